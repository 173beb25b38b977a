"""The plant's kernels with MuJoCo's own functions in the place of their recursion; all else is the plant's source.

`native.c` gives frames, mass matrix and bias over MuJoCo's 20 joints, whose speeds are J u with the speeds u of the 15
coordinates. These have the mass matrix J^T M J, and the bias J^T b at the accelerations dJ/dt u that u' = 0 leaves.
This module changes `kernels`: the build alone imports it, in a package of its own."""

from importlib.metadata import distribution
from pathlib import Path

import mujoco
import numpy as np
from numba import types

from ..plant import constants as tables
from ..plant import device as plant
from ..plant import kernels
from ..plant.device import GROUPS as GROUPS
from ..plant.device import SAVED_BEFORE as SAVED_BEFORE
from ..plant.device import constants as constants
from ..plant.device import refresh as refresh
from ..plant.device import restored as restored
from ..plant.device import reveal as reveal

PLATFORMS = ("linux64",)
NATIVE, INCLUDE = ("plant_mujoco",), Path(mujoco.__file__).parent / "include"
FAILED, REASONS = len(plant.REASONS), (*plant.REASONS, "MuJoCo stopped with an error near {time:.6f} s")
N_JOINTS, KNEE_JOINT, PATELLA_JOINT = 20, 9, 14
STATE = kernels.in_whole_vectors(
    [(name, plant.STATE[name].base, plant.STATE[name].shape) for name in plant.STATE.names]
    + [
        ("failed", "i8"), ("joints", "f8", (3, N_JOINTS)), ("joint_screw", "f8", (N_JOINTS, 6)),
        ("joint_mass", "f8", (N_JOINTS, N_JOINTS)), ("joint_bias", "f8", (N_JOINTS,)),
        ("half", "f8", (N_JOINTS, kernels.NQ)),
    ]
)  # fmt: skip
NUMBERS = types.CPointer(types.float64)
of_mujoco = types.ExternalFunction("plant_mujoco", types.int64(NUMBERS, types.int64, *[NUMBERS] * 11))
forces_on_bodies = kernels.generalised_force


def files():
    """{path in the FMU: content}."""
    folder = Path(mujoco.__file__).parent
    (library,) = folder.glob("libmujoco.so*")
    licences = [p for p in distribution("mujoco-core").files or () if "licenses" in p.parts]
    drawing = Path("extra", "sprain-cosim", "skeleton.json")
    return {
        drawing.as_posix(): (Path(plant.__file__).parent / drawing).read_bytes(),
        "resources/libmujoco.so": library.read_bytes(),
        "resources/landing.xml": tables.anatomy()[0].mjcf().encode(),
        **{f"documentation/licenses/mujoco/{p.name}": Path(p.locate()).read_bytes() for p in licences},
    }


def initialise(values, state, constants, time):
    state.failed = 0
    status = plant.initialise(values, state, constants, time)
    return FAILED if state.failed else status


def step(values, state, constants, time, step):
    status = plant.step(values, state, constants, time, step)
    return FAILED if state.failed else status


@kernels.kernel
def joint(k):
    """MuJoCo's joint of a coordinate; the knee has three, and the patella three more after the calcaneus."""
    return k if k < kernels.KNEE else k + 2 if k < kernels.LUMBAR else k + 5


@kernels.kernel
def follow(s, joints, k):
    """J^T x: what the joints' values (20,) are for coordinate k."""
    if k != kernels.KNEE:
        return joints[joint(k)]
    total = 0.0
    for i in range(3):
        total += s.slope[i] * joints[KNEE_JOINT + i] + s.slope[3 + i] * joints[PATELLA_JOINT + i]
    return total


@kernels.kernel
def skeleton(m, s, stage, q, u):
    """As kernels.skeleton; the wrenches of inertia and gravity are left to `generalised_force`."""
    kernels.knee_movements(m, s, q[kernels.KNEE])
    joints = s.joints
    for k in range(kernels.NQ):
        if k != kernels.KNEE:
            joints[0, joint(k)], joints[1, joint(k)], joints[2, joint(k)] = q[k], u[k], 0.0
    rate = u[kernels.KNEE]
    for i in range(6):
        at = KNEE_JOINT + i if i < 3 else PATELLA_JOINT + i - 3
        joints[0, at], joints[1, at], joints[2, at] = s.place[i], s.slope[i] * rate, s.curvature[i] * rate * rate
    if of_mujoco(
        joints.ctypes,
        m.scaled,
        m.body_mass.ctypes,
        m.body_com.ctypes,
        m.body_inertia.ctypes,
        m.anchor.ctypes,
        m.anchor_in_parent.ctypes,
        s.xpos.ctypes,
        s.xmat.ctypes,
        s.twist.ctypes,
        s.joint_screw.ctypes,
        s.joint_mass.ctypes,
        s.joint_bias.ctypes,
    ):
        s.failed = 1
        for k in range(N_JOINTS):
            s.joint_bias[k] = np.nan
    for k in range(kernels.NQ):
        for c in range(6):
            s.screw[k, c] = follow(s, s.joint_screw[:, c], k)
    for c in range(6):
        s.screw[kernels.KNEE, c], s.patella_screw[c] = 0.0, 0.0
        for i in range(3):
            s.screw[kernels.KNEE, c] += s.slope[i] * s.joint_screw[KNEE_JOINT + i, c]
            s.patella_screw[c] += s.slope[3 + i] * s.joint_screw[PATELLA_JOINT + i, c]
    kernels.side_by_side(s.screw, s.patella_screw, s.screws)
    for j in range(N_JOINTS):
        for k in range(kernels.NQ):
            s.half[j, k] = follow(s, s.joint_mass[j], k)
    for k in range(kernels.NQ):
        for i in range(kernels.NQ):
            s.mass[stage, i, k] = follow(s, s.half[:, k], i)
    for body in range(kernels.NB):
        for c in range(6):
            s.wrench[body, c] = 0.0


@kernels.kernel
def generalised_force(s, force):
    forces_on_bodies(s, force)
    for k in range(kernels.NQ):
        force[k] -= follow(s, s.joint_bias, k)


kernels.skeleton, kernels.generalised_force = skeleton, generalised_force
