"""OpenTURNS as an oracle: distributions, the Nataf transform, FORM, Sobol' indices and quantiles computed by somebody
else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sprain_cosim.uq import LogNormal, Normal, Truncated, Uniform
from sprain_cosim.uq.distributions import JointDistribution
from sprain_cosim.uq.reliability import form, sorm
from sprain_cosim.uq.sampling import monte_carlo, sobol
from sprain_cosim.uq.sensitivity import sobol_indices
from sprain_cosim.uq.statistics import percentile, replicated_percentile

ot = pytest.importorskip("openturns")
INPUTS = [Normal(-34.0, 5.0), LogNormal(0.30, 0.05), Uniform(0.0, 2.0)]
CORRELATION = np.array([[1.0, 0.4, -0.3], [0.4, 1.0, 0.2], [-0.3, 0.2, 1.0]])


def theirs(marginal):
    match marginal:
        case Normal():
            return ot.Normal(marginal.mean, marginal.sd)
        case LogNormal():
            return ot.ParametrizedDistribution(ot.LogNormalMuSigma(marginal.mean, marginal.sd))
        case Uniform():
            return ot.Uniform(marginal.low, marginal.high)
        case Truncated():
            return ot.TruncatedDistribution(theirs(marginal.parent), marginal.low, marginal.high)


def joined(joint: JointDistribution):
    copula = ot.NormalCopula(ot.CorrelationMatrix(joint.normal_correlation.tolist()))
    return ot.JointDistribution([theirs(m) for m in joint.marginals], copula)


@pytest.mark.parametrize(
    "marginal",
    [*INPUTS, LogNormal(5.0, 1.0), Truncated(Normal(0.2, 0.1), 0.0, 1.0), Truncated(LogNormal(0.2, 0.05), 0.1, 0.3)],
    ids=repr,
)
def test_marginals(marginal) -> None:
    other = theirs(marginal)
    assert marginal.mean == pytest.approx(other.getMean()[0], rel=1e-7)
    assert marginal.sd == pytest.approx(other.getStandardDeviation()[0], rel=1e-6)
    u = np.linspace(-4, 4, 17)
    quantiles = [other.computeQuantile(p)[0] for p in 0.5 * np.array([math.erfc(-v / math.sqrt(2)) for v in u])]
    assert marginal.from_standard(u) == pytest.approx(quantiles, rel=1e-8, abs=1e-9)


def test_nataf_gives_the_correlation_asked_for() -> None:
    """Pearson's correlation of a sample that OpenTURNS draws with our normal correlation, within four standard
    errors."""
    joint, size = JointDistribution(INPUTS, CORRELATION), 200_000
    ot.RandomGenerator.SetSeed(1)
    found = np.corrcoef(np.array(joined(joint).getSample(size)).T)
    assert found == pytest.approx(CORRELATION, abs=4 / math.sqrt(size))


def test_transform_to_the_standard_space() -> None:
    joint = JointDistribution(INPUTS, CORRELATION)
    x = monte_carlo(joint, 50, seed=3)
    assert np.array(joined(joint).getIsoProbabilisticTransformation()(x)) == pytest.approx(
        joint.to_standard(x), abs=1e-6
    )


@pytest.mark.parametrize("threshold", [-8.0, 3.0, 12.0])
def test_form_and_sorm(threshold: float) -> None:
    """A landing-like response, correlated inputs of three families; the event lies in either tail."""
    joint = JointDistribution(INPUTS, CORRELATION)

    def response(x: np.ndarray) -> np.ndarray:
        return 0.3 * (x[:, 0] + 34) + 30 * np.sqrt(np.abs(x[:, 1])) - 12 * x[:, 2] - 0.01 * (x[:, 0] + 34) ** 2

    found = form(response, INPUTS, threshold, CORRELATION, step=1e-5, tolerance=1e-8)
    vector = ot.RandomVector(joined(joint))
    limit = ot.PythonFunction(3, 1, func=lambda x: [float(response(np.array([x]))[0])])
    event = ot.ThresholdEvent(ot.CompositeRandomVector(limit, vector), ot.LessOrEqual(), threshold)
    solver = ot.AbdoRackwitz()
    solver.setMaximumIterationNumber(200)
    for stop in ("AbsoluteError", "RelativeError", "ResidualError", "ConstraintError"):
        getattr(solver, f"setMaximum{stop}")(1e-10)
    solver.setStartingPoint(joined(joint).getMean())
    algorithm = ot.FORM(solver, event)
    algorithm.run()
    result = algorithm.getResult()
    assert found.status == "ok"
    assert found.probability == pytest.approx(result.getEventProbability(), rel=1e-5)
    assert found.standard_point == pytest.approx(np.array(result.getStandardSpaceDesignPoint()), abs=1e-4)
    second = ot.SORM(solver, event)
    second.run()
    assert sorm(response, INPUTS, found, CORRELATION).breitung == pytest.approx(
        second.getResult().getEventProbabilityBreitung(), rel=1e-4
    )


def test_sobol_indices() -> None:
    """Each estimate within the other's reach: our 99 % intervals against Martinez' estimates from 2¹⁵ rows."""
    inputs = [LogNormal(0.30, 0.05), Normal(-34.0, 5.0), Uniform(0.0, 2.0)]

    def response(x: np.ndarray) -> np.ndarray:
        return 60 * np.sqrt(x[:, 0]) + 0.05 * (x[:, 1] + 40) * x[:, 2] ** 2

    ours = sobol_indices(response, inputs, 8192, seed=1, replicates=16, confidence=0.99)
    ot.RandomGenerator.SetSeed(1)
    size = 2**15
    design = ot.SobolIndicesExperiment(ot.JointDistribution([theirs(m) for m in inputs]), size).generate()
    other = ot.MartinezSensitivityAlgorithm(design, ot.Sample(response(np.array(design))[:, None]), size)
    assert ours.first == pytest.approx(np.array(other.getFirstOrderIndices()), abs=0.01)
    assert ours.total == pytest.approx(np.array(other.getTotalOrderIndices()), abs=0.01)


def test_quantiles_of_a_sum_of_normals_and_lognormals() -> None:
    """OpenTURNS has the distribution of a weighted sum without sampling; ours must hold its quantiles between their
    intervals."""
    inputs, weights = (
        [Normal(-34.0, 5.0), LogNormal(0.30, 0.05), LogNormal(0.2, 0.05), Uniform(0.0, 2.0)],
        np.array([0.3, 40.0, -10.0, 1.0]),
    )
    exact = ot.LinearCombinationDistribution([theirs(m) for m in inputs], weights.tolist(), 0.0)
    joint = JointDistribution(inputs)
    y, q = monte_carlo(joint, 4000, seed=1) @ weights, sobol(joint, 4096, seed=1, replicates=8) @ weights
    for p in (0.05, 0.5, 0.95):
        expected = exact.computeQuantile(p)[0]
        found, smooth = percentile(y, p, 0.999), replicated_percentile(q, 8, p, 0.999)
        assert found.low <= expected <= found.high
        assert smooth.low <= expected <= smooth.high
        assert smooth.half_width < found.half_width
