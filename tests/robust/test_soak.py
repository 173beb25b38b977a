"""Many trials of a light device: memory, descriptors and temporary files stay as they were. And what a study costs
besides its landings."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.cosim.master import Master
from sprain_cosim.process import Limits
from sprain_cosim.scenario import Scenario
from sprain_cosim.study.backends.backend import Task
from sprain_cosim.study.backends.choice import open_backend
from sprain_cosim.study.backends.local import Local
from sprain_cosim.study.dispatch import Dispatch
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.study.worker import made_again
from tests.native import device


def resident(process: int | str) -> int:
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture(autouse=True)
def own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr(tempfile, "tempdir", None)


def soak(folder: Path, trials: int, warm: int) -> None:
    scenario = Scenario("light", {"device": device(folder / "light.fmu")}, {}, {}, Master(stop=1e-3), "light")
    values = np.linspace(1.0, 50.0, trials)[:, None]
    seen: list[tuple[int, float, int, int, int, int]] = []
    with Ledger(folder / "soak", "soak", {}) as ledger:
        backend = open_backend(Task(scenario, ("device.stiffness",), Limits(recycle=trials + 1)), 1, None)
        assert isinstance(backend, Local)

        def look(finished: int, total: int, failed: int, seconds: float) -> None:
            if finished >= warm and backend._workers and (child := backend._workers[0]._child) is not None:
                temporary = len(os.listdir(tempfile.gettempdir()))
                seen.append(
                    (
                        finished,
                        seconds,
                        resident("self"),
                        resident(child._process.pid),
                        len(os.listdir("/proc/self/fd")),
                        temporary,
                    )
                )

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
    assert last[5] == first[5]
    print(
        f"\n{trials} trials: driver {(last[2] - first[2]) / 2**20:+.1f} MB, child {(last[3] - first[3]) / 2**20:+.1f} "
        "MB, ",
        end="",
    )
    assert len(seen) > 2
    half = len(seen) // 2
    early, late = ((b[0] - a[0]) / (b[1] - a[1]) for a, b in ((seen[0], seen[half]), (seen[half], seen[-1])))
    print(f"{early:.0f}/s in the first half, {late:.0f}/s in the second")


def test_short_soak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sprain_cosim.study.dispatch.COMMIT", 0.02)
    soak(tmp_path, 3000, 500)


@pytest.mark.long
def test_a_hundred_thousand_trials(tmp_path: Path) -> None:
    soak(tmp_path, 100_000, 5000)


def spent(process: int) -> float:
    """Processor time [s] of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.long
def test_isolation_and_ledger_cost_at_most_a_twentieth_of_a_landing(tmp_path: Path) -> None:
    """Processor time of the same landings, in turn: in this thread; in a child, with all that this process does to
    drive it and to keep the ledger. Of values whose trial a study does not make once more at half its step, which is no
    cost of isolation."""
    names, n, turns = ("plant.drop_height",), 100, 5
    x = np.array([[v] for v in np.linspace(0.25, 0.35, 2 * n).tolist() if not made_again([v])][:n])
    scenario, shares = sc.load_scenario("incline30_mixed"), []
    with scenario.open() as session, Ledger(tmp_path / "cost", "cost", {}) as ledger:
        backend = open_backend(Task(scenario, names), 1, None)
        assert isinstance(backend, Local)
        dispatch = Dispatch(ledger, backend)
        try:
            session.run({names[0]: 0.3})
            dispatch.finish([(np.array([turns * n]), x[:1])], 1)
            child = backend._workers[0]._child
            assert child is not None
            for turn in range(turns):
                before = time.thread_time()
                for (value,) in x:
                    session.run({names[0]: float(value)})
                landings = time.thread_time() - before
                here, there = time.process_time(), spent(child._process.pid)
                dispatch.finish([(np.arange(n) + n * turn, x)], n)
                here, there = time.process_time() - here, spent(child._process.pid) - there
                shares.append(((here + there) / landings - 1, here / landings, landings / n))
        finally:
            dispatch.close()
    total, driver, landing = np.median(shares, axis=0)
    print(
        f"\nlanding {1e3 * landing:.1f} ms of processor time; isolated and in the ledger {100 * total:+.1f} %, of "
        f"which {100 * driver:.1f} % in the driver"
    )
    assert total < 0.05
