"""Percentiles and failure probabilities from few evaluations: MV, AMV, AMV+, HMV and FORM.

Every method takes `function`, (n, d) inputs x → (n,) responses z, and d marginals. Points are handed over in
as few calls as the method allows, so that a caller can evaluate a batch in parallel. Results say what was
asked and what was executed (a point met twice is evaluated once), and carry a status:

    ok        nothing speaks against the answer
    suspect   use with care, `reasons` say why
    rejected  do not use: the response is not monotonic where the method needs it to be

Standard space: u is d independent standard normal variables, z(u) = function(x(u)); level p stands for β =
Φ⁻¹(p), and its design point u* is the extreme of (a model of) z on the sphere ‖u‖ = |β|: the lowest for p <
0.5, the highest for p > 0.5. Importance levels are α = u*/β, a unit vector that points to larger z (at p =
0.5: the gradient's direction at u = 0).

Sources: Y.-T. Wu, H. R. Millwater, T. A. Cruse, Advanced probabilistic structural analysis method for
implicit performance functions, AIAA J. 28 (1990) 1663-1669 (AMV, AMV+); B. D. Youn, K. K. Choi, Y. H. Park,
Hybrid analysis method for reliability-based design optimization, J. Mech. Des. 125 (2003) 221-232 (HMV); Y.
Zhang, A. Der Kiureghian, Two improved algorithms for reliability analysis, in Reliability and Optimization of
Structural Systems (1995) 297-304 (iHL-RF).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from .distributions import JointDistribution, Marginal

__all__ = [
    "Evaluations",
    "FormResult",
    "LevelResult",
    "SormResult",
    "amv",
    "amv_plus",
    "form",
    "form_exceedance",
    "hmv",
    "mean_value",
    "sorm",
    "step_noise",
]

Array = NDArray[np.float64]
Function = Callable[[Array], ArrayLike]
Difference = Literal["forward", "backward", "central"]
Space = Literal["x", "u"]
Status = Literal["ok", "suspect", "rejected"]

DEFAULT_LEVELS = (0.05, 0.5, 0.95)
DEFAULT_BUDGET = 2000

_CURVATURE_LIMIT = 0.5  # second-order share of the response at the outermost level
_DEPARTURE_LIMIT = 0.5  # |AMV − MV| over |MV − g0|
_TURN_LIMIT = math.radians(30.0)
_VARIANCE_LIMIT = 0.5  # linearised variance over sampled variance
_NOISE_LIMIT = 0.1  # error of the slopes from noise, over their norm


class Evaluations(int):
    """Number of evaluations requested, which an int is enough for; and what was executed.

    `executed` counts distinct points. `x` (executed, d) and `y` (executed,) are those points in the order of
    execution.
    """

    x: Array
    y: Array

    def __new__(cls, requested: int, x: Array, y: Array) -> Self:
        self = super().__new__(cls, requested)
        self.x, self.y = x, y
        return self

    @property
    def requested(self) -> int:
        return int(self)

    @property
    def executed(self) -> int:
        return len(self.y)


@dataclass(frozen=True)
class LevelResult:
    """Percentiles of the response at probability levels.

    value[p]         z_p, in the response's unit
    importance[p]    (d,) unit vector α; 0 for fixed inputs
    design_point[p]  (d,) physical inputs x*
    mean, sd         mean and standard deviation of the linearisation at the mean inputs
    gradient         (d,) ∂z/∂x at the mean inputs by finite differences
    linear_importance  (d,) importance levels of that linearisation alone, before any level is looked at
    iterations[p]    relinearisations (1 for MV and AMV)
    evaluations      requested (the int itself), .executed, .x, .y
    status, reasons  verdict of the gate, see the module
    """

    method: str
    value: dict[float, float]
    importance: dict[float, Array]
    design_point: dict[float, Array]
    mean: float
    sd: float
    gradient: Array
    linear_importance: Array
    iterations: dict[float, int]
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class FormResult:
    """First-order reliability of the event `function <= threshold`.

    beta          reliability index: distance of the design point from the origin of the standard space,
                  negative where the median inputs already lie in the event
    probability   Φ(−beta)
    alpha         (d,) unit vector with u* = beta·alpha; points to smaller values of the function
    importance    (d,) alpha²
    design_point  (d,) physical inputs x*; `standard_point` (d,) is u*
    """

    beta: float
    probability: float
    alpha: Array
    importance: Array
    design_point: Array
    standard_point: Array
    iterations: int
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]


class _BudgetSpent(Exception):
    pass


@dataclass
class _Ledger:
    """The function with a memory: counts what is asked, executes each distinct point once."""

    function: Function
    budget: int | None = None
    requested: int = 0
    known: dict[bytes, float] = field(default_factory=dict)
    x: list[Array] = field(default_factory=list)

    def __call__(self, points: Array) -> Array:
        points = np.atleast_2d(points) + 0.0  # −0 and 0 are one point
        keys = [row.tobytes() for row in points]
        fresh = {key: row for key, row in zip(keys, points, strict=True) if key not in self.known}
        if self.budget is not None and len(self.known) + len(fresh) > self.budget:
            raise _BudgetSpent
        self.requested += len(points)
        if fresh:
            rows = np.array(list(fresh.values()))
            values = np.asarray(self.function(rows), dtype=float)
            if values.shape != (len(rows),):
                raise ValueError(f"the function must return shape ({len(rows)},), it returned {values.shape}")
            for row, value in zip(rows, values, strict=True):
                if not math.isfinite(value):
                    raise ValueError(f"the function returned {value} at x = {row.tolist()}")
                self.known[row.tobytes()] = float(value)
                self.x.append(row)
        return np.array([self.known[key] for key in keys])

    def at(self, point: Array) -> float:
        return float(self(point)[0])

    def evaluations(self) -> Evaluations:
        return Evaluations(self.requested, np.array(self.x), np.array(list(self.known.values())))


@dataclass(frozen=True)
class _Slopes:
    """Value and derivatives of the function at one point.

    gradient (d,) ∂z/∂x; curvature (d,) ∂²z/∂x² by axis, or None from one-sided differences; moved: the
    largest change of z over the steps of each input (d,); resolution: the power of ten that every value met is
    a multiple of (to 0.0001), or None.
    """

    value: float
    gradient: Array
    curvature: Array | None
    moved: Array
    resolution: float | None


def _resolution(values: Array) -> float | None:
    for digits in range(5):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-9 * np.maximum(np.abs(scaled), 1.0)):
            return 10.0**-digits
    return None


def _differences(ledger: _Ledger, joint: JointDistribution, x: Array, step: float, how: Difference) -> _Slopes:
    """Differences of step·σᵢ about x in one batch: 1 + n points, or 1 + 2n central; fixed inputs skipped."""
    active, h = joint.active, step * joint.sds
    offsets = {"forward": (1.0,), "backward": (-1.0,), "central": (1.0, -1.0)}[how]
    points = [x]
    for sign in offsets:
        for i in active:
            shifted = x.copy()
            shifted[i] += sign * h[i]
            points.append(shifted)
    values = ledger(np.array(points))
    centre, sides = values[0], values[1:].reshape(len(offsets), len(active))
    gradient, moved = np.zeros(len(joint)), np.zeros(len(joint))
    curvature = None
    # The step that was taken, which rounding made a little different from the one asked for.
    taken = np.array([points[1 + k][i] - x[i] for k, i in enumerate(active)])
    if how == "central":
        back = np.array([x[i] - points[1 + len(active) + k][i] for k, i in enumerate(active)])
        gradient[active] = (sides[0] - sides[1]) / (taken + back)
        curvature = np.zeros(len(joint))
        curvature[active] = (sides[0] - 2.0 * centre + sides[1]) / (taken * back)
    else:
        gradient[active] = (sides[0] - centre) / taken
    moved[active] = np.max(np.abs(sides - centre), axis=0)
    return _Slopes(float(centre), gradient, curvature, moved, _resolution(values))


def _unit(vector: Array) -> Array:
    """The vector divided by its norm; zeros stay zeros."""
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 0 else np.zeros_like(vector)


def _standard_gradient(joint: JointDistribution, gradient: Array, u: Array) -> Array:
    """(d,) ∂z/∂u at u from ∂z/∂x."""
    return joint.jacobian(u).T @ gradient


def _linear_extreme(joint: JointDistribution, gradient: Array, radius: float, sign: float) -> Array:
    """(d,) u on the sphere ‖u‖ = radius where sign·Σ gradientᵢ·xᵢ(u) is largest.

    Ascent by the fixed point u ← radius·∇/‖∇‖ from several starts, shifted towards the present point wherever
    it would descend (as in the shifted power method), so that it cannot cycle.
    """
    weights = sign * gradient
    lower = joint.cholesky

    def value_and_slope(u: Array) -> tuple[Array, Array]:
        z = u @ lower.T
        value, slope = np.zeros(len(u)), np.zeros_like(u)
        for i in np.flatnonzero(weights):
            value += weights[i] * (joint.marginals[i].from_standard(z[:, i]) - joint.marginals[i].mean)
            slope[:, i] = weights[i] * joint.marginals[i].slope(z[:, i])
        return value, slope @ lower

    centre = _unit(value_and_slope(np.zeros((1, len(joint))))[1][0])
    axes = np.eye(len(joint))[joint.active]
    starts = np.array([centre, *axes, *-axes])
    directions = starts[np.linalg.norm(starts, axis=1) > 0]
    value, slope = value_and_slope(radius * directions)
    shift = np.zeros((len(directions), 1))
    for _ in range(2000):
        norms = np.linalg.norm(slope, axis=1, keepdims=True)
        target = slope / np.where(norms > 0, norms, 1.0) + shift * directions
        moved = target / np.linalg.norm(target, axis=1, keepdims=True)
        new_value, new_slope = value_and_slope(radius * moved)
        falls = new_value < value - 1e-14 * np.abs(value)
        shift[falls] = 2.0 * shift[falls] + 0.5
        change = np.linalg.norm(moved - directions, axis=1)
        keep = ~falls
        directions[keep], value[keep], slope[keep] = moved[keep], new_value[keep], new_slope[keep]
        if not falls.any() and np.max(change) < 1e-14:
            break
    return radius * directions[int(np.argmax(value))]


@dataclass(frozen=True)
class _Setting:
    """The checked arguments that the mean value family shares."""

    joint: JointDistribution
    levels: tuple[float, ...]
    space: Space
    step: float
    difference: Difference

    @classmethod
    def checked(
        cls,
        marginals: Sequence[Marginal],
        correlation: ArrayLike | None,
        levels: Sequence[float],
        space: Space,
        step: float,
        difference: Difference,
    ) -> _Setting:
        joint = JointDistribution(marginals, correlation)
        if not len(joint.active):
            raise ValueError("every input is fixed: there is nothing to vary")
        if not levels or any(not 0 < p < 1 for p in levels):
            raise ValueError(f"levels must lie between 0 and 1, got {list(levels)}")
        if space not in ("x", "u"):
            raise ValueError(f"space must be 'x' or 'u', got {space!r}")
        _check_differences(step, difference)
        return cls(joint, tuple(float(p) for p in levels), space, step, difference)

    @property
    def outermost(self) -> float:
        """max |β| over the levels."""
        return float(np.max(np.abs(ndtri(np.array(self.levels)))))

    def extreme(self, gradient: Array, level: float, at: Array) -> Array:
        """(d,) u* of the linear model with slopes `gradient` (∂z/∂x), in x or, about the point `at`, in u."""
        beta = float(ndtri(level))
        if beta == 0.0 or not np.any(gradient):
            return np.zeros(len(self.joint))
        if self.space == "x":
            return _linear_extreme(self.joint, gradient, abs(beta), math.copysign(1.0, beta))
        return beta * _unit(_standard_gradient(self.joint, gradient, at))

    def importance(self, gradient: Array, level: float, u: Array) -> Array:
        beta = float(ndtri(level))
        return u / beta if beta else _unit(_standard_gradient(self.joint, gradient, u))


def _check_differences(step: float, difference: str) -> None:
    if not (math.isfinite(step) and step > 0):
        raise ValueError(f"step must be positive (in standard deviations), got {step}")
    if difference not in ("forward", "backward", "central"):
        raise ValueError(f"difference must be 'forward', 'backward' or 'central', got {difference!r}")


@dataclass(frozen=True)
class _Linearisation:
    """The response linearised at the mean inputs, where every method of the family starts."""

    slopes: _Slopes
    mean_point: Array
    standard_point: Array
    sd: float
    importance: Array

    @classmethod
    def at_mean(cls, ledger: _Ledger, setting: _Setting) -> _Linearisation:
        joint = setting.joint
        slopes = _differences(ledger, joint, joint.means, setting.step, setting.difference)
        u = joint.to_standard(joint.means)
        sd = math.sqrt(float(slopes.gradient @ joint.covariance @ slopes.gradient))
        importance = _unit(_standard_gradient(joint, slopes.gradient, u))
        return cls(slopes, joint.means, u, sd, importance)

    def value(self, level: float) -> float:
        """MV: the percentile of a normal variable with the linearisation's mean and standard deviation."""
        return self.slopes.value + float(ndtri(level)) * self.sd


@dataclass
class _Gate:
    """Collects the signals against the mean value methods."""

    setting: _Setting
    linear: _Linearisation
    noise: float | None
    suspicions: list[str] = field(default_factory=list)
    rejections: list[str] = field(default_factory=list)

    def look_at_slopes(self) -> None:
        joint, slopes = self.setting.joint, self.linear.slopes
        norm = self.linear.sd
        if norm == 0.0:
            self.rejections.append("every slope at the mean inputs is zero: the linearisation says nothing")
            return
        still = [int(i) for i in joint.active if slopes.moved[i] == 0.0]
        if (
            still and slopes.resolution is not None
        ):  # without such steps an input that moves nothing is one without influence
            self.suspicions.append(
                f"the response comes in steps of {slopes.resolution:g}, and {len(still)} of {len(joint.active)} "
                "inputs (number "
                f"{', '.join(map(str, still))}) do not move it over a step of {self.setting.step:g} sd: take a larger "
                "step or more digits"
            )
        if self.noise is not None:
            error = self.noise / self.setting.step * math.sqrt(len(joint.active))
            error *= 1.0 / math.sqrt(2.0) if self.setting.difference == "central" else math.sqrt(2.0)
            if error > _NOISE_LIMIT * norm:
                self.suspicions.append(
                    f"noise of {self.noise:g} in the response makes the slopes uncertain by "
                    f"{error / norm:.0%} of their norm: a step above "
                    f"{self.setting.step * error / (_NOISE_LIMIT * norm):.2g} sd is needed"
                )
        if slopes.curvature is not None:
            self._look_at_curvature(slopes.curvature, norm)

    def _look_at_curvature(self, curvature: Array, norm: float) -> None:
        joint, reach = self.setting.joint, self.setting.outermost
        bend = np.abs(curvature) * joint.sds**2
        if self.noise is not None:  # what noise alone can make of a second difference
            bend = np.maximum(bend - math.sqrt(6.0) * self.noise / self.setting.step**2, 0.0)
        ratio = 0.5 * bend * reach / norm
        for i in np.flatnonzero(ratio > _CURVATURE_LIMIT):
            # The slope changes sign at reach/(2·ratio) or nearer: within the levels in any case, decisive where the
            # bent part outweighs the linear one.
            if ratio[i] > 1.0:
                self.rejections.append(
                    f"input number {i}: the one-sided slopes change sign well within the outermost level "
                    f"(curvature ratio {ratio[i]:.2g}); the response is not monotonic"
                )
            else:
                self.suspicions.append(f"input number {i}: curvature ratio {ratio[i]:.2g} is above {_CURVATURE_LIMIT}")

    def look_at_order(self, value: Mapping[float, float]) -> None:
        ordered = sorted(value)
        for low, high in itertools.pairwise(ordered):
            if value[high] <= value[low]:
                self.rejections.append(
                    f"the percentiles do not increase: {value[low]:.6g} at {low:g}, {value[high]:.6g} at {high:g}"
                )

    def look_at_departure(self, value: Mapping[float, float]) -> None:
        for level in sorted(value):
            expected = self.linear.value(level)
            spread = abs(expected - self.linear.slopes.value)
            if spread > 0 and abs(value[level] - expected) > _DEPARTURE_LIMIT * spread:
                self.suspicions.append(
                    f"level {level:g}: {value[level]:.6g} departs from the linearisation's {expected:.6g} by more "
                    "than half of its distance from the centre"
                )

    def look_at_turn(self, level: float, gradient_u: Array) -> None:
        cosine = float(_unit(gradient_u) @ self.linear.importance)
        if ndtri(level) and cosine < math.cos(_TURN_LIMIT):
            self.suspicions.append(
                f"level {level:g}: the gradient at the design point is turned by "
                f"{math.degrees(math.acos(max(cosine, -1.0))):.0f}° from that at the mean inputs"
            )

    def look_at_variance(self, variance: float | None) -> None:
        if variance is not None and self.linear.sd**2 < _VARIANCE_LIMIT * variance:
            self.suspicions.append(
                f"the linearisation explains {self.linear.sd**2 / variance:.0%} of the sampled variance"
            )

    @property
    def status(self) -> Status:
        return "rejected" if self.rejections else "suspect" if self.suspicions else "ok"

    @property
    def reasons(self) -> tuple[str, ...]:
        return (*self.rejections, *self.suspicions)


def _result(
    method: str,
    setting: _Setting,
    linear: _Linearisation,
    gate: _Gate,
    ledger: _Ledger,
    value: dict[float, float],
    points: dict[float, Array],
    importance: dict[float, Array],
    iterations: dict[float, int],
) -> LevelResult:
    return LevelResult(
        method=method,
        value=value,
        importance=importance,
        design_point={level: setting.joint.from_standard(u) for level, u in points.items()},
        mean=linear.slopes.value,
        sd=linear.sd,
        gradient=linear.slopes.gradient,
        linear_importance=linear.importance,
        iterations=iterations,
        evaluations=ledger.evaluations(),
        status=gate.status,
        reasons=gate.reasons,
    )


def mean_value(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "forward",
    correlation: ArrayLike | None = None,
    *,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """Mean value method: the response is taken as linear about the mean inputs, and normal.

    1 + n evaluations one-sided, 1 + 2n central, for n inputs that are not fixed. `step` is in standard
    deviations of each input; choose it so that the response moves well beyond its own noise (`step_noise`).
    Arguments as in `amv`.
    """
    setting = _Setting.checked(marginals, correlation, levels, space, step, difference)
    ledger = _Ledger(function)
    linear = _Linearisation.at_mean(ledger, setting)
    gate = _Gate(setting, linear, noise)
    gate.look_at_slopes()
    gate.look_at_variance(variance)
    points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
    return _result(
        "mv",
        setting,
        linear,
        gate,
        ledger,
        {p: linear.value(p) for p in setting.levels},
        points,
        {p: setting.importance(linear.slopes.gradient, p, u) for p, u in points.items()},
        dict.fromkeys(setting.levels, 1),
    )


def amv(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "forward",
    correlation: ArrayLike | None = None,
    *,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """Advanced mean value method: one evaluation of the response at each level's extreme point of the
    linearisation.

    function    (n, d) inputs → (n,) responses
    marginals   d of them; fixed ones are held and cost nothing
    levels      probabilities p whose percentile z_p is wanted
    space       'x': the model is linear in the physical inputs (Wu 1990, and the sprain study); 'u': linear
                in the standard space about the point of the mean inputs
    step        finite-difference step in standard deviations
    difference  'forward', 'backward' or 'central'; only central differences let the gate see curvature
    correlation (d, d) Pearson correlations of x, or None
    noise       standard deviation of the response's own noise, if known: slopes that drown in it are reported
    variance    variance of the response from a sample, if there is one: a linearisation that explains little
                is reported

    Evaluations requested: 1 + n + levels one-sided, 1 + 2n + levels central. Raises ValueError for arguments
    out of range, correlations that cannot be, and a response that is not finite.
    """
    setting = _Setting.checked(marginals, correlation, levels, space, step, difference)
    ledger = _Ledger(function)
    linear = _Linearisation.at_mean(ledger, setting)
    gate = _Gate(setting, linear, noise)
    gate.look_at_slopes()
    points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
    found = ledger(setting.joint.from_standard(np.array(list(points.values()))))
    value = {p: float(z) for p, z in zip(points, found, strict=True)}
    gate.look_at_order(value)
    gate.look_at_departure(value)
    gate.look_at_variance(variance)
    return _result(
        "amv",
        setting,
        linear,
        gate,
        ledger,
        value,
        points,
        {p: setting.importance(linear.slopes.gradient, p, u) for p, u in points.items()},
        dict.fromkeys(setting.levels, 1),
    )


@dataclass
class _Search:
    """Where a relinearising method stands at one level."""

    u: Array
    value: float
    iterations: int = 0
    gradient_u: Array | None = None
    complaint: str | None = None


_Improve = Callable[[_Ledger, _Setting, float, _Search, float], None]


def _relinearise(
    method: str,
    improve: _Improve,
    function: Function,
    setting: _Setting,
    tolerance: float,
    budget: int,
    noise: float | None,
    variance: float | None,
) -> LevelResult:
    """The frame of AMV+ and HMV: start at each level's AMV point, let `improve` move it, judge it."""
    ledger = _Ledger(function, budget)
    joint = setting.joint
    try:
        linear = _Linearisation.at_mean(ledger, setting)
        points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
        start = ledger(joint.from_standard(np.array(list(points.values()))))
    except _BudgetSpent:
        raise ValueError(f"a budget of {budget} evaluations does not even allow the AMV step") from None
    gate = _Gate(setting, linear, noise)
    gate.look_at_slopes()
    searches = {p: _Search(points[p], float(z)) for p, z in zip(points, start, strict=True)}
    small = tolerance * (linear.sd or 1.0)
    for level, search in searches.items():
        try:
            improve(ledger, setting, level, search, small)
        except _BudgetSpent:
            search.complaint = f"the budget of {budget} evaluations was spent before the search settled"
        if search.complaint:
            gate.suspicions.append(f"level {level:g}: {search.complaint}")
        if search.gradient_u is not None:
            gate.look_at_turn(level, search.gradient_u)
    value = {p: search.value for p, search in searches.items()}
    gate.look_at_order(value)
    gate.look_at_variance(variance)
    importance = {}
    for p, search in searches.items():
        beta = float(ndtri(p))
        gradient_u = linear.importance if search.gradient_u is None else search.gradient_u
        importance[p] = search.u / beta if beta else _unit(gradient_u)
    return _result(
        method,
        setting,
        linear,
        gate,
        ledger,
        value,
        {p: search.u for p, search in searches.items()},
        importance,
        {p: search.iterations for p, search in searches.items()},
    )


def _slopes_at(ledger: _Ledger, setting: _Setting, u: Array) -> tuple[_Slopes, Array]:
    """Differences at x(u), and the gradient in u."""
    slopes = _differences(ledger, setting.joint, setting.joint.from_standard(u), setting.step, setting.difference)
    return slopes, _standard_gradient(setting.joint, slopes.gradient, u)


_AMV_PLUS_ITERATIONS = 100


def _iterate_amv(ledger: _Ledger, setting: _Setting, level: float, search: _Search, small: float) -> None:
    """u ← extreme of the linearisation at u, until the response changes by less than `small`."""
    for _ in range(_AMV_PLUS_ITERATIONS):
        slopes, search.gradient_u = _slopes_at(ledger, setting, search.u)
        search.iterations += 1
        u = setting.extreme(slopes.gradient, level, search.u)
        value = ledger.at(setting.joint.from_standard(u))
        change, search.u, search.value = abs(value - search.value), u, value
        if change < small:
            return
    search.complaint = (
        f"plain relinearisation did not settle in {_AMV_PLUS_ITERATIONS} iterations (it cycles or crawls); use hmv"
    )


def amv_plus(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "central",
    correlation: ArrayLike | None = None,
    *,
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """AMV with the response linearised anew at each design point until z_p changes by less than tolerance·sd.

    Arguments as in `amv`, but differences are central unless asked otherwise, since the result depends on the
    slopes at the design point; `budget` bounds the evaluations executed. A search that cycles, crawls or
    spends the budget is reported as suspect with the value it had reached: concave responses do that, `hmv`
    is made for them.
    """
    setting = _Setting.checked(marginals, correlation, levels, space, step, difference)
    return _relinearise("amv+", _iterate_amv, function, setting, tolerance, budget, noise, variance)


_HMV_ITERATIONS = 100
_ARC_HALVINGS = 12


def _climb_hybrid(ledger: _Ledger, setting: _Setting, level: float, search: _Search, small: float) -> None:
    """Hybrid mean value: steepest direction where the response is convex, the mean of the last three where it
    is concave, and an arc towards the steepest direction wherever either would not improve."""
    beta = float(ndtri(level))
    _, search.gradient_u = _slopes_at(ledger, setting, search.u)
    search.iterations = 1
    if beta == 0.0:
        return
    radius, sign = abs(beta), math.copysign(1.0, beta)
    recent: list[Array] = []
    for _ in range(_HMV_ITERATIONS):
        steepest = sign * _unit(search.gradient_u)
        here = search.u / radius
        gain = float(np.linalg.norm(search.gradient_u)) * radius * (1.0 - float(steepest @ here))
        if gain < small:
            return
        recent = [*recent[-2:], steepest]
        direction = steepest
        if len(recent) == 3 and (recent[2] - recent[1]) @ (recent[1] - recent[0]) <= 0:
            direction = _unit(recent[0] + recent[1] + recent[2])
        moved = _improved(ledger, setting, search, here, [direction, *_arc(here, steepest)], sign, radius)
        if not moved:
            if gain > math.sqrt(small):
                search.complaint = "no step improves the response although its slope promises it: noise or a kink"
            return
        _, search.gradient_u = _slopes_at(ledger, setting, search.u)
        search.iterations += 1
    search.complaint = f"the search did not settle in {_HMV_ITERATIONS} iterations"


def _arc(start: Array, end: Array) -> list[Array]:
    """Unit vectors on the great circle from `start` towards `end`, each half as far as the one before."""
    angle = math.acos(float(np.clip(start @ end, -1.0, 1.0)))
    across = _unit(end - (start @ end) * start)
    turns = [angle * 0.5**k for k in range(1, _ARC_HALVINGS + 1)]
    return [math.cos(turn) * start + math.sin(turn) * across for turn in turns]


def _improved(
    ledger: _Ledger,
    setting: _Setting,
    search: _Search,
    here: Array,
    candidates: Sequence[Array],
    sign: float,
    radius: float,
) -> bool:
    """Move the search to the first candidate direction that is better than the present one."""
    for direction in candidates:
        if np.array_equal(direction, here):
            continue
        value = ledger.at(setting.joint.from_standard(radius * direction))
        if sign * (value - search.value) > 0:
            search.u, search.value = radius * direction, value
            return True
    return False


def hmv(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "central",
    correlation: ArrayLike | None = None,
    *,
    tolerance: float = 1e-9,
    budget: int = DEFAULT_BUDGET,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """Hybrid mean value method: the true extreme of the response on each level's sphere, also where AMV+
    cycles.

    Arguments as in `amv_plus`; `space` chooses the AMV start only, the search itself runs in the standard
    space. It stops when the slope promises less than tolerance·sd. Every accepted step improves, so that the
    value never gets worse than AMV's; a search that ends for another reason is suspect and says why.
    """
    setting = _Setting.checked(marginals, correlation, levels, space, step, difference)
    return _relinearise("hmv", _climb_hybrid, function, setting, tolerance, budget, noise, variance)


_FORM_ITERATIONS = 200
_STEP_HALVINGS = 30


def form(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float,
    correlation: ArrayLike | None = None,
    *,
    step: float = 1e-4,
    difference: Difference = "central",
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
) -> FormResult:
    """First-order reliability method for the event `function <= threshold`, by the improved HL-RF algorithm.

    The default step suits a limit state given as a formula; for a simulator choose it above the noise of the
    response, as for `amv`. Stops when the limit state is met and u is parallel to its gradient within
    `tolerance` (and the finite differences allow it). A search that ends for another reason, or a design
    point that is a second-best one, cannot be told from inside; the former is reported as suspect. Raises
    ValueError as `amv` does.
    """
    joint = JointDistribution(marginals, correlation)
    if not len(joint.active):
        raise ValueError("every input is fixed: there is nothing to vary")
    if not math.isfinite(threshold):
        raise ValueError(f"the threshold must be finite, got {threshold}")
    _check_differences(step, difference)
    ledger = _Ledger(function, budget)
    u = np.zeros(len(joint))
    state: tuple[float, Array] | None = None
    origin_value = math.nan
    complaint: str | None = f"no design point was found in {_FORM_ITERATIONS} iterations"
    iterations = 0
    try:
        for iterations in range(1, _FORM_ITERATIONS + 1):
            slopes = _differences(ledger, joint, joint.from_standard(u), step, difference)
            g, gradient = slopes.value - threshold, _standard_gradient(joint, slopes.gradient, u)
            state = g, gradient
            if iterations == 1:
                origin_value = g
            norm = float(np.linalg.norm(gradient))
            if norm == 0.0:
                if iterations == 1:  # a symmetric response: step aside and look again
                    u[joint.active] = 0.1
                    continue
                complaint = f"the gradient vanishes at x = {joint.from_standard(u).tolist()}"
                break
            normal = gradient / norm
            across = float(np.linalg.norm(u - (normal @ u) * normal))
            scale = max(1.0, float(np.linalg.norm(u)))
            if abs(g) <= 1e-4 * tolerance * norm * scale and across <= tolerance * scale:
                complaint = None
                break
            moved = _hlrf_step(ledger, joint, threshold, u, g, gradient)
            if moved is None:
                settled = (
                    abs(g) <= max(1e-6, 1e-2 * tolerance) * norm * scale and across <= max(1e-4, tolerance) * scale
                )
                complaint = None if settled else "the line search found no better point: noise or a kink"
                break
            u = moved
    except _BudgetSpent:
        complaint = f"the budget of {budget} evaluations was spent before the search settled"
    if state is None:
        raise ValueError(f"a budget of {budget} evaluations does not even allow one gradient")
    g, gradient = state
    alpha = -_unit(gradient)
    beta = math.copysign(float(np.linalg.norm(u)), origin_value)
    return FormResult(
        beta=beta,
        probability=float(ndtr(-beta)),
        alpha=alpha,
        importance=alpha**2,
        design_point=joint.from_standard(u),
        standard_point=u,
        iterations=iterations,
        evaluations=ledger.evaluations(),
        status="suspect" if complaint else "ok",
        reasons=(complaint,) if complaint else (),
    )


def form_exceedance(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float | Marginal,
    correlation: ArrayLike | None = None,
    **options: Any,
) -> FormResult:
    """FORM for the event `function > threshold`; `options` as in `form`.

    An uncertain threshold (a marginal, independent of the inputs) is one more input, the last of alpha and of
    the design point: the limit state is threshold − function(x) <= 0.
    """
    if not isinstance(threshold, Marginal):
        return form(lambda x: -np.asarray(function(x), dtype=float), marginals, -threshold, correlation, **options)
    joined = None
    if correlation is not None:
        joined = np.eye(len(marginals) + 1)
        joined[:-1, :-1] = correlation
    known: dict[bytes, float] = {}

    def margin(x: Array) -> Array:
        """A step of the threshold alone costs no evaluation."""
        inputs = np.ascontiguousarray(x[:, :-1])
        keys = [row.tobytes() for row in inputs]
        fresh = {key: row for key, row in zip(keys, inputs, strict=True) if key not in known}
        if fresh:
            values = np.asarray(function(np.array(list(fresh.values()))), dtype=float)
            known.update(zip(fresh, values.tolist(), strict=True))
        return x[:, -1] - np.array([known[key] for key in keys])

    return form(margin, [*marginals, threshold], 0.0, joined, **options)


def _hlrf_step(
    ledger: _Ledger, joint: JointDistribution, threshold: float, u: Array, g: float, gradient: Array
) -> Array | None:
    """One step of iHL-RF: its direction, shortened until ½‖u‖² + c·|g| falls; None if it never does."""
    norm2 = float(gradient @ gradient)
    target = (float(gradient @ u) - g) / norm2 * gradient
    direction = target - u
    penalty = 2.0 * float(np.linalg.norm(u)) / math.sqrt(norm2) + abs(g) / norm2
    merit = 0.5 * float(u @ u) + penalty * abs(g)
    slope = float(u @ direction) - penalty * abs(g)  # the gradient along HL-RF's direction is −g
    best: tuple[float, Array] | None = None
    for halving in range(_STEP_HALVINGS):
        moved = u + 0.5**halving * direction
        value = ledger.at(joint.from_standard(moved)) - threshold
        reached = 0.5 * float(moved @ moved) + penalty * abs(value)
        if best is not None and reached >= best[0]:
            break
        # Past a step that will do, half of it is tried too: full steps swing about a curved limit state.
        if reached <= merit + 0.1 * 0.5**halving * slope:
            best = reached, moved
    return None if best is None else best[1]


@dataclass(frozen=True)
class SormResult:
    """Second-order probabilities of the event of a `FormResult`.

    curvatures (d − 1,) of the limit state at the design point, positive where it bends away from the origin;
    breitung, hohenbichler, tvedt: the probability by K. Breitung (1984), by M. Hohenbichler and
    R. Rackwitz (1988) and by L. Tvedt (1983); NaN where the curvatures leave their range (1 + βκ ≤ 0).
    """

    curvatures: Array
    breitung: float
    hohenbichler: float
    tvedt: float
    evaluations: Evaluations


def sorm(
    function: Function,
    marginals: Sequence[Marginal],
    first_order: FormResult,
    correlation: ArrayLike | None = None,
    *,
    step: float = 1e-3,
) -> SormResult:
    """Correct a FORM probability for the curvature of the limit state at its design point.

    Second differences of `step` in the standard space: d(d + 1) + 1 evaluations for d inputs not fixed.
    """
    joint = JointDistribution(marginals, correlation)
    active, centre = joint.active, first_order.standard_point
    ledger = _Ledger(function)
    d = len(active)
    pairs = [(i, j) for i in range(d) for j in range(i + 1)]
    points = [centre]
    for i, j in pairs:
        for sign in (1.0, -1.0):
            point = centre.copy()
            point[active[i]] += sign * step
            if i != j:
                point[active[j]] += sign * step
            points.append(point)
    values = ledger(joint.from_standard(np.array(points)))
    second = dict(zip(pairs, (values[1::2] - 2.0 * values[0] + values[2::2]) / step**2, strict=True))
    diagonal = np.array([second[i, i] for i in range(d)])
    slopes = np.array([values[1 + 2 * pairs.index((i, i))] - values[2 + 2 * pairs.index((i, i))] for i in range(d)])
    hessian = np.diag(diagonal)
    for i, j in pairs:
        if i != j:
            hessian[i, j] = hessian[j, i] = 0.5 * (second[i, j] - diagonal[i] - diagonal[j])
    # An orthonormal basis whose first vector is alpha; the rest spans the tangent plane.
    tangent = np.linalg.qr(np.column_stack([first_order.alpha[active], np.eye(d)]))[0][:, 1:]
    side = math.copysign(1.0, first_order.beta)
    curved = tangent.T @ hessian @ tangent / float(np.linalg.norm(slopes / (2.0 * step)))
    curvatures: Array = side * np.linalg.eigvalsh(curved)
    distance = abs(first_order.beta)
    tails = _second_order(distance, curvatures)
    breitung, hohenbichler, tvedt = tails if first_order.beta > 0 else tuple(1.0 - tail for tail in tails)
    return SormResult(curvatures, breitung, hohenbichler, tvedt, ledger.evaluations())


def _second_order(beta: float, curvatures: Array) -> tuple[float, float, float]:
    """Tail probabilities beyond a design point at distance beta: Breitung, Hohenbichler-Rackwitz, Tvedt."""
    first = float(ndtr(-beta))
    density = math.exp(-0.5 * beta**2) / math.sqrt(2.0 * math.pi)

    def shrink(weight: complex) -> float:
        factors = 1.0 + weight * curvatures
        return math.nan if np.any(factors.real <= 0) else float(np.prod(1.0 / np.sqrt(factors)).real)

    at_beta, excess = shrink(beta), beta * first - density
    tvedt = first * at_beta + excess * (at_beta - shrink(beta + 1.0))
    tvedt += (beta + 1.0) * excess * (at_beta - shrink(beta + 1.0j))
    return first * at_beta, first * shrink(density / first), tvedt


def step_noise(function: Function, marginals: Sequence[Marginal], spacing: float = 1e-3, points: int = 9) -> float:
    """Standard deviation of the response's own noise near the mean inputs.

    A table of differences along the diagonal of the inputs (J. J. Moré, S. M. Wild, Estimating computational
    noise, SIAM J. Sci. Comput. 33 (2011) 1292-1314): differences of order k of a smooth function vanish,
    those of independent noise of standard deviation ε have standard deviation ε·√((2k)!/(k!)²). `points`
    evaluations, `spacing` standard deviations apart. Returns 0 where the response is smooth to rounding.
    """
    if points < 5:
        raise ValueError(f"the noise needs at least 5 points, got {points}")
    joint = JointDistribution(marginals)
    offsets = spacing * (np.arange(points) - points // 2)
    column = np.asarray(function(joint.means + offsets[:, np.newaxis] * joint.sds), dtype=float)
    if not np.all(np.isfinite(column)):
        raise ValueError("the function returned a value that is not finite")
    rounding = 4.0 * np.finfo(float).eps * float(np.max(np.abs(column)))
    estimates = []
    for order in range(1, points - 1):
        column = np.diff(column)
        if order >= 3:
            estimates.append(math.sqrt(float(np.mean(column**2)) / math.comb(2 * order, order)))
    level = float(np.median(estimates))
    return 0.0 if level <= rounding else level
