"""What the plant's FMU shows to the outside: parameters, inputs and outputs with units, start values and signs. Plain
data, no imports of compiled code, so that the exporter can describe the FMU without running it."""

from __future__ import annotations

import csv
from pathlib import Path

MODEL = "plant"
DESCRIPTION = "Single-leg landing on an inclined platform: 15 coordinates, 49 muscles, elastic-foundation contact"

ANKLE_MUSCLES = ("ext_dig", "per_brev", "per_long", "per_tert", "ext_hal", "flex_dig", "flex_hal", "tib_post")
EVERTORS = ANKLE_MUSCLES[:4]
PROFILES = {
    "anatomic": ("talocrural", "subtalar"),
    "jcs": ("dorsiflexion", "inversion", "internal_rotation"),
    "bushing": ("rotation_x", "rotation_y", "rotation_z"),
}
AXES = tuple(axis for axes in PROFILES.values() for axis in axes)
JCS = PROFILES["jcs"]

MEANING = {
    "talocrural": "talus relative to tibia, + dorsiflexion",
    "subtalar": "calcaneus relative to talus, + supination",
    "dorsiflexion": "joint coordinate system, + dorsiflexion, zero at the neutral pose",
    "inversion": "joint coordinate system, + inversion, zero at the neutral pose",
    "internal_rotation": "joint coordinate system, + internal rotation, zero at the neutral pose",
    "rotation_x": "body-fixed X-Y-Z Euler angle x of the calcaneus in the tibia",
    "rotation_y": "body-fixed X-Y-Z Euler angle y of the calcaneus in the tibia",
    "rotation_z": "body-fixed X-Y-Z Euler angle z of the calcaneus in the tibia",
}


def table(name: str) -> list[dict[str, str]]:
    """Rows of a table in `data/`; lines that begin with # are comments."""
    with open(Path(__file__).parent / "data" / f"{name}.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


MUSCLES = tuple(row["muscle"] for row in table("muscles"))
TRANSLATIONS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
COORDINATES = (
    *(*TRANSLATIONS, "pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    *("hip_flexion_r", "hip_adduction_r", "hip_rotation_r", "knee_angle_r", "ankle_angle_r", "subtalar_angle_r"),
    *("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
)

# A person of another size: the base person's mass is the sum of data/bodies.csv; factors of lengths in each body's own
# frame, both sides alike (thigh: femurs; shank: tibias, patellas; foot: talus, calcaneus, toes; torso: with the arms)
BASE_MASS = 67.54377325440001
SEGMENTS = ("pelvis", "thigh", "shank", "foot", "torso")
LEAST_FACTOR, GREATEST_FACTOR = 0.5, 2.0
# The passive ankle about each body-fixed Euler angle t: torque = linear t + quadratic t^2 + cubic t^3, restoring
POWERS = {"linear": "N.m/rad", "quadratic": "N.m/rad2", "cubic": "N.m/rad3"}
PASSIVE = tuple(
    (f"passive_{row['axis']}_{power}", unit, float(row[f"{power}_Nm"]), -1e5, 1e5, f"passive ankle torque about the Euler angle {row['axis']}, + restores")
    for row in table("bushings") if row["bushing"] == "ankle"
    for power, unit in POWERS.items()
)  # fmt: skip
PERSON = (
    ("body_mass", "kg", BASE_MASS, 20.0, 250.0, "of the whole person; its distribution over the bodies stays"),
    ("muscle_force_scale", "1", 1.0, 0.0, 10.0, "scales the maximal isometric forces of all 49 muscles"),
    *(
        (f"{segment}_scale_{axis}", "1", 1.0, LEAST_FACTOR, GREATEST_FACTOR, f"length factor of the {segment} in its own frame")
        for segment in SEGMENTS
        for axis in "xyz"
    ),
    *PASSIVE,
)  # fmt: skip

POSES = {"touching": 0, "published": 1, "given": 2}
NO_EDGE = 1000.0  # m
FIBRE_STARTS = {"equilibrium": 0, "as_published": 1}

# the state at contact: {coordinate: parameter}; talocrural, subtalar and the pelvis' vertical speed have their own names
OWN_NAMES = {"ankle_angle_r": "talocrural", "subtalar_angle_r": "subtalar"}
PLACED = {c: f"{c}_at_contact" for c in COORDINATES if c not in OWN_NAMES}
MOVING = {c: f"{c}_speed_at_contact" for c in COORDINATES if c not in OWN_NAMES and c != "pelvis_ty"}
_MEASURED = {row["coordinate"]: row for row in table("joints")}
_SIGNS = {
    "pelvis_tx": "+ anterior",
    "pelvis_ty": "+ up; counts where initial_pose = given",
    "pelvis_tz": "+ right (lateral)",
    "knee_angle_r": "+ extension",
}


def _at_contact(c: str, name: str, speed: bool) -> tuple[str, str, float, float, float, str]:
    start = float(_MEASURED[c]["initial_speed_rad_s_or_m_s" if speed else "initial_value_rad_or_m"])
    unit, most = ("m", 20.0 if speed else 1000.0) if c in TRANSLATIONS else ("rad", 100.0 if speed else 6.3)
    sign = _SIGNS.get(c, "sign of the OpenSim model")
    what = f"rate of {c} at contact; {sign.partition(';')[0]}" if speed else f"coordinate {c} at contact; {sign}"
    return name, f"{unit}/s" if speed else unit, start, -most, most, what


# name, unit, start, least, greatest, description
PARAMETERS = (
    ("platform_incline", "rad", 0.5235987755982988, -1.0471975511965976, 1.0471975511965976, "+ tilts the lateral side down; pivot at the platform joint"),
    ("drop_height", "m", 0.30, 0.0, 5.0, "gives the pelvis its vertical speed at contact, -sqrt(2 g h)"),
    ("contact_modulus", "Pa/m", 5e7, 1e3, 1e10, "of the elastic foundation"),
    ("contact_dissipation", "s/m", 5.0, 0.0, 100.0, "of the elastic foundation"),
    ("contact_friction", "1", 0.9, 0.0, 10.0, "static and dynamic"),
    ("contact_viscous_friction", "s/m", 0.9, 0.0, 100.0, "friction coefficient per slip speed"),
    ("talocrural_angle_at_contact", "rad", -0.5934119456780721, -1.5707963267948966, 1.5707963267948966, "+ dorsiflexion"),
    ("subtalar_angle_at_contact", "rad", 0.0, -1.5707963267948966, 1.5707963267948966, "+ supination"),
    ("talocrural_velocity_at_contact", "rad/s", 13.69543, -100.0, 100.0, "+ dorsiflexion"),
    ("subtalar_velocity_at_contact", "rad/s", 0.0, -100.0, 100.0, "+ supination"),
    ("pelvis_vertical_velocity", "m/s", 0.0, -20.0, 20.0, "+ up; 0: from drop_height"),
    ("passive_angle_scale", "1", 1.0, 0.0, 10.0, "scales the angles of the passive ankle torques"),
    ("ankle_strength_scale", "1", 1.0, 0.0, 10.0, "scales the maximal forces of the eight ankle-controlled muscles"),
    ("body_reflex_scale", "1", 1.0, 0.0, 100.0, "scales the reflexes of the other 41 muscles"),
    ("initial_ankle_activation", "1", 0.0, 0.0, 1.0, "of the eight ankle-controlled muscles; 0: the controller's co-activation (floor 0.01)"),
    ("internal_brace_angle_scale", "1", 0.0, 0.0, 100.0, "bushing brace inside the plant, for tests of the coupling; 0: none"),
    ("tolerance", "1", 0.0025, 1e-9, 1.0, "of the integrator's step control"),
    *(_at_contact(c, name, False) for c, name in PLACED.items()),
    *(_at_contact(c, name, True) for c, name in MOVING.items()),
    *PERSON,
    ("platform_edge_distance", "m", NO_EDGE, -1.0, NO_EDGE, "the platform ends at a line this far from the calcaneus' origin at contact; 1000 m: nowhere"),
    ("platform_edge_direction", "rad", 0.0, -3.2, 3.2, "in the platform's plane to that line, from anterior, + lateral"),
    ("evertor_strength_scale", "1", 1.0, 0.0, 10.0, "scales the maximal forces of the four evertors besides"),
)  # fmt: skip


def variables() -> list[dict]:
    """All scalar variables in the order of their value references: independent time is left to the exporter. Keys:
    name, causality, variability, unit, start (absent for outputs), min, max, description, and for enumerations type and
    items."""
    out: list[dict] = []
    for name, unit, start, least, greatest, text in PARAMETERS:
        out.append(
            dict(
                name=name,
                causality="parameter",
                variability="fixed",
                unit=unit,
                start=start,
                min=least,
                max=greatest,
                description=text,
            )
        )
    for name, items, text in (
        (
            "initial_pose",
            POSES,
            "touching: pelvis moved along the vertical until the foot just touches; published: its height as in the "
            "measured state; given: its height as pelvis_ty_at_contact, refused where the foot is inside the platform",
        ),
        (
            "fibre_start",
            FIBRE_STARTS,
            "equilibrium (OpenSim 4.6), or as in the published records (OpenSim 3.3: its three outcomes for tibialis anterior at the start, excitations of at least 0.01)",
        ),
    ):
        out.append(dict(name=name, causality="parameter", variability="fixed", items=items, start=0, description=text))

    def signal(name: str, causality: str, unit: str, text: str) -> None:
        entry = dict(name=name, causality=causality, variability="continuous", unit=unit, description=text)
        if causality == "input":
            entry["start"] = 0.0
        out.append(entry)

    for muscle in ANKLE_MUSCLES:
        signal(
            f"{muscle}_excitation", "input", "1", "from outside; the sum with the body reflexes is clamped to 0 ... 1"
        )
    for axis in AXES:
        signal(f"brace_{axis}_torque", "input", "N.m", f"of the brace on the foot; {MEANING[axis]}")
    for kind, unit in (("stiffness", "N.m/rad"), ("damping", "N.m.s/rad")):
        for axis, other in IMPEDANCES:
            name = f"brace_{axis}_{kind}" if axis == other else f"brace_{axis}_{other}_{kind}"
            signal(
                name,
                "input",
                unit,
                f"-d(torque about {axis})/d({other} {'angle' if kind == 'stiffness' else 'velocity'})",
            )
    of_brace = [v["name"] for v in out if v["name"].startswith("brace_")]
    for name, unit, text in SIGNALS:
        signal(name, "output", unit, text)
        out[-1]["depends"] = of_brace if name.startswith("brace_") else []
    for name, unit, text in LOCALS:
        signal(name, "local", unit, text)
    return out


IMPEDANCES = tuple((axis, axis) for axis in AXES) + tuple(
    (axis, other) for axes in PROFILES.values() for axis in axes for other in axes if axis != other
)

SIGNALS = (
    *((f"{axis}_angle", "rad", MEANING[axis]) for axis in AXES),
    *((f"{axis}_velocity", "rad/s", f"component of the angular velocity about its axis; {MEANING[axis]}") for axis in AXES),
    *((f"{muscle}_stretch_velocity", "1", "lengthening speed of the muscle over 10 optimal fibre lengths per second") for muscle in ANKLE_MUSCLES),
    *((f"{axis}_effective_inertia", "kg.m2", f"seen by a torque; {MEANING[axis]}") for axis in AXES),
    ("evertor_activation", "1", "mean of the four evertors"),
    *((f"anatomy_{axis}_moment", "N.m", f"of the passive ankle, + when it resists; {MEANING[axis]}") for axis in AXES),
    *((f"brace_{axis}_moment", "N.m", f"of the brace, + when it resists; {MEANING[axis]}") for axis in AXES),
    ("ground_force_x", "N", "on the foot, + anterior"),
    ("ground_force_y", "N", "on the foot, + up"),
    ("ground_force_z", "N", "on the foot, + right (lateral)"),
    ("ground_force", "N", "magnitude"),
    ("in_contact", "1", "1 while the foot touches the platform"),
    *((f"jcs_{axis}_raw_angle", "rad", "not zeroed, as in the paper's tables") for axis in JCS),
)  # fmt: skip
OUTPUTS = tuple(name for name, _, _ in SIGNALS)

# read only by those who ask: pose, muscles and where the ground pushes, under the names of the OpenSim model
LOCALS = (
    *((c, "m" if c in TRANSLATIONS else "rad", "coordinate") for c in COORDINATES),
    *((f"{c}_speed", "m/s" if c in TRANSLATIONS else "rad/s", "rate of the coordinate") for c in COORDINATES),
    *((f"{m}_activation", "1", "state of the muscle; it acts with at least 0.01") for m in MUSCLES),
    *((f"{m}_fibre_length", "m", "state of the muscle") for m in MUSCLES),
    *((f"{m}_tendon_force", "N", "pull on the bones") for m in MUSCLES),
    *((f"ground_point_{k}", "m", "centre of pressure on the platform's plane; 0 without contact") for k in "xyz"),
    ("ground_free_moment", "N.m", "about the platform's normal at the centre of pressure, on the foot"),
)
