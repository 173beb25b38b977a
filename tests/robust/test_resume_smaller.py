"""A resumed study never loses trials."""

from __future__ import annotations

from pathlib import Path

import sprain_cosim as sc


def test_fewer_trials_than_the_folder_holds_keep_all(tmp_path: Path) -> None:
    study = sc.load_study("study2")
    whole = study.run(trials=6, workers=1, out=tmp_path / "s", trajectories=0)
    before = (tmp_path / "s" / "trials.csv").read_bytes()
    again = study.run(trials=2, workers=1, out=tmp_path / "s", resume=True, trajectories=0)
    assert (tmp_path / "s" / "trials.csv").read_bytes() == before
    assert len(again.trials) == len(whole.trials) == 6
    assert again.summary.n_requested == 6
    assert any("which are kept" in warning for warning in again.warnings)
    more = study.run(trials=8, workers=1, out=tmp_path / "s", resume=True, trajectories=0)
    assert len(more.trials) == 8
    assert not any("which are kept" in warning for warning in more.warnings)
