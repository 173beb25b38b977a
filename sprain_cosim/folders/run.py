"""The folder that `run --out` leaves: signals.csv, landing.png, summary.json. The summary is written last: without it
the folder is not complete."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__, files
from ..cosim.result import Result
from ..errors import EnvironmentProblem, InputError
from ..scenario import Scenario

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
        "held": {
            name: {
                "period_s": held.period,
                "largest_change_Nm": held.largest_change,
                "share": held.share,
                "axis": held.axis,
            }
            for name, held in result.held.items()
        },
        "exchanges": result.exchanges,
        "smallest_step_s": result.smallest_step,
        "fmus": {name: path.name for name, path in scenario.fmus.items()},
        "sha256": {component.name: component.sha256 for component in scenario.components()},
        "version": __version__,
        "parameters": dict(scenario.parameters),
        "dropped": list(scenario.dropped),
    }


def check(folder: Path) -> None:
    """Raises InputError when the folder holds something else than an earlier run."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder")
    if folder.is_dir():
        strangers = sorted(
            p.name
            for p in folder.iterdir()
            if p.name not in (*FILES, "figures", "report.html") and p.stem != "animation" and not files.is_partial(p)
        )
        if strangers:
            raise InputError(f"{folder}: holds other files ({', '.join(strangers[:3])}); name a new folder")


def write(folder: Path, result: Result, picture: bytes, summary: dict[str, Any]) -> None:
    """Replaces an earlier run; `picture` is the content of landing.png. Raises EnvironmentProblem when the folder
    cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files.sweep(folder)
        (folder / "summary.json").unlink(missing_ok=True)
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    files.write(folder / "signals.csv", result.csv())
    files.write(folder / "landing.png", picture)
    files.write_json(folder / "summary.json", summary)


def read(folder: Path) -> tuple[dict[str, Any], Result]:
    """Raises InputError when the folder holds no complete run."""
    if folder.is_dir() and not (folder / "summary.json").exists():
        raise InputError(f"{folder}: no complete run in it; make one with `sprain-cosim run SCENARIO --out {folder}`")
    head = files.read_json(folder / "summary.json")
    missing = [key for key in ("status", "message", "scheme", "title") if key not in head]
    if missing:
        raise InputError(f"{folder}: not a folder of `sprain-cosim run`: summary.json lacks {missing[0]}")
    record = Result.read_csv(folder / "signals.csv")
    return head, replace(record, status=head["status"], message=head["message"], scheme=head["scheme"])


def note(heads: Sequence[Mapping[str, Any]]) -> str:
    """What stands below a figure: initial pose and coupling."""

    def all_of(texts: list[str]) -> str:
        return " and ".join(dict.fromkeys(texts))

    pose = all_of([head["initial_pose"] for head in heads if head.get("initial_pose")])
    steps = all_of([f"{1e3 * head['communication_step_s']:g}" for head in heads])
    coupling = f"{all_of([head['scheme'] for head in heads])} coupling every {steps} ms"
    return f"{f'Initial pose: {pose}; ' if pose else ''}{coupling}."
