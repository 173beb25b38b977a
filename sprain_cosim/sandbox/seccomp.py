"""The filter of system calls: refusals as a program of the kernel's packet filter machine (seccomp, mode filter)."""

from __future__ import annotations

import ctypes
import platform
import struct
from collections.abc import Mapping
from itertools import chain

from .kernel import call, checked
from .syscalls import ARCHITECTURES, COLUMNS, ENOSYS, NEWEST, OTHER_INTERFACE, Condition, Refusal

LOAD, EQUAL, GREATER, AT_LEAST, BITS, RETURN = 0x20, 0x15, 0x25, 0x35, 0x45, 0x06
KILL, ERRNO, NOTIFY, ALLOW = 0x80000000, 0x00050000, 0x7FC00000, 0x7FFF0000
NUMBER, ARCHITECTURE, ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
SET_FILTER, WITHOUT_SLOWING, LISTENER = 1, 1 << 2, 1 << 3
"""Without SPEC_ALLOW, kernels before 5.16 switch a mitigation on that slows all computing of the process."""

Instruction = tuple[int, int, int, int]  # code, jump if true, jump if false, value


class FilterProgram(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))


def compiled(refusals: Mapping[str, Refusal], watched: tuple[str, ...] | None = None) -> bytes:
    """The program for this machine. With `watched` a supervisor is asked about each refused and each watched call."""
    numbers = COLUMNS[platform.machine()]
    program: list[Instruction] = [
        (LOAD, 0, 0, ARCHITECTURE),
        (EQUAL, 1, 0, ARCHITECTURES[platform.machine()]),
        (RETURN, 0, 0, KILL),
        (LOAD, 0, 0, NUMBER),
        (AT_LEAST, 0, 1, OTHER_INTERFACE),
        (RETURN, 0, 0, ERRNO | ENOSYS),
        (GREATER, 0, 1, NEWEST),
        (RETURN, 0, 0, ERRNO | ENOSYS),
    ]
    for name, refusal in refusals.items():
        if name in numbers:
            ending = NOTIFY if watched is not None and refusal.error != ENOSYS else ERRNO | refusal.error
            block = _block(refusal.conditions, ending, NOTIFY if name in (watched or ()) else ALLOW)
            program += [(EQUAL, 0, len(block), numbers[name]), *block]
    for name in watched or ():
        if name in numbers and name not in refusals:
            program += [(EQUAL, 0, 1, numbers[name]), (RETURN, 0, 0, NOTIFY)]
    program.append((RETURN, 0, 0, ALLOW))
    return struct.pack("<" + len(program) * "HBBI", *chain.from_iterable(program))


def _block(conditions: tuple[Condition, ...], refused: int, granted: int) -> list[Instruction]:
    """Falls through to `granted` where every condition holds; jumps to `refused`, the last instruction, otherwise."""
    tests: list[list[Instruction]] = []
    for condition in conditions:
        loaded: Instruction = (LOAD, 0, 0, ARGUMENTS + 8 * condition.argument)
        tests.append([loaded, *_jumps(condition)])
    total = sum(len(test) for test in tests)
    block: list[Instruction] = []
    for test in tests:
        for code, true, false, value in test:
            here = len(block) + 1
            there = total + 1 - here  # to the refusal
            block.append((code, there if true == REFUSE else true, there if false == REFUSE else false, value))
    if conditions:
        block.append((RETURN, 0, 0, granted))
    block.append((RETURN, 0, 0, refused))
    return block


REFUSE = -1


def _jumps(condition: Condition) -> list[Instruction]:
    values = condition.values
    if condition.test == "any bit":
        return [(BITS, 0, REFUSE, values[0])]
    if condition.test == "no bit":
        return [(BITS, REFUSE, 0, values[0])]
    if condition.test == "not among":
        return [(EQUAL, REFUSE, 0, value) for value in values]
    last = len(values) - 1
    return [(EQUAL, last - k, REFUSE if k == last else 0, value) for k, value in enumerate(values)]


def install(program: bytes, listener: bool = False) -> int:
    """Holds for this thread and what it starts, for good. Returns the descriptor of the listener, or 0. Raises
    OSError."""
    buffer = ctypes.create_string_buffer(program, len(program))
    filtered = FilterProgram(len(program) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    flags = WITHOUT_SLOWING | (LISTENER if listener else 0)
    number = COLUMNS[platform.machine()]["seccomp"]
    return checked(call(number, SET_FILTER, flags, ctypes.byref(filtered)), "seccomp")
