"""The Dask backend: the same table as the local one, also when a worker dies and when the workers lack the FMUs."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.fmu.cache import cache_folder
from sprain_cosim.study.backends.backend import Task
from sprain_cosim.study.backends.dask import Dask, Missing, _batch, _hashes

TRIALS = 40

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    out = tmp_path_factory.mktemp("dask") / "whole"
    sc.load_study("study6").run(trials=TRIALS, workers=2, out=out, trajectories=0)
    return (out / "trials.csv").read_bytes()


def test_half_a_study_from_here_is_finished_on_dask_though_a_worker_is_killed(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "study"
    study = sc.load_study("study6")
    study.run(trials=8, workers=1, out=out, trajectories=0)
    killed = []

    def progress(finished: int, total: int, failed: int, seconds: float) -> None:
        if finished > 10 and not killed:
            killed.append(os.getpgid(backends[0]._processes[0].pid))
            os.killpg(killed[0], signal.SIGKILL)

    backends: list[Dask] = []
    began = Dask.__init__

    def begin(self: Dask, *arguments: object) -> None:
        began(self, *arguments)
        backends.append(self)

    monkeypatch.setattr(Dask, "__init__", begin)
    study.run(
        trials=TRIALS, workers=2, scheduler="local-cluster", out=out, resume=True, trajectories=0, progress=progress
    )
    assert killed
    assert (out / "trials.csv").read_bytes() == whole


def test_files_travel_to_a_worker_that_lacks_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a machine where the scenario's paths do not exist: the batch comes back with what is missing, and with it the
    worker runs."""
    import pickle
    from dataclasses import replace

    import numpy as np

    from sprain_cosim import __version__
    from sprain_cosim.study.backends import dask as module
    from sprain_cosim.study.backends.backend import Job

    scenario = sc.load_scenario("incline30")
    hashes = _hashes(Task(scenario, ("plant.drop_height",)))
    gone = {path: tmp_path / "elsewhere" / path.name for path in hashes}
    moved = replace(scenario, fmus={name: gone[path] for name, path in scenario.fmus.items()})
    pickled = pickle.dumps((Task(moved, ("plant.drop_height",)), {gone[path]: sha for path, sha in hashes.items()}))
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "kernels").symlink_to(
        cache_folder() / "kernels", target_is_directory=True
    )  # compiling them takes a minute
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", str(tmp_path / "cache"))
    jobs = pickle.dumps([Job(3, np.array([0.3]))])
    try:
        answer = _batch("test", pickled, __version__, jobs, {})
        assert isinstance(answer, Missing)
        assert set(answer.files) == set(hashes.values())
        content = {sha: path.read_bytes() for path, sha in hashes.items()}
        rows = _batch("test", pickled, __version__, jobs, content)
        assert isinstance(rows, bytes)
        assert pickle.loads(rows)[0].outcome.metrics == scenario.override("plant.drop_height", "0.3 m").run().metrics
        asyncio.run(module._release("test"))
        assert not isinstance(_batch("test", pickled, __version__, jobs, {}), Missing), (
            "the next study finds them in the cache"
        )
    finally:
        asyncio.run(module._release("test"))
    with pytest.raises(EnvironmentProblem, match=r"has sprain-cosim .* the study 0\.0"):
        _batch("test", pickled, "0.0", jobs, {})


def test_no_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sprain_cosim.study.backends.dask.PATIENCE", 0.3)
    with pytest.raises(EnvironmentProblem, match="no scheduler answers"):
        sc.load_study("study6").run(trials=2, scheduler="tcp://127.0.0.1:9", out=tmp_path / "a")
    with pytest.raises(InputError, match="local-cluster or an address"):
        sc.load_study("study6").run(trials=2, scheduler="somewhere", out=tmp_path / "b")
    assert not list(tmp_path.iterdir()), "nothing is left that would have to be resumed"
