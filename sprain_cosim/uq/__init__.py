"""Uncertainty: marginals, samples, reliability, sensitivities.

The numerics (`distributions`, `fitting`, `sampling`, `reliability`, `sensitivity`, `statistics`) take functions and
arrays, know nothing of FMUs and import numpy and scipy alone.
"""

from .distributions import (
    Beta,
    Choices,
    Empirical,
    Exponential,
    Fixed,
    LogNormal,
    Normal,
    Triangular,
    Truncated,
    Uniform,
    Weibull,
)

__all__ = [
    "Beta",
    "Choices",
    "Empirical",
    "Exponential",
    "Fixed",
    "LogNormal",
    "Normal",
    "Triangular",
    "Truncated",
    "Uniform",
    "Weibull",
]
