"""The folder that `run --out` leaves: signals.csv, landing.png, summary.json. The summary is written last: without it the folder is not complete."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from . import __version__
from .errors import EnvironmentProblem, InputError
from .result import Result
from .scenario import Scenario
from .units import Unit

FILES = ("signals.csv", "landing.png", "summary.json")


def summary(scenario: Scenario, result: Result) -> dict[str, Any]:
    """What `run --json` prints."""
    return {
        "status": result.status,
        "message": result.message,
        "wall_s": round(result.wall, 6),
        "initial_pose": scenario.initial_pose(),
        "coupling_error": result.coupling_error,
        "metrics": result.metrics,
        "scenario": scenario.source,
        "title": scenario.title,
        "scheme": result.scheme,
        "scheme_reason": result.scheme_reason,
        "warning": result.warning,
        "communication_step_s": scenario.master.communication_step,
        "exchanges": result.exchanges,
        "smallest_step_s": result.smallest_step,
        "fmus": {name: path.name for name, path in scenario.fmus.items()},
        "sha256": {component.name: component.sha256 for component in scenario.system().components},
        "version": __version__,
        "parameters": dict(scenario.parameters),
        "dropped": list(scenario.dropped),
    }


def check(folder: Path) -> None:
    """Raises InputError when the folder holds something else than an earlier run."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder")
    if folder.is_dir():
        strangers = sorted(p.name for p in folder.iterdir() if p.name not in (*FILES, "figures", "report.html") and p.stem != "animation")
        if strangers:
            raise InputError(f"{folder}: holds other files ({', '.join(strangers[:3])}); name a new folder")


def write(folder: Path, scenario: Scenario, result: Result, summary: dict[str, Any]) -> None:
    """Replaces an earlier run. Raises EnvironmentProblem when the folder cannot be written."""
    from . import plots

    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.json").unlink(missing_ok=True)
        _replace(folder / "signals.csv", result.csv().encode())
        _replace(folder / "landing.png", plots.picture(plots.landing([(scenario.title, result)], note([summary])), "png"))
        _replace(folder / "summary.json", (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode())
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None


def read(folder: Path) -> tuple[dict[str, Any], Result]:
    """Raises InputError when the folder holds no complete run."""
    try:
        head = json.loads((folder / "summary.json").read_text("utf-8"))
    except FileNotFoundError:
        raise InputError(f"{folder}: no complete run in it; make one with `sprain-cosim run SCENARIO --out {folder}`") from None
    except (ValueError, OSError) as problem:
        raise InputError(f"{folder}: cannot be read: {problem}") from None
    missing = [key for key in ("status", "message", "scheme", "title") if not isinstance(head, dict) or key not in head]
    if missing:
        raise InputError(f"{folder}: not a folder of `sprain-cosim run`: summary.json lacks {missing[0]}")
    record = signals(folder / "signals.csv")
    return head, replace(record, status=head["status"], message=head["message"], scheme=head["scheme"])


def signals(source: Path | IO[bytes]) -> Result:
    """The record of a signals.csv, also of one of a study's trajectories (csv.gz). Raises InputError when it is none."""
    import pandas as pd

    try:
        table = pd.read_csv(source, index_col=0)
        names, units = zip(*(str(c).removesuffix("]").rsplit(" [", 1) for c in table.columns), strict=True)
        time, values = table.index.to_numpy(float), table.to_numpy(float)
    except FileNotFoundError:
        raise InputError(f"{source}: no such file; make the run again with --out") from None
    except (ValueError, EOFError, OSError) as problem:
        raise InputError(f"{source}: cannot be read: {problem}") from None
    known = tuple(None if u == "?" else Unit(u) for u in units)
    return Result(time=time, values=values, names=names, units=known, status="completed", message="", scheme="")


def note(heads: Sequence[dict[str, Any]]) -> str:
    """What stands below a figure: initial pose and coupling."""

    def all_of(texts: list[str]) -> str:
        return " and ".join(dict.fromkeys(texts))

    pose = all_of([head["initial_pose"] for head in heads if head.get("initial_pose")])
    steps = all_of([f"{1e3 * head['communication_step_s']:g}" for head in heads])
    coupling = f"{all_of([head['scheme'] for head in heads])} coupling every {steps} ms"
    return f"{f'Initial pose: {pose}; ' if pose else ''}{coupling}."


def _replace(path: Path, data: bytes) -> None:
    partial = path.with_name(f".{path.name}")
    partial.write_bytes(data)
    os.replace(partial, path)
