"""Does a device FMU fit the contract? Five stages in order, nothing native loaded before archive and description pass:

1 archive, 2 description (both raise InputError: not a usable FMU) - 3 contract: names, causality, units - 4 dynamics
and 5 physics, measured by probe.py in a child process under a time limit."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..contract import AXES, INPUTS, OUTPUTS, POSITIVE, plain, profile
from ..errors import InputError, SprainError
from ..fmu import archive, cache
from ..fmu.component import Component
from ..fmu.element import Capabilities, Connector
from ..mapping import carried, load_mapping
from ..process import Child, Limits, ProcessEnded
from .probe import CYCLE_SPEED, STATIC_DEG, own_step

START_LIMIT, PROBE_LIMIT = 60.0, 6.0  # s
SMALL = 1e-9
LEAST, LARGEST = 0.5, 1000.0  # N.m at the peak of a landing; beyond, a unit is suspected
WORDS = {  # of vendors' names, for the proposal of a mapping
    "subtalar": ("subtalar", "supin", "inv", "ever", "roll"),
    "talocrural": ("talocrural", "dorsi", "plantar", "flex", "pitch"),
}
WORDS_JCS = {
    "internal_rotation": ("internal", "axial", "yaw", "introt"),
    "inversion": ("inv", "ever", "supin", "roll"),
    "dorsiflexion": ("dorsi", "plantar", "flex", "pitch"),
}


@dataclass
class Report:
    """`fits`; `problems` that keep it from fitting, `warnings`, `notes` in words; `facts` measured (SI); `proposal` a
    mapping file to start from, where names do not match; `next_step` what to type."""

    fmu: str
    interface: str = ""
    tool: str = ""
    profile: str | None = None
    mapping: str = ""
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    proposal: str = ""
    next_step: str = ""

    @property
    def fits(self) -> bool:
        return not self.problems

    @property
    def verdict(self) -> str:
        return "does not fit" if self.problems else "fits with warnings" if self.warnings else "fits"

    def as_dict(self) -> dict[str, Any]:
        names = (
            "fmu",
            "interface",
            "tool",
            "profile",
            "mapping",
            "problems",
            "warnings",
            "notes",
            "facts",
            "proposal",
            "next_step",
        )
        return {"verdict": self.verdict, "fits": self.fits, **{n: _finite(getattr(self, n)) for n in names}}

    def text(self) -> str:
        made = f", made by {self.tool}" if self.tool else ""
        lines = [
            f"{self.fmu}: {self.verdict}",
            f"  {self.interface}{made}{f', profile {self.profile}' if self.profile else ''}",
        ]
        for title, entries in (("problem", self.problems), ("warning", self.warnings), ("note", self.notes)):
            lines += [f"  {title + ':':9}{entry}" for entry in entries]
        if self.next_step:
            lines.append(f"\nnext: {self.next_step}")
        return "\n".join(lines)


def _finite(value: Any) -> Any:
    """JSON has no infinity: what overflowed becomes null."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def check_brace(fmu: Path | str, mapping: Path | str | None = None) -> Report:
    """Raises InputError when it is not a usable FMU: archive, description, library, or it cannot be instantiated even
    once."""
    component = Component.read("brace", fmu)
    checked = archive.read(component.fmu)
    archive.verify(checked)
    unusable = component.library_problem()
    if unusable:
        raise InputError(f"{fmu}: {unusable}")
    inside = carried(component)
    found = load_mapping(mapping) if mapping is not None else inside
    report = Report(str(fmu), component.capabilities.interface, component.capabilities.tool)
    if component.capabilities.shared_modules:
        report.notes.append("its Python modules could clash with another FMU's: a run gives it a process of its own")
    if component.capabilities.single:
        report.notes.append("allows one instance per process: two of them in one run need --isolate")
    if inside is not None and mapping is not None:
        report.notes.append(f"the mapping inside the FMU is not used, but {mapping} in its place")
    if found is not None:
        component, report.mapping = found.apply(component), found.source
    axes = _contract(component, report)
    if report.fits:
        cache.unpacked(component.fmu, component.sha256)
        try:
            _measure(component, axes, found is not None and found.active, report)
        except InputError:
            cache.forget(component.sha256)
            raise
    mapped = f" --map brace={mapping}" if mapping is not None else ""
    if report.proposal:
        report.next_step = f"review the mapping file, then sprain-cosim check {fmu} --map FILE"
    elif report.fits:
        report.next_step = f"sprain-cosim run incline30 --fmu brace={fmu}{mapped}"
    elif not report.next_step:
        report.next_step = (
            f"correct it, then sprain-cosim check {fmu}{f' --map {mapping}' if mapping is not None else ''}"
        )
    return report


# ---- 3 contract


def _contract(component: Component, report: Report) -> tuple[str, ...]:
    outputs = {plain(n): c for n, c in component.outputs.items()}
    inputs = {plain(n): c for n, c in component.inputs.items()}
    for causality, known in (("input", INPUTS), ("output", OUTPUTS)):
        for name in known:
            same = [n for n in component.select(causality) if plain(n) == plain(name)]
            if len(same) > 1:
                report.problems.append(
                    f"{' and '.join(same)} both read as {name}, since ., _ and letter case do not count; rename one"
                )
    axes = tuple(a for a in AXES if plain(f"{a}_torque") in outputs)
    report.profile = profile(set(axes))
    if not axes:
        report.proposal = propose(component)
        candidates = [n for n, c in component.outputs.items() if _fits(c, "torque")]
        if not candidates:
            report.problems.append(
                "no output in N.m, declared or named as a torque: this is no brace in the sense of the contract"
            )
            report.proposal = ""
            report.next_step = (
                "sprain-cosim brace new DIR for a brace to start from, or sprain-cosim brace from-csv "
                "TABLE.csv for one from a measured table"
            )
        else:
            report.problems.append(
                f"no output is named A_torque for an axis A ({', '.join(AXES)}); candidates: {', '.join(candidates)}"
            )
        return axes
    if report.profile is None:
        report.problems.append(f"torques of several profiles ({', '.join(axes)}); map only those of one")
    for axis in axes:
        if plain(f"{axis}_angle") not in inputs:
            close = ", ".join(difflib.get_close_matches(f"{axis}_angle", component.inputs, 3, 0.4))
            report.problems.append(
                f"no input {axis}_angle [rad], which {axis}_torque needs{f'; candidates: {close}' if close else ''}"
            )
            report.proposal = propose(component)
    if not any(plain(f"{a}_velocity") in inputs for a in axes):
        report.notes.append("no velocity inputs: the brace sees how fast the foot moves only by the angle's change")
    for known, have in ((INPUTS, inputs), (OUTPUTS, outputs)):
        for name, wanted in known.items():
            connector = have.get(plain(name))
            if connector is None:
                continue
            if not connector.scalar_number:
                report.problems.append(f"{connector.name}: is of type {connector.kind}; the contract has scalar reals")
            elif connector.unit is None:
                report.warnings.append(f"{connector.name}: no unit declared; {wanted.name} is assumed")
            elif not connector.unit.same_dimension(wanted):
                report.problems.append(
                    f"{connector.name}: unit {connector.unit.name} has the dimension {connector.unit.dimension()}, "
                    f"expected {wanted.dimension()};"
                    f' declare it right, or write unit = "..." in a mapping file'
                )
    extra = [n for n in component.inputs if plain(n) not in {plain(k) for k in INPUTS}]
    if extra:
        report.notes.append(
            "inputs outside the contract keep their start values: "
            f"{', '.join(extra[:6])}{' ...' if len(extra) > 6 else ''}"
        )
    return axes


def _fits(connector: Connector, kind: str) -> bool:
    wanted = (OUTPUTS if kind == "torque" else INPUTS)[f"subtalar_{kind}"]
    if connector.unit is not None and not connector.unit.dimensionless:
        return connector.unit.same_dimension(wanted)
    words = {
        "torque": ("torque", "moment", "tau", "m_"),
        "angle": ("angle", "ang", "phi", "theta", "rot"),
        "velocity": ("vel", "omega", "rate", "speed"),
    }
    return any(w in connector.name.lower() for w in words[kind])


def propose(component: Component) -> str:
    """A mapping file from names, units and causality; lines to be looked at end in `# review`."""
    lines: list[str] = ["# Proposed by sprain-cosim check: look at every line, then delete this one."]
    jcs = any(w in n.lower() for n in (*component.inputs, *component.outputs) for w in WORDS_JCS["internal_rotation"])
    for section, link, kinds in (("inputs", "to", ("angle", "velocity")), ("outputs", "from", ("torque",))):
        lines.append(f"[{section}]")
        taken: set[str] = set()
        for kind in kinds:
            for name, connector in component.select(section[:-1]).items():
                if not connector.scalar_number or not _fits(connector, kind):
                    continue
                axis = next(
                    (a for a, words in (WORDS_JCS if jcs else WORDS).items() if any(w in name.lower() for w in words)),
                    None,
                )
                sure = axis is not None and connector.unit is not None
                target = f"{axis or 'subtalar'}_{kind}"
                unit = (
                    ""
                    if connector.unit is not None and not connector.unit.dimensionless
                    else ', unit = "N.m"'
                    if kind == "torque"
                    else ', unit = "rad"'
                )
                unit = unit.replace("rad", "rad/s") if kind == "velocity" else unit
                line = f'{target} = {{ {link} = "{name}"{unit} }}'
                lines.append(
                    f"# {line}   # review: a second candidate"
                    if target in taken
                    else line
                    if sure
                    else f"{line}   # review"
                )
                taken.add(target)
        if not taken:
            lines.append("# no candidate found")
    return "\n".join(lines) + "\n"


# ---- 4 dynamics, 5 physics


def _measure(component: Component, axes: tuple[str, ...], active: bool, report: Report) -> None:
    child = Child("sprain_cosim.brace.probe", Limits(memory=8 << 30))
    try:
        try:
            child.open((component, axes), START_LIMIT)
        except ProcessEnded as end:
            raise InputError(f"{component.fmu}: cannot be instantiated: {end}{child.last_words()}") from None
        except SprainError as problem:
            raise InputError(f"{component.fmu}: cannot be instantiated: {problem}") from None
        measured, step = _probe(child, component, report)
    finally:
        child.close()
    if not measured:
        return
    _judge_dynamics(measured, report)
    for k, axis in enumerate(axes):
        _judge_physics(axis, k, measured, step, active, report)
    peak = max(measured["recorded"]["peak_torque"])
    if peak > LARGEST or 0 < peak < LEAST:
        report.warnings.append(
            f"at most {peak:.3g} N.m in a landing, where braces give tens: are its units right, those of its angles "
            "too?"
        )
    report.facts["landing"] = {
        "peak_torque_Nm": dict(zip(axes, measured["recorded"]["peak_torque"], strict=True)),
        "work_taken_J": measured["recorded"]["work_taken"],
    }


def _probe(child: Child, component: Component, report: Report) -> tuple[dict[str, dict[str, Any]], float]:
    """{experiment: its numbers}, and the step [s] that they were made with; nothing when one of them ended the check,
    as the report says."""
    measured: dict[str, dict[str, Any]] = {}
    step = own_step(component)
    for name in ORDER:
        if name == "state" and not component.capabilities.state:
            continue
        try:
            measured[name] = child.call("run", name, step, limit=PROBE_LIMIT)
        except ProcessEnded as end:
            report.problems.append(f"{DOING[name]}: the device {end}{child.last_words()}")
            return {}, step
        except SprainError as problem:
            report.problems.append(f"{DOING[name]}: {str(problem).removeprefix('brace: ')}")
            return {}, step
        if name == "steps":
            step = _judge_steps(measured[name]["taken"], step, component.capabilities, report)
            if not report.fits:
                return {}, step
        elif name == "reset" and component.capabilities.reusable and not measured[name]["equal"]:
            report.problems.append(
                "its reset does not give a fresh instance, though reset = true says so; take that line out of the "
                "mapping file"
            )
            return {}, step
    return measured, step


ORDER = ("steps", "start", "reset", "repeat", "state", "finite", "recorded", "static", "moving", "cycle")
DOING = {
    "steps": "trying communication steps",
    "start": "instantiated twice and started",
    "repeat": "two landings in a row, each with a fresh instance",
    "reset": "two landings in a row, reset between",
    "state": "saving and restoring its state in a landing",
    "finite": "over the physiological range at up to 1000 deg/s",
    "recorded": "through a recorded landing",
    "static": "held at angles",
    "moving": "passed through zero at 200 deg/s",
    "cycle": "in closed cycles of +-15 deg",
}


def _judge_steps(taken: dict[str, list[float] | str], step: float, able: Capabilities, report: Report) -> float:
    """The step to go on with: the wanted one, or one that it takes."""
    calls = {float(h): t for h, t in taken.items() if not isinstance(t, str)}
    report.facts["steps_taken_s"] = sorted(calls)
    if not calls:
        report.problems.append(
            f"takes no communication step between 0.1 and 5 ms: {next(str(t) for t in taken.values())}"
        )
        return step
    refused = [float(h) for h, t in taken.items() if isinstance(t, str)]
    own = min(calls)
    if able.fixed_step is not None:
        report.facts["own_step_s"] = able.fixed_step
        report.notes.append(_rate(able.fixed_step, able.continuous))
    if refused and not any(_multiple(h, own) for h in refused) and all(_multiple(h, own) for h in calls):
        report.facts["own_step_s"] = own
        report.warnings.append(
            f"has a fixed step of its own that it does not declare: takes {_ms(calls)}, refuses {_ms(refused)};"
            f' step = "{1e3 * own:g} ms" in a mapping file calls it at that rate'
        )
        report.proposal = f'step = "{1e3 * own:g} ms"   # review\n{report.proposal}'
    elif refused:
        report.warnings.append(f"refuses communication steps of {_ms(refused)}; takes {_ms(calls)}: give --step")
    values = [t[-1] for t in calls.values()]
    scale = max(max(abs(v) for v in values), SMALL)
    spread = (max(values) - min(values)) / scale
    report.facts["step_sensitivity"] = spread
    alike = [sorted(calls)[k : k + 2] for k in range(len(calls) - 1)]
    if any(len(set(calls[b])) >= 3 and calls[a][: len(calls[b])] == calls[b] for a, b in alike):
        report.problems.append(
            "advances by a step of its own whatever step it is asked for: call by call it gives the same torques at "
            f"{_ms(calls)};"
            ' declare it (canHandleVariableCommunicationStepSize="false", stepSize in DefaultExperiment), or write '
            'step = "..." in a mapping file'
        )
    elif spread > 1e-3:
        report.warnings.append(
            f"its torque depends on the communication step: {100 * spread:.2g} % between {_ms(calls)} with the angle "
            "held at 10 deg"
        )
    return step if any(abs(h - step) < 1e-9 for h in calls) else min(calls, key=lambda h: abs(h - step))


def _rate(period: float, continuous: bool) -> str:
    if continuous:
        return (
            f"has steps of its own of {1e3 * period:g} ms and a law that is continuous in truth: its torque is carried "
            "on by its stiffness between its calls"
        )
    return (
        f"sampled every {1e3 * period:g} ms: every run calls it at that rate and holds its torque in between; if its "
        "law is continuous in truth and the step only that of the tool it was exported with, write continuous = true "
        "in a mapping file"
    )


def _multiple(h: float, own: float) -> bool:
    return abs(h / own - round(h / own)) < 1e-6


def _ms(steps: Any) -> str:
    return ", ".join(f"{1e3 * h:g}" for h in sorted(steps)) + " ms"


def _judge_dynamics(measured: dict[str, dict[str, Any]], report: Report) -> None:
    if not measured["repeat"]["equal"]:
        report.problems.append(
            "a fresh instance gives other torques than the one before it (by up to "
            f"{measured['repeat']['difference']:.3g} N.m): runs cannot be repeated"
        )
    reset = measured["reset"]
    report.facts["reset_works"] = bool(reset["equal"])
    if not reset["equal"]:
        report.warnings.append(
            f"its reset leaves something behind (up to {reset['difference']:.3g} N.m); every run takes a fresh instance"
        )
    state = measured.get("state")
    report.facts["state_works"] = bool(state and state["equal"])
    if state is not None and not state["equal"]:
        report.problems.append(
            f"claims to restore its state, but then replays other torques (by up to {state['difference']:.3g} N.m); "
            "withdraw the claim"
        )


def _propose_sign(output: str, report: Report) -> None:
    if not report.mapping:
        report.proposal += (
            "" if "[outputs]" in report.proposal else "[outputs]\n"
        ) + f'{output} = {{ from = "{output}", factor = -1 }}   # review\n'


def _degrees(angles: list[float]) -> str:
    return ", ".join(f"{d:+g}" for d in sorted(angles)) + " deg"


def _judge_physics(
    axis: str, k: int, measured: dict[str, dict[str, Any]], step: float, active: bool, report: Report
) -> None:
    pairs = measured["static"]["torque"][axis]
    damping = measured["moving"]["damping"][axis]
    taken, stored = measured["cycle"]["cycle"][axis]
    rest = measured["static"]["rest"][k]
    secants = {
        sign * d: -(torque - rest) / math.radians(sign * d)
        for d, *both in pairs
        for sign, torque in zip((1, -1), both, strict=True)
    }
    largest = max(abs(s) for s in secants.values())
    report.facts[axis] = {
        "torque_at_rest_Nm": rest,
        "secant_stiffness_Nm_per_rad": {f"{d:g}deg": s for d, s in secants.items()},
        "torque_Nm": {f"{sign * d:g}deg": t for d, plus, minus in pairs for sign, t in ((1, plus), (-1, minus))},
        "damping_Nms_per_rad": damping,
        "energy_taken_per_cycle_J": taken,
    }
    against = f"{axis}_torque"
    if report.mapping:
        advice = (
            f"if the sign is meant the other way round, change that of factor in outputs.{against} of {report.mapping}"
        )
    else:
        advice = (
            f'if the sign is meant the other way round, write {against} = {{ from = "{against}", factor = -1 }} '
            "under [outputs] of a mapping file"
        )
    sink = report.warnings if active else report.problems
    noise = max(SMALL, 1e-6 * largest)
    wrong = [d for d, s in secants.items() if s < -noise]
    right = [d for d, s in secants.items() if s > noise]
    d, plus, minus = next((p for p in pairs if p[0] == 10.0), pairs[-1])
    if wrong and not right:
        at = max(wrong)
        push = next(plus if at > 0 else minus for e, plus, minus in pairs if e == abs(at))
        way = (
            f"{POSITIVE[axis]} {at:g} deg ({axis} +)"
            if at > 0
            else f"the other way than {POSITIVE[axis]}, {-at:g} deg ({axis} -)"
        )
        sink.append(
            f"sign: {way}: the brace pushes it further with {abs(push):.3g} N.m instead of resisting; {advice}"
            + ("" if active else ", or active = true if it is meant to")
        )
        _propose_sign(against, report)
        return
    if wrong:
        sink.append(
            f"{axis}: pushes the foot away from rest at {_degrees(wrong)}, and back at {_degrees(right)}: it resists "
            "in part of the range only"
            + ("" if active else "; correct its law, or write active = true in a mapping file if it is meant to")
        )
    if not right and not wrong:
        if damping < -SMALL:
            sink.append(
                f"sign: {axis} moving at 200 deg/s through zero is pushed faster (damping {damping:.3g} N.m.s/rad); "
                f"{advice}"
            )
            _propose_sign(against, report)
            return
        if damping <= SMALL:
            others = [
                t for a, rows in measured["static"]["torque"].items() if a != axis for _, *both in rows for t in both
            ]
            if any(abs(t) > SMALL for t in others):
                report.notes.append(f"{axis}: left free")
                return
            where = f"at held angles up to {STATIC_DEG[-1]:g} deg nor when passing zero"
            report.warnings.append(f"{axis}: no torque {where}: no probe can tell its sign; it is assumed right")
            return
        report.notes.append(
            f"{axis}: no static stiffness, damping {damping:.3g} N.m.s/rad: it slows the foot; velocity and torque "
            "both of the other sign would look the same"
        )
        return
    late = 0.7 < -damping / max(SMALL, secants[pairs[0][0]] * step) < 1.3
    if late:
        report.notes.append(
            f"{axis}: answers one communication step late, which the coupling cannot make good: better send the "
            "torque at the end of the step"
        )
    elif damping < -max(SMALL, 1e-5 * largest):
        report.warnings.append(
            f"{axis}: pushes a passing foot faster (damping {damping:.3g} N.m.s/rad): is the sign of {axis}_velocity "
            "right?"
        )
    gives = taken < -max(
        1e-6, (1e-3 + late * 13 * CYCLE_SPEED * step) * stored
    )  # late by h, an elastic one gives 2 pi w h of what it stores
    if gives and not active:
        report.warnings.append(
            f"{axis}: gives {-taken:.3g} J in a closed cycle: an active device; say so with active = true in a "
            "mapping file"
        )
    kind = (
        f"gives {-taken:.3g} J in a cycle of +-15 deg"
        if gives
        else f"takes {taken:.3g} J in a cycle"
        if taken > 1e-3 * stored
        else "elastic"
    )
    report.notes.append(
        f"{axis}: stiffness up to {largest:.3g} N.m/rad (secant), damping {damping + 0.0:.3g} N.m.s/rad"
    )
    does = "pushes it back with" if plus < 0 else "gives"
    report.notes.append(
        f"{POSITIVE[axis]} {d:g} deg ({axis} +): the brace {does} {abs(plus):.3g} N.m; the other way {abs(minus):.3g} "
        f"N.m; {kind}"
    )
    if abs(plus + minus) < 0.02 * abs(plus - minus):
        report.notes.append(
            f"{axis}: symmetric, so angle and torque both of the other sign would look the same; + is taken to mean "
            f"{POSITIVE[axis]}"
        )
    said = measured["static"]["declared"].get(axis)
    if said is not None:
        declared, true = said
        if abs(declared - true) > max(1e-6, 0.05 * max(abs(true), largest)):
            report.warnings.append(
                f"{axis}_stiffness says {declared:.4g} N.m/rad at 5 deg, its torque says {true:.4g}: it must be "
                "-d(torque)/d(angle); the coupling relies on it"
            )
