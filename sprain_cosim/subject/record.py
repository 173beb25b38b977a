"""A subject in results: what was measured and what was estimated, and by which rules the plant became this person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..records import Record
from .anthropometry import MEASURES, anthropometry, unit_of_measure
from .person import BODY_MASS, Person, Subject, base_person


@dataclass(frozen=True)
class MeasureRecord(Record):
    """A body measure.

    value  measured, or the mean of those who share what was measured
    sd     standard deviation that an estimate leaves open; 0: measured
    base   of the person with whom the plant was made
    unit   of all three
    """

    value: float
    sd: float
    base: float
    unit: str


@dataclass(frozen=True)
class SubjectRecord(Record):
    """Who landed.

    words       in a heading
    sex         female or male
    age         years; None: not stated
    rules       of force and passive torque that are not the scale tool's, in words
    measures    {measure: ...}
    parameters  {parameter of the plant: value [kg, 1]}; the passive ankle's coefficients as factors of the model's
    source      of the estimates
    """

    words: str
    sex: str
    age: float | None = None
    rules: tuple[str, ...] = ()
    measures: Mapping[str, MeasureRecord] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    source: str = ""

    @classmethod
    def of(cls, subject: Subject) -> SubjectRecord:
        own, base = Person.of(subject), base_person()
        measures = {
            name: MeasureRecord(own.measures[name], own.sd[name], base.measures[name], unit_of_measure(name))
            for name in MEASURES
        }
        source = anthropometry(subject.sex).source
        return cls(subject.words, subject.sex, subject.age, subject.rules, measures, subject.parameters(), source)


def subject_listing(subject: Subject) -> str:
    """The table that `subject` prints: measures, then lengths and factors of the segments."""
    found, own, base = SubjectRecord.of(subject), Person.of(subject), base_person()
    lines = [f"{found.words[:1].upper()}{found.words[1:]}", "", f"{'':34}{'this person':>24}{'base person':>14}"]
    for name, m in found.measures.items():
        left = f" ± {1e3 * m.sd:.0f} mm" if m.unit == "m" else f" ± {m.sd:.1f} kg"
        value = f"{m.value:.3f} m" if m.unit == "m" else f"{m.value:.1f} kg"
        base_value = f"{m.base:.3f} m" if m.unit == "m" else f"{m.base:.2f} kg"
        lines.append(f"{name.replace('_', ' '):34}{value + (left if m.sd else ' measured'):>24}{base_value:>14}")
    lines += ["", f"{'factors of the body are made of':34}{'':24}{'':14}{'factor':>10}"]
    of_base = base.lengths()
    for name, length in own.lengths().items():
        lines.append(f"{name:34}{f'{length:.3f} m':>24}{f'{of_base[name]:.3f} m':>14}{length / of_base[name]:10.4f}")
    units = {BODY_MASS: " kg"}
    lines += ["", *(f"{name:34}{number:24.5g}{units.get(name, '')}" for name, number in found.parameters.items())]
    lines += [f"note: {line}" for line in subject.warnings]
    return "\n".join([*lines, "", f"Estimates (± one standard deviation): {found.source}"])
