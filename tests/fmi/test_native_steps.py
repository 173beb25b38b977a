"""Steps taken in C give the record of the schemes in Python to the bit, and fail in the same words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.cosim import native_members
from sprain_cosim.cosim.native_steps import NativeSteps
from sprain_cosim.cosim.system import connect
from tests.native import compile_fmu, mischief

SHIPPED = ("level", "incline30", "incline30_brace", "incline30_reflex", "incline30_mixed")


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Of each run: whether its steps were taken in C."""
    found: list[bool] = []
    of = NativeSteps.of

    def watched(*arguments: object) -> NativeSteps | None:
        steps = of(*arguments)
        found.append(steps is not None)
        return steps

    monkeypatch.setattr(NativeSteps, "of", watched)
    return found


def both(monkeypatch: pytest.MonkeyPatch, run: object) -> Iterator[sc.Result]:
    """The result of `run()` in C, then in Python."""
    yield run()
    with monkeypatch.context() as patch:
        patch.setattr(native_members, "loaded", lambda: None)
        yield run()


def with_brace(fmu: Path) -> sc.Result:
    """30 ms of the braced landing by Gauss-Seidel."""
    parts = sc.load_scenario("incline30_brace").replace_fmu("brace", fmu).components()
    system = sc.System(parts, connect(parts, {})[0]).open()
    try:
        return sc.Master(scheme="gauss-seidel", stop=0.03).run(system, {})
    finally:
        system.close()


def same(one: sc.Result, other: sc.Result) -> None:
    assert (one.status, one.message, one.scheme) == (other.status, other.message, other.scheme)
    assert (one.exchanges, one.coupling_error, one.warning) == (other.exchanges, other.coupling_error, other.warning)
    assert one.values.tobytes() == other.values.tobytes()
    assert one.time.tobytes() == other.time.tobytes()


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize(("scheme", "step"), [("auto", 5e-4), ("gauss-seidel", 2.5e-4), ("jacobi", 2.5e-4)])
def test_records_are_equal_to_the_bit(
    name: str, scheme: str, step: float, monkeypatch: pytest.MonkeyPatch, taken: list[bool]
) -> None:
    scenario = sc.load_scenario(name)
    with scenario.open() as session:
        system = session.system.open()
        master = sc.Master(scheme=scheme, communication_step=step, stop=0.06)
        one, other = both(monkeypatch, lambda: master.run(system, session.system.parameters))
        system.close()
    assert taken == [True, False]
    assert one.status == "completed"
    same(one, other)


def test_what_needs_python_between_two_steps_is_left_to_it(taken: list[bool], tmp_path: Path) -> None:
    braced = sc.load_scenario("incline30_brace")
    black_box = compile_fmu(tmp_path / "black.fmu")
    for master, scenario in (
        (sc.Master(stop=0.01, record=("plant.*",)), braced),
        (sc.Master(stop=0.01, communication_step=1e-3), braced),
        (sc.Master(stop=0.01, scheme="gauss-seidel-extrapolated"), braced),
        (sc.Master(stop=0.01, adaptive=1e-3), braced),
        (sc.Master(stop=0.01), braced.replace_fmu("brace", black_box)),
    ):
        parts = scenario.components()
        system = sc.System(parts, connect(parts, {})[0]).open()
        assert master.run(system, {}).status == "completed"
        system.close()
    assert not any(taken)
    assert len(taken) == 5


@pytest.mark.parametrize("fault", ["none", "error", "fatal", "discard", "nan", "negative_infinity", "huge"])
def test_faults_end_a_run_in_the_same_words(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: list[bool]
) -> None:
    fmu = compile_fmu(tmp_path / "device.fmu", fault=fault)

    one, other = both(monkeypatch, lambda: with_brace(fmu))
    assert taken == [True, False]
    assert (one.status == "completed") == (fault == "none")
    same(one, other)


@pytest.mark.parametrize("kind", ["round_up", "flush_to_zero", "unknown_status", "negative_status"])
def test_a_foreign_library_changes_no_arithmetic_but_its_own(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: list[bool]
) -> None:
    fmu = mischief(tmp_path / "device.fmu", kind)

    one, other = both(monkeypatch, lambda: with_brace(fmu))
    assert taken == [True, False]
    same(one, other)


def test_a_library_of_another_source_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    assert native_members.loaded() is not None
    native_members.loaded.cache_clear()
    monkeypatch.setattr(native_members, "source_digest", lambda name: "0" * 64)
    try:
        assert native_members.loaded() is None
    finally:
        native_members.loaded.cache_clear()
