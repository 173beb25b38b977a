"""Reads the reference numbers, which are not part of the project: folder SPRAIN_REFERENCE, by default
../shared/reference beside the clone."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

FOLDER = Path(os.environ.get("SPRAIN_REFERENCE") or Path(__file__).parent.parent.parent / "shared" / "reference")


@cache
def read(name: str) -> pd.DataFrame:
    """The table `name`, a path below the folder."""
    return pd.read_csv(FOLDER / name)


def foot_surface() -> np.ndarray:
    """(7, n) facets of the paper's foot as constants.sole has them, for comparison with the project's own sole."""
    t = read("model/contact_foot_mesh_triangles.csv")
    places = [t.centroid_x_m, t.centroid_y_m - 0.005, t.centroid_z_m + 0.005, t.area_m2]
    return np.array([*places, t.normal_x**2, t.normal_y**2, t.normal_z**2])
