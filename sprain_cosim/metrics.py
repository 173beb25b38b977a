"""Named responses of a landing: signed maxima over the communication points, t = 0 included, and moments at the moment
of a peak."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np

IMPACT = 0.005
# what a foot that starts inside the floor gives in the first millisecond, whatever the landing
THROWN = ("peak_vertical_grf_N", "peak_talocrural_velocity_deg_s", "peak_jcs_dorsiflexion_velocity_deg_s")
THROWN_TEXT = (
    "the published pose starts inside the floor: the ground reaction, and the talocrural velocity, of the first "
    "millisecond are those of the pose, not of a landing"
)
JCS = ("dorsiflexion", "inversion", "internal_rotation")
ANATOMIC = ("subtalar", "talocrural")
NEEDED = (
    *(f"{axis}_angle" for axis in ANATOMIC),
    *(f"jcs_{axis}_raw_angle" for axis in JCS),
    *(f"{axis}_velocity" for axis in (*ANATOMIC, *JCS)),
    *(f"anatomy_{axis}_moment" for axis in (*ANATOMIC, *JCS)),
    "ground_force_y",
)
LABELS = {**{a: a for a in ANATOMIC}, **{a: f"jcs_{a}" for a in JCS}}
OF_BRACE = (
    *(f"brace_{label}_moment_Nm" for label in LABELS.values()),
    "peak_brace_subtalar_moment_Nm",
    "brace_subtalar_work_to_peak_J",
    "brace_work_J",
)
NAMES = (  # of all metrics; those OF_BRACE need a brace on the plant
    *(f"peak_{a}_angle_deg" for a in ANATOMIC),
    *(f"peak_jcs_{a}_deg" for a in JCS),
    "peak_inversion_from_neutral_deg",
    "time_of_peak_subtalar_s",
    *(f"peak_{label}_velocity_deg_s" for label in LABELS.values()),
    *(f"anatomy_{label}_moment_Nm" for label in LABELS.values()),
    *OF_BRACE,
    "peak_vertical_grf_N",
    "peak_vertical_grf_after_impact_N",
)
AXES = {
    "subtalar": "supination about the subtalar axis",
    "talocrural": "dorsiflexion about the talocrural axis",
    "dorsiflexion": "dorsiflexion in the joint coordinate system",
    "inversion": "inversion in the joint coordinate system",
    "internal_rotation": "internal rotation in the joint coordinate system",
}
MEANINGS = {
    **{f"peak_{a}_angle_deg": f"largest {AXES[a]}" for a in ANATOMIC},
    **{f"peak_jcs_{a}_deg": f"largest {AXES[a]} (raw)" for a in JCS},
    "peak_inversion_from_neutral_deg": "largest inversion of the foot, counted from its neutral position",
    "time_of_peak_subtalar_s": "time of the largest supination after contact",
    **{f"peak_{label}_velocity_deg_s": f"largest angular velocity of {AXES[a]}" for a, label in LABELS.items()},
    **{
        f"{who}_{label}_moment_Nm": f"moment of the {who} against {AXES[a]}, at the time of that axis' peak angle"
        for who in ("anatomy", "brace")
        for a, label in LABELS.items()
    },
    "peak_brace_subtalar_moment_Nm": "largest moment of the brace against supination, at any time",
    "brace_subtalar_work_to_peak_J": "energy that the brace took from the rolling foot until its peak",
    "brace_work_J": "energy that the brace took from all axes in the whole landing; negative where it gave",
    "peak_vertical_grf_N": "largest vertical ground reaction, impact included",
    "peak_vertical_grf_after_impact_N": f"largest vertical ground reaction later than {1e3 * IMPACT:g} ms",
}
UNITS = {"_deg": "deg", "_deg_s": "deg/s", "_Nm": "N·m", "_N": "N", "_s": "s", "_J": "J"}


class Signals(Protocol):
    """(n,) `time` [s] and (n,) signals by name."""

    @property
    def time(self) -> np.ndarray: ...

    @property
    def index(self) -> Mapping[str, int]: ...

    def __getitem__(self, name: str) -> np.ndarray: ...


def brace_torques(run: Signals) -> dict[str, str]:
    """{axis: the plant's input} of every torque that a brace gives; empty without a brace."""
    start, end = "plant.brace_", "_torque"
    return {n.removeprefix(start).removesuffix(end): n for n in run.index if n.startswith(start) and n.endswith(end)}


def metrics(run: Signals) -> dict[str, float]:
    """Keys carry their unit. Angles of the three axes of the joint coordinate system are raw, as in Table 3 of Yoder et
    al. 2021 (doi 10.3389/fbioe.2021.765331); velocities are components of the angular velocity; moments are those about
    an axis at the time of that axis' own peak angle, positive when they resist. `peak_brace_subtalar_moment_Nm` is the
    brace's largest resistance to supination at any time; `brace_subtalar_work_to_peak_J` the energy it took from the
    rolling foot until the subtalar peak, `brace_work_J` that from all axes over the whole landing (negative where it
    gave: an elastic brace tensed by plantarflexion before contact). Without a brace on the plant these and the `brace_`
    keys are absent; without a plant that gives all the signals there are none."""
    if any(f"plant.{signal}" not in run.index for signal in NEEDED):
        return {}
    degrees = math.degrees(1.0)
    angle = {a: f"plant.{a}_angle" for a in ANATOMIC} | {a: f"plant.jcs_{a}_raw_angle" for a in JCS}
    torques = brace_torques(run)
    out: dict[str, float] = {}
    peak = {}
    for axis, name in angle.items():
        values = run[name]
        peak[axis] = k = int(values.argmax())
        key = f"peak_{axis}_angle_deg" if axis in ANATOMIC else f"peak_jcs_{axis}_deg"
        out[key] = degrees * float(values[k])
        if axis == "subtalar":
            out["time_of_peak_subtalar_s"] = float(run.time[k])
        out[f"peak_{LABELS[axis]}_velocity_deg_s"] = degrees * float(run[f"plant.{axis}_velocity"].max())
    if "plant.inversion_angle" in run.index:
        out["peak_inversion_from_neutral_deg"] = degrees * float(run["plant.inversion_angle"].max())
    needed = [f"plant.brace_{axis}_moment" for axis in peak] + [f"plant.{axis}_angle" for axis in torques]
    torques = torques if all(name in run.index for name in needed) else {}
    for who in ("anatomy", "brace") if torques else ("anatomy",):
        for axis, k in peak.items():
            out[f"{who}_{LABELS[axis]}_moment_Nm"] = float(run[f"plant.{who}_{axis}_moment"][k])
    if torques:
        moment, k = run["plant.brace_subtalar_moment"], peak["subtalar"] + 1
        out["peak_brace_subtalar_moment_Nm"] = float(moment.max())
        out["brace_subtalar_work_to_peak_J"] = _work(moment[:k], run["plant.subtalar_angle"][:k])
        out["brace_work_J"] = -sum(_work(run[n], run[f"plant.{axis}_angle"]) for axis, n in torques.items())
    force = run["plant.ground_force_y"]
    out["peak_vertical_grf_N"] = float(force.max())
    late = force[run.time > IMPACT]
    if len(late):
        out["peak_vertical_grf_after_impact_N"] = float(late.max())
    return out


def _work(torque: np.ndarray, angle: np.ndarray) -> float:
    """[J] of (n,) torque [N.m] over (n,) angle [rad]."""
    return float(np.sum(0.5 * (torque[1:] + torque[:-1]) * (angle[1:] - angle[:-1])))


def unit_of(key: str) -> str:
    """The unit in the name of a metric."""
    return next(
        (unit for suffix, unit in sorted(UNITS.items(), key=lambda item: -len(item[0])) if key.endswith(suffix)), ""
    )


def doubtful_peaks(run: Signals, stop: float) -> list[str]:
    """What is to be said of peaks that are none of a landing which was followed to its end [s], a line each: the foot
    has not turned back, it never rolled outwards, or what is largest comes when the body lies on the ground."""
    if "plant.subtalar_angle" not in run.index or len(run.time) < 2:
        return []
    found, largest = [], int(np.argmax(run["plant.subtalar_angle"]))
    if largest == len(run.time) - 1:
        found.append(
            f"the foot still turned at the stop ({1e3 * stop:g} ms): its peak is the largest angle till then; "
            f"{longer(stop)}"
        )
    elif largest == 0:
        found.append("the foot never rolled outwards: its peak is the angle at contact")
    rows = table(run) if run.time[-1] > LATE else []
    late = [f"{label} {1e3 * time:g} ms" for label, _, _, time in rows if time > LATE and "moment" not in label]
    if late:
        found.append(f"{SUNK} ({', '.join(late)}); {earlier()}")
    return found


LATE = 0.3  # s: when the pelvis would hit the ground after a drop of 0.8 m; of 0.3 m at 0.5 s
LONGEST = 0.5  # s, as far as landings are known to run
SHORTEST = 0.15  # s, that the paper's landings run
SUNK = (
    f"later than {1e3 * LATE:g} ms the body has sunk to the ground, which in this model the foot alone touches: "
    "peaks of that time are of no landing"
)


def longer(stop: float) -> str:
    """What lets a landing last longer, as the end of a sentence."""
    return (
        f'--stop "{1e3 * min(LONGEST, max(SHORTEST, 2.0 * stop)):g} ms" shows how it goes on'
        if stop < LONGEST
        else "take a longer --stop"
    )


def earlier() -> str:
    """What leaves out a time in which no person stands."""
    return f'--stop "{1e3 * LATE:g} ms" leaves them out'


def pose_artefacts(keys: Iterable[str], pose: str | None) -> list[str]:
    """Those of the metrics that the initial pose alone gives: in the pose `published` the foot starts inside the floor,
    and is thrown out of it."""
    return [key for key in keys if key in THROWN] if pose == "published" else []


def table(run: Signals) -> list[tuple[str, float, str, float]]:
    """What a reader wants first, as (label, value, unit, time [s]) rows: the peaks, and who bears the moment at the
    subtalar peak."""
    values = metrics(run)
    if not values:
        return []
    rows = []
    for label, signal, key in (
        ("subtalar supination", "plant.subtalar_angle", "peak_subtalar_angle_deg"),
        ("subtalar velocity", "plant.subtalar_velocity", "peak_subtalar_velocity_deg_s"),
        ("talocrural dorsiflexion", "plant.talocrural_angle", "peak_talocrural_angle_deg"),
        ("JCS inversion (raw)", "plant.jcs_inversion_raw_angle", "peak_jcs_inversion_deg"),
        ("JCS internal rotation (raw)", "plant.jcs_internal_rotation_raw_angle", "peak_jcs_internal_rotation_deg"),
        ("vertical ground reaction", "plant.ground_force_y", "peak_vertical_grf_N"),
    ):
        rows.append((label, values[key], unit_of(key), float(run.time[np.argmax(run[signal])])))
    at = values["time_of_peak_subtalar_s"]
    for who in ("anatomy", "brace"):
        key = f"{who}_subtalar_moment_Nm"
        if key in values:
            rows.append((f"subtalar moment of the {who}", values[key], unit_of(key), at))
    return rows
