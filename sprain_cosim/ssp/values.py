"""Parameter sets (SSV) and their mappings (SSM): named values with units, renamed and transformed on their way to the
parameters of an FMU."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import InputError, nearest
from ..fmu.element import Connector
from ..units import BASE, Unit, unit
from .elements import NUMERALS, REALS, SSM, SSV, children, document, fitting, local

NUMBERS = (*REALS, *NUMERALS, "Boolean")
TRANSFORMATIONS = (
    "LinearTransformation",
    "BooleanMappingTransformation",
    "IntegerMappingTransformation",
    "EnumerationMappingTransformation",
)


@dataclass(frozen=True)
class Transformation:
    """What a value goes through, after any conversion of units.

    kind    element of SSP, such as LinearTransformation
    factor, offset  of a LinearTransformation: factor * value + offset
    table   {source: target} of the others, as text; what is not in it stays, as the standard says
    """

    kind: str
    factor: float = 1.0
    offset: float = 0.0
    table: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Assigned:
    """A value on its way.

    name            of the parameter that it is for
    kind            element of SSP: Real, Integer, Boolean, Enumeration, String, Binary
    text            as it is written
    unit            of a real number; None: that of the parameter
    transformation  None: none
    suppressed      whether the conversion of units is left out
    place           for messages
    """

    name: str
    kind: str
    text: str
    unit: Unit | None = None
    transformation: Transformation | None = None
    suppressed: bool = False
    place: str = ""

    def value(self, connector: Connector) -> float | str | bool:
        """As a scenario file has it: a number with the parameter's own unit, a name, true or false. Raises
        InputError."""
        what = f"{self.place}: {self.name}"
        if connector.items:
            return self._item(connector, what)
        if connector.kind == "boolean":
            return self._boolean(what)
        if self.kind not in (*REALS, *NUMERALS):
            raise InputError(f"{what}: is {self.kind} in the parameter set, {connector.kind} in the FMU")
        number = self._number(connector, what)
        if connector.kind != "real":
            if number != int(number):
                raise InputError(f"{what} = {number:g}: the FMU takes whole numbers only")
            return int(number)
        own = connector.unit
        return number if own is None or own.dimensionless else f"{number!r} {own.name}"

    def at(self, own: Unit) -> Assigned:
        """As a connector of a system carries it that states a unit. Raises InputError."""
        if self.kind not in (*REALS, *NUMERALS):
            return self
        carrier = Connector(self.name, 0, "parameter", "real", unit=own)
        return Assigned(
            self.name, "Real", repr(self._number(carrier, f"{self.place}: {self.name}")), own, place=self.place
        )

    def _number(self, connector: Connector, what: str) -> float:
        number = finite_number(self.text, what)
        if self.unit is not None and not self.suppressed:
            if connector.unit is None:
                raise InputError(f"{what}: has the unit {self.unit.name}, and the FMU declares none for it")
            if not self.unit.same_dimension(connector.unit):
                raise InputError(
                    f"{what}: {self.unit.name} ({self.unit.dimension()}) is not {connector.unit.name} "
                    f"({connector.unit.dimension()})"
                )
            if not self.unit.equivalent(connector.unit):
                number = connector.unit.from_base(self.unit.to_base(number))
        change = self.transformation
        if change is None:
            return number
        if change.kind == "LinearTransformation" and connector.kind == "real":
            return change.factor * number + change.offset
        if change.kind == "IntegerMappingTransformation" and self.kind in NUMERALS:
            return float(int(change.table.get(self.text, self.text)))
        raise InputError(f"{what}: {change.kind} does not belong to a value of type {self.kind}")

    def _boolean(self, what: str) -> bool:
        if self.kind != "Boolean":
            raise InputError(f"{what}: is {self.kind} in the parameter set, Boolean in the FMU")
        text = truth(self.text)
        if self.transformation is not None:
            if self.transformation.kind != "BooleanMappingTransformation":
                raise InputError(f"{what}: {self.transformation.kind} does not belong to a value of type Boolean")
            text = truth(self.transformation.table.get(text, text))
        return text == "true"

    def _item(self, connector: Connector, what: str) -> str:
        text, change = self.text, self.transformation
        if self.kind not in ("Enumeration", *NUMERALS):
            raise InputError(f"{what}: is {self.kind} in the parameter set, an enumeration in the FMU")
        if change is not None:
            if change.kind != f"{'Enumeration' if self.kind == 'Enumeration' else 'Integer'}MappingTransformation":
                raise InputError(f"{what}: {change.kind} does not belong to a value of type {self.kind}")
            text = change.table.get(text, text)
        if self.kind in NUMERALS:
            text = next((n for n, v in connector.items.items() if str(v) == text), text)
        if text not in connector.items:
            raise InputError(f"{what} = {text!r}: must be one of {', '.join(connector.items)}")
        return text


def parameter_set(data: bytes, place: str) -> list[Assigned]:
    """The values of a parameter set. Raises InputError."""
    return values_of(document(data, place, f"{{{SSV}}}ParameterSet"), place)


def set_name(data: bytes, place: str) -> str:
    """The name of a parameter set. Raises InputError."""
    return str(document(data, place, f"{{{SSV}}}ParameterSet").get("name"))


def values_of(tree: Any, place: str) -> list[Assigned]:
    """The values of an element ParameterSet. Raises InputError."""
    units, found = units_of(tree, place), list[Assigned]()
    for parameter in children(tree, "Parameters", "Parameter"):
        name = str(parameter.get("name"))
        typed = next((c for c in parameter if isinstance(c.tag, str) and local(c) != "Annotations"), None)
        if typed is None:
            raise InputError(f"{place}: {name}: has no value")
        if typed.get("value") is None or (local(typed) in NUMBERS and len(typed.get("value").split()) > 1):
            raise InputError(f"{place}: {name}: needs one value; arrays are not supported")
        given = unit_named(typed.get("unit"), units, f"{place}: {name}")
        found.append(Assigned(name, local(typed), str(typed.get("value")).strip(), given, place=place))
    twice = _twice(value.name for value in found)
    if twice:
        raise InputError(f"{place}: {', '.join(twice)}: two values in one parameter set; keep one")
    return found


def mapped_values(values: Sequence[Assigned], tree: Any, place: str) -> tuple[list[Assigned], list[str]]:
    """The values under the names that an element ParameterMapping gives them, and the names that it leaves out. Raises
    InputError."""
    named = {value.name: value for value in values}
    found, used = dict[str, Assigned](), set[str]()
    for entry in children(tree, "MappingEntry"):
        source, target = str(entry.get("source")), str(entry.get("target"))
        if source not in named:
            raise InputError(f"{place}: maps {source}, which the parameter set does not have{nearest(source, named)}")
        if target in found:
            raise InputError(f"{place}: two entries map to {target}; keep one")
        used.add(source)
        found[target] = replace(
            named[source],
            name=target,
            transformation=transformation_of(entry, f"{place}: {target}"),
            suppressed=truth(entry.get("suppressUnitConversion", "false")) == "true",
            place=place,
        )
    return list(found.values()), [name for name in named if name not in used]


def parameter_mapping(tree: Any, place: str) -> Any:
    """An element ParameterMapping of the namespace of SSM that stands inline. Raises InputError for anything else."""
    if tree.tag != f"{{{SSM}}}ParameterMapping":
        raise InputError(f"{place}: holds {local(tree)}, expected ParameterMapping of SSM")
    return fitting(tree, place)


def transformation_of(element: Any, place: str) -> Transformation | None:
    """Raises InputError."""
    found = next((c for c in element if isinstance(c.tag, str) and local(c) in TRANSFORMATIONS), None)
    if found is None:
        return None
    if local(found) == "LinearTransformation":
        factor, offset = finite_number(found.get("factor", "1"), place), finite_number(found.get("offset", "0"), place)
        return Transformation("LinearTransformation", factor, offset)
    read = truth if local(found) == "BooleanMappingTransformation" else str.strip
    entries = [(read(str(e.get("source"))), read(str(e.get("target")))) for e in children(found, "MapEntry")]
    table = dict(entries)
    if len(table) < len(entries):
        raise InputError(f"{place}: {local(found)} has two entries for {', '.join(_twice(s for s, _ in entries))}")
    return Transformation(local(found), table=table)


def units_of(tree: Any, place: str) -> dict[str, Unit]:
    """{name: unit} that a document defines. Raises InputError."""
    found: dict[str, Unit] = {}
    for element in children(tree, "Units", "Unit"):
        name = str(element.get("name"))
        base = next(iter(children(element, "BaseUnit")), None)
        if base is None:
            raise InputError(f"{place}: unit {name}: has no BaseUnit")
        what = f"{place}: unit {name}"
        exponents = tuple(int(finite_number(base.get(symbol, "0"), what)) for symbol in BASE)
        factor, offset = finite_number(base.get("factor", "1"), what), finite_number(base.get("offset", "0"), what)
        if not factor > 0:
            raise InputError(f"{what}: its factor {factor:g} must be positive")
        if name in found:
            raise InputError(f"{what}: is defined twice; keep one")
        found[name] = Unit(name, exponents, factor, offset)
    return found


def unit_named(name: str | None, units: Mapping[str, Unit], place: str) -> Unit | None:
    """Raises InputError for a unit that the document does not define, or not as what its name says."""
    if name is None:
        return None
    if not name:
        raise InputError(f"{place}: unit '' is not defined; name one, or leave the attribute out where there is none")
    if name not in units:
        raise InputError(f"{place}: unit {name!r} is not defined in this document's Units{nearest(name, units)}")
    own = units[name]
    try:
        usual = unit(name)
    except InputError:  # a name that says nothing
        return own
    same = math.isclose(own.factor, usual.factor, rel_tol=1e-6) and math.isclose(
        own.offset, usual.offset, rel_tol=1e-6, abs_tol=1e-12
    )
    if not same or own.exponents[:-1] != usual.exponents[:-1]:  # not every tool counts the radian
        raise InputError(
            f"{place}: unit {name} is defined as {_in_base(own)}, but {name} is {_in_base(usual)}; correct the "
            "definition, or give the unit another name"
        )
    return own


def _in_base(own: Unit) -> str:
    return f"{own.factor:g} {own.dimension()}{f' + {own.offset:g}' if own.offset else ''}"


def finite_number(text: str, place: str) -> float:
    """Raises InputError for what is no finite number."""
    try:
        number = float(text)
    except ValueError:
        raise InputError(f"{place}: {text!r} is no number") from None
    if "_" in text or not text.isascii():  # which Python reads, and XML does not
        raise InputError(f"{place}: {text!r} is no number")
    if not math.isfinite(number):
        raise InputError(f"{place}: {text!r} must be finite")
    return number


def truth(text: str) -> str:
    """XML's four spellings of a truth value as true or false."""
    return {"1": "true", "0": "false"}.get(text.strip(), text.strip())


def _twice(names: Iterable[str]) -> list[str]:
    return [name for name, count in Counter(names).items() if count > 1]
