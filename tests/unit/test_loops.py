"""Consistent values at the start: direct feed-through solved by substitution and by Newton's method, or named."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import SimulationError
from tests.fake import connector
from tests.unit.test_system import component, device, plant


def loop(brace: Callable[[float], float], plant: Callable[[float], float] = lambda torque: -torque) -> System:
    """Direct feed-through both ways: torque = brace(angle), angle = plant(torque)."""
    device_ = device("subtalar", output=lambda s, i: [brace(i["subtalar_angle"])])
    foot = component(
        "plant",
        connector("subtalar_angle", "output", "rad"),
        connector("brace_subtalar_torque", "input", "N.m"),
        output=lambda s, i: [plant(i["brace_subtalar_torque"])],
    )
    parts = (foot, device_)
    return System(parts, connect(parts, {})[0])


@pytest.mark.parametrize(
    ("brace", "torque"),
    [
        (lambda x: 1.0 + 0.5 * x, 2.0 / 3.0),  # substitution settles
        (lambda x: 1.0 + 0.9 * x, 1.0 / 1.9),  # it would take 260 rounds
        (lambda x: 1.0 - 0.99 * x, 100.0),
        (lambda x: 1.0 + 2.0 * x, 1.0 / 3.0),  # from here on it diverges
        (lambda x: 1.0 - 3.0 * x, -0.5),
        (lambda x: 1.0 + 2000.0 * x, 1.0 / 2001.0),
        (lambda x: 5.0 + 40.0 * x + 300.0 * x**3, 0.11174210743783466),  # cubic, gain 40 and more
    ],
)
def test_a_loop_is_solved_whatever_its_gain(brace: Callable[[float], float], torque: float) -> None:
    assembly = loop(brace).open()
    assembly.start({}, 0.0, 1.0)
    bus, at = assembly.bus, assembly.index
    assert bus[at["brace.subtalar_torque"]] == pytest.approx(torque, rel=1e-9)
    assert bus[at["plant.subtalar_angle"]] == pytest.approx(-bus[at["plant.brace_subtalar_torque"]], rel=1e-10)
    assert bus[at["brace.subtalar_torque"]] == pytest.approx(brace(bus[at["brace.subtalar_angle"]]), rel=1e-9)


def test_a_loop_over_two_axes_with_a_follower_is_solved() -> None:
    """Gains of -4 and 3 across the axes; the follower only reads."""
    axes = ("talocrural", "subtalar")
    gain = np.array([[0.5, -4.0], [3.0, 1.5]])
    angles = [connector(f"{a}_angle", "input", "rad") for a in axes]
    brace = component(
        "brace",
        *angles,
        *(connector(f"{a}_torque", "output", "N.m") for a in axes),
        output=lambda s, i: gain @ [i[f"{a}_angle"] for a in axes] + [1.0, -2.0],
    )
    plant = component(
        "plant",
        *(connector(f"brace_{a}_torque", "input", "N.m") for a in axes),
        *(connector(f"{a}_angle", "output", "rad") for a in axes),
        output=lambda s, i: [i[f"brace_{a}_torque"] for a in axes],
    )
    reader = component(
        "reader",
        connector("subtalar_angle", "input", "rad"),
        connector("y", "output"),
        output=lambda s, i: [2.0 * i["subtalar_angle"]],
    )
    parts = (plant, brace, reader)
    assembly = System(parts, connect(parts, {})[0]).open()
    assembly.start({}, 0.0, 1.0)
    truth = np.linalg.solve(np.eye(2) - gain, [1.0, -2.0])
    assert [assembly.bus[assembly.index[f"plant.{a}_angle"]] for a in axes] == pytest.approx(truth, rel=1e-9)
    assert assembly.bus[assembly.index["reader.y"]] == pytest.approx(2.0 * truth[1], rel=1e-9)


@pytest.mark.parametrize("brace", [lambda x: 1.0 + x * x, lambda x: x + 1.0 if x < 0 else x - 1.0])
def test_a_loop_without_a_solution_is_named_connection_by_connection(brace: Callable[[float], float]) -> None:
    result = Master(stop=1e-3).run(loop(brace, plant=lambda torque: torque).open(), {})
    assert result.status == "failed"
    assert "no solution found for the loop through" in result.message
    assert (
        "brace.subtalar_angle = plant.subtalar_angle" in result.message
        or "plant.brace_subtalar_torque = brace.subtalar_torque" in result.message
    )


def test_failure_at_the_start_names_the_variable() -> None:
    broken = device("subtalar", output=lambda s, i: [math.nan])
    parts = (plant(), broken)
    assembly = System(parts, connect(parts, {})[0]).open()
    with pytest.raises(SimulationError, match=r"brace.subtalar_torque is not finite at the start"):
        assembly.start({}, 0.0, 1.0)
