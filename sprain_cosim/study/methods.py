"""The methods by which a study chooses its trials."""

from __future__ import annotations

SAMPLED = ("monte-carlo", "lhs", "sobol", "grid", "table")
# the trials depend on the method's own plan
SEARCHES = ("mean-value", "amv", "amv+", "hmv", "form", "sobol-indices", "design")
METHODS = (*SAMPLED, *SEARCHES)
LEVELLED = ("mean-value", "amv", "amv+", "hmv")  # searches for the response's value at levels of probability
DRAWN = ("monte-carlo", "lhs", "sobol", "table")  # samples, of which shares are probabilities
USED_BY = {  # settings that some methods alone look at
    "trials": ("monte-carlo", "lhs", "sobol", "sobol-indices", "design"),
    "half_width": DRAWN,
    "until": ("monte-carlo", "table"),  # whose first rows are independent draws
    "replicates": ("sobol", "sobol-indices"),
    "levels": (*DRAWN, *LEVELLED),
    "threshold": (*DRAWN, *LEVELLED, "form"),
    "space": LEVELLED,
    "step": (*LEVELLED, "form"),
    "difference": (*LEVELLED, "form"),
    "tolerance": ("amv+", "hmv", "form"),
    "budget": ("amv+", "hmv", "form"),
    "check": (*LEVELLED, "form"),
}
