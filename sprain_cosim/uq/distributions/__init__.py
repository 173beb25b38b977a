"""Marginals and the Gaussian copula: between physical values x and the standard space u.

A marginal is a frozen, increasing map x(u) of a standard normal variable u. `JointDistribution` joins d marginals by a
Gaussian copula.

Equations: A. Der Kiureghian and P.-L. Liu, J. Eng. Mech. 112 (1986) 85-104. Scores: H. Millwater, Universal properties
of kernel functions for probabilistic sensitivity analysis, Probabilistic Eng. Mech. 24 (2009) 89-99.
"""

from .bounded import Beta, Triangular, Uniform
from .discrete import Choices, Empirical, Fixed
from .joint import JointDistribution
from .marginal import Array, Marginal
from .mixture import JointMixture, Mixture
from .normal import LogNormal, Normal
from .positive import Exponential, Weibull
from .truncated import Truncated

__all__ = [
    "Array",
    "Beta",
    "Choices",
    "Empirical",
    "Exponential",
    "Fixed",
    "JointDistribution",
    "JointMixture",
    "LogNormal",
    "Marginal",
    "Mixture",
    "Normal",
    "Triangular",
    "Truncated",
    "Uniform",
    "Weibull",
]
