"""Metrics on signals whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sprain_cosim.metrics import metrics, table, unit_of

AXES = ("talocrural", "subtalar", "dorsiflexion", "inversion", "internal_rotation")


class Run:
    def __init__(self, braced: bool) -> None:
        self.time = np.linspace(0.0, 0.15, 301)
        self.signals = {}
        for k, axis in enumerate(AXES):
            self.signals[f"plant.{axis}_angle"] = 0.1 * (k + 1) * np.sin(math.pi * self.time / (0.1 + 0.02 * k))
            self.signals[f"plant.{axis}_velocity"] = np.full(301, float(k)) - 10 * self.time
            self.signals[f"plant.anatomy_{axis}_moment"] = 100 * self.time + k
            self.signals[f"plant.brace_{axis}_moment"] = 200 * self.time + k
        for axis in AXES[2:]:
            self.signals[f"plant.jcs_{axis}_raw_angle"] = self.signals[f"plant.{axis}_angle"] - 0.2
        self.signals["plant.ground_force_y"] = np.where(self.time <= 0.005, 9000.0, 2000.0)
        if braced:
            self.signals["plant.brace_subtalar_torque"] = np.zeros(301)
        self.index = {name: k for k, name in enumerate(self.signals)}

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]


def test_peaks_and_moments_at_the_axis_own_peak() -> None:
    values = metrics(Run(braced=True))
    assert values["peak_subtalar_angle_deg"] == pytest.approx(math.degrees(0.2), rel=1e-12)
    assert values["time_of_peak_subtalar_s"] == pytest.approx(0.06)
    assert values["peak_talocrural_angle_deg"] == pytest.approx(math.degrees(0.1), rel=1e-12)
    assert values["peak_jcs_inversion_deg"] == pytest.approx(math.degrees(0.4 - 0.2), rel=1e-12)
    assert values["peak_jcs_inversion_velocity_deg_s"] == pytest.approx(math.degrees(3.0))
    assert values["anatomy_subtalar_moment_Nm"] == pytest.approx(100 * 0.06 + 1)
    assert values["brace_jcs_inversion_moment_Nm"] == pytest.approx(200 * 0.08 + 3)
    assert values["peak_vertical_grf_N"] == 9000.0
    assert values["peak_vertical_grf_after_impact_N"] == 2000.0
    assert values["peak_inversion_from_neutral_deg"] == pytest.approx(math.degrees(0.4), rel=1e-12)
    assert len(values) == 27


def test_brace_work_is_what_it_takes_from_the_ankle() -> None:
    """A spring of 20 N·m/rad about the subtalar axis and a damper about the talocrural: closed forms of the energy
    until the peak and over all."""
    run = Run(braced=True)
    subtalar, talocrural = run["plant.subtalar_angle"], run["plant.talocrural_angle"]
    run.signals["plant.brace_subtalar_torque"] = -20 * subtalar
    run.signals["plant.brace_subtalar_moment"] = 20 * subtalar
    run.signals["plant.brace_talocrural_torque"] = -0.5 * np.gradient(talocrural, run.time)
    run.index = {name: k for k, name in enumerate(run.signals)}
    values = metrics(run)
    w = math.pi / 0.1  # of the talocrural angle 0.1 sin(w t); the damper takes the integral of 0.5 (0.1 w cos(w t))^2
    damped = 0.5 * (0.1 * w) ** 2 * (0.15 / 2 + math.sin(2 * w * 0.15) / (4 * w))
    end = 0.2 * math.sin(math.pi * 0.15 / 0.12)
    assert values["brace_subtalar_work_to_peak_J"] == pytest.approx(0.5 * 20 * 0.2**2, rel=1e-9)
    assert values["brace_work_J"] == pytest.approx(0.5 * 20 * end**2 + damped, rel=1e-3)
    assert values["peak_brace_subtalar_moment_Nm"] == pytest.approx(20 * 0.2)


def test_without_a_brace_its_keys_are_absent() -> None:
    values = metrics(Run(braced=False))
    assert not [key for key in values if "brace" in key]
    assert len(values) == 19


def test_every_metric_carries_its_unit() -> None:
    assert {unit_of(key) for key in metrics(Run(braced=True))} == {"deg", "deg/s", "N·m", "N", "s", "J"}


def test_table_shows_value_and_time_of_each_peak() -> None:
    rows = {label: (value, unit, time) for label, value, unit, time in table(Run(braced=True))}
    assert rows["subtalar supination"] == (pytest.approx(math.degrees(0.2)), "deg", pytest.approx(0.06))
    assert rows["subtalar moment of the brace"] == (pytest.approx(13.0), "N·m", pytest.approx(0.06))
