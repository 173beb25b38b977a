"""Studies as JSON, so that a ledger holds what it was made with and any machine reads it back. A file makes only the
classes named here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..cosim.master import Master
from ..errors import InputError
from ..scenario import Scenario
from ..scenario.wiring import Wiring
from ..subject.person import Subject
from ..units import Unit
from ..uq import distributions
from ..uq.exceedance import Bounds
from ..uq.measured import Measured
from .goal import Goal
from .marginals import Fitted
from .plan import Plan
from .population import Population
from .questions import Question
from .until import Until

STUDY = "Study"  # the name under which a plan stands in a file
CLASSES: dict[str, Any] = (
    {STUDY: Plan}
    | {
        kind.__name__: kind
        for kind in (
            Scenario,
            Master,
            Question,
            Goal,
            Until,
            Measured,
            Bounds,
            Fitted,
            Subject,
            Population,
            Wiring,
            Unit,
        )
    }
    | {
        kind.__name__: kind
        for kind in vars(distributions).values()
        if isinstance(kind, type) and dataclasses.is_dataclass(kind) and issubclass(kind, distributions.Marginal)
    }
)


def encode(value: Any) -> Any:
    """What json.dumps takes. A path becomes absolute."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            "!": STUDY if isinstance(value, Plan) else type(value).__name__,
            **{f.name: encode(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init},
        }
    if isinstance(value, Path):
        return {"!": "path", "value": str(value.absolute())}
    if isinstance(value, np.ndarray):
        return {"!": "array", "value": value.tolist()}
    if isinstance(value, tuple):
        return {"!": "tuple", "value": [encode(v) for v in value]}
    if isinstance(value, Mapping):
        return {"!": "map", "value": [[encode(k), encode(v)] for k, v in value.items()]}
    if isinstance(value, list):
        return [encode(v) for v in value]
    return value


def decode(content: Any) -> Any:
    """The inverse of `encode`. Raises InputError for anything else."""
    try:
        return _decoded(content)
    except (TypeError, ValueError, OverflowError, RecursionError) as problem:
        raise InputError(f"made by another version: {str(problem)[:200]}") from None


def _decoded(content: Any) -> Any:
    if isinstance(content, list):
        return [_decoded(v) for v in content]
    if not isinstance(content, dict):
        return content
    kind: Any = content.get("!")
    value: Any = content.get("value")
    if kind == "path":
        return Path(value)
    if kind == "array":
        return np.array(value, float)
    if kind == "tuple":
        return tuple(_decoded(v) for v in value)
    if kind == "map":
        return {_decoded(k): _decoded(v) for k, v in value}
    if isinstance(kind, str) and kind in CLASSES:
        try:
            return CLASSES[kind](**{k: _decoded(v) for k, v in content.items() if k != "!"})
        except (TypeError, ValueError) as problem:
            raise InputError(f"made by another version: {kind}: {problem}") from None
    raise InputError(f"made by another version: {kind!r} is not known")
