"""Old and new side by side: this version and the last one whose FMUs were Python, both built from this clone's history.

    make bench, or python tools/bench_versions.py [--rounds 3] [--trials 100 300]

Every measurement runs in turn with the old and the new version, each in processes of its own; the least of the rounds
is printed. Processor time, user and system, of a process and of all that it started; times on the wall where it says
so."""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
OLD = "cea88b8"  # the last commit before the first FMUs are native
NEEDED = {"numba": "numba", "mujoco": "mujoco-core", "pythonfmu": "pythonfmu"}  # module: package, of the old version
TASK = Path(__file__).with_name("bench_task.py")
STUDY = 1000  # trials that the time of a study is stated for
OPENSIM = 6.3  # s per landing, median, OpenSim 4.6 on the same class of machine
NOT_BUILT = "the old version cannot be built here"


class NotBuilt(Exception):
    pass


@dataclass(frozen=True)
class Version:
    """A package at `root`, run by `python`."""

    root: Path
    python: Path

    @property
    def environment(self) -> dict[str, str]:
        caches = self.root / "build" / "bench-cache"
        return os.environ | {
            "PYTHONPATH": str(self.root),
            "SPRAIN_COSIM_CACHE": str(caches / "fmus"),
            "NUMBA_CACHE_DIR": str(caches / "numba"),
            "OPENBLAS_NUM_THREADS": "1",
        }

    def task(self, *arguments: object) -> dict[str, Any]:
        text = self._run([TASK, *arguments])
        found: dict[str, Any] = json.loads(text.splitlines()[-1])
        return found

    def command(self, *arguments: object) -> tuple[float, float]:
        """Processor time and wall time [s] of a command of the package."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        self._run(["-m", "sprain_cosim", *arguments])
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall

    def _run(self, arguments: list[object]) -> str:
        ran = subprocess.run(
            [self.python, *map(str, arguments)],
            capture_output=True,
            text=True,
            env=self.environment,
            cwd=self.root,
            check=False,
        )
        if ran.returncode:
            raise NotBuilt(f"{arguments[0]}: {(ran.stderr.strip().splitlines() or ['?'])[-1]}")
        return ran.stdout


def old_version() -> Version:
    """Raises NotBuilt."""
    folder = ROOT / "build" / "bench" / OLD
    if not (folder / "pyproject.toml").is_file():
        archive = subprocess.run(["git", "-C", ROOT, "archive", OLD], capture_output=True, check=False)
        if archive.returncode:
            raise NotBuilt(f"this clone has no commit {OLD} (git fetch --unshallow)")
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as content:
            content.extractall(folder, filter="data")
    version = Version(folder, _python_for(folder))
    version.command("build")
    return version


def _python_for(folder: Path) -> Path:
    """This one where it has what the old version needs, else one of its own."""
    probe = f"import {', '.join(NEEDED)}"
    if not subprocess.run([sys.executable, "-c", probe], capture_output=True, check=False).returncode:
        return Path(sys.executable)
    own = folder / "build" / "venv"
    python = own / "bin" / "python"
    if not (own / "complete").is_file():
        needs = tomllib.loads((folder / "pyproject.toml").read_text())["project"]["dependencies"]
        for command in (
            [sys.executable, "-m", "venv", own],
            [python, "-m", "pip", "install", "--quiet", *needs],
        ):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise NotBuilt(f"its requirements: {(done.stderr.strip().splitlines() or ['?'])[-1]}")
        (own / "complete").touch()
    return python


def study_costs(version: Version, trials: tuple[int, int]) -> dict[str, float]:
    """Processor time [s] of STUDY trials of study 6 on two workers, and of each beyond the first."""
    few, many = trials
    found = []
    for count in trials:
        with tempfile.TemporaryDirectory() as out:
            options = ("--trials", count, "--workers", 2, "--progress", "none", "--out", f"{out}/study")
            found.append(version.command("study", "study6", *options)[0])
    each = (found[1] - found[0]) / (many - few)
    return {"study": found[1] + (STUDY - many) * each, "each": each}


def measured(version: Version, trials: tuple[int, int], repeat: int) -> dict[str, float]:
    """One round."""
    direct, braced = version.task("runs", "incline30", repeat), version.task("runs", "incline30_brace", repeat)
    processor, wall = version.command("run", "incline30")
    bare, landed = version.task("memory")["bytes"], version.task("memory", "incline30")["bytes"]
    start = version.task("worker")
    return {
        "direct": direct["run"],
        "braced": braced["run"],
        "direct_session": direct["session"],
        "braced_session": braced["session"],
        "peak": direct["peak"],
        "command": processor,
        "command_wall": wall,
        "first_worker": start["first"],
        "worker": start["next"],
        "memory": landed - bare,
        **study_costs(version, trials),
    }


def least(rounds: list[dict[str, float]]) -> dict[str, float]:
    return {key: min(found[key] for found in rounds) for key in rounds[0]}


ROWS: tuple[tuple[str, Callable[[Mapping[str, float]], float], str, str], ...] = (
    ("scenario.run(), no brace", lambda v: 1e3 * v["direct"], "ms", "2.7"),
    ("scenario.run(), with a brace", lambda v: 1e3 * v["braced"], "ms", "3"),
    ("  a landing of an open session, no brace", lambda v: 1e3 * v["direct_session"], "ms", ""),
    ("  a landing of an open session, with a brace", lambda v: 1e3 * v["braced_session"], "ms", ""),
    (f"{STUDY} trials of study 6, two workers (extrapolated)", lambda v: v["study"], "s", "2.3"),
    ("  each trial beyond the first hundred", lambda v: 1e3 * v["each"], "ms", ""),
    ("10^6 landings with the ledger, on two cores (extrapolated)", lambda v: 1e6 * v["each"] / 2 / 3600, "h", ""),
    ("sprain-cosim run incline30", lambda v: v["command"], "s", ""),
    ("  on the wall", lambda v: v["command_wall"], "s", ""),
    ("a worker with its first landing, on the wall", lambda v: v["first_worker"], "s", ""),
    ("  the next worker", lambda v: v["worker"], "s", ""),
    ("memory of a process with a landing, beyond Python's", lambda v: v["memory"] / 2**20, "MB", ""),
    ("OpenSim 4.6 (6.3 s) over a landing, no brace", lambda v: OPENSIM / v["direct_session"], "", ""),
)


def table(old: Mapping[str, float] | None, new: Mapping[str, float]) -> str:
    lines = ["| | old | new | old / new | bound |", "|---|---|---|---|---|"]
    for label, value, unit, bound in ROWS:
        now = value(new)
        before = value(old) if old else None
        ratio = "" if before is None or not unit else f"{before / now:.2f}"
        shown = "–" if before is None else f"{before:.3g} {unit}".strip()
        missed = "" if not bound or not ratio or float(ratio) >= float(bound) else ", missed"
        lines.append(f"| {label} | {shown} | {f'{now:.3g} {unit}'.strip()} | {ratio} | {bound}{missed} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--repeat", type=int, default=15, help="runs of which the least counts, in each round")
    parser.add_argument("--trials", type=int, nargs=2, default=(100, 300), metavar=("FEW", "MANY"))
    chosen = parser.parse_args()
    new = Version(ROOT, Path(sys.executable))
    versions = {"new": new}
    try:
        versions = {"old": old_version(), "new": new}
    except NotBuilt as problem:
        print(f"{NOT_BUILT}: {problem}")
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in versions}
    for number in range(chosen.rounds):
        for name, version in versions.items():
            print(f"round {number + 1} of {chosen.rounds}: {name} version ...", file=sys.stderr)
            rounds[name].append(measured(version, tuple(chosen.trials), chosen.repeat))
    found = {name: least(several) for name, several in rounds.items()}
    few, many = chosen.trials
    print(
        f"{date.today()}, {os.cpu_count()} cores; least of {chosen.rounds} rounds in turn; studies of {few} and {many} "
        f"trials, from which {STUDY} are extrapolated\n"
    )
    print(table(found.get("old"), found["new"]))
    if "old" in found:
        print(f"\npeak of incline30: {found['old']['peak']:.6f} deg old, {found['new']['peak']:.6f} deg new")


if __name__ == "__main__":
    main()
