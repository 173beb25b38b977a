"""A study as users have it: its plan, and `run`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..process import Limits
from . import runner
from .campaign import Campaign
from .dispatch import Progress
from .plan import Plan
from .trajectories import FIRST


@dataclass(frozen=True)
class Study(Plan):
    """A plan that runs: `load_study("study6").run(trials=200)`."""

    def run(
        self,
        *,
        trials: int | None = None,
        seed: int | None = None,
        method: str | None = None,
        until: str | Sequence[str] = (),
        out: Path | str | None = None,
        workers: int | None = None,
        scheduler: str | None = None,
        shard: tuple[int, int] | None = None,
        rows: int | None = None,
        resume: bool = False,
        max_failed: float = 0.01,
        limits: Limits | None = None,
        progress: Progress | None = None,
        trajectories: int = FIRST,
        parquet: bool = False,
        command: str = "",
    ) -> Campaign:
        """Runs the study with `trials`, `seed`, `method` and `until` ("p95 0.5 deg") in place of the plan's; the others
        are options of `runner.run`.

        Raises InputError before any trial, SimulationError when too many failed or a search met a failed trial."""
        plan = replace(
            self.with_until([until] if isinstance(until, str) else until, method),
            trials=self.trials if trials is None else trials,
            seed=self.seed if seed is None else seed,
            method=method or self.method,
        )
        return runner.run(
            plan,
            out=out,
            workers=workers,
            scheduler=scheduler,
            shard=shard,
            rows=rows,
            resume=resume,
            max_failed=max_failed,
            limits=limits,
            progress=progress,
            trajectories=trajectories,
            parquet=parquet,
            command=command,
        )
