"""Distributions as users write them: `{ normal = { mean = "30 deg", sd = "5 deg" } }`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .. import keys
from ..errors import InputError, nearest
from ..files import read_csv
from ..units import Unit, quantity, unit
from ..uq.distributions import (
    Beta,
    Choices,
    Empirical,
    Exponential,
    Fixed,
    LogNormal,
    Marginal,
    Normal,
    Triangular,
    Truncated,
    Uniform,
    Weibull,
)
from ..uq.fitting import FAMILIES as FITTED
from ..uq.fitting import Family as Law
from ..uq.fitting import fit_sample
from .inputs import heading_of

ENDS = ("low", "high")
LARGEST = 1e150
NONE = unit("1")
NUMBER = {"type": ["number", "string"]}
MEANINGS = {
    "mean": "mean",
    "sd": "standard deviation",
    "low": "lower end",
    "high": "upper end",
    "mode": "most frequent value",
    "alpha": "shape: the larger, the rarer are values near low",
    "beta": "shape: the larger, the rarer are values near high",
}


@dataclass(frozen=True)
class Family:
    """One distribution.

    keys   its numbers, in the order in which `make` takes them; none: the family's value itself is `value`
    make   the distribution of them
    text   what it is
    plain  those of the keys that have no unit
    value  JSON Schema of a family that is no table
    """

    keys: tuple[str, ...]
    make: Callable[..., Marginal]
    text: str
    plain: tuple[str, ...] = ()
    value: Mapping[str, Any] | None = None


FAMILIES = {
    "normal": Family(("mean", "sd"), Normal, "mean and standard deviation"),
    "lognormal": Family(("mean", "sd"), LogNormal, "mean and standard deviation of the variable itself"),
    "weibull": Family(("mean", "sd"), Weibull, "mean and standard deviation"),
    "exponential": Family(("mean",), Exponential, "from 0 on"),
    "uniform": Family(ENDS, Uniform, "between low and high"),
    "triangular": Family(("low", "mode", "high"), Triangular, "between low and high, most often near mode"),
    "beta": Family(("alpha", "beta", *ENDS), Beta, "between low and high, shapes alpha and beta", ("alpha", "beta")),
    "empirical": Family(
        (), Empirical, "a list of measured values, as they are", value={"type": "array", "items": NUMBER, "minItems": 3}
    ),
    "choices": Family(
        (),
        Choices,
        "single values, such as the items of an enumeration: a list, or each with its weight",
        value={
            "anyOf": [
                {"type": "array", "items": {"type": ["number", "string", "boolean"]}, "minItems": 2},
                {
                    "type": "object",
                    "additionalProperties": {"type": "number", "exclusiveMinimum": 0},
                    "minProperties": 2,
                },
            ]
        },
    ),
    "fixed": Family((), Fixed, "one value: the parameter does not vary", value=NUMBER),
}
SAMPLES = "samples"
NAMES = (*FAMILIES, SAMPLES)
OF_FILE = keys.Short(
    "file",
    keys.Table(
        (
            keys.Key(
                "file", keys.text(), "a table with a header, `name [unit]`, one row a specimen", needs="needs file"
            ),
            keys.Key("column", keys.text(), "its column", "the only one"),
            keys.Key("family", keys.choice(FITTED), "the law that is fitted", "that of least AICc"),
        )
    ),
)


def _numbers(family: Family) -> keys.Kind:
    if family.value is not None:
        words = "quantity" if family.value is NUMBER else "quantities" if family.make is Empirical else "values"
        return keys.raw(words, family.value, "its own")
    entries = [
        keys.Key(
            name,
            keys.raw("number", NUMBER) if name in family.plain else keys.raw("quantity", NUMBER, "its own"),
            MEANINGS[name],
            needs=f"needs {name}",
        )
        for name in family.keys
    ]
    return keys.Table(tuple(entries))


DISTRIBUTION = keys.Later(
    keys.Table(
        (
            *(keys.Key(name, _numbers(family), family.text) for name, family in FAMILIES.items()),
            keys.Key(SAMPLES, OF_FILE, "measured values in a file: normal, lognormal or weibull fitted to them"),
            keys.Key("low", keys.raw("quantity", NUMBER, "its own"), "beside the distribution: truncates it"),
            keys.Key("high", keys.raw("quantity", NUMBER, "its own"), "beside the distribution: truncates it"),
        ),
        more={"oneOf": [{"required": [name]} for name in NAMES]},
        words="distribution",
    )
)


@dataclass(frozen=True)
class Fitted:
    """A law fitted to measured values.

    law       normal, lognormal or weibull
    n         values
    file      where they stand
    aicc      of the law; inf for three values
    anderson_darling, p_value  how far they lie from it, and how likely that is if they came from it
    warnings  what speaks against it
    """

    law: str
    n: int
    file: str
    aicc: float
    anderson_darling: float
    p_value: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measurements:
    """Files of measured values: where relative paths begin, and the fits made, by place."""

    folder: Path
    fits: dict[str, Fitted] = field(default_factory=dict)


def marginal(
    spec: Any,
    own: Unit | None,
    place: str,
    measured: Measurements | None = None,
    value: Callable[[Any, str], float] | None = None,
) -> Marginal:
    """The distribution that a table describes, in the unit `own` of the parameter. `measured` takes the fits of its
    samples, and `value` reads a choice. Raises InputError that begins with `place`, ValueError for numbers that no
    distribution has."""
    if not isinstance(spec, dict):
        raise InputError(f'{place}: must be a distribution, such as {{ normal = {{ mean = "30 deg", sd = "5 deg" }} }}')
    names = [name for name in spec if name in NAMES]
    strange = [name for name in spec if name not in (*NAMES, *ENDS)]
    if strange:
        raise InputError(f"{place}: unknown {strange[0]!r}{nearest(strange[0], NAMES)}")
    if len(names) != 1:
        raise InputError(f"{place}: needs exactly one of {', '.join(NAMES)}")
    name = names[0]
    ends = {end: quantity(spec[end], own, f"{place}.{end}") for end in ENDS if end in spec}
    if name in ("fixed", "choices") and ends:
        raise InputError(f"{place}: {'a fixed value has' if name == 'fixed' else 'choices have'} no low or high")
    if name == "uniform" and ends:
        raise InputError(f"{place}: low and high belong inside {name}")
    if name == SAMPLES:
        parent = _of_samples(spec[name], own, place, measured, bool(ends))
    elif name == "choices":
        parent = _choices(spec[name], place, value or (lambda entry, what: quantity(entry, own, what)))
    else:
        parent = _member(name, spec[name], own, place)
    if problem := strangeness(parent):
        raise InputError(f"{place}: {problem}")
    return Truncated(parent, ends.get("low", -math.inf), ends.get("high", math.inf)) if ends else parent


def strangeness(law: Marginal) -> str:
    """Why nothing can be calculated with a law's numbers; empty for one that is in order."""
    try:
        with np.errstate(all="ignore"):
            numbers = (law.mean, law.sd, *law.from_standard([-3.0, 3.0]))
        if all(abs(number) < LARGEST for number in numbers):
            lost = not law.is_fixed and law.mean + 0.01 * law.sd == law.mean
            return f"its sd is lost in rounding beside the mean {law.mean:g}; write fixed = ..." if lost else ""
    except (OverflowError, ZeroDivisionError):
        pass
    return "its numbers are too large, too small or too far apart to calculate with"


def _choices(inner: Any, place: str, value: Callable[[Any, str], float]) -> Choices:
    weighted = isinstance(inner, dict)
    if not (weighted or isinstance(inner, list)):
        raise InputError(
            f'{place}: choices must be a list, such as ["a", "b"], or each with its weight, {{ a = 1, b = 3 }}'
        )
    if weighted and not all(keys.is_number(weight) for weight in inner.values()):
        raise InputError(f"{place}.choices: weights must be numbers")
    found = [value(entry, f"{place}.choices") for entry in inner]
    if len(set(found)) != len(found):
        raise InputError(f"{place}.choices: a value stands twice")
    order = sorted(range(len(found)), key=lambda k: found[k])
    weights = tuple(float(list(inner.values())[k]) for k in order) if weighted else ()
    return Choices(tuple(found[k] for k in order), weights)


def _of_samples(inner: Any, own: Unit | None, place: str, measured: Measurements | None, truncated: bool) -> Marginal:
    problems: list[str] = []
    asked = OF_FILE.read(inner, f"{place}.{SAMPLES}", problems)
    if problems or asked is keys.MISSING:
        raise InputError("; ".join(problems))
    if measured is None:
        raise InputError(f"{place}: samples stand in a study file, beside which their file lies")
    path = measured.folder / asked["file"]
    values = _column(path, asked.get("column"), own, f"{place}: {asked['file']}")
    laws: tuple[Law, ...] = (asked["family"],) if "family" in asked else FITTED
    try:
        fit = fit_sample(values, laws)
    except ValueError as problem:
        raise InputError(f"{place}: {asked['file']}: {problem}") from None
    without = ("low and high cut the law: its doubt about its parameters is not carried on",) if truncated else ()
    best = fit.best
    measured.fits[place] = Fitted(
        best.family,
        fit.n,
        str(asked["file"]),
        best.aicc,
        best.anderson_darling,
        best.p_value,
        (*fit.warnings, *without),
    )
    return fit.marginal


def _column(path: Path, wanted: str | None, own: Unit | None, place: str) -> list[float]:
    """The values of one column of a table, in the unit `own`. Raises InputError naming row and cell."""
    lines = read_csv(path)
    _, header = next(lines)
    names = [heading_of(cell) for cell in header]
    if wanted is None and len(names) != 1:
        raise InputError(f'{place}: has {len(names)} columns; name one: {{ file = "...", column = "{names[0][0]}" }}')
    found = [k for k, (name, _) in enumerate(names) if wanted in (None, name, header[k])]
    if not found:
        raise InputError(f"{place}: has no column {wanted!r}{nearest(wanted or '', [n for n, _ in names])}")
    k = found[0]
    if header[k].replace(".", "").replace("-", "").isdigit():
        raise InputError(f"{place}: begins with a number; needs a header, such as stiffness [N.m/rad]")
    unit_after = names[k][1]
    return [quantity(f"{cells[k]} {unit_after}".strip(), own, f"{place}, row {at}, {header[k]}") for at, cells in lines]


def _member(name: str, inner: Any, own: Unit | None, place: str) -> Marginal:
    family = FAMILIES[name]
    if name == "fixed":
        return Fixed(quantity(inner, own, place))
    if name == "empirical":
        if not isinstance(inner, list):
            raise InputError(f'{place}: empirical must be a list of values, such as ["0.28 m", "0.31 m", "0.33 m"]')
        return Empirical(tuple(quantity(value, own, f"{place}.{name}") for value in inner))
    if not isinstance(inner, dict) or set(inner) != set(family.keys):
        raise InputError(f"{place}: {name} = {{ {', '.join(f'{key} = ...' for key in family.keys)} }}")
    numbers = [
        quantity(inner[key], NONE if key in family.plain else own, f"{place}.{key}", difference=key == "sd")
        for key in family.keys
    ]
    if name == "lognormal" and not any(numbers):
        raise InputError(f"{place}: a lognormal cannot be 0; write {{ fixed = 0 }}")
    return family.make(*numbers)
