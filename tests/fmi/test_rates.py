"""Sampled devices on the real plant: C FMUs with a fixed step against the same law in an FMU that takes any step and
samples by itself, exchanged every 0.05 ms."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import check_brace
from sprain_cosim.cosim.result import Result
from sprain_cosim.scenario import load_scenario
from tests.laws import sampled
from tests.native import device

FIGURES = [  # k [N.m/rad], period [ms], peak [deg]
    (60.0, 10, 33.62),
    (120.0, 10, 21.85),
    (60.0, 5, 32.71),
    (120.0, 5, 20.39),
    (120.0, 1, 19.35),
]
AXES = ("subtalar", "talocrural", "dorsiflexion", "inversion", "internal_rotation")


def land(fmu: Path, step: str | None = None, scheme: str | None = None) -> Result:
    result = load_scenario("incline30").replace_fmu("brace", fmu).with_master(scheme, step).run()
    assert result.status == "completed", result.message
    return result


@pytest.mark.parametrize(("k", "period", "peak"), FIGURES)
@pytest.mark.parametrize("step", [None, "10 ms"])
def test_peaks_of_a_sampled_spring(k: float, period: int, peak: float, step: str | None, tmp_path: Path) -> None:
    """Whatever the communication step; the record stays on 0.5 ms, so the ground reaction does not see the rate."""
    result = land(sampled(tmp_path / "brace.fmu", "subtalar", k, 0.0, 1e-3 * period, fixed=True), step)
    assert result.metrics["peak_subtalar_angle_deg"] == pytest.approx(peak, abs=0.1)
    assert len(result.time) == 301
    assert result.held["brace"].period == 1e-3 * period
    assert result.held["brace"].share > 0.01 * period
    assert result.coupling_error < 1e-6


def test_the_ground_reaction_is_that_of_the_plant_s_grid() -> None:
    """Without a brace: 8767 N, not the 6021 N of a record every 10 ms."""
    usual, coarse = (load_scenario("incline30").with_master(communication_step=h).run() for h in ("0.5 ms", "10 ms"))
    assert usual.metrics["peak_vertical_grf_N"] == pytest.approx(8767, abs=3)
    assert coarse.metrics["peak_vertical_grf_N"] == pytest.approx(8767, rel=0.01)
    assert (usual.time == coarse.time).all()


def against_a_fine_exchange(numbers: np.random.Generator, folder: Path) -> tuple[str, float]:
    """(what was drawn, difference of the peaks [deg])."""
    k, c = numbers.uniform(10.0, 200.0), numbers.uniform(0.0, 0.5)
    period = float(np.exp(numbers.uniform(np.log(2e-4), np.log(1.5e-2))))
    if numbers.random() < 0.5:
        period = max(1, round(1e4 * period)) * 1e-4
    axis = AXES[numbers.integers(len(AXES))]
    own = land(sampled(folder / "own.fmu", axis, k, c, period, fixed=True))
    fine = land(sampled(folder / "fine.fmu", axis, k, c, period, fixed=False), "0.05 ms", "gauss-seidel")
    key = "peak_subtalar_angle_deg"
    return f"{axis} {k:.1f} {c:.3f} {1e3 * period:.4f} ms", own.metrics[key] - fine.metrics[key]


@pytest.mark.parametrize("seed", range(3))
def test_any_sampled_law_is_the_one_of_a_fine_exchange(seed: int, tmp_path: Path) -> None:
    what, difference = against_a_fine_exchange(np.random.default_rng(seed), tmp_path)
    assert abs(difference) < 0.05, what


@pytest.mark.long
def test_forty_sampled_laws_are_those_of_a_fine_exchange(tmp_path: Path) -> None:
    numbers, worst = np.random.default_rng(40), ("", 0.0)
    for case in range(40):
        (tmp_path / str(case)).mkdir()
        worst = max(worst, against_a_fine_exchange(numbers, tmp_path / str(case)), key=lambda found: abs(found[1]))
    assert abs(worst[1]) < 0.05, worst


def test_half_the_communication_step_leaves_the_device_its_rate(tmp_path: Path) -> None:
    scenario = load_scenario("incline30").replace_fmu(
        "brace", sampled(tmp_path / "brace.fmu", "subtalar", 60.0, 0.0, 7e-3, fixed=True)
    )
    change = scenario.coupling_check(scenario.run())
    assert abs(change["peak_subtalar_angle_deg"]) < 0.05


@pytest.mark.parametrize("period", [0.005, 0.002])
def test_check_names_a_rate_that_no_description_declares(period: float, tmp_path: Path) -> None:
    """An FMU that takes any step and samples by itself; a declared one is said in words too."""
    free = check_brace(sampled(tmp_path / "free.fmu", "subtalar", 60.0, 0.0, period, fixed=False))
    assert free.fits, free.text()
    assert free.facts["changes_every_s"] == pytest.approx(period)
    assert f"takes any step, but its torque changes only every {1e3 * period:g} ms" in free.text()
    fixed = check_brace(sampled(tmp_path / "fixed.fmu", "subtalar", 60.0, 0.0, period, fixed=True))
    assert fixed.fits, fixed.text()
    assert f"sampled every {1e3 * period:g} ms: every run calls it at that rate" in fixed.text()
    assert "--step" not in fixed.next_step


KINDS = ((20, "input_tick", '"constant" intervalDecimal="0.01"'), (21, "output_tick", '"triggered"'))


def test_check_names_clocks(tmp_path: Path) -> None:
    """An input clock of FMI 3 is a warning, since nothing ticks it; an output clock is a note."""
    plain = device(tmp_path / "plain.fmu", fmi=3)
    clocks = "".join(
        f'<Clock name="{name}" valueReference="{k}" causality="{name.split("_")[0]}" variability="discrete" '
        f"intervalVariability={interval}/>"
        for k, name, interval in (
            (20, "input_tick", '"constant" intervalDecimal="0.01"'),
            (21, "output_tick", '"triggered"'),
        )
    )
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(tmp_path / "clocks.fmu", "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data = data.replace(b"</ModelVariables>", f"{clocks}</ModelVariables>".encode())
            new.writestr(name, data)
    report = check_brace(tmp_path / "clocks.fmu")
    assert any(w.startswith("has input clocks (input_tick), which no run ticks") for w in report.warnings), (
        report.text()
    )
    assert any(n.startswith("has output clocks (output_tick)") for n in report.notes)
