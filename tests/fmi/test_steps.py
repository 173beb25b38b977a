"""Steps that an FMU refuses, ends early, ends the run in, or computes in the background: as FMI says, with C FMUs of
our own."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim.cosim.coupling import SCHEMES
from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.result import Result
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.isolated import isolated
from sprain_cosim.scenario import load_scenario
from tests.fake import FakeComponent, connector
from tests.native import device

EVENTS = 'hasEventMode="true"'
EARLY = 'mightReturnEarlyFromDoStep="true"'


def moving() -> FakeComponent:
    """A foot that turns at 2 rad/s whatever the torque."""
    return FakeComponent(
        "plant",
        {
            "subtalar_angle": connector("subtalar_angle", "output", "rad", depends_on=()),
            "brace_subtalar_torque": connector("brace_subtalar_torque", "input", "N.m"),
        },
        advance=lambda state, inputs, time, step: 2.0 * (time + step),
        output=lambda state, inputs: [state],
    )


def run(fmu: Path, scheme: str = "gauss-seidel", step: float = 1e-3) -> Result:
    parts = (moving(), Component.read("brace", fmu))
    assembly = System(parts, connect(parts, {})[0]).open()
    try:
        return Master(step, 0.02, scheme=scheme, guard=False).run(assembly, {})
    finally:
        assembly.close()


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Result:
    result = run(device(tmp_path_factory.mktemp("plain") / "device.fmu"))
    assert result.status == "completed"
    return result


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("tells", [1, 0])
def test_a_refused_step_is_taken_in_parts(fmi: int, tells: int, plain: Result, tmp_path: Path) -> None:
    """At most 0.3 ms of 1 ms; whether it says how far it came or not."""
    result = run(device(tmp_path / "device.fmu", fmi, behaviour={"REFUSES": 3e-4, "TELLS": tells}))
    assert result.status == "completed", result.message
    assert result["brace.subtalar_torque"] == pytest.approx(plain["brace.subtalar_torque"], rel=1e-12, abs=1e-14)


def test_a_refused_step_in_a_process_of_its_own(plain: Result, tmp_path: Path) -> None:
    brace = isolated(Component.read("brace", device(tmp_path / "device.fmu", behaviour={"REFUSES": 3e-4})))
    parts = (moving(), brace)
    assembly = System(parts, connect(parts, {})[0]).open()
    result = Master(1e-3, 0.02, scheme="gauss-seidel", guard=False).run(assembly, {})
    assembly.close()
    assert result.status == "completed", result.message
    assert result["brace.subtalar_torque"] == pytest.approx(plain["brace.subtalar_torque"], rel=1e-12, abs=1e-14)


def test_a_refused_step_under_iteration(tmp_path: Path) -> None:
    refused, free = (
        run(device(tmp_path / f"{k}.fmu", behaviour=b), "iterative") for k, b in enumerate(({"REFUSES": 3e-4}, {}))
    )
    assert refused.status == "completed", refused.message
    assert refused["brace.subtalar_torque"] == pytest.approx(free["brace.subtalar_torque"], rel=1e-12, abs=1e-14)


def test_a_refused_step_without_saved_states_says_how_far_it_came_and_what_to_do(tmp_path: Path) -> None:
    result = run(device(tmp_path / "device.fmu", behaviour={"REFUSES": 3e-4}, saves=False))
    assert (result.status, len(result.time)) == ("failed", 1)
    assert result.message == (
        "brace: discarded the call in the step from 0 s to 0.001 s; it got to 0.0003 s; it cannot save its state, so "
        "the step cannot be taken in parts; "
        "take a smaller communication step"
    )
    assert (
        run(device(tmp_path / "other.fmu", behaviour={"REFUSES": 3e-4}, saves=False), step=2.5e-4).status == "completed"
    )


def test_an_fmu_without_saved_states_runs_under_every_scheme_that_needs_none(tmp_path: Path) -> None:
    """On the real plant, its stiffness found from its direct answer; the iteration names it."""
    scenario = (
        load_scenario("incline30")
        .replace_fmu("brace", device(tmp_path / "device.fmu", saves=False))
        .with_master(stop="60 ms")
    )
    for scheme in SCHEMES:
        if scheme == "iterative":
            with pytest.raises(InputError, match="iterative: brace cannot save and restore its state"):
                scenario.with_master(scheme).run()
        else:
            assert scenario.with_master(scheme).run().status == "completed"
    assert scenario.run().scheme_reason.startswith(
        "found by finite differences: stiffness of brace about subtalar from its direct answer"
    )


def test_a_device_that_refuses_every_step_ends_the_run(tmp_path: Path) -> None:
    result = run(device(tmp_path / "device.fmu", behaviour={"REFUSES": 1e-12, "TELLS": 0}))
    assert result.status == "failed"
    assert "discarded the call in the step from 0 s to" in result.message
    assert "however small the parts" in result.message


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_can_end_the_run(fmi: int, plain: Result, tmp_path: Path) -> None:
    """Stopped is neither completed nor failed; the record until then stays, and no metrics are made of it."""
    result = run(device(tmp_path / "device.fmu", fmi, behaviour={"ENDS": 0.0104}))
    assert (result.status, result.message) == ("stopped", "brace: asked to end the simulation at 0.0104 s")
    assert len(result.time) == len(result.values) == 21  # every 0.5 ms up to the last exchange
    assert result["brace.subtalar_torque"] == pytest.approx(plain["brace.subtalar_torque"][:21], rel=1e-12)
    assert result.metrics == {}


@pytest.mark.parametrize(
    ("behaviour", "attributes"),
    [
        ({"RETURNS": 7e-4}, EARLY),  # early returns, no events to handle
        ({"RETURNS": 7e-4, "EVENTS": 1}, f"{EARLY} {EVENTS}"),
        ({"RETURNS": 7e-4, "NAMES": 1}, EVENTS),  # the time of the next event is named; steps must not pass it
        ({}, EVENTS),
    ],
)
def test_early_returns_and_events(behaviour: dict[str, float], attributes: str, plain: Result, tmp_path: Path) -> None:
    result = run(device(tmp_path / "device.fmu", 3, behaviour=behaviour, attributes=attributes))
    assert result.status == "completed", result.message
    assert result["brace.subtalar_torque"] == pytest.approx(plain["brace.subtalar_torque"], rel=1e-12, abs=1e-14)


def test_early_returns_under_iteration(tmp_path: Path) -> None:
    """The time of the next event is rolled back with the state."""
    result = run(
        device(tmp_path / "device.fmu", 3, behaviour={"RETURNS": 7e-4, "NAMES": 1}, attributes=EVENTS), "iterative"
    )
    assert result.status == "completed", result.message


def test_an_early_return_that_was_not_allowed_is_an_error(tmp_path: Path) -> None:
    result = run(device(tmp_path / "device.fmu", 3, behaviour={"RETURNS": 7e-4}))
    assert result.status == "failed"
    assert "returned at 0.0007 s though early return was not allowed" in result.message


def test_a_step_in_the_background_is_waited_for(plain: Result, tmp_path: Path) -> None:
    result = run(device(tmp_path / "device.fmu", behaviour={"WAITS": 3}))
    assert (result.values == plain.values).all()
