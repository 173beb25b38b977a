"""Figures: each function takes plain data and returns a matplotlib Figure, one journal column (8.5 cm) wide. Nothing
here reads a file or runs an FMU."""

from .landings import DEGREES, PANELS, fan, landing, moment_angle, phase, sharing
from .law import torque_angle
from .samples import Sample, amv, cdf, grid, percentiles, poses, published, tornado
from .style import ANATOMY, BRACE, FAINT, GROUND, INK, SUBTALAR, TALOCRURAL, label, picture, save, shorten

__all__ = [
    "ANATOMY",
    "BRACE",
    "DEGREES",
    "FAINT",
    "GROUND",
    "INK",
    "PANELS",
    "SUBTALAR",
    "TALOCRURAL",
    "Sample",
    "amv",
    "cdf",
    "fan",
    "grid",
    "label",
    "landing",
    "moment_angle",
    "percentiles",
    "phase",
    "picture",
    "poses",
    "published",
    "save",
    "sharing",
    "shorten",
    "tornado",
    "torque_angle",
]
