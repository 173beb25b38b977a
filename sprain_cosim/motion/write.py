"""The files of a motion: the scenario, the page and the picture beside it."""

from __future__ import annotations

from pathlib import Path

from ..figures import picture
from ..files import check_file, write
from .page import motion_page, motion_scenario
from .picture import pose_figure
from .start import MotionStart


def write_motion(start: MotionStart, peaks: dict[str, float], target: Path) -> tuple[Path, Path, Path]:
    """Writes `target` (.toml), and .md and .png of the same name. Raises InputError for a target that is no name of a
    file, EnvironmentProblem."""
    check_file(target, beside=(".md", ".png"))
    page, drawing = target.with_suffix(".md"), target.with_suffix(".png")
    write(drawing, picture(pose_figure(start), "png"), parents=True)
    write(page, motion_page(start, peaks, target.name, drawing.name))
    write(target, motion_scenario(start, page.name))
    return target, page, drawing
