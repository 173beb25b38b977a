"""The dependency arrows: who may import whom."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "sprain_cosim"
# from the bottom up: a module may import what stands before it, and its own level where the list groups modules
LEVELS = [
    {"errors"},
    {"units"},
    {"archive", "export"},
    {"component", "contract"},
    {"system"},
    {"mapping"},
    {"coupling"},
    {"metrics"},
    {"result"},
    {"isolation"},
    {"isolated"},
    {"master"},
    {"scenario"},
    {"plots"},
    {"runfolder"},
    {"uq"},
    {"doctor"},
    {"brace"},
    {"folders"},
    {"gallery"},
    {"report"},
    {"landing"},
    {"animate", "storage", "reproduce"},
    {"validation"},
    {"cli"},
    {"__main__", "__init__"},
]
NUMERICS = {"distributions", "sampling", "reliability", "sensitivity", "statistics"}


def imports(path: Path, of_types: bool = False) -> set[str]:
    """Absolute names of the modules a file imports, wherever in the file, without those for type checkers only."""
    tree = ast.parse(path.read_text())
    package = ["sprain_cosim", *path.relative_to(PACKAGE).parts[:-1]] if path.is_relative_to(PACKAGE) else ["fmus", *path.relative_to(ROOT / "fmus").parts[:-1]]
    skipped = {n for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) for n in ast.walk(node)}
    found = set()
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{stem}.{alias.name}" if node.module is None else stem for alias in node.names}
    return found


def sources(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*.py") if "__pycache__" not in p.parts)


@pytest.mark.parametrize("path", sources(PACKAGE), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_arrows_point_downwards(path: Path) -> None:
    used = imports(path)
    assert not [name for name in used if name.split(".")[0] in ("mujoco", "fmus")], "the package meets the plant through FMI alone"
    parts = path.relative_to(PACKAGE).parts
    if path.name == "__init__.py" and len(parts) == 1:
        return
    own = parts[0].removesuffix(".py")
    if own == "uq" and path.stem in NUMERICS:
        assert not [n for n in used if n.startswith("sprain_cosim") and not n.startswith(("sprain_cosim.uq", "sprain_cosim.errors"))]
        return
    rank = {name: k for k, level in enumerate(LEVELS) for name in level}
    assert own in rank, f"{own} has no place in LEVELS"
    for name in used:
        if name.startswith("sprain_cosim.") and name != "sprain_cosim.__version__":
            other = name.split(".")[1]
            assert other == own or rank[other] < rank[own], f"{own} must not import {other}"


@pytest.mark.parametrize("path", sources(ROOT / "fmus"), ids=lambda p: str(p.relative_to(ROOT)))
def test_fmus_do_not_know_the_package(path: Path) -> None:
    assert not [name for name in imports(path) if name.startswith("sprain_cosim")]


def test_only_component_touches_fmpy() -> None:
    users = {p.relative_to(PACKAGE).as_posix() for p in sources(PACKAGE) if any(n.split(".")[0] == "fmpy" for n in imports(p))}
    assert {u.split("/")[0] for u in users} == {"component"}


def test_public_names() -> None:
    import sprain_cosim

    assert {n for n in dir(sprain_cosim) if not n.startswith("_")} == set(sprain_cosim.__all__) - {"__version__"}
    for name in sprain_cosim.__all__:
        assert getattr(sprain_cosim, name) is not None
    with pytest.raises(AttributeError):
        _ = sprain_cosim.nothing_of_that_name
