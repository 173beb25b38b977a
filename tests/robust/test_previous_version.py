"""Folders of version 0.1.0: read, repeated, continued, reproduced.

tests/folders_0_1/light was written by that version: `sprain-cosim study study.toml`, the study of tests/light.py."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError
from sprain_cosim.study.folder import recorded_plan
from sprain_cosim.study.ledger import FORMAT, Ledger
from sprain_cosim.study.replay import replay
from sprain_cosim.study.reproduce import reproduce
from tests.light import study_file

SOURCE = Path(__file__).parent.parent / "folders_0_1" / "light"
THERE = "/tmp/light/"  # where its files lay


@pytest.fixture
def study(tmp_path: Path) -> sc.Study:
    return sc.load_study(study_file(tmp_path))


@pytest.fixture
def old(study: sc.Study, tmp_path: Path) -> Path:
    """The folder, as if its FMU were the one that this machine compiles: its path and its hash stand in it."""
    folder = tmp_path / "old"
    shutil.copytree(SOURCE, folder)
    fmu = study.scenario.fmus["plant"]
    before = json.loads((SOURCE / "manifest.json").read_text())["fmus"]["plant"]["sha256"]
    now = hashlib.sha256(fmu.read_bytes()).hexdigest()
    with sqlite3.connect(folder / "ledger.sqlite") as ledger:
        facts = dict(ledger.execute("SELECT key, value FROM study"))
        facts = {k: v.replace(before, now).replace(THERE, f"{fmu.parent}/") for k, v in facts.items()}
        identity = json.loads(facts["identity"])
        facts["digest"] = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
        ledger.executemany("UPDATE study SET value = ? WHERE key = ?", [(v, k) for k, v in facts.items()])
    ledger.close()
    manifest = (folder / "manifest.json").read_text().replace(before, now).replace(THERE, f"{fmu.parent}/")
    (folder / "manifest.json").write_text(manifest)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix in (".csv", ".json", ".toml", ".sqlite")}


def test_its_ledger_is_read(old: Path, study: sc.Study) -> None:
    with Ledger.read(old) as ledger:
        assert json.loads(ledger.facts["identity"]) == study.identity | {"version": "0.1.0"}
        assert [row.trial for row in ledger.rows()] == [0, 1, 2, 3, 4]
        assert recorded_plan(old, ledger).names == study.names


def test_a_trial_of_it_is_repeated(old: Path) -> None:
    assert replay(old, 2).same


def test_a_complete_one_is_left_as_it_is(old: Path, study: sc.Study) -> None:
    before = contents(old)
    campaign = study.run(out=old, workers=1, resume=True)
    assert campaign.summary.n_completed == 5
    assert campaign.warnings == ()
    assert contents(old) == before
    trials = pd.read_csv(old / "trials.csv", keep_default_na=False)
    assert np.array_equal(campaign.trials["plant.height [m]"], trials["plant.height [m]"])


def test_it_is_continued_when_its_trials_come_out_the_same(old: Path, study: sc.Study, tmp_path: Path) -> None:
    first = (old / "trials.csv").read_text().splitlines()
    campaign = study.run(trials=8, out=old, workers=1, resume=True)
    assert len(campaign.warnings) == 1
    assert campaign.warnings[0].startswith(f"{old}: was begun with version 0.1.0; trials 0, ")
    assert campaign.warnings[0].endswith(f" repeated with {sc.__version__}, came out the same to the bit")
    assert (old / "trials.csv").read_text().splitlines()[:6] == first
    whole = study.run(trials=8, out=tmp_path / "whole", workers=1)
    assert whole.trials.equals(campaign.trials)
    assert study.run(trials=8, out=old, workers=1, resume=True).warnings == ()
    with sqlite3.connect(old / "ledger.sqlite") as ledger:
        assert ledger.execute("PRAGMA user_version").fetchone() == (FORMAT,)
    ledger.close()


def test_it_is_refused_when_a_trial_comes_out_otherwise(old: Path, study: sc.Study) -> None:
    with sqlite3.connect(old / "ledger.sqlite") as ledger:
        (blob,) = ledger.execute("SELECT metrics FROM trials WHERE trial = 0").fetchone()
        values = np.frombuffer(blob).copy()
        values[3] = np.nextafter(values[3], 1.0)  # the last bit
        ledger.execute("UPDATE trials SET metrics = ? WHERE trial = 0", (values.tobytes(),))
    ledger.close()
    before = contents(old)
    with pytest.raises(
        InputError, match=r"begun with version 0.1.0; with .* its trial 0 gives peak_\w+ = \S+, not \S+;"
    ):
        study.run(trials=8, out=old, workers=1, resume=True)
    assert contents(old) == before


def test_another_study_is_refused(old: Path, study: sc.Study) -> None:
    scenario = study.scenario.with_master(identify=3)
    other = sc.Study(**{**vars(study), "scenario": scenario})
    with pytest.raises(InputError, match=r"holds another study \(.*master.identify: 1 then, 3 now"):
        other.run(trials=8, out=old, workers=1, resume=True)


@pytest.mark.parametrize("ledger", [True, False], ids=["with its ledger", "without"])
def test_it_is_reproduced(old: Path, tmp_path: Path, ledger: bool) -> None:
    if not ledger:
        (old / "ledger.sqlite").unlink()
        for name in ("light.toml", "light.fmu"):
            shutil.copy(tmp_path / name, old)
    found = reproduce(old / "manifest.json", workers=1)
    assert found.identical
    assert found.trials == 5
    assert found.differences[0] == f"sprain-cosim 0.1.0 then, {sc.__version__} now"
