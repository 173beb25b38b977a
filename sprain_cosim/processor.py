"""The level of x86-64 processors whose code the FMUs of the project run. They hold code for several and take the best
that runs (fmus/_native/device.c), or the one that SPRAIN_CPU names; results of two levels differ in the last digits.
And how many threads linear algebra takes."""

from __future__ import annotations

import contextlib
import math
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

VARIABLE = "SPRAIN_CPU"
LEVELS = ("x86-64-v2", "x86-64-v3")  # rising
OF_THE_BEST = {"avx2", "fma", "bmi1", "bmi2"}  # flags of /proc/cpuinfo
ROUNDING = 1e-9
AVX2_AVAILABLE = 40  # PF_AVX2_INSTRUCTIONS_AVAILABLE of the Windows API


@lru_cache(maxsize=1)
def own() -> str:
    """The best level that this processor runs; empty where that is not known, and for other kinds of processors."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return ""
    if sys.platform == "win32":
        import ctypes

        return LEVELS[-1 if ctypes.windll.kernel32.IsProcessorFeaturePresent(AVX2_AVAILABLE) else 0]
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            flags = next((line for line in file if line.startswith("flags")), "").partition(":")[2].split()
    except OSError:
        return ""
    return LEVELS[-1 if OF_THE_BEST.issubset(flags) else 0]


def level() -> str:
    """What is taken here: that of SPRAIN_CPU, else the processor's own."""
    return os.environ.get(VARIABLE) or own()


def runs_here(wanted: str) -> bool:
    """Whether this processor has `wanted`, one of LEVELS."""
    return wanted in LEVELS and own() in LEVELS and LEVELS.index(wanted) <= LEVELS.index(own())


def lowest(levels: Iterable[str]) -> str:
    """The level that all have; empty where one is not of LEVELS."""
    found = set(levels)
    return min(found, key=LEVELS.index) if found and found.issubset(LEVELS) else ""


def within_rounding(one: float, other: float) -> bool:
    """Whether two numbers of a landing may be those of two levels, which were found to differ by 1e-12 of the value."""
    return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=ROUNDING) or (math.isnan(one) and math.isnan(other))


def take(wanted: str) -> None:
    """For this process and its children from now on; empty: as it is."""
    if wanted:
        os.environ[VARIABLE] = wanted


Count = tuple[Callable[[], int], Callable[[int], None]]  # says and sets a number of threads


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra of NumPy and SciPy in one thread meanwhile; as it is where their wheels bring no OpenBLAS.

    Factors of some hundred columns make its threads wait for each other, turning: on a busy machine they take fifty
    times the processor time of one thread. What is summed in one thread is also the same on every machine."""
    held = [(put, count()) for count, put in _openblas()]
    more = [(put, before) for put, before in held if before > 1]
    for put, _ in more:
        put(1)
    try:
        yield
    finally:
        for put, before in more:
            put(before)


@lru_cache(maxsize=1)
def _openblas() -> tuple[Count, ...]:
    """Of the libraries that the wheels of NumPy and SciPy bring, which this process has loaded."""
    import ctypes

    found = list[Count]()
    for package in ("numpy", "scipy"):
        spec = find_spec(package)
        home = Path(spec.origin).parent if spec and spec.origin else Path()
        for path in (*home.parent.glob(f"{package}.libs/*openblas*"), *home.glob(".dylibs/*openblas*")):
            with contextlib.suppress(OSError):
                library = ctypes.CDLL(str(path))
                for suffix in ("64_", ""):
                    count = getattr(library, f"scipy_openblas_get_num_threads{suffix}", None)
                    put = getattr(library, f"scipy_openblas_set_num_threads{suffix}", None)
                    if count and put:
                        found.append((count, put))
                        break
    return tuple(found)
