"""Distributions as users write them: `{ normal = { mean = "30 deg", sd = "5 deg" } }`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from .. import keys
from ..errors import InputError, nearest
from ..units import Unit, quantity, unit
from ..uq.distributions import (
    Beta,
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

ENDS = ("low", "high")
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
    "fixed": Family((), Fixed, "one value: the parameter does not vary", value=NUMBER),
}


def _numbers(family: Family) -> keys.Kind:
    if family.value is not None:
        return keys.raw("quantities" if family.value is not NUMBER else "quantity", family.value, "its own")
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
            keys.Key("low", keys.raw("quantity", NUMBER, "its own"), "beside the distribution: truncates it"),
            keys.Key("high", keys.raw("quantity", NUMBER, "its own"), "beside the distribution: truncates it"),
        ),
        more={"oneOf": [{"required": [name]} for name in FAMILIES]},
        words="distribution",
    )
)


def marginal(spec: Any, own: Unit | None, place: str) -> Marginal:
    """The distribution that a table describes, in the unit `own` of the parameter. Raises InputError that begins with
    `place`, ValueError for numbers that no distribution has."""
    if not isinstance(spec, dict):
        raise InputError(f'{place}: must be a distribution, such as {{ normal = {{ mean = "30 deg", sd = "5 deg" }} }}')
    names = [name for name in spec if name in FAMILIES]
    strange = [name for name in spec if name not in (*FAMILIES, *ENDS)]
    if strange:
        raise InputError(f"{place}: unknown {strange[0]!r}{nearest(strange[0], FAMILIES)}")
    if len(names) != 1:
        raise InputError(f"{place}: needs exactly one of {', '.join(FAMILIES)}")
    name = names[0]
    ends = {end: quantity(spec[end], own, f"{place}.{end}") for end in ENDS if end in spec}
    if name == "fixed" and ends:
        raise InputError(f"{place}: a fixed value has no low or high")
    if ends and set(ENDS) <= set(FAMILIES[name].keys):
        raise InputError(f"{place}: low and high belong inside {name}")
    parent = _member(name, spec[name], own, place)
    return Truncated(parent, ends.get("low", -math.inf), ends.get("high", math.inf)) if ends else parent


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
    numbers = [quantity(inner[key], NONE if key in family.plain else own, f"{place}.{key}") for key in family.keys]
    if name == "lognormal" and not any(numbers):
        raise InputError(f"{place}: a lognormal cannot be 0; write {{ fixed = 0 }}")
    return family.make(*numbers)
