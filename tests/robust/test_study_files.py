"""A study and its files: what is changed, moved or removed while it runs changes none of its trials."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from pathlib import Path

import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError
from sprain_cosim.fmu import cache
from sprain_cosim.folders.read import edited_since, read_folders
from sprain_cosim.process import Limits
from sprain_cosim.study.plan import Plan
from sprain_cosim.study.replay import replay
from tests.light import study_file
from tests.native import device

MAP = '[outputs]\nsubtalar_torque = { from = "subtalar_torque", factor = 1 }\n'
TRIALS = 12


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two devices that differ by a factor of two."""
    folder = tmp_path_factory.mktemp("fmus")
    return device(folder / "one.fmu"), device(folder / "two.fmu", sign=2.0)


def study(folder: Path, fmus: tuple[Path, Path]) -> Plan:
    shutil.copy(fmus[0], folder / "brace.fmu")
    (folder / "brace.toml").write_text(MAP)
    return sc.load_study("study2").replace_fmu("brace", folder / "brace.fmu", folder / "brace.toml")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, fmus: tuple[Path, Path]) -> pd.DataFrame:
    folder = tmp_path_factory.mktemp("undisturbed")
    return study(folder, fmus).run(trials=TRIALS, workers=1, limits=Limits(recycle=3)).trials


@pytest.mark.usefixtures("every_row_is_committed")
@pytest.mark.parametrize("what", ["replaced", "overwritten", "removed", "map"])
def test_a_file_that_changes_meanwhile(
    what: str, fmus: tuple[Path, Path], undisturbed: pd.DataFrame, tmp_path: Path
) -> None:
    """Children are replaced after three trials, so that later ones open the files anew."""
    brace, table, moments = tmp_path / "brace.fmu", tmp_path / "brace.toml", list[int]()

    def disturb(finished: int, *_: object) -> None:
        if finished < 2:
            return
        moments.append(finished)
        if what == "replaced":
            shutil.copy(fmus[1], tmp_path / "new.fmu")
            os.replace(tmp_path / "new.fmu", brace)
        elif what == "overwritten":
            brace.write_bytes(fmus[1].read_bytes())
        elif what == "removed":
            brace.unlink(missing_ok=True)
        else:
            table.write_text(MAP.replace("factor = 1", "factor = 3"))

    done = study(tmp_path, fmus).run(
        trials=TRIALS, workers=1, out=tmp_path / "s", limits=Limits(recycle=3), progress=disturb, trajectories=0
    )
    assert moments[0] == 2
    pd.testing.assert_frame_equal(done.trials, undisturbed, check_exact=True)
    changed = table if what == "map" else brace
    became = "is gone" if what == "removed" else "has changed"
    assert len(done.warnings) == 1
    assert done.warnings[0].startswith(f"{changed} {became}")
    assert "all its trials are of the file as it was then" in done.warnings[0]
    manifest = json.loads((tmp_path / "s" / "manifest.json").read_text())
    assert manifest["fmus"]["brace"] == {"file": str(brace), "sha256": cache.file_sha256(fmus[0])}
    assert replay(tmp_path / "s", 5).same  # from the copy
    if what != "removed":
        again = sc.load_study("study2").replace_fmu("brace", brace, table)
        with pytest.raises(InputError, match="holds another study"):
            again.run(trials=TRIALS, workers=1, out=tmp_path / "s", resume=True)


@pytest.mark.long
@pytest.mark.usefixtures("every_row_is_committed")
@pytest.mark.parametrize("workers", [1, 2])
def test_none_of_400_rows_is_of_the_new_file(workers: int, fmus: tuple[Path, Path], tmp_path: Path) -> None:
    """FMU and mapping file are replaced again and again while the study runs; children are replaced every 20 trials."""
    trials, limits = 400, Limits(recycle=20)
    (tmp_path / "whole").mkdir()
    clean = study(tmp_path / "whole", fmus).with_master(stop="5 ms").run(trials=trials, workers=workers, limits=limits)
    brace, table = tmp_path / "brace.fmu", tmp_path / "brace.toml"

    def disturb(finished: int, *_: object) -> None:
        shutil.copy(fmus[finished % 2 or finished > 350], tmp_path / "new.fmu")
        os.replace(tmp_path / "new.fmu", brace)
        table.write_text(MAP.replace("factor = 1", f"factor = {2 + finished % 3}"))

    disturbed = study(tmp_path, fmus).with_master(stop="5 ms")
    done = disturbed.run(
        trials=trials, workers=workers, out=tmp_path / "s", limits=limits, progress=disturb, trajectories=0
    )
    pd.testing.assert_frame_equal(done.trials, clean.trials, check_exact=True)
    assert len(done.trials) == trials
    assert [str(brace) in w or str(table) in w for w in done.warnings] == [True, True]


def test_nothing_changed_no_warning(fmus: tuple[Path, Path], tmp_path: Path) -> None:
    assert study(tmp_path, fmus).run(trials=2, workers=1).warnings == ()


def repacked(fmu: Path, members: dict[str, bytes]) -> None:
    """The FMU with other or more members, as a build for another platform leaves it."""
    with zipfile.ZipFile(fmu) as archive:
        held = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (held | members).items():
            archive.writestr(name, content)


def test_a_study_goes_on_when_its_fmu_was_built_for_another_platform_as_well(
    fmus: tuple[Path, Path], undisturbed: pd.DataFrame, tmp_path: Path
) -> None:
    """`make test` adds libraries for Windows where a compiler for it is; what runs here stays the same."""
    begun = study(tmp_path, fmus)
    begun.run(trials=3, workers=1, out=tmp_path / "out", trajectories=0)
    repacked(tmp_path / "brace.fmu", {"binaries/elsewhere64/brace.dll": b"a library"})
    campaign = begun.run(trials=TRIALS, workers=1, out=tmp_path / "out", resume=True, trajectories=0)
    pd.testing.assert_frame_equal(campaign.trials, undisturbed)
    (warning,) = [w for w in campaign.warnings if "brace.fmu" in w]
    assert "has changed" in warning and "all its trials are of the file as it was then" in warning
    repacked(tmp_path / "brace.fmu", {"resources/table.bin": b"another device"})
    with pytest.raises(InputError, match=r"holds another study \(fmus\.brace"):
        begun.run(trials=TRIALS + 1, workers=1, out=tmp_path / "out", resume=True)


def test_a_report_says_which_files_were_edited_since(tmp_path: Path) -> None:
    """A line each; a file that is not here may be another machine's."""
    path = study_file(tmp_path)
    sc.load_study(path).run(workers=1, out=tmp_path / "out", trajectories=0)
    folders = read_folders([tmp_path / "out"])
    assert edited_since(folders) == []
    path.write_text(path.read_text().replace("0.03 m", "0.04 m"))
    fmu = tmp_path / "light.fmu"
    fmu.write_bytes(fmu.read_bytes() + b"x")
    device, file = edited_since(folders)
    assert device.startswith(f"{tmp_path / 'out'}: plant: light.fmu has another content now (SHA-256 ")
    assert "study.toml has been edited since" in file
    fmu.unlink()
    path.unlink()
    assert edited_since(folders) == []
