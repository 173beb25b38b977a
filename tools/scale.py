"""What a study of many trials costs besides its landings.
Run: python tools/scale.py [--trials N] [--scheduler local-cluster] [--workers K] [--landing SECONDS].

Trials of a known duration stand in place of the landing; all else is as in a study: child processes, batches, window,
ledger. Prints the rate, the size of the ledger, and the memory of this process, sampled along the way."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.study.backends.backend import Task
from sprain_cosim.study.backends.choice import open_backend
from sprain_cosim.study.dispatch import Dispatch
from sprain_cosim.study.ledger import FILE, Ledger
from sprain_cosim.uq.distributions import JointDistribution, Normal
from sprain_cosim.uq.sampling import monte_carlo_blocks

INPUTS, METRICS = 10, 30


@dataclass(frozen=True)
class Stub:
    """In place of a scenario: a trial takes `seconds` and gives 30 metrics made of its inputs."""

    seconds: float

    def open(self) -> Stub:
        return self

    def __enter__(self) -> Stub:
        return self

    def __exit__(self, *_: object) -> None: ...

    def run(self, parameters: Mapping[str, float]) -> SimpleNamespace:
        if self.seconds:
            time.sleep(self.seconds)
        values = list(parameters.values())
        return SimpleNamespace(
            status="completed", message="", metrics={f"metric_{k}": values[k % len(values)] + k for k in range(METRICS)}
        )


def memory() -> tuple[float, float, int]:
    """Resident MB of this process, private MB of it, open descriptors."""
    status = {
        line.split(":")[0]: line.split()[1]
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith(("VmRSS", "RssAnon"))
    }
    return int(status["VmRSS"]) / 1024, int(status["RssAnon"]) / 1024, len(os.listdir("/proc/self/fd"))


def measure(
    trials: int, workers: int, scheduler: str | None, landing: float, out: Path
) -> list[tuple[int, float, float, float, int]]:
    """(finished, seconds, resident MB, private MB, descriptors) every 5 % of the trials."""
    joint = JointDistribution(tuple(Normal(0.0, 1.0) for _ in range(INPUTS)))
    seen: list[tuple[int, float, float, float, int]] = []

    def progress(finished: int, total: int, failed: int, seconds: float) -> None:
        if finished >= total * len(seen) / 20:
            seen.append((finished, seconds, *memory()))
            print(
                f"{finished:9d} trials {seconds:8.1f} s  {seen[-1][2]:7.1f} MB resident, {seen[-1][3]:7.1f} MB "
                f"private, {seen[-1][4]} descriptors",
                flush=True,
            )

    def blocks() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for first, x in monte_carlo_blocks(joint, trials, 7):
            yield np.arange(first, first + len(x)), x

    with Ledger(out, "scale", {}) as ledger:
        dispatch = Dispatch(
            ledger,
            open_backend(Task(Stub(landing), tuple(f"x{k}" for k in range(INPUTS))), workers, scheduler),
            progress=progress,
        )
        try:
            dispatch.finish(blocks(), trials)
        finally:
            dispatch.close()
        numbers, failed = ledger.finished()
    assert len(numbers) == trials and numbers[0] == 0 and numbers[-1] == trials - 1 and not failed.any()
    return seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20_000)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--scheduler")
    parser.add_argument("--landing", type=float, default=0.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        began, used = time.perf_counter(), time.process_time()
        seen = measure(options.trials, options.workers, options.scheduler, options.landing, Path(folder) / "scale")
        wall, used = time.perf_counter() - began, time.process_time() - used
        size = (Path(folder) / "scale" / FILE).stat().st_size
    rate, each = options.trials / wall, size / options.trials
    print(f"{options.trials} trials of {1e3 * options.landing:g} ms in {wall:.1f} s: {rate:.0f}/s")
    print(f"ledger {each:.0f} B a trial; {1e6 * used / options.trials:.0f} us of processor time of this process")
    print(f"driver: {seen[-1][2] - seen[len(seen) // 4][2]:+.1f} MB from a quarter of the trials to the end")


if __name__ == "__main__":
    tools = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [tools, str(Path(tools).parent), os.environ.get("PYTHONPATH", "")]
    )  # children import Stub by its name
    import scale

    scale.main()
