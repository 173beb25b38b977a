"""Populations: the base person's factors, sampled populations against the table they are drawn from."""

from __future__ import annotations

import numpy as np

from ...study.population import Population
from ...subject.anthropometry import MASS, NOUNS_OF_MANY, SEXES, anthropometry
from ...subject.person import BASE
from ...uq.sampling import monte_carlo
from ..check import Check, CheckRow
from ..laboratory import Laboratory

N, SEED = 4000, 3
STANDARD_ERRORS = 4.0  # of the worst of nine means or SD, or of 36 correlations


def base_person_factors(_: Laboratory) -> list[CheckRow]:
    """Of the person with whom the plant was made: mass and factors as the plant has them."""
    own = BASE.parameters()
    factors = [value for name, value in own.items() if "_scale_" in name]
    return [
        CheckRow("body mass", own["body_mass"], 67.54377325440001, 0.0, "kg"),
        CheckRow("largest factor", max(factors), 1.0, 0.0),
        CheckRow("smallest factor", min(factors), 1.0, 0.0),
    ]


def sampled_persons(_: Laboratory) -> list[CheckRow]:
    """The largest gap of means, standard deviations and correlations, in standard errors of the sample."""
    rows = []
    for sex in SEXES:
        population, table = Population({sex: 1.0}), anthropometry(sex)
        marginals = population.marginals
        x = monte_carlo(population.joint(marginals, population.correlations(list(marginals), None)), N, SEED)
        names = list(population.measures)
        mean, sd = (np.array([of[name] for name in names]) for of in (table.mean, table.sd))
        excess = np.mean((x - mean) ** 4, axis=0) / sd**4 - 1.0
        z = np.column_stack([np.log(x[:, k]) if name == MASS else x[:, k] for k, name in enumerate(names)])
        at = [table.names.index(name) for name in names]
        above = np.triu_indices(len(names), 1)
        found, expected = np.corrcoef(z.T)[above], table.correlation[np.ix_(at, at)][above]
        gaps = {
            "means": (x.mean(axis=0) - mean) / sd * np.sqrt(N),
            "standard deviations": (x.std(axis=0, ddof=1) / sd - 1.0) * 2.0 * np.sqrt(N / excess),
            "correlations": (np.arctanh(found) - np.arctanh(expected)) * np.sqrt(N - 3),
        }
        who = NOUNS_OF_MANY[sex]
        rows += [
            CheckRow(f"{what} of {who}", float(np.abs(gap).max()), 0.0, STANDARD_ERRORS, "SE")
            for what, gap in gaps.items()
        ]
    return rows


CHECKS = (
    Check("uq-14", "Persons: the base person has factors of 1", "to the bit", "by construction", base_person_factors),
    Check(
        "uq-15",
        f"Persons: samples of {N} women and men have the table's moments and correlations",
        "four standard errors of the sample for the worst of nine measures",
        "ANSUR II, C. C. Gordon et al. 2014",
        sampled_persons,
    ),
)
