"""A person: what is known of one, the estimates of the rest, and the factors that make the plant's body theirs.

The base person, with whom the plant was made, is a woman of 1.80 m and 67.54 kg; her measures are estimated as
anybody's are, and a factor is a measure of the person over the same measure of the base person. So a woman of that
stature and mass has factors of 1 to the bit, and what a tape measure finds elsewhere than a joint's centre lies
cancels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np

from ..errors import InputError, nearest
from .anthropometry import (
    MASS,
    MEASURES,
    NOUNS,
    OLDEST,
    SEXES,
    STATURE,
    YOUNGEST,
    anthropometry,
    exchanged,
    meant,
    range_of_measure,
    unit_of_measure,
)

AXES = ("x", "y", "z")
SEGMENTS = ("pelvis", "thigh", "shank", "foot", "torso")
SCALING = (  # what the factors of a body are made of
    STATURE,
    MASS,
    "foot_length",
    "foot_breadth",
    "lateral_malleolus_height",
    "lateral_epicondyle_height",
    "trochanterion_height",
    "bicristal_breadth",
    "cervicale_height",
)
SCALE_TOOL, HANDSFIELD, BY_SIZE = "scale-tool", "handsfield", "mass-height"
FORCE_RULES = {
    SCALE_TOOL: "isometric forces as the base person's",
    HANDSFIELD: "isometric force by muscle volume (Handsfield et al. 2014) over leg length",
}
PASSIVE_RULES = {
    SCALE_TOOL: "passive ankle torque as the base person's",
    BY_SIZE: "passive ankle torque in proportion to mass times stature",
}
VOLUME = (
    47.05,
    1289.6,
)  # cm³/(kg·m), cm³: of a leg's muscles; Handsfield et al. 2014, doi 10.1016/j.jbiomech.2013.12.002
ELDEST = 120  # years
BODY_MASS, MUSCLE_FORCE = "body_mass", "muscle_force_scale"
PASSIVE = tuple(f"passive_{axis}_{power}" for axis in AXES for power in ("linear", "quadratic", "cubic"))


@dataclass(frozen=True)
class Subject:
    """Who lands, as far as somebody said.

    sex       female or male
    measures  {measure: [m], the mass [kg]}; what is not there is estimated
    age       years; None: not known
    force     one of FORCE_RULES
    passive   one of PASSIVE_RULES
    scales    {segment: its factors (x, y, z)}, in place of those of the measures
    """

    sex: str
    measures: Mapping[str, float] = field(default_factory=dict)
    age: float | None = None
    force: str = SCALE_TOOL
    passive: str = SCALE_TOOL
    scales: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def checked(self, place: str) -> Subject:
        """Itself. Raises InputError that begins with `place`."""
        if self.sex not in SEXES:
            raise InputError(f"{place}: sex {self.sex!r}: must be female or male, whose measures the tables hold")
        if self.age is not None and not 0 <= self.age <= ELDEST:
            raise InputError(f"{place}: age {self.age:g}: must lie between 0 and {ELDEST} years")
        if self.age is not None and self.age < YOUNGEST:
            raise InputError(
                f"{place}: age {self.age:g}: those measured were {YOUNGEST} to {OLDEST} years old, and a growing body "
                "is no small adult; name the plant's factors instead"
            )
        for name in self.measures:
            if name not in MEASURES:
                raise InputError(f"{place}: unknown measure {name!r}{nearest(name, MEASURES)}")
        for kind, rule, rules in (("force", self.force, FORCE_RULES), ("passive", self.passive, PASSIVE_RULES)):
            if rule not in rules:
                raise InputError(f"{place}: {kind} = {rule!r}: must be {' or '.join(rules)}")
        for name, value in (
            *self.measures.items(),
            *((f"{n}_scale", f) for n, factors in self.scales.items() for f in factors),
        ):
            if not value > 0:
                raise InputError(f"{place}: {name} = {value:g}: must be positive")
        for name, value in self.measures.items():
            low, high = range_of_measure(name)
            if not low <= value <= high:
                own = unit_of_measure(name)
                raise InputError(
                    f"{place}: {name} = {value:g} {own}: no adult's ({low:.3g} ... {high:.3g} {own} is taken)"
                    f"{meant(self.sex, name, value)}"
                )
        if exchanged(self.sex, self.measures):
            stature, mass = self.measures[STATURE], self.measures[MASS]
            raise InputError(
                f"{place}: stature = {stature:.4g} m, mass = {mass:.4g} kg: nobody's; the units are exchanged, write "
                f'"{mass:.4g} cm, {100 * stature:.4g} kg"'
            )
        for name in self.scales:
            if name not in SEGMENTS:
                raise InputError(f"{place}: no segment {name!r}{nearest(name, SEGMENTS)}")
        Person.of(self).lengths(place)
        return self

    @property
    def words(self) -> str:
        """The person in a heading: "woman, 1.63 m, 62 kg"."""
        parts = [NOUNS[self.sex]]
        for name in (STATURE, MASS):
            if name in self.measures:
                parts.append(f"{self.measures[name]:.4g} {'kg' if name == MASS else 'm'}")
        parts += [
            f"{name.replace('_', ' ')} {value:.4g} m"
            for name, value in self.measures.items()
            if name not in (STATURE, MASS)
        ]
        parts += [
            f"{name} scaled by {' × '.join(f'{f:.4g}' for f in dict.fromkeys(factors))}"
            for name, factors in self.scales.items()
        ]
        return ", ".join([*parts, *self.rules])

    @property
    def rules(self) -> tuple[str, ...]:
        """The rules that are none of the scale tool's, in words."""
        chosen = ((FORCE_RULES, self.force), (PASSIVE_RULES, self.passive))
        return tuple(rules[rule] for rules, rule in chosen if rule != SCALE_TOOL)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is unusual about the measures, a line each."""
        lines = [
            f"subject: {line}; factors follow the measures all the same, and the estimates extrapolate"
            for line in anthropometry(self.sex).unusual(self.measures)
        ]
        person = Person.of(self)
        for name, factor, unit in ((STATURE, 100.0, "cm"), (MASS, 1.0, "kg")):
            if name not in self.measures:
                lines.append(
                    f"subject: the {name} is not stated; {factor * person.measures[name]:.0f} {unit} is "
                    f"estimated, which leaves ± {factor * person.sd[name]:.0f} {unit} open, and is the same in "
                    "all landings that do not vary it"
                )
        if self.age is not None and self.age > OLDEST:
            lines.append(f"subject: age {self.age:g}: those measured were {YOUNGEST} to {OLDEST} years old")
        return tuple(lines)

    @property
    def deviations(self) -> list[dict[str, float]]:
        """What the estimates leave open: measures [m, kg], one standard deviation off along directions that do not
        depend on each other, so that the squares of what each changes add up; empty where all is measured that bodies
        are scaled by."""
        names, _, covariance = anthropometry(self.sex).rest(self.measures)
        centre = Person.of(self).measures
        scaled = [k for k, name in enumerate(names) if name in SCALING]
        variance, directions = np.linalg.eigh(covariance[np.ix_(scaled, scaled)])
        found = []
        for column in (directions * np.sqrt(np.maximum(variance, 0.0))).T.tolist():
            off = {names[k]: d for k, d in zip(scaled, column, strict=True)}
            found.append({n: centre[n] * math.exp(d) if n == MASS else centre[n] + d for n, d in off.items()})
        return found

    def parameters(self, measures: Mapping[str, float] | None = None) -> dict[str, float]:
        """{parameter of the plant: value [kg, 1]}; `measures` go on top of the subject's own. The passive ankle's
        coefficients stand as factors of the model's."""
        given = {**self.measures, **(measures or {})}
        known = given.keys() >= set(SCALING)  # estimates of the rest move nothing
        person = Person(self.sex, given, {}) if known else Person.estimated(self.sex, given)
        return {
            BODY_MASS: person.measures[MASS],
            **{
                f"{segment}_scale_{axis}": factor
                for segment, factors in (person.factors | dict(self.scales)).items()
                for axis, factor in zip(AXES, factors, strict=True)
            },
            **({MUSCLE_FORCE: person.force_factor} if self.force == HANDSFIELD else {}),
            **(dict.fromkeys(PASSIVE, person.size) if self.passive == BY_SIZE else {}),
        }


@dataclass(frozen=True)
class Person:
    """All measures of a person.

    sex       female or male
    measures  {measure: measured, or else the mean of those who share what was measured} [m, kg]
    sd        {measure: standard deviation of what an estimate leaves open; 0: measured}
    """

    sex: str
    measures: Mapping[str, float]
    sd: Mapping[str, float]

    @classmethod
    def estimated(cls, sex: str, given: Mapping[str, float]) -> Person:
        return cls(sex, *anthropometry(sex).conditional(given))

    @classmethod
    def of(cls, subject: Subject) -> Person:
        return cls.estimated(subject.sex, subject.measures)

    def lengths(self, place: str = "subject") -> dict[str, float]:
        """{segment length or breadth [m]} that the factors are made of. Raises InputError where one is not positive."""
        m = self.measures
        found = {
            "pelvis breadth": m["bicristal_breadth"],
            "thigh length": m["trochanterion_height"] - m["lateral_epicondyle_height"],
            "shank length": m["lateral_epicondyle_height"] - m["lateral_malleolus_height"],
            "foot length": m["foot_length"],
            "foot height": m["lateral_malleolus_height"],
            "foot breadth": m["foot_breadth"],
            "torso length": m["cervicale_height"] - m["trochanterion_height"],
        }
        for name, value in found.items():
            if not value > 0:
                raise InputError(f"{place}: the measures leave a {name} of {1e3 * value:.0f} mm; look at their units")
        return found

    @cached_property
    def factors(self) -> dict[str, tuple[float, float, float]]:
        """{segment: factors (x forward, y up, z to the right) on the base person's}."""
        own, base = self.lengths(), base_person().lengths()
        ratio = {name: value / base[name] for name, value in own.items()}
        alike = {"pelvis": "pelvis breadth", "thigh": "thigh length", "shank": "shank length", "torso": "torso length"}
        found = {segment: (ratio[name],) * 3 for segment, name in alike.items()}
        found["foot"] = (ratio["foot length"], ratio["foot height"], ratio["foot breadth"])
        return {segment: found[segment] for segment in SEGMENTS}

    @property
    def size(self) -> float:
        """Mass times stature, over the base person's."""
        return self._mass_height / base_person()._mass_height

    @property
    def force_factor(self) -> float:
        """Isometric force over the base person's: muscle volume over leg length, since a muscle's force goes with its
        cross section and its fibres are taken to be as long as the leg makes them."""
        own, base = ((VOLUME[0] * p._mass_height + VOLUME[1]) / p._leg for p in (self, base_person()))
        return own / base

    @property
    def _mass_height(self) -> float:
        return self.measures[MASS] * self.measures[STATURE]

    @property
    def _leg(self) -> float:
        return self.measures["trochanterion_height"] - self.measures["lateral_malleolus_height"]


BASE = Subject("female", {STATURE: 1.80, MASS: 67.54377325440001})


@cache
def base_person() -> Person:
    """With whom the plant was made."""
    return Person.of(BASE)
