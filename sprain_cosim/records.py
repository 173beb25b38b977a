"""Frozen dataclasses that a JSON object holds, written and read by the types of their fields.

A field is always written, and must be there when it is read unless it has a default; one that is `optional()` is left
out while it is None. None is JSON's null: a number that is not known, NaN and infinity included. Keys that a class does
not know are passed over, so that a later version may add some."""

from __future__ import annotations

import math
import sys
import types
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, field, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from .errors import InputError

FORMAT = 2  # of summary.json and compare.json; the files of version 0.1 have none and are read as well
T = TypeVar("T")
KINDS: Mapping[Any, tuple[tuple[type, ...], str]] = {  # what JSON may hold for a type, in words
    float: ((int, float), "a number"),
    int: ((int,), "a whole number"),
    str: ((str,), "a text"),
    bool: ((bool,), "true or false"),
}
LARGEST: Mapping[Any, float] = {int: 2**128, float: sys.float_info.max}  # seeds are whole numbers of up to 128 bits


def ends_of(named: Mapping[str, float] | None) -> tuple[float, float] | None:
    """The least and the greatest of named numbers; None where there are none."""
    return (min(named.values()), max(named.values())) if named else None


def named_differences(one: Mapping[str, float] | None, other: Mapping[str, float] | None) -> dict[str, float]:
    """{name: the number of `one` minus that of `other`} of the names that both have."""
    return {name: value - other[name] for name, value in (one or {}).items() if other and name in other}


def known_format(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """The content of a summary.json or compare.json. Raises InputError for a file of a later version than this one."""
    found = content.get("format", 1)
    if not isinstance(found, int) or found > FORMAT:
        raise InputError(
            f"{path}: has format {found!r}, this version reads up to {FORMAT}; install a newer sprain-cosim"
        )
    return content


def optional() -> Any:
    """A field that its JSON object lacks while it is None."""
    return field(default=None, metadata={"optional": True})


def finite(value: float | None) -> float | None:
    """The number, or None for one that JSON does not have."""
    return None if value is None or not math.isfinite(value) else float(value)


class Record:
    """Base of such dataclasses; a class whose object is laid out in another way overrides both methods."""

    def to_json(self) -> dict[str, Any]:
        """What `json.dumps` takes."""
        held = ((f, getattr(self, f.name)) for f in fields(self))  # type: ignore[arg-type]
        return {f.name: _plain(value) for f, value in held if value is not None or not f.metadata.get("optional")}

    @classmethod
    def lacking(cls, content: Mapping[str, Any]) -> list[str]:
        """Keys that an object of this class must have and `content` lacks."""
        layout = _layout(cls)  # type: ignore[arg-type]
        return [name for name, entry, _ in layout if name not in content and _is_needed(entry)]

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        """The inverse. `place` names the object in messages: its file, then the keys that lead to it. Raises InputError
        for a key that is missing or holds something else than its type."""
        if not isinstance(content, dict):
            raise InputError(f"{place}: must be an object")
        for name in cls.lacking(content):
            raise InputError(f"{place}: lacks {name}")
        held = ((name, kind) for name, _, kind in _layout(cls) if name in content)  # type: ignore[arg-type]
        return cls(**{name: _typed(kind, content[name], f"{place}, {name}") for name, kind in held})


class Summary(Record, Mapping[str, Any]):
    """A record that scripts may also read like the JSON object it is: summary["responses"], `in`, `dict(summary)`."""

    @cached_property
    def _object(self) -> dict[str, Any]:
        return self.to_json()

    def __getitem__(self, key: str) -> Any:
        return self._object[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._object)

    def __len__(self) -> int:
        return len(self._object)


@cache
def _layout(cls: Any) -> list[tuple[str, Field[Any], Any]]:
    hints = get_type_hints(cls)
    return [(f.name, f, hints[f.name]) for f in fields(cls)]


def _is_needed(entry: Field[Any]) -> bool:
    return entry.default is MISSING and entry.default_factory is MISSING


def _plain(value: Any) -> Any:
    if isinstance(value, Record):
        return value.to_json()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return finite(value) if isinstance(value, float) else value


def _typed(kind: Any, content: Any, place: str) -> Any:
    """`content` as a value of the type `kind`: Any, a number, a text, a record, a mapping by texts, a tuple, or any of
    them or None."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any:
        return content
    if origin in (Union, types.UnionType):
        (some,) = (a for a in arguments if a is not type(None))
        return None if content is None else _typed(some, content, place)
    if kind in KINDS:
        allowed, name = KINDS[kind]
        if not isinstance(content, allowed) or (isinstance(content, bool) and kind is not bool):
            raise InputError(f"{place}: must be {name}")
        if isinstance(content, int | float) and abs(content) > LARGEST.get(kind, math.inf):
            raise InputError(f"{place}: is too large a number")
        return kind(content)
    if origin is tuple:
        each = arguments[:1] * len(content) if isinstance(content, list) and arguments[-1] is Ellipsis else arguments
        if not isinstance(content, list) or len(content) != len(each):
            raise InputError(f"{place}: must be a list" + ("" if arguments[-1] is Ellipsis else f" of {len(each)}"))
        return tuple(_typed(k, item, place) for k, item in zip(each, content, strict=True))
    if isinstance(kind, type) and issubclass(kind, Record):
        return kind.from_json(content, place)
    if not isinstance(content, dict):
        raise InputError(f"{place}: must be an object")
    return {key: _typed(arguments[1], item, f"{place}, {key}") for key, item in content.items()}
