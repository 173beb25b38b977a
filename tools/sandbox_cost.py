"""What a process of its own and the sandbox cost, side by side in one run: processor time of a landing in a study's
worker and of a whole `run`, and whether the numbers are the same to the bit.

    python tools/sandbox_cost.py [--landings 20] [--turns 15]

The device is a copy of a brace that ships, which counts as foreign. Each turn measures all ways one after the other;
the least of the turns, and the median over the turns of what a way costs more than another. Processor time is that of
this process, of those that it starts and of theirs."""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim import fork_server
from sprain_cosim.scenario import Scenario, Session, load_scenario
from sprain_cosim.shipped import FMUS
from sprain_cosim.study.worker import Worker, made_again

NAME = "plant.drop_height"


def foreign(folder: Path) -> Path:
    """A brace that ships with one file more, so that nothing knows its content."""
    path = folder / "device.fmu"
    shutil.copy(FMUS / "brace_bushing.fmu", path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("documentation/copy.txt", "a copy")
    return path


def spent(process: int) -> float:
    """Processor time [s] of another process so far: of its threads, to the nanosecond."""
    return (
        sum(int((task / "schedstat").read_text().split()[0]) for task in Path(f"/proc/{process}/task").iterdir()) / 1e9
    )


def all_time() -> float:
    """Processor time [s] of this process, of its children that have ended, and of the server of its children with
    those of them that have ended."""
    of = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    server = fork_server._server
    ticks = stat_fields(server.process)[11:15] if server else []
    return sum(u.ru_utime + u.ru_stime for u in of) + sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def stat_fields(process: int) -> list[str]:
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()


def study_costs(scenario: Scenario, landings: int, turns: int) -> None:
    """Of values whose trial a study does not make once more at half its step, which is no cost of isolation."""
    several = np.linspace(0.25, 0.35, 2 * landings).tolist()
    x = [value for value in several if not made_again([value])][:landings]
    shares = []
    with (
        scenario.open(in_process=True) as session,
        Worker(scenario.unconfined(), (NAME,)) as bare,
        Worker(scenario, (NAME,)) as confined,
    ):
        assert isinstance(session, Session)
        workers = {"a process of its own": bare, "and the sandbox": confined}
        for worker in workers.values():
            worker.run([0.3])
        for _ in range(turns):
            began, metrics = time.thread_time(), {}
            for value in x:
                metrics[value] = session.run({NAME: float(value)}, judged=False).metrics  # as workers do
            times = [time.thread_time() - began]
            for worker in workers.values():
                assert worker._child is not None
                child = worker._child._process.pid
                here, there = time.thread_time(), spent(child)
                outcomes = {value: dict(worker.run([float(value)]).metrics) for value in x}
                times.append(time.thread_time() - here + spent(child) - there)
                assert outcomes == metrics, "other numbers"
            shares.append(times)
    by_turn = np.array(shares)
    base, process, sandbox = by_turn.min(axis=0) / landings
    print(f"landing in a study          {1e3 * base:8.2f} ms of processor time in this process")
    for k, (name, value) in enumerate((("in a process of its own", process), ("and in the sandbox", sandbox)), 1):
        share = np.median(by_turn[:, k] / by_turn[:, k - 1] - 1)
        print(f"  {name:26}{1e3 * value:8.2f} ms  {100 * share:+.1f} % against the line above")
    print("numbers equal to the bit: yes")


def run_costs(scenario: Scenario, turns: int, runs: int = 10) -> None:
    """`runs` a turn, for the clock of what other processes took has ticks of 10 ms."""
    ways: dict[str, Callable[[], object]] = {
        "in this process": lambda: scenario.run(in_process=True),
        "in a process and a sandbox": scenario.run,
    }
    times: dict[str, list[float]] = {name: [] for name in ways}
    for run in ways.values():
        run()
    for _ in range(turns):
        for name, run in ways.items():
            began = all_time()
            for _ in range(runs):
                run()
            times[name].append((all_time() - began) / runs)
    first = None
    for name, found in times.items():
        value = min(found)
        first = value if first is None else first
        print(f"run {name:28}{1e3 * value:8.1f} ms of processor time  {1e3 * (value - first):+.1f} ms")


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--landings", type=int, default=20)
    arguments.add_argument("--turns", type=int, default=15)
    chosen = arguments.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        scenario = load_scenario("incline30_brace").replace_fmu("brace", foreign(Path(scratch)))
        print(f"isolation: {scenario.isolation().kind}")
        study_costs(scenario, chosen.landings, chosen.turns)
        run_costs(scenario, chosen.turns)


if __name__ == "__main__":
    main()
