"""The floating-point environment: rounding mode, flushing of tiny numbers, traps. Foreign code may change it, in a call
or by being loaded (libraries built with -ffast-math flush tiny numbers from then on); what comes after must not
notice."""

from __future__ import annotations

import ctypes
from typing import Any

SIZE = 64  # B, more than any platform's fenv_t
ONE, LITTLE, MORE = 1.0, 2.0**-53, 1.5 * 2.0**-53  # half and three quarters of the last place of ONE
NEXT = ONE + 2.0**-52
TINY, HALF = 2.0**-1022, 0.5


def _functions() -> tuple[Any, Any] | None:
    """fegetenv and fesetenv, called without letting other threads in; None where the platform has none."""
    for library in (None, "libm.so.6", "ucrtbase"):
        try:
            found = ctypes.PyDLL(library)
            return found.fegetenv, found.fesetenv
        except (OSError, AttributeError, TypeError):
            continue
    return None


_found = _functions()


class FloatingPoint:
    """The environment as it was when this was made."""

    def __init__(self) -> None:
        self._saved = ctypes.create_string_buffer(SIZE)
        if _found is not None:
            _found[0](self._saved)

    def restore(self) -> None:
        """All of it, whatever it is now."""
        if _found is not None:
            _found[1](self._saved)

    def restore_if_changed(self) -> None:
        """Six times as fast where nothing changed: rounding and tiny numbers are tried out. A trap goes off at that."""
        if ONE + LITTLE != ONE or ONE + MORE != NEXT or TINY * HALF == 0.0:
            self.restore()


def is_usual() -> bool:
    """Rounding to nearest, and tiny numbers kept."""
    return ONE + LITTLE == ONE and ONE + MORE == NEXT and TINY * HALF != 0.0
