"""Labelled arrays for xarray, whose variables say their unit and what they are, as the CF conventions ask."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .errors import EnvironmentProblem

if TYPE_CHECKING:
    import xarray

UDUNITS = {"deg": "degree", "°": "degree"}  # as UDUNITS spells what is spelled otherwise here


@dataclass(frozen=True)
class Variable:
    """A variable or a coordinate.

    name       of it
    dims       of its values
    values     an array
    unit       as units.py spells it; "" for none, "?" for one that is not declared
    long_name  what it is, for axes of plots
    """

    name: str
    dims: tuple[str, ...]
    values: Any
    unit: str
    long_name: str


def dataset(variables: Iterable[Variable], coordinates: Iterable[Variable], about: Mapping[str, Any]) -> xarray.Dataset:
    """An xarray.Dataset whose variables have `units` and `long_name`; `about` are its attributes, of which None are
    left out. Raises EnvironmentProblem where xarray is not there."""
    try:
        import xarray
    except ImportError:
        raise EnvironmentProblem('to_xarray: needs xarray: pip install "sprain-cosim[xarray]"') from None
    kept = {key: value for key, value in about.items() if value is not None}
    return xarray.Dataset(_described(variables), _described(coordinates), kept)


def _described(several: Iterable[Variable]) -> dict[str, tuple[Sequence[str], Any, dict[str, str]]]:
    return {
        v.name: (v.dims, v.values, {"long_name": v.long_name, **({} if v.unit == "?" else {"units": cf_unit(v.unit)})})
        for v in several
    }


def cf_unit(name: str) -> str:
    """The unit as UDUNITS reads it: products with a blank, degree; "1" for none."""
    return re.sub(r"[^\W\d_]+|°", lambda word: UDUNITS.get(word[0], word[0]), re.sub("[.·⋅]", " ", name)) or "1"


def in_words(name: str) -> str:
    """ "plant.subtalar_angle" as "subtalar angle (plant)"."""
    owner, _, variable = name.rpartition(".")
    return f"{variable.replace('_', ' ')} ({owner})" if owner else variable.replace("_", " ")
