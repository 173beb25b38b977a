"""All the design points of an event that a modest number of evaluations can find.

One search from the origin can start on a ridge (4 − u₁² − 0.3u₂ ≤ 0: it runs along u₂ to β = 13 instead of 2) and knows
one design point where there may be several. Here the first search starts off-centre; then points on a sphere somewhat
beyond the design point ask whether the event is met, or nearly met, where no design point found so far explains it, and
new searches start from there.

The sphere test is a sample: in ten dimensions a second region that fills a small angle is easily missed, and what it
finds is no proof that there is nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..distributions import JointDistribution, Marginal, Normal
from ..distributions.marginal import as_array
from ..sampling import sobol
from .differences import Difference, check_differences
from .first_order import FormResult, search
from .limit_state import Event, LimitState
from .points import DEFAULT_BUDGET, Array, BudgetSpent, Evaluations, Function, PointLedger, Status

__all__ = ["SPHERE_POINTS", "DesignPoints", "design_points", "find_design_points"]

SPHERE_POINTS = 40

_OFF_CENTRE = 0.3  # length of the first start
_BEYOND = 0.75  # radius of the sphere test beyond the nearest design point
_RESTARTS = 4
_SAME = 0.2  # design points nearer to each other than this share of β are one
_MIRRORS = 3  # axes by which a design point is mirrored
_COVERED = 0.75  # α·u over β above which a design point explains a point of the event


@dataclass(frozen=True)
class DesignPoints:
    """Design points of an event, the nearest first.

    points       one result of a search each; at least one
    sphere       points of the sphere test; `unexplained` of them lie in the event where no design point is near
    evaluations  of the function
    """

    points: tuple[FormResult, ...]
    sphere: int
    unexplained: int
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]

    @property
    def nearest(self) -> FormResult:
        return self.points[0]


def design_points(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float | Marginal,
    correlation: ArrayLike | None = None,
    *,
    above: bool = False,
    sphere: int = SPHERE_POINTS,
    step: float = 1e-4,
    difference: Difference = "central",
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
    seed: int = 0,
) -> DesignPoints:
    """Design points of `function <= threshold` (`above`: `function > threshold`) from several starts.

    sphere  points of the sphere test; 20 to 60 are reasonable, 0 leaves it out

    Others as in `form`. An uncertain threshold is the last input of every point.
    """
    inputs = JointDistribution(marginals, correlation)
    inputs.require_slopes()
    check_differences(step, difference)
    state = LimitState(PointLedger(function, budget), inputs, Event(threshold, above))
    return find_design_points(state, sphere, step, difference, tolerance, seed)


def find_design_points(
    state: LimitState, sphere: int, step: float, difference: Difference, tolerance: float, seed: int
) -> DesignPoints:
    """The same on a limit state, whose ledger keeps every evaluation."""
    hunt = _Hunt(PointLedger(state), state.joint, step, difference, tolerance)
    reasons: list[str] = []
    unexplained = tested = 0
    hunt.from_start(hunt.first_start())
    try:
        origin = hunt.ledger.at(state.joint.from_standard(np.zeros(len(state.joint))))
        if sphere and hunt.found:
            directions = _directions(state.joint, sphere, seed, hunt.nearest.standard_point)
            radius = abs(hunt.nearest.beta) + _BEYOND
            margin = hunt.margins(radius * directions) * math.copysign(1.0, origin)
            tested = len(directions)
            for _ in range(_RESTARTS):
                start = hunt.candidate(directions, radius, margin, abs(origin))
                if start is None:
                    break
                hunt.from_start(start)
            unexplained = int(np.sum(hunt.unexplained(directions, radius) & (margin <= 0)))
    except BudgetSpent:
        reasons.append("the budget was spent before other design points could be looked for")
    points = tuple(sorted(hunt.found, key=lambda p: abs(p.beta))) or (hunt.failed[0],)
    if not hunt.found:
        reasons += [f"no design point was found: {r}" for r in points[0].reasons]
    if unexplained:
        reasons.append(
            f"{unexplained} of {tested} points on the sphere of radius {radius:.2f} lie in the event where no design "
            "point explains them: the event is larger than first order says"
        )
    return DesignPoints(
        points, tested, unexplained, state.ledger.evaluations(), "suspect" if reasons else "ok", tuple(reasons)
    )


@dataclass
class _Hunt:
    """Searches from several starts on one ledger; `found` are those that settled on different design points."""

    ledger: PointLedger
    joint: JointDistribution
    step: float
    difference: Difference
    tolerance: float

    def __post_init__(self) -> None:
        self.found: list[FormResult] = []
        self.failed: list[FormResult] = []
        self.tried: list[Array] = []

    @property
    def nearest(self) -> FormResult:
        return min(self.found, key=lambda p: abs(p.beta))

    def first_start(self) -> Array:
        """Off-centre, in a direction that is no diagonal and no axis."""
        active = self.joint.active
        pattern = 1.0 + np.sqrt(np.arange(len(active)) + 2.0) % 1.0
        start = np.zeros(len(self.joint))
        start[active] = _OFF_CENTRE * pattern / np.linalg.norm(pattern)
        return start

    def from_start(self, start: Array) -> None:
        self.tried.append(start)
        found = search(
            self.ledger,
            self.joint,
            0.0,
            start,
            self.step,
            self.difference,
            self.tolerance,
            # What u is off by across changes its distance by the square of that: the limit state needs no better.
            on_limit=max(1e-4 * self.tolerance, self.tolerance**2),
            known=self.is_known,
        )
        if found.status != "ok":
            self.failed.append(found)
        elif not self.is_known(found.standard_point):
            self.found.append(found)

    def is_known(self, u: Array) -> bool:
        """Whether u is near a design point found."""
        return any(np.linalg.norm(u - p.standard_point) < _SAME * max(1.0, abs(p.beta)) for p in self.found)

    def margins(self, points: Array) -> Array:
        return self.ledger(self.joint.from_standard(points))

    def unexplained(self, directions: Array, radius: float) -> np.ndarray:
        """Whether each point of the sphere lies where no design point found has its event."""
        explained = np.zeros(len(directions), dtype=bool)
        for p in self.found:
            toward = p.standard_point / (np.linalg.norm(p.standard_point) or 1.0)
            explained |= radius * directions @ toward >= _COVERED * abs(p.beta)
        return ~explained

    def candidate(self, directions: Array, radius: float, margin: Array, origin: float) -> Array | None:
        """Where another search should start: the unexplained point that comes nearest to the event, if it promises one
        at no more than one standard deviation beyond the nearest."""
        free = self.unexplained(directions, radius)
        for tried in self.tried[1:]:
            free &= directions @ tried < 0.8 * np.linalg.norm(tried)
        fall = origin - margin
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(fall > 0, radius * origin / fall, np.inf)
        reach = np.where(free, reach, np.inf)
        best = int(np.argmin(reach))
        limit = abs(self.nearest.beta) + 1.0 + _BEYOND
        return None if reach[best] > limit else min(float(reach[best]), radius) * directions[best]


def _directions(joint: JointDistribution, count: int, seed: int, point: Array) -> Array:
    """(n, d) unit vectors: the mirror images of a design point, by all axes and by each that matters, then a scrambled
    Sobol' sample of the sphere with its own mirror images."""
    active = joint.active
    mirrors = [-point]
    for k in np.argsort(-np.abs(point))[:_MIRRORS]:
        if abs(point[k]) > 0.3 * np.linalg.norm(point) and len(active) > 1:
            mirrored = point.copy()
            mirrored[k] *= -1.0
            mirrors.append(mirrored)
    mirrors = mirrors[: count if np.any(point) else 0]
    half = max((count - len(mirrors)) // 2, 0)
    u = np.zeros((0, len(active)))
    if half:
        u = sobol(JointDistribution([Normal(0.0, 1.0)] * len(active)), half, seed, replicates=1)
    if len(active) == 1:
        u = np.zeros((0, 1)) if mirrors else np.array([[1.0]])
    elif len(active) == 2:  # evenly round the circle, no point on an axis
        angle = math.pi * (np.arange(half) + 0.5 + 1.0 / math.sqrt(7.0)) / max(half, 1)
        u = np.column_stack([np.cos(angle), np.sin(angle)])
    directions = np.zeros((len(mirrors) + 2 * len(u), len(joint)))
    directions[: len(mirrors)] = np.reshape(mirrors, (-1, len(joint)))
    directions[len(mirrors) :, active] = np.concatenate([u, -u])
    return as_array(directions / np.linalg.norm(directions, axis=1, keepdims=True))
