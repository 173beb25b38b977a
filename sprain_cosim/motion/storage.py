"""OpenSim's storage files (.mot, .sto) as tables: a header up to `endheader`, labels, rows of numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, problems_to_error
from ..files import read_text

LARGEST = 256 << 20  # B
DECLARED = re.compile(r"\s*(\w+)\s*=\s*(.*?)\s*$")
SIMM = re.compile(r"\s*(datarows|datacolumns)\s+(\d+)\s*$", re.IGNORECASE)
ENOUGH = 3  # problems named of a file
GAP = 2.5  # times the median distance of rows, that is worth a word


@dataclass(frozen=True)
class StorageTable:
    """A storage file.

    - path
    - time: (n,) [s], rising
    - columns: {label: (n,)} as they stand in the file; cells that hold no number are NaN
    - lines: (n,) line of the file of each row
    - in_degrees: what the header says of angles; None: nothing
    - notes: what a reader must know of the file
    """

    path: Path
    time: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    lines: tuple[int, ...]
    in_degrees: bool | None
    notes: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Rows per second; 0 for a single row."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0]) if len(self.time) > 1 else 0.0


def read_storage(path: Path) -> StorageTable:
    """Raises InputError with the line at fault."""
    lines = read_text(path, LARGEST).splitlines()
    end = next((k for k, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise InputError(f"{path}: has no line `endheader`; a storage file of OpenSim (.mot, .sto) is needed")
    head = {found[1].lower(): found[2] for line in lines[:end] if (found := DECLARED.match(line))}
    head |= {found[1].lower(): found[2] for line in lines[:end] if (found := SIMM.match(line))}
    start = next((k for k in range(end + 1, len(lines)) if lines[k].strip()), None)
    labels = lines[start].split() if start is not None else []
    if start is None or labels[0].lower() != "time":
        raise InputError(f"{path}: after `endheader` a line of column labels must come that begins with `time`")
    _check_labels(path, labels)
    last = max((k for k in range(start, len(lines)) if lines[k].strip()), default=start)
    rows, places = _rows(path, lines, range(start + 1, last + 1), len(labels))
    if not rows:
        raise InputError(f"{path}: has column labels and no rows of numbers")
    table = np.array(rows)
    _check_time(path, table[:, 0], places)
    stated = head.get("nrows", head.get("datarows", str(len(rows))))
    notes = [] if stated == str(len(rows)) else [f"the header announces {stated} rows, the file has {len(rows)}"]
    notes += _gaps(table[:, 0])
    return StorageTable(
        path,
        table[:, 0],
        {label: table[:, k] for k, label in enumerate(labels) if k},
        tuple(places),
        _in_degrees(path, head.get("indegrees")),
        tuple(notes),
    )


def _check_labels(path: Path, labels: list[str]) -> None:
    twice = [label for k, label in enumerate(labels) if label in labels[:k]]
    problems_to_error(str(path), [f"column {label} is given twice; leave one out" for label in twice[:ENOUGH]])


def _rows(path: Path, lines: list[str], places: range, width: int) -> tuple[list[list[float]], list[int]]:
    """The numbers of the rows, and the line of each, counted from 1."""
    rows, at = list[list[float]](), list[int]()
    problems: list[str] = []
    for k in places:
        cells = lines[k].split()
        if len(cells) != width:
            problems.append(
                f"line {k + 1} is empty; delete it"
                if not cells
                else f"line {k + 1} has {len(cells)} cells, the labels are {width}"
            )
        else:
            rows.append([_number(cell) for cell in cells])
            at.append(k + 1)
        if len(problems) == ENOUGH:
            break
    problems_to_error(str(path), problems)
    return rows, at


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _check_time(path: Path, time: NDArray[np.float64], lines: list[int]) -> None:
    for k, value in enumerate(time):
        if not np.isfinite(value):
            raise InputError(f"{path}: line {lines[k]}: its time is no number")
        if k and value <= time[k - 1]:
            raise InputError(f"{path}: line {lines[k]}: time {value:g} s does not rise (before it {time[k - 1]:g} s)")


def _gaps(time: NDArray[np.float64]) -> list[str]:
    """Where rows are missing, or far apart: the course between them is not known."""
    if len(time) < ENOUGH:
        return []
    apart = np.diff(time)
    usual, k = float(np.median(apart)), int(np.argmax(apart))
    if apart[k] < GAP * usual:
        return []
    return [
        f"rows are not evenly spaced: {1e3 * usual:.3g} ms apart in the middle, {1e3 * apart[k]:.3g} ms from "
        f"{time[k]:.6g} s on; what lies between is interpolated"
    ]


def _in_degrees(path: Path, text: str | None) -> bool | None:
    if text is None:
        return None
    if text.lower() not in ("yes", "no"):
        raise InputError(f"{path}: inDegrees={text}: must be yes or no")
    return text.lower() == "yes"
