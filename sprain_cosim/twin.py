"""A copy of this process that shares its work: each of the two takes the next task that nobody has begun.

    with shared(tasks) as results:   # the copy begins
        ...                          # something that is no task
        found = results()            # this process takes its share, and waits

There is a copy only where that is safe (fork_server.py) and where it finds a core of its own; elsewhere this process
does all of it. What the copy does not hand over, because it failed or was ended, is done here: errors are those of one
process."""

from __future__ import annotations

import contextlib
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import NoReturn, TypeVar

from .fork_server import can_be_copied, end, forked
from .machine.here import SYSTEM

MOST = 256  # tasks: a number is one byte
T = TypeVar("T")
Tasks = Sequence[Callable[[], T]]


@contextlib.contextmanager
def shared(tasks: Tasks[T]) -> Iterator[Callable[[], list[T]]]:
    """Yields what gives the results in the order of the `tasks`, and raises what a task raises.

    tasks  in the order in which they are begun: the longest first leave the least to wait for; what they return can be
           pickled"""
    if not (1 < len(tasks) <= MOST and SYSTEM.cores() > 1 and can_be_copied()):
        yield lambda: [task() for task in tasks]
        return
    numbers, numbered = os.pipe()
    source, target = os.pipe()
    parent, process = os.getpid(), 0
    try:
        os.write(numbered, bytes(range(len(tasks))))
        os.close(numbered)
        with contextlib.suppress(OSError):  # no more processes
            process = forked(lambda: _live(tasks, numbers, target, parent))
        os.close(target)
        yield lambda: _results(tasks, numbers, source)
    finally:
        if process:
            end(process)
        os.close(numbers)
        os.close(source)


def _results(tasks: Tasks[T], numbers: int, source: int) -> list[T]:
    found = dict(_share(tasks, numbers))
    with open(source, "rb", closefd=False) as file, contextlib.suppress(EOFError, pickle.UnpicklingError):
        found.update(pickle.loads(file.read()))
    return [found[n] if n in found else task() for n, task in enumerate(tasks)]


def _share(tasks: Tasks[T], numbers: int) -> Iterator[tuple[int, T]]:
    while number := os.read(numbers, 1):
        yield number[0], tasks[number[0]]()


def _live(tasks: Tasks[T], numbers: int, target: int, parent: int) -> NoReturn:
    SYSTEM.die_with(parent)
    found = dict[int, T]()
    with contextlib.suppress(Exception):
        for number, result in _share(tasks, numbers):
            found[number] = result
    with open(target, "wb") as file:
        pickle.dump(found, file)
    os._exit(0)
