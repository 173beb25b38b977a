"""Compiled kernels of the plant: forces, the equations of motion and their integrator. One file, so that numba's cache
never serves a stale caller.

Two records carry everything: `MODEL` (constants, and the addresses of MuJoCo's arrays) and `STATE` (parameters, inputs,
state, work space). MuJoCo's C functions give kinematics, mass matrix and bias; they are called from compiled code by
address. Frames, units and signs: `model.py`; equations and their sources: README.md beside this file."""

from __future__ import annotations

import ctypes
import math
from pathlib import Path

import llvmlite.binding
import mujoco
import numpy as np
from numba import carray, njit, types
from numba.extending import intrinsic

from .interface import AXES, IMPEDANCES

NQ, NV, NB, NM, NP = 15, 20, 8, 49, 175
PELVIS, FEMUR, TIBIA, TALUS, CALCN, PATELLA, TORSO = range(1, 8)
KNEE, TALOCRURAL, SUBTALAR, LUMBAR = 9, 10, 11, 12
N_ANKLE = 8
N_AXES = len(AXES)
N_KNOTS = 13
MAX_FACETS = 8192
BLOCK = 16  # facets that are skipped together while their bounding box is off the platform
GAMMA = 0.25  # of the Rosenbrock-W method: A-stable, smallest error constant

# Thelen 2003 (doi 10.1115/1.1531112), constants of this model
V_MAX, STRAIN_0, K_TOE, F_TOE = 10.0, 0.033, 3.0, 0.33
K_PASSIVE, STRAIN_MUSCLE, A_F, F_LEN, LINEAR_ABOVE = 4.0, 0.6, 0.3, 1.8, 0.95
STRAIN_TOE = STRAIN_0 * 99.0 * math.e**3 / (166.0 * math.e**3 - 67.0)
SLOPE_LINEAR = (1.0 - F_TOE) / (STRAIN_0 - STRAIN_TOE)
TAU_RISE, TAU_FALL, MIN_ACTIVATION = 0.01, 0.04, 0.01
EQUILIBRIUM = 1e-10  # of the maximal force, in fibre_equilibrium; a tendon at its slack length cannot come closer
ECCENTRIC = (2.0 + 2.0 / A_F) / (F_LEN - 1.0)

f8, i8 = np.float64, np.int64
MODEL = np.dtype(
    [
        ("mj_model", i8), ("mj_data", i8), ("qpos", i8), ("qvel", i8), ("qacc", i8), ("xpos", i8), ("xmat", i8), ("xanchor", i8),
        ("xaxis", i8), ("mass", i8), ("n_mass", i8),
        ("mass_row", i8, (200,)), ("mass_column", i8, (200,)),
        ("spline_size", i8, (5,)), ("spline_scale", f8, (5,)), ("spline_knot", f8, (5, N_KNOTS)),
        ("spline_coefficient", f8, (5, N_KNOTS, 4)),
        ("max_force", f8, (NM,)), ("l_opt", f8, (NM,)), ("l_slack", f8, (NM,)), ("height", f8, (NM,)), ("l_min", f8, (NM,)),
        ("length_gain", f8, (NM,)), ("velocity_gain", f8, (NM,)), ("rest_length", f8, (NM,)),
        ("ankle_muscle", i8, (N_ANKLE,)), ("ankle_index", i8, (NM,)),
        ("point_muscle", i8, (NP,)), ("point_body", i8, (NP,)), ("point", f8, (NP, 3)), ("point_coordinate", i8, (NP,)),
        ("point_low", f8, (NP,)), ("point_high", f8, (NP,)),
        ("ankle_bushing", f8, (3, 3)), ("lumbar_bushing", f8, (3, 4)),
        ("limit", f8, (2, 6)), ("pivot", f8, (3,)), ("jcs_zero", f8, (3,)),
    ],
    align=True,
)  # fmt: skip
STATE = np.dtype(
    [
        # parameters of the landing
        ("plane", f8, (3, 3)), ("modulus", f8), ("dissipation", f8), ("friction", f8), ("viscous_friction", f8), ("transition", f8),
        ("passive_scale", f8), ("internal_brace_scale", f8), ("reflex_scale", f8), ("excitation_floor", f8), ("strength", f8, (NM,)), ("tolerance", f8),
        # inputs, held over a communication step
        ("excitation", f8, (N_ANKLE,)), ("torque", f8, (N_AXES,)), ("stiffness", f8, (N_AXES, N_AXES)), ("damping", f8, (N_AXES, N_AXES)),
        ("held_angle", f8, (N_AXES,)), ("held_velocity", f8, (N_AXES,)), ("braced", i8), ("yielding", i8),
        # state
        ("time", f8), ("h", f8), ("q", f8, (NQ,)), ("u", f8, (NQ,)), ("a", f8, (NM,)), ("l", f8, (NM,)),
        ("evaluations", i8), ("steps", i8), ("rejected", i8),
        # set by evaluate(); stage 0 is at the state, stage 1 at the trial point
        ("valid", i8), ("mass", f8, (2, NQ, NQ)), ("force", f8, (2, NQ)), ("damp", f8, (NQ, NQ)), ("a_rate", f8, (2, NM)), ("a_pole", f8, (2, NM)),
        ("l_rate", f8, (2, NM)), ("l_pole", f8, (2, NM)), ("l_mtu", f8, (2, NM)), ("mtu", f8, (2, NM)), ("mtu_rate", f8, (2, NM)),
        ("tendon_force", f8, (2, NM)), ("reflex", f8, (2, NM)), ("ankle_force", f8, (2, 2)), ("ankle_damp", f8, (2, 2, 2)),
        # work space
        ("bias", f8, (NV,)), ("full", f8, (NV, NV)), ("slope", f8, (6,)), ("curvature", f8, (6,)),
        ("screw", f8, (NQ, 6)), ("patella_screw", f8, (6,)), ("twist", f8, (NB, 6)), ("wrench", f8, (NB, 6)),
        ("segments", i8), ("active", i8), ("known", i8), ("path_first", i8, (NM + 1,)), ("path_base", f8, (NM,)),
        ("from_body", i8, (NP,)), ("to_body", i8, (NP,)), ("from_point", f8, (NP, 3)), ("to_point", f8, (NP, 3)), ("line", f8, (NP, 6)),
        ("contact", f8, (6,)), ("normal_damping", f8, (3, 3)), ("tangent_damping", f8, (3, 3)), ("plane_screw", f8, (12, 6)), ("touching", i8),
        ("angle", f8, (N_AXES,)), ("velocity", f8, (N_AXES,)), ("axis", f8, (N_AXES, 3)), ("dual", f8, (N_AXES, 3)),
        ("talo_rate", f8, (N_AXES,)), ("sub_rate", f8, (N_AXES,)), ("anatomy", f8, (3,)), ("brace", f8, (3,)), ("axis_torque", f8, (N_AXES,)),
        ("block_low", f8, (MAX_FACETS // BLOCK,)), ("facet_x", f8, (MAX_FACETS,)), ("facet_y", f8, (MAX_FACETS,)), ("facet_force", f8, (MAX_FACETS,)),
        ("factor", f8, (NQ, NQ)), ("right", f8, (NQ,)),
        ("k1q", f8, (NQ,)), ("k1u", f8, (NQ,)), ("k1a", f8, (NM,)), ("k1l", f8, (NM,)), ("k2q", f8, (NQ,)), ("k2u", f8, (NQ,)), ("k2a", f8, (NM,)), ("k2l", f8, (NM,)),
        ("yq", f8, (NQ,)), ("yu", f8, (NQ,)), ("ya", f8, (NM,)), ("yl", f8, (NM,)),
    ],
    align=True,
)  # fmt: skip

N_IMPEDANCES = len(IMPEDANCES)
IMPEDANCE_ROW = np.array([AXES.index(a) for a, _ in IMPEDANCES])
IMPEDANCE_COLUMN = np.array([AXES.index(b) for _, b in IMPEDANCES])
N_OUTPUTS = 2 * N_AXES + N_ANKLE + N_AXES + 1 + 2 * N_AXES + 5 + 3
DONE, NOT_FINITE, STEP_TOO_SMALL, TOO_MANY_STEPS = 0, 1, 2, 3
STRETCH = 0.15  # a step may be this much longer than proposed, rather than two short ones up to the next exchange
MAX_STEPS = 50_000  # of one call; a landing needs about 800

_library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco.so*"), "")))


def _mujoco(name: str, *arguments: types.Type) -> types.ExternalFunction:
    llvmlite.binding.add_symbol(name, ctypes.cast(getattr(_library, name), ctypes.c_void_p).value)
    return types.ExternalFunction(name, types.void(types.intp, types.intp, *arguments))


mj_kinematics = _mujoco("mj_kinematics")
mj_com_pos = _mujoco("mj_comPos")
mj_mass = _mujoco("mj_makeM")
mj_com_vel = _mujoco("mj_comVel")
mj_bias = _mujoco("mj_rne", types.int32, types.intp)


@intrinsic
def _pointer(typing_context, address):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(address), generate


FAST = {"reassoc", "contract", "nsz", "arcp"}
kernel = njit(error_model="numpy", fastmath=FAST)
entry = njit(error_model="numpy", fastmath=FAST, cache=True, nogil=True)


# ----------------------------------------------------------------------------------------------------------------
# skeleton


@kernel
def knee_movements(m, s, angle, rate):
    """Tibia (x, y, turn) and patella (x, y, turn) over the knee angle: writes qpos, qvel, qacc of MuJoCo, slopes and
    curvatures."""
    qpos = carray(_pointer(m.qpos), NV)
    qvel = carray(_pointer(m.qvel), NV)
    qacc = carray(_pointer(m.qacc), NV)
    for k in range(6):
        if k == 2:
            value, slope, curvature = angle, 1.0, 0.0
        else:
            j = k if k < 2 else k - 1
            knots, n = m.spline_knot[j], m.spline_size[j]
            i = 0
            while i < n - 2 and angle > knots[i + 1]:
                i += 1
            c = m.spline_coefficient[j, i]
            t = min(max(angle, knots[0]), knots[n - 1]) - knots[i]
            beyond = angle - knots[i] - t
            scale = m.spline_scale[j]
            slope = c[1] + t * (2 * c[2] + t * 3 * c[3])
            value = scale * (c[0] + t * (c[1] + t * (c[2] + t * c[3])) + slope * beyond)
            slope *= scale
            curvature = 0.0 if beyond != 0 else scale * (2 * c[2] + 6 * t * c[3])
        s.slope[k] = slope
        s.curvature[k] = curvature
        d = 9 + k if k < 3 else 11 + k
        qpos[d] = value
        qvel[d] = slope * rate
        qacc[d] = curvature * rate * rate


@kernel
def coupled_screw(s, first, axes, anchor, out):
    """Screw of the knee coordinate through a body's two translations and its rotation (slopes `first` ... `first` +
    2)."""
    e = axes[2]
    turn = s.slope[first + 2]
    for c in range(3):
        out[c] = turn * e[c]
        out[3 + c] = s.slope[first] * axes[0, c] + s.slope[first + 1] * axes[1, c]
    out[3] += turn * (anchor[1] * e[2] - anchor[2] * e[1])
    out[4] += turn * (anchor[2] * e[0] - anchor[0] * e[2])
    out[5] += turn * (anchor[0] * e[1] - anchor[1] * e[0])


@kernel
def skeleton(m, s, stage, q, u):
    """Kinematics, reduced mass matrix (15 x 15) and bias at (q, u); the screw of each coordinate and the twist of each
    body about the ground's origin (angular part first)."""
    qpos = carray(_pointer(m.qpos), NV)
    qvel = carray(_pointer(m.qvel), NV)
    for k in range(NQ):
        if k != KNEE:
            d = k if k < KNEE else k + 2 if k < LUMBAR else k + 5
            qpos[d] = q[k]
            qvel[d] = u[k]
    knee_movements(m, s, q[KNEE], u[KNEE])
    mj_kinematics(m.mj_model, m.mj_data)
    mj_com_pos(m.mj_model, m.mj_data)
    mj_mass(m.mj_model, m.mj_data)
    mj_com_vel(m.mj_model, m.mj_data)
    mj_bias(m.mj_model, m.mj_data, np.int32(1), s.bias.ctypes.data)

    mass = carray(_pointer(m.mass), 200)
    full, reduced, slope = s.full, s.mass[stage], s.slope
    for k in range(m.n_mass):
        full[m.mass_row[k], m.mass_column[k]] = mass[k]
        full[m.mass_column[k], m.mass_row[k]] = mass[k]
    for i in range(NQ):
        di = i if i < KNEE else i + 2 if i < LUMBAR else i + 5
        for j in range(i + 1):
            if i == KNEE or j == KNEE:
                continue
            dj = j if j < KNEE else j + 2 if j < LUMBAR else j + 5
            value = full[di, dj]
            reduced[i, j] = value
            reduced[j, i] = value
    for j in range(NQ):
        if j != KNEE:
            dj = j if j < KNEE else j + 2 if j < LUMBAR else j + 5
            value = 0.0
            for k in range(6):
                value += slope[k] * full[9 + k if k < 3 else 11 + k, dj]
            reduced[KNEE, j] = value
            reduced[j, KNEE] = value
    value = 0.0
    for k in range(3):
        for j in range(3):
            value += slope[k] * slope[j] * full[9 + k, 9 + j] + slope[3 + k] * slope[3 + j] * full[14 + k, 14 + j]
    reduced[KNEE, KNEE] = value

    xanchor = carray(_pointer(m.xanchor), (NV, 3))
    xaxis = carray(_pointer(m.xaxis), (NV, 3))
    screw = s.screw
    for k in range(NQ):
        if k == KNEE:
            continue
        d = k if k < KNEE else k + 2 if k < LUMBAR else k + 5
        e, r = xaxis[d], xanchor[d]
        if k < 3:
            for c in range(3):
                screw[k, c] = 0.0
                screw[k, 3 + c] = e[c]
        else:
            for c in range(3):
                screw[k, c] = e[c]
            screw[k, 3] = r[1] * e[2] - r[2] * e[1]
            screw[k, 4] = r[2] * e[0] - r[0] * e[2]
            screw[k, 5] = r[0] * e[1] - r[1] * e[0]
    coupled_screw(s, 0, xaxis[9:12], xanchor[11], screw[KNEE])
    coupled_screw(s, 3, xaxis[14:17], xanchor[16], s.patella_screw)
    twist = s.twist
    for c in range(6):
        pelvis = 0.0
        for k in range(6):
            pelvis += screw[k, c] * u[k]
        femur = pelvis + screw[6, c] * u[6] + screw[7, c] * u[7] + screw[8, c] * u[8]
        tibia = femur + screw[KNEE, c] * u[KNEE]
        talus = tibia + screw[TALOCRURAL, c] * u[TALOCRURAL]
        twist[PELVIS, c] = pelvis
        twist[FEMUR, c] = femur
        twist[TIBIA, c] = tibia
        twist[TALUS, c] = talus
        twist[CALCN, c] = talus + screw[SUBTALAR, c] * u[SUBTALAR]
        twist[PATELLA, c] = femur + s.patella_screw[c] * u[KNEE]
        twist[TORSO, c] = pelvis + screw[12, c] * u[12] + screw[13, c] * u[13] + screw[14, c] * u[14]
        for b in range(NB):
            s.wrench[b, c] = 0.0


@kernel
def generalised_force(s, force):
    """(15,) force of the wrenches on the bodies, summed from the leaves to the root."""
    w, screw = s.wrench, s.screw
    for k in range(NQ):
        force[k] = 0.0
    for c in range(6):
        foot = w[CALCN, c]
        force[SUBTALAR] += screw[SUBTALAR, c] * foot
        foot += w[TALUS, c]
        force[TALOCRURAL] += screw[TALOCRURAL, c] * foot
        foot += w[TIBIA, c]
        force[KNEE] += screw[KNEE, c] * foot + s.patella_screw[c] * w[PATELLA, c]
        foot += w[PATELLA, c] + w[FEMUR, c]
        for k in range(6, 9):
            force[k] += screw[k, c] * foot
        for k in range(LUMBAR, NQ):
            force[k] += screw[k, c] * w[TORSO, c]
        foot += w[TORSO, c] + w[PELVIS, c]
        for k in range(6):
            force[k] += screw[k, c] * foot


# ------------------------------------------------------------------------------------------------------------------
# muscles


@kernel
def connect_paths(m, s, q):
    """Lists the segments that cross from body to body for the conditional points active at q; the lengths inside bodies
    are constants."""
    active = 0
    bit = 1
    for p in range(NP):
        c = m.point_coordinate[p]
        if c >= 0:
            if m.point_low[p] <= q[c] <= m.point_high[p]:
                active |= bit
            bit <<= 1
    if s.known == 1 and active == s.active:
        return
    s.known, s.active = 1, active
    n, bit, last = 0, 1, -1
    for p in range(NP):
        c = m.point_coordinate[p]
        if c >= 0:
            skip = (active & bit) == 0
            bit <<= 1
            if skip:
                continue
        k = m.point_muscle[p]
        if last < 0 or m.point_muscle[last] != k:
            s.path_first[k] = n
            s.path_base[k] = 0.0
        elif m.point_body[p] == m.point_body[last]:
            square = 0.0
            for i in range(3):
                square += (m.point[p, i] - m.point[last, i]) ** 2
            s.path_base[k] += math.sqrt(square)
        else:
            s.from_body[n] = m.point_body[last]
            s.to_body[n] = m.point_body[p]
            for i in range(3):
                s.from_point[n, i] = m.point[last, i]
                s.to_point[n, i] = m.point[p, i]
            n += 1
        last = p
    s.path_first[NM] = n
    s.segments = n


@kernel
def paths(m, s, mtu, mtu_rate):
    """(49,) length and lengthening speed of the muscles; the unit wrench (A x e, e) of each crossing segment."""
    xpos = carray(_pointer(m.xpos), (NB, 3))
    xmat = carray(_pointer(m.xmat), (NB, 9))
    twist, line = s.twist, s.line
    for k in range(NM):
        length, rate = s.path_base[k], 0.0
        for n in range(s.path_first[k], s.path_first[k + 1]):
            a, b = s.from_body[n], s.to_body[n]
            ra, rb, pa, pb = xmat[a], xmat[b], s.from_point[n], s.to_point[n]
            ax = xpos[a, 0] + ra[0] * pa[0] + ra[1] * pa[1] + ra[2] * pa[2]
            ay = xpos[a, 1] + ra[3] * pa[0] + ra[4] * pa[1] + ra[5] * pa[2]
            az = xpos[a, 2] + ra[6] * pa[0] + ra[7] * pa[1] + ra[8] * pa[2]
            ex = xpos[b, 0] + rb[0] * pb[0] + rb[1] * pb[1] + rb[2] * pb[2] - ax
            ey = xpos[b, 1] + rb[3] * pb[0] + rb[4] * pb[1] + rb[5] * pb[2] - ay
            ez = xpos[b, 2] + rb[6] * pb[0] + rb[7] * pb[1] + rb[8] * pb[2] - az
            d = math.sqrt(ex * ex + ey * ey + ez * ez)
            length += d
            scale = 1.0 / d
            ex *= scale
            ey *= scale
            ez *= scale
            w = line[n]
            w[0] = ay * ez - az * ey
            w[1] = az * ex - ax * ez
            w[2] = ax * ey - ay * ex
            w[3] = ex
            w[4] = ey
            w[5] = ez
            for c in range(6):
                rate += w[c] * (twist[b, c] - twist[a, c])
        mtu[k] = length
        mtu_rate[k] = rate


@kernel
def tendon(strain):
    """Force and stiffness (per unit strain) of the tendon, in units of the maximal isometric force (Thelen 2003)."""
    if strain <= 0.0:
        return 0.0, 0.0
    if strain > STRAIN_TOE:
        return F_TOE + SLOPE_LINEAR * (strain - STRAIN_TOE), SLOPE_LINEAR
    e = math.exp(K_TOE * strain / STRAIN_TOE)
    scale = F_TOE / (math.exp(K_TOE) - 1.0)
    return scale * (e - 1.0), scale * e * K_TOE / STRAIN_TOE


@kernel
def passive_fibre(length):
    """Passive force of the fibre and its slope over the normalised length."""
    if length <= 1.0:
        return 0.0, 0.0
    e = math.exp(K_PASSIVE * (length - 1.0) / STRAIN_MUSCLE)
    scale = 1.0 / (math.exp(K_PASSIVE) - 1.0)
    return scale * (e - 1.0), scale * e * K_PASSIVE / STRAIN_MUSCLE


@kernel
def fibre_speed(a, afl, f):
    """Speed of the contractile element in V_max for the force f at activation a, afl = a * f_l, with its slopes over f
    and afl."""
    k = 0.25 + 0.75 * a
    if f <= 0.0:
        slope = k * (1.0 + 1.0 / A_F) / afl
        return slope * f - k, slope, -slope * f / afl
    if f <= afl:
        b = afl + f / A_F
        return k * (f - afl) / b, k * (1.0 / b - (f - afl) / (b * b * A_F)), k * (-1.0 / b - (f - afl) / (b * b))
    if f < LINEAR_ABOVE * F_LEN * afl:
        b = ECCENTRIC * (F_LEN * afl - f)
        n = f - afl
        return k * n / b, k * (1.0 / b + n * ECCENTRIC / (b * b)), k * (-1.0 / b - n * ECCENTRIC * F_LEN / (b * b))
    gap = ECCENTRIC * F_LEN * (1.0 - LINEAR_ABOVE)
    top = LINEAR_ABOVE * F_LEN
    slope = k * (1.0 / gap + (top - 1.0) * ECCENTRIC / (gap * gap))
    return k * (top - 1.0) / gap + slope * (f / afl - top), slope / afl, -slope * f / (afl * afl)


@kernel
def muscles(m, s, stage, a, l):
    """Rates of the fibre lengths with their derivatives, tendon forces [N], excitation by the body's reflexes."""
    mtu, rate, pole, coupling = s.mtu[stage], s.l_rate[stage], s.l_pole[stage], s.l_mtu[stage]
    force, reflex = s.tendon_force[stage], s.reflex[stage]
    for k in range(NM):
        lo, length = m.l_opt[k], l[k]
        ratio = m.height[k] / length
        cosine = math.sqrt(1.0 - ratio * ratio)
        ft, kt = tendon((mtu[k] - length * cosine) / m.l_slack[k] - 1.0)
        norm = length / lo
        fp, kp = passive_fibre(norm)
        fl = math.exp(-2.0 * (norm - 1.0) ** 2)
        active = max(a[k], MIN_ACTIVATION)
        afl = active * fl
        v, dv_f, dv_afl = fibre_speed(active, afl, ft / cosine - fp)
        kt /= m.l_slack[k]
        df = -kt / (cosine * cosine) - ft * ratio * ratio / (length * cosine * cosine * cosine) - kp / lo
        top = V_MAX * lo
        force[k] = ft * m.max_force[k] * s.strength[k]
        if length <= m.l_min[k] and v < 0.0:
            rate[k], pole[k], coupling[k] = 0.0, 0.0, 0.0
        else:
            rate[k] = top * v
            pole[k] = top * (dv_f * df - dv_afl * afl * 4.0 * (norm - 1.0) / lo)
            coupling[k] = top * dv_f * kt / cosine
        reflex[k] = (
            s.reflex_scale
            * (
                m.length_gain[k] * max(0.0, length - m.rest_length[k] * lo)
                + m.velocity_gain[k] * max(0.0, rate[k]) / V_MAX
            )
            / lo
        )


@kernel
def activations(m, s, stage, a):
    """Rates of the activations for the excitations from outside and from the body's reflexes, clamped to
    `excitation_floor` ... 1. A muscle acts with max(activation, 0.01). Without a floor (OpenSim 4) the state itself
    drains below that, which delays the next rise; with a floor of 0.01 (OpenSim 3.3, the published records) it
    cannot."""
    for k in range(NM):
        excitation = s.reflex[stage, k]
        if m.ankle_index[k] >= 0:
            excitation += s.excitation[m.ankle_index[k]]
        excitation = min(max(excitation, s.excitation_floor), 1.0)
        active = max(a[k], MIN_ACTIVATION)
        fast = 0.5 + 1.5 * active
        tau = TAU_RISE * fast if excitation > active else TAU_FALL / fast
        s.a_rate[stage, k] = (excitation - active) / tau
        s.a_pole[stage, k] = 1.0 / tau if a[k] >= MIN_ACTIVATION else 0.0


# ------------------------------------------------------------------------------------------------------------------
# contact


def _facet_sums(with_damping):
    @kernel
    def facet_sums(xs, ys, elastics, n, twist, dissipation, friction, viscous, transition, total):
        """Elastic foundation: sums over n facets at (x, y) of the plane with elastic force k A depth. Each gives f_n =
        k A depth max(0, 1 - c v_n) against slip f_n (mu / max(v_t, v_s) + mu_v) v_t, with velocity and point of
        application on the plane. `total` (16,): force (t1, t2, n), moments, then with damping the moments up to second
        order of k A depth c and of the tangential damping."""
        w1, w2, wn, v1, v2, vn = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
        floor = transition * transition
        f0 = f1 = f2 = mx = my = mz = d0 = d1 = d2 = d3 = d4 = d5 = t0 = t1 = t2 = t3 = 0.0
        for i in range(n):
            x, y, elastic = xs[i], ys[i], elastics[i]
            a1 = v1 - wn * y
            a2 = v2 + wn * x
            gain = max(0.0, 1.0 - dissipation * (vn + w1 * y - w2 * x))
            fn = elastic * gain
            square = max(floor, a1 * a1 + a2 * a2)
            # 1/sqrt in single precision and one Newton step: 1e-14, at half the cost
            inverse = np.float64(np.float32(1.0) / np.sqrt(np.float32(square)))
            inverse *= 1.5 - 0.5 * square * inverse * inverse
            g = fn * (friction * inverse + viscous)
            f0 -= g * a1
            f1 -= g * a2
            f2 += fn
            mx += fn * y
            my -= fn * x
            mz += g * (y * a1 - x * a2)
            if with_damping:
                d = elastic * dissipation if gain > 0.0 else 0.0
                dx, dy, gx, gy = d * x, d * y, g * x, g * y
                d0 += d
                d1 += dx
                d2 += dy
                d3 += dx * x
                d4 += dx * y
                d5 += dy * y
                t0 += g
                t1 += gx
                t2 += gy
                t3 += gx * x + gy * y
        total[0], total[1], total[2], total[3], total[4], total[5] = f0, f1, f2, mx, my, mz
        total[6], total[7], total[8], total[9], total[10], total[11] = d0, d1, d2, d3, d4, d5
        total[12], total[13], total[14], total[15] = t0, t1, t2, t3

    return facet_sums


facet_forces, facet_forces_and_damping = _facet_sums(False), _facet_sums(True)


@kernel
def place_facets(m, s, facets, blocks, place, origin):
    """Plane coordinates and elastic force k A depth of the facets in blocks that may touch, packed into the work space;
    how many."""
    p00, p01, p02 = place[0, 0], place[0, 1], place[0, 2]
    p10, p11, p12 = place[1, 0], place[1, 1], place[1, 2]
    n0, n1, n2 = place[2, 0], place[2, 1], place[2, 2]
    o0, o1, o2, modulus = origin[0], origin[1], origin[2], s.modulus
    a0, a1, a2 = abs(n0), abs(n1), abs(n2)
    for k in range(blocks.shape[1]):
        s.block_low[k] = (
            o2
            + n0 * blocks[0, k]
            + n1 * blocks[1, k]
            + n2 * blocks[2, k]
            - a0 * blocks[3, k]
            - a1 * blocks[4, k]
            - a2 * blocks[5, k]
        )
    x, y, elastic = s.facet_x, s.facet_y, s.facet_force
    n = 0
    for k in range(blocks.shape[1]):
        if s.block_low[k] < 0.0:
            here, there = np.uintp(k), np.uintp(n)
            for j in range(BLOCK):
                i = np.uintp(j)
                rx, ry, rz = facets[here, 0, i], facets[here, 1, i], facets[here, 2, i]
                depth = -(o2 + n0 * rx + n1 * ry + n2 * rz)
                x[there + i] = o0 + p00 * rx + p01 * ry + p02 * rz
                y[there + i] = o1 + p10 * rx + p11 * ry + p12 * rz
                elastic[there + i] = modulus * facets[here, 3, i] * (depth if depth > 0.0 else 0.0)
            n += BLOCK
    return n


@kernel
def contact(m, s, facets, blocks, stage):
    """`facets` (n, 4, BLOCK) are sorted into `blocks` (6, n): centre and half extents of each. Wrench of the platform
    on the calcaneus, and the damping matrices for the integrator, about the platform's pivot."""
    xpos = carray(_pointer(m.xpos), (NB, 3))
    xmat = carray(_pointer(m.xmat), (NB, 9))
    plane, pivot = s.plane, m.pivot
    place = np.empty((3, 3))
    origin = np.empty(3)
    twist = np.empty(6)
    total = np.empty(16)
    w = s.twist[CALCN]
    vx = w[3] + w[1] * pivot[2] - w[2] * pivot[1]
    vy = w[4] + w[2] * pivot[0] - w[0] * pivot[2]
    vz = w[5] + w[0] * pivot[1] - w[1] * pivot[0]
    for i in range(3):
        for j in range(3):
            place[i, j] = (
                plane[i, 0] * xmat[CALCN, j] + plane[i, 1] * xmat[CALCN, 3 + j] + plane[i, 2] * xmat[CALCN, 6 + j]
            )
        origin[i] = (
            plane[i, 0] * (xpos[CALCN, 0] - pivot[0])
            + plane[i, 1] * (xpos[CALCN, 1] - pivot[1])
            + plane[i, 2] * (xpos[CALCN, 2] - pivot[2])
        )
        twist[i] = plane[i, 0] * w[0] + plane[i, 1] * w[1] + plane[i, 2] * w[2]
        twist[3 + i] = plane[i, 0] * vx + plane[i, 1] * vy + plane[i, 2] * vz
    for c in range(6):
        s.contact[c] = 0.0
    s.touching = 0
    n = place_facets(m, s, facets, blocks, place, origin)
    force = (
        s.facet_x,
        s.facet_y,
        s.facet_force,
        n,
        twist,
        s.dissipation,
        s.friction,
        s.viscous_friction,
        s.transition,
        total,
    )
    if stage == 0:
        facet_forces_and_damping(*force)
    else:
        facet_forces(*force)
    if total[2] <= 0.0:
        return
    s.touching = 1
    wrench = s.wrench[CALCN]
    for i in range(3):
        s.contact[i] = plane[0, i] * total[0] + plane[1, i] * total[1] + plane[2, i] * total[2]
        s.contact[3 + i] = plane[0, i] * total[3] + plane[1, i] * total[4] + plane[2, i] * total[5]
        wrench[i] += s.contact[3 + i]
    fx, fy, fz = s.contact[0], s.contact[1], s.contact[2]
    wrench[0] += pivot[1] * fz - pivot[2] * fy
    wrench[1] += pivot[2] * fx - pivot[0] * fz
    wrench[2] += pivot[0] * fy - pivot[1] * fx
    wrench[3] += fx
    wrench[4] += fy
    wrench[5] += fz
    if stage > 0:
        return
    nd, td = s.normal_damping, s.tangent_damping
    # over (w1, w2, v_n): rows y, -x, 1; over (w_n, v1, v2): rows (-y, 1, 0) and (x, 0, 1)
    nd[0, 0], nd[0, 1], nd[0, 2] = total[11], -total[10], total[8]
    nd[1, 0], nd[1, 1], nd[1, 2] = -total[10], total[9], -total[7]
    nd[2, 0], nd[2, 1], nd[2, 2] = total[8], -total[7], total[6]
    td[0, 0], td[0, 1], td[0, 2] = total[15], -total[14], total[13]
    td[1, 0], td[1, 1], td[1, 2] = -total[14], total[12], 0.0
    td[2, 0], td[2, 1], td[2, 2] = total[13], 0.0, total[12]


@kernel
def contact_damping(m, s, damp):
    """(15, 15) damping of the coordinates by the contact, J'DJ."""
    for i in range(NQ):
        for j in range(NQ):
            damp[i, j] = 0.0
    if s.touching == 0:
        return
    plane, pivot, screw, local = s.plane, m.pivot, s.screw, s.plane_screw
    nd, td = s.normal_damping, s.tangent_damping
    for k in range(12):
        w = screw[k]
        vx = w[3] + w[1] * pivot[2] - w[2] * pivot[1]
        vy = w[4] + w[2] * pivot[0] - w[0] * pivot[2]
        vz = w[5] + w[0] * pivot[1] - w[1] * pivot[0]
        local[k, 0] = plane[0, 0] * w[0] + plane[0, 1] * w[1] + plane[0, 2] * w[2]
        local[k, 1] = plane[1, 0] * w[0] + plane[1, 1] * w[1] + plane[1, 2] * w[2]
        local[k, 2] = plane[2, 0] * vx + plane[2, 1] * vy + plane[2, 2] * vz
        local[k, 3] = plane[2, 0] * w[0] + plane[2, 1] * w[1] + plane[2, 2] * w[2]
        local[k, 4] = plane[0, 0] * vx + plane[0, 1] * vy + plane[0, 2] * vz
        local[k, 5] = plane[1, 0] * vx + plane[1, 1] * vy + plane[1, 2] * vz
    for k in range(12):
        x = local[k]
        a0 = nd[0, 0] * x[0] + nd[0, 1] * x[1] + nd[0, 2] * x[2]
        a1 = nd[1, 0] * x[0] + nd[1, 1] * x[1] + nd[1, 2] * x[2]
        a2 = nd[2, 0] * x[0] + nd[2, 1] * x[1] + nd[2, 2] * x[2]
        b0 = td[0, 0] * x[3] + td[0, 1] * x[4] + td[0, 2] * x[5]
        b1 = td[1, 0] * x[3] + td[1, 1] * x[4]
        b2 = td[2, 0] * x[3] + td[2, 2] * x[5]
        for j in range(k + 1):
            y = local[j]
            value = a0 * y[0] + a1 * y[1] + a2 * y[2] + b0 * y[3] + b1 * y[4] + b2 * y[5]
            damp[k, j] = value
            damp[j, k] = value


# ------------------------------------------------------------------------------------------ passive joints, ankle axes,
# brace


@kernel
def smooth_step(x):
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


@kernel
def limit_force(limit, angle, rate):
    """Torque of an elastic stop [N m]; `limit`: upper, lower [rad], stiffness above, below [N m/rad], damping [N m
    s/rad], transition [rad]."""
    above = smooth_step((angle - limit[0]) / limit[5])
    below = smooth_step((limit[1] - angle) / limit[5])
    return (
        limit[2] * above * (limit[0] - angle)
        + limit[3] * below * (limit[1] - angle)
        - limit[4] * (above + below) * rate
    )


@kernel
def euler_axes(xmat, parent, child, axis, dual):
    """Body-fixed X-Y-Z Euler angles of `child` in `parent` [rad]; the three axes in the ground frame and their dual
    basis."""
    p, c = xmat[parent], xmat[child]
    r00 = p[0] * c[0] + p[3] * c[3] + p[6] * c[6]
    r01 = p[0] * c[1] + p[3] * c[4] + p[6] * c[7]
    r02 = p[0] * c[2] + p[3] * c[5] + p[6] * c[8]
    r12 = p[1] * c[2] + p[4] * c[5] + p[7] * c[8]
    r22 = p[2] * c[2] + p[5] * c[5] + p[8] * c[8]
    x = math.atan2(-r12, r22)
    y = math.asin(min(max(r02, -1.0), 1.0))
    z = math.atan2(-r01, r00)
    cx, sx = math.cos(x), math.sin(x)
    for i in range(3):
        axis[0, i] = p[3 * i]
        axis[1, i] = cx * p[3 * i + 1] + sx * p[3 * i + 2]
        axis[2, i] = c[3 * i + 2]
    dual_basis(axis, dual)
    return x, y, z


@kernel
def dual_basis(axis, dual):
    """(3, 3) rows e^i with e^i . e_j = delta_ij."""
    for i in range(3):
        a, b = axis[(i + 1) % 3], axis[(i + 2) % 3]
        dual[i, 0] = a[1] * b[2] - a[2] * b[1]
        dual[i, 1] = a[2] * b[0] - a[0] * b[2]
        dual[i, 2] = a[0] * b[1] - a[1] * b[0]
    scale = 1.0 / (dual[0, 0] * axis[0, 0] + dual[0, 1] * axis[0, 1] + dual[0, 2] * axis[0, 2])
    for i in range(3):
        for c in range(3):
            dual[i, c] *= scale


@kernel
def jcs_angles(xmat, e1, axis, dual):
    """Raw angles (dorsiflexion, inversion, internal rotation) [rad] of the ankle complex (Wu 2002); axes and dual basis
    in the ground frame."""
    t, c = xmat[TIBIA], xmat[CALCN]
    axis[0, 0], axis[0, 1], axis[0, 2] = e1[0], e1[1], e1[2]
    axis[2, 0], axis[2, 1], axis[2, 2] = c[1], c[4], c[7]
    axis[1, 0] = axis[2, 1] * e1[2] - axis[2, 2] * e1[1]
    axis[1, 1] = axis[2, 2] * e1[0] - axis[2, 0] * e1[2]
    axis[1, 2] = axis[2, 0] * e1[1] - axis[2, 1] * e1[0]
    scale = 1.0 / math.sqrt(axis[1, 0] ** 2 + axis[1, 1] ** 2 + axis[1, 2] ** 2)
    dot = t[1] * e1[0] + t[4] * e1[1] + t[7] * e1[2]
    px, py, pz = t[1] - dot * e1[0], t[4] - dot * e1[1], t[7] - dot * e1[2]
    size = 1.0 / math.sqrt(px * px + py * py + pz * pz)
    for i in range(3):
        axis[1, i] *= scale
    dual_basis(axis, dual)
    e2, e3 = axis[1], axis[2]
    dorsiflexion = math.asin(min(max(size * (e2[0] * px + e2[1] * py + e2[2] * pz), -1.0), 1.0))
    inversion = math.asin(min(max(e1[0] * e3[0] + e1[1] * e3[1] + e1[2] * e3[2], -1.0), 1.0))
    rotation = math.asin(min(max(e2[0] * c[2] + e2[1] * c[5] + e2[2] * c[8], -1.0), 1.0))
    return dorsiflexion, inversion, rotation


@kernel
def cubic(coefficient, t):
    return t * (coefficient[0] + t * (coefficient[1] + t * coefficient[2]))


@kernel
def ankle_axes(m, s, q, u):
    """Angles, velocities, axes and dual bases of the contract's eight axes. The dual vectors of talocrural and subtalar
    lie in their plane: a torque about one of them carries no moment that does no work."""
    xmat = carray(_pointer(m.xmat), (NB, 9))
    talo, sub = s.screw[TALOCRURAL, :3], s.screw[SUBTALAR, :3]
    axis, dual, angle = s.axis, s.dual, s.angle
    dot = talo[0] * sub[0] + talo[1] * sub[1] + talo[2] * sub[2]
    scale = 1.0 / (1.0 - dot * dot)
    for c in range(3):
        axis[0, c] = talo[c]
        axis[1, c] = sub[c]
        dual[0, c] = scale * (talo[c] - dot * sub[c])
        dual[1, c] = scale * (sub[c] - dot * talo[c])
    angle[0], angle[1] = q[TALOCRURAL], q[SUBTALAR]
    raw = jcs_angles(xmat, talo, axis[2:5], dual[2:5])
    for k in range(3):
        angle[2 + k] = raw[k] - m.jcs_zero[k]
    angle[5], angle[6], angle[7] = euler_axes(xmat, TIBIA, CALCN, axis[5:8], dual[5:8])
    for k in range(N_AXES):
        s.talo_rate[k] = dual[k, 0] * talo[0] + dual[k, 1] * talo[1] + dual[k, 2] * talo[2]
        s.sub_rate[k] = dual[k, 0] * sub[0] + dual[k, 1] * sub[1] + dual[k, 2] * sub[2]
        s.velocity[k] = s.talo_rate[k] * u[TALOCRURAL] + s.sub_rate[k] * u[SUBTALAR]


@kernel
def passive_joints(m, s, q, u):
    """Wrenches of the ankle's and the back's bushings; leaves the axes of the ankle in the state."""
    xmat = carray(_pointer(m.xmat), (NB, 9))
    ankle_axes(m, s, q, u)
    anatomy = s.anatomy
    for c in range(3):
        anatomy[c] = 0.0
    for k in range(3):
        torque = -cubic(m.ankle_bushing[k], s.passive_scale * s.angle[5 + k])
        for c in range(3):
            anatomy[c] += torque * s.dual[5 + k, c]
    axis = np.empty((3, 3))
    dual = np.empty((3, 3))
    angles = euler_axes(xmat, PELVIS, TORSO, axis, dual)
    for c in range(3):
        s.wrench[CALCN, c] += anatomy[c]
        s.wrench[TIBIA, c] -= anatomy[c]
    w = s.twist
    for k in range(3):
        rate = 0.0
        for c in range(3):
            rate += dual[k, c] * (w[TORSO, c] - w[PELVIS, c])
        torque = -cubic(m.lumbar_bushing[k], angles[k]) - m.lumbar_bushing[k, 3] * rate
        for c in range(3):
            s.wrench[TORSO, c] += torque * dual[k, c]
            s.wrench[PELVIS, c] -= torque * dual[k, c]


@kernel
def brace(m, s, stage):
    """Torques of the brace about the talocrural and subtalar axes, from the held torques of the contract's axes, their
    impedance tau - K (theta - theta_held) - C (omega - omega_held), and the internal bushing; damping over the two
    coordinates besides."""
    force, damp, moment = s.ankle_force[stage], s.ankle_damp[stage], s.brace
    for i in range(2):
        force[i] = 0.0
        for j in range(2):
            damp[i, j] = 0.0
    for c in range(3):
        moment[c] = 0.0
    if s.braced == 0:
        return
    torque = s.axis_torque
    for k in range(N_AXES):
        torque[k] = s.torque[k]
        if s.yielding:
            for j in range(N_AXES):
                stiffness, damping = s.stiffness[k, j], s.damping[k, j]
                if stiffness != 0.0 or damping != 0.0:
                    torque[k] -= stiffness * (s.angle[j] - s.held_angle[j]) + damping * (
                        s.velocity[j] - s.held_velocity[j]
                    )
                    damp[0, 0] += s.talo_rate[k] * damping * s.talo_rate[j]
                    damp[0, 1] += s.talo_rate[k] * damping * s.sub_rate[j]
                    damp[1, 0] += s.sub_rate[k] * damping * s.talo_rate[j]
                    damp[1, 1] += s.sub_rate[k] * damping * s.sub_rate[j]
    if s.internal_brace_scale != 0.0:
        for k in range(3):
            torque[5 + k] -= cubic(m.ankle_bushing[k], s.internal_brace_scale * s.angle[5 + k])
    for k in range(N_AXES):
        force[0] += s.talo_rate[k] * torque[k]
        force[1] += s.sub_rate[k] * torque[k]
        for c in range(3):
            moment[c] += torque[k] * s.dual[k, c]
    mean = 0.5 * (damp[0, 1] + damp[1, 0])
    damp[0, 1] = damp[1, 0] = mean


# ------------------------------------------------------------------------------------------------------ equations of
# motion


@kernel
def evaluate(m, s, facets, blocks, stage, q, u, a, l):
    """Everything at one point of the state space that does not depend on inputs: mass matrix, force, damping, rates of
    the fibres."""
    s.evaluations += 1
    connect_paths(m, s, q)
    skeleton(m, s, stage, q, u)
    paths(m, s, s.mtu[stage], s.mtu_rate[stage])
    muscles(m, s, stage, a, l)
    wrench, line = s.wrench, s.line
    for k in range(NM):
        f = s.tendon_force[stage, k]
        for n in range(s.path_first[k], s.path_first[k + 1]):
            i, j = s.from_body[n], s.to_body[n]
            for c in range(6):
                w = f * line[n, c]
                wrench[i, c] += w
                wrench[j, c] -= w
    passive_joints(m, s, q, u)
    contact(m, s, facets, blocks, stage)
    if stage == 0:
        contact_damping(m, s, s.damp)
    force = s.force[stage]
    generalised_force(s, force)
    for k in range(NQ):
        if k != KNEE:
            force[k] -= s.bias[k if k < KNEE else k + 2 if k < LUMBAR else k + 5]
    for k in range(6):
        force[KNEE] -= s.slope[k] * s.bias[9 + k if k < 3 else 11 + k]
    force[LUMBAR] += limit_force(m.limit[0], q[LUMBAR], u[LUMBAR])
    force[KNEE] += limit_force(m.limit[1], q[KNEE], u[KNEE])


@kernel
def solve(s, stage, h, right, out):
    """out = (M + GAMMA h D)^-1 right by Cholesky, with the brace's damping in D."""
    mass, damp, ankle, low = s.mass[stage], s.damp, s.ankle_damp[0], s.factor
    gh = GAMMA * h
    for i in range(NQ):
        for j in range(i + 1):
            low[i, j] = mass[i, j] + gh * damp[i, j]
    low[10, 10] += gh * ankle[0, 0]
    low[11, 10] += gh * ankle[1, 0]
    low[11, 11] += gh * ankle[1, 1]
    # from the last coordinate to the first, so that the lumbar branch and the leg never meet
    for k in range(NQ - 1, -1, -1):
        root = math.sqrt(low[k, k])
        low[k, k] = root
        scale = 1.0 / root
        first = LUMBAR if k >= LUMBAR else 0
        for j in range(6 if k >= LUMBAR else 0):
            low[k, j] *= scale
        for j in range(first, k):
            low[k, j] *= scale
        for i in range(6 if k >= LUMBAR else 0):
            f = low[k, i]
            for j in range(i + 1):
                low[i, j] -= f * low[k, j]
        for i in range(first, k):
            f = low[k, i]
            if first > 0:
                for j in range(6):
                    low[i, j] -= f * low[k, j]
            for j in range(first, i + 1):
                low[i, j] -= f * low[k, j]
    back_substitute(low, right, out)


@kernel
def back_substitute(low, right, out):
    """M = L'L with L lower triangular: first L' y = right, from the last row; then L x = y."""
    for k in range(NQ - 1, -1, -1):
        value = right[k]
        for j in range(k + 1, NQ):
            if k < 6 or j < LUMBAR or k >= LUMBAR:
                value -= low[j, k] * out[j]
        out[k] = value / low[k, k]
    for k in range(NQ):
        value = out[k]
        for j in range(k):
            if k < LUMBAR or j < 6 or j >= LUMBAR:
                value -= low[k, j] * out[j]
        out[k] = value / low[k, k]


@kernel
def error_norm(m, s, h):
    """Largest difference between the second-order result and its embedded first-order companion, over scales that weigh
    equally in the peak angle of a landing: 30 rad/s (m/s) + the speed, 0.05 rad (m), 0.1 optimal fibre lengths,
    activations of 0.2."""
    worst = 0.0
    for k in range(NQ):
        worst = max(worst, abs(s.k1u[k] + s.k2u[k]) / (30.0 + abs(s.u[k])))
        worst = max(worst, abs(s.k1q[k] + s.k2q[k]) * 20.0)
    for k in range(NM):
        worst = max(worst, abs(s.k1l[k] + s.k2l[k]) / (0.1 * m.l_opt[k]))
        worst = max(worst, abs(s.k1a[k] + s.k2a[k]) * 5.0)
    return 0.5 * h * worst


@kernel
def step(m, s, facets, blocks, h):
    """One trial step of the Rosenbrock-W method from stage 0; returns the error norm and leaves the new point in y."""
    gh = GAMMA * h
    q, u, a, l = s.q, s.u, s.a, s.l
    right = s.right
    for k in range(NQ):
        right[k] = s.force[0, k]
    right[10] += s.ankle_force[0, 0]
    right[11] += s.ankle_force[0, 1]
    solve(s, 0, h, right, s.k1u)
    for k in range(NQ):
        s.k1q[k] = u[k] + gh * s.k1u[k]
        s.yq[k] = q[k] + h * s.k1q[k]
        s.yu[k] = u[k] + h * s.k1u[k]
    for k in range(NM):
        s.k1a[k] = s.a_rate[0, k] / (1.0 + gh * s.a_pole[0, k])
        s.k1l[k] = (s.l_rate[0, k] + gh * s.l_mtu[0, k] * s.mtu_rate[0, k]) / (1.0 - gh * s.l_pole[0, k])
        s.ya[k] = a[k] + h * s.k1a[k]
        s.yl[k] = max(l[k] + h * s.k1l[k], m.l_min[k])
    evaluate(m, s, facets, blocks, 1, s.yq, s.yu, s.ya, s.yl)
    activations(m, s, 1, s.ya)
    brace(m, s, 1)
    for i in range(NQ):
        value = s.force[1, i]
        for j in range(NQ):
            value -= 2.0 * s.mass[1, i, j] * s.k1u[j]
        right[i] = value
    right[10] += s.ankle_force[1, 0]
    right[11] += s.ankle_force[1, 1]
    solve(s, 1, h, right, s.k2u)
    for k in range(NQ):
        s.k2q[k] = s.yu[k] - 2.0 * s.k1q[k] + gh * s.k2u[k]
        s.yq[k] = q[k] + h * (1.5 * s.k1q[k] + 0.5 * s.k2q[k])
        s.yu[k] = u[k] + h * (1.5 * s.k1u[k] + 0.5 * s.k2u[k])
    for k in range(NM):
        s.k2a[k] = (s.a_rate[1, k] - 2.0 * s.k1a[k]) / (1.0 + gh * s.a_pole[1, k])
        s.k2l[k] = (
            s.l_rate[1, k] - 2.0 * s.k1l[k] + gh * s.l_mtu[1, k] * (s.mtu_rate[1, k] - 2.0 * s.mtu_rate[0, k])
        ) / (1.0 - gh * s.l_pole[1, k])
        s.ya[k] = a[k] + h * (1.5 * s.k1a[k] + 0.5 * s.k2a[k])
        s.yl[k] = max(l[k] + h * (1.5 * s.k1l[k] + 0.5 * s.k2l[k]), m.l_min[k])
    return error_norm(m, s, h)


@kernel
def refresh(m, s, facets, blocks):
    """Stage 0 at the present state and inputs."""
    if s.valid == 0:
        evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)
        s.valid = 1
    activations(m, s, 0, s.a)
    brace(m, s, 0)


@entry
def advance(model, state, facets, blocks, end, fixed_step):
    """Integrates to `end` [s] with the inputs held; `fixed_step` > 0 [s] switches the step control off. Returns DONE,
    NOT_FINITE, STEP_TOO_SMALL or TOO_MANY_STEPS."""
    m, s = model[0], state[0]
    if s.valid == 0:
        evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)
        s.valid = 1
    for k in range(N_AXES):
        s.held_angle[k] = s.angle[k]
        s.held_velocity[k] = s.velocity[k]
    refresh(m, s, facets, blocks)
    limit = 1e-12 * max(1.0, abs(end))
    tried = 0
    while end - s.time > limit:
        tried += 1
        if tried > MAX_STEPS:
            return TOO_MANY_STEPS
        left = end - s.time
        size = fixed_step if fixed_step > 0.0 else s.h
        n = math.ceil(left / size - STRETCH)
        h = left / n if n >= 1 else left
        error = step(m, s, facets, blocks, h)
        if fixed_step > 0.0:
            error = error if error != error else 0.0
        ratio = error / s.tolerance
        if not ratio <= 1.0:
            s.rejected += 1
            s.h = h * (0.25 if ratio != ratio else max(0.2, 0.85 / math.sqrt(ratio)))
            if s.h < 1e-11:
                return NOT_FINITE if ratio != ratio else STEP_TOO_SMALL
            continue
        s.steps += 1
        s.time = end if n <= 1 else s.time + h
        for k in range(NQ):
            s.q[k] = s.yq[k]
            s.u[k] = s.yu[k]
        for k in range(NM):
            s.a[k] = s.ya[k]
            s.l[k] = s.yl[k]
        if fixed_step <= 0.0:
            s.h = min(h * min(2.5, 0.85 / math.sqrt(max(ratio, 1e-4))), 1e-3)
        evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)
        activations(m, s, 0, s.a)
        brace(m, s, 0)
    for k in range(NQ):
        if not math.isfinite(s.q[k]) or not math.isfinite(s.u[k]):
            return NOT_FINITE
    return DONE


# --------------------------------------------------------------------------------------------------------- start and
# outputs


@kernel
def velocity_factor(a, speed):
    """Force over a * f_l at the normalised fibre speed: the inverse of fibre_speed, never negative."""
    k = 0.25 + 0.75 * a
    if speed <= 0.0:
        return max(0.0, (k + speed) / (k - speed / A_F))
    factor = (k + F_LEN * ECCENTRIC * speed) / (k + ECCENTRIC * speed)
    top = LINEAR_ABOVE * F_LEN
    if factor <= top:
        return factor
    gap = ECCENTRIC * F_LEN * (1.0 - LINEAR_ABOVE)
    slope = k * (1.0 / gap + (top - 1.0) * ECCENTRIC / (gap * gap))
    return top + (speed - k * (top - 1.0) / gap) / slope


@kernel
def fibre_equilibrium(m, k, mtu, mtu_rate, a, as_published):
    """Fibre length [m] at which fibre and tendon carry the same force while they share the muscle's speed by their
    stiffnesses.

    Newton iteration with step halving from 1 % tendon strain. `as_published` repeats a failure of OpenSim 3.3 that
    shaped a few published trials: a fibre that ends slack, shorter than 0.996 L_opt and shortening, was set to its
    minimum length."""
    lo, slack, height, low = m.l_opt[k], m.l_slack[k], m.height[k], m.l_min[k]
    along = mtu - 1.01 * slack
    length = max(low, math.sqrt(along * along + height * height)) if along > 0.0 else low
    speed = 0.0
    for _ in range(200):
        ratio = height / length
        cosine = math.sqrt(1.0 - ratio * ratio)
        ft, kt = tendon((mtu - length * cosine) / slack - 1.0)
        kt /= slack
        norm = length / lo
        fp, kp = passive_fibre(norm)
        fl = math.exp(-2.0 * (norm - 1.0) ** 2)
        fv = velocity_factor(a, speed)
        fm = a * fl * fv + fp
        km = (kp - 4.0 * (norm - 1.0) * a * fl * fv) / lo
        # derivative of the force along the tendon, over the fibre's length and over its projection
        slope = km * cosine + fm * ratio * ratio / (length * cosine)
        projected = slope * cosine
        error = fm * cosine - ft
        total = projected + kt
        share = kt / total if kt > 0.0 and abs(total) > 1e-12 else 0.0
        new_speed = mtu_rate * share * cosine / (V_MAX * lo)
        if abs(error) < EQUILIBRIUM and (ft < EQUILIBRIUM or abs(new_speed - speed) < 1e-12):
            break
        speed = new_speed
        fv = velocity_factor(a, speed)
        error = (a * fl * fv + fp) * cosine - ft
        gradient = slope + kt / cosine
        change = -error / gradient if abs(gradient) > 1e-12 else 0.0
        factor = 1.0
        for _ in range(40):
            trial = max(low, length + factor * change)
            r = height / trial
            c = math.sqrt(1.0 - r * r)
            force, _ = tendon((mtu - trial * c) / slack - 1.0)
            passive, _ = passive_fibre(trial / lo)
            if abs((a * math.exp(-2.0 * (trial / lo - 1.0) ** 2) * fv + passive) * c - force) <= abs(error):
                break
            factor *= 0.5
        length = max(low, length + factor * change)
    if as_published and ft < 10.0 * EQUILIBRIUM and length < 0.996 * lo and mtu_rate < 0.0:
        return low
    return length


@entry
def initialise(model, state, facets, blocks, touching, as_published):
    """From coordinates, speeds and activations to a consistent start: the pose (pelvis moved along the vertical until
    the deepest facet lies in the plane, if `touching`) and the fibres in equilibrium. Returns the depth of the deepest
    facet before that [m]."""
    m, s = model[0], state[0]
    s.known = 0
    s.time, s.h = 0.0, 2e-6
    s.evaluations = s.steps = s.rejected = 0
    for k in range(NM):
        s.l[k] = m.l_opt[k]
    evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)
    xpos = carray(_pointer(m.xpos), (NB, 3))
    xmat = carray(_pointer(m.xmat), (NB, 9))
    depth = -1e9
    for i in range(facets.shape[0] * BLOCK):
        facet = facets[i // BLOCK, :, i % BLOCK]
        height = 0.0
        for c in range(3):
            x = xpos[CALCN, c] - m.pivot[c]
            for j in range(3):
                x += xmat[CALCN, 3 * c + j] * facet[j]
            height += s.plane[2, c] * x
        depth = max(depth, -height)
    if touching:
        s.q[1] += depth / s.plane[2, 1]
    for k in range(NM):
        s.l[k] = fibre_equilibrium(m, k, s.mtu[0, k], s.mtu_rate[0, k], s.a[k], as_published)
    s.valid = 0
    refresh(m, s, facets, blocks)
    return depth


@kernel
def accept(s, inputs):
    """The FMU's inputs in the order of interface.py: excitations, torques, stiffnesses, dampings."""
    n = 0
    for k in range(N_ANKLE):
        s.excitation[k] = inputs[k]
    n += N_ANKLE
    braced = s.internal_brace_scale != 0.0
    for k in range(N_AXES):
        s.torque[k] = inputs[n + k]
        braced |= inputs[n + k] != 0.0
    n += N_AXES
    yielding = False
    for k in range(N_IMPEDANCES):
        i, j = IMPEDANCE_ROW[k], IMPEDANCE_COLUMN[k]
        s.stiffness[i, j], s.damping[i, j] = inputs[n + k], inputs[n + N_IMPEDANCES + k]
        yielding |= inputs[n + k] != 0.0 or inputs[n + N_IMPEDANCES + k] != 0.0
    s.yielding = yielding
    s.braced = braced or yielding


@kernel
def brace_moments(s, out):
    for k in range(N_AXES):
        e = s.axis[k]
        out[k] = -(s.brace[0] * e[0] + s.brace[1] * e[1] + s.brace[2] * e[2])


@entry
def respond(model, state, inputs, moments):
    """New inputs at the present state: the only outputs that follow them at once are the moments of the brace
    (n_axes,)."""
    s = state[0]
    accept(s, inputs)
    for k in range(N_AXES):
        s.held_angle[k] = s.angle[k]
        s.held_velocity[k] = s.velocity[k]
    brace(model[0], s, 0)
    brace_moments(s, moments)


@entry
def take(state, inputs):
    accept(state[0], inputs)


@entry
def observe(model, state, facets, blocks, out):
    """Writes the outputs of interface.py, in their order, for the present state and inputs."""
    m, s = model[0], state[0]
    refresh(m, s, facets, blocks)
    n = 0
    for k in range(N_AXES):
        out[n + k] = s.angle[k]
        out[n + N_AXES + k] = s.velocity[k]
    n += 2 * N_AXES
    for k in range(N_ANKLE):
        j = m.ankle_muscle[k]
        out[n + k] = s.mtu_rate[0, j] / (V_MAX * m.l_opt[j])
    n += N_ANKLE
    # inverse of the mass matrix over (talocrural, subtalar)
    unit = np.zeros(NQ)
    column = np.empty(NQ)
    unit[TALOCRURAL] = 1.0
    solve(s, 0, 0.0, unit, column)
    tt = column[TALOCRURAL]
    unit[TALOCRURAL] = 0.0
    unit[SUBTALAR] = 1.0
    back_substitute(s.factor, unit, column)
    ts, ss = column[TALOCRURAL], column[SUBTALAR]
    for k in range(N_AXES):
        rt, rs = s.talo_rate[k], s.sub_rate[k]
        out[n + k] = 1.0 / (rt * rt * tt + 2.0 * rt * rs * ts + rs * rs * ss)
    n += N_AXES
    mean = 0.0
    for k in range(4):
        mean += 0.25 * max(s.a[m.ankle_muscle[k]], MIN_ACTIVATION)
    out[n] = mean
    n += 1
    for k in range(N_AXES):
        e = s.axis[k]
        out[n + k] = -(s.anatomy[0] * e[0] + s.anatomy[1] * e[1] + s.anatomy[2] * e[2])
    brace_moments(s, out[n + N_AXES :])
    n += 2 * N_AXES
    total = 0.0
    for c in range(3):
        out[n + c] = s.contact[c]
        total += s.contact[c] ** 2
    out[n + 3] = math.sqrt(total)
    out[n + 4] = 1.0 if s.touching else 0.0
    for k in range(3):
        out[n + 5 + k] = s.angle[2 + k] + m.jcs_zero[k]


@entry
def look(model, state, facets, blocks, out):
    """Writes the local variables of interface.py, in their order, for the present state."""
    m, s = model[0], state[0]
    refresh(m, s, facets, blocks)
    for k in range(NQ):
        out[k] = s.q[k]
        out[NQ + k] = s.u[k]
    n = 2 * NQ
    for k in range(NM):
        out[n + k] = s.a[k]
        out[n + NM + k] = s.l[k]
        out[n + 2 * NM + k] = s.tendon_force[0, k]
    n += 3 * NM
    for k in range(4):
        out[n + k] = 0.0
    if s.touching == 0:
        return
    normal, force, moment = s.plane[2], s.contact[:3], s.contact[3:]
    push = normal[0] * force[0] + normal[1] * force[1] + normal[2] * force[2]
    arm = out[n:]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        arm[k] = (normal[i] * moment[j] - normal[j] * moment[i]) / push
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        arm[3] += normal[k] * (moment[k] - arm[i] * force[j] + arm[j] * force[i])
    for k in range(3):
        arm[k] += m.pivot[k]
