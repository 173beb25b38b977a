"""The Dask backend: the same table as the local one, also when a worker dies and when the workers lack the FMUs."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import sprain_cosim as sc
from sprain_cosim import processor
from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.study.backends.backend import Task
from sprain_cosim.study.backends.dask import Dask, Missing, _batch, _hashes
from tests.light import study_file

TRIALS = 40

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    out = tmp_path_factory.mktemp("dask") / "whole"
    sc.load_study("study6").run(trials=TRIALS, workers=2, out=out, trajectories=0)
    return (out / "trials.csv").read_bytes()


@pytest.mark.usefixtures("every_row_is_committed")
def test_half_a_study_from_here_is_finished_on_dask_though_a_worker_is_killed(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "study"
    study = sc.load_study("study6")
    study.run(trials=8, workers=1, out=out, trajectories=0)
    killed = []

    def progress(finished: int, total: int, failed: int, seconds: float) -> None:
        if finished > 10 and not killed:
            killed.append(finished)
            os.killpg(os.getpgid(backends[0]._processes[0]._process.pid), signal.SIGKILL)

    backends: list[Dask] = []
    began = Dask.__init__

    def begin(self: Dask, *arguments: object) -> None:
        began(self, *arguments)
        backends.append(self)

    monkeypatch.setattr(Dask, "__init__", begin)
    study.run(
        trials=TRIALS, workers=2, scheduler="local-cluster", out=out, resume=True, trajectories=0, progress=progress
    )
    assert killed == [11]
    assert (out / "trials.csv").read_bytes() == whole


@pytest.mark.long
def test_a_study_that_knows_enough_stops_at_the_same_look_on_dask(tmp_path: Path) -> None:
    study = sc.load_study(study_file(tmp_path))
    here, there = (
        study.run(trials=200, until="mean 0.2 deg", workers=2, scheduler=where, out=tmp_path / name, trajectories=0)
        for name, where in (("here", None), ("there", "local-cluster"))
    )
    assert here.summary.until == there.summary.until
    assert (tmp_path / "here" / "trials.csv").read_bytes() == (tmp_path / "there" / "trials.csv").read_bytes()


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


@pytest.fixture
def scheduler() -> Iterator[str]:
    """The address of a scheduler that has no worker."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, processes=True, dashboard_address=None, silence_logs=50) as cluster:
        yield cluster.scheduler_address


def test_no_worker_is_said_and_ends_the_study(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("sprain_cosim.study.backends.dask.SAID_AFTER", 1.0)
    monkeypatch.setenv("SPRAIN_COSIM_WORKER_WAIT", "4")
    began = time.monotonic()
    with caplog.at_level(logging.WARNING), pytest.raises(EnvironmentProblem, match=r"no worker for \d+ s; .*--resume"):
        sc.load_study("study6").run(trials=2, scheduler=scheduler, out=tmp_path / "a")
    assert time.monotonic() - began < 300.0  # the product's own wait is 600 s
    assert [r.getMessage().partition(": ")[2][:24] for r in caplog.records] == ["no worker has joined for"]
    monkeypatch.setenv("SPRAIN_COSIM_WORKER_WAIT", "soon")
    with pytest.raises(InputError, match="must be a number of seconds"):
        sc.load_study("study6").run(trials=2, scheduler=scheduler, out=tmp_path / "b")


def test_a_worker_without_the_package_is_one_line(scheduler: str, tmp_path: Path) -> None:
    code = "import sys; sys.modules['sprain_cosim'] = None; from distributed.cli.dask_worker import main; main()"
    options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--death-timeout", "20"]
    environment = os.environ | {"DASK_TEMPORARY_DIRECTORY": str(tmp_path)}
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    worker = subprocess.Popen([sys.executable, "-c", code, scheduler, *options], env=environment, **quiet)  # type: ignore[call-overload]
    try:
        with pytest.raises(EnvironmentProblem, match=r"a worker cannot run sprain-cosim \(.*sprain_cosim.*install"):
            sc.load_study("study6").run(trials=2, scheduler=scheduler, out=tmp_path / "a")
    finally:
        worker.kill()
        worker.wait()


def test_the_level_of_the_processor_is_the_lowest_of_the_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    older, newer = processor.LEVELS
    monkeypatch.delenv(processor.VARIABLE, raising=False)
    dask = object.__new__(Dask)
    dask._client = SimpleNamespace(run=lambda function: {"tcp://a": newer, "tcp://b": older})
    assert dask._lowest_level() == older
    dask._client = SimpleNamespace(run=lambda function: {})  # nobody has joined yet
    assert dask._lowest_level() == processor.own()
    monkeypatch.setenv(processor.VARIABLE, newer)
    assert dask._lowest_level() == newer
