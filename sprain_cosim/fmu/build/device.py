"""A device as Python source: a folder with `interface.py` (what the FMU shows) and `device.py` (the law).

`device.py` holds plain functions; each takes what it names of

- `values`: one record of all variables by name, and of GROUPS of variables as arrays
- `state`: one record of what STATE names, at its start values when an instance is made
- `constants`: one record of what `constants(resources)` returns, at most
- `time`, `step` [s]: of the communication step; `time` alone outside of one

and returns nothing, or a position in REASONS (0: all is well) when it cannot go on:

- `initialise`: parameters and first inputs are set; leaves consistent outputs (default: `refresh`)
- `step`: from `time` to `time + step` with the inputs held; leaves consistent outputs (default: `refresh`)
- `refresh`: inputs were set: the outputs that follow them at once
- `reveal`: writes the local variables; called when one of them is read
- `restored`: a saved state came back; what stands in STATE from the field SAVED_BEFORE on did not
- `differentiate(values, state, seed, result)`: `result` is the derivative of the outputs in the direction `seed` of the
  inputs, both records like `values`

The same functions run as plain Python on any objects with these attributes; the FMU holds them compiled (compile.py).
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ...errors import InputError
from .description import PACKAGE, Variables, package, variables_of

FUNCTIONS = {
    "initialise": ("values", "state", "constants", "time", "step"),
    "step": ("values", "state", "constants", "time", "step"),
    "refresh": ("values", "state", "constants", "time", "step"),
    "reveal": ("values", "state", "constants", "time", "step"),
    "restored": ("values", "state", "constants", "time", "step"),
    "differentiate": ("values", "state", "constants", "seed", "result"),
}
KINDS = (np.dtype("f8"), np.dtype("i8"))


@dataclass(frozen=True)
class Reason:
    """A text of REASONS: `format` is for printf with one double, the number at `offset` [B] of the state; -1: none."""

    format: str
    offset: int


@dataclass(frozen=True)
class Device:
    """What was read from a device's folder.

    - `functions`: those of FUNCTIONS that it has, by name
    - `modules`: every module of its package, for the compiler
    - `values`, `state`: layout of the records; (n,) doubles in the order of the value references, and STATE
    - `first_state`: a record with the start values of STATE
    - `constants`: a record, or None
    - `saved`: bytes of the state that belong to a saved state
    - `constants_in_resources`: the FMU reads its constants when it is instantiated
    - `platforms`: those it can be built for; none named: all
    - `native`, `include`: functions of its own in C, of `native.c` beside device.py, and a folder of headers for it
    - `files`: {path in the FMU: content} that it adds
    - `experiment`: of its reference experiment (experiment.py): `step` [s], `steps`, `parameters`
    """

    name: str
    folder: Path
    variables: Variables
    functions: Mapping[str, Callable[..., Any]]
    modules: tuple[ModuleType, ...]
    values: np.dtype
    state: np.dtype
    first_state: np.ndarray
    constants: np.ndarray | None
    saved: int
    reasons: tuple[Reason, ...]
    constants_in_resources: bool
    platforms: tuple[str, ...] = ()
    native: tuple[str, ...] = ()
    include: Path | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)
    experiment: Mapping[str, Any] = field(default_factory=dict)

    def records(self) -> tuple[Any, Any, Any]:
        """(values, state, constants) of a fresh instance, to run the functions as plain Python."""
        values = np.recarray(1, dtype=self.values)
        values.view("f8")[:] = [v.get("start", 0.0) for v in self.variables]
        constants = None if self.constants is None else self.constants.view(np.recarray)[0]
        return values[0], self.first_state.copy().view(np.recarray)[0], constants


def arguments(function: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)


def read_device(folder: Path) -> Device:
    """Runs both files. Raises InputError in one line for what is at fault."""
    for needed in ("interface.py", "device.py"):
        if not (folder / needed).is_file():
            raise InputError(f"{folder}: no {needed}; a device's folder holds interface.py and device.py")
    with _imported(folder) as (interface, device, modules):
        variables = variables_of(interface, folder / "interface.py")
        groups: Mapping[str, Any] = getattr(device, "GROUPS", {})
        state, first = _state(folder, getattr(device, "STATE", {}))
        saved_before = getattr(device, "SAVED_BEFORE", None)
        if saved_before is not None and saved_before not in (state.names or ()):
            raise InputError(f"{folder / 'device.py'}: SAVED_BEFORE = {saved_before!r} is no field of STATE")
        saved = int((state.fields or {})[saved_before][1]) if saved_before else state.itemsize
        constants = _record(folder, "constants", device.constants(folder / "resources")) if _has(device) else None
        return Device(
            interface.MODEL,
            folder,
            variables,
            _functions(folder, device),
            modules,
            _values(folder, variables, groups),
            state,
            first,
            constants,
            saved if state.names else 0,
            tuple(_reason(folder, text, state) for text in getattr(device, "REASONS", ("",))),
            bool(getattr(device, "CONSTANTS_IN_RESOURCES", False)),
            tuple(getattr(device, "PLATFORMS", ())),
            tuple(getattr(device, "NATIVE", ())),
            getattr(device, "INCLUDE", None),
            device.files() if hasattr(device, "files") else {},
            _own_step(interface) | getattr(device, "EXPERIMENT", {}),
        )


def _has(device: ModuleType) -> bool:
    return hasattr(device, "constants")


def _own_step(interface: ModuleType) -> dict[str, Any]:
    return {"step": interface.FIXED_STEP} if hasattr(interface, "FIXED_STEP") else {}


@contextlib.contextmanager
def _imported(folder: Path) -> Iterator[tuple[ModuleType, ModuleType, tuple[ModuleType, ...]]]:
    """The modules interface and device of the folder, and all of their package."""
    with package(folder) as prefix:
        interface, device = (importlib.import_module(f"{prefix}.{name}") for name in ("interface", "device"))
        yield interface, device, tuple(m for n, m in sorted(sys.modules.items()) if n.startswith(f"{PACKAGE}."))


def _functions(folder: Path, device: ModuleType) -> dict[str, Callable[..., Any]]:
    found = {name: getattr(device, name) for name in FUNCTIONS if hasattr(device, name)}
    if not found:
        raise InputError(f"{folder / 'device.py'}: none of the functions {', '.join(FUNCTIONS)}")
    for name in ("initialise", "step"):
        if name not in found and "refresh" in found:
            found[name] = found["refresh"]
    problems = [
        f"{name} has an argument {argument!r}; it may have {', '.join(FUNCTIONS[name])}"
        for name, function in found.items()
        for argument in arguments(function)
        if argument not in FUNCTIONS[name] or (argument == "constants" and not _has(device))
    ]
    if problems:
        raise InputError(f"{folder / 'device.py'}: {'; '.join(problems)}")
    return found


def _values(folder: Path, variables: Variables, groups: Mapping[str, Any]) -> np.dtype:
    """Every variable by its name where that is an identifier, and the groups beside them, over the same numbers."""
    place = {v["name"]: 8 * k for k, v in enumerate(variables)}
    fields: dict[str, tuple[Any, int]] = {name: ("f8", at) for name, at in place.items() if name.isidentifier()}
    problems = []
    for label, members in groups.items():
        missing = [m for m in members if m not in place]
        if missing or label in place:
            problems.append(
                f"group {label!r}: {', '.join(missing)} is no variable" if missing else f"{label!r} is a variable"
            )
        elif [place[m] for m in members] != [place[members[0]] + 8 * k for k in range(len(members))]:
            problems.append(f"group {label!r}: its variables do not stand next to each other in interface.py")
        else:
            fields[label] = (("f8", (len(members),)), place[members[0]])
    if problems:
        raise InputError(f"{folder / 'device.py'}: GROUPS: {'; '.join(problems)}")
    formats, offsets = [f for f, _ in fields.values()], [at for _, at in fields.values()]
    return np.dtype(dict(names=list(fields), formats=formats, offsets=offsets, itemsize=8 * len(variables)))


def _state(folder: Path, declared: Any) -> tuple[np.dtype, np.ndarray]:
    if isinstance(declared, np.dtype):
        return declared, np.zeros(1, declared)
    record = _record(folder, "STATE", declared)
    return record.dtype, record


def _record(folder: Path, what: str, declared: Any) -> np.ndarray:
    """One record of numbers and arrays of numbers, from a mapping or a structured array."""
    if isinstance(declared, np.ndarray) and declared.dtype.names:
        return np.atleast_1d(declared)
    arrays = {name: np.asarray(value) for name, value in dict(declared).items()}
    arrays = {name: v.astype(KINDS[0] if v.dtype.kind == "f" else KINDS[1]) if v.dtype.kind in "fiub" else v
              for name, v in arrays.items()}  # fmt: skip
    wrong = [name for name, value in arrays.items() if value.dtype not in KINDS]
    if wrong:
        raise InputError(f"{folder / 'device.py'}: {what}: {', '.join(wrong)}: must be numbers or arrays of numbers")
    out = np.zeros(1, np.dtype([(name, v.dtype, v.shape) for name, v in arrays.items()], align=True))
    for name, value in arrays.items():
        out[name] = value
    return out


def _reason(folder: Path, text: str, state: np.dtype) -> Reason:
    """A text with at most one `{field}` or `{field:.6f}` of the state."""
    found = re.findall(r"\{(\w+)(?::(\.\d+[efg]))?\}", text)
    plain = text.replace("%", "%%") if found else text
    if not found:
        return Reason(plain, -1)
    name, form = found[0]
    kind = (state.fields or {}).get(name)
    if len(found) > 1 or kind is None or kind[0] != KINDS[0]:
        raise InputError(f"{folder / 'device.py'}: REASONS: {text!r} may show one number of STATE")
    return Reason(re.sub(r"\{[^}]*\}", f"%{form or 'g'}", plain), int(kind[1]))
