"""What the kernel of this machine offers a sandbox, and the calls of it that Python does not have."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from .syscalls import COLUMNS

LANDLOCK_CREATE_RULESET, LANDLOCK_ADD_RULE, LANDLOCK_RESTRICT_SELF = 444, 445, 446
SECCOMP_GET_ACTION_AVAIL, RET_ERRNO = 2, 0x00050000
NETWORK_ABI, SIGNAL_ABI, TRUNCATE_ABI = 4, 6, 3  # Landlock's, from which each is held


@dataclass(frozen=True)
class Offer:
    """`landlock` its version (ABI), 0 without; `seccomp` whether system calls can be filtered; `namespaces` whether a
    process may have a network of its own."""

    landlock: int = 0
    seccomp: bool = False
    namespaces: bool = False

    def gaps(self) -> list[str]:
        """What a sandbox on this machine does not hold back, one sentence each; empty: all is held."""
        if sys.platform != "linux":
            return ["files, network, processes: there is a sandbox on Linux alone, so an FMU may do what you may"]
        found = []
        if not self.landlock:
            found.append("files: the kernel has no Landlock, so an FMU may read, change and delete what you may")
        elif self.landlock < TRUNCATE_ABI and not self.seccomp:
            found.append("files: this Landlock does not keep an FMU from emptying them")
        if not self.seccomp:
            found.append("system calls: the kernel cannot filter them, so an FMU may start processes and open sockets")
            if self.landlock < NETWORK_ABI:
                found.append("network: an FMU may open connections")
            if self.landlock < SIGNAL_ABI:
                found.append("signals: an FMU may stop and kill your processes")
        return found

    def __str__(self) -> str:
        parts = [f"Landlock ABI {self.landlock}"] if self.landlock else []
        parts += ["system call filter"] if self.seccomp else []
        parts += ["network namespaces"] if self.namespaces else []
        return ", ".join(parts) or "nothing"


@lru_cache(maxsize=1)
def offered() -> Offer:
    """Asks the kernel; changes nothing."""
    if sys.platform != "linux":
        return Offer()
    landlock = max(0, call(LANDLOCK_CREATE_RULESET, None, 0, 1))
    return Offer(landlock, _filters(), _namespaces())


def _filters() -> bool:
    column = COLUMNS.get(platform.machine())
    if column is None or sys.byteorder != "little":
        return False
    action = ctypes.c_uint32(RET_ERRNO)
    return call(column["seccomp"], SECCOMP_GET_ACTION_AVAIL, 0, ctypes.byref(action)) == 0


def _namespaces() -> bool:
    if os.geteuid() == 0:
        return Path("/proc/self/ns/net").exists()
    try:
        most = int(Path("/proc/sys/user/max_user_namespaces").read_text())
        closed = [
            Path("/proc/sys") / name
            for name, value in (
                ("kernel/unprivileged_userns_clone", "0"),
                ("kernel/apparmor_restrict_unprivileged_userns", "1"),
            )
            if (Path("/proc/sys") / name).exists() and (Path("/proc/sys") / name).read_text().strip() == value
        ]
    except (OSError, ValueError):
        return False
    return most > 0 and not closed


@lru_cache(maxsize=1)
def libc() -> Any:
    return ctypes.CDLL(None, use_errno=True)


def call(number: int, *arguments: Any) -> int:
    """A system call; -1 on failure, then `ctypes.get_errno()` says why."""
    return int(libc().syscall(ctypes.c_long(number), *arguments))


def prctl(option: int, *arguments: int) -> int:
    padded = [*arguments, 0, 0, 0, 0][:4]
    return int(libc().prctl(option, *(ctypes.c_ulong(a) for a in padded)))


def checked(result: int, doing: str) -> int:
    """Raises OSError where a call failed."""
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{doing}: {os.strerror(number)}")
    return result
