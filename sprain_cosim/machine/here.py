"""The system of this machine. Nothing else asks which it is, but for what a file or a picture is made of (the FMU's
library, fonts)."""

from __future__ import annotations

import sys

from .face import OperatingSystem


def _own() -> OperatingSystem:
    if sys.platform == "win32":
        from .windows import Windows

        return Windows()
    from .posix import Posix

    return Posix()


SYSTEM: OperatingSystem = _own()
