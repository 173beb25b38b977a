"""A result as JSON and its numbers as bytes, for the line between two processes: what the other one says is checked,
never executed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from ..errors import InputError
from ..fmu.messages import Messages
from ..units import Unit
from .result import Held, Result

PIECE = 16 << 20  # B of numbers in a message
PLAIN = ("status", "message", "scheme", "scheme_reason", "warning", "coupling_error", "halved", "wall", "exchanges")
STATUSES = ("completed", "stopped", "failed")


def packed(result: Result, count: int) -> dict[str, Any]:
    """All but the numbers, which `pieces` gives, so many."""
    return {name: getattr(result, name) for name in PLAIN} | {
        "smallest_step": result.smallest_step,
        "names": result.names,
        "units": [None if u is None else [u.name, u.exponents, u.factor, u.offset] for u in result.units],
        "parameters": result.parameters,
        "held": {name: [getattr(held, f.name) for f in fields(Held)] for name, held in result.held.items()},
        "messages": {name: said.to_json() for name, said in result.messages.items()},
        "rows": len(result.time),
        "pieces": count,
    }


def pieces(result: Result) -> list[bytes]:
    """Time and values, row by row, as little-endian doubles."""
    data = np.column_stack([result.time, result.values]).astype("<f8").tobytes()
    return [data[k : k + PIECE] for k in range(0, len(data), PIECE)]


def unpacked(content: Mapping[str, Any], numbers: Sequence[bytes]) -> Result:
    """The result again from `packed` and `pieces`. Raises ValueError for anything that is none."""
    try:
        if content["status"] not in STATUSES:
            raise ValueError(f"status {content['status']!r}")
        names = tuple(str(name) for name in content["names"])
        data = np.frombuffer(b"".join(numbers), "<f8").astype(float)
        table = data.reshape(int(content["rows"]), len(names) + 1)
        units = tuple(None if u is None else Unit(u[0], tuple(u[1]), u[2], u[3]) for u in content["units"])
        if len(units) != len(names):
            raise ValueError("units")
        return Result(
            time=table[:, 0].copy(),
            values=table[:, 1:].copy(),
            names=names,
            units=units,
            parameters={str(name): float(value) for name, value in content["parameters"].items()},
            held={str(name): Held(*values) for name, values in content["held"].items()},
            messages={str(n): Messages.from_json(said, str(n)) for n, said in content["messages"].items()},
            smallest_step=float(content["smallest_step"]),
            **{name: content[name] for name in PLAIN},
        )
    except (KeyError, TypeError, IndexError, AttributeError, InputError) as problem:
        raise ValueError(str(problem)) from None
