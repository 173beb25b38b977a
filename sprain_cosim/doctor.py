"""What `sprain-cosim doctor` finds out about the installation."""

from __future__ import annotations

import importlib.metadata
import platform

from . import processor
from .errors import EnvironmentProblem, SprainError
from .fmu import cache
from .fmu.build.built import PACKAGES, version
from .fmu.build.link import PLATFORMS, has_compiler
from .machine.here import SYSTEM
from .sandbox.kernel import offered

REQUIRED = ("fmpy", "numpy", "scipy", "pandas", "matplotlib", "click")

Finding = tuple[bool, str, str]


def findings() -> list[Finding]:
    """(ok, what, detail) rows."""
    found: list[Finding] = [
        (True, "python", f"{platform.python_version()} on {platform.platform()}, {SYSTEM.cores()} cores"),
        (True, "processor", f"the FMUs run code for {processor.level() or 'a processor that is not known'}"),
    ]
    for name in REQUIRED:
        try:
            found.append((True, name, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:
            found.append((False, name, f"not installed; run `pip install {name}`"))
    found += [_build(), _cache(), _sandbox()]
    if all(ok for ok, _, _ in found):
        found += [*_fmus(), _landing()]
    return found


def _build() -> Finding:
    """Never a reason to fail: to run FMUs nothing of it is needed."""
    versions = {name: version(name) for name in PACKAGES}
    missing = [name for name, found in versions.items() if found is None]
    if missing:
        return True, "build", f"{', '.join(missing)} not installed: FMUs run, Python devices cannot be compiled"
    places = [name for name in PLATFORMS if all(map(has_compiler, PLATFORMS[name].slices))]
    return (
        True,
        "build",
        f"{', '.join(f'{name} {found}' for name, found in versions.items())}; C compilers for "
        f"{', '.join(places) or 'no platform'}",
    )


def _cache() -> Finding:
    try:
        folder = cache.writable()
    except EnvironmentProblem as problem:
        return False, "cache", str(problem)
    return True, "cache", str(folder)


def _sandbox() -> Finding:
    """Never a reason to fail: without a sandbox everything runs, less protected."""
    offer = offered()
    gaps = offer.gaps()
    if not gaps:
        return True, "sandbox", f"{offer}: files, network, signals, processes are held"
    return True, "sandbox", f"{offer}; not protected: {'; '.join(gaps)}"


def _fmus() -> list[Finding]:
    from .fmu.component import Component
    from .shipped import FMUS, has_library_here, shipped_fmus

    names = shipped_fmus()
    if not names:
        return [(False, "FMUs", "none built; run `sprain-cosim build`")]
    rows: list[Finding] = []
    for name in names:
        if not has_library_here(name):
            rows.append((True, name, "for Linux alone"))
            continue
        try:
            component = Component.read(name, FMUS / f"{name}.fmu")
            rows.append(
                (
                    True,
                    name,
                    f"FMI {component.capabilities.fmi_version}, {len(component.connectors)} variables, "
                    f"{component.guid[:12]}",
                )
            )
        except SprainError as problem:
            rows.append((False, name, str(problem)))
    return rows


def _landing() -> Finding:
    from .scenario import load_scenario

    try:
        with load_scenario("incline30").open() as session:
            session.run()
            result = session.run()
    except SprainError as problem:
        return False, "landing", str(problem)
    if result.status != "completed":
        return False, "landing", result.message
    return (
        True,
        "landing",
        f"peak subtalar angle {result.metrics['peak_subtalar_angle_deg']:.1f} deg in {1e3 * result.wall:.0f} ms",
    )
