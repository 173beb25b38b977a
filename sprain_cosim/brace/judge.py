"""What the measurements of probe.py mean: problems, warnings and notes about a device's steps, repeatability and
physics."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from ..contract import MAX_VELOCITY_DEG_S, POSITIVE
from ..fmu.driver import STEP
from ..fmu.element import Capabilities
from ..literature import BRACES_TEXT
from .fit import FitReport
from .probe import ROUNDING, STATIC_DEG
from .strength import Strength

SMALL = 1e-9  # N.m, N.m/rad and so on: as good as zero
REPLAYED = 1e-6  # of the largest torque: what a restored state may miss
Measured = dict[str, dict[str, Any]]  # results by probe


# ---- communication steps


def judge_steps(taken: dict[str, list[float] | str], step: float, able: Capabilities, report: FitReport) -> float:
    """The step [s] to go on with: `step`, or the nearest one that the device takes.

    - taken: by communication step [s], as text: the torques [N.m] call by call, or the message of a refusal
    - able: what the device's description declares, its own fixed step among it
    """
    calls = {float(h): t for h, t in taken.items() if not isinstance(t, str)}
    report.facts["steps_taken_s"] = sorted(calls)
    if not calls:
        report.problems.append(
            f"takes no communication step between 0.1 and 5 ms: {next(str(t) for t in taken.values())}"
        )
        return step
    if able.fixed_step is not None:
        report.facts["own_step_s"] = able.fixed_step
        report.notes.append(_rate(able.fixed_step, able.continuous))
    _judge_refusals(calls, [float(h) for h, t in taken.items() if isinstance(t, str)], report)
    _judge_step_sensitivity(calls, report)
    return step if any(abs(h - step) < 1e-9 for h in calls) else min(calls, key=lambda h: abs(h - step))


def _judge_refusals(calls: dict[float, list[float]], refused: list[float], report: FitReport) -> None:
    own = min(calls)
    if refused and not any(_multiple(h, own) for h in refused) and all(_multiple(h, own) for h in calls):
        report.facts["own_step_s"] = own
        report.warnings.append(
            f"has a fixed step of its own that it does not declare: takes {_ms(calls)}, refuses {_ms(refused)};"
            f' step = "{1e3 * own:g} ms" in a mapping file calls it at that rate'
        )
        report.proposal = f'step = "{1e3 * own:g} ms"   # review\n{report.proposal}'
    elif refused:
        report.warnings.append(f"refuses communication steps of {_ms(refused)}; takes {_ms(calls)}: give --step")


def _judge_step_sensitivity(calls: dict[float, list[float]], report: FitReport) -> None:
    values = [torques[-1] for torques in calls.values()]
    spread = (max(values) - min(values)) / max(max(abs(v) for v in values), SMALL)
    report.facts["step_sensitivity"] = spread
    if _same_call_by_call(calls):
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


def _same_call_by_call(calls: dict[float, list[float]]) -> bool:
    """Whether two neighbouring steps give one sequence of torques, which changes from call to call."""
    ordered = sorted(calls)
    return any(
        _distinct(calls[long]) >= 3 and calls[short][: len(calls[long])] == calls[long]
        for short, long in itertools.pairwise(ordered)
    )


def _distinct(torques: list[float]) -> int:
    """How many values differ by more than rounding."""
    rounding = ROUNDING * max(abs(t) for t in torques)
    return 1 + sum(after - before > rounding for before, after in itertools.pairwise(sorted(torques)))


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


def _ms(steps: Iterable[float]) -> str:
    return ", ".join(f"{1e3 * h:g}" for h in sorted(steps)) + " ms"


# ---- repeatability


def judge_dynamics(measured: Measured, report: FitReport) -> None:
    """Fresh instances, reset and saved states: do they give the same torques?"""
    if not measured["repeat"]["equal"]:
        report.problems.append(
            "a fresh instance gives other torques than the one before it (by up to "
            f"{measured['repeat']['difference']:.3g} N.m): runs cannot be repeated"
        )
    every = measured["recorded"]["changes_every"]
    if every is not None:
        report.facts["changes_every_s"] = every
        report.notes.append(
            f"takes any step, but its torque changes only every {1e3 * every:g} ms: a sampled controller inside; runs "
            "exchange values with it at the communication step"
        )
    reset = measured.get("reset")
    report.facts["reset_works"] = bool(reset and reset["equal"])
    if reset is not None and not reset["equal"]:
        report.notes.append(
            f"its reset leaves something behind (up to {reset['difference']:.3g} N.m); no run uses it, every run takes "
            "a fresh instance"
        )
    state = measured.get("state")
    report.facts["state_works"] = bool(state and state["equal"])
    if state is not None and not state["equal"] and state["difference"] <= REPLAYED * state["largest"]:
        report.notes.append(
            f"a saved state replays torques that differ by {state['difference'] / state['largest']:.1g} of the "
            "largest: the tolerance of its solver"
        )
    elif state is not None and not state["equal"]:
        report.problems.append(
            f"claims to restore its state, but then replays other torques (by up to {state['difference']:.3g} N.m); "
            "withdraw the claim"
        )


# ---- physics


@dataclass(frozen=True)
class CycleWork:
    """What a device does on a closed path, all numbers in J but the last.

    - path: the path in words
    - taken: energy taken from the foot; stored: the most that was taken or given meanwhile
    - turning: W; times an age [s] of the torque: what a torque so old gives
    """

    path: str
    taken: float
    stored: float
    turning: float

    def gives(self, age: float) -> bool:
        """Whether it gives more than torques of this mean age [s] explain, and 1 % of what it stores."""
        return self.taken < -max(1e-6, 1e-2 * self.stored + 1.3 * age * self.turning)

    @property
    def gives_little(self) -> bool:
        """Whether it gives more than rounding and solvers explain."""
        return self.taken < -max(1e-6, 1e-3 * self.stored)

    @property
    def takes(self) -> bool:
        return self.taken > max(1e-6, 1e-3 * self.stored)


@dataclass(frozen=True)
class AxisMeasurement:
    """One axis of a device, in the contract's signs and SI units.

    - pairs: (angle [deg], torque [N.m] there, torque at the opposite angle) of held angles, rising
    - rest: torque at zero angle [N.m]
    - one_sided: (angle [deg], torque [N.m]) of held angles whose opposite lies beyond the range
    - damping, fast_damping: N.m.s/rad, passing zero at 200 and 1000 deg/s
    - near, far: work in a closed cycle of +-15 deg, and in one as far and fast as a landing
    - declared: stiffness at 5 deg that the device declares, and that of its torque [N.m/rad]; or None
    - others_resist: whether another axis gives a torque at a held angle
    - secants: secant stiffness -(torque - rest)/angle [N.m/rad] by angle [deg]
    """

    axis: str
    pairs: list[tuple[float, float, float]]
    one_sided: list[tuple[float, float]]
    rest: float
    damping: float
    fast_damping: float
    near: CycleWork
    far: CycleWork
    declared: tuple[float, float] | None
    others_resist: bool
    secants: dict[float, float] = field(init=False)

    def __post_init__(self) -> None:
        secants = {
            sign * d: -(torque - self.rest) / math.radians(sign * d)
            for d, *both in self.pairs
            for sign, torque in zip((1, -1), both, strict=True)
        }
        secants |= {d: -(torque - self.rest) / math.radians(d) for d, torque in self.one_sided}
        object.__setattr__(self, "secants", secants)

    @classmethod
    def read(cls, axis: str, k: int, measured: Measured) -> AxisMeasurement:
        """Of axis number `k`, from the results of the probes static, moving and cycle."""
        static = measured["static"]
        others = [t for a, rows in static["torque"].items() if a != axis for _, *both in rows for t in both]
        declared = static["declared"].get(axis)
        return cls(
            axis,
            [(d, plus, minus) for d, plus, minus in static["torque"][axis]],
            [(d, torque) for d, torque in static["one_sided"][axis]],
            static["rest"][k],
            measured["moving"]["damping"][axis],
            measured["moving"]["fast_damping"][axis],
            CycleWork("a cycle of +-15 deg", *measured["cycle"]["cycle"][axis]),
            CycleWork(
                f"a cycle up to {STATIC_DEG[-1]:g} deg at up to {MAX_VELOCITY_DEG_S:g} deg/s",
                *measured["cycle"]["far_cycle"][axis],
            ),
            None if declared is None else (declared[0], declared[1]),
            any(abs(t) > SMALL for t in others),
        )

    @property
    def largest(self) -> float:
        """Largest secant stiffness [N.m/rad], whatever its sign."""
        return max(abs(s) for s in self.secants.values())

    @property
    def pushing(self) -> list[float]:
        """Angles [deg] at which the torque pushes the foot away from rest."""
        return [d for d, s in self.secants.items() if s < -self._noise]

    @property
    def resisting(self) -> list[float]:
        """Angles [deg] at which the torque pushes the foot back."""
        return [d for d, s in self.secants.items() if s > self._noise]

    @property
    def _noise(self) -> float:
        return max(SMALL, 1e-6 * self.largest)

    @property
    def over_centre(self) -> bool:
        """Whether it pushes near the middle and resists further out, on every side on which it pushes."""
        sides = [[abs(d) for d in self.pushing if sign * d > 0] for sign in (1, -1)]
        beyond = [[abs(d) for d in self.resisting if sign * d > 0] for sign in (1, -1)]
        return all(out and min(out) > max(near) for near, out in zip(sides, beyond, strict=True) if near)

    def age(self, measured: Measured, step: float) -> float:
        """Mean age [s] of the torque by its own hold or delay. Within the usual step nobody can tell a late answer from
        the exchange itself."""
        every = measured["recorded"]["changes_every"] or 0.0
        return max(0.5 * every, step if self.late(step) or step <= STEP else 0.5 * step)

    @property
    def facts(self) -> dict[str, Any]:
        return {
            "torque_at_rest_Nm": self.rest,
            "secant_stiffness_Nm_per_rad": {f"{d:g}deg": s for d, s in self.secants.items()},
            "torque_Nm": {
                f"{sign * d:g}deg": t for d, plus, minus in self.pairs for sign, t in ((1, plus), (-1, minus))
            }
            | {f"{d:g}deg": t for d, t in self.one_sided},
            "damping_Nms_per_rad": self.damping,
            "fast_damping_Nms_per_rad": self.fast_damping,
            "energy_taken_per_cycle_J": self.near.taken,
            "energy_taken_per_far_cycle_J": self.far.taken,
        }

    def late(self, step: float) -> bool:
        """Whether the damping is that of an elastic torque which answers one communication step [s] late."""
        return 0.7 < -self.damping / max(SMALL, self.secants[self.pairs[0][0]] * step) < 1.3


def judge_physics(axis: str, k: int, measured: Measured, step: float, active: bool, report: FitReport) -> None:
    """Sign, damping, energy and declared stiffness of axis number `k`; `active`: may push the foot."""
    found = AxisMeasurement.read(axis, k, measured)
    report.facts[axis] = found.facts
    sink = report.warnings if active else report.problems
    age = found.age(measured, step)
    giving = [work for work in (found.near, found.far) if work.gives(age)]
    pushes_any_passing_foot = not found.resisting and found.damping < -SMALL
    if found.pushing and not found.resisting:
        _report_pushing_everywhere(found, active, sink, report)
    elif found.pushing:
        _report_pushing_in_part(found, bool(giving), active, report)
    if giving and active:
        report.notes.append(f"{axis}: active, {_gifts(giving)}")
    elif giving and (found.resisting or not found.pushing) and not pushes_any_passing_foot:
        report.problems.append(
            f"{axis}: does net work on the foot, which a passive brace cannot: {_gifts(giving)}; "
            + ("correct its law" if found.resisting else _sign_advice(axis, report))
            + ", or write active = true in a mapping file if it is meant to"
        )
        if not found.resisting:
            _propose_sign(axis, report)
    if found.resisting:
        _judge_damping(found, step, age, report)
        _note_hold(found, age, bool(giving), report)
        _note_stiffness(found, report)
        _judge_declared_stiffness(found, report)
    elif not found.pushing and (pushes_any_passing_foot or not giving):
        _judge_without_stiffness(found, sink, report)


def judge_landing(measured: Measured, axes: tuple[str, ...], step: float, active: bool, report: FitReport) -> None:
    """Torque and work over the recorded landing."""
    work = CycleWork("the recorded landing, from zero and back to zero", *measured["closed_landing"]["work"])
    age = max(AxisMeasurement.read(axis, k, measured).age(measured, step) for k, axis in enumerate(axes))
    if work.gives(age) and active:
        report.notes.append(f"active, {_gifts([work])}")
    elif work.gives(age) and report.fits:
        report.problems.append(
            f"does net work on the foot, which a passive brace cannot: {_gifts([work])}; is the sign of its torque "
            "right? Correct it, or write active = true in a mapping file if it is meant to"
        )
    recorded = measured["recorded"]
    strength = Strength.of(measured["static"], recorded)
    if strength.doubt and strength.torque > 0:
        report.warnings.append(
            f"up to {strength.torque:.3g} N.m in a landing and {strength.stiffness:.3g} N.m/rad: {strength.doubt} "
            f"({BRACES_TEXT}): are its units right, those of its angles too?"
        )
    report.facts["landing"] = {
        "peak_torque_Nm": dict(zip(axes, recorded["peak_torque"], strict=True)),
        "work_taken_J": recorded["work_taken"],
        "work_taken_from_zero_to_zero_J": work.taken,
    }


def _report_pushing_everywhere(found: AxisMeasurement, active: bool, sink: list[str], report: FitReport) -> None:
    axis, at = found.axis, max(found.pushing)
    push = found.rest - found.secants[at] * math.radians(at)
    way = (
        f"{POSITIVE[axis]} {at:g} deg ({axis} +)"
        if at > 0
        else f"the other way than {POSITIVE[axis]}, {-at:g} deg ({axis} -)"
    )
    sink.append(
        f"sign: {way}: the brace pushes it further with {abs(push):.3g} N.m instead of resisting; "
        f"{_sign_advice(axis, report)}" + ("" if active else ", or active = true if it is meant to")
    )
    _propose_sign(axis, report)


def _judge_without_stiffness(found: AxisMeasurement, sink: list[str], report: FitReport) -> None:
    """No torque at held angles: a damper, a free axis, or nothing that a probe can tell the sign of."""
    axis, damping = found.axis, found.damping
    if damping < -SMALL:
        sink.append(
            f"sign: {axis} moving at 200 deg/s through zero is pushed faster (damping {damping:.3g} N.m.s/rad); "
            f"{_sign_advice(axis, report)}"
        )
        _propose_sign(axis, report)
    elif damping > SMALL:
        report.notes.append(
            f"{axis}: no static stiffness, damping {damping:.3g} N.m.s/rad: it slows the foot; velocity and torque "
            "both of the other sign would look the same"
        )
    elif found.fast_damping < -SMALL:
        sink.append(
            f"sign: {axis} moving at {MAX_VELOCITY_DEG_S:g} deg/s through zero is pushed faster (damping "
            f"{found.fast_damping:.3g} N.m.s/rad); {_sign_advice(axis, report)}"
        )
        _propose_sign(axis, report)
    elif found.near.takes or found.far.takes:
        work = found.near if found.near.takes else found.far
        report.notes.append(f"{axis}: no torque at held angles; takes {work.taken:.3g} J in {work.path}: it resists")
    elif found.others_resist:
        report.notes.append(f"{axis}: left free")
    else:
        where = (
            f"at held angles up to {STATIC_DEG[-1]:g} deg, passing zero at {MAX_VELOCITY_DEG_S:g} deg/s, nor in closed "
            "cycles"
        )
        report.warnings.append(f"{axis}: no torque {where}: no probe can tell its sign; it is assumed right")


def _judge_damping(found: AxisMeasurement, step: float, age: float, report: FitReport) -> None:
    if found.late(step):
        report.notes.append(
            f"{found.axis}: answers one communication step late, which the coupling cannot make good: better send the "
            "torque at the end of the step"
        )
    elif found.damping < -max(SMALL, 1e-5 * found.largest, 2.0 * age * found.largest if age > step else 0.0):
        report.warnings.append(
            f"{found.axis}: pushes a passing foot faster (damping {found.damping:.3g} N.m.s/rad): is the sign of "
            f"{found.axis}_velocity right?"
        )


def _gifts(works: list[CycleWork]) -> str:
    return ", ".join(f"gives {-work.taken:.3g} J in {work.path}" for work in works)


def _report_pushing_in_part(found: AxisMeasurement, giving: bool, active: bool, report: FitReport) -> None:
    where = (
        f"{found.axis}: pushes the foot away from rest at {_degrees(found.pushing)}, and back at "
        f"{_degrees(found.resisting)}"
    )
    if found.over_centre and not giving:
        report.warnings.append(
            f"{where}: over centre, it gives back no more than it takes, but its rest is not stable: the foot snaps to "
            "either side; is it meant to?"
        )
        return
    (report.warnings if active else report.problems).append(
        f"{where}: it resists in part of the range only"
        + ("" if active else "; correct its law, or write active = true in a mapping file if it is meant to")
    )


def _note_hold(found: AxisMeasurement, age: float, giving: bool, report: FitReport) -> None:
    """What the hold or the delay of a passive device gives."""
    if found.near.gives_little and not giving:
        report.notes.append(
            f"{found.axis}: gives {-found.near.taken:.3g} J in {found.near.path}: no more than torques that are "
            f"{1e3 * age:.3g} ms old on average do, like a negative damping of about "
            f"{age * found.largest:.2g} N.m.s/rad"
        )


def _note_stiffness(found: AxisMeasurement, report: FitReport) -> None:
    axis = found.axis
    near = found.near
    energy = (
        _gifts([near]) if near.gives_little else f"takes {near.taken:.3g} J in a cycle" if near.takes else "elastic"
    )
    d, plus, minus = next((p for p in found.pairs if p[0] == 10.0), found.pairs[-1])
    does = "pushes it back with" if plus < 0 else "gives"
    report.notes.append(
        f"{axis}: stiffness up to {found.largest:.3g} N.m/rad (secant), damping {found.damping + 0.0:.3g} N.m.s/rad"
    )
    report.notes.append(
        f"{POSITIVE[axis]} {d:g} deg ({axis} +): the brace {does} {abs(plus):.3g} N.m; the other way {abs(minus):.3g} "
        f"N.m; {energy}"
    )
    if abs(plus + minus) < 0.02 * abs(plus - minus):
        report.notes.append(
            f"{axis}: symmetric, so angle and torque both of the other sign would look the same; + is taken to mean "
            f"{POSITIVE[axis]}"
        )


def _judge_declared_stiffness(found: AxisMeasurement, report: FitReport) -> None:
    if found.declared is None:
        return
    declared, true = found.declared
    if abs(declared - true) > max(1e-6, 0.05 * max(abs(true), found.largest)):
        report.warnings.append(
            f"{found.axis}_stiffness says {declared:.4g} N.m/rad at 5 deg, its torque says {true:.4g}: it must be "
            "-d(torque)/d(angle); the coupling relies on it"
        )


def _sign_advice(axis: str, report: FitReport) -> str:
    if report.mapping:
        return (
            f"if the sign is meant the other way round, change that of factor in outputs.{axis}_torque of "
            f"{report.mapping}"
        )
    return f"if the sign is meant the other way round, write {_turned(axis, report)} under [outputs] of a mapping file"


def _turned(axis: str, report: FitReport) -> str:
    """The entry of a mapping file that turns the torque round; it states the unit where the FMU does not."""
    output = f"{axis}_torque"
    stated = ', unit = "N.m"' if output in report.facts.get("undeclared_units", ()) else ""
    return f'{output} = {{ from = "{output}", factor = -1{stated} }}'


def _propose_sign(axis: str, report: FitReport) -> None:
    if not report.mapping:
        section = "" if "[outputs]" in report.proposal else "[outputs]\n"
        report.proposal += f"{section}{_turned(axis, report)}   # review\n"


def _degrees(angles: list[float]) -> str:
    return ", ".join(f"{d:+g}" for d in sorted(angles)) + " deg"
