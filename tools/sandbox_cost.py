"""What a process of its own and the sandbox cost, side by side in one run: processor time of a landing in a study's
worker, of a run in a program and of the whole command `run`, and whether the numbers are the same to the bit.

    python tools/sandbox_cost.py [--landings 20] [--turns 15]

The device is a copy of a brace that ships, which counts as foreign. Each turn measures all ways one after the other;
the least of the turns, and the median over the turns of what a way costs more than another. Processor time is that of
this process, of those that it starts and of theirs."""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim import fork_server
from sprain_cosim.process import Child
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.shipped import FMUS
from sprain_cosim.study import worker as study_worker
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


def landed(worker: Worker, values: Sequence[float]) -> dict[float, Mapping[str, float]]:
    """The metrics of a trial with each of the values, by the way that a study takes."""
    outcomes = chain.from_iterable(worker.run_all([([value], False) for value in values]))
    return {value: outcome.metrics for value, outcome in zip(values, outcomes, strict=True)}


def study_costs(scenario: Scenario, landings: int, turns: int, processes: int) -> None:
    """Of values whose trial a study does not make once more at half its step, which is no cost of isolation. The
    landing alone is measured in the same process: another one is faster or slower by some percent for as long as it
    lives, by where its memory lies."""
    several = np.linspace(0.25, 0.35, 2 * landings).tolist()
    x = [value for value in several if not made_again([value])][:landings]
    study_worker.Child = lambda _, limits: Child("tools.sandbox_child", limits)  # type: ignore[misc, assignment]
    with scenario.open(in_process=True) as session:
        metrics = {value: session.run({NAME: value}, judged=False).metrics for value in x}
    for name, chosen in (("a process of its own", scenario.unconfined()), ("and the sandbox", scenario)):
        found = []
        for _ in range(processes):
            with Worker(chosen, (NAME,)) as worker:
                landed(worker, [0.3] * 10)
                found.append(np.median([_turn(worker, x, metrics) for _ in range(turns)], axis=0) / landings)
        alone, driver, child = np.median(found, axis=0)
        share = np.median([(d + c) / a - 1 for a, d, c in found])
        print(
            f"{name:22}{1e3 * (child + driver):6.2f} ms a landing, of which {1e3 * driver:.2f} ms in the driver; alone "
            f"{1e3 * alone:.2f} ms: {100 * share:+.1f} %"
        )
    print("numbers equal to the bit: yes")


def _turn(worker: Worker, x: Sequence[float], metrics: Mapping[float, object]) -> tuple[float, float, float]:
    """[s] of processor time: the landings alone, the driver, the child."""
    assert worker._child is not None
    process = worker._child._process.pid
    alone = worker._child.call("alone", x, limit=60.0)
    here, there = time.thread_time(), spent(process)
    outcomes = landed(worker, x)
    here, there = time.thread_time() - here, spent(process) - there
    assert outcomes == metrics, "other numbers"
    return alone, here, there


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


def command_costs(device: Path, turns: int) -> None:
    """Of the whole command, begun and ended `turns` times each way: what each turn adds, the median of them."""
    command = [sys.executable, "-P", "-m", "sprain_cosim", "run", "incline30_brace", "--fmu", f"brace={device}"]
    times = []
    for _ in range(turns + 1):
        turn = []
        for more in (["--in-process"], []):
            began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL, cwd=device.parent)
            ended = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            turn.append(
                [ended[0].ru_utime + ended[0].ru_stime - began[0].ru_utime - began[0].ru_stime, ended[1] - began[1]]
            )
        times.append(turn)
    found = 1e3 * np.array(times[1:])  # the first fills caches
    for k, kind in enumerate(("processor", "wall")):
        here, apart = np.median(found[:, 0, k]), np.median(found[:, 1, k] - found[:, 0, k])
        print(f"command {kind:9} in this process {here:8.1f} ms, in a process and a sandbox {apart:+.1f} ms")


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--landings", type=int, default=20)
    arguments.add_argument("--turns", type=int, default=15)
    arguments.add_argument("--processes", type=int, default=8)
    chosen = arguments.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        device = foreign(Path(scratch))
        scenario = load_scenario("incline30_brace").replace_fmu("brace", device)
        print(f"isolation: {scenario.isolation().kind}")
        study_costs(scenario, chosen.landings, chosen.turns, chosen.processes)
        run_costs(scenario, chosen.turns)
        command_costs(device, chosen.turns)


if __name__ == "__main__":
    main()
