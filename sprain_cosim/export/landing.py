"""A landing as a table for other tools: OpenSim's storage files (.sto, .mot), CSV, Parquet.

Names and units are those of the OpenSim model: coordinates by their own names, states by path
(/jointset/ankle_r/ankle_angle_r/value, /forceset/soleus_r/activation), ground reaction as in OpenSim's external loads
files. Angles are radians; only the coordinates of a .mot are in degrees."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import EnvironmentProblem, InputError, nearest
from ..files import whole_file
from ..folders.landing import Landing

if TYPE_CHECKING:
    import pandas as pd

JOINTS = {
    "ground_pelvis": ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz"),
    "hip_r": ("hip_flexion_r", "hip_adduction_r", "hip_rotation_r"),
    "knee_r": ("knee_angle_r",),
    "ankle_r": ("ankle_angle_r",),
    "subtalar_r": ("subtalar_angle_r",),
    "back": ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
}
COORDINATES = tuple(name for names in JOINTS.values() for name in names)
TRANSLATIONS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
FORMATS = {
    "sto": "states",
    "mot": "coordinates",
    "csv": "signals",
    "parquet": "signals",
}  # and the content of each by default


def coordinates(run: Landing, speeds: bool = False) -> pd.DataFrame:
    """The 15 coordinates [rad, m]; with `speeds` their rates beside them under the same names with _u, as OpenSim 3
    names them [rad/s, m/s]."""
    run.need(COORDINATES, "the export of coordinates")
    columns = {name: run.result[f"plant.{name}"] for name in COORDINATES}
    if speeds:
        columns |= {f"{name}_u": run.result[f"plant.{name}_speed"] for name in COORDINATES}
    return _frame(run, columns)


def states(run: Landing) -> pd.DataFrame:
    """Coordinates and speeds [rad, m, rad/s, m/s], activations [1] and fibre lengths [m] of all muscles, by OpenSim's
    paths."""
    run.need(COORDINATES, "the export of states")
    columns: dict[str, np.ndarray] = {}
    for joint, names in JOINTS.items():
        for name in names:
            columns[f"/jointset/{joint}/{name}/value"] = run.result[f"plant.{name}"]
            columns[f"/jointset/{joint}/{name}/speed"] = run.result[f"plant.{name}_speed"]
    for muscle in _muscles(run):
        columns[f"/forceset/{muscle}/activation"] = run.result[f"plant.{muscle}_activation"]
        columns[f"/forceset/{muscle}/fiber_length"] = run.result[f"plant.{muscle}_fibre_length"]
    return _frame(run, columns)


def forces(run: Landing) -> pd.DataFrame:
    """Tendon forces [N] by muscle, moments of the passive ankle and of the brace about every axis [N.m], + when they
    resist."""
    run.need(COORDINATES, "the export of forces")
    columns = {muscle: run.result[f"plant.{muscle}_tendon_force"] for muscle in _muscles(run)}
    moments = [
        name
        for name in run.result.names
        if name.startswith(("plant.anatomy_", "plant.brace_")) and name.endswith("_moment")
    ]
    return _frame(run, columns | {name.removeprefix("plant."): run.result[name] for name in moments})


def ground(run: Landing) -> pd.DataFrame:
    """Force [N], centre of pressure [m] and free moment [N.m] of the platform on the foot, in the ground's frame."""
    run.need(("ground_point_x", "ground_free_moment"), "the export of the ground reaction")
    incline = run.parameter("platform_incline")
    normal = (0.0, math.cos(incline), math.sin(incline))
    columns = {f"ground_force_v{k}": run.result[f"plant.ground_force_{k}"] for k in "xyz"}
    columns |= {f"ground_force_p{k}": run.result[f"plant.ground_point_{k}"] for k in "xyz"}
    columns |= {
        f"ground_torque_{k}": n * run.result["plant.ground_free_moment"] for k, n in zip("xyz", normal, strict=True)
    }
    return _frame(run, columns)


def signals(run: Landing) -> pd.DataFrame:
    """Everything recorded, as "component.variable [unit]"."""
    result = run.result
    headings = [f"{n} [{u.name if u else '?'}]" for n, u in zip(result.names, result.units, strict=True)]
    return _frame(run, dict(zip(headings, result.values.T, strict=True)))


CONTENTS: dict[str, Callable[[Landing], pd.DataFrame]] = {
    "coordinates": coordinates,
    "states": states,
    "forces": forces,
    "ground": ground,
    "signals": signals,
}


def write_landing(
    run: Landing, target: Path, kind: str | None = None, content: str | None = None, speeds: bool = False
) -> tuple[int, int]:
    """Writes `content` (one of CONTENTS) of a landing as `kind` (one of FORMATS; None: by the ending of `target`);
    `speeds`: beside coordinates. Returns rows and columns, time not counted. Raises InputError, EnvironmentProblem."""
    kind = kind or target.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(f"{target}: format {kind!r} is unknown{nearest(kind, FORMATS)}")
    content = content or FORMATS[kind]
    if speeds and content not in ("coordinates", "states"):
        raise InputError(f"{target}: --speeds belongs to coordinates, and this file holds {content}")
    table = coordinates(run, speeds) if content == "coordinates" else CONTENTS[content](run)
    with whole_file(target, parents=True) as partial:
        if kind == "csv":
            table.to_csv(partial, float_format="%.10g", lineterminator="\n")
        elif kind == "parquet":
            try:
                table.to_parquet(partial)
            except ImportError:
                raise EnvironmentProblem(
                    'Parquet needs the extra [parquet]: pip install "sprain-cosim[parquet]"'
                ) from None
        else:
            in_degrees = kind == "mot" and content == "coordinates"
            if in_degrees:
                turned = [name for name in table.columns if name.removesuffix("_u") not in TRANSLATIONS]
                table[turned] = np.degrees(table[turned])
            text = opensim_text(table, {"coordinates": "Coordinates"}.get(content, content), in_degrees)
            partial.write_text(text, "utf-8")
    return table.shape[0], table.shape[1]


def opensim_text(table: pd.DataFrame, name: str, in_degrees: bool) -> str:
    """A storage file of OpenSim 4: header, then columns separated by tabs; `table` over time [s]. Numbers have the 17
    digits that give them back to the bit."""
    head = [
        name,
        "version=1",
        f"nRows={len(table)}",
        f"nColumns={table.shape[1] + 1}",
        f"inDegrees={'yes' if in_degrees else 'no'}",
        "endheader",
    ]
    labels = "\t".join(["time", *(str(c).replace(" ", "_") for c in table.columns)])
    rows = [
        "\t".join(f"{v:.17g}" for v in (time, *values))
        for time, values in zip(table.index, table.to_numpy(), strict=True)
    ]
    return "\n".join([*head, labels, *rows]) + "\n"


def _frame(run: Landing, columns: dict[str, np.ndarray]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(columns, index=pd.Index(run.result.time, name="time [s]"))


def _muscles(run: Landing) -> list[str]:
    names = [
        name.removeprefix("plant.").removesuffix("_tendon_force")
        for name in run.result.names
        if name.endswith("_tendon_force")
    ]
    if not names:
        raise InputError(f"{run.label}: its record has no muscles; run it again with this version")
    return names
