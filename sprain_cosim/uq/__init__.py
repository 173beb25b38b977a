"""Uncertainty: marginals, samples, reliability, sensitivities; studies and their runner.

The numerics (`distributions`, `sampling`, `reliability`, `sensitivity`, `statistics`) take functions and
arrays, know nothing of FMUs and import numpy and scipy alone.
"""

from .distributions import Fixed, LogNormal, Normal, Truncated, Uniform

__all__ = ["Fixed", "LogNormal", "Normal", "Truncated", "Uniform"]
