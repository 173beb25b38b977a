"""Does a change that should change no number change none? Records every number that the product prints, and compares
two records byte by byte.

    python tools/same_numbers.py record FOLDER [--clone CLONE]
    python tools/same_numbers.py compare BEFORE AFTER

`record` runs the six scenarios, studies 1 to 6 (50 trials each), a comparison and the quick validation with the package
in CLONE (default: this one) and keeps tables, signals and JSON without times, versions and folders. `compare` exits 1
and names every file that differs."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SCENARIOS = ("level", "incline30", "incline30_reflex", "incline30_coactivation", "incline30_brace", "incline30_mixed")
STUDIES = tuple(f"study{k}" for k in range(1, 7))
# what may differ between two runs of the same code, or between two versions of it
FREE = {
    "wall_s",
    "seconds",
    "versions",
    "version",
    "commit",
    "date",
    "started",
    "environment",
    "folder",
    "out",
    "sha256",
    "platform",
    "command",
    "format",
}


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if key not in FREE}
    return [without_times(item) for item in value] if isinstance(value, list) else value


def record(folder: Path, clone: Path) -> None:
    folder.mkdir(parents=True)
    environment = {
        **os.environ,
        "PYTHONPATH": str(clone),
        "SPRAIN_REFERENCE": os.environ.get("SPRAIN_REFERENCE", str(ROOT.parent / "shared/reference")),
    }

    def command(name: str, *arguments: str, accepted: tuple[int, ...] = (0,)) -> None:
        print(name, flush=True)
        done = subprocess.run(
            [sys.executable, "-m", "sprain_cosim", *arguments, "--json"],
            cwd=clone,
            env=environment,
            capture_output=True,
            text=True,
        )
        if done.returncode not in accepted:
            sys.exit(f"{name}: exit code {done.returncode}: {done.stderr}")
        (folder / f"{name}.json").write_text(
            json.dumps(without_times(json.loads(done.stdout)), indent=1, sort_keys=True)
        )

    with tempfile.TemporaryDirectory() as scratch:
        for name in SCENARIOS:
            command(name, "run", name, "--out", f"{scratch}/{name}")
            (folder / f"{name}.signals.csv").write_bytes(Path(scratch, name, "signals.csv").read_bytes())
        for name in STUDIES:
            command(name, "study", name, "--trials", "50", "--progress", "none", "--out", f"{scratch}/{name}")
            (folder / f"{name}.trials.csv").write_bytes(Path(scratch, name, "trials.csv").read_bytes())
        command("amv6", "study", "amv6", "--progress", "none", "--out", f"{scratch}/amv6")
        braces = ("--brace", "paper=brace_bushing", "--brace", "rigid=brace_semi_rigid", "--progress", "none")
        command("compare", "compare", "incline30", *braces, "--out", f"{scratch}/compare")
        command("compare_study", "compare", "study6", *braces, "--trials", "20", "--out", f"{scratch}/compare_study")
        command("check", "check", str(clone / "sprain_cosim/_fmus/brace_bushing.fmu"))
        command("validate", "validate", "--quick", "--out", f"{scratch}/validate")


def compare(before: Path, after: Path) -> int:
    names = sorted({p.name for folder in (before, after) for p in folder.iterdir()})
    different = [
        n
        for n in names
        if not (before / n).is_file()
        or not (after / n).is_file()
        or (before / n).read_bytes() != (after / n).read_bytes()
    ]
    for name in different:
        print(f"differs: {name}")
    print(f"{len(names) - len(different)} of {len(names)} files are equal to the byte")
    return 1 if different else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    actions = parser.add_subparsers(dest="action", required=True)
    recording = actions.add_parser("record")
    recording.add_argument("folder", type=Path)
    recording.add_argument("--clone", type=Path, default=ROOT)
    comparing = actions.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    chosen = parser.parse_args()
    if chosen.action == "compare":
        return compare(chosen.before, chosen.after)
    record(chosen.folder, chosen.clone.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
