"""The one place that puts files on disk, whole or not at all, and that reads JSON, TOML and CSV from disk.

Reading raises InputError with one line: the place, the cause, the line where the parser knows it. Writing raises
EnvironmentProblem. A file is written beside its place under a name of its own and takes the place by one rename, so
that a reader, a crash or a second writer never meets half of it; `sweep` removes what killed processes leave."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import secrets
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .errors import EnvironmentProblem, InputError, problems_to_error

LARGEST = 256 << 20  # B of a text that is read at once
LARGEST_CSV = 2 << 30  # B; its rows are read one after the other
ENOUGH = 5  # wrong rows of a table, after which the rest is not read
PARTIAL = re.compile(r"\..*\.[0-9a-f]{8}\.partial(\..*)?")


@contextlib.contextmanager
def whole_file(path: Path, advice: str = "", parents: bool = False) -> Iterator[Path]:
    """A path with the ending of `path` to write a file at; the file takes its place when the block ends well, and is
    removed when the block raises. A device or a pipe is written directly.

    `advice` follows the cause in the message of an EnvironmentProblem ("; continue with --resume"); with `parents`
    missing folders are made. Any OSError of the block is taken for one of writing."""
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial{path.suffix}")
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file() and not path.is_dir():
            yield path
            return
        yield partial
        os.replace(partial, path)
    except OSError as problem:
        raise EnvironmentProblem(f"{path}: cannot be written: {problem.strerror or problem}{advice}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def write(path: Path, content: str | bytes, advice: str = "", parents: bool = False) -> None:
    """A text goes out as UTF-8 with its own line ends. `advice` and `parents` as for `whole_file`."""
    with whole_file(path, advice, parents) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, content: Any, advice: str = "", parents: bool = False) -> None:
    """Indented by two, one line end at the end. Raises ValueError for a number that JSON does not know (NaN)."""
    write(path, json.dumps(content, indent=2, allow_nan=False) + "\n", advice, parents)


def sweep(folder: Path) -> None:
    """Removes what killed processes left half written; for the process that owns the folder."""
    for path in folder.iterdir():
        if is_partial(path):
            with contextlib.suppress(OSError):
                path.unlink()


def is_partial(path: Path) -> bool:
    """Whether the name is that of a file half written."""
    return PARTIAL.fullmatch(path.name) is not None


def read_text(path: Path) -> str:
    """UTF-8, with or without a byte-order mark; not more than LARGEST."""
    try:
        _check_size(path, LARGEST)
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None


def _check_size(path: Path, most: int) -> None:
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path}: {size / 2**20:.0f} MB; at most {most >> 20} MB are accepted")


def read_csv(path: Path) -> Iterator[tuple[int, list[str]]]:
    """(line number in the file, cells without blanks around them) of the header and of each row; blank lines are passed
    over. Raises InputError: no UTF-8 text, other separators than commas, a row with more or fewer cells than the
    header, a header cell that stands twice."""
    try:
        _check_size(path, LARGEST_CSV)
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            header, problems = list[str](), list[str]()
            for cells in reader:
                if not any(cell.strip() for cell in cells):
                    continue
                cells = [cell.strip() for cell in cells]
                if not header:
                    header = cells
                    _check_header(path, header)
                elif len(cells) != len(header):
                    problems.append(f"row {reader.line_num}: {_count(cells, header)}")
                    if len(problems) < ENOUGH:
                        continue
                    break
                yield reader.line_num, cells
            problems_to_error(str(path), problems)
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError, csv.Error) as problem:
        raise InputError(
            f"{path}: cannot be read as a table: {getattr(problem, 'strerror', None) or problem}"
        ) from None
    if not header:
        raise InputError(f"{path}: is empty; needs a header and rows")


def _check_header(path: Path, cells: list[str]) -> None:
    for mark, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if len(cells) == 1 and mark in cells[0]:
            raise InputError(f"{path}: cells are separated by {name}; save it with commas, and points in the numbers")
    for k, cell in enumerate(cells):
        if cell and cell in cells[:k]:
            raise InputError(f"{path}: column {k + 1} {cell!r}: given twice, also as column {cells.index(cell) + 1}")


def _count(cells: list[str], header: list[str]) -> str:
    """What is wrong with a row whose cells are not as many as the header's."""
    text = f"{len(cells)} cells, the header has {len(header)}"
    if len(cells) == 2 * len(header) and all(cell.lstrip("+-").isdigit() for cell in cells):
        return f"{text}; its numbers seem to have decimal commas; write points"
    if len(cells) == 1 and ";" in cells[0]:
        return f"{text}; its cells are separated by semicolons"
    return text


def read_json(path: Path) -> dict[str, Any]:
    """The one object that a JSON file holds."""
    return parse_json(read_text(path), str(path))


def parse_json(text: str, place: str) -> dict[str, Any]:
    """`place` stands before the cause in messages: a file, or a member of an archive."""
    try:
        content = json.loads(text)
    except json.JSONDecodeError as problem:
        where = f"line {problem.lineno}, column {problem.colno}"
        raise InputError(f"{place}: cannot be read: not valid JSON: {problem.msg} (at {where})") from None
    except (ValueError, RecursionError) as problem:  # a number of thousands of digits; thousands of brackets
        raise InputError(f"{place}: cannot be read: {_reason(problem)}") from None
    if not isinstance(content, dict):
        raise InputError(f"{place}: cannot be read: must hold one JSON object")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    return parse_toml(read_text(path), str(path))


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """`place` as for `parse_json`."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as problem:
        raise InputError(f"{place}: not valid TOML: {problem}") from None
    except (ValueError, RecursionError) as problem:
        raise InputError(f"{place}: not valid TOML: {_reason(problem)}") from None


def _reason(problem: Exception) -> str:
    return "brackets nested too deeply" if isinstance(problem, RecursionError) else str(problem)
