"""What a system couples: an element with a name, connectors and capabilities, which can be opened. An FMU is one
(component.py), a law in Python another (python.py). Descriptions are frozen."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import Any

from ..errors import InputError, nearest
from ..notebook import Card, Rows
from ..units import Unit, quantity
from .instance import Instance

NUMBERS = ("real", "integer", "enumeration", "boolean")  # kinds that can be connected or set


@dataclass(frozen=True)
class Array:
    """An array of FMI 3, whose elements are connectors such as u[2,1]: indices from 1, the last runs fastest.

    name   of the variable
    shape  by the constants or the structural parameters' start values of its dimensions
    start  start values of all elements
    """

    name: str
    shape: tuple[int, ...]
    start: tuple[float, ...]

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def names(self) -> list[str]:
        """Of the elements, in the order in which FMI passes them."""
        places = itertools.product(*(range(1, n + 1) for n in self.shape))
        return [f"{self.name}[{','.join(map(str, place))}]" for place in places]


@dataclass(frozen=True)
class Connector:
    """One scalar variable, or one element of an array.

    name         as the FMU or the mapping file calls it
    reference    FMI's value reference
    causality    input, output, parameter, local, independent, calculatedParameter or structuralParameter
    kind         real, integer, boolean, enumeration, string, binary, clock or array
    unit         declared unit; None where none is declared
    start        start value in `unit`; None where there is none or it is not a number
    minimum      least allowed value, in `unit`
    maximum      greatest allowed value, in `unit`
    items        {name: value} of an enumeration
    description  text for people
    depends_on   inputs that act on this output directly; None: not declared, so all may
    fmi_type     the type's name in the version of FMI, such as Float64
    clocks       input clocks that alone change it
    interval     [s] between the ticks of an input clock that a run ticks; None for any other variable
    shift        [s] from the start of a run to its first tick
    negated      the FMU passes it with the other sign (a negated alias of FMI 1)
    array        of which it is an element; None for a variable of its own
    element      its place in the array, from 0
    parts        of an output that is their sum, in SI: the FMU's own outputs, each with the unit that takes it to SI
    """

    name: str
    reference: int
    causality: str
    kind: str
    unit: Unit | None = None
    start: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    items: Mapping[str, int] = field(default_factory=dict)
    description: str = ""
    depends_on: tuple[str, ...] | None = None
    fmi_type: str = "Real"
    clocks: tuple[str, ...] = ()
    interval: float | None = None
    shift: float = 0.0
    negated: bool = False
    array: Array | None = None
    element: int = 0
    parts: tuple[Connector, ...] = ()

    def __reduce__(self) -> tuple[type[Connector], tuple[Any, ...]]:
        """Without the defaults at the end: a child process is sent hundreds, and most say little."""
        values = tuple(vars(self).values())
        last = max((k for k in range(4, len(values)) if values[k] != _USUAL[k]), default=3)
        return Connector, values[: last + 1]

    @property
    def scalar_number(self) -> bool:
        """Whether it can be connected or set: not text, not an array, not a clock."""
        return self.kind in NUMBERS

    @property
    def labelled(self) -> str:
        """ "subtalar_angle [rad]"; the name alone where there is no unit."""
        return f"{self.name} [{self.unit.name}]" if self.unit and not self.unit.dimensionless else self.name

    def number(self, entry: float | str, what: str) -> float:
        """A value from a program: a number is in the connector's own unit already and stays as it is, a text such as
        "0.35 m" or a choice is read. Raises InputError for anything else, and as `value` does for kind and range."""
        if isinstance(entry, float) and self.kind == "real" and math.isfinite(entry):  # by the thousand
            return self._in_range(entry, what, entry)
        if isinstance(entry, str):
            return self.value(entry, what)
        unit = f" {self.unit.name}" if self.unit and not self.unit.dimensionless else ""
        if not isinstance(entry, Real) or (isinstance(entry, bool) and self.kind != "boolean"):
            raise InputError(f"{what} = {entry!r}: expected a number{unit and f' in{unit}, or a text with its unit'}")
        number = float(entry)
        if self.items and number not in self.items.values():
            raise InputError(f"{what} = {number:g}: must be one of {', '.join(self.items)}")
        if self.kind == "boolean" and number not in (0.0, 1.0):
            raise InputError(f"{what} = {number:g}: must be true or false")
        if not math.isfinite(number) or (self.kind != "real" and number != int(number)):
            kind = "finite" if self.kind == "real" else "whole"
            raise InputError(f"{what} = {number:g}{unit}: must be a {kind} number")
        return self._in_range(number, what, number)

    def value(self, entry: float | str | bool, what: str) -> float:
        """A value from a file or the command line in the connector's own unit. Raises InputError: unit, kind or
        range."""
        if self.items:
            if isinstance(entry, str) and entry in self.items:
                return float(self.items[entry])
            raise InputError(
                f"{what} = {entry!r}: must be one of "
                f"{', '.join(self.items)}{nearest(str(entry), self.items) if len(self.items) > 12 else ''}"
            )
        if self.kind == "boolean":
            if isinstance(entry, bool) or entry in (0, 1, "true", "false"):
                return float(entry in (True, 1, "true"))
            raise InputError(f"{what} = {entry!r}: must be true or false")
        if not self.scalar_number:
            raise InputError(f"{what}: {self.kind} parameters cannot be set")
        number = quantity(entry, self.unit, what)
        if self.kind != "real" and number != int(number):
            raise InputError(f"{what} = {entry!r}: must be a whole number")
        return self._in_range(number, what, entry)

    def _in_range(self, number: float, what: str, entry: float | str) -> float:
        if self.minimum <= number <= self.maximum:
            return number
        unit = f" {self.unit.name}" if self.unit and not self.unit.dimensionless else ""
        shown = f"{entry:.6g}{unit}" if isinstance(entry, float) else entry
        raise InputError(f"{what} = {shown}: outside its range {self.minimum:.6g} ... {self.maximum:.6g}{unit}")


SHORTEST_STEP, LONGEST_STEP = 1e-6, 1e4  # s

_USUAL = tuple(vars(Connector("", 0, "", "")).values())


@dataclass(frozen=True)
class Capabilities:
    """What an element can do, as it declares it.

    fmi_version       1.0, 2.0 or 3.0; "" for an element that is no FMU
    fixed_step        [s], its own step where it cannot take another one; None where it can
    state             its state can be saved and restored
    reusable          its reset is known to give a new instance
    tool              the program that made it
    model_exchange    it gives derivatives, and a solver here integrates them
    states            number of continuous states (FMI 2 model exchange)
    event_indicators  number of event indicators (FMI 2 model exchange)
    shared_modules    its Python modules have names that another FMU's may have as well: it needs a process of its own
    single            one instance per process
    variable_step     the communication step may change during a run
    continuous        its law is continuous in truth, though it has a fixed step; a mapping file says so
    event_mode        an FMI 3 FMU uses event mode
    early_return      an FMI 3 FMU may return before the end of a step
    """

    fmi_version: str
    fixed_step: float | None = None
    state: bool = False
    reusable: bool = False
    tool: str = ""
    model_exchange: bool = False
    states: int = 0
    event_indicators: int = 0
    shared_modules: bool = False
    single: bool = False
    variable_step: bool = True
    continuous: bool = False
    event_mode: bool = False
    early_return: bool = False

    def __post_init__(self) -> None:
        if self.fixed_step is not None and not SHORTEST_STEP <= self.fixed_step <= LONGEST_STEP:
            raise InputError(
                f"its own step of {self.fixed_step:g} s: must lie between {SHORTEST_STEP:g} s and {LONGEST_STEP:g} s; "
                "is its unit right?"
            )

    @property
    def interface(self) -> str:
        """Such as FMI 2.0 co-simulation."""
        return f"FMI {self.fmi_version} {'model exchange' if self.model_exchange else 'co-simulation'}"


@dataclass(frozen=True, repr=False)
class Element(Card, ABC):
    """What a system couples.

    name          its name in the system
    connectors    {name: connector} of all its variables
    capabilities  what it can do
    """

    name: str
    connectors: Mapping[str, Connector]
    capabilities: Capabilities

    def select(self, causality: str) -> dict[str, Connector]:
        """{name: connector} of one causality, in the order of the description."""
        return {n: c for n, c in self.connectors.items() if c.causality == causality}

    @cached_property
    def inputs(self) -> dict[str, Connector]:
        """What can be fed."""
        return self.select("input")

    @cached_property
    def outputs(self) -> dict[str, Connector]:
        """What can feed an input."""
        return self.select("output")

    @cached_property
    def parameters(self) -> dict[str, Connector]:
        """What may be set before a run."""
        return self.select("parameter")

    def card(self) -> tuple[str, Rows]:
        rows = [(kind, ", ".join(c.labelled for c in self.select(kind).values())) for kind in ("input", "output")]
        rows.append(("parameter", ", ".join(c.labelled for c in self.parameters.values())))
        return self.name, [(f"{kind}s", names or "none") for kind, names in rows]

    @abstractmethod
    def open(self) -> Instance:
        """A new instance, to be closed by the caller. Raises SimulationError or EnvironmentProblem."""


class Same:
    """An element as a part of a key: equal to itself alone. Descriptions of one content are one object, see
    mapping.read_component."""

    __slots__ = ("element",)

    def __init__(self, element: Element) -> None:
        self.element = element

    def __hash__(self) -> int:
        return id(self.element)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.element is self.element
