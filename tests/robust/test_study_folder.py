"""The folder of a study: its trajectories, its shards, a trial of it again; each from the folder alone."""

from __future__ import annotations

import gzip
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import sprain_cosim as sc
from sprain_cosim.cli import cli
from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.fmu.cache import cache_folder
from sprain_cosim.folders.study import read_study
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.study.merge import merge
from sprain_cosim.study.replay import replay
from sprain_cosim.study.shards import shard as part
from sprain_cosim.study.trajectories import Trajectories, read_trajectory, trajectory_path

TRIALS = 12


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("folder") / "whole"
    sc.load_study("study6").run(trials=TRIALS, workers=2, out=out, trajectories=4, parquet=True, command="typed")
    return out


def test_trajectories_are_those_of_the_first_and_of_the_percentiles(whole: Path) -> None:
    summary = json.loads((whole / "summary.json").read_text())
    roles = {role: trial for role, trial in summary["trajectories"].items() if role != "first"}
    assert summary["trajectories"]["first"] == 4
    kept = {int(p.name.removesuffix(".record")) for p in (whole / "trajectories").iterdir()}
    assert kept == {0, 1, 2, 3, *roles.values()}
    trials = pd.read_csv(whole / "trials.csv")
    response = trials["peak_subtalar_angle_deg"]
    assert (roles["min"], roles["max"]) == (response.idxmin(), response.idxmax())
    assert abs(response[roles["p50"]] - response.quantile(0.5)) == (response - response.quantile(0.5)).abs().min()
    for trial in kept:  # the record belongs to the row
        record = read_trajectory(trajectory_path(whole, trial))
        assert np.degrees(1.0) * record["plant.subtalar_angle"].max() == response[trial]


def test_a_trajectory_has_the_signals_of_a_run(whole: Path, tmp_path: Path) -> None:
    again = replay(whole, 2)
    assert again.same
    assert again.outcome.trajectory == (whole / "trajectories" / "000002.record").read_bytes()
    ran = CliRunner().invoke(cli, ["trial", str(whole), "2", "--out", str(tmp_path / "run"), "--json"])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["reproduced"] is True
    kept = read_trajectory(whole / "trajectories" / "000002.record")
    assert (tmp_path / "run" / "signals.csv").read_text() == kept.csv()


def test_a_folder_with_records_of_version_0_1_is_read_and_sealed(whole: Path, tmp_path: Path) -> None:
    """They were gzipped tables, of ten digits."""
    shutil.copytree(whole, tmp_path / "old")
    for path in (tmp_path / "old" / "trajectories").iterdir():
        (path.parent / f"{path.stem}.csv.gz").write_bytes(gzip.compress(read_trajectory(path).csv().encode()))
        path.unlink()
    new, old = read_study(whole), read_study(tmp_path / "old")
    assert list(old.trajectories) == list(new.trajectories)
    for trial in new.trajectories:
        assert np.allclose(old.trajectory(trial).values, new.trajectory(trial).values, rtol=1e-9, atol=0.0)
    assert Trajectories(tmp_path / "old").lacks(new.trajectories) == []


def test_a_trial_that_no_longer_gives_its_numbers_is_told(whole: Path, tmp_path: Path) -> None:
    changed = tmp_path / "changed"
    shutil.copytree(whole, changed)
    with Ledger(changed, **_facts(changed)) as ledger:
        row = ledger.row(5)
        assert row is not None
        first, value = next(iter(row.outcome.metrics.items()))
        metrics = {**row.outcome.metrics, first: float(np.nextafter(value, 1e9))}
        ledger._database.execute("DELETE FROM trials WHERE trial = 5")
        ledger.add(replace(row, outcome=replace(row.outcome, metrics=metrics)))  # with its checksum
    assert not replay(changed, 5).same
    ran = CliRunner().invoke(cli, ["trial", str(changed), "5"], standalone_mode=False)
    assert ran.return_value == 1
    assert "OTHER numbers" in ran.output


def _facts(folder: Path) -> dict:
    with Ledger.read(folder) as ledger:
        facts = ledger.facts
    return {"digest": facts["digest"], "identity": json.loads(facts["identity"]), "description": facts["study"]}


def test_no_such_trial_and_a_changed_fmu_are_one_line(whole: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no trial 99; it has 12, number 0 to 11"):
        replay(whole, 99)
    brace = tmp_path / "brace.fmu"
    shutil.copy(sc.load_scenario("incline30_brace").fmus["brace"], brace)
    sc.load_study("study6").replace_fmu("brace", brace).run(trials=2, workers=1, out=tmp_path / "own")
    brace.write_bytes(sc.load_scenario("incline30").fmus["plant"].read_bytes())
    assert replay(tmp_path / "own", 1).same  # from the copy that the study kept
    shutil.rmtree(cache_folder() / "files")
    with pytest.raises(InputError, match=r"fmus.brace: \w{12} then, \w{12} now"):
        replay(tmp_path / "own", 0)
    brace.unlink()
    with pytest.raises(InputError, match="which is gone"):
        replay(tmp_path / "own", 0)


def test_manifest_says_with_what(whole: Path) -> None:
    manifest = json.loads((whole / "manifest.json").read_text())
    study = sc.load_study("study6")
    assert manifest["study_digest"] == study.digest
    assert set(manifest["fmus"]) == {"plant", "controller", "brace"}
    assert set(manifest["fmus"]["plant"]) == {"file", "sha256"}
    assert (manifest["seed"], manifest["command"]) == (20211208, "typed")
    assert {"versions", "platform", "created"} <= set(manifest)
    assert (whole / "study.toml").read_text() == study.text


def test_parquet_holds_the_same_table(whole: Path) -> None:
    pd.testing.assert_frame_equal(
        pd.read_parquet(whole / "trials.parquet"),
        pd.read_csv(whole / "trials.csv", keep_default_na=False),
        check_exact=True,
    )


def test_shards_merge_into_the_whole(whole: Path, tmp_path: Path) -> None:
    study = sc.load_study("study6")
    folders = [tmp_path / f"part{k}" for k in (1, 2, 3)]
    for k in (1, 2):
        study.run(trials=TRIALS, workers=1, out=folders[k - 1], shard=(k, 3), trajectories=4)
    with pytest.raises(InputError, match="trials 2, 5, 8, 11 are in none of the folders"):
        merge(folders[:2], tmp_path / "merged")
    study.run(trials=TRIALS, workers=1, out=folders[2], shard=(3, 3), trajectories=4)
    merged = merge(folders, tmp_path / "merged")
    assert (tmp_path / "merged" / "trials.csv").read_bytes() == (whole / "trials.csv").read_bytes()
    assert merged.summary["trajectories"] == json.loads((whole / "summary.json").read_text())["trajectories"]
    for role in ("p5", "max"):
        assert (tmp_path / "merged" / "trajectories" / f"{merged.summary['trajectories'][role]:06d}.record").is_file()
    study.run(trials=TRIALS, seed=1, workers=1, out=tmp_path / "other", shard=(3, 3), trajectories=0)
    with pytest.raises(InputError, match="another study"):
        merge([*folders[:2], tmp_path / "other"], tmp_path / "mixed")


def test_parts_and_a_study_that_goes_on_say_all_that_they_ran_with(tmp_path: Path) -> None:
    """The manifest of a merged study named the software of the machine that merged, that of a study that went on the
    last one's."""
    study, folders = sc.load_study("study6"), [tmp_path / "a", tmp_path / "b"]

    def of_another_machine(folder: Path) -> None:
        content = json.loads((folder / "manifest.json").read_text())
        content["versions"]["numpy"], content["platform"] = "1.0", "elsewhere"
        (folder / "manifest.json").write_text(json.dumps(content))

    for k, folder in enumerate(folders, 1):
        study.run(trials=4, workers=1, out=folder, shard=(k, 2), trajectories=0)
    of_another_machine(folders[0])
    merged = merge(folders, tmp_path / "both")
    said = json.loads((tmp_path / "both" / "manifest.json").read_text())
    assert said["versions"]["numpy"] == f"1.0, {np.__version__}"
    assert said["platform"].startswith("elsewhere, ")
    assert said["versions"]["scipy"].count(",") == 0
    (warning,) = merged.warnings
    assert f"numpy 1.0 there, {np.__version__} here" in warning
    study.run(trials=2, workers=1, out=tmp_path / "longer", trajectories=0)
    of_another_machine(tmp_path / "longer")
    longer = study.run(trials=4, workers=1, out=tmp_path / "longer", resume=True, trajectories=0)
    assert any("ran with other software" in warning for warning in longer.warnings)
    assert json.loads((tmp_path / "longer" / "manifest.json").read_text())["versions"]["numpy"].startswith("1.0, ")


def test_a_search_has_no_parts_and_a_part_is_written_k_of_n(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no parts"):
        sc.load_study("amv6").run(shard=(1, 2), out=tmp_path / "amv")
    assert part("2/10") == (2, 10)
    for wrong in ("0/3", "4/3", "1", "a/b", "1/"):
        with pytest.raises(InputError, match="K/N"):
            part(wrong)


def test_all_trials_of_a_search_are_recorded(tmp_path: Path) -> None:
    campaign = replace(sc.load_study("amv6"), check=False).run(workers=2, out=tmp_path / "amv", trajectories=0)
    kept = sorted((tmp_path / "amv" / "trajectories").iterdir())
    assert len(kept) == len(campaign.trials)
    level = campaign.summary["amv"]["levels"]["95"]["value"]
    row = campaign.trials.set_index("trial").loc[campaign.summary["trajectories"]["p95"]]
    assert row["peak_subtalar_angle_deg"] == level


def test_a_study_survives_its_way_through_json() -> None:
    from sprain_cosim.study.codec import decode, encode

    for name in ("study1", "study6", "amv6"):
        study = sc.load_study(name)
        again = decode(json.loads(json.dumps(encode(study))))
        assert again.digest == study.digest
        assert np.array_equal(again.sample(), study.sample()) if name != "amv6" else again.levels == study.levels
    with pytest.raises(InputError, match="not known"):
        decode({"!": "Popen", "args": ["true"]})


@pytest.mark.usefixtures("every_row_is_committed")
@pytest.mark.parametrize("how", ["removed", "moved", "replaced"])
def test_a_folder_that_goes_away_while_the_study_runs(how: str, tmp_path: Path) -> None:
    """One line instead of trials that are nowhere; what was moved can be continued."""
    out, elsewhere = tmp_path / "s", tmp_path / "elsewhere"
    study = sc.load_study("study2").with_master(stop="5 ms")

    def disturb(finished: int, *_: object) -> None:
        if finished and not elsewhere.exists() and out.is_dir():
            out.rename(elsewhere)
            if how == "removed":
                shutil.rmtree(elsewhere)
                elsewhere.touch()
            if how == "replaced":
                out.write_text("something else")

    with pytest.raises(EnvironmentProblem, match="its ledger was removed or moved while the study ran") as problem:
        study.run(trials=6, workers=1, out=out, trajectories=1, progress=disturb)
    assert "\n" not in str(problem.value)
    if how == "moved":
        again = study.run(trials=6, workers=1, out=elsewhere, trajectories=1, resume=True)
        assert again.summary.n_completed == 6
