"""What every marginal offers: a strictly increasing function x(u) of a standard normal variable u."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri

__all__ = ["Array", "Marginal", "as_array", "between", "density", "mass_between", "require_finite", "times_density"]

Array = NDArray[np.float64]


def as_array(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float)


def density(v: ArrayLike) -> Array:
    """Standard normal density; 0 at ±inf."""
    near = np.clip(as_array(v), -100.0, 100.0)  # beyond, the density is 0 and a square may overflow
    return as_array(np.exp(-0.5 * np.square(near)) / math.sqrt(2.0 * math.pi))


def require_finite(owner: object, **values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f"{type(owner).__name__}: {name} must be finite, got {value}")


class Marginal(ABC):
    """One random input: an increasing function x(u) of a standard normal variable u.

    `mean` and `sd` are those of x. Units are the caller's; every method keeps the shape of its argument. x(u) is
    strictly increasing and continuous but for `Choices` (`is_discrete`), which has steps, and for the ties of an
    `Empirical` sample.
    """

    if TYPE_CHECKING:  # fields of some marginals, properties of others

        @property
        def mean(self) -> float: ...

        @property
        def sd(self) -> float: ...

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Lowest and highest possible x (±inf where unbounded)."""

    @abstractmethod
    def from_standard(self, u: ArrayLike) -> Array:
        """x(u)."""

    @abstractmethod
    def to_standard(self, x: ArrayLike) -> Array:
        """u(x); ∓inf at and beyond the ends of the support."""

    @abstractmethod
    def slope(self, u: ArrayLike) -> Array:
        """dx/du at u."""

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        """∂ ln f/∂mean and ∂ ln f/∂sd at x, f being the density: the score functions of the sensitivity
        factors.

        NaN where they do not exist (uniform: its ends move with the parameters; fixed: no density).
        """
        nan = np.full(np.shape(x), np.nan)
        return nan, nan

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        """∂u/∂mean and ∂u/∂sd at a held x; NaN where `score` is."""
        nan = np.full(np.shape(x), np.nan)
        return nan, nan

    def cdf(self, x: ArrayLike) -> Array:
        """P(X ≤ x)."""
        return as_array(ndtr(self.to_standard(x)))

    @property
    def is_fixed(self) -> bool:
        return False

    @property
    def is_discrete(self) -> bool:
        """x takes single values: there is no slope for a search to follow."""
        return False

    @property
    def has_kinks(self) -> bool:
        """x(u) is not smooth, which a Gauss rule would take badly."""
        return False

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        """Mean and standard deviation of x given a ≤ u ≤ b, by quadrature over the truncated variable's own u."""
        from scipy.integrate import quad  # slow to import

        mass = mass_between(a, b)

        def integrand(w: float) -> float:
            return float(self.from_standard(between(as_array(w), a, b, mass)))

        def expectation(power: int, centre: float) -> float:
            # 12 standard deviations either side hold all but 1e-32 of the weight.
            parts = [
                quad(lambda w: (integrand(w) - centre) ** power * float(density(w)), *ends, epsabs=0.0, epsrel=1e-11)[0]
                for ends in ((-12.0, -3.0), (-3.0, 0.0), (0.0, 3.0), (3.0, 12.0))
            ]
            return math.fsum(parts)

        first = integrand(0.0)
        mean = first + expectation(1, first)
        return mean, math.sqrt(expectation(2, mean))

    def probability_outside(self, low: float, high: float) -> float:
        """P(x < low or x > high)."""
        below, above = self.to_standard(np.array([low, high], dtype=float))
        return float(ndtr(below) + ndtr(-above))


def between(u: Array, a: float, b: float, mass: float) -> Array:
    """The normal variable v(u) that is standard normal given a ≤ v ≤ b; `mass` = Φ(b) − Φ(a)."""
    # Each half is counted from its own end, so that neither tail loses its digits.
    lower = ndtri(ndtr(a) + mass * ndtr(u))
    upper = -ndtri(ndtr(-b) + mass * ndtr(-u))
    return as_array(np.clip(np.where(lower < 0, lower, upper), a, b))


def times_density(v: float) -> float:
    return 0.0 if math.isinf(v) else float(v * density(v))


def mass_between(a: float, b: float) -> float:
    """Φ(b) − Φ(a), counted in the tail where both lie."""
    if a > 0:
        a, b = -b, -a
    return math.exp(log_ndtr(b)) - math.exp(log_ndtr(a)) if b < 0 else float(ndtr(b) - ndtr(a))
