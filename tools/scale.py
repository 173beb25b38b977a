"""What a study of many trials costs besides its landings.
Run: python tools/scale.py [--trials N] [--scheduler local-cluster] [--workers K] [--landing SECONDS].

Trials of a known duration stand in place of the landing; all else is as in a study: child processes, batches, window, ledger. Prints the rate, the size of
the ledger, and the memory of this process, sampled along the way."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.uq.distributions import JointDistribution, Normal

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
        return SimpleNamespace(status="completed", message="", metrics={f"metric_{k}": values[k % len(values)] + k for k in range(METRICS)})


def memory() -> tuple[float, float, int]:
    """Resident MB of this process, private MB of it, open descriptors."""
    status = {line.split(":")[0]: line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(("VmRSS", "RssAnon"))}
    return int(status["VmRSS"]) / 1024, int(status["RssAnon"]) / 1024, len(os.listdir("/proc/self/fd"))


def measure(trials: int, workers: int, scheduler: str | None, landing: float, out: Path) -> list[tuple[int, float, float, float, int]]:
    """(finished, seconds, resident MB, private MB, descriptors) every 5 % of the trials."""
    joint = JointDistribution(tuple(Normal(0.0, 1.0) for _ in range(INPUTS)))
    seen: list[tuple[int, float, float, float, int]] = []

    def progress(finished: int, total: int, failed: int, seconds: float) -> None:
        if finished >= total * len(seen) / 20:
            seen.append((finished, seconds, *memory()))
            rate, each = options.trials / wall, size / options.trials

    print(f"{options.trials} trials of {1e3 * options.landing:g} ms in {wall:.1f} s: {rate:.0f}/s; ledger {each:.0f} B a trial")
    print(f"driver: {seen[-1][2] - seen[len(seen) // 4][2]:+.1f} MB from a quarter of the trials to the end")


if __name__ == "__main__":
    tools = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = os.pathsep.join([tools, str(Path(tools).parent), os.environ.get("PYTHONPATH", "")])  # children import Stub by its name
    import scale

    scale.main()
