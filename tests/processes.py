"""What runs on this machine, for tests of what must have ended."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path


def alive_in(group: int) -> list[str]:
    """Processes of a group that are not zombies."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = (Path("/proc") / entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[2]) == group and fields[0] != "Z":
                found.append(entry)
    return found


def soon(condition: Callable[[], bool], seconds: float) -> bool:
    """Whether it becomes so. The `seconds` are those of the processor that asking again and again takes: where a loaded
    machine makes others slow, they last as much longer."""
    began = time.process_time()
    while not condition():
        if time.process_time() - began > seconds:
            return False
        os.sched_yield()
    return True
