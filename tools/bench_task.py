"""One measurement for tools/bench_versions.py, in the version of the package that PYTHONPATH names; one line of JSON.

python tools/bench_task.py runs NAME REPEAT | worker | memory [NAME]"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def least(run: Callable[[], object], repeat: int) -> float:
    """Processor time [s] of this process and of children that have ended."""
    times = []
    for _ in range(repeat):
        began = time.process_time()
        run()
        times.append(time.process_time() - began)
    return min(times)


def runs(name: str, repeat: int) -> dict[str, Any]:
    from sprain_cosim.scenario import load_scenario

    scenario = load_scenario(name)
    result = scenario.run()
    whole = least(lambda: scenario.run().metrics, repeat)
    with scenario.open() as session:
        session.run()
        landing = least(lambda: session.run().metrics, repeat)
    return {"run": whole, "session": landing, "peak": result.metrics["peak_subtalar_angle_deg"]}


def worker() -> dict[str, Any]:
    """The second worker of a study: the first finds nothing of what it needs in memory."""
    from sprain_cosim.scenario import load_scenario
    from sprain_cosim.study.worker import Worker

    walls = []
    for _ in range(2):
        began = time.perf_counter()
        with Worker(load_scenario("incline30_brace"), ["plant.drop_height"]) as child:
            assert child.run([0.3]).status == "completed"
            walls.append(time.perf_counter() - began)
    return {"first": walls[0], "next": walls[1]}


def memory(name: str = "") -> dict[str, Any]:
    """Resident [B] of a process that has landed once; without a name of one that has only Python."""
    if name:
        from sprain_cosim.scenario import load_scenario

        load_scenario(name).run()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {"bytes": pages * resource.getpagesize()}


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    found = runs(rest[0], int(rest[1])) if task == "runs" else worker() if task == "worker" else memory(*rest)
    print(json.dumps(found))
