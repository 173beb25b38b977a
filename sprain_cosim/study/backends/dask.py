"""Workers of a Dask cluster. The process of a Dask worker is never the one that runs an FMU: each of its threads drives
a child of its own.

Files (FMUs, mapping files) are known by the SHA-256 of their content. A worker takes those that lie where the scenario
says, or in its cache; what it lacks it asks for, and gets with the batch that is sent again. A batch whose machine is
lost is run elsewhere by the scheduler; one that outlives several machines is split into its trials, and a trial that
does so again is a row with status `lost`."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import logging
import os
import pickle
import platform
import queue
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from time import monotonic
from typing import Any

from ... import __version__, processor
from ...errors import EnvironmentProblem, InputError
from ...fmu import cache
from ...machine.here import SYSTEM
from ...process import Program, python_command
from ...scenario import Scenario
from ..ledger import Row
from ..worker import Outcome, Worker
from .backend import Job, Task

log = logging.getLogger("sprain_cosim")
PATIENCE = 10.0  # s for a scheduler to answer
SAID_AFTER = 10.0  # s without any worker, after which that is said
WAIT, WAIT_VARIABLE = 600.0, "SPRAIN_COSIM_WORKER_WAIT"  # s without any worker, after which the study ends
LOG = 20  # messages that Dask keeps for its developers
AGAIN = 3  # times that a trial is sent anew after it was lost with its machine


@dataclass(frozen=True)
class Missing:
    """A worker's answer to a batch: it lacks the files of these SHA-256."""

    files: tuple[str, ...]


class Dask:
    """`address` tcp://..., tls://... of a scheduler, or local-cluster for `workers` processes here. For a remote one
    `workers` is how many are expected, so that work waits for those that are still to come."""

    batch = 1.5

    def __init__(self, task: Task, workers: int | None, address: str) -> None:
        try:
            dask, distributed = (importlib.import_module(name) for name in ("dask", "distributed"))
        except ImportError:
            raise EnvironmentProblem('--scheduler: needs Dask: pip install "sprain-cosim[distributed]"') from None
        self._expected, self._now, self._asked = workers or 1, 0, -PATIENCE
        self._alone_since, self._said = monotonic(), False
        self._wait = _wait()
        self._out: dict[Any, tuple[tuple[Job, ...], int]] = {}
        self._delivered: dict[str, Any] = {}
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._cluster: Any = None
        self._processes: list[Program] = []
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        dask.config.set(
            {"distributed.admin.low-level-log-length": LOG}
        )  # else the last 1000 messages, batches with all their inputs, stay in memory
        try:
            if address == "local-cluster":
                self._expected = workers or SYSTEM.cores()
                self._cluster = distributed.LocalCluster(
                    n_workers=0, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
                )
                self._processes = [_dask_worker(self._cluster.scheduler_address) for _ in range(self._expected)]
            elif "://" not in address:
                raise InputError(f"--scheduler {address}: must be local-cluster or an address such as tcp://host:8786")
            self._client = distributed.Client(self._cluster or address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as problem:
            raise EnvironmentProblem(
                f"--scheduler {address}: no scheduler answers: {' '.join(str(problem).split())}"
            ) from None
        self._address = address
        self.level = task.level or self._lowest_level()
        hashes = _hashes(task)
        self._files = {sha: path for path, sha in hashes.items()}
        self._task = pickle.dumps((replace(task, level=self.level), hashes))
        self._key = hashlib.sha256(self._task).hexdigest()[:16] + f"-{os.getpid()}"

    def _lowest_level(self) -> str:
        """Of SPRAIN_CPU here, else of the workers that are there by now, else this machine's; a worker that joins later
        and is older refuses with that reason."""
        if not os.environ.get(processor.VARIABLE):
            with contextlib.suppress(Exception):  # no worker yet, or one without the package, which its batch reports
                return processor.lowest(self._client.run(processor.level).values()) or processor.level()
        return processor.level()

    def workers(self) -> int:
        if monotonic() - self._asked > 2.0:
            with contextlib.suppress(OSError, ValueError):
                self._now, self._asked = sum(self._client.nthreads().values()), monotonic()
        return max(self._now, self._expected)

    def send(self, jobs: Sequence[Job]) -> None:
        self._submit(tuple(jobs), 0)

    def receive(self) -> list[Row]:
        from distributed import CancelledError, KilledWorker

        try:
            future = self._done.get(timeout=1.0)
        except queue.Empty:
            if self._client.status not in ("running", "connecting"):
                raise self._gone() from None
            self._look_for_workers()
            return []
        jobs, lost = self._out.pop(future.key)
        try:
            answer = future.result()
        except KilledWorker:
            return self._lost(jobs, lost + 1)
        except ImportError as problem:
            raise EnvironmentProblem(
                f"--scheduler {self._address}: a worker cannot run sprain-cosim ({problem}); install sprain-cosim "
                f"{__version__} with its libraries where the workers run"
            ) from None
        except (CancelledError, OSError, TimeoutError):
            if self._client.status != "running":
                raise self._gone() from None
            return self._lost(jobs, lost + 1)
        finally:
            future.release()
        if isinstance(answer, Missing):
            for sha in answer.files:
                if sha not in self._delivered:
                    self._delivered[sha] = self._client.submit(
                        _same, self._files[sha].read_bytes(), key=f"file-{sha}-{self._key}"
                    )
            self._submit(jobs, lost, answer.files)
            return []
        rows: list[Row] = pickle.loads(answer)
        return rows

    def _look_for_workers(self) -> None:
        """Says once that there are none; raises EnvironmentProblem when that lasts."""
        self.workers()
        now = monotonic()
        if self._now:
            self._alone_since, self._said = now, False
        alone = now - self._alone_since
        if alone > SAID_AFTER and not self._said:
            self._said = True
            log.warning(
                f"--scheduler {self._address}: no worker has joined for {alone:.0f} s; start one with "
                f"`dask worker ADDRESS` where sprain-cosim {__version__} is installed; the study waits "
                f"{self._wait:g} s in all ({WAIT_VARIABLE} sets another time)"
            )
        if alone > self._wait:
            raise EnvironmentProblem(
                f"--scheduler {self._address}: no worker for {alone:.0f} s; what was finished is kept, continue with "
                "--resume when there are some"
            )

    def close(self) -> list[Row]:
        for process in self._processes:
            process.end()
        with contextlib.suppress(Exception):
            if self._cluster is None and self._client.status == "running":
                self._client.run(_release, self._key, wait=False)
        for close in (
            lambda: self._client.close(timeout=1),
            self._cluster and (lambda: self._cluster.close(timeout=1)),
        ):
            if close:
                with contextlib.suppress(Exception):
                    close()
        return []

    def _submit(self, jobs: tuple[Job, ...], lost: int, files: Sequence[str] = ()) -> None:
        arguments = self._key, self._task, __version__, pickle.dumps(jobs)
        if files:
            content = {sha: self._delivered[sha] for sha in files}
            future = self._client.submit(_batch, *arguments, content, pure=False, retries=0)
        else:
            future = self._client.submit(pickle.loads, pickle.dumps(_Deferred(arguments)), pure=False, retries=0)
        self._out[future.key] = jobs, lost
        future.add_done_callback(self._done.put)

    def _lost(self, jobs: tuple[Job, ...], times: int) -> list[Row]:
        rows = []
        for job in jobs:
            if times > AGAIN:
                rows.append(
                    Row(
                        job.trial,
                        job.values,
                        Outcome("lost", "lost with the machine that ran it, several times", attempts=times),
                        "",
                    )
                )
            else:
                self._submit((job,), times)
        return rows

    def _gone(self) -> EnvironmentProblem:
        return EnvironmentProblem(
            f"--scheduler {self._address}: the scheduler is gone; what was finished is kept, continue with --resume"
        )


class _Deferred:
    """A batch that runs where it is unpickled. A worker that lacks the package then reports that as its task's error;
    given the function itself it would end without a word, since it could not read the message."""

    def __init__(self, arguments: tuple[str, bytes, str, bytes]) -> None:
        self.arguments = arguments

    def __reduce__(self) -> tuple[Any, ...]:
        return _batch, (*self.arguments, {})


def _dask_worker(scheduler: str) -> Program:
    """A Dask worker of one thread, which ends when its scheduler does. A process by command line: forking or spawning
    would run the user's script again."""
    options = [
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
        "--memory-limit",
        "0",
        "--death-timeout",
        "60",
        "--local-directory",
        tempfile.gettempdir(),
    ]
    return Program(
        [*python_command("distributed.cli.dask_worker"), scheduler, *options],
        {"DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": str(LOG)},
    )


def _wait() -> float:
    """[s]; raises InputError."""
    text = os.environ.get(WAIT_VARIABLE, "")
    try:
        return float(text) if text else WAIT
    except ValueError:
        raise InputError(f"{WAIT_VARIABLE} = {text!r}: must be a number of seconds") from None


def _hashes(task: Task) -> dict[Path, str]:
    scenario = task.scenario
    return (
        {path: cache.file_sha256(path) for path in (*scenario.fmus.values(), *scenario.maps.values())}
        if isinstance(scenario, Scenario)
        else {}
    )


def _same(content: bytes) -> bytes:
    return content


# what runs on a Dask worker

_workers: dict[int, tuple[str, Worker]] = {}
_guard = threading.Lock()


def _batch(key: str, pickled: bytes, version: str, jobs: bytes, content: Mapping[str, bytes]) -> bytes | Missing:
    """The rows of a batch, or which files this machine lacks. Every thread keeps its child until another study comes.
    Jobs and rows are pickled here, because Dask makes a message of its own of every array."""
    if version != __version__:
        raise EnvironmentProblem(
            f"a worker has sprain-cosim {__version__}, the study {version}; install the same everywhere"
        )
    me = threading.get_ident()
    held = _workers.get(me)
    if held is None or held[0] != key:
        task, hashes = pickle.loads(pickled)
        found = {path: _place(path, sha, content.get(sha)) for path, sha in hashes.items()}
        places = {path: place for path, place in found.items() if place is not None}
        missing = tuple(sha for path, sha in hashes.items() if path not in places)
        if missing:
            return Missing(missing)
        if isinstance(task.scenario, Scenario):
            fmus, maps = (
                {name: places[path] for name, path in files.items()}
                for files in (task.scenario.fmus, task.scenario.maps)
            )
            task = replace(task, scenario=replace(task.scenario, fmus=fmus, maps=maps))
        if held is not None:
            held[1].kill()
        held = key, Worker(task.scenario, task.names, task.limits, task.level)
        with _guard:
            _workers[me] = held
    label = f"{platform.node()}:{os.getpid()}"
    several: list[Job] = pickle.loads(jobs)
    landed = chain.from_iterable(held[1].run_all([(job.values.tolist(), job.record) for job in several]))
    return pickle.dumps([Row(job.trial, job.values, o, label) for job, o in zip(several, landed, strict=True)])


def _place(path: Path, sha: str, content: bytes | None) -> Path | None:
    """This machine's own copy of a file, so that nobody changes it meanwhile; None where the machine lacks it."""
    copy = cache.found(path.name, sha)
    if copy is not None:
        return copy
    if content is None:
        with contextlib.suppress(OSError):
            there = path.read_bytes()
            content = there if hashlib.sha256(there).hexdigest() == sha else None
    return None if content is None else cache.keep(path.name, content, sha)


async def _release(key: str) -> None:
    """Ends the children of a study; a coroutine, so that nobody need wait for it."""
    with _guard:
        for thread in [t for t, (k, _) in _workers.items() if k == key]:
            _workers.pop(thread)[1].kill()
