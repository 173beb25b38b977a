"""A campaign of generated devices against `check`: unit declared or not, sign, threshold, rate, axis, half of them
right as stated. No wrong one fits without a warning, no right one is refused, few right ones are warned."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import check_brace
from sprain_cosim.brace.fit import FitReport
from tests.campaign import Device, draw, fmu, library, mapping

OUTCOMES = ("wrong", "silent", "right", "refused", "right declared", "warned")
SUBJECTS = ("sign", "unit", "work", "torque")  # what a warning may be about


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return library(tmp_path_factory.mktemp("campaign"))


def devices(count: int, seed: int) -> Iterator[Device]:
    random = np.random.default_rng(seed)
    for k in range(count):
        yield draw(random, right=k % 2 == 0)


def checked(device: Device, compiled: Path, folder: Path) -> FitReport:
    """As a vendor would: the file with what is stated; the device that asks for its units gets the true ones."""
    path = fmu(folder / "device.fmu", device, compiled)
    if device.declared == "map":
        return check_brace(path, mapping(folder / "map.toml", device))
    report = check_brace(path)
    if not report.fits and device.wrong == "" and device.declared == "names":
        assert 'unit = "?"' in report.proposal, report.text()
        return check_brace(path, mapping(folder / "map.toml", device))
    return report


def campaign(count: int, seed: int, compiled: Path, folder: Path) -> dict[str, list[str]]:
    """Texts of the reports by outcome."""
    out: dict[str, list[str]] = {
        "silent": [],
        "refused": [],
        "warned": [],
        "right declared": [],
        "right": [],
        "wrong": [],
    }
    for device in devices(count, seed):
        report = checked(device, compiled, folder)
        text = f"{device}\n{report.text()}"
        told = [w for w in report.warnings if any(subject in w for subject in SUBJECTS)]
        if device.wrong:
            out["wrong"].append(text)
            out["silent"] += [text] if report.fits and not told else []
            continue
        out["right"].append(text)
        out["refused"] += [] if report.fits else [text]
        if device.declared != "names":
            out["right declared"].append(text)
            out["warned"] += [text] if told else []
    return out


def test_a_few_devices(compiled: Path, tmp_path: Path) -> None:
    found = campaign(4, 1, compiled, tmp_path)
    assert not found["silent"]
    assert not found["refused"]
    assert not found["warned"]


@pytest.mark.long
def test_the_campaign(compiled: Path, tmp_path: Path) -> None:
    """200 devices; the figures of docs/validation.md."""
    found = campaign(200, 2026, compiled, tmp_path)
    for name, texts in found.items():
        print(f"{name}: {len(texts)}")
    print("\n\n".join([*found["silent"], *found["refused"], *found["warned"]]))
    assert not found["silent"], found["silent"][0]
    assert not found["refused"], found["refused"][0]
    assert len(found["warned"]) <= 0.05 * len(found["right declared"])


def test_a_device_whose_units_are_open_is_asked_and_then_fits(compiled: Path, tmp_path: Path) -> None:
    """One in radians; tests/cli/test_tutorial.py has one in degrees."""
    device = Device(("subtalar",), 60.0, 0.2, 0.1, 0.005, "rad", "N.m", "map", "")
    path = fmu(tmp_path / "device.fmu", device, compiled)
    asked = check_brace(path, mapping(tmp_path / "open.toml", device, ("?", "?")))
    assert not asked.fits
    assert "only as radians is plausible" in asked.problems[0]
    assert check_brace(path, mapping(tmp_path / "map.toml", device)).verdict == "fits"
