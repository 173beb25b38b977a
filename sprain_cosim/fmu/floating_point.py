"""The floating-point environment: rounding mode, flushing of tiny numbers, traps. Foreign code may change it, in a call
or by being loaded (libraries built with -ffast-math flush tiny numbers from then on); what comes after must not
notice."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

SIZE = 64  # B, more than any platform's fenv_t
ONE, LITTLE, MORE = 1.0, 2.0**-53, 1.5 * 2.0**-53  # half and three quarters of the last place of ONE
NEXT = ONE + 2.0**-52
TINY, HALF = 2.0**-1022, 0.5


def _library() -> Any:
    """Called without letting other threads in; None where the platform has none."""
    for name in (None, "libm.so.6", "ucrtbase"):
        try:
            found = ctypes.PyDLL(name)
            _ = found.fegetenv, found.fesetenv, found.fegetround
            return found
        except (OSError, AttributeError, TypeError):
            continue
    return None


_libm = _library()


class FloatingPoint:
    """The environment as it was when this was made. While `watched`, what was found changed is `noticed`: rounding,
    traps."""

    watched: ClassVar[bool] = False
    noticed: ClassVar[set[str]] = set()

    def __init__(self) -> None:
        self._saved = ctypes.create_string_buffer(SIZE)
        if _libm is not None:
            _libm.fegetenv(self._saved)

    @property
    def address(self) -> int:
        """Of the fenv_t that is put back."""
        return ctypes.addressof(self._saved)

    def restore(self) -> None:
        """All of it, whatever it is now."""
        if _libm is None:
            return
        if self.watched:
            self._notice()
        _libm.fesetenv(self._saved)

    def _notice(self) -> None:
        """By functions that no trap hinders."""
        if _libm.fegetround():  # 0 is to nearest
            self.noticed.add("rounding mode")
        if hasattr(_libm, "fegetexcept") and _libm.fegetexcept():
            self.noticed.add("traps of arithmetic")

    def restore_if_changed(self) -> None:
        """Six times as fast where nothing changed: rounding and tiny numbers are tried out. A trap goes off at that."""
        if ONE + LITTLE != ONE or ONE + MORE != NEXT or TINY * HALF == 0.0:
            self.restore()


def is_usual() -> bool:
    """Rounding to nearest, and tiny numbers kept."""
    return ONE + LITTLE == ONE and ONE + MORE == NEXT and TINY * HALF != 0.0
