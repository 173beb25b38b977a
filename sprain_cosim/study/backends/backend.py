"""What a backend is: it takes batches of jobs and gives back rows, in any order; nothing else of a study depends on
it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from ...process import Limits
from ...uq.distributions import Array
from ..ledger import Row
from ..worker import Openable


class Job(NamedTuple):
    """One trial.

    trial   its number
    values  (d,) its inputs, in the parameters' own units
    record  whether its trajectory is to be kept
    """

    trial: int
    values: Array
    record: bool = False


@dataclass(frozen=True)
class Task:
    """What all trials of a study share; picklable.

    scenario  what a child opens
    names     (d,) the parameters that a trial sets
    limits    of a trial and of its process
    level     of the processor, whose code every worker runs (processor.py); empty: the lowest of the workers
    """

    scenario: Openable
    names: tuple[str, ...]
    limits: Limits = field(default_factory=Limits)
    level: str = ""


class Backend(Protocol):
    """Order of the calls: (send* - receive)* - close, which may come at any moment and ends what runs."""

    batch: float  # s of work that one batch should hold
    level: str  # of the processor, whose code all workers run; empty where it is not known

    def workers(self) -> int:
        """How many trials run at a time, now."""

    def send(self, jobs: Sequence[Job]) -> None: ...

    def receive(self) -> list[Row]:
        """Waits until something is finished; an empty list now and then. Raises what stops a study: SimulationError,
        EnvironmentProblem."""

    def close(self) -> list[Row]:
        """Ends what runs; what had been finished."""
