"""A study as users have it: its plan, and `run`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError
from ..process import Limits
from ..units import proportion, seconds, whole_number
from . import runner
from .campaign import Campaign
from .plan import Plan
from .progress import Progress, shown_to
from .shards import as_shard
from .trajectories import FIRST

MOST_WORKERS = 1024  # processes of one study on one machine


@dataclass(frozen=True, repr=False)
class Study(Plan):
    """A plan that runs.

    >>> import sprain_cosim as sc
    >>> campaign = sc.load_study("study6").run(trials=8, seed=7, workers=1, out="runs/s6")
    >>> campaign.summary.n_completed, campaign.trials.attrs["units"]["peak_subtalar_angle_deg"]
    (8, 'deg')
    """

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
        shard: tuple[int, int] | str | None = None,
        rows: int | None = None,
        resume: bool = False,
        max_failed: float | str = 0.01,
        trial_limit: float | str | None = None,
        limits: Limits | None = None,
        progress: Progress | str | None = "auto",
        trajectories: int = FIRST,
        parquet: bool = False,
        command: str = "",
    ) -> Campaign:
        """Runs what the folder `out` lacks of the study.

        trials        in place of the plan's number; `seed`, `method` and `until` ("p95 0.5 deg") likewise
        out           the folder; None: nothing is kept
        workers       processes; None: one per core
        scheduler     address of a Dask scheduler, or local-cluster; None: processes of this machine
        shard         (k, n) or "k/n": the k-th of n parts, from 1; None: all trials
        rows          the first so many trials of a sample alone; `resume` goes on with more; None: all
        resume        the folder may hold the study already
        max_failed    share of failed trials that is accepted, 0.01 or "1 %"
        trial_limit   wall time of a trial, "20 s" or a number in seconds; None: the plan's
        limits        of a trial and of its process in full
        progress      "auto": a bar on a terminal or under a notebook's cell, else silent; plain, json, none; or a
                      function of (finished, of, failed, seconds)
        trajectories  trials from the first on that are recorded, besides those of percentiles, extremes, failures and
                      searches
        parquet       writes trials.parquet as well
        command       what was typed, for the manifest

        Raises InputError before any trial, SimulationError when too many failed or a search met a failed trial. An
        interrupt ends the workers; what is finished is in the folder, and `resume` continues."""
        limit = self.trial_limit if trial_limit is None else seconds(trial_limit, "trial_limit")
        if limit is not None and limit <= 0.0:
            raise InputError(f"trial_limit = {trial_limit!r}: must be positive")
        plan = replace(
            self.with_until([until] if isinstance(until, str) else until, method),
            trials=self.trials if trials is None else whole_number(trials, "trials", 1),
            seed=self.seed if seed is None else whole_number(seed, "seed", 0),
            method=self.method if method is None else method,
            trial_limit=limit,
        )
        return runner.run(
            plan,
            out=out,
            workers=None if workers is None else whole_number(workers, "workers", 1, MOST_WORKERS),
            scheduler=scheduler,
            shard=None if shard is None else as_shard(shard),
            rows=rows,
            resume=resume,
            max_failed=proportion(max_failed, "max_failed"),
            limits=limits,
            progress=shown_to(progress),
            trajectories=trajectories,
            parquet=parquet,
            command=command,
        )
