"""The process that compiles devices (compile.py): WORK PLATFORM,… FOLDER…"""

import sys
from pathlib import Path

from .compile import compile_all

if __name__ == "__main__":
    compile_all(Path(sys.argv[1]), sys.argv[2].split(","), [Path(p) for p in sys.argv[3:]])
