"""A trial of a study once more, from the study's folder alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..cosim.record import read_record
from ..cosim.result import Result
from ..errors import InputError
from ..process import Limits
from .folder import load_study_plan
from .ledger import Ledger, Row
from .manifest import level_then
from .plan import Plan
from .worker import Outcome, Worker


@dataclass(frozen=True)
class Replay:
    """A trial of a study once more.

    study    with the trial's inputs among its scenario's parameters
    row      what the ledger has of the trial
    outcome  how it ended now
    """

    study: Plan
    row: Row
    outcome: Outcome

    @property
    def same(self) -> bool:
        """Whether all numbers are the same to the bit."""
        return (self.outcome.status, self.outcome.metrics) == (self.row.outcome.status, self.row.outcome.metrics)

    @property
    def result(self) -> Result | None:
        """The record of the repetition; None when its process did not live to give one."""
        if not self.outcome.trajectory:
            return None
        record = read_record(self.outcome.trajectory, f"trial {self.row.trial}")
        return replace(record, message=self.outcome.message, wall=self.outcome.wall, **self.outcome.about)

    @property
    def inputs(self) -> dict[str, float]:
        """{"component.parameter": value in its own unit} of the inputs."""
        return dict(zip(self.study.names, self.row.inputs.tolist(), strict=True))

    @property
    def settings(self) -> dict[str, str | float]:
        """{"component.parameter": value with its unit} of the inputs."""
        return {
            name: f"{value!r} {self.study.units[name]}" if self.study.units[name] else value
            for name, value in self.inputs.items()
        }


def replay(folder: Path, trial: int, limits: Limits | None = None) -> Replay:
    """Runs a trial of a study's folder again, from the folder alone, in a child process. A trial that its limit of wall
    time ended has that limit again, where `limits` state no other. Raises InputError when there is no such trial, or an
    FMU has changed since."""
    with Ledger.read(folder) as ledger:
        study = load_study_plan(folder, ledger)
        row = ledger.row(trial)
        if row is None:
            numbers, _ = ledger.finished()
            have = f"it has {len(numbers)}, number {numbers[0]} to {numbers[-1]}" if len(numbers) else "it has none yet"
            raise InputError(f"{folder}: no trial {trial}; {have}")
    limits = limits or Limits()
    if limits.trial is None:
        ended = row.outcome.wall if row.outcome.status == "timeout" else 0.0
        limits = replace(limits, trial=ended or study.trial_limit)
    with Worker(study.scenario, study.names, limits, level_then(folder)) as worker:
        outcome = worker.run(row.inputs.tolist(), record=True)
    result = Replay(study, row, outcome)
    return replace(result, study=replace(study, scenario=study.scenario.with_inputs(result.inputs, result.settings)))
