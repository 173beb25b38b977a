"""Child processes of this process, one thread each to drive them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Sequence

import numpy as np

from ... import processor, signals
from ...machine.here import SYSTEM
from ...process import prepare_children
from ..ledger import Row
from ..worker import EXCHANGE, Stopped, Worker
from .backend import Job, Task


class Local:
    """Workers are hired when there is work for them. `workers` None: one per core that this process may use."""

    batch = EXCHANGE

    def __init__(self, task: Task, workers: int | None) -> None:
        self.level = task.level or processor.level()
        self._task, self._count = task, workers or SYSTEM.cores()
        self._workers: list[Worker] = []
        self._threads: list[threading.Thread] = []
        self._jobs: queue.SimpleQueue[Sequence[Job] | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[list[Row] | BaseException] = queue.SimpleQueue()
        prepare_children()

    def workers(self) -> int:
        return self._count

    def send(self, jobs: Sequence[Job]) -> None:
        self._jobs.put(jobs)
        if len(self._workers) < self._count and self._jobs.qsize():
            self._hire()

    def receive(self) -> list[Row]:
        found: list[list[Row] | BaseException] = [signals.taken(self._done)]
        while not self._done.empty():
            found.append(self._done.get())
        rows = [row for each in found if isinstance(each, list) for row in each]
        problem = next((each for each in found if not isinstance(each, list)), None)
        if problem is not None:
            self._done.put(rows)
            raise problem
        return rows

    def close(self) -> list[Row]:
        for worker in self._workers:
            worker.kill()
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads:
            thread.join(1.0)
        rows = []
        while not self._done.empty():
            if isinstance(found := self._done.get(), list):
                rows += found
        return rows

    def _hire(self) -> None:
        worker = Worker(self._task.scenario, self._task.names, self._task.limits, self.level)
        thread = threading.Thread(target=self._work, args=(worker, str(len(self._workers))), daemon=True)
        self._workers.append(worker)
        self._threads.append(thread)
        thread.start()

    def _work(self, worker: Worker, label: str) -> None:
        try:
            while (jobs := self._jobs.get()) is not None:
                waiting = iter(jobs)
                for outcomes in worker.run_all([(job.values.tolist(), job.record) for job in jobs]):
                    landed = zip(outcomes, waiting, strict=False)
                    self._done.put([Row(job.trial, np.asarray(job.values, float), o, label) for o, job in landed])
        except Stopped:
            pass
        except BaseException as problem:  # receive() raises it
            self._done.put(problem)
