"""What a brace resists in postures of ordinary motion: foot and leg at rest, the device alone stepped until it is
static. In a child process, so that a device that crashes or hangs ends the child alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from ..cosim.loops import make_consistent
from ..errors import SimulationError
from ..fmu.driver import own_step
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - before the process is copied
from ..process import Child, Handlers, Limits, ProcessEnded, serve
from .scenario import Scenario

POSTURES = {  # of ordinary motion: (axis, angle [deg]), the other axis at 0
    **{f"plantarflexion_{d}deg": ("talocrural", -float(d)) for d in (5, 10)},
    **{f"dorsiflexion_{d}deg": ("talocrural", float(d)) for d in (5, 10)},
    **{f"supination_{d}deg": ("subtalar", float(d)) for d in (5, 10)},
}
HOLD = 0.1  # s, after which a held posture counts as static


def resistances(
    scenario: Scenario, settings: Sequence[Mapping[str, float]], limits: Limits | None = None
) -> list[dict[str, float]]:
    """For each of the `settings` {"component.parameter": value in its own unit}, {posture: N.m that resist it}; empty
    where the plant cannot be put into postures. Raises SimulationError when the process ends, and what the opening of
    the FMUs raises."""
    limits = limits or Limits()
    child = Child(__name__, limits)
    try:
        child.open(scenario.absolute(), limits.of_starts().seconds, scenario.confinement())
        limit = limits.of_trials().seconds
        return [child.call("hold", POSTURES, dict(values), limit=limit) for values in settings]
    except ProcessEnded as end:
        raise SimulationError(f"the process {end}{child.last_words()}") from None
    finally:
        child.close()


def hold(
    scenario: Scenario, postures: Mapping[str, tuple[str, float]], values: Mapping[str, float]
) -> dict[str, float]:
    """{posture: moment [N.m] of the brace about the posture's axis, positive when it resists}: foot and leg at rest in
    the posture, the device alone stepped for HOLD. Empty where the plant has no such parameters or outputs."""
    system = scenario.system()
    plant = system.component("plant")
    initial = [f"{axis}_{kind}_at_contact" for axis in ("talocrural", "subtalar") for kind in ("angle", "velocity")]
    if (
        plant is None
        or not all(n in plant.parameters for n in initial)
        or not all(f"brace_{a}_moment" in plant.outputs for a in ("talocrural", "subtalar"))
    ):
        return {}
    out = {}
    assembly = system.open()
    try:
        device = next(m for m in assembly.members if m.name == "brace")
        h = own_step(device.component)
        for posture, (axis, degrees) in postures.items():
            still = {f"plant.{n}": 0.0 for n in initial}
            connector = plant.parameters[f"{axis}_angle_at_contact"]
            angle = math.radians(degrees)
            still[f"plant.{axis}_angle_at_contact"] = connector.unit.from_base(angle) if connector.unit else angle
            assembly.start({**system.parameters, **values, **still}, 0.0, scenario.master.stop)
            for k in range(max(1, round(HOLD / h))):
                assembly.transfer(device)
                assembly.advance(device, k * h, h, all_outputs=True)
            make_consistent(assembly)
            out[posture] = math.copysign(1.0, degrees) * assembly.si(assembly.index[f"plant.brace_{axis}_moment"])
    finally:
        assembly.close()
    return out


@contextmanager
def _handlers(scenario: Scenario) -> Iterator[Handlers]:
    """The child: holds postures."""
    yield {"hold": lambda postures, values: hold(scenario, postures, values)}


if __name__ == "__main__":
    serve(_handlers)
