"""The landings and trials that others published, run in one process: what the tests of the plant and the tables of
docs/validation.md compare with the records."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pandas as pd

from fmus.plant.plant import Landing
from sprain_cosim.validation.checks.paper import published_inputs
from tools.direct import COLUMN, land, plant, scale
from tools.reference import FOLDER, read

KNEE, TALOCRURAL, SUBTALAR, HIP = 9, 10, 11, slice(6, 9)
HOLD = 2.5e-4  # s: the references hold their controls that long
CASES = list(pd.read_csv(FOLDER / "landing" / "index.csv").case) if FOLDER.is_dir() else []
MUSCLES = [case for case in CASES if (FOLDER / "landing" / f"{case}_muscles.csv.gz").is_file()]
DEMERS = list(pd.read_csv(FOLDER / "demers2017" / "index.csv").case) if FOLDER.is_dir() else []
COARSE = {"conv_h1e-3": 1e-3}  # this reference holds its controls for 1 ms


def number(value: float, default: float = 0.0) -> float:
    return default if math.isnan(value) else float(value)


@cache
def simulated(case: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Outputs (n, k), coordinates (n, 15) [rad, m], tendon forces (n, 49) [N] and the ground reaction at t = 0 [N],
    every 1 ms."""
    row = read("landing/index.csv").set_index("case").loc[case]
    landing = Landing(
        platform_incline=math.radians(row.incline_deg),
        drop_height=row.drop_height_m,
        contact_modulus=row.contact_modulus,
        contact_dissipation=row.contact_dissipation,
        passive_angle_scale=scale(row.ankle_stiff),
        talocrural_angle_at_contact=math.radians(row.talocrural_deg),
        subtalar_angle_at_contact=math.radians(row.subtalar_deg),
        subtalar_velocity_at_contact=math.radians(row.subtalar_u0),
        ankle_strength_scale=1.0 + row.strength,
        initial_pose=Landing.TOUCHING if case.startswith("nopen") else Landing.PUBLISHED,
        internal_brace_angle_scale=0.0 if math.isnan(row.brace) else scale(row.brace),
        body_reflex_scale=float(row.body_ctrl),
        initial_ankle_activation=number(row.init_act),
    )
    states: list[np.ndarray] = []
    step = COARSE.get(case, HOLD)
    out = land(
        landing,
        row.coactivation,
        row.reflex_gain,
        row.reflex_delay_s,
        row.inv_ratio,
        stop=row["T"],
        step=step,
        every=round(1e-3 / step),
        on=plant(),
        probe=lambda p: states.append(np.r_[p.state["q"], p.state["tendon_force"][0, :49]]),
    )
    history = np.array(states)
    return out, history[:, :15], history[:, 15:], out[0, COLUMN["ground_force_x"] : COLUMN["ground_force_z"] + 1]


def rms(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def errors(trials: pd.DataFrame) -> np.ndarray:
    """Simulated minus published peak subtalar angle [deg], the inputs rounded as they were run."""
    found, inputs = [], published_inputs(trials)
    for record, row in zip(trials.to_dict("records"), inputs.to_dict("records"), strict=True):
        landing = Landing(
            platform_incline=math.radians(record["incline_deg"]),
            drop_height=row["plant.drop_height [m]"],
            contact_modulus=row["plant.contact_modulus [Pa/m]"],
            contact_dissipation=row["plant.contact_dissipation [s/m]"],
            passive_angle_scale=row["plant.passive_angle_scale"],
            talocrural_angle_at_contact=math.radians(row["plant.talocrural_angle_at_contact [deg]"]),
            subtalar_angle_at_contact=math.radians(row["plant.subtalar_angle_at_contact [deg]"]),
            ankle_strength_scale=row["plant.ankle_strength_scale"],
            internal_brace_angle_scale=row.get("brace.angle_scale", 0.0),
            initial_pose=Landing.PUBLISHED,
            fibre_start=Landing.AS_PUBLISHED,
        )
        activity = row.get("controller.coactivation", 0.0), row.get("controller.reflex_gain", 0.0)
        out = land(landing, *activity, on=plant())
        found.append(math.degrees(out[:, COLUMN["subtalar_angle"]].max()) - record["peak_subtalar_deg"])
    return np.array(found)
