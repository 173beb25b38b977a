"""sprain-cosim: co-simulation of single-leg landings with ankle braces as FMUs.

>>> import sprain_cosim as sc
>>> result = sc.load_scenario("incline30_brace").with_parameters(plant={"drop_height": "35 cm"}).run()
>>> round(result.metrics["peak_subtalar_angle_deg"], 1)
30.4
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from . import notebook

__version__ = "0.2.0"

_HOME = {
    "load_scenario": "scenario",
    "Scenario": "scenario",
    "load_study": "study.file",
    "open_folder": "folders.read",
    "Study": "study.study",
    "brace_from_csv": "brace.from_csv",
    "check_brace": "brace.check",
    "compare_braces": "brace.compare",
    "to_salib": "export.sample",
    "to_openturns": "export.sample",
    "System": "cosim.system",
    "Component": "fmu.component",
    "Driver": "fmu.driver",
    "PythonComponent": "fmu.python",
    "Master": "cosim.master",
    "Result": "cosim.result",
    "SprainError": "errors",
    "InputError": "errors",
    "SimulationError": "errors",
    "EnvironmentProblem": "errors",
}
__all__ = ["__version__", *sorted(_HOME)]

if TYPE_CHECKING:
    from .brace.check import check_brace as check_brace
    from .brace.compare import compare_braces as compare_braces
    from .brace.from_csv import brace_from_csv as brace_from_csv
    from .cosim.master import Master as Master
    from .cosim.result import Result as Result
    from .cosim.system import System as System
    from .errors import EnvironmentProblem as EnvironmentProblem
    from .errors import InputError as InputError
    from .errors import SimulationError as SimulationError
    from .errors import SprainError as SprainError
    from .export.sample import to_openturns as to_openturns
    from .export.sample import to_salib as to_salib
    from .fmu.component import Component as Component
    from .fmu.driver import Driver as Driver
    from .fmu.python import PythonComponent as PythonComponent
    from .folders.read import open_folder as open_folder
    from .scenario import Scenario as Scenario
    from .scenario import load_scenario as load_scenario
    from .study.file import load_study as load_study
    from .study.study import Study as Study


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used: the command line starts without numpy."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


def _draw(item: notebook.Plottable, kind: str) -> Any:
    return importlib.import_module(".figures.results", __name__).figure_of(item, kind)


notebook.draw = _draw


def __dir__() -> list[str]:
    return __all__
