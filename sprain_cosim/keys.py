"""Tables of keys: what a user may write in a file, described once.

From a table come the reader (`read`), the JSON Schema that ships (`schema`) and the page of the reference
(`reference`), so that none of the three can forget a key. A reader reports all problems of a file together, each with
its place; what needs more than one key to be judged is judged by the module that owns the file."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from .errors import InputError, nearest
from .units import Unit, quantity

MISSING: Any = object()  # in place of a value that could not be read
MEASURED = r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*\S+\s*$"  # a number and a unit


class Kind(Protocol):
    """What may stand behind a key."""

    @property
    def words(self) -> str:
        """The type, in the words of the reference."""

    @property
    def unit(self) -> str:
        """What the value is measured in; empty where it has no dimension."""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        """The value as the program takes it, or MISSING with a line more in `problems`; `place` names the key."""

    def schema(self) -> dict[str, Any]:
        """Its JSON Schema."""


class Value(NamedTuple):
    """A value that is read on its own.

    words  the type
    form   its JSON Schema
    take   (value, place) -> the value as the program takes it; raises InputError
    unit   what it is measured in
    """

    words: str
    form: Mapping[str, Any]
    take: Callable[[Any, str], Any]
    unit: str = ""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        try:
            return self.take(value, place)
        except InputError as problem:
            problems.append(str(problem))
            return MISSING

    def schema(self) -> dict[str, Any]:
        return dict(self.form)


def simple(
    words: str,
    form: Mapping[str, Any],
    fits: Callable[[Any], bool],
    says: str,
    convert: Callable[[Any], Any] = lambda value: value,
    unit: str = "",
) -> Value:
    """A value that `fits` accepts. `says` is the message for any other: `{at}` stands for the place, `{table}` for
    that of its table, `{value}` for the value."""

    def take(value: Any, place: str) -> Any:
        if not fits(value):
            raise InputError(_fill(says, at=place, table=place.rpartition(".")[0], value=repr(value)))
        return convert(value)

    return Value(words, form, take, unit)


def text(says: str = "{at}: must be text", **form: Any) -> Value:
    return simple("text", {"type": "string", **form}, lambda value: isinstance(value, str), says)


def flag() -> Value:
    return simple(
        "true or false", {"type": "boolean"}, lambda value: isinstance(value, bool), "{at}: must be true or false"
    )


def whole(least: int = 0, says: str = "{at} = {value}: must be a whole number, not negative") -> Value:
    return simple(
        "whole number", {"type": "integer", "minimum": least}, lambda value: is_whole(value) and value >= least, says
    )


def positive(says: str = "{at} = {value}: must be a positive number") -> Value:
    form = {"type": "number", "exclusiveMinimum": 0}
    return simple("number", form, lambda value: is_number(value) and value > 0, says)


def number(says: str = "{at}: must be a finite number") -> Value:
    return simple("number", {"type": "number"}, is_number, says, float)


def choice(names: Sequence[str]) -> Value:
    """One of few names."""
    words = " or ".join(names)
    return simple(words, {"enum": list(names)}, lambda value: value in names, f"{{at}} = {{value}}: must be {words}")


def measured(unit: Unit, above_zero: bool = False) -> Value:
    """A number with a unit, read to a number in `unit`."""

    def take(value: Any, place: str) -> float:
        read = quantity(value, unit, place)
        if above_zero and read <= 0:
            raise InputError(f"{place} = {value!r}: must be positive")
        return read

    return Value("quantity", {"type": "string", "pattern": MEASURED}, take, unit.name)


def raw(words: str, form: Mapping[str, Any], unit: str = "") -> Value:
    """A value that the owner of the file reads, since it needs more than the value itself."""
    return Value(words, form, lambda value, _: value, unit)


def is_number(value: Any) -> bool:
    """A finite number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


class Key(NamedTuple):
    """One key of a table.

    name     as it is written
    kind     what may stand behind it
    text     what it means: a sentence of the reference, and the schema's description
    default  what holds where the key is left out, as text
    needs    the message where the key is left out; empty: it may be left out
    """

    name: str
    kind: Kind
    text: str
    default: str = ""
    needs: str = ""


class Table(NamedTuple):
    """A table of known keys. `says` is the message for a value that is no table, `more` stands in the schema beside
    the keys (which of them exclude each other)."""

    keys: tuple[Key, ...]
    says: str = "{at}: must be a table, [{at}]"
    more: Mapping[str, Any] = {}
    words: str = "table"
    unit: str = ""
    others: Mapping[str, str] = {}  # {what people also call a key: the key}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(key.name for key in self.keys)

    def _meant(self, name: str) -> str:
        return f" (did you mean {self.others[name]}?)" if name in self.others else nearest(name, self.names)

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        if not isinstance(value, Mapping):
            problems.append(_fill(self.says, at=place))
            return MISSING
        problems += [_at(place, f"unknown key {name!r}{self._meant(name)}") for name in value if name not in self.names]
        found: dict[str, Any] = {}
        for key in self.keys:
            if key.name not in value:
                problems += [_at(place, key.needs)] if key.needs else []
                continue
            read = key.kind.read(value[key.name], f"{place}.{key.name}" if place else key.name, problems)
            if read is not MISSING:
                found[key.name] = read
        return found

    def schema(self) -> dict[str, Any]:
        needed = [key.name for key in self.keys if key.needs]
        return {
            "type": "object",
            "additionalProperties": False,
            **({"required": needed} if needed else {}),
            **self.more,
            "properties": {key.name: {**key.kind.schema(), "description": key.text} for key in self.keys},
        }


class Named(NamedTuple):
    """A table whose keys are names: of components, parameters, signals.

    label    how the reference writes a name
    value    what stands behind each
    pattern  of the names, for the schema
    known    all names there are; empty: any that fits the pattern
    strange  the message for a name that is none, with `{at}`, `{name}`, `{quoted}` and `{hint}`; empty: the owner
             judges names
    says     the message for a value that is no table
    """

    label: str
    value: Kind
    pattern: str = ""
    known: tuple[str, ...] = ()
    strange: str = ""
    says: str = "{at}: must be a table, [{at}]"
    words: str = "table"
    unit: str = ""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        if not isinstance(value, Mapping):
            problems.append(_fill(self.says, at=place))
            return MISSING
        found: dict[str, Any] = {}
        for name, entry in value.items():
            fits = name in self.known if self.known else not self.pattern or re.search(self.pattern, name)
            if self.strange and not fits:
                problems.append(
                    _fill(self.strange, at=place, name=name, quoted=repr(name), hint=nearest(name, self.known))
                )
            read = self.value.read(entry, f"{place}.{name}", problems) if fits or not self.known else MISSING
            if read is not MISSING:
                found[name] = read
        return found

    def schema(self) -> dict[str, Any]:
        names: dict[str, Any] = {"enum": list(self.known)} if self.known else {"pattern": self.pattern}
        return {"type": "object", "propertyNames": names, "additionalProperties": self.value.schema()}


class Short(NamedTuple):
    """A table, or for short the text of one of its keys: `x = "a"` for `x = { key = "a" }`."""

    key: str
    table: Table
    words: str = "text, or table"
    unit: str = ""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        return self.table.read({self.key: value} if isinstance(value, str) else value, place, problems)

    def schema(self) -> dict[str, Any]:
        short = next(key for key in self.table.keys if key.name == self.key)
        return {"anyOf": [{"type": "string", "description": f"{short.text}, as it is"}, self.table.schema()]}


class Tables(NamedTuple):
    """Several tables of the same keys: [[name]]."""

    table: Table
    words: str = "tables"
    unit: str = ""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        if not isinstance(value, list):
            problems.append(f"{place}: must be tables, [[{place}]]")
            return MISSING
        found = [self.table.read(entry, f"{place} {k}", problems) for k, entry in enumerate(value, 1)]
        return [entry for entry in found if entry is not MISSING]

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.table.schema()}


class Later(NamedTuple):
    """A table that the owner of the file reads, since that takes more than the table itself; the schema and the
    reference know it."""

    table: Table

    @property
    def words(self) -> str:
        return self.table.words

    @property
    def unit(self) -> str:
        return self.table.unit

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        return value

    def schema(self) -> dict[str, Any]:
        return self.table.schema()


class Either(NamedTuple):
    """A value or a table, which the owner of the file reads."""

    form: Mapping[str, Any]
    table: Table
    words: str
    unit: str = ""

    def read(self, value: Any, place: str, problems: list[str]) -> Any:
        return value

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [dict(self.form), self.table.schema()]}


class File(NamedTuple):
    """A file that users write.

    title  of the schema and of the section in the reference
    name   of the schema that ships: NAME.schema.json
    text   what the file is for: the first lines of the section
    table  its keys
    """

    title: str
    name: str
    text: str
    table: Table

    def schema(self) -> dict[str, Any]:
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"sprain-cosim {self.title}"}
        return head | self.table.schema()

    def reference(self) -> str:
        """Its section of the reference, as Markdown: one row a key."""
        rows = [
            f"| `{path}` | {_cell(kind.words)} | {_cell(kind.unit)} | {_cell(default)} | {_cell(meaning)} |"
            for path, kind, default, meaning in _rows(self.table, "")
        ]
        head = ["| Key | Type | Unit | Default | Meaning |", "|---|---|---|---|---|"]
        return "\n".join([f"## {self.title[0].upper()}{self.title[1:]}", "", self.text, "", *head, *rows, ""])


def _rows(table: Table, before: str) -> Iterator[tuple[str, Kind, str, str]]:
    for key in table.keys:
        yield from _row(key.kind, before + key.name, "needed" if key.needs else key.default, key.text)


def _row(kind: Kind, path: str, default: str, meaning: str) -> Iterator[tuple[str, Kind, str, str]]:
    if isinstance(kind, Named):
        yield from _row(kind.value, f"{path}.{kind.label}", default, meaning)
        return
    yield path, kind, default, meaning
    if isinstance(kind, Short | Tables | Later | Either):
        kind = kind.table
    if isinstance(kind, Table):
        yield from _rows(kind, f"{path}.")


def _fill(message: str, **parts: str) -> str:
    for name, part in parts.items():
        message = message.replace(f"{{{name}}}", part)
    return message


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _at(place: str, problem: str) -> str:
    return f"{place}: {problem}" if place else problem
