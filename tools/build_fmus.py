"""Builds every model folder of fmus/ into sprain_cosim/_fmus/. Run: python tools/build_fmus.py [name ...]"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.fmu.build import build_all

if __name__ == "__main__":
    for target, guid in build_all(sys.argv[1:]):
        print(f"{target}  {guid[:12]}")
