"""The mean value family from one linearisation: MV and AMV.

Source: Y.-T. Wu, H. R. Millwater, T. A. Cruse, Advanced probabilistic structural analysis method for implicit
performance functions, AIAA J. 28 (1990) 1663-1669.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..distributions import Marginal
from .differences import Difference
from .gate import Gate
from .linearisation import DEFAULT_LEVELS, Linearisation, Setting, Space
from .points import Array, Evaluations, Function, PointLedger, Status

if TYPE_CHECKING:
    from .level_check import LevelCheck

__all__ = ["LevelResult", "amv", "level_result", "mean_value"]


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
    check            what random rows say of the levels, where they were asked (`check_levels`)
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
    check: LevelCheck | None = None


def level_result(
    method: str,
    setting: Setting,
    linear: Linearisation,
    gate: Gate,
    ledger: PointLedger,
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
    setting = Setting.checked(marginals, correlation, levels, space, step, difference)
    ledger = PointLedger(function)
    linear = Linearisation.at_mean(ledger, setting)
    gate = Gate(setting, linear, noise)
    gate.look_at_slopes()
    gate.look_at_variance(variance)
    points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
    return level_result(
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

    function     (n, d) inputs → (n,) responses
    marginals    d of them; fixed ones are held and cost nothing
    levels       probabilities p whose percentile z_p is wanted
    space        'x': the model is linear in the physical inputs (Wu 1990, and the sprain study); 'u': linear
                 in the standard space about the point of the mean inputs
    step         finite-difference step in standard deviations
    difference   'forward', 'backward' or 'central'; only central differences let the gate see curvature
    correlation  (d, d) Pearson correlations of x, or None
    noise        standard deviation of the response's own noise, if known: slopes that drown in it are reported
    variance     variance of the response from a sample, if there is one: a linearisation that explains little
                 is reported

    Evaluations requested: 1 + n + levels one-sided, 1 + 2n + levels central. Raises ValueError for arguments
    out of range, correlations that cannot be, and a response that is not finite.
    """
    setting = Setting.checked(marginals, correlation, levels, space, step, difference)
    ledger = PointLedger(function)
    linear = Linearisation.at_mean(ledger, setting)
    gate = Gate(setting, linear, noise)
    gate.look_at_slopes()
    points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
    found = ledger(setting.joint.from_standard(np.array(list(points.values()))))
    value = {p: float(z) for p, z in zip(points, found, strict=True)}
    gate.look_at_order(value)
    gate.look_at_departure(value)
    gate.look_at_variance(variance)
    return level_result(
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
