"""The command line, which ends in one line also where it is interrupted while it is loaded."""

from __future__ import annotations

import atexit
import gc
import os

gc.set_threshold(20_000, 10, 10)  # most of what is loaded stays: looking for garbage in it takes a tenth of a landing
atexit.register(gc.freeze)  # and looking for it at the end, when all goes anyway, a sixth

try:
    from .cli import main
except KeyboardInterrupt:
    os.write(2, b"error: interrupted\n")
    os._exit(130)

if __name__ == "__main__":
    main()
