"""The same FMUs under another co-simulation master, for tools/bench.py, which runs this file with the Python of that
master's own environment.

Reads a task from stdin (JSON: peer, fmus {name: file}, connections {input: output}, parameters {"component.parameter":
value}, references {"component.variable": value reference}, step and stop [s], repeat) and prints {"seconds": shortest
wall time of a landing, "peak": [rad]} as JSON."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

PEAK = "plant.subtalar_angle"


def libcosim(task: dict[str, Any]) -> tuple[float, float]:
    """Fixed-step algorithm of libcosim (parallel Jacobi), a fresh execution for each landing, which is how it is
    used."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(step_size=round(1e9 * task["step"]))
    slaves = {name: CosimLocalSlave(fmu_path=file, instance_name=name) for name, file in task["fmus"].items()}
    index = {name: execution.add_local_slave(local_slave=slave) for name, slave in slaves.items()}
    reference = task["references"]
    for target, source in task["connections"].items():
        ends = [(index[end.partition(".")[0]], reference[end]) for end in (source, target)]
        execution.connect_real_variables(*ends[0], *ends[1])
    for name, value in task["parameters"].items():
        component = index[name.partition(".")[0]]
        if name in task["integers"]:
            execution.integer_initial_value(component, reference[name], int(value))
        else:
            execution.real_initial_value(component, reference[name], float(value))
    observer = CosimObserver.create_time_series(buffer_size=100_000)
    execution.add_observer(observer=observer)
    observer.start_time_series(index["plant"], reference[PEAK], CosimVariableType.REAL)
    execution.step()  # the first step includes the initialisation; it is left out of the time
    began = time.perf_counter()
    execution.simulate_until(round(1e9 * (task["stop"] + task["step"])))
    seconds = time.perf_counter() - began
    return seconds, max(
        observer.time_series_real_samples(index["plant"], reference[PEAK], 1, round(task["stop"] / task["step"]))[2]
    )


def cofmupy(task: dict[str, Any]) -> tuple[float, float]:
    """Jacobi without iteration."""
    from cofmupy import Coordinator

    def end(name: str) -> dict[str, str]:
        component, _, variable = name.partition(".")
        return {"id": component, "variable": variable, "type": "fmu"}

    initial: dict[str, dict[str, float]] = {name: {} for name in task["fmus"]}
    for name, value in task["parameters"].items():
        component, _, variable = name.partition(".")
        initial[component][variable] = value
    config = {
        "fmus": [{"id": n, "name": n, "path": f, "initialization": initial[n]} for n, f in task["fmus"].items()],
        "connections": [{"source": end(s), "target": end(t)} for t, s in task["connections"].items()],
        "cosim_method": "jacobi",
        "iterative": False,
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "system.json"
        file.write_text(json.dumps(config))
        coordinator = Coordinator()
        coordinator.start(str(file))
    peak = -1e9
    began = time.perf_counter()
    for _ in range(round(task["stop"] / task["step"])):
        coordinator.do_step(task["step"])
        peak = max(peak, coordinator.get_variable(("plant", "subtalar_angle"))[0])
    return time.perf_counter() - began, peak


def main() -> None:
    task = json.load(sys.stdin)
    runs = [{"libcosim": libcosim, "cofmupy": cofmupy}[task["peer"]](task) for _ in range(task["repeat"])]
    print(json.dumps({"seconds": min(seconds for seconds, _ in runs), "peak": runs[0][1]}), flush=True)


if __name__ == "__main__":
    main()
