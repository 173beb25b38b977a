"""Body measures of women and men: their joint law, and what some measures of a person say of the others.

Lengths are normal and the mass is lognormal, joined by the correlations of ansur2.toml (of the mass's logarithm); given
some measures, the others are normal about the conditional means. The law holds for the adults who were measured,
soldiers of 17 to 58 years.

Source of the law of the others: a Gaussian over the same data is what AddBiomechanics takes, K. Werling et al., PLoS
ONE 18 (2023) e0295152."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import read_toml

STATURE = "stature"
MASS = "mass"
SEXES = ("female", "male")  # in the order of their numbers in tables
NOUNS = {"female": "woman", "male": "man"}
NOUNS_OF_MANY = {"female": "women", "male": "men"}
LIKELY = 4.5  # standard deviations from the mean
USUAL = (0.001, 0.999)  # of a population; a measure outside is worth a word
USUAL_SCORE = 3.090232306167813  # its ends in standard deviations
SPREAD = (0.2, 4.0)  # of the smallest and the largest mean: beyond lies a mistake of units
YOUNGEST, OLDEST = 17, 58  # years of those who were measured


@dataclass(frozen=True)
class Anthropometry:
    """The law of a sex's measures.

    sex          female or male
    source       of the numbers
    n            persons measured
    mean, sd     {measure: [m], the mass [kg]}
    correlation  (k, k) in their order, of the mass's logarithm
    """

    sex: str
    source: str
    n: int
    mean: Mapping[str, float]
    sd: Mapping[str, float]
    correlation: NDArray[np.float64]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.mean)

    def score(self, name: str, value: float) -> float:
        """The standard normal score of a measure."""
        location, scale = self._law(name)
        return (_straight(name, value) - location) / scale

    def share_below(self, name: str, value: float) -> float:
        """Share of the sex whose measure is smaller."""
        return _below(self.score(name, value))

    def log_density(self, given: Mapping[str, float]) -> float:
        """Logarithm of the density of these measures together, but for a term that both sexes have alike."""
        known = [self.names.index(name) for name in given]
        correlation = self.correlation[np.ix_(known, known)]
        z = np.array([self.score(name, value) for name, value in given.items()])
        scales = sum(math.log(self._law(name)[1]) for name in given)
        return float(-0.5 * (z @ np.linalg.solve(correlation, z) + np.linalg.slogdet(correlation)[1]) - scales)

    def conditional(self, given: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """{measure: mean} and {measure: standard deviation} of all, given some; those of a given measure are itself
        and 0."""
        names, location, covariance = self.rest(given)
        mean, sd = dict(given), dict.fromkeys(given, 0.0)
        for name, centre, variance in zip(names, location.tolist(), np.diag(covariance).tolist(), strict=True):
            mean[name], sd[name] = moments_of_measure(name, centre, math.sqrt(variance))
        return {name: mean[name] for name in self.names}, {name: sd[name] for name in self.names}

    def rest(self, given: Mapping[str, float]) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
        """The measures that are not given, and the mean (m,) and the covariance (m, m) of their normal variables (of
        the mass, its logarithm) beside those that are."""
        known = tuple(name for name in self.names if name in given)
        if known not in self._regressions:
            self._regressions[known] = self._regression(known)
        names, weights, location, scale, covariance = self._regressions[known]
        z = np.array([self.score(name, given[name]) for name in known])
        return list(names), location + scale * (weights @ z), covariance

    @cached_property
    def _regressions(self) -> dict[tuple[str, ...], tuple[Any, ...]]:
        """{names of measures: what they say of the others}: the same for all persons of whom these are known."""
        return {}

    def _regression(self, given: tuple[str, ...]) -> tuple[Any, ...]:
        """The measures that are not given, the weights of the given ones' scores in theirs, and location, scale and
        conditional covariance of their normal variables."""
        known = [self.names.index(name) for name in given]
        rest = [k for k in range(len(self.names)) if k not in known]
        r = self.correlation
        weights = np.linalg.solve(r[np.ix_(known, known)], r[np.ix_(known, rest)]).T
        names = [self.names[k] for k in rest]
        location, scale = np.array([self._law(name) for name in names]).reshape(-1, 2).T
        covariance = r[np.ix_(rest, rest)] - weights @ r[np.ix_(known, rest)]
        return names, weights, location, scale, covariance * np.outer(scale, scale)

    def unusual(self, given: Mapping[str, float]) -> list[str]:
        """The given measures that lie outside what is usual for the sex, or beside the other given ones, a line
        each."""
        lines = []
        for name, value in given.items():
            if not USUAL[0] <= (share := self.share_below(name, value)) <= USUAL[1]:
                lines.append(f"{self._measure(name, value)} is {self._side(share)}")
                continue
            others = {n: v for n, v in given.items() if n != name}
            if others and not USUAL[0] <= (share := self._share_beside(name, value, others)) <= USUAL[1]:
                shared = " and ".join(self._measure(n, v) for n, v in others.items())
                lines.append(f"{self._measure(name, value)} is {self._side(share)} with {shared}")
        return lines

    def unusual_rows(self, given: Mapping[str, NDArray[np.float64]]) -> NDArray[np.bool_]:
        """Which persons have a measure outside what is usual, alone or beside their other ones; {measure: (n,)}."""
        names = list(given)
        known = [self.names.index(name) for name in names]
        location, scale = np.array([self._law(name) for name in names]).reshape(-1, 2).T
        straight = np.column_stack([np.log(given[name]) if name == MASS else given[name] for name in names])
        z = (straight - location) / scale
        precision = np.linalg.inv(self.correlation[np.ix_(known, known)])
        beside = z @ precision / np.sqrt(np.diag(precision))
        return np.asarray((np.maximum(np.abs(z), np.abs(beside)) > USUAL_SCORE).any(axis=1))

    def _side(self, share: float) -> str:
        """Where a measure lies among those of the sex; beyond all of them the tail of a fitted law is no number."""
        which, tail = ("below", share) if share < 0.5 else ("above", 1.0 - share)
        of_many = NOUNS_OF_MANY[self.sex]
        if tail * self.n < 1.0:
            return f"by their law {which} all {self.n} {of_many} measured"
        return f"{which} all but {100 * tail:.1g} % of the {of_many} measured"

    def _share_beside(self, name: str, value: float, others: Mapping[str, float]) -> float:
        names, location, covariance = self.rest(others)
        k = names.index(name)
        return _below(float(_straight(name, value) - location[k]) / math.sqrt(covariance[k, k]))

    def _law(self, name: str) -> tuple[float, float]:
        """Location and scale of the normal variable behind a measure."""
        mean, sd = self.mean[name], self.sd[name]
        if name != MASS:
            return mean, sd
        zeta = math.sqrt(math.log1p((sd / mean) ** 2))
        return math.log(mean) - 0.5 * zeta**2, zeta

    @staticmethod
    def _measure(name: str, value: float) -> str:
        return f"{_spelled(name)} {value:.4g} {unit_of_measure(name)}"


def unit_of_measure(name: str) -> str:
    return "kg" if name == MASS else "m"


def meaning_of_measure(name: str) -> str:
    return f"{name.replace('_', ' ')}, as ANSUR II measures it"


_TABLES = read_toml(Path(__file__).parent / "ansur2.toml")  # before any sandbox closes


@cache
def anthropometry(sex: str) -> Anthropometry:
    """The law of a sex."""
    rows: dict[str, tuple[float, float, list[float]]] = _TABLES[sex]["measures"]
    correlation = np.eye(len(rows))
    for k, (_, _, before) in enumerate(rows.values()):
        correlation[k, :k] = correlation[:k, k] = before
    return Anthropometry(
        sex,
        _TABLES["source"],
        _TABLES[sex]["n"],
        {name: mean for name, (mean, _, _) in rows.items()},
        {name: sd for name, (_, sd, _) in rows.items()},
        correlation,
    )


MEASURES = anthropometry(SEXES[0]).names


def range_of_measure(name: str) -> tuple[float, float]:
    """Between which a measure of an adult lies, whatever the person."""
    means = [anthropometry(sex).mean[name] for sex in SEXES]
    return SPREAD[0] * min(means), SPREAD[1] * max(means)


def meant(sex: str, name: str, value: float) -> str:
    """What a value that is nobody's was perhaps meant to be, in words: the same figures in another unit, or as the
    stature or the mass."""
    law = anthropometry(sex)
    other = {STATURE: MASS, MASS: STATURE}.get(name)
    scaled = [(name, value * 10.0**k) for k in range(-3, 4)] + ([(other, value)] if other else [])
    for what, number in scaled:
        if abs(law.score(what, number)) < LIKELY:
            named = f"a {what} of " if what != name else ""
            return f"; did you mean {named}{number:.4g} {unit_of_measure(what)}?"
    return "; look at its unit"


def exchanged(sex: str, given: Mapping[str, float]) -> bool:
    """Whether the stature in cm and the mass in kg are nobody's, but would be usual for each other."""
    law = anthropometry(sex)
    if not {STATURE, MASS} <= given.keys():
        return False
    stature, mass = given[STATURE], given[MASS]
    pairs = ((STATURE, stature), (MASS, mass)), ((STATURE, 0.01 * mass), (MASS, 100.0 * stature))
    said, turned = ([abs(law.score(name, value)) for name, value in pair] for pair in pairs)
    return min(said) > LIKELY > max(turned)


def _below(score: float) -> float:
    """Share of a normal variable below a standard score."""
    return 0.5 * math.erfc(-score / math.sqrt(2.0))


def _straight(name: str, value: float) -> float:
    return math.log(value) if name == MASS else value


def moments_of_measure(name: str, location: float, scale: float) -> tuple[float, float]:
    """Mean and standard deviation of a measure whose normal variable has these."""
    if name != MASS:
        return location, scale
    mean = math.exp(location + 0.5 * scale**2)
    return mean, mean * math.sqrt(math.expm1(scale**2))


def _spelled(name: str) -> str:
    return name.replace("_", " ")
