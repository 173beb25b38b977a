"""The dependency arrows: who may import whom."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "sprain_cosim"
ROW = re.compile(r"^\| (\d+) \| (.+?) \|", re.MULTILINE)


def floors() -> dict[str, int]:
    """{room: floor}, from the table that docs/architecture.md shows."""
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    return {room: int(number) for number, rooms in ROW.findall(page) for room in re.findall(r"`(\w+)`", rooms)}


def imports(path: Path, of_types: bool = False) -> set[str]:
    """Absolute names of the modules a file imports, wherever in the file, without those for type checkers only."""
    tree = ast.parse(path.read_text())
    package = (
        ["sprain_cosim", *path.relative_to(PACKAGE).parts[:-1]]
        if path.is_relative_to(PACKAGE)
        else [*path.relative_to(ROOT).parts[:-1]]
    )
    skipped = {
        n
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for n in ast.walk(node)
    }
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
    assert not [name for name in used if name.split(".")[0] in ("mujoco", "fmus")], (
        "the package meets the plant through FMI alone"
    )
    parts = path.relative_to(PACKAGE).parts
    if path.name == "__init__.py" and len(parts) == 1:
        return
    own = parts[0].removesuffix(".py")
    if own == "__main__":
        return
    rank = floors()
    assert own in rank, f"{own} has no floor in docs/architecture.md"
    if own == "uq":
        assert not [
            n
            for n in used
            if n.startswith("sprain_cosim") and not n.startswith(("sprain_cosim.uq", "sprain_cosim.errors"))
        ]
    for name in used:
        if name.startswith("sprain_cosim.") and name != "sprain_cosim.__version__":
            other = name.split(".")[1]
            assert other == own or rank[other] < rank[own], f"{own} must not import {other}"


@pytest.mark.parametrize("path", sources(ROOT / "fmus"), ids=lambda p: str(p.relative_to(ROOT)))
def test_fmus_do_not_know_the_package(path: Path) -> None:
    assert not [name for name in imports(path) if name.startswith("sprain_cosim")]


@pytest.mark.parametrize("path", sources(ROOT / "tools"), ids=lambda p: p.name)
def test_tools_do_not_know_the_tests(path: Path) -> None:
    assert not [name for name in imports(path) if name.split(".")[0] == "tests"]


def test_every_floor_exists() -> None:
    rooms = {p.stem for p in PACKAGE.glob("*.py")} | {p.parent.name for p in PACKAGE.glob("*/__init__.py")}
    assert set(floors()) == rooms - {"__init__", "__main__"}


# what lives as long as its module, beside constants and caches of pure functions, and who ends it
OWNED = {
    "fmu/messages.py": {"_logs"},  # the logger's senders, held weakly: each instance takes its entry with it
    "study/backends/dask.py": {"_workers"},  # the children of a Dask worker, by thread; `_release` ends them
}


def test_state_of_a_module_has_an_owner() -> None:
    """A module-level name bound to an empty container is state that grows."""
    found: dict[str, set[str]] = {}
    for path in sources(PACKAGE):
        for node in ast.parse(path.read_text("utf-8")).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                continue
            value = node.value
            called = isinstance(value, ast.Call) and not value.args and not value.keywords
            kind = ast.unparse(value.func).split(".")[-1] if isinstance(value, ast.Call) and called else ""
            empty = ast.unparse(value) in ("{}", "[]") or kind.split("[")[0] in (
                *("dict", "list", "set", "deque", "defaultdict"),
                *("WeakValueDictionary", "WeakKeyDictionary", "WeakSet", "local"),
            )
            if empty:
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found.setdefault(path.relative_to(PACKAGE).as_posix(), set()).update(map(ast.unparse, targets))
    assert found == OWNED


def test_types_ship() -> None:
    """PEP 561: without this file the annotations of an installed package do not count."""
    assert (PACKAGE / "py.typed").is_file()


def test_an_init_only_re_exports() -> None:
    for path in PACKAGE.glob("*/**/__init__.py"):
        assert all(
            isinstance(node, ast.Expr | ast.Import | ast.ImportFrom | ast.Assign)
            for node in ast.parse(path.read_text()).body
        ), path


def test_only_fmu_touches_fmpy() -> None:
    users = {
        p.relative_to(PACKAGE).as_posix()
        for p in sources(PACKAGE)
        if any(n.split(".")[0] == "fmpy" for n in imports(p))
    }
    assert {u.split("/")[0] for u in users} == {"fmu"}


def test_public_names() -> None:
    import sprain_cosim

    assert {n for n in dir(sprain_cosim) if not n.startswith("_")} == set(sprain_cosim.__all__) - {"__version__"}
    for name in sprain_cosim.__all__:
        assert getattr(sprain_cosim, name) is not None
    with pytest.raises(AttributeError):
        _ = sprain_cosim.nothing_of_that_name
