"""The master's time grid, its order of calls and its failure policy, on components made of lambdas."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.system import System
from sprain_cosim.cosim.transport import packed, pieces, unpacked
from sprain_cosim.errors import InputError, SimulationError
from tests.fake import FakeComponent, connector


def ramp(**more) -> FakeComponent:
    return FakeComponent(
        "a", {"y": connector("y", "output")}, advance=lambda s, i, t, h: s + h, output=lambda s, i: [s], **more
    )


def test_communication_points_come_from_the_integer() -> None:
    part = ramp()
    result = Master(communication_step=1e-4, stop=0.3).run(System((part,), {}).open(), {})
    assert result.status == "completed"
    assert len(result.time) == 3001
    assert result.time[-1] == 3000 * 1e-4
    steps = [float(line.split()[1]) for line in part.journal if line.startswith("do_step")]
    assert steps == [k * 1e-4 for k in range(3000)]


@pytest.mark.parametrize(
    ("master", "words"),
    [
        (Master(communication_step=7e-4), "near it are 0.75 ms and 0.625 ms"),
        (Master(communication_step=0.0), "must be positive"),
        (Master(communication_step=math.nan), "must be positive"),
        (Master(stop=0.0), "must lie after the start"),
        (Master(communication_step=1e-9, stop=1.0), "at most 10 000 000"),
    ],
)
def test_times_that_do_not_fit(master: Master, words: str) -> None:
    with pytest.raises(InputError, match=words):
        _ = master.steps


@pytest.mark.parametrize("step", [0.7e-3, 0.41e-3, 7e-3, 1.1e-5, 0.149])
def test_steps_that_are_proposed_are_accepted(step: float) -> None:
    with pytest.raises(InputError) as refused:
        _ = Master(communication_step=step).steps
    proposed = re.findall(r"([\d.]+) ms", str(refused.value).partition("near it are")[2])
    assert len(proposed) == 2
    assert float(proposed[1]) < 1e3 * step < float(proposed[0])
    for text in proposed:
        assert Master(communication_step=float(text) / 1e3).steps > 0


def test_steps_that_suit_the_plant_and_the_stop_are_proposed() -> None:
    part = ramp()
    plant = replace(part, name="plant", capabilities=replace(part.capabilities, fixed_step=2e-3))
    (problem,) = System((plant,), {}).check(5e-3, 0.15)
    assert "use 2 ms or 6 ms" in problem
    assert System((plant,), {}).check(6e-3, 0.15) == []


def test_a_result_passes_between_processes_to_the_bit_and_damage_is_no_result() -> None:
    result = Master(communication_step=1e-3, stop=0.01).run(System((ramp(),), {}).open(), {})
    content, numbers = json.loads(json.dumps(packed(result, 1))), pieces(result)
    arrived = unpacked(content, numbers)
    assert arrived.time.tobytes() == result.time.tobytes()
    assert arrived.values.tobytes() == result.values.tobytes()
    assert (arrived.names, arrived.units, arrived.held) == (result.names, result.units, result.held)
    for damaged in ([], [numbers[0][:-8]], [numbers[0][:-1]], [*numbers, *numbers], ["AAAA"], [None]):
        with pytest.raises(ValueError):  # noqa: PT011 - whatever NumPy says
            unpacked(content, damaged)
    with pytest.raises(ValueError, match="finished"):
        unpacked(content | {"status": "finished"}, numbers)


def test_a_value_that_is_not_finite_ends_the_run() -> None:
    part = FakeComponent(
        "a",
        {"y": connector("y", "output")},
        advance=lambda s, i, t, h: math.nan if t > 1.2e-3 else s,
        output=lambda s, i: [s],
    )
    result = Master(stop=5e-3).run(System((part,), {}).open(), {})
    assert (result.status, result.message) == ("failed", "a: y = nan at 0.002 s")
    assert len(result.time) == len(result.values) == 4
    assert np.isfinite(result.values).all()
    assert result.metrics == {}


def test_an_error_in_a_step_ends_the_run() -> None:
    def law(state, inputs, time, step):
        raise SimulationError("a: reported an error")

    result = Master(stop=5e-3).run(
        System((FakeComponent("a", {"y": connector("y", "output")}, advance=law, output=lambda s, i: [s]),), {}).open(),
        {},
    )
    assert (result.status, len(result.time)) == ("failed", 1)


def test_later_components_see_the_newest_outputs() -> None:
    """Gauss-Seidel: the follower's output at t(k+1) is the leader's at t(k+1)."""
    leader = FakeComponent(
        "lead", {"y": connector("y", "output")}, advance=lambda s, i, t, h: t + h, output=lambda s, i: [s]
    )
    follower = FakeComponent(
        "follow",
        {"x": connector("x", "input"), "y": connector("y", "output", depends_on=())},
        advance=lambda s, i, t, h: i["x"],
        output=lambda s, i: [s],
    )
    result = Master(stop=5e-3).run(System((leader, follower), {"follow.x": "lead.y"}).open(), {})
    assert result["follow.y"][1:] == pytest.approx(result.time[1:])
    assert result["follow.x"] == pytest.approx(result["lead.y"])


def test_runs_of_one_assembly_are_independent() -> None:
    assembly = System((ramp(),), {}).open()
    first, second = Master().run(assembly, {}), Master().run(assembly, {})
    assert (first.values == second.values).all()
