"""What of Python a device may use: said before the compiler is asked, for every place at once.

The compiler's own refusals come one at a time and speak of its inner life; this list knows the constructs that people
reach for, and names the line and the way out."""

from __future__ import annotations

import ast
import builtins
import dis
import inspect
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from ...errors import nearest

WAY_OUT = (
    "a device computes with numbers, math, tuples, arrays of STATE and functions of its own; "
    "for what needs more take C: sprain-cosim brace new DIR --lang c"
)
STATEMENTS: dict[type[ast.AST], str] = {
    ast.Dict: "a dict",
    ast.DictComp: "a dict",
    ast.Set: "a set",
    ast.SetComp: "a set",
    ast.List: "a list",
    ast.ListComp: "a list",
    ast.GeneratorExp: "a generator",
    ast.JoinedStr: "a formatted text",
    ast.Lambda: "a lambda",
    ast.Yield: "a generator",
    ast.Try: "try",
    ast.With: "with",
    ast.ClassDef: "a class",
    ast.Import: "an import inside a function",
    ast.ImportFrom: "an import inside a function",
    ast.Global: "a global variable that changes",
    ast.Nonlocal: "a variable of an outer function that changes",
    ast.MatMult: "the matrix product @",
    ast.Match: "match",
    ast.Delete: "del",
}
NAMES = {
    "print": "print",
    "open": "a file",
    "input": "input",
    "eval": "eval",
    "exec": "exec",
    "getattr": "getattr",
    "setattr": "setattr",
    "dict": "a dict",
    "list": "a list",
    "set": "a set",
    "str": "text",
    "sorted": "sorted",
}
MODULES = {"random": "random numbers", "linalg": "numpy.linalg", "fft": "numpy.fft"}
FUNCTIONS_OF_MATH = {"gamma", "lgamma", "erf", "erfc"}


def problems(functions: Iterable[Callable[..., Any]], fields: Mapping[str, Collection[str]]) -> list[str]:
    """`device.py, line 12: print cannot be compiled` for every place in the functions and those that they call;
    `fields`: what each record has, by the name of the argument."""
    found: list[tuple[str, int, str]] = []
    for function in _reached(functions):
        path = Path(function.__code__.co_filename)
        for load in dis.get_instructions(function):
            known = load.argval in function.__globals__ or hasattr(builtins, str(load.argval))
            if load.opname == "LOAD_GLOBAL" and not known:
                line = load.positions.lineno if load.positions else None
                found.append((path.name, line or 0, f"{load.argval} is not defined"))
        try:
            lines, first = inspect.getsourcelines(function)
        except OSError:
            continue
        for node in ast.walk(ast.parse(textwrap.dedent("".join(lines)))):
            what = _refused(node)
            problem = f"{what} cannot be compiled" if what is not None else _no_field(node, fields)
            if problem is not None:
                found.append((path.name, first + getattr(node, "lineno", 1) - 1, problem))
    return [f"{name}, line {line}: {problem}" for name, line, problem in sorted(set(found))]


def _no_field(node: ast.AST, fields: Mapping[str, Collection[str]]) -> str | None:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in fields:
        known = fields[node.value.id]
        if node.attr not in known:
            return f"{node.value.id} has no {node.attr}{nearest(node.attr, known)}"
    return None


def _refused(node: ast.AST) -> str | None:
    for kind, what in STATEMENTS.items():
        if isinstance(node, kind) or (isinstance(node, ast.BinOp) and isinstance(node.op, kind)):
            return what
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return NAMES.get(node.func.id)
    if isinstance(node, ast.Attribute):
        if node.attr in FUNCTIONS_OF_MATH and isinstance(node.value, ast.Name) and node.value.id == "math":
            return f"math.{node.attr}"
        if isinstance(node.value, ast.Name) and node.value.id in ("np", "numpy", "random"):
            return MODULES.get(node.attr) or ("random numbers" if node.value.id == "random" else None)
    return None


def _reached(functions: Iterable[Callable[..., Any]]) -> list[FunctionType]:
    """The functions and those of the same package that they name, each once."""
    left: list[Any] = [getattr(f, "py_func", f) for f in functions]
    visited: list[FunctionType] = []
    while left:
        function = left.pop()
        if not isinstance(function, FunctionType) or function in visited:
            continue
        visited.append(function)
        package = function.__module__.partition(".")[0]
        for name in function.__code__.co_names:
            other = function.__globals__.get(name)
            if isinstance(other, ModuleType):
                candidates = [getattr(other, n, None) for n in function.__code__.co_names]
            else:
                candidates = [other]
            for candidate in candidates:
                plain = getattr(candidate, "py_func", candidate)
                if isinstance(plain, FunctionType) and plain.__module__.partition(".")[0] == package:
                    left.append(plain)
    return visited
