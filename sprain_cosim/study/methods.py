"""The methods by which a study chooses its trials."""

from __future__ import annotations

SAMPLED = ("monte-carlo", "lhs", "sobol", "grid", "table")
SEARCHES = ("mean-value", "amv", "amv+", "hmv", "form", "sobol-indices")  # the trials depend on the method's own plan
METHODS = (*SAMPLED, *SEARCHES)
