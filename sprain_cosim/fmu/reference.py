"""Reference experiments that an FMU carries: what went in where it was made, and what came out there.

FMI-LS-REF 1.0.0-beta.1 (github.com/modelica/fmi-ls-ref, July 2026) says where the files lie and what they are for;
their form is MA-HS-Experiments (github.com/modelica/ma-hs-experiments), still a draft:

    extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml   <fmiReferences> of <Related type= source= role=>
    SOURCE of role experiment[/smoke-test|/validation]      <Experiments> of <Experiment name= tolerance=>
        <TransientSimulation startTime= stopTime= stepSize=/>   older drafts: attributes of <Experiment>
        <Parameters source=".ssv"/> <Stimuli source=".csv"/> <References source=".csv"/>

A source is relative to the file that names it. The draft leaves the columns of a CSV open; here the first is the time
[s], the others are named as the FMU's variables, each in its own unit unless one stands behind the name, as in
torque [N.mm]."""

from __future__ import annotations

import io
import math
import posixpath
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import parse_csv
from . import archive

STANDARD = "org.fmi-standard.fmi-ls-ref"
VERSION = "1.0.0-beta.1"
MANIFEST = f"extra/{STANDARD}/fmi-ls-manifest.xml"
ROLES = ("experiment", "experiment/smoke-test", "experiment/validation")
TYPES = ("application/x-ma-hs-experiments", "application/x-ma-ls-experiments")  # the second until 1.0.0-alpha.1
TIME = ("time", "t")
LARGEST = 64 << 20  # B of a file that is read
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """Values of variables over time.

    time    (n,) s, not falling; a time that stands twice is a jump
    values  {variable: (n,)}
    units   {variable: the unit that its column names}; the others are in the variable's own
    """

    time: Array
    values: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    def at(self, name: str, time: float, linear: bool) -> float:
        """The value at `time` [s]: linear between the rows or as the last row says; after a jump at its time; the first
        and the last value hold outside."""
        k = int(np.searchsorted(self.time, time, side="right")) - 1
        values = self.values[name]
        if k < 0 or k + 1 >= len(values) or not linear:
            return float(values[max(k, 0)])
        share = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        return float(values[k] + share * (values[k + 1] - values[k]))


@dataclass(frozen=True)
class Experiment:
    """One transient simulation.

    name        of the experiment
    start       s
    stop        s; None: the last time of the references
    step        s between communication points; None: not said
    tolerance   as the file says, relative; None: not said
    parameters  {variable: number, true, false or text, with its unit behind it where one is named}
    stimuli     of the inputs; None where they keep their start values
    references  what came out
    """

    name: str
    references: Series
    start: float = 0.0
    stop: float | None = None
    step: float | None = None
    tolerance: float | None = None
    parameters: Mapping[str, float | str | bool] = field(default_factory=dict)
    stimuli: Series | None = None


def experiments(fmu: Path) -> tuple[list[Experiment], list[str]]:
    """The experiments that can be run, and a line for each that cannot. Raises InputError for a damaged archive."""
    folder = _Folder(fmu)
    found: list[Experiment] = []
    problems: list[str] = []
    if MANIFEST not in folder.names:
        return found, problems
    try:
        listed = [(source, entry) for source, entry in _listed(folder)]
    except InputError as problem:
        return found, [str(problem)]
    for source, entry in listed:
        try:
            found.append(_experiment(folder, source, entry))
        except InputError as problem:
            problems.append(f"{entry.get('name') or source}: {problem}")
    return found, problems


class _Folder:
    """The files of an archive, found from one another."""

    def __init__(self, fmu: Path) -> None:
        self.fmu, self.names = fmu, frozenset(archive.read(fmu).names)

    def beside(self, base: str, source: str | None) -> str:
        """The name of the entry that `source`, in the file `base`, means. Raises InputError."""
        address = urlsplit(source or "")
        if not source or address.scheme or address.netloc:
            raise InputError(f"{base} names {source!r}, which is no file inside the FMU")
        name = posixpath.normpath(posixpath.join(posixpath.dirname(base), unquote(address.path)))
        if name not in self.names:
            raise InputError(f"{name} is not in the FMU, though {base} names it")
        return name

    def text(self, name: str) -> str:
        """Raises InputError for what is no text."""
        data = archive.member(self.fmu, name)
        if len(data) > LARGEST:
            raise InputError(f"{name}: {len(data) >> 20} MB; at most {LARGEST >> 20} MB are read")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise InputError(f"{name} is not UTF-8 text") from None

    def xml(self, name: str, root: str) -> ElementTree.Element:
        """The root element, whose name is `root`. Raises InputError."""
        text = self.text(name)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise InputError(f"{name} has a DOCTYPE or entities; not read")
        try:
            element = ElementTree.fromstring(text.encode())
        except (ElementTree.ParseError, ValueError, LookupError) as problem:
            raise InputError(f"{name} is not valid XML: {problem}") from None
        if _tag(element) != root:
            raise InputError(f"{name} holds <{_tag(element)}>, not <{root}>")
        return element


def _listed(folder: _Folder) -> Iterator[tuple[str, ElementTree.Element]]:
    """(file, its <Experiment>) of all. Raises InputError."""
    for related in _children(folder.xml(MANIFEST, "fmiReferences"), "Related"):
        if related.get("role") in ROLES and related.get("type", TYPES[0]) in TYPES:
            source = folder.beside(MANIFEST, related.get("source"))
            for entry in _children(folder.xml(source, "Experiments"), "Experiment"):
                yield source, entry


def _experiment(folder: _Folder, source: str, entry: ElementTree.Element) -> Experiment:
    """Raises InputError for one that cannot be run or compared."""
    kinds = [
        _tag(child) for child in entry if _tag(child) not in ("Parameters", "Stimuli", "References", "Annotations")
    ]
    other = next((kind for kind in kinds if kind != "TransientSimulation"), None)
    if other is not None:
        raise InputError(f"a {other}, not a simulation over time; not run")
    settings = dict(entry.attrib)
    for transient in _children(entry, "TransientSimulation"):
        settings.update(transient.attrib)
    references = _series(folder, source, entry, "References")
    if references is None:
        raise InputError("has no reference results, so nothing could be compared; not run")
    if not len(references.time):
        raise InputError("its reference results have no rows")
    start = _number(settings, "startTime")
    found = Experiment(
        settings.get("name", "") or "unnamed",
        references,
        float(references.time[0]) if start is None else start,
        _number(settings, "stopTime"),
        _number(settings, "stepSize"),
        _number(settings, "tolerance"),
        dict(_parameters(folder, source, entry)),
        _series(folder, source, entry, "Stimuli"),
    )
    if found.step is not None and found.step <= 0:
        raise InputError(f"stepSize = {found.step:g}: must be above 0")
    return found


def _number(settings: Mapping[str, str], key: str) -> float | None:
    if key not in settings:
        return None
    number = _float(settings[key])
    if number is None:
        raise InputError(f"{key} = {settings[key]!r}: must be a number")
    return number


def _float(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _series(folder: _Folder, source: str, entry: ElementTree.Element, kind: str) -> Series | None:
    """The time series that the element `kind` names; None without one. Raises InputError."""
    for element in _children(entry, kind):
        if element.get("type", "text/csv") != "text/csv":
            raise InputError(f"its {kind} are {element.get('type')}; only text/csv is read")
        return read_series(folder.text(name := folder.beside(source, element.get("source"))), name)
    return None


def read_series(text: str, place: str) -> Series:
    """Of a CSV: the time first, then a column for each variable. Raises InputError with `place`."""
    rows = parse_csv(io.StringIO(text, newline=""), place)
    header = [_column(cell) for cell in next(rows)[1]]
    names = [name for name, _ in header]
    if names[0].lower() not in TIME:
        raise InputError(f"{place}: its first column is {names[0]!r}; must be time, in s")
    table = []
    for line, cells in rows:
        numbers = [_truth(cell) for cell in cells]
        if None in numbers:
            wrong = numbers.index(None)
            raise InputError(f"{place}: row {line}, {names[wrong]}: {cells[wrong]!r} is not a number")
        table.append(numbers)
    values = np.array(table, dtype=float).reshape(len(table), len(names))
    if (np.diff(values[:, 0]) < 0).any():
        raise InputError(f"{place}: its times fall; they must rise, or stay for a jump")
    units = {name: unit for name, unit in header[1:] if unit}
    return Series(values[:, 0], {name: values[:, k] for k, name in enumerate(names) if k}, units)


def _column(cell: str) -> tuple[str, str]:
    """The variable of a column and the unit in brackets behind a blank; without a blank it is the index of an array."""
    name, blank, unit = cell.rpartition(" ")
    return (name.strip(), unit[1:-1]) if blank and unit.startswith("[") and unit.endswith("]") else (cell, "")


def _truth(cell: str) -> float | None:
    return float(cell.lower() == "true") if cell.lower() in ("true", "false") else _float(cell)


def _parameters(folder: _Folder, source: str, entry: ElementTree.Element) -> Iterator[tuple[str, float | str | bool]]:
    """(variable, value) of the parameter set (SSP's SSV). Raises InputError."""
    for element in _children(entry, "Parameters"):
        if element.get("type", "application/x-ssp-parameter-set") != "application/x-ssp-parameter-set":
            raise InputError(f"its Parameters are {element.get('type')}; only a parameter set of SSP is read")
        place = folder.beside(source, element.get("source"))
        for parameters in _children(folder.xml(place, "ParameterSet"), "Parameters"):
            for parameter in _children(parameters, "Parameter"):
                for value in parameter:
                    yield parameter.get("name", ""), _value(value)


def _value(element: ElementTree.Element) -> float | str | bool:
    text, unit = element.get("value", ""), element.get("unit")
    if _tag(element) == "Boolean":
        return text in ("true", "1")
    number = _float(text)
    if number is None or _tag(element) in ("String", "Enumeration"):
        return text
    return f"{text} {unit}" if unit else number


def _children(element: ElementTree.Element, tag: str) -> Iterable[ElementTree.Element]:
    return [child for child in element if _tag(child) == tag]


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]
