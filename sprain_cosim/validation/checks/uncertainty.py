"""Are the uncertainty numerics right? Problems with closed forms, and one that Dakota solved."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import stats

from ...uq.distributions import Array, JointDistribution, LogNormal, Marginal, Normal, Uniform
from ...uq.reliability import amv, amv_plus, form, hmv, mean_value
from ...uq.sampling import monte_carlo
from ...uq.sensitivity import sensitivity_factors, sobol_indices
from ...uq.statistics import order_statistic_ranks
from ..check import Check, CheckRow
from ..laboratory import Laboratory

LEVELS = (0.05, 0.5, 0.95)
A = np.array([3, -2, 1, 4, -1, 2, -3, 1, 2, -1], float)
TEN = [Normal(float(i), 0.1 * i) for i in range(1, 11)]
SPREAD = A * 0.1 * np.arange(1, 11)
MEAN, SD = float(A @ np.arange(1, 11)), float(np.linalg.norm(SPREAD))
LOGNORMALS = [LogNormal(10.0, 1.0), LogNormal(5.0, 1.0), LogNormal(2.0, 0.5)]
COLUMN = [Normal(500.0, 100.0), Normal(2000.0, 400.0), LogNormal(5.0, 0.5)]
COLUMN_CORRELATION = np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1.0]])
SAMPLE = 20_000


def linear(x: Array) -> Array:
    y: Array = x @ A
    return y


def product(x: Array) -> Array:
    return x[:, 0] ** 2 * x[:, 1] / x[:, 2]


def square(x: Array) -> Array:
    return x[:, 0] ** 2


def balls(x: Array) -> Array:
    y: Array = ((x + np.array([3.0, 2.0, 1.0])) ** 2).sum(axis=1)
    return y


def column(x: Array) -> Array:
    """Limit state of a short column under axial force and moment (Kuschel & Rackwitz 1997): b = 5, h = 15."""
    return 1 - 4 * x[:, 1] / (5 * 15**2 * x[:, 2]) - x[:, 0] ** 2 / ((5 * 15) ** 2 * x[:, 2] ** 2)


def ishigami(x: Array) -> Array:
    y: Array = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    return y


def linear_percentiles(_: Laboratory) -> list[CheckRow]:
    methods: dict[str, Callable[..., object]] = {"mean value": mean_value, "AMV": amv, "AMV+": amv_plus, "HMV": hmv}
    rows = []
    for name, method in methods.items():
        value = method(linear, TEN).value  # type: ignore[attr-defined]
        rows += [CheckRow(f"{name}, {100 * p:g} %", value[p], MEAN + SD * stats.norm.ppf(p), 1e-6 * SD) for p in LEVELS]
    return rows


def linear_importance(_: Laboratory) -> list[CheckRow]:
    found = np.asarray(amv(linear, TEN).importance[0.95])
    return [
        CheckRow(f"input {k}", float(a), float(b), 1e-6)
        for k, (a, b) in enumerate(zip(found, SPREAD / SD, strict=True), 1)
    ]


def evaluations(_: Laboratory) -> list[CheckRow]:
    return [
        CheckRow("forward differences", amv(linear, TEN).evaluations.requested, 14, 0),
        CheckRow("central differences", amv(linear, TEN, difference="central").evaluations.requested, 24, 0),
    ]


def lognormal_product(_: Laboratory) -> list[CheckRow]:
    """Its logarithm is linear in standard space, so all that work there are exact."""
    zeta = [math.log1p((m.sd / m.mean) ** 2) for m in LOGNORMALS]
    location = [math.log(m.mean) - z / 2 for m, z in zip(LOGNORMALS, zeta, strict=True)]
    mu, sigma = 2 * location[0] + location[1] - location[2], math.sqrt(4 * zeta[0] + zeta[1] + zeta[2])
    value = amv_plus(product, LOGNORMALS).value
    rows = []
    for p in LEVELS:
        expected = math.exp(mu + sigma * stats.norm.ppf(p))
        rows.append(CheckRow(f"AMV+, {100 * p:g} %", value[p], expected, 1e-5 * expected))
    rows.append(CheckRow("FORM, beta", form(product, LOGNORMALS, math.exp(mu - 1.7 * sigma)).beta, 1.7, 1e-5))
    return rows


def squares(_: Laboratory) -> list[CheckRow]:
    """z = x², x ~ N(3, 0.5): mean value 9 + 3 b, AMV (3 + b/2)²; and (U + c)² of three inputs, whose extremes are
    known."""
    rows = []
    for p in LEVELS:
        b = stats.norm.ppf(p)
        first = mean_value(square, [Normal(3.0, 0.5)], step=1e-4, difference="central").value[p]
        rows.append(CheckRow(f"mean value of a square, {100 * p:g} %", first, 9 + 3 * b, 1e-6))
        rows.append(
            CheckRow(
                f"AMV of a square, {100 * p:g} %",
                amv(square, [Normal(3.0, 0.5)], step=1e-4).value[p],
                (3 + 0.5 * b) ** 2,
                1e-6,
            )
        )
        far = (math.sqrt(14) + b) ** 2
        rows.append(
            CheckRow(
                f"AMV+ of three squares, {100 * p:g} %",
                amv_plus(balls, [Normal(0.0, 1.0)] * 3).value[p],
                far,
                1e-5 * far,
            )
        )
    return rows


def form_probabilities(_: Laboratory) -> list[CheckRow]:
    flat = form(linear, TEN, MEAN - 2.5 * SD)
    ball = form(balls, [Normal(0.0, 1.0)] * 3, 1.0)
    return [
        CheckRow("linear limit state, beta", flat.beta, 2.5, 1e-6),
        CheckRow(
            "linear limit state, probability", flat.probability, stats.norm.cdf(-2.5), 1e-5 * stats.norm.cdf(-2.5)
        ),
        CheckRow("ball, beta", ball.beta, math.sqrt(14) - 1, 1e-5),
    ]


def short_column(_: Laboratory) -> list[CheckRow]:
    """Percentiles at the probabilities of Dakota's own test, correlated inputs, in both spaces."""
    expected = {
        0.24456790666: (-2.9983189805, -2.9989829451, -3.0000000032),
        0.58912021904: (-2.0000386435, -2.0000300399, -1.9999999981),
    }
    levels = tuple(expected)
    options = {"levels": levels, "correlation": COLUMN_CORRELATION, "step": 1e-4, "difference": "central"}
    found = (
        amv(column, COLUMN, space="x", **options).value,  # type: ignore[arg-type]
        amv(column, COLUMN, space="u", **options).value,  # type: ignore[arg-type]
        amv_plus(column, COLUMN, **options).value,  # type: ignore[arg-type]
    )
    names = ("AMV, x-space", "AMV, u-space", "AMV+")
    return [
        CheckRow(f"{name} at p = {p:.4f}", value[p], expected[p][k], 1e-5 * abs(expected[p][k]))
        for k, (name, value) in enumerate(zip(names, found, strict=True))
        for p in levels
    ]


def gate(_: Laboratory) -> list[CheckRow]:
    cases: dict[str, tuple[Callable[[Array], Array], list[Marginal], str]] = {
        "u1² + 0.1 u2 rejected": (lambda x: x[:, 0] ** 2 + 0.1 * x[:, 1], [Normal(0.0, 1.0)] * 2, "rejected"),
        "(x - 0.01)² rejected": (lambda x: (x[:, 0] - 0.01) ** 2, [Normal(0.0, 1.0)], "rejected"),
        "linear accepted": (linear, list(TEN), "ok"),
    }
    return [
        CheckRow(label, float(amv(f, m, difference="central").status == status), 1.0, 0.0)
        for label, (f, m, status) in cases.items()
    ]


def factors(_: Laboratory) -> list[CheckRow]:
    """Four factors of a linear function of ten normals, and two of a product of lognormals, within four standard
    errors."""
    x = monte_carlo(JointDistribution(TEN), SAMPLE, seed=4)
    found, share = sensitivity_factors(x, linear(x), TEN), SPREAD / SD
    rows = []
    for name, expected in (
        ("dmean_dmean", share),
        ("dsd_dsd", share**2),
        ("dmean_dsd", 0 * share),
        ("dsd_dmean", 0 * share),
    ):
        error = np.asarray(getattr(found.standard_error, name))
        rows += [
            CheckRow(
                f"linear, {name}, input {k + 1}",
                float(getattr(found, name)[k]),
                float(expected[k]),
                float(4 * error[k]),
            )
            for k in range(len(share))
        ]
    x = monte_carlo(JointDistribution(LOGNORMALS), SAMPLE, seed=5)
    found = sensitivity_factors(x, product(x), LOGNORMALS)
    closed = {"dmean_dmean": (0.5115110, 0.5166261, -0.7217571), "dsd_dsd": (0.3236659, 0.2950986, 0.5689743)}
    for name, values in closed.items():
        error = np.asarray(getattr(found.standard_error, name))
        rows += [
            CheckRow(
                f"lognormals, {name}, input {k + 1}", float(getattr(found, name)[k]), values[k], float(4 * error[k])
            )
            for k in range(3)
        ]
    return rows


def ishigami_indices(_: Laboratory) -> list[CheckRow]:
    found = sobol_indices(ishigami, [Uniform(-math.pi, math.pi)] * 3, 4096, seed=3)
    rows = []
    for kind, closed in (("first", (0.3139, 0.4424, 0.0)), ("total", (0.5576, 0.4424, 0.2437))):
        value, low, high = (np.asarray(getattr(found, f"{kind}{end}")) for end in ("", "_low", "_high"))
        rows += [
            CheckRow(f"{kind}, input {k + 1}", float(value[k]), v, float(high[k] - low[k]))
            for k, v in enumerate(closed)
        ]
    return rows


def intervals(_: Laboratory) -> list[CheckRow]:
    """The binomial probability between the two ranks lies between 95 and 100 %, and at n = 1000 is that of the
    narrowest pair."""
    rows = []
    for n, p in ((100, 0.5), (1000, 0.05), (1000, 0.5), (1000, 0.95), (200, 0.9)):
        low, high = order_statistic_ranks(n, p)
        coverage = float(stats.binom.cdf(high - 1, n, p) - stats.binom.cdf(low - 1, n, p))
        rows.append(CheckRow(f"{100 * p:g} % of {n}", 100 * coverage, 97.5, 2.5, "%"))
    return rows


def nataf(_: Laboratory) -> list[CheckRow]:
    """Correlation in standard space for a wanted Pearson correlation of 0.4: ln(1 + r d1 d2)/(z1 z2), and r d/z beside
    a normal."""
    d, r = 0.5, 0.4
    zeta = math.sqrt(math.log1p(d * d))
    target = np.array([[1, r], [r, 1]])
    both = JointDistribution([LogNormal(2.0, 1.0), LogNormal(4.0, 2.0)], target).normal_correlation[0, 1]
    mixed = JointDistribution([Normal(0.0, 1.0), LogNormal(4.0, 2.0)], target).normal_correlation[0, 1]
    return [
        CheckRow("two lognormals", float(both), math.log1p(r * d * d) / zeta**2, 1e-12),
        CheckRow("normal and lognormal", float(mixed), r * d / zeta, 1e-12),
    ]


def openturns_form(_: Laboratory) -> list[CheckRow]:
    import openturns as ot

    ot.Log.Show(ot.Log.NONE)
    threshold = -4.0
    lognormal = ot.ParametrizedDistribution(ot.LogNormalMuSigma(5.0, 0.5))
    copula = ot.NormalCopula(
        ot.CorrelationMatrix(JointDistribution(COLUMN, COLUMN_CORRELATION).normal_correlation.tolist())
    )
    joint = ot.JointDistribution([ot.Normal(500.0, 100.0), ot.Normal(2000.0, 400.0), lognormal], copula)
    function = ot.PythonFunction(3, 1, func_sample=lambda x: column(np.asarray(x))[:, np.newaxis])
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(joint)), ot.LessOrEqual(), threshold)
    solver = ot.AbdoRackwitz()
    for limit in (
        solver.setMaximumAbsoluteError,
        solver.setMaximumRelativeError,
        solver.setMaximumResidualError,
        solver.setMaximumConstraintError,
    ):
        limit(1e-8)
    solver.setStartingPoint(joint.getMean())
    analysis = ot.FORM(solver, event)
    analysis.run()
    result = analysis.getResult()
    ours = form(column, COLUMN, threshold, correlation=COLUMN_CORRELATION)
    return [
        CheckRow("beta", ours.beta, result.getHasoferReliabilityIndex(), 1e-5),
        CheckRow("probability", ours.probability, result.getEventProbability(), 1e-4 * result.getEventProbability()),
    ]


CLOSED_FORM = "closed form"
DIFFERENCES = "rounding of the finite differences"
CHECKS = (
    Check(
        "uq-01",
        "Percentiles of a linear function of ten normals, four methods",
        DIFFERENCES,
        CLOSED_FORM,
        linear_percentiles,
    ),
    Check("uq-02", "Importance levels of a linear function", DIFFERENCES, CLOSED_FORM, linear_importance),
    Check(
        "uq-03",
        "Evaluations asked by AMV for ten inputs and three levels",
        "a count",
        "1 + n + levels; 1 + 2 n + levels",
        evaluations,
    ),
    Check("uq-04", "A product of lognormals: AMV+ and FORM", "iteration stops at 1e-6", CLOSED_FORM, lognormal_product),
    Check("uq-05", "Mean value and AMV of a square, AMV+ of three", DIFFERENCES, CLOSED_FORM, squares),
    Check("uq-06", "FORM of a plane and of a ball", "iteration stops at 1e-6", CLOSED_FORM, form_probabilities),
    Check(
        "uq-07",
        "Short column with correlated inputs, AMV in both spaces, AMV+",
        "1e-5 relative: both sides iterate",
        "Dakota's own test values",
        short_column,
    ),
    Check(
        "uq-08",
        "The gate rejects functions that are not monotonic, accepts a linear one",
        "a verdict",
        "by construction",
        gate,
    ),
    Check(
        "uq-09",
        "Probabilistic sensitivity factors",
        "four standard errors of the estimate from 20 000 trials",
        CLOSED_FORM,
        factors,
    ),
    Check(
        "uq-10",
        "Sobol' indices of the Ishigami function",
        "twice the half-width of its own 95 % interval",
        CLOSED_FORM,
        ishigami_indices,
    ),
    Check(
        "uq-11",
        "Order-statistic intervals of percentiles cover at least 95 %",
        "from 95 to 100 %",
        "binomial distribution",
        intervals,
    ),
    Check(
        "uq-12",
        "Correlation in standard space (Nataf)",
        "rounding",
        "closed form, Der Kiureghian & Liu 1986",
        nataf,
    ),
    Check("uq-13", "FORM against OpenTURNS", "both iterate to 1e-6", "OpenTURNS", openturns_form, needs=("openturns",)),
)
