"""Builds every model folder of fmus/ into sprain_cosim/_fmus/. Run: python tools/build_fmus.py [name ...]"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from sprain_cosim.export import build_fmu  # noqa: E402


def build(names: list[str]) -> None:
    folders = sorted(p.parent for p in (ROOT / "fmus").glob("*/interface.py"))
    for folder in folders:
        if not names or folder.name in names:
            target = ROOT / "sprain_cosim" / "_fmus" / f"{folder.name}.fmu"
            guid = build_fmu(folder, target)
            print(f"{target.relative_to(ROOT)}  {guid[:12]}")


if __name__ == "__main__":
    build(sys.argv[1:])
