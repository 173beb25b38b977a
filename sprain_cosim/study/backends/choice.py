"""Where trials run.

| Backend | Workers | Chosen by |
|---|---|---|
| local | threads of this process, each with a child process | default |
| dask | threads of Dask workers, each with such a child | `--scheduler tcp://...`, `tls://...`, `local-cluster` |
"""

from __future__ import annotations

from .backend import Backend, Task
from .local import Local


def open_backend(task: Task, workers: int | None, scheduler: str | None) -> Backend:
    """`workers` processes here, or the Dask cluster at `scheduler`. Raises InputError, EnvironmentProblem."""
    if scheduler is None:
        return Local(task, workers)
    from .dask import Dask  # an extra: the base install has no Dask

    return Dask(task, workers, scheduler)
