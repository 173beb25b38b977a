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

Modules, each with its sources:

    points             the ledger of evaluations
    differences        slopes and noise
    linearisation      the linear model and its extreme points
    gate               cheap signals against the mean value methods
    mean_value_family  MV and AMV
    relinearised       AMV+ and HMV
    level_check        levels of all these tested on random evaluations
    first_order        FORM
    multistart         FORM from several starts, with a test of the sphere
    second_order       SORM
    importance         sampling about the design points
    rare               the best estimate of all these
"""

from ..sensitivity import importance_x
from .differences import Difference, step_noise
from .first_order import FormResult, form, form_exceedance
from .importance import ImportanceSampling, importance_sampling
from .level_check import LevelCheck, check_levels, level_exceedance
from .linearisation import DEFAULT_LEVELS, Space
from .mean_value_family import LevelResult, amv, mean_value
from .multistart import DesignPoints, design_points
from .points import DEFAULT_BUDGET, BudgetTooSmall, Evaluations, Function, Status
from .rare import RareEvent, rare_event
from .relinearised import amv_plus, hmv
from .second_order import SormResult, sorm

__all__ = [
    "DEFAULT_BUDGET",
    "DEFAULT_LEVELS",
    "BudgetTooSmall",
    "DesignPoints",
    "Difference",
    "Evaluations",
    "FormResult",
    "Function",
    "ImportanceSampling",
    "LevelCheck",
    "LevelResult",
    "RareEvent",
    "SormResult",
    "Space",
    "Status",
    "amv",
    "amv_plus",
    "check_levels",
    "design_points",
    "form",
    "form_exceedance",
    "hmv",
    "importance_sampling",
    "importance_x",
    "level_exceedance",
    "mean_value",
    "rare_event",
    "sorm",
    "step_noise",
]
