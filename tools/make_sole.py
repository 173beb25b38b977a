"""Makes the plant's sole (fmus/plant/data/sole.csv) from the surface of the paper's foot.

The surface, given as facets (centroid, normal, area), is sampled anew on a regular grid: every facet is spread over a 2
x 2 pattern in its own plane (0.3 of its width), the samples are gathered in cubic cells, and each cell becomes two
equal facets that keep its area, its centroid and its largest second moment, and the mean squares of its normals'
components, from which the area of a scaled foot follows. Parts above HIGHEST never come near the platform and are left
out. docs/validation.md shows what this costs. Run: python tools/make_sole.py [folder with
contact_foot_mesh_triangles.csv]"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parent.parent))

from tools.reference import FOLDER

CELL = 0.0055  # m; 8 mm costs 0.06 deg RMS of peak subtalar angle, 5.5 mm 0.02 deg
SPREAD = 0.3
HIGHEST = 0.035  # m above the calcaneus origin; no landing of the studies wets more than 0.025 m
OFFSET = (0.0, -0.005, 0.005)  # m, surface frame to calcaneus frame
TARGET = Path(__file__).parent.parent / "fmus" / "plant" / "data" / "sole.csv"


def sample(centroid: np.ndarray, normal: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(4 n, 3) points, (4 n,) areas and (4 n, 3) normals: a 2 x 2 pattern in the plane of each facet."""
    first = np.cross(normal, [0.3, 0.9, 0.1])
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(normal, first)
    reach = 0.25 * SPREAD * np.sqrt(area)[:, None]
    points = [centroid + reach * (a * first + b * second) for a in (-1, 1) for b in (-1, 1)]
    return np.vstack(points), np.tile(area / 4, 4), np.tile(normal, (4, 1))


def gather(points: np.ndarray, areas: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(m, 7) facets x, y, z, area, mean squares of the normals' components: two for every occupied cell of the grid."""
    cells, member = np.unique(np.floor(points / CELL + 0.5).astype(int), axis=0, return_inverse=True)
    facets = []
    for k in range(len(cells)):
        inside = member.ravel() == k
        weight, here = areas[inside], points[inside]
        mean = weight @ here / weight.sum()
        spread, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, here - mean, here - mean) / weight.sum())
        half = np.sqrt(max(spread[2], 0.0)) * axes[:, 2]
        squares = weight @ normals[inside] ** 2 / weight.sum()
        facets += [[*(mean + sign * half), weight.sum() / 2, *squares] for sign in (-1, 1)]
    return np.array(facets)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER / "model"
    surface = pd.read_csv(folder / "contact_foot_mesh_triangles.csv")
    centroid = surface[["centroid_x_m", "centroid_y_m", "centroid_z_m"]].to_numpy() + OFFSET
    normals = surface[["normal_x", "normal_y", "normal_z"]].to_numpy()
    facets = gather(*sample(centroid, normals, surface["area_m2"].to_numpy()))
    facets = facets[facets[:, 1] < HIGHEST]
    with open(TARGET, "w", encoding="utf-8", newline="\n") as file:
        file.write(
            "# The sole: facets in the calcaneus frame, resampled on a regular grid by tools/make_sole.py from the "
            "foot surface of\n"
        )
        file.write(
            "# Yoder, Petrella & Farrokhi 2021, doi 10.3389/fbioe.2021.765331 (areas and first moments kept, parts "
            "that never touch left out).\n# normal_*: mean square of that component of the facet's normals.\n"
        )
        file.write("x_m,y_m,z_m,area_m2,normal_x,normal_y,normal_z\n")
        for x, y, z, area, *squares in facets:
            file.write(f"{x:.6f},{y:.6f},{z:.6f},{area:.5e},{','.join(f'{v:.5f}' for v in squares)}\n")
    print(f"{len(facets)} facets, {facets[:, 3].sum() * 1e4:.1f} cm2 -> {TARGET}")


if __name__ == "__main__":
    main()
