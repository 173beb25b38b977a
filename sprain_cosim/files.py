"""The one place that puts files on disk, whole or not at all, and that reads JSON, TOML and CSV from disk.

Reading raises InputError with one line: the place, the cause, the line where the parser knows it. Sizes, lengths of
lines and depths are checked before anything is read whole, so that no file takes the memory or the time of this
machine. Writing raises EnvironmentProblem. A file is written beside its place under a name of its own and takes the
place by one rename, so that a reader, a crash or a second writer never meets half of it; `sweep` removes what killed
processes leave."""

from __future__ import annotations

import contextlib
import csv
import gzip
import io
import json
import math
import os
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from .errors import EnvironmentProblem, InputError, problems_to_error
from .machine.here import SYSTEM

if TYPE_CHECKING:
    import pandas as pd

LARGEST = 2 << 20  # B of a text that people write
LARGEST_JSON = 64 << 20  # B
LARGEST_CSV = 2 << 30  # B; its rows are read one after the other
LARGEST_TABLE = 8 << 30  # B of a table that programs wrote
LARGEST_RECORD = 256 << 20  # B of the signals of one landing, unpacked
LONGEST_LINE = 1 << 20  # B of a table
DEEPEST = 64  # parts of a dotted key
DOTTED = re.compile(r"(?:\.[^.,=\[\]{}#\n]*+)++")
INSIDE = 80  # characters of the longest path in a folder of ours, while the file is written
ENOUGH = 5  # wrong rows of a table, after which the rest is not read
PARTIAL = re.compile(r"\..*\.[0-9a-f]{8}\.partial(\..*)?")


def check_path(path: Path) -> None:
    """Raises InputError for a path that no file of this system can have."""
    if why := SYSTEM.refusal(path):
        raise InputError(f"{path}: {why}")


def check_file(path: Path, sources: Iterable[Path | None] = (), beside: Collection[str] = ()) -> None:
    """The same for a file that is to be written; for one that it is made of; and for one that would be replaced by what
    is written beside it, under the same name with one of these endings."""
    check_path(path)
    if not path.name or path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    for source in sources:
        if source is not None and source.exists() and path.exists() and path.samefile(source):
            raise InputError(f"{path}: is what it would be made of; name another file")
    if path.suffix in beside:
        raise InputError(f"{path}: the {path.suffix} of that name is written beside it; choose another ending")


def is_missing(path: Path) -> str:
    """Why a path is no folder, in words; empty for one that is there."""
    if why := SYSTEM.refusal(path):
        return why
    with contextlib.suppress(OSError):  # a name that none can have
        if path.exists():
            return "" if path.is_dir() else "is a file; name a folder"
    return "no such folder"


def check_folder(path: Path) -> None:
    """The same for a folder that files are to be put into, and where a file is in its place."""
    if why := SYSTEM.refusal(path, inside=INSIDE):
        raise InputError(f"{path}: {why}")
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file; name a folder")


@contextlib.contextmanager
def whole_file(path: Path, advice: str = "", parents: bool = False) -> Iterator[Path]:
    """A path with the ending of `path` to write a file at; the file takes its place when the block ends well, and is
    removed when the block raises. A device or a pipe is written directly.

    `advice` follows the cause in the message of an EnvironmentProblem ("; continue with --resume"); with `parents`
    missing folders are made. Any OSError of the block is taken for one of writing."""
    partial = path.with_name(f".{path.stem}.{os.urandom(4).hex()}.partial{path.suffix}")
    check_path(path)
    check_path(partial)
    partial = partial.absolute()  # pandas takes a leading ~ for somebody's home
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file() and not path.is_dir():
            yield path
            return
        yield partial
        SYSTEM.rename(partial, path)
    except FileExistsError as problem:  # in the place of a folder
        raise EnvironmentProblem(f"{path}: cannot be written: {problem.filename} is a file{advice}") from None
    except OSError as problem:
        raise EnvironmentProblem(f"{path}: cannot be written: {problem.strerror or problem}{advice}") from None
    finally:
        with contextlib.suppress(OSError):
            SYSTEM.remove(partial)


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
                SYSTEM.remove(path)


def is_partial(path: Path) -> bool:
    """Whether the name is that of a file half written."""
    return PARTIAL.fullmatch(path.name) is not None


def read_text(path: Path, most: int = LARGEST) -> str:
    """UTF-8, with or without a byte-order mark; not more than `most` bytes."""
    try:
        _check_size(path, most)
        with path.open("rb") as file:
            content = file.read(most + 1)  # a device or a pipe has no size
        if len(content) > most:
            raise InputError(f"{path}: more than {_megabytes(most)} are not accepted")
        return io.TextIOWrapper(io.BytesIO(content), "utf-8-sig").read()
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None


def _check_size(path: Path, most: int) -> None:
    check_path(path)
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path}: {_megabytes(size)}; at most {_megabytes(most)} are accepted")


def _megabytes(size: int) -> str:
    return f"{size / 2**20:.0f} MB" if size >= 10 << 20 else f"{size / 2**20:.1f} MB"


def read_csv(path: Path) -> Iterator[tuple[int, list[str]]]:
    """(line number in the file, cells without blanks around them) of the header and of each row; blank lines are passed
    over. Raises InputError: no UTF-8 text, other separators than commas, a row with more or fewer cells than the
    header, a header cell that stands twice."""
    try:
        _check_size(path, LARGEST_CSV)
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield from parse_csv(_lines(file), str(path))
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as problem:
        raise InputError(
            f"{path}: cannot be read as a table: {getattr(problem, 'strerror', None) or problem}"
        ) from None


def parse_csv(lines: Iterable[str], place: str) -> Iterator[tuple[int, list[str]]]:
    """The same of `lines` with their ends; `place` as for `parse_json`."""
    reader = csv.reader(lines)
    header, problems = list[str](), list[str]()
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            cells = [cell.strip() for cell in cells]
            if not header:
                header = cells
                _check_header(place, header)
            elif len(cells) != len(header):
                problems.append(f"row {reader.line_num}: {_count(cells, header)}")
                if len(problems) < ENOUGH:
                    continue
                break
            yield reader.line_num, cells
    except csv.Error as problem:
        raise InputError(f"{place}: cannot be read as a table: {problem}") from None
    problems_to_error(place, problems)
    if not header:
        raise InputError(f"{place}: is empty; needs a header and rows")


def _lines(file: IO[str]) -> Iterator[str]:
    """The lines of a text. Raises ValueError at one that is too long, before it is read whole."""
    while line := file.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line is longer than {_megabytes(LONGEST_LINE)}")
        yield line


def read_frame(source: Path | IO[bytes], most: int = LARGEST_TABLE, **options: Any) -> pd.DataFrame:
    """A table that a program wrote, also gzipped (.gz); `options` are those of pandas.read_csv. Raises InputError,
    FileNotFoundError where there is no such file."""
    import pandas as pd

    place = source if isinstance(source, Path) else "the table"
    try:
        if isinstance(source, Path) and source.suffix == ".gz":
            source = io.BytesIO(_unpacked(source, most))
        elif isinstance(source, Path):
            _check_size(source, most)
            with source.open("rb") as file:
                _check_lines(file)
            source = source.absolute()  # pandas takes a leading ~ for somebody's home
        return pd.read_csv(source, **options)
    except FileNotFoundError:
        raise
    except (ValueError, EOFError, OSError) as problem:
        raise InputError(f"{place}: cannot be read: {_first_line(problem)}") from None


def _unpacked(path: Path, most: int) -> bytes:
    _check_size(path, most)
    with gzip.open(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"unpacked it has more than {_megabytes(most)}")
    _check_lines(io.BytesIO(content))
    return content


def _check_lines(file: IO[bytes]) -> None:
    """Raises ValueError for lines without end and for bytes that no text has. Twenty times as fast as reading the
    table."""
    while block := file.read(LONGEST_LINE):
        if b"\0" in block:
            raise ValueError("holds zero bytes")
        if len(block) == LONGEST_LINE and b"\n" not in block:
            raise ValueError(f"a line is longer than {_megabytes(LONGEST_LINE)}")


def _first_line(problem: Exception) -> str:
    text = getattr(problem, "strerror", None) or str(problem)
    return text.strip().partition("\n")[0][:300] or type(problem).__name__


def _check_header(place: str, cells: list[str]) -> None:
    for mark, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if len(cells) == 1 and mark in cells[0]:
            raise InputError(f"{place}: cells are separated by {name}; save it with commas, and points in the numbers")
    for k, cell in enumerate(cells):
        if cell and cell in cells[:k]:
            raise InputError(f"{place}: column {k + 1} {cell!r}: given twice, also as column {cells.index(cell) + 1}")


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
    return parse_json(read_text(path, LARGEST_JSON), str(path))


def parse_json(text: str, place: str) -> dict[str, Any]:
    """`place` stands before the cause in messages: a file, or a member of an archive."""
    try:
        content = json.loads(text, parse_float=_finite, parse_constant=_finite)
    except json.JSONDecodeError as problem:
        where = f"line {problem.lineno}, column {problem.colno}"
        raise InputError(f"{place}: cannot be read: not valid JSON: {problem.msg} (at {where})") from None
    except (ValueError, RecursionError) as problem:  # a number of thousands of digits; thousands of brackets
        raise InputError(f"{place}: cannot be read: {_reason(problem)}") from None
    if not isinstance(content, dict):
        raise InputError(f"{place}: cannot be read: must hold one JSON object")
    return content


def _finite(text: str) -> float:
    """JSON has no other numbers."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is no number that JSON has")
    return number


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    return parse_toml(read_text(path), str(path))


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """`place` as for `parse_json`."""
    try:
        if any(run[0].count(".") >= DEEPEST for run in DOTTED.finditer(text)):  # time and memory grow by the square
            raise ValueError(f"a key has more than {DEEPEST} parts")
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as problem:
        raise InputError(f"{place}: not valid TOML: {problem}{_backslash(text, str(problem))}") from None
    except (ValueError, RecursionError) as problem:
        raise InputError(f"{place}: not valid TOML: {_reason(problem)}") from None


def _backslash(text: str, problem: str) -> str:
    """What to do where a path was written as Windows has it."""
    found = re.search(r"at line (\d+)", problem)
    line = text.splitlines()[int(found[1]) - 1] if found else ""
    return "; write a path of Windows with / , or between single quotes" if re.search(r'"[^"]*\\', line) else ""


def _reason(problem: Exception) -> str:
    return "brackets nested too deeply" if isinstance(problem, RecursionError) else str(problem)
