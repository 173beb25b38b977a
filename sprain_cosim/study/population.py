"""A population as inputs of a study: the measures of its women and men, joined as they are in the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from .. import keys
from ..errors import InputError, nearest
from ..scenario.body import OWNER, SEX
from ..subject.anthropometry import (
    MASS,
    MEASURES,
    NOUNS_OF_MANY,
    SEXES,
    anthropometry,
    moments_of_measure,
    unit_of_measure,
)
from ..subject.person import FORCE_RULES, PASSIVE_RULES, SCALE_TOOL, SCALING, Subject
from ..subject.words import ALSO
from ..uq.distributions import (
    Array,
    Choices,
    Fixed,
    JointDistribution,
    JointMixture,
    LogNormal,
    Marginal,
    Mixture,
    Normal,
)


def _measures(value: Any, place: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not value or len(set(map(str, value))) != len(value):
        raise InputError(f"{place}: must be a list of different measures, such as {list(SCALING[:3])}")
    for name in value:
        if name not in MEASURES:
            raise InputError(f"{place}: unknown measure {name!r}{nearest(ALSO.get(str(name), str(name)), MEASURES)}")
    return tuple(value)


POPULATION = keys.Table(
    (
        keys.Key("women", keys.positive(), "their share; of both, in any numbers: 1 and 1 are halves", "0"),
        keys.Key("men", keys.positive(), "their share", "0"),
        keys.Key(
            "measures",
            keys.Value("names", {"type": "array", "items": {"enum": list(MEASURES)}, "minItems": 1}, _measures),
            "the measures that vary; the others follow from them as conditional means",
            f"the nine that bodies are scaled by: {', '.join(SCALING)}",
        ),
        keys.Key("force", keys.choice(tuple(FORCE_RULES)), "rule of the isometric forces", SCALE_TOOL),
        keys.Key("passive", keys.choice(tuple(PASSIVE_RULES)), "rule of the passive ankle's torque", SCALE_TOOL),
    )
)

NOBODY, FEW = 1e-6, 0.01  # shares of a sex that is not drawn, and that is worth no word


@dataclass(frozen=True)
class Population:
    """Who a study's persons are drawn from.

    shares    {sex: its share}, sum 1
    measures  that vary
    fixed     {measure that all of those who land share: its value [m, kg]}
    """

    shares: Mapping[str, float]
    measures: tuple[str, ...] = SCALING
    fixed: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def drawn(self) -> dict[str, float]:
        """{sex: its share of those who have the fixed measures}, sum 1: of a mixed population hardly one of the tall is
        a woman."""
        density = {sex: anthropometry(sex).log_density(self.fixed) for sex in self.shares}
        weight = {sex: share * math.exp(density[sex] - max(density.values())) for sex, share in self.shares.items()}
        some = {sex: w for sex, w in weight.items() if w > NOBODY * sum(weight.values())}
        return {sex: w / sum(some.values()) for sex, w in some.items()} if self.fixed else {**self.shares}

    @property
    def words(self) -> str:
        """In a heading: "population of women and men (50 : 50 %)"."""
        told = " and ".join(NOUNS_OF_MANY[sex] for sex in self.drawn)
        if len(self.drawn) > 1:
            told += f" ({' : '.join(f'{100 * share:.3g}' for share in self.drawn.values())} %)"
        shared = (
            f", {name.replace('_', ' ')} {value:.4g} {unit_of_measure(name)}" for name, value in self.fixed.items()
        )
        varied = ", ".join(name.replace("_", " ") for name in self.measures if name not in self.fixed)
        alone = varied and not {*SCALING} <= {*self.measures, *self.fixed}
        return f"population of {told}{''.join(shared)}" + (f", drawn by {varied} alone" if alone else "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is unusual about the measures that all of them share, a line each."""
        some = [sex for sex, share in self.drawn.items() if share > FEW]
        lines = [line for sex in some for line in anthropometry(sex).unusual(self.fixed)]
        return tuple(f"population: {line}; what else is drawn extrapolates" for line in lines)

    @property
    def marginals(self) -> dict[str, Marginal]:
        """{"subject.NAME": over the sexes}; the sex first where there are several."""
        laws, shares = [self.law(sex)[0] for sex in self.drawn], tuple(self.drawn.values())
        if len(laws) == 1:
            return laws[0]
        found: dict[str, Marginal] = {SEX: Choices(tuple(float(SEXES.index(sex)) for sex in self.drawn), shares)}
        for name in laws[0]:
            parts = tuple(law[name] for law in laws)
            found[name] = parts[0] if parts[0].is_fixed else Mixture(parts, shares)
        return found

    @property
    def units(self) -> dict[str, str]:
        return {name: "" if name == SEX else unit_of_measure(name.removeprefix(OWNER)) for name in self.marginals}

    def law(self, sex: str) -> tuple[dict[str, Marginal], Array]:
        """{"subject.NAME": law within a sex}, and Pearson's correlations (m, m) in their order."""
        names, location, covariance = anthropometry(sex).rest(self.fixed)
        marginals: dict[str, Marginal] = {}
        at, stretch = [], []
        for name in self.measures:
            if name in self.fixed:
                marginals[OWNER + name] = Fixed(self.fixed[name])
                at.append(-1)
                stretch.append(0.0)
                continue
            k = names.index(name)
            scale = math.sqrt(covariance[k, k])
            mean, sd = moments_of_measure(name, float(location[k]), scale)
            marginals[OWNER + name] = LogNormal(mean, sd) if name == MASS else Normal(mean, sd)
            at.append(k)
            stretch.append(1.0 / (sd if name != MASS else sd / mean))  # Nataf: normal with lognormal is this factor
        full = np.pad(covariance, (0, 1))
        correlation = full[np.ix_(at, at)] * np.outer(stretch, stretch)
        np.fill_diagonal(correlation, 1.0)
        return marginals, correlation

    def correlations(self, names: list[str], others: Array | None) -> Array | None:
        """(d, d) of all inputs of a study of one sex; `others`: those of the inputs after its own. None: none."""
        if len(self.drawn) > 1:
            return None if others is None else _joined(np.eye(len(self.marginals)), others)
        own = self.law(next(iter(self.drawn)))[1]
        rest = np.eye(len(names) - len(own)) if others is None else others
        return _joined(own, rest)

    def joint(self, marginals: Mapping[str, Marginal], correlation: Array | None) -> JointDistribution:
        """The law of a study's inputs, the population's own among them."""
        names = list(marginals)
        if not isinstance(marginals.get(SEX), Choices):
            return JointDistribution(tuple(marginals.values()), correlation)
        parts = []
        for sex in self.drawn:
            own, block = self.law(sex)
            laws = {**marginals, **own, SEX: Fixed(float(SEXES.index(sex)))}
            joined = np.eye(len(names)) if correlation is None else correlation.copy()
            at = [names.index(name) for name in own]
            joined[np.ix_(at, at)] = block
            parts.append(JointDistribution([laws[name] for name in names], joined))
        return JointMixture(tuple(marginals.values()), names.index(SEX), parts)

    def fixing(self, name: str, value: float) -> Population:
        """Those of the population with this value of "subject.NAME". Raises InputError when there are none."""
        if name == SEX:
            sex = SEXES[round(value)]
            if sex not in self.shares:
                raise InputError(f"{name} = {sex}: the population has no {NOUNS_OF_MANY[sex]}")
            return replace(self, shares={sex: 1.0})
        return replace(self, fixed={**self.fixed, name.removeprefix(OWNER): value})


def population_of(content: Mapping[str, Any], place: str) -> tuple[Population, Subject]:
    """From the keys of POPULATION, read, with the rules as those of a subject. Raises InputError."""
    shares = {sex: content[noun] for sex, noun in NOUNS_OF_MANY.items() if noun in content}
    if not shares:
        raise InputError(f"{place}: needs women = ... or men = ..., their shares")
    total = sum(shares.values())
    population = Population({sex: share / total for sex, share in shares.items()}, content.get("measures", SCALING))
    rules = {key: content[key] for key in ("force", "passive") if key in content}
    return population, Subject(next(iter(shares)), **rules).checked(place)


def _joined(one: Array, other: Array) -> Array:
    corner = np.zeros((len(one), len(other)))
    return np.block([[one, corner], [corner.T, other]])
