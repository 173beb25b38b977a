"""The command line, which ends in one line also where it is interrupted while it is loaded."""

from __future__ import annotations

import os

try:
    from .cli import main
except KeyboardInterrupt:
    os.write(2, b"error: interrupted\n")
    os._exit(130)

if __name__ == "__main__":
    main()
