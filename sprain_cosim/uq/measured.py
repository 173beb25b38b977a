"""A distribution known from n specimens: what its parameters may be, given that they were estimated.

Normal, and lognormal in its logarithm: with mean m, standard deviation s (n − 1) and the reference prior 1/σ, the
posterior is normal–inverse-gamma: σ² = (n − 1)s²/χ²(n − 1), μ = m + σ·z/√n. Weibull: ln x follows a law of location and
scale, and the same prior gives the law of the pivots of its maximum-likelihood estimates, which is simulated (J. F.
Lawless, Statistical models and methods for lifetime data, 2nd ed. 2003, chapter 5; exact for the pair of estimates).

Intervals drawn from these cover as often as they state when the family is right; that it is, n specimens seldom tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv, ndtr

from .distributions import Array, JointDistribution, LogNormal, Marginal, Normal, Weibull
from .distributions.marginal import as_array
from .fitting import MIN_SPECIMENS, SampleFit, extreme_estimates
from .sampling import Stream, generator, sobol

__all__ = ["DRAWS", "Measured", "ParameterDraws"]

DRAWS = 4096


@dataclass(frozen=True)
class ParameterDraws:
    """b members of one family, as location and scale (b,) of x (normal) or of ln x (lognormal, Weibull)."""

    location: Array
    scale: Array
    logarithmic: bool
    extreme: bool

    def _standard(self, x: ArrayLike) -> Array:
        """(b, n) standardised values of x (n,)."""
        values = as_array(x)
        if self.logarithmic:
            with np.errstate(divide="ignore"):
                values = np.log(np.maximum(values, 0.0))
        return as_array((values - self.location[:, np.newaxis]) / self.scale[:, np.newaxis])

    def cdf(self, x: ArrayLike) -> Array:
        """(b, n) P(X ≤ x) under every member."""
        z = self._standard(x)
        return as_array(-np.expm1(-np.exp(np.minimum(z, 700.0)))) if self.extreme else as_array(ndtr(z))

    def log_density(self, x: ArrayLike) -> Array:
        """(b, n) ln of the density of x, or of ln x, under every member: enough for ratios of densities."""
        z = self._standard(x)
        shape = z - np.exp(np.minimum(z, 700.0)) if self.extreme else -0.5 * (z**2 + math.log(2.0 * math.pi))
        return as_array(shape - np.log(self.scale)[:, np.newaxis])


@dataclass(frozen=True)
class Measured:
    """A normal, lognormal or Weibull distribution whose parameters were estimated from n specimens.

    marginal  the estimate
    n         specimens behind it, at least 3
    """

    marginal: Marginal
    n: int

    def __post_init__(self) -> None:
        if not isinstance(self.marginal, Normal | LogNormal | Weibull):
            raise ValueError(
                f"a number of specimens goes with normal, lognormal or weibull, not with {type(self.marginal).__name__}"
            )
        if self.n < MIN_SPECIMENS:
            raise ValueError(f"n = {self.n}: at least {MIN_SPECIMENS} specimens are needed behind a distribution")

    @classmethod
    def of_fit(cls, fit: SampleFit) -> Measured:
        return cls(fit.marginal, fit.n)

    def with_specimens(self, n: int) -> Measured:
        """The same estimate, had it come from another number of specimens."""
        return Measured(self.marginal, n)

    def stated(self) -> ParameterDraws:
        """The estimate itself, as the one draw."""
        location, scale = self._location_and_scale()
        return self._draws(np.array([location]), np.array([scale]))

    def draws(self, seed: int = 0, size: int = DRAWS) -> ParameterDraws:
        """`size` members of the family as the specimens leave them possible (a power of two is balanced best)."""
        location, scale = self._location_and_scale()
        if isinstance(self.marginal, Weibull):
            rng = generator(seed, Stream.THRESHOLD)
            estimates = extreme_estimates(np.log(rng.standard_exponential((size, self.n))))
            scales = scale / estimates[1]
            return self._draws(location - estimates[0] * scales, scales)
        u = sobol(JointDistribution([Normal(0.0, 1.0)] * 2), size, seed, replicates=1)
        half = 0.5 * (self.n - 1)
        scales = scale * np.sqrt(half / gammaincinv(half, ndtr(u[:, 0])))
        return self._draws(location + scales * u[:, 1] / math.sqrt(self.n), scales)

    def _draws(self, location: Array, scale: Array) -> ParameterDraws:
        return ParameterDraws(
            location, scale, not isinstance(self.marginal, Normal), isinstance(self.marginal, Weibull)
        )

    def _location_and_scale(self) -> tuple[float, float]:
        match self.marginal:
            case Weibull() as weibull:
                return math.log(weibull.scale), 1.0 / weibull.shape
            case LogNormal() as lognormal:
                return lognormal.lam, lognormal.zeta
            case marginal:
                return marginal.mean, marginal.sd
