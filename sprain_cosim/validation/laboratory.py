"""What checks measure with: landings and studies that are run once and shared, the summary figures, and what this
machine has."""

from __future__ import annotations

import importlib.util
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, SimulationError
from ..files import read_toml
from ..fmu.build.link import COMPILERS
from ..scenario import Scenario, Value, load_scenario
from ..shipped import FMUS, SOURCES, has_library_here
from ..study.file import load_study
from ..study.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from ..cosim.result import Result
    from ..study.campaign import Campaign

QUICK_TRIALS = 200  # of each study
MILLISECOND = 1e-3
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class Laboratory:
    """What a run of the suite shares between its checks.

    - quick: studies with QUICK_TRIALS trials instead of their own number.
    - workers: processes of a study; None: one for each processor.
    - reference: folder of the reference trajectories and trials, which are not part of the project (by default the
      environment variable SPRAIN_REFERENCE); None: the checks that need them say so.
    """

    def __init__(self, quick: bool = False, workers: int | None = None, reference: Path | None = None) -> None:
        self.quick, self.workers = quick, workers
        folder = os.environ.get("SPRAIN_REFERENCE")
        self.reference = reference or (Path(folder) if folder else None)
        self._tables: dict[str, pd.DataFrame] = {}
        self._runs: dict[Any, Result] = {}
        self._campaigns: dict[str, Campaign] = {}

    @cached_property
    def figures(self) -> dict[str, Any]:
        """Content of figures.toml."""
        return read_toml(Path(__file__).parent / "figures.toml")

    def run(
        self,
        name: str,
        overrides: Mapping[str, Value] | None = None,
        step: str | None = None,
        scheme: str | None = None,
        stop: str | None = None,
    ) -> Result:
        """A shipped scenario with other parameters; the same request is answered from memory. Raises SimulationError
        when it fails."""
        key = name, tuple(sorted((overrides or {}).items())), step, scheme, stop
        if key not in self._runs:
            self._runs[key] = self.land(scenario(name, overrides), step, scheme, stop)
        return self._runs[key]

    @staticmethod
    def land(chosen: Scenario, step: str | None = None, scheme: str | None = None, stop: str | None = None) -> Result:
        result = chosen.with_master(scheme, step, stop).run()
        if result.status != "completed":
            raise SimulationError(result.message)
        return result

    def campaign(self, name: str) -> Campaign:
        """A shipped study, with fewer trials in a quick run. A search runs as it is."""
        if name not in self._campaigns:
            study = self.study(name)
            trials = QUICK_TRIALS if self.quick and study.method == "monte-carlo" else None
            self._campaigns[name] = study.run(trials=trials, workers=self.workers)
        return self._campaigns[name]

    @staticmethod
    def study(name: str) -> Study:
        return load_study(name)

    def table(self, name: str) -> pd.DataFrame:
        """A table of the reference folder, read once; for checks that need "reference"."""
        import pandas as pd

        if self.reference is None:
            raise InputError(f"{name}: no folder of reference numbers (set SPRAIN_REFERENCE)")
        if name not in self._tables:
            self._tables[name] = pd.read_csv(self.reference / name)
        return self._tables[name]

    def missing(self, need: str) -> str:
        """Why `need` is not there, or ''."""
        return NEEDS[need](self)


def scenario(name: str, overrides: Mapping[str, Value] | None = None) -> Scenario:
    """A shipped scenario with other parameters; one for the brace adds the paper's brace where the scenario has
    none."""
    chosen = load_scenario(name)
    if any(key.startswith("brace.") for key in overrides or {}) and "brace" not in chosen.fmus:
        chosen = chosen.replace_fmu("brace", FMUS / "brace_bushing.fmu")
    for key, value in (overrides or {}).items():
        chosen = chosen.override(key, value)
    return chosen


def every_millisecond(result: Result) -> Result:
    """The record at whole milliseconds only, as the reference landings are sampled."""
    stride = round(MILLISECOND / (result.time[1] - result.time[0]))
    return replace(result, time=result.time[::stride], values=result.values[::stride])


def rms(difference: Any) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(difference, float)))))


def _compiler(_: Laboratory) -> str:
    return "" if any(map(shutil.which, COMPILERS)) else f"no C compiler ({', '.join(COMPILERS)}) on this machine"


def browser() -> str:
    """Path of a Chromium, or ''."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), "")


def _browser(_: Laboratory) -> str:
    return "" if browser() else f"no browser ({', '.join(BROWSERS)}) on this machine"


def _reference(laboratory: Laboratory) -> str:
    folder = laboratory.reference
    if folder is None:
        return "no reference trajectories and trials (set SPRAIN_REFERENCE)"
    there = (folder / "landing" / "index.csv").is_file()
    return "" if there else f"no reference trajectories and trials in {folder} (set SPRAIN_REFERENCE)"


def _clone(_: Laboratory) -> str:
    return (
        "" if (SOURCES / "plant" / "interface.py").is_file() else "needs a clone: the FMUs' sources are not installed"
    )


def _plant_mujoco(_: Laboratory) -> str:
    if (FMUS / "plant_mujoco.fmu").is_file() and has_library_here("plant_mujoco"):
        return ""
    return "no plant_mujoco.fmu, which is for 64-bit Linux; in a clone run `sprain-cosim build plant_mujoco`"


def _module(name: str, extra: str) -> Callable[[Laboratory], str]:
    return lambda _: (
        "" if importlib.util.find_spec(name) else f'{name} is not installed; pip install "sprain-cosim[{extra}]"'
    )


NEEDS: dict[str, Callable[[Laboratory], str]] = {
    "compiler": _compiler,
    "browser": _browser,
    "reference": _reference,
    "clone": _clone,
    "plant_mujoco": _plant_mujoco,
    "openturns": _module("openturns", "reliability"),
}
