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
from ..worker import Stopped, Worker
from .backend import Job, Task


class Local:
    """Workers are hired when there is work for them. `workers` None: one per core that this process may use."""

    batch = 0.0  # single trials: the ledger gets each at once

    def __init__(self, task: Task, workers: int | None) -> None:
        self.level = task.level or processor.level()
        self._task, self._count = task, workers or SYSTEM.cores()
        self._workers: list[Worker] = []
        self._threads: list[threading.Thread] = []
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[Row | BaseException] = queue.SimpleQueue()
        prepare_children()

    def workers(self) -> int:
        return self._count

    def send(self, jobs: Sequence[Job]) -> None:
        for job in jobs:
            self._jobs.put(job)
        if len(self._workers) < self._count and self._jobs.qsize():
            self._hire()

    def receive(self) -> list[Row]:
        found: list[Row | BaseException] = [signals.taken(self._done)]
        while not self._done.empty():
            found.append(self._done.get())
        rows = [row for row in found if isinstance(row, Row)]
        problem = next((p for p in found if not isinstance(p, Row)), None)
        if problem is not None:
            for row in rows:
                self._done.put(row)
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
            if isinstance(row := self._done.get(), Row):
                rows.append(row)
        return rows

    def _hire(self) -> None:
        worker = Worker(self._task.scenario, self._task.names, self._task.limits, self.level)
        thread = threading.Thread(target=self._work, args=(worker, str(len(self._workers))), daemon=True)
        self._workers.append(worker)
        self._threads.append(thread)
        thread.start()

    def _work(self, worker: Worker, label: str) -> None:
        try:
            while (job := self._jobs.get()) is not None:
                self._done.put(
                    Row(job.trial, np.asarray(job.values, float), worker.run(job.values.tolist(), job.record), label)
                )
        except Stopped:
            pass
        except BaseException as problem:  # receive() raises it
            self._done.put(problem)
