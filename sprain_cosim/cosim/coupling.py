"""The scheme of one run: chosen by what the components can do, checked for stability, started."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError, nearest
from .assembly import Assembly
from .course import course_doubts
from .energy import Values, exchange, residual
from .identification import Identification, Linearisation
from .schedule import Schedule
from .schemes.adaptive import Adaptive
from .schemes.extrapolated import Extrapolated
from .schemes.gauss_seidel import GaussSeidel
from .schemes.impedance import Impedance
from .schemes.iterative import Iterative
from .schemes.jacobi import Jacobi
from .schemes.protocol import Scheme
from .stability import WARNING, WRONG_SIGN, growth, own_doubts, verdict

__all__ = ["SCHEMES", "Coupling", "Scheme", "begin", "check_scheme"]


SCHEMES = (Jacobi.name, GaussSeidel.name, Extrapolated.name, Iterative.name, Impedance.name)


def check_scheme(name: str) -> None:
    """Raises InputError for an unknown name."""
    known = ["auto", *SCHEMES]
    if name not in known:
        raise InputError(f"scheme {name!r} is unknown{nearest(name, known)}")


@dataclass(frozen=True)
class Coupling:
    """The scheme of one run, started.

    scheme          what couples
    reason          why it was taken, in words
    warning         of the stability guard and the identification; empty for none
    identification  of what is handed over; None where nothing is
    """

    scheme: Scheme
    reason: str
    warning: str
    identification: Identification | None = None

    def step(self, assembly: Assembly, time: float, step: float, due: Sequence[str] = ()) -> None:
        """From one point of exchange to the next; there, the members that are `due` are called. Raises
        SimulationError."""
        self.scheme.step(assembly, time, step)
        if due:
            assembly.call(due)
            if self.identification is not None and self.identification.update_called(due, time + step):
                assembly.refresh_feedback(carry_on=False)

    def judgement(self, assembly: Assembly, passed: Values, schedule: Schedule) -> tuple[float | None, str]:
        """The coupling error and the warning of a run whose values at the schedule's points were `passed` (n + 1,
        slots): what was known at its start, and what its course showed."""
        found = exchange(assembly, passed, schedule.step, schedule.due)
        if isinstance(self.scheme, Adaptive) and all(own.rate.sampled for own in assembly.own_rate.values()):
            error = self.scheme.error
        else:
            error = residual(self.scheme, found)
        doubts = course_doubts(found, list(assembly.system.torques), WRONG_SIGN in self.warning)
        return error, "; ".join([*doubts, *([self.warning] if self.warning else [])])

    def effort(self, schedule: Schedule, points: int) -> tuple[int, float]:
        """Exchanges up to this point of the schedule, and the smallest step [s] between two of them."""
        if isinstance(self.scheme, Adaptive):
            return self.scheme.exchanges, self.scheme.smallest
        return points, float(schedule.step[: max(1, points)].min())


def begin(
    name: str, assembly: Assembly, step: float, steps: int, identify: int = 1, guard: bool = True, adaptive: float = 0.0
) -> Coupling:
    """Chooses and starts the scheme of an assembly that has started, for `steps` steps of `step` [s]; `identify`,
    `guard` and `adaptive` as in Master. Raises InputError for a scheme that the system cannot run or, with `guard`,
    that would be unstable."""
    check_scheme(name)
    unable = [m.name for m in assembly.stepping if not m.component.capabilities.state]
    if name == Iterative.name and unable:
        raise InputError(
            f"scheme iterative: {', '.join(unable)} cannot save and restore its state; use auto, impedance or "
            "gauss-seidel"
        )
    probing = guard or name in ("auto", Impedance.name)
    identification = Identification(assembly, step) if probing else None
    found = identification.linearisation if identification else None
    reason = "asked for"
    if name == "auto":
        name, reason = _choose(found, not unable, step, steps)
    elif name == Impedance.name:
        reason = f"asked for; {_handed_over(found)}"
    warnings = []
    plain: dict[str, type[Scheme]] = {s.name: s for s in (Jacobi, GaussSeidel, Extrapolated, Iterative)}
    scheme: Scheme = (
        plain[name]() if name in plain else Impedance(identification or Identification(assembly, step), identify)
    )
    if adaptive:
        scheme = Adaptive(scheme, assembly, step, adaptive)
    if guard:
        warnings = _guarded(scheme, found, step, steps, states=not unable)
    scheme.start(assembly)
    handing = identification if name == Impedance.name and identify else None
    return Coupling(scheme, reason, "; ".join(w for w in warnings if w), handing)


def _guarded(scheme: Scheme, found: Linearisation | None, step: float, steps: int, states: bool) -> list[str]:
    """What the guard has to say. Raises InputError where the coupling would be unstable."""
    finest = scheme.allowed[-1] if isinstance(scheme, Adaptive) else 1
    others = (Impedance.name, Iterative.name) if states else (Impedance.name,)
    level, message = verdict(scheme.name, found, step / finest, steps * finest, others)
    if level == "refusal":
        raise InputError(message)
    return [message, found.doubt if found else "", *own_doubts(found, step * steps)]


def _choose(found: Linearisation | None, states: bool, step: float, steps: int) -> tuple[str, str]:
    """Impedance hand-over wherever something can be handed over; else Gauss-Seidel, if it is stable; else iteration, if
    all can repeat a step."""
    if found is None:
        return GaussSeidel.name, "no device gives the plant a torque"
    if found.period.all():
        periods = " and ".join(f"{1e3 * p:g} ms" for p in sorted(set(found.period.tolist())))
        return GaussSeidel.name, f"every torque is sampled, every {periods}, and held in between"
    if found.declared or found.identified:
        return Impedance.name, f"{_handed_over(found)}; {found.size()} at the start"
    why = "stiffness and damping are neither declared nor to be found"
    if found.inertia is not None and growth(GaussSeidel.name, found, step, steps) > WARNING:
        if states:
            return Iterative.name, f"{why}, and gauss-seidel would not be stable: {found.size()} at the start"
        return GaussSeidel.name, f"{why}, and no iteration: not every component saves its state"
    return GaussSeidel.name, why


def _handed_over(found: Linearisation | None) -> str:
    if found is None or not (found.declared or found.identified):
        return "nothing to hand over"
    parts = [f"the device declares {', '.join(found.declared)}"] if found.declared else []
    if found.identified:
        parts.append(f"found by finite differences: {', '.join(found.identified)}")
    return "; ".join(parts)
