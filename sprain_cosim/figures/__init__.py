"""Figures: each function takes plain data and returns a matplotlib Figure, one journal column (8.5 cm) wide. Nothing
here reads a file or runs an FMU."""

from .design import Designed, design_curve, trade_off
from .landings import DEGREES, PANELS, fan, landing_signals, moment_angle, phase, sharing
from .law import calibration, torque_angle
from .questions import Answer, Exceeded, questions
from .samples import Sample, cdf, grid, level_search, percentiles, poses, published, tornado
from .style import (
    ANATOMY,
    BRACE,
    FAINT,
    GROUND,
    INK,
    SUBTALAR,
    TALOCRURAL,
    Form,
    drawn_as,
    label,
    picture,
    save,
    shorten,
)

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
    "Answer",
    "Designed",
    "Exceeded",
    "Form",
    "Sample",
    "calibration",
    "cdf",
    "design_curve",
    "drawn_as",
    "fan",
    "grid",
    "label",
    "landing_signals",
    "level_search",
    "moment_angle",
    "percentiles",
    "phase",
    "picture",
    "poses",
    "published",
    "questions",
    "save",
    "sharing",
    "shorten",
    "tornado",
    "torque_angle",
    "trade_off",
]
