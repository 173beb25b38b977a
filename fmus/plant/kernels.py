"""Compiled kernels of the plant: forces, the equations of motion and their integrator. One file, so that numba's cache
never serves a stale caller; no allocation, so that they can be compiled ahead of time.

Two records carry everything: `MODEL` (constants) and `STATE` (parameters, inputs, state, work space). Frames, units and
signs: `model.py`; equations and their sources: README.md beside this file."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .interface import AXES, COORDINATES, IMPEDANCES, MOVING, NO_EDGE, PLACED, POSES

NQ, NB, NM, NP = 15, 8, 49, 175
N_CONDITIONAL = 13  # of the NP points, those that a muscle touches in a range of a coordinate only
GROUND = 0
PELVIS, FEMUR, TIBIA, TALUS, CALCN, PATELLA, TORSO = range(1, 8)
KNEE, TALOCRURAL, SUBTALAR, LUMBAR = 9, 10, 11, 12
N_ANKLE, N_EVERTORS = 8, 4  # the evertors first
N_AXES = len(AXES)
N_KNOTS = 13
MAX_FACETS = 8192
NS, LANES = 128, 4  # segments that cross from body to body, in groups of whole vectors
WIDTH, ROW = 16, 52  # of rows of NQ and of NM numbers, padded to whole vectors
BLOCK = 16  # facets that are skipped together while their bounding box is off the platform, in groups of LANES
GAMMA = 0.25  # of the Rosenbrock-W method: A-stable, smallest error constant

# Thelen 2003 (doi 10.1115/1.1531112), constants of this model
V_MAX, STRAIN_0, K_TOE, F_TOE = 10.0, 0.033, 3.0, 0.33
K_PASSIVE, STRAIN_MUSCLE, A_F, F_LEN, LINEAR_ABOVE = 4.0, 0.6, 0.3, 1.8, 0.95
STRAIN_TOE = STRAIN_0 * 99.0 * math.e**3 / (166.0 * math.e**3 - 67.0)
SLOPE_LINEAR = (1.0 - F_TOE) / (STRAIN_0 - STRAIN_TOE)
TAU_RISE, TAU_FALL, MIN_ACTIVATION = 0.01, 0.04, 0.01
EQUILIBRIUM = 1e-10  # of the maximal force, in fibre_equilibrium; a tendon at its slack length cannot come closer
ECCENTRIC = (2.0 + 2.0 / A_F) / (F_LEN - 1.0)
GAP = ECCENTRIC * F_LEN * (1.0 - LINEAR_ABOVE)
TOE, PASSIVE = F_TOE / (math.exp(K_TOE) - 1.0), 1.0 / (math.exp(K_PASSIVE) - 1.0)
HALF_PI_HIGH, HALF_PI_LOW = float.fromhex("0x1.921fb54400000p+0"), float.fromhex("0x1.0b4611a626331p-34")
LOG2_E, LN2_HIGH, LN2_LOW = (
    1.4426950408889634,
    float.fromhex("0x1.62e42fee00000p-1"),
    float.fromhex("0x1.a39ef35793c76p-33"),
)

f8, f4, i8 = np.float64, np.float32, np.int64


def in_whole_vectors(fields):
    """The record of `fields` whose arrays each begin at a whole vector, so that no load of one reaches over two lines of
    the processor's cache."""
    plain = np.dtype(fields)
    kinds, offsets, end = [plain[k] for k in range(len(plain))], [], 0
    for kind in kinds:
        unit = 8 * LANES if kind.shape or kind.names else kind.alignment
        offsets.append(-(-end // unit) * unit)
        end = offsets[-1] + kind.itemsize
    end = -(-end // (8 * LANES)) * 8 * LANES
    return np.dtype({"names": plain.names, "formats": kinds, "offsets": offsets, "itemsize": end}, align=True)


MODEL = in_whole_vectors(
    [
        # `scaled`: of a person of another size than the MuJoCo model; a joint's anchor in the parent's and in the body's own frame
        ("scaled", i8), ("gravity", f8), ("body_mass", f8, (NB,)), ("body_com", f8, (NB, 3)), ("body_inertia", f8, (NB, 9)),
        ("anchor_in_parent", f8, (NB, 3)), ("anchor", f8, (NB, 3)), ("talocrural_axis", f8, (3,)), ("subtalar_axis", f8, (3,)),
        ("published_height", f8),
        ("spline_size", i8, (5,)), ("spline_scale", f8, (5,)), ("spline_knot", f8, (5, N_KNOTS)),
        ("spline_coefficient", f8, (5, N_KNOTS, 4)),
        ("max_force", f8, (NM,)), ("l_opt", f8, (NM,)), ("l_slack", f8, (NM,)), ("height", f8, (NM,)), ("l_min", f8, (NM,)),
        ("length_gain", f8, (NM,)), ("velocity_gain", f8, (NM,)), ("rest_length", f8, (NM,)),
        ("ankle_muscle", i8, (N_ANKLE,)), ("tibialis_anterior", i8),
        ("point_muscle", i8, (NP,)), ("point_body", i8, (NP,)), ("point", f8, (NP, 3)), ("point_coordinate", i8, (NP,)),
        ("conditional", i8, (N_CONDITIONAL,)),
        ("point_low", f8, (NP,)), ("point_high", f8, (NP,)),
        ("ankle_bushing", f8, (3, 3)), ("brace_bushing", f8, (3, 3)), ("lumbar_bushing", f8, (3, 4)),
        ("limit", f8, (2, 6)), ("pivot", f8, (3,)), ("jcs_zero", f8, (3,)),
    ]
)  # fmt: skip
STATE = in_whole_vectors(
    [
        # parameters of the landing
        ("plane", f8, (3, 3)), ("modulus", f8), ("dissipation", f8), ("friction", f8), ("viscous_friction", f8), ("transition", f8),
        ("passive_scale", f8), ("internal_brace_scale", f8), ("reflex_scale", f8), ("excitation_floor", f8), ("strength", f8, (NM,)), ("tolerance", f8),
        ("edged", i8), ("edge", f8, (3,)),  # the platform is where edge[0] x + edge[1] y <= edge[2] in its plane
        # inputs, held over a communication step
        ("excitation", f8, (N_ANKLE,)), ("torque", f8, (N_AXES,)), ("stiffness", f8, (N_AXES, N_AXES)), ("damping", f8, (N_AXES, N_AXES)),
        ("held_angle", f8, (N_AXES,)), ("held_velocity", f8, (N_AXES,)), ("braced", i8), ("yielding", i8),
        # state
        ("time", f8), ("h", f8), ("q", f8, (NQ,)), ("u", f8, (NQ,)), ("a", f8, (NM,)), ("l", f8, (NM,)),
        ("evaluations", i8), ("steps", i8), ("rejected", i8),
        # set by evaluate(); stage 0 is at the state, stage 1 at the trial point
        ("valid", i8), ("mass", f8, (2, NQ, WIDTH)), ("force", f8, (2, NQ)), ("damp", f8, (NQ, WIDTH)), ("a_rate", f8, (2, ROW)), ("a_pole", f8, (2, ROW)),
        ("l_rate", f8, (2, ROW)), ("l_pole", f8, (2, ROW)), ("l_mtu", f8, (2, ROW)), ("mtu", f8, (2, ROW)), ("mtu_rate", f8, (2, ROW)),
        ("tendon_force", f8, (2, ROW)), ("reflex", f8, (2, ROW)), ("ankle_force", f8, (2, 2)), ("ankle_damp", f8, (2, 2, 2)),
        # work space
        ("xpos", f8, (NB, 3)), ("xmat", f8, (NB, 9)), ("acceleration", f8, (NB, 6)), ("inertia", f8, (NB, 10)),
        ("joint_axes", f8, (3, 3)), ("momentum", f8, (2, 6)), ("place", f8, (6,)), ("slope", f8, (6,)), ("curvature", f8, (6,)),
        ("screw", f8, (NQ, 6)), ("patella_screw", f8, (6,)), ("twist", f8, (NB, 6)), ("wrench", f8, (NB, 6)),
        ("segments", i8), ("groups", i8), ("active", i8), ("known", i8), ("path_base", f8, (NM,)),
        ("group_start", i8, (NB * NB,)), ("group_end", i8, (NB * NB,)), ("group_first", i8, (NB * NB + 1,)),
        ("segment_muscle", i8, (NS,)), ("place_muscle", i8, (NS,)), ("first_place", i8, (NM,)),
        ("others", i8), ("other_muscle", i8, (NS,)), ("other_place", i8, (NS,)), ("start_point", f8, (3, NS)), ("end_point", f8, (3, NS)),
        ("contact", f8, (6,)), ("normal_damping", f8, (3, 3)), ("tangent_damping", f8, (3, 3)), ("touching", i8),
        ("angle", f8, (N_AXES,)), ("velocity", f8, (N_AXES,)), ("axis", f8, (N_AXES, 3)), ("dual", f8, (N_AXES, 3)),
        ("talo_rate", f8, (N_AXES,)), ("sub_rate", f8, (N_AXES,)), ("anatomy", f8, (3,)), ("brace", f8, (3,)), ("axis_torque", f8, (N_AXES,)),
        ("facet_place", f8, (3, 3)), ("facet_origin", f8, (3,)), ("facet_twist", f8, (6,)), ("facet_sum", f8, (16,)),
        ("back_axis", f8, (3, 3)), ("back_dual", f8, (3, 3)),
        # work space that a saved state leaves out (SAVED_BEFORE)
        ("unit", f8, (WIDTH,)), ("screws", f8, (6, WIDTH)), ("hung", f8, (10, WIDTH)), ("screw_momentum", f8, (6, WIDTH)),
        ("plane_screws", f8, (6, WIDTH)), ("plane_damping", f8, (6, WIDTH)), ("depth_mm", f8), ("turn", f8, (WIDTH,)), ("cosine", f8, (WIDTH,)), ("sine", f8, (WIDTH,)),
        ("segment_ends", i8, (NS, 2)), ("line", f8, (6, NS)), ("segment_length", f8, (NS + 1,)), ("segment_rate", f8, (NS + 1,)), ("pull", f8, (NS,)),
        ("drive", f8, (NM,)), ("fibre", f8, (6, ROW)),
        ("block_low", f8, (MAX_FACETS // BLOCK,)), ("facet_x", f8, (MAX_FACETS,)), ("facet_y", f8, (MAX_FACETS,)), ("facet_force", f8, (MAX_FACETS,)),
        ("rows", f8, (NQ, WIDTH)), ("columns", f8, (NQ, WIDTH)), ("pivot", f8, (WIDTH,)), ("inverse", f8, (NQ,)), ("worst", f8, (LANES,)), ("right", f8, (WIDTH,)),
        ("k1q", f8, (NQ,)), ("k1u", f8, (NQ,)), ("k1a", f8, (NM,)), ("k1l", f8, (NM,)), ("k2q", f8, (NQ,)), ("k2u", f8, (NQ,)), ("k2a", f8, (NM,)), ("k2l", f8, (NM,)),
        ("yq", f8, (NQ,)), ("yu", f8, (NQ,)), ("ya", f8, (NM,)), ("yl", f8, (NM,)),
    ]
)  # fmt: skip

SAVED_BEFORE = "unit"
N_IMPEDANCES = len(IMPEDANCES)
IMPEDANCE_ROW = np.array([AXES.index(a) for a, _ in IMPEDANCES])
IMPEDANCE_COLUMN = np.array([AXES.index(b) for _, b in IMPEDANCES])
N_OUTPUTS = 2 * N_AXES + N_ANKLE + N_AXES + 1 + 2 * N_AXES + 5 + 3
PLACED_AT = np.array([COORDINATES.index(c) for c in PLACED])
MOVING_AT = np.array([COORDINATES.index(c) for c in MOVING])
DONE, NOT_FINITE, STEP_TOO_SMALL, TOO_MANY_STEPS, FOOT_INSIDE, NO_FOOTHOLD = 0, 1, 2, 3, 4, 5
TOUCHING, PUBLISHED, GIVEN = POSES["touching"], POSES["published"], POSES["given"]
FORGIVEN_MM = 0.1  # depth of a given foot in the platform that its numbers' rounding explains
EQUILIBRIUM_START, AS_PUBLISHED = 0, 1
LEAST_FORCE = 1e-6  # N, of a foot that touches; the touching pose leaves a depth of rounding
SLIP_TRANSITION = 0.1  # m/s, below which friction grows linearly with slip
OTHER_ACTIVATION = 0.05  # of the muscles that the controller does not reach, at contact
STRETCH = 0.15  # a step may be this much longer than proposed, rather than two short ones up to the next exchange
MAX_STEPS = 50_000  # of one call; a landing needs about 800

FAST = {"reassoc", "contract", "nsz", "arcp"}
kernel = njit(error_model="numpy", fastmath=FAST)
entry = njit(error_model="numpy", fastmath=FAST, cache=True, nogil=True)  # called from Python by plant.py


def apart(fastmath):
    """Of a loop over arrays that share no memory, which the build tells the compiler: without that it looks for overlaps
    before each loop, or leaves it without vector instructions."""

    def decorate(function):
        function.apart = True
        return njit(error_model="numpy", fastmath=fastmath)(function)

    return decorate


vector = apart(FAST)
# without leave to take reciprocals, which processors of different makers estimate differently
rounded = apart(FAST - {"arcp"})
ordered = apart({"contract"})  # sums in the order in which they stand


# ----------------------------------------------------------------------------------------------------------------
# skeleton


@kernel
def knee_movements(m, s, angle):
    """Tibia (x, y, turn) and patella (x, y, turn) over the knee angle: writes `place` [m, rad], slopes and
    curvatures."""
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
        s.place[k] = value
        s.slope[k] = slope
        s.curvature[k] = curvature


@ordered
def cosines_and_sines(angle, cosine, sine):
    """(16,) to 3e-16, without branches, so that the loop becomes vector code."""
    for k in range(WIDTH):
        x = angle[k]
        n = np.floor(x * (2.0 / math.pi) + 0.5)
        r = (x - n * HALF_PI_HIGH) - n * HALF_PI_LOW
        # Taylor's series up to r^16 for |r| <= pi/4, in groups that do not wait for each other
        z = r * r
        z2 = z * z
        z4 = z2 * z2
        odd = (1.0 - z * (1.0 / 6.0)) + z2 * (1.0 / 120.0 - z * (1.0 / 5040.0))
        odd += z4 * (
            (1.0 / 362880.0 - z * (1.0 / 39916800.0)) + z2 * (1.0 / 6227020800.0 - z * (1.0 / 1307674368000.0))
        )
        odd *= r
        even = (1.0 / 24.0 - z * (1.0 / 720.0)) + z2 * (1.0 / 40320.0 - z * (1.0 / 3628800.0))
        even += z4 * ((1.0 / 479001600.0 - z * (1.0 / 87178291200.0)) + z2 * (1.0 / 20922789888000.0))
        even = 1.0 - (0.5 * z - z2 * even)
        quarter = n - 4.0 * np.floor(0.25 * n)
        swapped = quarter == 1.0 or quarter == 3.0
        c = odd if swapped else even
        cosine[k] = -c if quarter == 1.0 or quarter == 2.0 else c
        c = even if swapped else odd
        sine[k] = -c if quarter >= 2.0 else c


@kernel
def turn_z(base, c, n, out):
    """out = base Rz of an angle with cosine c and sine n; rotation matrices are (9,), row by row."""
    for i in range(3):
        x, y = base[3 * i], base[3 * i + 1]
        out[3 * i] = c * x + n * y
        out[3 * i + 1] = c * y - n * x
        out[3 * i + 2] = base[3 * i + 2]


@kernel
def turn_zxy(base, cosine, sine, out, axes):
    """out = base Rz Rx Ry of three angles; `axes` (3, 3): the rows are the axes of the turns in the ground frame."""
    cz, cx, cy = cosine[0], cosine[1], cosine[2]
    nz, nx, ny = sine[0], sine[1], sine[2]
    for i in range(3):
        x, y, z = base[3 * i], base[3 * i + 1], base[3 * i + 2]
        axes[0, i] = z
        x, y = cz * x + nz * y, cz * y - nz * x
        axes[1, i] = x
        y, z = cx * y + nx * z, cx * z - nx * y
        axes[2, i] = y
        out[3 * i] = cy * x - ny * z
        out[3 * i + 1] = y
        out[3 * i + 2] = ny * x + cy * z


@kernel
def turn_about(base, axis, c, n, out):
    """out = base R(axis, angle) for a unit axis and an angle with cosine c and sine n (Rodrigues)."""
    a, b, d = axis[0], axis[1], axis[2]
    v = 1.0 - c
    for i in range(3):
        x, y, z = base[3 * i], base[3 * i + 1], base[3 * i + 2]
        along = v * (a * x + b * y + d * z)
        out[3 * i] = c * x + along * a + n * (y * d - z * b)
        out[3 * i + 1] = c * y + along * b + n * (z * a - x * d)
        out[3 * i + 2] = c * z + along * d + n * (x * b - y * a)


@kernel
def hang(m, s, body, parent):
    """Body at its joint's anchor in the parent, which is the origin of its own frame but for the tibia's; it moves with
    the parent until joints are added."""
    r, anchor = s.xmat[parent], m.anchor_in_parent[body]
    for i in range(3):
        s.xpos[body, i] = s.xpos[parent, i] + r[3 * i] * anchor[0] + r[3 * i + 1] * anchor[1] + r[3 * i + 2] * anchor[2]
    for i in range(6):
        s.twist[body, i] = s.twist[parent, i]
        s.acceleration[body, i] = s.acceleration[parent, i]


@kernel
def set_hinge(screw, ex, ey, ez, at):
    """Screw about the ground's origin of a turn about the axis e through the point `at`."""
    screw[0], screw[1], screw[2] = ex, ey, ez
    screw[3] = at[1] * ez - at[2] * ey
    screw[4] = at[2] * ex - at[0] * ez
    screw[5] = at[0] * ey - at[1] * ex


@kernel
def add_joint(s, body, screw, rate):
    """Twist and velocity-dependent acceleration of a body that moves along a further screw, which its parent
    carries."""
    v, a = s.twist[body], s.acceleration[body]
    a[0] += rate * (v[1] * screw[2] - v[2] * screw[1])
    a[1] += rate * (v[2] * screw[0] - v[0] * screw[2])
    a[2] += rate * (v[0] * screw[1] - v[1] * screw[0])
    a[3] += rate * (v[1] * screw[5] - v[2] * screw[4] + v[4] * screw[2] - v[5] * screw[1])
    a[4] += rate * (v[2] * screw[3] - v[0] * screw[5] + v[5] * screw[0] - v[3] * screw[2])
    a[5] += rate * (v[0] * screw[4] - v[1] * screw[3] + v[3] * screw[1] - v[4] * screw[0])
    for i in range(6):
        v[i] += rate * screw[i]


@kernel
def ball(m, s, body, parent, first, u):
    """Three turns about z, x, y at one point, of the coordinates `first` ... `first` + 2."""
    axes = s.joint_axes
    turn_zxy(s.xmat[parent], s.cosine[first : first + 3], s.sine[first : first + 3], s.xmat[body], axes)
    for i in range(3):
        screw = s.screw[first + i]
        set_hinge(screw, axes[i, 0], axes[i, 1], axes[i, 2], s.xpos[body])
        add_joint(s, body, screw, u[first + i])


@kernel
def hinge(m, s, body, parent, axis, k, u):
    """One turn about a fixed axis of the parent, of the coordinate k."""
    hang(m, s, body, parent)
    r = s.xmat[parent]
    turn_about(r, axis, s.cosine[k], s.sine[k], s.xmat[body])
    ex = r[0] * axis[0] + r[1] * axis[1] + r[2] * axis[2]
    ey = r[3] * axis[0] + r[4] * axis[1] + r[5] * axis[2]
    ez = r[6] * axis[0] + r[7] * axis[1] + r[8] * axis[2]
    set_hinge(s.screw[k], ex, ey, ez, s.xpos[body])
    add_joint(s, body, s.screw[k], u[k])


@kernel
def ride_knee(m, s, body, first, turn, screw, rate):
    """Tibia or patella on the femur: two translations and a turn about z, all functions of the knee angle, whose values,
    slopes and curvatures stand from `first` on, cosine and sine of the turn at `turn`. `screw` is that of the knee coordinate."""
    hang(m, s, body, FEMUR)
    r, at, a = s.xmat[FEMUR], s.xpos[body], s.acceleration[body]
    x, y = s.place[first], s.place[first + 1]
    x1, y1, turn1 = s.slope[first], s.slope[first + 1], s.slope[first + 2]
    x2, y2, turn2 = s.curvature[first], s.curvature[first + 1], s.curvature[first + 2]
    for i in range(3):
        at[i] += r[3 * i] * x + r[3 * i + 1] * y
    ex, ey, ez = turn1 * r[2], turn1 * r[5], turn1 * r[8]
    lx, ly, lz = r[0] * x1 + r[1] * y1, r[3] * x1 + r[4] * y1, r[6] * x1 + r[7] * y1
    set_hinge(screw, ex, ey, ez, at)
    screw[3] += lx
    screw[4] += ly
    screw[5] += lz
    add_joint(s, body, screw, rate)
    # the screw changes along the coordinate itself: slope of the turn, of the translation, and the anchor that moves
    square = rate * rate
    fx, fy, fz = turn2 * r[2], turn2 * r[5], turn2 * r[8]
    a[0] += square * fx
    a[1] += square * fy
    a[2] += square * fz
    a[3] += square * (r[0] * x2 + r[1] * y2 + at[1] * fz - at[2] * fy + ly * ez - lz * ey)
    a[4] += square * (r[3] * x2 + r[4] * y2 + at[2] * fx - at[0] * fz + lz * ex - lx * ez)
    a[5] += square * (r[6] * x2 + r[7] * y2 + at[0] * fy - at[1] * fx + lx * ey - ly * ex)
    turn_z(r, s.cosine[turn], s.sine[turn], s.xmat[body])
    own, r = m.anchor[body], s.xmat[body]
    for i in range(3):
        at[i] -= r[3 * i] * own[0] + r[3 * i + 1] * own[1] + r[3 * i + 2] * own[2]


@kernel
def carry(inertia, v, out):
    """Momentum of an inertia about the ground's origin, (10,): mass, first moment, second moment xx yy zz xy xz yz,
    moving with the twist v."""
    mass, x, y, z = inertia[0], inertia[1], inertia[2], inertia[3]
    xx, yy, zz, xy, xz, yz = inertia[4], inertia[5], inertia[6], inertia[7], inertia[8], inertia[9]
    out[0] = xx * v[0] + xy * v[1] + xz * v[2] + y * v[5] - z * v[4]
    out[1] = xy * v[0] + yy * v[1] + yz * v[2] + z * v[3] - x * v[5]
    out[2] = xz * v[0] + yz * v[1] + zz * v[2] + x * v[4] - y * v[3]
    out[3] = mass * v[3] + z * v[1] - y * v[2]
    out[4] = mass * v[4] + x * v[2] - z * v[0]
    out[5] = mass * v[5] + y * v[0] - x * v[1]


@kernel
def weigh(m, s, body):
    """Inertia of the body about the ground's origin, and as its wrench what gravity and its velocity ask of its joints,
    with the opposite sign."""
    r, com, local, mass = s.xmat[body], m.body_com[body], m.body_inertia[body], m.body_mass[body]
    out = s.inertia[body]
    x = s.xpos[body, 0] + r[0] * com[0] + r[1] * com[1] + r[2] * com[2]
    y = s.xpos[body, 1] + r[3] * com[0] + r[4] * com[1] + r[5] * com[2]
    z = s.xpos[body, 2] + r[6] * com[0] + r[7] * com[1] + r[8] * com[2]
    out[0], out[1], out[2], out[3] = mass, mass * x, mass * y, mass * z
    ax = r[0] * local[0] + r[1] * local[3] + r[2] * local[6]
    ay = r[0] * local[1] + r[1] * local[4] + r[2] * local[7]
    az = r[0] * local[2] + r[1] * local[5] + r[2] * local[8]
    bx = r[3] * local[0] + r[4] * local[3] + r[5] * local[6]
    by = r[3] * local[1] + r[4] * local[4] + r[5] * local[7]
    bz = r[3] * local[2] + r[4] * local[5] + r[5] * local[8]
    cx = r[6] * local[0] + r[7] * local[3] + r[8] * local[6]
    cy = r[6] * local[1] + r[7] * local[4] + r[8] * local[7]
    cz = r[6] * local[2] + r[7] * local[5] + r[8] * local[8]
    out[4] = ax * r[0] + ay * r[1] + az * r[2] + mass * (y * y + z * z)
    out[5] = bx * r[3] + by * r[4] + bz * r[5] + mass * (x * x + z * z)
    out[6] = cx * r[6] + cy * r[7] + cz * r[8] + mass * (x * x + y * y)
    out[7] = ax * r[3] + ay * r[4] + az * r[5] - mass * x * y
    out[8] = ax * r[6] + ay * r[7] + az * r[8] - mass * x * z
    out[9] = bx * r[6] + by * r[7] + bz * r[8] - mass * y * z
    v, h, f, wrench = s.twist[body], s.momentum[0], s.momentum[1], s.wrench[body]
    carry(out, v, h)
    carry(out, s.acceleration[body], f)
    wrench[0] = -f[0] - (v[1] * h[2] - v[2] * h[1] + v[4] * h[5] - v[5] * h[4])
    wrench[1] = -f[1] - (v[2] * h[0] - v[0] * h[2] + v[5] * h[3] - v[3] * h[5])
    wrench[2] = -f[2] - (v[0] * h[1] - v[1] * h[0] + v[3] * h[4] - v[4] * h[3])
    wrench[3] = -f[3] - (v[1] * h[5] - v[2] * h[4])
    wrench[4] = -f[4] - (v[2] * h[3] - v[0] * h[5])
    wrench[5] = -f[5] - (v[0] * h[4] - v[1] * h[3])


@vector
def carry_all(inertia, v, out):
    """As `carry`, of the inertia (10, 16) that each screw (6, 16) moves."""
    for k in range(WIDTH):
        mass, x, y, z = inertia[0, k], inertia[1, k], inertia[2, k], inertia[3, k]
        xx, yy, zz = inertia[4, k], inertia[5, k], inertia[6, k]
        xy, xz, yz = inertia[7, k], inertia[8, k], inertia[9, k]
        v0, v1, v2, v3, v4, v5 = v[0, k], v[1, k], v[2, k], v[3, k], v[4, k], v[5, k]
        out[0, k] = xx * v0 + xy * v1 + xz * v2 + y * v5 - z * v4
        out[1, k] = xy * v0 + yy * v1 + yz * v2 + z * v3 - x * v5
        out[2, k] = xz * v0 + yz * v1 + zz * v2 + x * v4 - y * v3
        out[3, k] = mass * v3 + z * v1 - y * v2
        out[4, k] = mass * v4 + x * v2 - z * v0
        out[5, k] = mass * v5 + y * v0 - x * v1


@vector
def hang_on(inertia, out):
    """(10, 16) inertia of all that each coordinate moves, and last what the knee moves besides: the patella."""
    for c in range(10):
        foot, talus = inertia[CALCN, c], inertia[CALCN, c] + inertia[TALUS, c]
        shank, torso = talus + inertia[TIBIA, c], inertia[TORSO, c]
        leg = shank + inertia[FEMUR, c] + inertia[PATELLA, c]
        whole = inertia[PELVIS, c] + leg + torso
        for k in range(6):
            out[c, k] = whole
        for k in range(6, KNEE):
            out[c, k] = leg
        out[c, KNEE], out[c, TALOCRURAL], out[c, SUBTALAR] = shank, talus, foot
        for k in range(LUMBAR, NQ):
            out[c, k] = torso
        out[c, NQ] = inertia[PATELLA, c]


def _products(first, last, width):
    @vector
    def products(left, right, out):
        """Numbers 0 ... width - 1 of the rows first ... last - 1 of the product left' right, both (6, 16)."""
        for i in range(first, last):
            for j in range(width):
                out[i, j] = (
                    left[0, i] * right[0, j]
                    + left[1, i] * right[1, j]
                    + left[2, i] * right[2, j]
                    + left[3, i] * right[3, j]
                    + left[4, i] * right[4, j]
                    + left[5, i] * right[5, j]
                )

    return products


products_0, products_4, products_8, products_12 = (_products(k, min(k + 4, NQ), k + 4) for k in range(0, NQ, 4))


@vector
def side_by_side(screw, patella_screw, out):
    """`out` (6, 16): the screws (15, 6) as columns, and the patella's."""
    for c in range(6):
        for k in range(NQ):
            out[c, k] = screw[k, c]
        out[c, NQ] = patella_screw[c]


@vector
def mirror(matrix):
    """The lower triangle also above the diagonal."""
    for i in range(NQ):
        for j in range(i):
            matrix[j, i] = matrix[i, j]


@kernel
def masses(s, mass):
    """(15, 15) by composite bodies, summed from the leaves to the root (Featherstone 2008, section 6.2)."""
    screws, h = s.screws, s.screw_momentum
    hang_on(s.inertia, s.hung)
    carry_all(s.hung, screws, h)
    knee = 0.0
    for c in range(6):
        # the knee moves tibia and patella, each along a screw of its own
        knee += h[c, KNEE] * screws[c, KNEE] + h[c, NQ] * screws[c, NQ]
        h[c, KNEE] += h[c, NQ]
    products_0(h, screws, mass)
    products_4(h, screws, mass)
    products_8(h, screws, mass)
    products_12(h, screws, mass)
    mass[KNEE, KNEE] = knee
    for i in range(LUMBAR, NQ):
        for j in range(6, LUMBAR):
            mass[i, j] = 0.0
    mirror(mass)


@kernel
def skeleton(m, s, stage, q, u):
    """Frames of the bodies, the screw of each coordinate and the twist of each body about the ground's origin (angular
    part first), the mass matrix (15 x 15), and the wrenches of inertia and gravity on the bodies, from which the forces
    of the other terms go on."""
    knee_movements(m, s, q[KNEE])
    for k in range(3, NQ):
        s.turn[k] = q[k]
    s.turn[KNEE], s.turn[NQ] = s.place[2], s.place[5]  # of the tibia and the patella
    cosines_and_sines(s.turn, s.cosine, s.sine)
    for i in range(3):
        s.xpos[PELVIS, i] = q[i]
        for c in range(6):
            s.screw[i, c] = 0.0
        s.screw[i, 3 + i] = 1.0
        s.twist[PELVIS, i], s.twist[PELVIS, 3 + i] = 0.0, u[i]
        s.acceleration[PELVIS, i], s.acceleration[PELVIS, 3 + i] = 0.0, 0.0
    s.acceleration[PELVIS, 4] = m.gravity  # a frame that rises so feels gravity
    for i in range(9):
        s.xmat[GROUND, i] = 1.0 if i % 4 == 0 else 0.0
    ball(m, s, PELVIS, GROUND, 3, u)
    hang(m, s, FEMUR, PELVIS)
    ball(m, s, FEMUR, PELVIS, 6, u)
    ride_knee(m, s, TIBIA, 0, KNEE, s.screw[KNEE], u[KNEE])
    ride_knee(m, s, PATELLA, 3, NQ, s.patella_screw, u[KNEE])
    hinge(m, s, TALUS, TIBIA, m.talocrural_axis, TALOCRURAL, u)
    hinge(m, s, CALCN, TALUS, m.subtalar_axis, SUBTALAR, u)
    hang(m, s, TORSO, PELVIS)
    ball(m, s, TORSO, PELVIS, LUMBAR, u)
    for c in range(6):
        s.wrench[GROUND, c] = 0.0
    for body in range(1, NB):
        weigh(m, s, body)
    side_by_side(s.screw, s.patella_screw, s.screws)
    masses(s, s.mass[stage])


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
    """Lists the segments that cross from body to body for the conditional points active at q, those between the same
    two bodies together; the lengths inside bodies are constants."""
    active = 0
    bit = 1
    for k in range(N_CONDITIONAL):
        p = m.conditional[k]
        if m.point_low[p] <= q[m.point_coordinate[p]] <= m.point_high[p]:
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
            s.path_base[k] = 0.0
        elif m.point_body[p] == m.point_body[last]:
            square = 0.0
            for i in range(3):
                square += (m.point[p, i] - m.point[last, i]) ** 2
            s.path_base[k] += math.sqrt(square)
        else:
            s.segment_muscle[n], s.segment_ends[n, 0], s.segment_ends[n, 1] = k, last, p
            n += 1
        last = p
    s.segments = n
    group_segments(m, s)


@kernel
def group_segments(m, s):
    """Places the segments by the bodies of their two ends; each group is filled up to whole vectors with segments of no
    muscle. A muscle's first segment stands in `first_place`, where NS is a place of no length, further ones in
    `other_place`."""
    s.groups = s.others = n = 0
    for i in range(NS):
        s.place_muscle[i] = NM
    for k in range(NM):
        s.first_place[k] = NS
    for a in range(NB):
        for b in range(NB):
            first = n
            for i in range(s.segments):
                start, end, k = s.segment_ends[i, 0], s.segment_ends[i, 1], s.segment_muscle[i]
                if m.point_body[start] == a and m.point_body[end] == b:
                    s.place_muscle[n] = k
                    if s.first_place[k] == NS:
                        s.first_place[k] = n
                    else:
                        s.other_muscle[s.others], s.other_place[s.others] = k, n
                        s.others += 1
                    for c in range(3):
                        s.start_point[c, n], s.end_point[c, n] = m.point[start, c], m.point[end, c]
                    n += 1
            if n > first:
                while n % LANES:
                    for c in range(3):
                        s.start_point[c, n], s.end_point[c, n] = s.start_point[c, first], s.end_point[c, first]
                    n += 1
                g = s.groups
                s.group_start[g], s.group_end[g], s.group_first[g], s.group_first[g + 1] = a, b, first, n
                s.groups += 1


@vector
def cross(xpos, xmat, twist, groups, group_start, group_end, group_first, start, end, line, length, rate):
    """Of the segments of each group, from its first body to its second: the unit wrench (A x e, e), (6, n), the length
    and its rate."""
    for g in range(groups):
        a, b = group_start[g], group_end[g]
        ra, rb, ta, tb, va, vb = xmat[a], xmat[b], xpos[a], xpos[b], twist[a], twist[b]
        v0, v1, v2 = vb[0] - va[0], vb[1] - va[1], vb[2] - va[2]
        v3, v4, v5 = vb[3] - va[3], vb[4] - va[4], vb[5] - va[5]
        for first in range(group_first[g], group_first[g + 1], LANES):
            here = np.uintp(first)
            for i in range(LANES):
                n = here + np.uintp(i)
                p, q, r = start[0, n], start[1, n], start[2, n]
                ax = ta[0] + ra[0] * p + ra[1] * q + ra[2] * r
                ay = ta[1] + ra[3] * p + ra[4] * q + ra[5] * r
                az = ta[2] + ra[6] * p + ra[7] * q + ra[8] * r
                p, q, r = end[0, n], end[1, n], end[2, n]
                ex = tb[0] + rb[0] * p + rb[1] * q + rb[2] * r - ax
                ey = tb[1] + rb[3] * p + rb[4] * q + rb[5] * r - ay
                ez = tb[2] + rb[6] * p + rb[7] * q + rb[8] * r - az
                d = math.sqrt(ex * ex + ey * ey + ez * ez)
                scale = 1.0 / d
                ex *= scale
                ey *= scale
                ez *= scale
                mx, my, mz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
                line[0, n] = mx
                line[1, n] = my
                line[2, n] = mz
                line[3, n] = ex
                line[4, n] = ey
                line[5, n] = ez
                length[n] = d
                rate[n] = mx * v0 + my * v1 + mz * v2 + ex * v3 + ey * v4 + ez * v5


@kernel
def paths(m, s, mtu, mtu_rate):
    """(49,) length and lengthening speed of the muscles; the unit wrenches of the crossing segments."""
    cross(
        s.xpos,
        s.xmat,
        s.twist,
        s.groups,
        s.group_start,
        s.group_end,
        s.group_first,
        s.start_point,
        s.end_point,
        s.line,
        s.segment_length,
        s.segment_rate,
    )
    for k in range(NM):
        n = s.first_place[k]
        mtu[k], mtu_rate[k] = s.path_base[k] + s.segment_length[n], s.segment_rate[n]
    for i in range(s.others):
        k, n = s.other_muscle[i], s.other_place[i]
        mtu[k] += s.segment_length[n]
        mtu_rate[k] += s.segment_rate[n]


@vector
def pulls(line, pull, first, last, total):
    """(6,) wrench of the segments first ... last - 1 that pull with `pull` [N]."""
    w0 = w1 = w2 = w3 = w4 = w5 = 0.0
    begin = np.uintp(first)
    for i in range(last - first):
        n = begin + np.uintp(i)
        f = pull[n]
        w0 += f * line[0, n]
        w1 += f * line[1, n]
        w2 += f * line[2, n]
        w3 += f * line[3, n]
        w4 += f * line[4, n]
        w5 += f * line[5, n]
    total[0], total[1], total[2], total[3], total[4], total[5] = w0, w1, w2, w3, w4, w5


@kernel
def pull_bodies(s, force):
    """Wrenches of the muscles' forces (52,), of which those beyond the muscles are nothing, on the bodies that they
    cross."""
    pull, wrench, total = s.pull, s.wrench, s.momentum[0]
    for n in range(s.group_first[s.groups]):
        pull[n] = force[s.place_muscle[n]]
    for g in range(s.groups):
        pulls(s.line, pull, s.group_first[g], s.group_first[g + 1], total)
        a, b = s.group_start[g], s.group_end[g]
        for c in range(6):
            wrench[a, c] += total[c]
            wrench[b, c] -= total[c]


@ordered
def exponential(x):
    """e^x without branches, so that loops over the muscles become vector code: 9e-15 relative between -700 and 700,
    beyond which x is taken as that."""
    x = 700.0 if x > 700.0 else x
    x = -700.0 if x < -700.0 else x
    n = np.floor(x * LOG2_E + 0.5)
    r = (x - n * LN2_HIGH) - n * LN2_LOW
    # Taylor's series up to r^11 for |r| <= ln(2)/2, in groups that do not wait for each other
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 + r) + r2 * (0.5 + r * (1.0 / 6.0))
    middle = (1.0 / 24.0 + r * (1.0 / 120.0)) + r2 * (1.0 / 720.0 + r * (1.0 / 5040.0))
    high = (1.0 / 40320.0 + r * (1.0 / 362880.0)) + r2 * (1.0 / 3628800.0 + r * (1.0 / 39916800.0))
    return (low + r4 * (middle + r4 * high)) * np.int64((np.int64(np.int32(n)) + 1023) << 52).view(np.float64)


@kernel
def tendon(strain):
    """Force and stiffness (per unit strain) of the tendon, in units of the maximal isometric force (Thelen 2003)."""
    e = exponential(min(max(strain, 0.0), STRAIN_TOE) * (K_TOE / STRAIN_TOE))
    in_toe = strain <= STRAIN_TOE
    force = TOE * (e - 1.0) if in_toe else F_TOE + SLOPE_LINEAR * (strain - STRAIN_TOE)
    stiffness = TOE * K_TOE / STRAIN_TOE * e if in_toe else SLOPE_LINEAR
    return force, stiffness if strain > 0.0 else 0.0


@kernel
def passive_fibre(length):
    """Passive force of the fibre and its slope over the normalised length."""
    e = exponential(K_PASSIVE / STRAIN_MUSCLE * max(length - 1.0, 0.0))
    return PASSIVE * (e - 1.0), PASSIVE * K_PASSIVE / STRAIN_MUSCLE * e if length > 1.0 else 0.0


@kernel
def fibre_speed(a, afl, f):
    """Speed of the contractile element in V_max for the force f at activation a, afl = a * f_l, with its slopes over f
    and afl. Below no force and above 0.95 of the greatest the law goes on as a straight line."""
    k = 0.25 + 0.75 * a
    top = LINEAR_ABOVE * F_LEN * afl
    inside = min(max(f, 0.0), top)
    shortens = inside <= afl
    beyond = f >= top  # without the differences of near numbers, which would be the noise of the stiffest muscles
    lengthening = GAP * afl if beyond else ECCENTRIC * (F_LEN * afl - inside)
    b = afl + inside * (1.0 / A_F) if shortens else lengthening
    both = 1.0 / (b * afl)  # one division for two reciprocals
    scale = k * afl * both
    n = ((LINEAR_ABOVE * F_LEN - 1.0) * afl if beyond else inside - afl) * afl * both
    slope = scale * (1.0 - n * (1.0 / A_F) if shortens else 1.0 + n * ECCENTRIC)
    over_afl = -scale * (1.0 + n if shortens else 1.0 + n * (ECCENTRIC * F_LEN))
    straight = f <= 0.0 or beyond
    return k * n + slope * (f - inside), slope, -slope * f * b * both if straight else over_afl


@vector
def lines_of_pull(l, mtu, l_opt, l_slack, height, work):
    """The first of three loops over the muscles, which are short enough for the processor to overlap many muscles: 1 / the
    fibre's projection, 1 / l_opt, 1 / l_slack, the strain of the tendon and that of the fibre, in the rows of `work`."""
    for k in range(NM):
        length, lo, slack = l[k], l_opt[k], l_slack[k]
        projected = math.sqrt(length * length - height[k] * height[k])
        both = lo * slack
        every = 1.0 / (projected * both)  # one division for three reciprocals
        per_lo, per_slack = every * projected * slack, every * projected * lo
        work[0, k], work[1, k], work[2, k] = every * both, per_lo, per_slack
        work[3, k], work[4, k] = (mtu[k] - slack - projected) * per_slack, (length - lo) * per_lo


@vector
def tensions(l, a, height, max_force, strength, work, force):
    """Tendon forces [N]; a f_l, the force of the contractile element with its slope over the fibre's length, and the
    tendon's stiffness along the fibre."""
    for k in range(NM):
        inverse, per_lo, per_slack, beyond = work[0, k], work[1, k], work[2, k], work[4, k]
        ft, kt = tendon(work[3, k])
        fp, kp = passive_fibre(1.0 + beyond)
        per_cosine = l[k] * inverse
        along_fibre = kt * per_slack * per_cosine
        force[k] = ft * max_force[k] * strength[k]
        work[0, k] = max(a[k], MIN_ACTIVATION) * exponential(-2.0 * beyond * beyond)
        work[2, k] = ft * per_cosine - fp
        work[3, k] = -along_fibre * per_cosine - ft * height[k] * height[k] * inverse * inverse * inverse - kp * per_lo
        work[5, k] = along_fibre


@vector
def fibres(l, a, l_opt, l_min, rest_length, length_gain, velocity_gain, scale, work, rate, pole, coupling, reflex):
    """(49,) rates of the fibre lengths l [m] with their derivatives over l and mtu; excitations by the body's reflexes."""
    for k in range(NM):
        length, lo, afl, per_lo = l[k], l_opt[k], work[0, k], work[1, k]
        v, dv_f, dv_afl = fibre_speed(max(a[k], MIN_ACTIVATION), afl, work[2, k])
        top = 0.0 if length <= l_min[k] and v < 0.0 else V_MAX * lo
        speed = top * v
        rate[k] = speed
        pole[k] = top * (dv_f * work[3, k] - dv_afl * afl * 4.0 * work[4, k] * per_lo)
        coupling[k] = top * dv_f * work[5, k]
        stretch = length_gain[k] * max(0.0, length - rest_length[k] * lo)
        reflex[k] = scale * (stretch + velocity_gain[k] * max(0.0, speed) * (1.0 / V_MAX)) * per_lo


@kernel
def muscles(m, s, stage, a, l):
    """Rates of the fibre lengths with their derivatives, tendon forces [N], excitation by the body's reflexes."""
    work, rate, reflex = s.fibre, s.l_rate[stage], s.reflex[stage]
    lines_of_pull(l, s.mtu[stage], m.l_opt, m.l_slack, m.height, work)
    tensions(l, a, m.height, m.max_force, s.strength, work, s.tendon_force[stage])
    fibres(
        l,
        a,
        m.l_opt,
        m.l_min,
        m.rest_length,
        m.length_gain,
        m.velocity_gain,
        s.reflex_scale,
        work,
        rate,
        s.l_pole[stage],
        s.l_mtu[stage],
        reflex,
    )


@vector
def activation_rates(drive, a, floor, rate, pole):
    """(49,) rates of the activations a for the excitations `drive`, clamped to `floor` ... 1, and minus their
    derivatives over a."""
    for k in range(NM):
        excitation = min(max(drive[k], floor), 1.0)
        active = max(a[k], MIN_ACTIVATION)
        fast = 0.5 + 1.5 * active
        speed = 1.0 / (TAU_RISE * fast) if excitation > active else fast * (1.0 / TAU_FALL)
        rate[k] = (excitation - active) * speed
        pole[k] = speed if a[k] >= MIN_ACTIVATION else 0.0


@kernel
def activations(m, s, stage, a):
    """Rates of the activations for the excitations from outside and from the body's reflexes, clamped to
    `excitation_floor` ... 1. A muscle acts with max(activation, 0.01). Without a floor (OpenSim 4) the state itself
    drains below that, which delays the next rise; with a floor of 0.01 (OpenSim 3.3, the published records) it
    cannot."""
    for k in range(NM):
        s.drive[k] = s.reflex[stage, k]
    for k in range(N_ANKLE):
        s.drive[m.ankle_muscle[k]] += s.excitation[k]
    activation_rates(s.drive, a, s.excitation_floor, s.a_rate[stage], s.a_pole[stage])


# ------------------------------------------------------------------------------------------------------------------
# contact


def _facet_sums(with_damping):
    @rounded
    def facet_sums(xs, ys, elastics, n, twist, dissipation, friction, viscous, transition, total):
        """Elastic foundation: sums over n facets at (x, y) of the plane with elastic force k A depth. Each gives f_n =
        k A depth max(0, 1 - c v_n) against slip f_n (mu / max(v_t, v_s) + mu_v) v_t, with velocity and point of
        application on the plane. `total` (16,): force (t1, t2, n), moments, then with damping the moments up to second
        order of k A depth c and of the tangential damping."""
        w1, w2, wn, v1, v2, vn = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
        floor, one = transition * transition, f4(1.0)
        level, along_x, along_y = 1.0 - dissipation * vn, dissipation * w2, -dissipation * w1
        f0 = f1 = f2 = mx = my = mz = d0 = d1 = d2 = d3 = d4 = d5 = t0 = t1 = t2 = t3 = 0.0
        for i in range(n):
            x, y, elastic = xs[i], ys[i], elastics[i]
            gain = level + along_x * x + along_y * y
            pressing = elastic if gain > 0.0 else 0.0
            force = pressing * gain
            a1 = v1 - wn * y
            a2 = v2 + wn * x
            square = max(floor, a1 * a1 + a2 * a2)
            # 1/sqrt in single precision and one Newton step: 1e-14, at half the cost
            inverse = f8(one / np.sqrt(f4(square)))
            inverse *= 1.5 - 0.5 * square * inverse * inverse
            g = force * (friction * inverse + viscous)
            if with_damping:
                # the other sums follow from these, since gain and slip are linear in x and y
                px, py, gx, gy = pressing * x, pressing * y, g * x, g * y
                d0 += pressing
                d1 += px
                d2 += py
                d3 += px * x
                d4 += px * y
                d5 += py * y
                t0 += g
                t1 += gx
                t2 += gy
                t3 += gx * x + gy * y
            else:
                f0 -= g * a1
                f1 -= g * a2
                f2 += force
                mx += force * y
                my -= force * x
                mz += g * (y * a1 - x * a2)
        if with_damping:
            f0, f1, mz = wn * t2 - v1 * t0, -v2 * t0 - wn * t1, v1 * t2 - v2 * t1 - wn * t3
            f2 = level * d0 + along_x * d1 + along_y * d2
            mx, my = level * d2 + along_x * d4 + along_y * d5, -level * d1 - along_x * d3 - along_y * d4
        total[0], total[1], total[2], total[3], total[4], total[5] = f0, f1, f2, mx, my, mz
        total[6], total[7], total[8] = dissipation * d0, dissipation * d1, dissipation * d2
        total[9], total[10], total[11] = dissipation * d3, dissipation * d4, dissipation * d5
        total[12], total[13], total[14], total[15] = t0, t1, t2, t3

    return facet_sums


facet_forces, facet_forces_and_damping = _facet_sums(False), _facet_sums(True)


@vector
def place_facets(facets, blocks, place, origin, modulus, low, x, y, elastic):
    """Plane coordinates and elastic force k A depth of the facets that touch and of those in one group with them, packed
    into `x`, `y` and `elastic`; how many. `low` is work space: the height of each block's lowest corner."""
    stiffness = -modulus
    p00, p01, p02 = place[0, 0], place[0, 1], place[0, 2]
    p10, p11, p12 = place[1, 0], place[1, 1], place[1, 2]
    n0, n1, n2 = place[2, 0], place[2, 1], place[2, 2]
    o0, o1, o2 = origin[0], origin[1], origin[2]
    a0, a1, a2 = abs(n0), abs(n1), abs(n2)
    n = 0
    for four in range(0, blocks.shape[1], LANES):
        near, first = False, np.uintp(four)
        for j in range(LANES):
            k = first + np.uintp(j)
            low[k] = (
                o2
                + n0 * blocks[0, k]
                + n1 * blocks[1, k]
                + n2 * blocks[2, k]
                - a0 * blocks[3, k]
                - a1 * blocks[4, k]
                - a2 * blocks[5, k]
            )
            near |= low[k] < 0.0
        if not near:
            continue
        for j in range(LANES):
            k = first + np.uintp(j)
            if low[k] < 0.0:
                for start in range(0, BLOCK, LANES):
                    touching, there = False, np.uintp(n)
                    for lane in range(LANES):
                        i, o = np.uintp(start) + np.uintp(lane), there + np.uintp(lane)
                        rx, ry, rz = facets[k, 0, i], facets[k, 1, i], facets[k, 2, i]
                        height = o2 + n0 * rx + n1 * ry + n2 * rz
                        x[o] = o0 + p00 * rx + p01 * ry + p02 * rz
                        y[o] = o1 + p10 * rx + p11 * ry + p12 * rz
                        elastic[o] = facets[k, 3, i] * (min(height, 0.0) * stiffness)
                        touching |= height < 0.0
                    n += LANES if touching else 0
    return n


@kernel
def let_off(s, n):
    """Facets beyond the platform's edge carry nothing."""
    for i in range(n):
        if s.edge[0] * s.facet_x[i] + s.edge[1] * s.facet_y[i] > s.edge[2]:
            s.facet_force[i] = 0.0


@kernel
def contact(m, s, facets, blocks, stage):
    """`facets` (n, 4, BLOCK) are sorted into `blocks` (6, n): centre and half extents of each. Wrench of the platform
    on the calcaneus, and the damping matrices for the integrator, about the platform's pivot."""
    xpos, xmat = s.xpos, s.xmat
    plane, pivot = s.plane, m.pivot
    place, origin, twist, total = s.facet_place, s.facet_origin, s.facet_twist, s.facet_sum
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
    n = place_facets(facets, blocks, place, origin, s.modulus, s.block_low, s.facet_x, s.facet_y, s.facet_force)
    if s.edged == 1:
        let_off(s, n)
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
    if total[2] <= LEAST_FORCE:
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


@vector
def in_plane(screws, plane, pivot, out):
    """(6, 16) of the coordinates that move the foot: (w1, w2, v_n, w_n, v1, v2) in the plane's axes, at the pivot."""
    for k in range(LUMBAR):
        w0, w1, w2 = screws[0, k], screws[1, k], screws[2, k]
        vx = screws[3, k] + w1 * pivot[2] - w2 * pivot[1]
        vy = screws[4, k] + w2 * pivot[0] - w0 * pivot[2]
        vz = screws[5, k] + w0 * pivot[1] - w1 * pivot[0]
        out[0, k] = plane[0, 0] * w0 + plane[0, 1] * w1 + plane[0, 2] * w2
        out[1, k] = plane[1, 0] * w0 + plane[1, 1] * w1 + plane[1, 2] * w2
        out[2, k] = plane[2, 0] * vx + plane[2, 1] * vy + plane[2, 2] * vz
        out[3, k] = plane[2, 0] * w0 + plane[2, 1] * w1 + plane[2, 2] * w2
        out[4, k] = plane[0, 0] * vx + plane[0, 1] * vy + plane[0, 2] * vz
        out[5, k] = plane[1, 0] * vx + plane[1, 1] * vy + plane[1, 2] * vz


@vector
def damped(screws, nd, td, out):
    """(6, 16): what the damping makes of each coordinate's motion in the plane."""
    for k in range(LUMBAR):
        x0, x1, x2, x3, x4, x5 = screws[0, k], screws[1, k], screws[2, k], screws[3, k], screws[4, k], screws[5, k]
        out[0, k] = nd[0, 0] * x0 + nd[0, 1] * x1 + nd[0, 2] * x2
        out[1, k] = nd[1, 0] * x0 + nd[1, 1] * x1 + nd[1, 2] * x2
        out[2, k] = nd[2, 0] * x0 + nd[2, 1] * x1 + nd[2, 2] * x2
        out[3, k] = td[0, 0] * x3 + td[0, 1] * x4 + td[0, 2] * x5
        out[4, k] = td[1, 0] * x3 + td[1, 1] * x4
        out[5, k] = td[2, 0] * x3 + td[2, 2] * x5


@kernel
def contact_damping(m, s, damp):
    """(15, 16) damping of the coordinates by the contact, J'DJ, in its lower triangle."""
    for i in range(NQ):
        for j in range(WIDTH):
            damp[i, j] = 0.0
    if s.touching == 0:
        return
    in_plane(s.screws, s.plane, m.pivot, s.plane_screws)
    damped(s.plane_screws, s.normal_damping, s.tangent_damping, s.plane_damping)
    products_0(s.plane_damping, s.plane_screws, damp)
    products_4(s.plane_damping, s.plane_screws, damp)
    products_8(s.plane_damping, s.plane_screws, damp)


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
    size = 1.0 / math.sqrt(r12 * r12 + r22 * r22)
    y = math.asin(min(max(r02, -1.0), 1.0))
    z = math.atan2(-r01, r00)
    cx, sx = size * r22, -size * r12
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
    xmat = s.xmat
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
    xmat = s.xmat
    ankle_axes(m, s, q, u)
    anatomy = s.anatomy
    for c in range(3):
        anatomy[c] = 0.0
    for k in range(3):
        torque = -cubic(m.ankle_bushing[k], s.passive_scale * s.angle[5 + k])
        for c in range(3):
            anatomy[c] += torque * s.dual[5 + k, c]
    axis, dual = s.back_axis, s.back_dual
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
            torque[5 + k] -= cubic(m.brace_bushing[k], s.internal_brace_scale * s.angle[5 + k])
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
    pull_bodies(s, s.tendon_force[stage])
    passive_joints(m, s, q, u)
    contact(m, s, facets, blocks, stage)
    if stage == 0:
        contact_damping(m, s, s.damp)
    force = s.force[stage]
    generalised_force(s, force)
    force[LUMBAR] += limit_force(m.limit[0], q[LUMBAR], u[LUMBAR])
    force[KNEE] += limit_force(m.limit[1], q[KNEE], u[KNEE])


def _elimination(width):
    @vector
    def eliminate(rows, columns, pivot, scale, k, first, last):
        """Row k out of the rows first ... last - 1, of which `width` numbers reach up to the diagonal."""
        for i in range(first, last):
            f = scale * pivot[i]
            for j in range(width):
                rows[i, j] -= f * pivot[j]
            rows[k, i] = columns[i, k] = f

    return eliminate


eliminate_4, eliminate_8, eliminate_12, eliminate_16 = (_elimination(width) for width in range(4, 17, 4))


@vector
def factorise(mass, damp, ankle_damp, gh, rows, columns, pivot, inverse):
    """M + gh D = L' E L with L lower triangular, one on its diagonal: L without that in `rows` and once more, transposed,
    in `columns` (15, 16); 1 / E in `inverse` (15,). From the last coordinate to the first, so that the lumbar branch and
    the leg never meet. Rows are padded to whole vectors; only the lower triangle counts."""
    for i in range(NQ):
        for j in range(WIDTH):
            rows[i, j] = mass[i, j] + gh * damp[i, j]
    for i in range(2):
        for j in range(2):
            rows[TALOCRURAL + i, TALOCRURAL + j] += gh * ankle_damp[i, j]
    for k in range(NQ - 1, -1, -1):
        scale = 1.0 / rows[k, k]
        inverse[k] = scale
        for j in range(WIDTH):
            pivot[j] = rows[k, j]
            rows[k, j] = 0.0
        before = 6 if k >= LUMBAR else k
        eliminate_4(rows, columns, pivot, scale, k, 0, min(before, 4))
        eliminate_8(rows, columns, pivot, scale, k, 4, min(before, 8))
        eliminate_12(rows, columns, pivot, scale, k, 8, before)
        eliminate_16(rows, columns, pivot, scale, k, LUMBAR, k)


@vector
def forward(rows, right):
    """L'^-1 of `right` (16,), in its place."""
    for k in range(NQ - 1, 0, -1):
        value = right[k]
        for j in range(WIDTH):
            right[j] -= value * rows[k, j]


@vector
def backward(columns, inverse, right, out):
    """(E L)^-1 of `right` (16,), which is overwritten."""
    for k in range(NQ):
        right[k] *= inverse[k]
    for k in range(NQ):
        value = right[k]
        out[k] = value
        for j in range(WIDTH):
            right[j] -= value * columns[k, j]


@vector
def less_twice(matrix, x, right):
    """Takes twice the product of a symmetric `matrix` (15, 16) and x (15,) from `right` (16,)."""
    for i in range(NQ):
        f = 2.0 * x[i]
        for j in range(WIDTH):
            right[j] -= f * matrix[i, j]


@kernel
def solve(s, right, out):
    """out (15,) = (M + gh D)^-1 right for the matrix factorised last; overwrites `right` (16,)."""
    forward(s.rows, right)
    backward(s.columns, s.inverse, right, out)


@vector
def worst_of_fibres(l1, l2, a1, a2, l_opt, worst):
    """(4,) largest share of the fibres in the error, of every fourth muscle."""
    for j in range(LANES):
        worst[j] = 0.0
    whole = NM // LANES * LANES
    for first in range(0, whole, LANES):
        for j in range(LANES):
            k = np.uintp(first) + np.uintp(j)
            worst[j] = max(worst[j], max(abs(l1[k] + l2[k]) * (10.0 / l_opt[k]), abs(a1[k] + a2[k]) * 5.0))
    for k in range(whole, NM):
        worst[0] = max(worst[0], max(abs(l1[k] + l2[k]) * (10.0 / l_opt[k]), abs(a1[k] + a2[k]) * 5.0))


@kernel
def error_norm(m, s, h):
    """Largest difference between the second-order result and its embedded first-order companion, over scales that weigh
    equally in the peak angle of a landing: 30 rad/s (m/s) + the speed, 0.05 rad (m), 0.1 optimal fibre lengths,
    activations of 0.2."""
    worst, each = 0.0, s.worst
    for k in range(NQ):
        worst = max(worst, abs(s.k1u[k] + s.k2u[k]) / (30.0 + abs(s.u[k])))
        worst = max(worst, abs(s.k1q[k] + s.k2q[k]) * 20.0)
    worst_of_fibres(s.k1l, s.k2l, s.k1a, s.k2a, m.l_opt, each)
    for k in range(LANES):
        worst = max(worst, each[k])
    return 0.5 * h * worst


@kernel
def step(m, s, facets, blocks, h):
    """One trial step of the Rosenbrock-W method from stage 0; returns the error norm and leaves the new point in y."""
    gh = GAMMA * h
    q, u, a, l = s.q, s.u, s.a, s.l
    right = s.right
    for k in range(NQ):
        right[k] = s.force[0, k]
    right[TALOCRURAL] += s.ankle_force[0, 0]
    right[SUBTALAR] += s.ankle_force[0, 1]
    factorise(s.mass[0], s.damp, s.ankle_damp[0], gh, s.rows, s.columns, s.pivot, s.inverse)
    solve(s, right, s.k1u)
    for k in range(NQ):
        s.k1q[k] = u[k] + gh * s.k1u[k]
        s.yq[k] = q[k] + h * s.k1q[k]
        s.yu[k] = u[k] + h * s.k1u[k]
    for k in range(NM):
        of_a, of_l = 1.0 + gh * s.a_pole[0, k], 1.0 - gh * s.l_pole[0, k]
        both = 1.0 / (of_a * of_l)  # one division for two reciprocals
        s.k1a[k] = s.a_rate[0, k] * of_l * both
        s.k1l[k] = (s.l_rate[0, k] + gh * s.l_mtu[0, k] * s.mtu_rate[0, k]) * of_a * both
        s.ya[k] = a[k] + h * s.k1a[k]
        s.yl[k] = max(l[k] + h * s.k1l[k], m.l_min[k])
    evaluate(m, s, facets, blocks, 1, s.yq, s.yu, s.ya, s.yl)
    activations(m, s, 1, s.ya)
    brace(m, s, 1)
    for k in range(NQ):
        right[k] = s.force[1, k]
    less_twice(s.mass[1], s.k1u, right)
    right[TALOCRURAL] += s.ankle_force[1, 0]
    right[SUBTALAR] += s.ankle_force[1, 1]
    factorise(s.mass[1], s.damp, s.ankle_damp[0], gh, s.rows, s.columns, s.pivot, s.inverse)
    solve(s, right, s.k2u)
    for k in range(NQ):
        s.k2q[k] = s.yu[k] - 2.0 * s.k1q[k] + gh * s.k2u[k]
        s.yq[k] = q[k] + h * (1.5 * s.k1q[k] + 0.5 * s.k2q[k])
        s.yu[k] = u[k] + h * (1.5 * s.k1u[k] + 0.5 * s.k2u[k])
    for k in range(NM):
        of_a, of_l = 1.0 + gh * s.a_pole[1, k], 1.0 - gh * s.l_pole[1, k]
        both = 1.0 / (of_a * of_l)
        change = s.mtu_rate[1, k] - 2.0 * s.mtu_rate[0, k]
        s.k2a[k] = (s.a_rate[1, k] - 2.0 * s.k1a[k]) * of_l * both
        s.k2l[k] = (s.l_rate[1, k] - 2.0 * s.k1l[k] + gh * s.l_mtu[1, k] * change) * of_a * both
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
def advance(m, s, facets, blocks, end, fixed_step):
    """Integrates to `end` [s] with the inputs held; `fixed_step` > 0 [s] switches the step control off. Returns DONE,
    NOT_FINITE, STEP_TOO_SMALL or TOO_MANY_STEPS."""
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

    Newton iteration with step halving from 1 % tendon strain. `as_published` repeats what the old solver (OpenSim 3.3)
    did with tibialis anterior: in some trials it ended at the minimum, in others at the optimal length. Which, was
    found on every other one of the published trials: a description of the record, not of physiology."""
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
    along = mtu - slack * (1.0 + 1e-11)
    loose = math.sqrt(along * along + height * height) if along > 0.0 else low
    if ft < EQUILIBRIUM and abs(length - loose) < EQUILIBRIUM * slack:
        length = max(low, loose)  # just beyond the slack length, where stiffness jumps, however the iteration came near
    if as_published and k == m.tibialis_anterior:
        share = length / lo
        if share - 0.03 * (mtu_rate + 0.54) < 0.9955:
            return low
        if share + 0.150 * mtu_rate < 0.962:
            return lo
    return length


@entry
def muscle_lengths(m, s, facets, blocks, pose, out):
    """(49,) lengths of the muscles [m] at the coordinates `pose`; what was evaluated before is not valid any more."""
    for k in range(NQ):
        s.yq[k], s.yu[k] = pose[k], 0.0
    for k in range(NM):
        s.ya[k], s.yl[k] = OTHER_ACTIVATION, m.l_opt[k]
    s.known = s.valid = 0
    evaluate(m, s, facets, blocks, 0, s.yq, s.yu, s.ya, s.yl)
    for k in range(NM):
        out[k] = s.mtu[0, k]
    s.known = 0


@entry
def prepare(m, s, p):
    """Parameters of the landing `p` (any record with the names of interface.PARAMETERS, `initial_pose`, `fibre_start`, and the
    arrays `placed` and `moving` of interface.PLACED and MOVING), coordinates, speeds and activations at contact. The excitations that stand in the state give the ankle muscles their first activation (floor
    0.01) unless `initial_ankle_activation` is set."""
    sine, cosine = math.sin(p.platform_incline), math.cos(p.platform_incline)
    for i in range(3):
        for j in range(3):
            s.plane[i, j] = 0.0
    s.plane[0, 0] = 1.0
    s.plane[1, 1], s.plane[1, 2] = sine, -cosine
    s.plane[2, 1], s.plane[2, 2] = cosine, sine
    s.edged = p.platform_edge_distance < NO_EDGE
    # the plane's second axis points medially
    s.edge[0], s.edge[1] = math.cos(p.platform_edge_direction), -math.sin(p.platform_edge_direction)
    s.edge[2] = p.platform_edge_distance
    s.modulus, s.dissipation = p.contact_modulus, p.contact_dissipation
    s.friction, s.viscous_friction, s.transition = p.contact_friction, p.contact_viscous_friction, SLIP_TRANSITION
    s.passive_scale, s.internal_brace_scale = p.passive_angle_scale, p.internal_brace_angle_scale
    s.reflex_scale, s.tolerance = p.body_reflex_scale, p.tolerance
    s.excitation_floor = MIN_ACTIVATION if p.fibre_start == AS_PUBLISHED else 0.0
    for k in range(NM):
        s.strength[k], s.a[k] = 1.0, OTHER_ACTIVATION
    for k in range(N_ANKLE):
        j = m.ankle_muscle[k]
        first = p.initial_ankle_activation if p.initial_ankle_activation != 0.0 else s.excitation[k]
        s.strength[j], s.a[j] = p.ankle_strength_scale, min(max(first, MIN_ACTIVATION), 1.0)
        if k < N_EVERTORS:
            s.strength[j] *= p.evertor_strength_scale
    for k in range(len(PLACED_AT)):
        s.q[PLACED_AT[k]] = p.placed[k]
    for k in range(len(MOVING_AT)):
        s.u[MOVING_AT[k]] = p.moving[k]
    if p.initial_pose != GIVEN:
        s.q[1] = m.published_height
    s.q[TALOCRURAL], s.q[SUBTALAR] = p.talocrural_angle_at_contact, p.subtalar_angle_at_contact
    s.u[TALOCRURAL], s.u[SUBTALAR] = p.talocrural_velocity_at_contact, p.subtalar_velocity_at_contact
    fall = math.sqrt(2.0 * m.gravity * p.drop_height)
    s.u[1] = p.pelvis_vertical_velocity if p.pelvis_vertical_velocity != 0.0 else -fall
    s.braced, s.yielding = s.internal_brace_scale != 0.0, 0
    for k in range(N_AXES):
        s.torque[k] = s.held_angle[k] = s.held_velocity[k] = 0.0
        for j in range(N_AXES):
            s.stiffness[k, j] = s.damping[k, j] = 0.0


@kernel
def deepest(m, s, facets):
    """Depth of the deepest facet on the platform [m], whose edge is still counted from the calcaneus' origin. -1e9: none
    is on it."""
    xpos, xmat = s.xpos, s.xmat
    depth = -1e9
    for i in range(facets.shape[0] * BLOCK):
        facet = facets[i // BLOCK, :, i % BLOCK]
        height = reach = 0.0
        for c in range(3):
            turned = 0.0
            for j in range(3):
                turned += xmat[CALCN, 3 * c + j] * facet[j]
            reach += (s.edge[0] * s.plane[0, c] + s.edge[1] * s.plane[1, c]) * turned
            height += s.plane[2, c] * (xpos[CALCN, c] - m.pivot[c] + turned)
        if s.edged == 0 or reach <= s.edge[2]:
            depth = max(depth, -height)
    return depth


@entry
def initialise(m, s, facets, blocks, pose, as_published):
    """From coordinates, speeds and activations to a consistent start: the pose (pelvis moved along the vertical until
    the deepest facet lies in the plane, if TOUCHING) and the fibres in equilibrium. Leaves the depth of the deepest
    facet before that in the state, and places the edge in the platform. Returns DONE, FOOT_INSIDE for a given pose whose
    foot is inside the platform, or NO_FOOTHOLD."""
    s.known = 0
    s.time, s.h = 0.0, 2e-6
    s.evaluations = s.steps = s.rejected = 0
    for k in range(NM):
        s.l[k] = m.l_opt[k]
    evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)
    depth = deepest(m, s, facets)
    if depth < -1e8:
        return NO_FOOTHOLD
    s.depth_mm = 1e3 * depth
    if pose == GIVEN and s.depth_mm > FORGIVEN_MM:
        return FOOT_INSIDE
    if pose == TOUCHING:
        s.q[1] += depth / s.plane[2, 1]
        s.edge[2] += s.edge[1] * s.plane[1, 1] * depth / s.plane[2, 1]
    for c in range(3):
        s.edge[2] += (s.edge[0] * s.plane[0, c] + s.edge[1] * s.plane[1, c]) * (s.xpos[CALCN, c] - m.pivot[c])
    for k in range(NM):
        s.l[k] = fibre_equilibrium(m, k, s.mtu[0, k], s.mtu_rate[0, k], s.a[k], as_published)
    s.valid = 0
    refresh(m, s, facets, blocks)
    return DONE


@entry
def take(s, inputs):
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
def respond(m, s, inputs, moments):
    """New inputs at the present state: the only outputs that follow them at once are the moments of the brace
    (n_axes,)."""
    take(s, inputs)
    for k in range(N_AXES):
        s.held_angle[k] = s.angle[k]
        s.held_velocity[k] = s.velocity[k]
    brace(m, s, 0)
    brace_moments(s, moments)


@entry
def observe(m, s, facets, blocks, out):
    """Writes the outputs of interface.py, in their order, for the present state and inputs."""
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
    talo, sub = s.right, s.unit
    for k in range(WIDTH):
        talo[k] = sub[k] = 0.0
    talo[TALOCRURAL] = sub[SUBTALAR] = 1.0
    factorise(s.mass[0], s.damp, s.ankle_damp[0], 0.0, s.rows, s.columns, s.pivot, s.inverse)
    forward(s.rows, talo)
    forward(s.rows, sub)
    tt = ts = ss = 0.0
    for k in range(SUBTALAR + 1):
        tt += s.inverse[k] * talo[k] * talo[k]
        ts += s.inverse[k] * talo[k] * sub[k]
        ss += s.inverse[k] * sub[k] * sub[k]
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
def look(m, s, facets, blocks, out):
    """Writes the local variables of interface.py, in their order, for the present state."""
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
