"""The processes that compile devices (compile.py): TASK WORK ARGUMENT…"""

import sys
from pathlib import Path

from .compile import run_task

if __name__ == "__main__":
    run_task(sys.argv[1], Path(sys.argv[2]), *sys.argv[3:])
