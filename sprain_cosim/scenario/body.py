"""The person of a scenario as parameters of its plant: "subject.stature" and the like may be set and varied as
parameters are, and become the plant's mass and factors before a run."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from ..cosim.system import System
from ..errors import InputError
from ..fmu.element import Connector
from ..subject.anthropometry import MEASURES, SEXES, meaning_of_measure, range_of_measure, unit_of_measure
from ..subject.person import MUSCLE_FORCE, PASSIVE, SEGMENTS, Person, Subject
from ..units import unit

OWNER = "subject."
SEX = f"{OWNER}sex"
PLANT = "plant."


class SexConnector(Connector):
    """A sex: by name, or by its number in tables of trials."""

    def value(self, entry: float | str | bool, what: str) -> float:
        text = str(entry).strip().removesuffix(".0")
        for number, sex in enumerate(SEXES):
            if text in (sex, str(number)):
                return float(number)
        raise InputError(f"{what} = {entry!r}: must be {' or '.join(SEXES)} (0 or 1)")


def subject_connectors(subject: Subject) -> dict[str, Connector]:
    """{"subject.NAME": what may be set of the person}, with the person's own measures as start values."""
    own = Person.of(subject).measures
    sex = float(SEXES.index(subject.sex))
    named = f"{' or '.join(SEXES)}; as a number {' or '.join(str(number) for number in range(len(SEXES)))}"
    found: dict[str, Connector] = {
        SEX: SexConnector("sex", -1, "parameter", "real", None, sex, 0.0, 1.0, description=named)
    }
    for name in MEASURES:
        low, high = range_of_measure(name)
        found[f"{OWNER}{name}"] = Connector(
            name,
            -1,
            "parameter",
            "real",
            unit(unit_of_measure(name)),
            own[name],
            low,
            high,
            description=meaning_of_measure(name),
        )
    return found


def with_measures(subject: Subject, values: Mapping[str, float]) -> Subject:
    """The subject with {"subject.NAME": value} in place of its own."""
    sex = SEXES[round(values[SEX])] if SEX in values else subject.sex
    measures = {name.removeprefix(OWNER): value for name, value in values.items() if name != SEX}
    return replace(subject, sex=sex, measures={**subject.measures, **measures})


def is_of_subject(name: str) -> bool:
    return name.startswith(OWNER)


def plant_values(subject: Subject, system: System) -> dict[str, float]:
    """{"plant.parameter": value in its own unit} of a person. Raises InputError for a plant without these parameters,
    and for a person outside their ranges."""
    found: dict[str, float] = {}
    for name, value in subject.parameters().items():
        full = PLANT + name
        try:
            connector = system.find(full)
        except InputError:
            raise InputError(f"subject: the plant has no parameter {name}, so it cannot be this person") from None
        if name in PASSIVE:
            value *= connector.start or 0.0
        if not connector.minimum <= value <= connector.maximum:
            raise InputError(
                f"subject: {subject.words}: {name} = {value:.4g} lies outside the plant's {connector.minimum:g} ... "
                f"{connector.maximum:g}; look at the measures and their units"
            )
        found[full] = value
    return found


def of_person(subject: Subject) -> set[str]:
    """The plant's parameters that such a person makes."""
    return {PLANT + name for name in subject.parameters()}


def without_person(
    parameters: Mapping[str, Any], subject: Subject, kept: Collection[str] = ()
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The parameters without those that say something of another person than `subject`, but those `kept`; a warning
    that names what is gone. Raises InputError where a rule that the subject names contradicts one of them: both were
    written on purpose."""
    gone = [name for name in parameters if name in of_person(subject) and name not in kept]
    ruled = [name for name in gone if name.removeprefix(PLANT) in (*PASSIVE, MUSCLE_FORCE)]
    if ruled:
        named = f"{', '.join(ruled[:3])}{' ...' * (len(ruled) > 3)}"
        raise InputError(
            f"subject: {' and '.join(subject.rules)} contradicts {named}, which the scenario sets; leave one out"
        )
    left = {name: value for name, value in parameters.items() if name not in gone}
    if not gone:
        return left, ()
    more = f" and {len(gone) - 2} more parameters of the scenario" if len(gone) > 2 else ", which the scenario set"
    return left, (f"subject: takes the place of {', '.join(gone[:2])}{more}",)


def pose_problem(system: System, values: Mapping[str, float], varied: Collection[str] = ()) -> str:
    """Why a landing with these `values` in their own units cannot start: the published pose has the height of the base
    person, and no other's lengths. Empty where it can. `varied`: names whose values are not known yet."""
    try:
        pose, fibres = system.find(f"{PLANT}initial_pose"), system.find(f"{PLANT}fibre_start")
    except InputError:
        return ""
    published, record = pose.items.get("published"), fibres.items.get("as_published")
    if published is None or values.get(f"{PLANT}initial_pose", pose.start) != published:
        return ""
    lengths = tuple(f"{PLANT}{segment}_scale_" for segment in SEGMENTS)
    if not any(n.startswith((*lengths, OWNER)) for n in varied) and all(
        value == 1.0 for name, value in values.items() if name.startswith(lengths)
    ):
        return ""
    more = f" and {PLANT}fibre_start=equilibrium" if values.get(f"{PLANT}fibre_start", fibres.start) == record else ""
    return (
        f"{PLANT}initial_pose = published: is the height of the base person's pelvis, which leaves another one's foot "
        f"far above or inside the platform; set {PLANT}initial_pose=touching{more}"
    )


def measured_text(name: str, value: float) -> str:
    """A value of "subject.NAME" as people write it."""
    plain = name.removeprefix(OWNER)
    return SEXES[round(value)] if name == SEX else f"{value!r} {unit_of_measure(plain)}"
