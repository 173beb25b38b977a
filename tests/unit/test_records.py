"""Records go out as JSON and come back the same; a file that holds something else is named to the key."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.records import Record, Summary, finite, optional


@dataclass(frozen=True)
class Interval(Record):
    value: float | None
    ends: tuple[float | None, float | None] | None = optional()


@dataclass(frozen=True, eq=False)
class Found(Summary):
    title: str
    count: int
    done: bool = True
    peaks: Mapping[str, Interval] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    best: Interval | None = None
    anything: Any = None


FOUND = Found("x", 3, False, {"a": Interval(1.5, (0.0, None)), "b": Interval(None)}, ("p", "q"), Interval(2.0), [1])


def test_a_record_comes_back_the_same() -> None:
    text = json.dumps(FOUND.to_json(), allow_nan=False)
    again = Found.from_json(json.loads(text), "f.json")
    assert again == FOUND
    assert again.peaks["a"] == Interval(1.5, (0.0, None))
    assert again.names == ("p", "q")
    assert again.best == Interval(2.0)


def test_optional_keys_are_absent_and_others_are_null() -> None:
    assert Interval(None).to_json() == {"value": None}
    assert "best" in Found("x", 1).to_json()


def test_keys_with_a_default_may_be_missing_and_unknown_ones_are_passed_over() -> None:
    assert Found.from_json({"title": "x", "count": 1, "new": 5}, "f.json") == Found("x", 1)


def test_numbers_that_json_lacks_become_null() -> None:
    assert Interval(math.nan, (-math.inf, 1.0)).to_json() == {"value": None, "ends": [None, 1.0]}
    assert [finite(v) for v in (None, math.nan, math.inf, 2.0)] == [None, None, None, 2.0]


def test_a_summary_is_read_by_keys_too_and_travels() -> None:
    assert FOUND["peaks"]["a"] == {"value": 1.5, "ends": [0.0, None]}
    assert FOUND["title"] == FOUND.title
    assert "absent" not in FOUND
    assert dict(FOUND) == FOUND.to_json()
    assert replace(FOUND, count=4)["count"] == 4
    assert pickle.loads(pickle.dumps(FOUND)) == FOUND


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"title": None}, "f.json, title: must be a text"),
        ({"count": 1.5}, "f.json, count: must be a whole number"),
        ({"count": True}, "f.json, count: must be a whole number"),
        ({"done": 1}, "f.json, done: must be true or false"),
        ({"names": "p"}, "f.json, names: must be a list"),
        ({"names": [1]}, "f.json, names: must be a text"),
        ({"peaks": []}, "f.json, peaks: must be an object"),
        ({"peaks": {"a": 1}}, "f.json, peaks, a: must be an object"),
        ({"peaks": {"a": {}}}, "f.json, peaks, a: lacks value"),
        ({"peaks": {"a": {"value": "1"}}}, "f.json, peaks, a, value: must be a number"),
        ({"peaks": {"a": {"value": 1, "ends": [1]}}}, "f.json, peaks, a, ends: must be a list of 2"),
    ],
)
def test_what_does_not_fit_is_named(changed: dict[str, Any], place: str) -> None:
    with pytest.raises(InputError) as caught:
        Found.from_json(FOUND.to_json() | changed, "f.json")
    assert str(caught.value) == place
    with pytest.raises(InputError, match=r"f\.json: must be an object"):
        Found.from_json([FOUND.to_json()], "f.json")
