"""Run by test_libcosim.py with the Python of an environment that has libcosimpy: the task on stdin, the series on
stdout, both JSON."""

import json
import sys

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

log_output_level(CosimLogLevel.FATAL)
task = json.load(sys.stdin)
execution = CosimExecution.from_step_size(step_size=task["step_ns"])
slaves = {name: CosimLocalSlave(fmu_path=file, instance_name=name) for name, file in task["fmus"].items()}
index = {name: execution.add_local_slave(local_slave=slave) for name, slave in slaves.items()}
for (source, out), (target, into) in task["connections"]:
    execution.connect_real_variables(index[source], out, index[target], into)
observer = CosimObserver.create_last_value()
execution.add_observer(observer=observer)
rows = []
for _ in range(task["steps"]):
    execution.step()
    rows.append([observer.last_real_values(index[name], [reference])[0] for name, reference in task["watch"]])
print(json.dumps(rows))
