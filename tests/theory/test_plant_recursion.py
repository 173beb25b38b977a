"""The plant's own recursion against MuJoCo, term by term, at random states: frames, mass matrix, bias."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit

from fmus.plant import constants, kernels
from tools.direct import plant

TREE = [k if k < kernels.KNEE else k + 2 if k < kernels.LUMBAR else k + 5 for k in range(kernels.NQ)]
KNEE_JOINTS = [9, 10, 11, 14, 15, 16]  # tibia and patella: x, y, turn


@njit
def skeleton_alone(model, state, q, u, force):
    kernels.skeleton(model[0], state[0], 0, q, u)
    kernels.generalised_force(state[0], force)


def test_frames_mass_matrix_and_bias_are_those_of_mujoco() -> None:
    """1000 states far beyond a landing's; 1e-9 of the largest entry is asked, 1e-13 is found."""
    p, (skeleton, _, compiled) = plant(), constants.anatomy()
    data, random = mujoco.MjData(compiled), np.random.default_rng(1)
    first, worst = skeleton.initial()[0], np.zeros(4)
    for _ in range(1000):
        q, u = first + 0.6 * random.normal(size=15), 5.0 * random.normal(size=15)
        q[kernels.KNEE] = random.uniform(-2.0, 0.3)
        force = np.zeros(15)
        skeleton_alone(p._model, p._state, q, u, force)
        follow = np.zeros((20, 15))  # from the 15 coordinates to MuJoCo's joints
        for k, joint in enumerate(TREE):
            follow[joint, k] = float(k != kernels.KNEE)
        follow[KNEE_JOINTS, kernels.KNEE] = p.state["slope"]
        data.qpos[:] = follow @ q
        data.qpos[KNEE_JOINTS] = p.state["place"]
        data.qvel[:], data.qacc[:] = follow @ u, 0.0
        data.qacc[KNEE_JOINTS] = p.state["curvature"] * u[kernels.KNEE] ** 2
        for function in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_makeM, mujoco.mj_comVel):
            function(compiled, data)
        bias, mass = np.zeros(20), np.zeros((20, 20))
        mujoco.mj_rne(compiled, data, 1, bias)
        mujoco.mj_fullM(compiled, data, mass)
        pairs = (
            (p.state["xpos"][1:], data.xpos[1:]),
            (p.state["xmat"][1:], data.xmat[1:]),
            (p.state["mass"][0, :, :15], follow.T @ mass @ follow),
            (-force, follow.T @ bias),
        )
        worst = np.maximum(worst, [np.abs(a - b).max() / np.abs(b).max() for a, b in pairs])
    assert (worst <= 1e-9).all(), worst
