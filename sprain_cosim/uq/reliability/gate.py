"""Cheap signals against a method of the mean value family, read off the evaluations it makes anyway."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from .differences import unit_vector
from .linearisation import Linearisation, Setting
from .points import Array, Status

__all__ = ["Gate"]

_CURVATURE_LIMIT = 0.5  # second-order share of the response at the outermost level
_DEPARTURE_LIMIT = 0.5  # |AMV − MV| over |MV − g0|
_TURN_LIMIT = math.radians(30.0)
_VARIANCE_LIMIT = 0.5  # linearised variance over sampled variance
_NOISE_LIMIT = 0.1  # error of the slopes from noise, over their norm


@dataclass
class Gate:
    """Collects the signals against the mean value methods."""

    setting: Setting
    linear: Linearisation
    noise: float | None
    suspicions: list[str] = field(default_factory=list)
    rejections: list[str] = field(default_factory=list)

    def look_at_slopes(self) -> None:
        joint, slopes = self.setting.joint, self.linear.slopes
        norm = self.linear.sd
        if norm == 0.0:
            self.rejections.append("every slope at the mean inputs is zero: the linearisation says nothing")
            return
        still = [int(i) for i in joint.active if slopes.moved[i] == 0.0]
        if (
            still and slopes.resolution is not None
        ):  # without such steps an input that moves nothing is one without influence
            self.suspicions.append(
                f"the response comes in steps of {slopes.resolution:g}, and {len(still)} of {len(joint.active)} "
                "inputs (number "
                f"{', '.join(map(str, still))}) do not move it over a step of {self.setting.step:g} sd: take a larger "
                "step or more digits"
            )
        if self.noise is not None:
            error = self.noise / self.setting.step * math.sqrt(len(joint.active))
            error *= 1.0 / math.sqrt(2.0) if self.setting.difference == "central" else math.sqrt(2.0)
            if error > _NOISE_LIMIT * norm:
                self.suspicions.append(
                    f"noise of {self.noise:g} in the response makes the slopes uncertain by "
                    f"{error / norm:.0%} of their norm: a step above "
                    f"{self.setting.step * error / (_NOISE_LIMIT * norm):.2g} sd is needed"
                )
        if slopes.curvature is not None:
            self._look_at_curvature(slopes.curvature, norm)

    def _look_at_curvature(self, curvature: Array, norm: float) -> None:
        joint, reach = self.setting.joint, self.setting.outermost
        bend = np.abs(curvature) * joint.sds**2
        if self.noise is not None:  # what noise alone can make of a second difference
            bend = np.maximum(bend - math.sqrt(6.0) * self.noise / self.setting.step**2, 0.0)
        ratio = 0.5 * bend * reach / norm
        for i in np.flatnonzero(ratio > _CURVATURE_LIMIT):
            # The slope changes sign at reach/(2·ratio) or nearer: within the levels in any case, decisive where the
            # bent part outweighs the linear one.
            if ratio[i] > 1.0:
                self.rejections.append(
                    f"input number {i}: the one-sided slopes change sign well within the outermost level "
                    f"(curvature ratio {ratio[i]:.2g}); the response is not monotonic"
                )
            else:
                self.suspicions.append(f"input number {i}: curvature ratio {ratio[i]:.2g} is above {_CURVATURE_LIMIT}")

    def look_at_order(self, value: Mapping[float, float]) -> None:
        ordered = sorted(value)
        for low, high in itertools.pairwise(ordered):
            if value[high] <= value[low]:
                self.rejections.append(
                    f"the percentiles do not increase: {value[low]:.6g} at {low:g}, {value[high]:.6g} at {high:g}"
                )

    def look_at_departure(self, value: Mapping[float, float]) -> None:
        for level in sorted(value):
            expected = self.linear.value(level)
            spread = abs(expected - self.linear.slopes.value)
            if spread > 0 and abs(value[level] - expected) > _DEPARTURE_LIMIT * spread:
                self.suspicions.append(
                    f"level {level:g}: {value[level]:.6g} departs from the linearisation's {expected:.6g} by more "
                    "than half of its distance from the centre"
                )

    def look_at_turn(self, level: float, gradient_u: Array) -> None:
        cosine = float(unit_vector(gradient_u) @ self.linear.importance)
        if ndtri(level) and cosine < math.cos(_TURN_LIMIT):
            self.suspicions.append(
                f"level {level:g}: the gradient at the design point is turned by "
                f"{math.degrees(math.acos(max(cosine, -1.0))):.0f}° from that at the mean inputs"
            )

    def look_at_variance(self, variance: float | None) -> None:
        if variance is not None and self.linear.sd**2 < _VARIANCE_LIMIT * variance:
            self.suspicions.append(
                f"the linearisation explains {self.linear.sd**2 / variance:.0%} of the sampled variance"
            )

    @property
    def status(self) -> Status:
        return "rejected" if self.rejections else "suspect" if self.suspicions else "ok"

    @property
    def reasons(self) -> tuple[str, ...]:
        return (*self.rejections, *self.suspicions)
