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
    first_order        FORM
    second_order       SORM
"""

from .differences import Difference, step_noise
from .first_order import FormResult, form, form_exceedance
from .linearisation import DEFAULT_LEVELS, Space
from .mean_value_family import LevelResult, amv, mean_value
from .points import DEFAULT_BUDGET, Evaluations, Function, Status
from .relinearised import amv_plus, hmv
from .second_order import SormResult, sorm

__all__ = [
    "DEFAULT_BUDGET",
    "DEFAULT_LEVELS",
    "Difference",
    "Evaluations",
    "FormResult",
    "Function",
    "LevelResult",
    "SormResult",
    "Space",
    "Status",
    "amv",
    "amv_plus",
    "form",
    "form_exceedance",
    "hmv",
    "mean_value",
    "sorm",
    "step_noise",
]
