"""Elements of FMI 3 arrays, 32-bit numbers, input clocks: mapped like any scalar, or refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import check_brace, load_scenario
from sprain_cosim.brace.names import clocks
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.mapping import parse
from tests.fmi.test_versions import angles, baseline  # noqa: F401
from tests.native import changed, device

MAP = '[inputs]\nsubtalar_angle = "u[2,1]"\n[outputs]\nsubtalar_torque = "y[2]"\n'
U = (
    '<UInt64 name="n" valueReference="30" causality="structuralParameter" variability="tunable" start="2"/>'
    '<Float64 name="u" valueReference="20" causality="input" variability="continuous" unit="rad" start="0 0 0 1">'
    '<Dimension valueReference="30"/><Dimension start="2"/></Float64>'
)
Y = (
    '<Float64 name="y" valueReference="21" causality="output" variability="continuous" unit="N.m">'
    '<Dimension start="3"/></Float64>'
)
P = (
    '<Float64 name="p" valueReference="22" causality="parameter" variability="fixed" start="20 1">'
    '<Dimension start="2"/></Float64>'
)


SCALARS = {
    U: '<Float64 name="subtalar_angle" valueReference="0" causality="input" variability="continuous" unit="rad" '
    'start="0"/>',
    Y: '<Float64 name="subtalar_torque" valueReference="1" causality="output" variability="continuous" unit="N.m"/>',
    P: '<Float64 name="stiffness" valueReference="2" causality="parameter" variability="fixed" unit="N.m/rad" '
    'start="20"/>',
    '<Output valueReference="21"': '<Output valueReference="1"',
    '<InitialUnknown valueReference="21"': '<InitialUnknown valueReference="1"',
}


@pytest.fixture(scope="module")
def arrays(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arrays")
    plain = device(folder / "plain.fmu", 3, behaviour={"ARRAYS": 1})
    return changed(plain, folder / "arrays.fmu", {old: new for new, old in SCALARS.items()})


def test_described(arrays: Path) -> None:
    component = Component.read("brace", arrays)
    assert [n for n in component.inputs if n != "u"] == ["u[1,1]", "u[1,2]", "u[2,1]", "u[2,2]"]
    assert [component.inputs[n].start for n in ("u[1,1]", "u[2,2]")] == [0.0, 1.0]
    assert list(component.outputs) == ["y", "y[1]", "y[2]", "y[3]"]
    assert component.parameters["p[1]"].start == 20.0
    assert not component.inputs["u"].scalar_number


def test_the_landing_is_that_of_the_scalar_brace(arrays: Path, baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    """Elements that nothing feeds keep their start values."""
    (tmp_path / "m.toml").write_text(MAP)
    scenario = load_scenario("incline30").replace_fmu("brace", arrays, tmp_path / "m.toml").with_master("gauss-seidel")
    with scenario.open() as session:
        for result in (session.run(), session.run()):
            assert result.status == "completed", result.message
            assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-12


def test_elements_that_are_set_hold(arrays: Path) -> None:
    """A parameter, and an input that nothing feeds, each beside elements of the same array; a run leaves nothing."""
    component = parse(MAP, "here").apply(Component.read("brace", arrays))
    with Driver(component, ["subtalar_angle"], ["subtalar_torque", "y[1]"]) as driver:

        def torque(parameters: dict[str, float]) -> float:
            driver.start(parameters, {"subtalar_angle": 0.1})
            driver.step(1.0)
            return driver["subtalar_torque"]

        first = torque({})
        assert first == pytest.approx(-20 * 0.1 * 1.04, rel=1e-9)
        assert torque({"p[1]": 40.0}) == pytest.approx(2 * first, rel=1e-9)
        assert torque({"u[2,2]": 0.5}) == pytest.approx(first / 2, rel=1e-9)
        assert torque({"u[1,1]": 3.0, "p[2]": 3.0}) == pytest.approx(3 * first, rel=1e-9)
        assert driver["y[1]"] == 3.0
        assert torque({}) == first


def test_check_lists_and_proposes_them(arrays: Path, tmp_path: Path) -> None:
    report = check_brace(arrays)
    assert not report.fits
    assert '"y[2]"' in report.proposal
    assert "u[2,1]" in report.proposal
    (tmp_path / "m.toml").write_text(MAP)
    assert check_brace(arrays, tmp_path / "m.toml").fits


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        ("u[3,1]", r"the array u has u\[1,1\] to u\[2,2\]"),
        ("u[2]", r"the array u has u\[1,1\] to u\[2,2\]"),
        ("u", "is of type array; only scalar numbers can be mapped"),
        ("y[2]", "is of causality output; only an input"),
    ],
)
def test_what_is_no_element(variable: str, words: str, arrays: Path) -> None:
    mapping = parse(f'[inputs]\nsubtalar_angle = "{variable}"\n', "here")
    with pytest.raises(InputError, match=words):
        mapping.apply(Component.read("brace", arrays))


def test_arrays_that_stay_whole(arrays: Path, tmp_path: Path) -> None:
    """Too many elements, or another number of start values: not offered, so that nothing is set by guess."""
    for old, new in (('<Dimension valueReference="30"/>', '<Dimension start="999"/>'), ("0 0 0 1", "0 0 1")):
        component = Component.read("brace", changed(arrays, tmp_path / "w.fmu", {old: new}))
        assert list(component.inputs) == ["u"]
        with pytest.raises(InputError, match="whose elements cannot be mapped; export scalars"):
            parse(MAP, "here").apply(component)


def test_numbers_of_32_bits(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    narrow = {old: old.replace("Float64", "Float32") for old in (SCALARS[U], SCALARS[Y])}
    fmu = changed(device(tmp_path / "plain.fmu", 3), tmp_path / "narrow.fmu", narrow)
    assert 0 < np.abs(angles(fmu) - baseline).max() < 1e-5
    component = Component.read("brace", fmu)
    assert (component.inputs["subtalar_angle"].kind, component.inputs["subtalar_angle"].fmi_type) == ("real", "Float32")


CLOCK = """<Clock name="tick" valueReference="40" causality="input" variability="discrete" 
  intervalVariability="constant" intervalDecimal="0.01"/></ModelVariables>"""


@pytest.mark.parametrize("declared", [True, False])
def test_a_torque_that_waits_for_a_clock(declared: bool, tmp_path: Path) -> None:
    """No run ticks clocks, so such a device does not fit: by its description, or since its torque never changes."""
    plain = device(tmp_path / "plain.fmu", 3, sign=1.0 if declared else 0.0)
    clocked = {"</ModelVariables>": CLOCK} | (
        {SCALARS[Y]: SCALARS[Y].replace('"continuous"', '"discrete" clocks="40"')} if declared else {}
    )
    report = check_brace(changed(plain, tmp_path / "clocked.fmu", clocked))
    assert not report.fits
    words = (
        "subtalar_torque changes only when its clock (tick) ticks, and no run ticks clocks"
        if declared
        else "its torque never changed, it has input clocks (tick) that may trigger its law"
    )
    assert words in report.problems[0]


def test_a_clock_of_constant_interval_ticks(tmp_path: Path) -> None:
    """FMI 3 leaves it to the host of event mode: from the start on, at its own times, with the inputs of the moment."""
    plain = device(tmp_path / "plain.fmu", 3, behaviour={"CLOCKED": 1}, attributes='hasEventMode="true"')
    clocked = {"</ModelVariables>": CLOCK, SCALARS[Y]: SCALARS[Y].replace('"continuous"', '"discrete" clocks="40"')}
    component = Component.read("brace", changed(plain, tmp_path / "clocked.fmu", clocked))
    assert component.inputs["tick"].interval == 0.01
    for step in (1e-3, 3e-3, 20e-3):
        with Driver(component, ["subtalar_angle"], ["subtalar_torque"]) as driver:
            driver.start({}, {"subtalar_angle": 0.1})
            torques = []
            for k in range(round(0.06 / step)):
                driver.step(step, {"subtalar_angle": 0.1 + k * step}, k * step)
                torques.append(driver["subtalar_torque"])
        ends = step * np.arange(1, len(torques) + 1)
        ticks = np.floor(ends / 0.01 + 1e-6)
        changes = np.flatnonzero(np.diff(torques))
        assert (changes == np.flatnonzero(np.diff(ticks))).all()
    few, notes = clocks(component)
    assert not few
    assert notes == ["every run ticks its clocks: tick every 10 ms"]
