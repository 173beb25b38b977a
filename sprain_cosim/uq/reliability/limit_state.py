"""Events {function <= threshold} and {function > threshold}, whose threshold is a number or itself uncertain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..distributions import JointDistribution, Marginal
from ..distributions.marginal import as_array
from .points import Array, PointLedger

__all__ = ["Event", "LimitState"]


@dataclass(frozen=True)
class Event:
    """function <= threshold, or `above`: function > threshold. The threshold is independent of the inputs."""

    threshold: float | Marginal
    above: bool

    def __post_init__(self) -> None:
        if isinstance(self.threshold, Marginal):
            if self.threshold.is_fixed or self.threshold.is_discrete:
                raise ValueError("give a fixed threshold as a number; a threshold of several values is none")
        elif not math.isfinite(self.threshold):
            raise ValueError(f"the threshold must be finite, got {self.threshold}")

    def given(self, values: Array) -> Array:
        """P(event | function = value) for each value: 0 or 1 for a number."""
        if isinstance(self.threshold, Marginal):
            below = self.threshold.cdf(values)
            return below if self.above else 1.0 - below
        return as_array(values > self.threshold if self.above else values <= self.threshold)


class LimitState:
    """The margin of an event, (n, d) → (n,), at most zero in it; an uncertain threshold is the last of its inputs.

    ledger  the function's own evaluations, which a step of the threshold alone does not add to
    joint   inputs, and the threshold where it is uncertain
    """

    def __init__(self, ledger: PointLedger, inputs: JointDistribution, event: Event):
        self.ledger, self.inputs, self.event = ledger, inputs, event
        self.joint = inputs
        if isinstance(event.threshold, Marginal):
            correlation = None
            if inputs.correlation is not None:
                correlation = np.eye(len(inputs) + 1)
                correlation[:-1, :-1] = inputs.correlation
            self.joint = JointDistribution([*inputs.marginals, event.threshold], correlation)

    def __call__(self, points: Array) -> Array:
        points = np.atleast_2d(points)
        values = self.ledger(np.ascontiguousarray(points[:, : len(self.inputs)]))
        threshold = points[:, -1] if isinstance(self.event.threshold, Marginal) else self.event.threshold
        return as_array(threshold - values if self.event.above else values - threshold)
