"""The child of tools/sandbox_cost.py: that of a study, which is also asked for landings with nothing around them."""

from __future__ import annotations

import contextlib
import inspect
import time
from collections.abc import Iterator
from typing import Any

from sprain_cosim.process import Handlers, serve
from sprain_cosim.study import worker
from sprain_cosim.study.worker import _prepare  # noqa: F401 - before the process is copied


@contextlib.contextmanager
def _handlers(subject: Any) -> Iterator[Handlers]:
    name = subject[2][0]
    with worker._handlers(subject) as handlers:
        session = inspect.getclosurevars(handlers["halved"]).nonlocals["session"]

        def alone(values: list[float]) -> float:
            """[s] of processor time."""
            began = time.thread_time()
            for value in values:
                session.run({name: value}, judged=False).metrics  # noqa: B018
            return time.thread_time() - began

        yield {**handlers, "alone": alone}


if __name__ == "__main__":
    serve(_handlers)
