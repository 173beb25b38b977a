"""Many trials of a light device: memory, descriptors and temporary files stay as they were. And what a study costs besides its landings."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.isolation import Limits
from sprain_cosim.master import Master
from sprain_cosim.scenario import Scenario
from sprain_cosim.uq.backends import Task, open_backend
from sprain_cosim.uq.backends.local import Local
from sprain_cosim.uq.dispatch import Dispatch
from sprain_cosim.uq.ledger import Ledger
from tests.native import device


def resident(process: int | str) -> int:
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def soak(folder: Path, trials: int, warm: int) -> None:
    scenario = Scenario("light", {"brace": device(folder / "light.fmu")}, {}, {}, Master(stop=1e-3), "light")
    values = np.linspace(1.0, 50.0, trials)[:, None]
    seen: list[tuple[int, float, int, int, int, int]] = []
    with Ledger(folder / "soak", "soak", {}) as ledger:
        backend = open_backend(Task(scenario, ("brace.stiffness",), Limits(recycle=trials + 1)), 1, None)
        assert isinstance(backend, Local)

        def look(finished: int, total: int, failed: int, seconds: float) -> None:
            if finished >= warm and backend._workers and (child := backend._workers[0]._child) is not None:
                temporary = len(os.listdir(tempfile.gettempdir()))
                seen.append((finished, seconds, resident("self"), resident(child._process.pid), len(os.listdir("/proc/self/fd")), temporary))

        dispatch = Dispatch(ledger, backend, progress=look)
        try:
            dispatch.finish([(np.arange(trials), values)], trials)
        finally:
            dispatch.close()
        numbers, failed = ledger.finished()
    assert len(numbers) == trials
    assert not failed.any()
    first, last = seen[0], seen[-1]
    assert last[2] - first[2] < 20 << 20, "this process grew"
    assert last[3] - first[3] < 20 << 20, "the child grew"
    assert last[4] == first[4]
    assert last[5] <= first[5] + 2  # other programs have temporary files too
    print(f"\n{trials} trials: driver {(last[2] - first[2]) / 2**20:+.1f} MB, child {(last[3] - first[3]) / 2**20:+.1f} MB, ", end="")
    half = len(seen) // 2
    early, late = ((b[0] - a[0]) / (b[1] - a[1]) for a, b in ((seen[0], seen[half]), (seen[half], seen[-1])))
    print(f"{early:.0f}/s in the first half, {late:.0f}/s in the second")


def test_short_soak(tmp_path: Path) -> None:
    soak(tmp_path, 3000, 500)


@pytest.mark.long
def test_a_hundred_thousand_trials(tmp_path: Path) -> None:
    soak(tmp_path, 100_000, 5000)


@pytest.mark.long
def test_isolation_and_ledger_cost_at_most_a_twentieth_of_a_landing(tmp_path: Path) -> None:
    """One worker: all the time that is not in a landing (requests, answers, rows, commits) as a share of the landings' own, and the processor time
    of this process, which the other workers would be without."""
    names, n, turns = ("plant.drop_height",), 100, 5
    x = np.linspace(0.25, 0.35, n)[:, None]
    shares = []
    with Ledger(tmp_path / "cost", "cost", {}) as ledger:
        dispatch = Dispatch(ledger, open_backend(Task(sc.load_scenario("incline30_mixed"), names), 1, None))
        try:
            dispatch.finish([(np.array([turns * n]), x[:1])], 1)
            for turn in range(turns):
                numbers = np.arange(n) + n * turn
                began, here = time.perf_counter(), time.process_time()
                dispatch.finish([(numbers, x)], n)
                elapsed, here = time.perf_counter() - began, time.process_time() - here
                landings = sum(row.outcome.wall for row in map(ledger.row, numbers.tolist()) if row is not None)
                shares.append((elapsed / landings - 1, here / landings, landings / n))
        finally:
            dispatch.close()
    total, driver, landing = np.median(shares, axis=0)
    print(f"\nlanding {1e3 * landing:.1f} ms; isolation and ledger {100 * total:.1f} % more, {100 * driver:.1f} % processor time of the driver")
    assert total < 0.05
