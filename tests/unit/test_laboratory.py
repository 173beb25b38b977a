"""What the numbered checks measure with: the folder of reference numbers has no default inside the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim import shipped
from sprain_cosim.errors import InputError
from sprain_cosim.validation.checks import fmi
from sprain_cosim.validation.laboratory import Laboratory


def test_without_a_folder_the_checks_that_need_reference_numbers_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SPRAIN_REFERENCE", raising=False)
    laboratory = Laboratory()
    assert laboratory.reference is None
    assert laboratory.missing("reference") == "no reference trajectories and trials (set SPRAIN_REFERENCE)"
    with pytest.raises(InputError, match=r"paper/study1_trials\.csv: no folder of reference numbers"):
        laboratory.table("paper/study1_trials.csv")


def test_the_environment_or_the_caller_names_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SPRAIN_REFERENCE", str(tmp_path))
    assert Laboratory().reference == tmp_path
    assert f"no reference trajectories and trials in {tmp_path}" in Laboratory().missing("reference")
    other = tmp_path / "other"
    (other / "landing").mkdir(parents=True)
    (other / "landing" / "index.csv").write_text("case\nbase\n")
    laboratory = Laboratory(reference=other)
    assert laboratory.missing("reference") == ""
    table = laboratory.table("landing/index.csv")
    assert list(table["case"]) == ["base"]
    assert laboratory.table("landing/index.csv") is table


def test_what_is_for_linux_alone_is_left_out_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "plant_mujoco" in fmi.fmus()
    monkeypatch.setattr(shipped.machine, "system", lambda: "Windows")
    assert fmi.fmus() == [name for name in shipped.shipped_fmus() if name != "plant_mujoco"]
    assert Laboratory().missing("plant_mujoco").startswith("no plant_mujoco.fmu, which is for 64-bit Linux")
