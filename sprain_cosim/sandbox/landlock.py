"""Landlock: which files, and whether other processes and the network, a process reaches. Constants: the kernel's
include/uapi/linux/landlock.h."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable

from .kernel import (
    LANDLOCK_ADD_RULE,
    LANDLOCK_CREATE_RULESET,
    LANDLOCK_RESTRICT_SELF,
    NETWORK_ABI,
    SIGNAL_ABI,
    call,
    checked,
)

EXECUTE, WRITE, READ, LIST = 1 << 0, 1 << 1, 1 << 2, 1 << 3
FIRST = (1 << 13) - 1  # what the first version governs
REFER, TRUNCATE, DEVICE_IOCTL = 1 << 13, 1 << 14, 1 << 15
OF_FILES = EXECUTE | WRITE | READ | TRUNCATE | DEVICE_IOCTL
BIND_TCP, CONNECT_TCP = 1, 2
ABSTRACT_SOCKETS, SIGNALS = 1, 2


class Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("access", ctypes.c_uint64), ("descriptor", ctypes.c_int32))


def restrict(
    abi: int, readable: Iterable[str], writable: Iterable[str], network: bool = False, execute: bool = False
) -> None:
    """Holds for this thread and what it starts, for good; no_new_privs must be set. Paths that do not exist are passed
    over. Raises OSError."""
    governed = FIRST | (REFER if abi >= 2 else 0) | (TRUNCATE if abi >= 3 else 0) | (DEVICE_IOCTL if abi >= 5 else 0)
    attributes = Ruleset(
        governed,
        BIND_TCP | CONNECT_TCP if abi >= NETWORK_ABI and not network else 0,
        ABSTRACT_SOCKETS | SIGNALS if abi >= SIGNAL_ABI else 0,
    )
    size = 8 if abi < NETWORK_ABI else 16 if abi < SIGNAL_ABI else 24
    ruleset = checked(call(LANDLOCK_CREATE_RULESET, ctypes.byref(attributes), size, 0), "landlock_create_ruleset")
    try:
        reading = READ | LIST | (EXECUTE if execute else 0)
        writing = governed if execute else governed & ~EXECUTE
        for rights, paths in ((reading, readable), (writing, writable)):
            for path in paths:
                _add(ruleset, path, rights & governed)
        checked(call(LANDLOCK_RESTRICT_SELF, ruleset, 0), "landlock_restrict_self")
    finally:
        os.close(ruleset)


def _add(ruleset: int, path: str, rights: int) -> None:
    try:
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not os.path.isdir(path):
            rights &= OF_FILES
        rule = Beneath(rights, descriptor)
        checked(call(LANDLOCK_ADD_RULE, ruleset, 1, ctypes.byref(rule), 0), f"landlock_add_rule {path}")
    finally:
        os.close(descriptor)
