"""Figures: each function takes plain data and returns a matplotlib Figure, one journal column (8.5 cm) wide. Nothing
here reads a file or runs an FMU."""

from .design import Designed, design_curve, trade_off
from .forest import Changed, Difference, forest
from .landings import DEGREES, PANELS, fan, landing_signals, moment_angle, phase, sharing
from .law import calibration, torque_angle
from .pairs import Column, pairs
from .questions import Answer, Exceeded, questions
from .samples import Sample, cdf, grid, level_search, percentiles, poses, published, tornado
from .searches import event_search, variance_shares
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
    "Changed",
    "Column",
    "Designed",
    "Difference",
    "Exceeded",
    "Form",
    "Sample",
    "calibration",
    "cdf",
    "design_curve",
    "drawn_as",
    "event_search",
    "fan",
    "forest",
    "grid",
    "label",
    "landing_signals",
    "level_search",
    "moment_angle",
    "pairs",
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
    "variance_shares",
]
