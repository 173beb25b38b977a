"""Reads the reference numbers (folder SPRAIN_REFERENCE, default ../shared/reference); tests that need them skip where
it is absent."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

FOLDER = Path(os.environ.get("SPRAIN_REFERENCE", Path(__file__).parent.parent.parent / "shared" / "reference"))
needs_reference = pytest.mark.skipif(not FOLDER.is_dir(), reason="reference numbers not found (set SPRAIN_REFERENCE)")


@cache
def read(name: str) -> pd.DataFrame:
    return pd.read_csv(FOLDER / name)


def foot_surface() -> np.ndarray:
    """(4, n) facets of the paper's foot in the calcaneus frame: for comparison with the project's own sole."""
    t = read("model/contact_foot_mesh_triangles.csv")
    return np.array([t.centroid_x_m, t.centroid_y_m - 0.005, t.centroid_z_m + 0.005, t.area_m2])
