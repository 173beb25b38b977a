"""What the rows of a study depend on: every field of its descriptions, files by their content.

A field that is new counts. One that changes no row is listed in `CHANGES_NO_ROW` with the reason, one that counts for
some methods only in `COUNTS_FOR`."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..cosim.master import Master
from ..fmu.cache import file_sha256
from ..scenario import Scenario
from .methods import SEARCHES

if TYPE_CHECKING:
    from .plan import Plan

CHANGES_NO_ROW = {
    "Plan.title": "a heading",
    "Plan.scenario": "its own fields stand in its place",
    "Plan.fits": "where a marginal comes from, which counts itself",
    "Plan.questions": "answered from the rows when they are done; what method form searches counts as its threshold",
    "Plan.half_width": "a stopping rule is judged when the trials are done",
    "Plan.until": "likewise; trials beyond those that it needs are kept",
    "Plan.trial_limit": "a trial that it ends is a row that says so, and runs again under a longer one",
    "Plan.published": "printed beside the results",
    "Plan.source": "where the description came from",
    "Plan.text": "the file as it was read, of which every key counts by itself",
    "Plan.warnings": "printed before the run",
    "Scenario.title": "a heading",
    "Scenario.changes": "for the heading; the changed fields count themselves",
    "Scenario.source": "where the description came from",
    "Scenario.warnings": "printed before the run",
    "Scenario.dropped": "what a device lacked, for the summary",
    "Scenario.isolate": "where a component runs; the numbers are the same to the bit",
    "Scenario.in_process": "as isolate",
}
COUNTS_FOR = {
    "responses": SEARCHES,  # the first: others choose what is summarised
    "trials": ("lhs", "sobol-indices", "design"),  # elsewhere a study that grows keeps its rows
    "replicates": ("sobol", "sobol-indices"),
    "levels": SEARCHES,
    "threshold": SEARCHES,
    "space": SEARCHES,
    "step": SEARCHES,
    "difference": SEARCHES,
    "tolerance": SEARCHES,
    "budget": SEARCHES,
    "goal": ("design",),
    "vary": ("design",),
    "check": ("form",),  # of levels, it comes after the method's own landings
}
DRAWING = "drawing"  # in the order of an identity; since 0.2.0
LONG = 10_000  # characters, above which a sequence counts by its hash


def identity(plan: Plan, files: Mapping[str, Mapping[str, str]] | None = None) -> dict[str, Any]:
    """{field: its value as JSON knows it}, the scenario's fields beside the plan's. `files` {"fmus" or "maps":
    {component: SHA-256}} stands for the content of the files; None: it is read. Raises OSError."""
    scenario = plan.scenario
    contents = files or {
        kind: {name: file_sha256(path) for name, path in getattr(scenario, kind).items()} for kind in ("fmus", "maps")
    }
    return {
        "version": __version__,
        "order": _order(plan),
        **_fields(
            scenario,
            "Scenario",
            {**contents, **_absent("subject", scenario.subject), **_absent("wiring", scenario.wiring)},
        ),
        **_fields(
            plan,
            "Plan",
            {name: None for name, methods in COUNTS_FOR.items() if plan.method not in methods}
            | _absent("population", plan.population),
        ),
        **({"replicates": plan.sequences} if plan.method in COUNTS_FOR["replicates"] else {}),
    } | _of_search(plan)


def _absent(name: str, value: Any) -> dict[str, None]:
    """A field that does not count where it is not there, so that identities of before stay as they are."""
    return {name: None} if value is None else {}


def _order(plan: Plan) -> dict[str, Any]:
    """Of the inputs' columns, and of their drawing where that is another."""
    order = {"components": list(plan.scenario.fmus), "inputs": list(plan.names)}
    drawn = [plan.names[k] for k in plan.drawing]
    return order if drawn == order["inputs"] else {**order, DRAWING: drawn}


def _of_search(plan: Plan) -> dict[str, Any]:
    """The first response alone, what form searches, and the tolerance that holds."""
    if plan.method not in SEARCHES:
        return {}
    limit = {"threshold": _plain(plan.limit)} if plan.method == "form" else {}
    return {"responses": plan.responses[0], "tolerance": plan.settling} | limit


def digest_of(identity: Mapping[str, Any]) -> str:
    """The SHA-256 of an identity."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


def changes(
    before: Mapping[str, Any],
    now: Mapping[str, Any],
    without: Collection[str] = (),
    words: tuple[str, str] = ("then", "now"),
) -> list[str]:
    """What differs between two identities, a line a field: "master.adaptive: 0.0 then, 0.001 now". `without`: fields
    that may differ; `words` for the two."""
    lines = []
    for key in dict.fromkeys([*before, *now]):
        if key not in without:
            lines += [
                f"{place}: {_short(one)} {words[0]}, {_short(other)} {words[1]}"
                for place, one, other in _differences(key, before.get(key), now.get(key))
            ]
    return lines


def _fields(description: Scenario | Plan, kind: str, replaced: Mapping[str, Any]) -> dict[str, Any]:
    """A field that `replaced` holds as None does not count, and is left out: a later one leaves older identities as
    they are."""
    return {
        field.name: replaced[field.name] if field.name in replaced else _plain(getattr(description, field.name))
        for field in dataclasses.fields(description)
        if f"{kind}.{field.name}" not in CHANGES_NO_ROW and replaced.get(field.name, field) is not None
    }


def _plain(value: Any) -> Any:
    """A value of a description as JSON knows it, the same for equal values. Raises TypeError for what has no such
    form."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence):
        plain = [_plain(entry) for entry in value]
        text = json.dumps(plain)
        return plain if len(text) <= LONG else f"SHA-256 {hashlib.sha256(text.encode()).hexdigest()}"
    if dataclasses.is_dataclass(value):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init}
        return fields if isinstance(value, Master) else {type(value).__name__: fields}
    raise TypeError(f"{type(value).__name__}: a study's description cannot hold this")


def _differences(place: str, one: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys([*one, *other]):
            yield from _differences(f"{place}.{key}", one.get(key), other.get(key))
    elif one != other:
        yield place, one, other


def _short(value: Any) -> str:
    """A hash shows its first digits."""
    text = "absent" if value is None else value if isinstance(value, str) else json.dumps(value)
    return text[:12] if len(text) == 64 and text.isalnum() else text if len(text) <= 60 else f"{text[:57]}..."
