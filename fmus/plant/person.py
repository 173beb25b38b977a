"""Persons of another size: the base person's constants, scaled in place when a landing is initialised. The rules, and
what they were compared with: README.md. Like the kernels nothing here allocates."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from . import kernels
from .interface import BASE_MASS, PERSON, SEGMENTS, table

f8, i8 = np.float64, np.int64
N_BODIES, N_PERSON = len(table("bodies")), len(PERSON)
# in the parameters of a person, (26,): from FACTORS on x, y, z of each of SEGMENTS, from LAW on the passive ankle's
MASS, FORCE, FACTORS, LAW = 0, 1, 2, 2 + 3 * len(SEGMENTS)
THIGH, FOOT = SEGMENTS.index("thigh"), SEGMENTS.index("foot")


def sole_record(n_blocks: int) -> np.dtype:
    """Facets and blocks as the kernels take them, and the mean squares of the components of each facet's normals."""
    return kernels.in_whole_vectors(
        [
            ("facets", f8, (n_blocks, 4, kernels.BLOCK)),
            ("blocks", f8, (6, n_blocks)),
            ("normals", f8, (n_blocks, 3, kernels.BLOCK)),
        ]
    )


SOLE = sole_record(math.ceil(len(table("sole")) / kernels.BLOCK / kernels.LANES) * kernels.LANES)
BASE = kernels.in_whole_vectors(
    [
        ("model", kernels.MODEL), ("sole", SOLE),
        # the bodies of the table, parents first; `segment`: of SEGMENTS; `carrier`: the moving body that it is part of,
        # `moves`: it is that body itself; `slide`: of a locked joint's translations; `turn`: in the carrier's frame
        ("segment", i8, (N_BODIES,)), ("parent", i8, (N_BODIES,)),
        ("carrier", i8, (N_BODIES,)), ("moves", i8, (N_BODIES,)),
        ("mass", f8, (N_BODIES,)), ("com", f8, (N_BODIES, 3)), ("inertia", f8, (N_BODIES, 3, 3)),
        ("at_parent", f8, (N_BODIES, 3)), ("at_child", f8, (N_BODIES, 3)),
        ("slide", f8, (N_BODIES, 3)), ("turn", f8, (N_BODIES, 3, 3)),
        ("point_body", i8, (kernels.NP,)), ("point", f8, (kernels.NP, 3)),
        ("spline_axis", i8, (5,)), ("measured", f8, (kernels.NQ,)),
    ]
)  # fmt: skip
# of an instance: the person, has it constants of its own for that, and work space
SCALED = np.dtype(
    [
        ("own", i8), ("person", f8, (N_PERSON,)),
        ("factor", f8, (N_BODIES, 3)), ("above", f8, (N_BODIES, 3)), ("place", f8, (N_BODIES, 3)),
        ("vector", f8, (3,)), ("inertia", f8, (3, 3)), ("half", f8, (3, 3)),
        ("sum", f8, (kernels.NB, 10)), ("length", f8, (2, kernels.NM)),
    ],
    align=True,
)  # fmt: skip

entry = njit(error_model="numpy", cache=True)  # calls nothing of another file, see kernels.py


@entry
def has_base_lengths(person):
    same = True
    for k in range(FACTORS, LAW):
        same = same and person[k] == 1.0
    return same


@entry
def has_base_ankle(base, person):
    same = True
    for k in range(9):
        same = same and person[LAW + k] == base.ankle_bushing[k // 3, k % 3]
    return same


@entry
def is_known(scaled, person):
    """Do the constants belong to this person? From here on they do."""
    known = True
    for k in range(N_PERSON):
        if scaled.person[k] != person[k]:
            known = False
            scaled.person[k] = person[k]
    return known


@entry
def copy(source, target):
    for k in range(target.size):
        target.flat[k] = source.flat[k]


@entry
def restore(base, sole, model, facets, blocks, person):
    """The base person's constants, every field of kernels.MODEL, with the person's own muscle forces and passive
    ankle."""
    model.scaled, model.gravity, model.published_height = 0, base.gravity, base.published_height
    model.tibialis_anterior = base.tibialis_anterior
    copy(base.body_mass, model.body_mass)
    copy(base.body_com, model.body_com)
    copy(base.body_inertia, model.body_inertia)
    copy(base.anchor_in_parent, model.anchor_in_parent)
    copy(base.anchor, model.anchor)
    copy(base.talocrural_axis, model.talocrural_axis)
    copy(base.subtalar_axis, model.subtalar_axis)
    copy(base.spline_size, model.spline_size)
    copy(base.spline_scale, model.spline_scale)
    copy(base.spline_knot, model.spline_knot)
    copy(base.spline_coefficient, model.spline_coefficient)
    copy(base.max_force, model.max_force)
    copy(base.l_opt, model.l_opt)
    copy(base.l_slack, model.l_slack)
    copy(base.height, model.height)
    copy(base.l_min, model.l_min)
    copy(base.length_gain, model.length_gain)
    copy(base.velocity_gain, model.velocity_gain)
    copy(base.rest_length, model.rest_length)
    copy(base.ankle_muscle, model.ankle_muscle)
    copy(base.point_muscle, model.point_muscle)
    copy(base.point_body, model.point_body)
    copy(base.point, model.point)
    copy(base.point_coordinate, model.point_coordinate)
    copy(base.conditional, model.conditional)
    copy(base.point_low, model.point_low)
    copy(base.point_high, model.point_high)
    copy(base.brace_bushing, model.brace_bushing)
    copy(base.lumbar_bushing, model.lumbar_bushing)
    copy(base.limit, model.limit)
    copy(base.pivot, model.pivot)
    copy(base.jcs_zero, model.jcs_zero)
    for k in range(len(facets)):
        for i in range(4):
            for j in range(kernels.BLOCK):
                facets[k, i, j] = sole.facets[k, i, j]
        for i in range(6):
            blocks[i, k] = sole.blocks[i, k]
    for k in range(9):
        model.ankle_bushing[k // 3, k % 3] = person[LAW + k]
    for k in range(kernels.NM):
        model.max_force[k] *= person[FORCE]


@entry
def turned(matrix, vector, out):
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@entry
def place_bodies(base, scaled):
    """The factors of every body and of its parent, and where its frame lies in its carrier's."""
    person, factor, above, place, there = scaled.person, scaled.factor, scaled.above, scaled.place, scaled.vector
    for k in range(N_BODIES):
        first, parent = FACTORS + 3 * base.segment[k], base.parent[k]
        for c in range(3):
            factor[k, c] = person[first + c]
            above[k, c] = person[FACTORS + 3 * base.segment[parent] + c] if parent >= 0 else 1.0
            place[k, c] = 0.0
        if base.moves[k]:
            continue
        joint = scaled.inertia[0]
        for c in range(3):
            joint[c] = (base.at_parent[k, c] + base.slide[k, c]) * above[k, c]
        turned(base.turn[parent], joint, there)
        for c in range(3):
            place[k, c] = place[parent, c] + there[c]
            joint[c] = base.at_child[k, c] * factor[k, c]
        turned(base.turn[k], joint, there)
        for c in range(3):
            place[k, c] -= there[c]


@entry
def scale_inertia(base, scaled, k):
    """Of a body of the table about its centre of mass, in its own frame: the second moments of the mass follow the
    lengths."""
    f, out, own = scaled.factor[k], scaled.inertia, base.inertia[k]
    half = 0.5 * (own[0, 0] + own[1, 1] + own[2, 2])
    total = 0.0
    for i in range(3):
        total += (half - own[i, i]) * f[i] * f[i]
    for i in range(3):
        for j in range(3):
            out[i, j] = own[i, j] * f[i] * f[j]
        out[i, i] = total - (half - own[i, i]) * f[i] * f[i]


@entry
def scale_bodies(base, model, scaled):
    """Masses, mass centres, inertias and joint centres of the moving bodies, locked bodies fused into them."""
    ratio, sums, com = scaled.person[MASS] / BASE_MASS, scaled.sum, scaled.vector
    for body in range(kernels.NB):
        for n in range(10):
            sums[body, n] = 0.0
    for k in range(N_BODIES):
        mass, turn, inertia, half = ratio * base.mass[k], base.turn[k], scaled.inertia, scaled.half
        into = sums[base.carrier[k]]
        own = scaled.half[0]
        for c in range(3):
            own[c] = base.com[k, c] * scaled.factor[k, c]
        turned(turn, own, com)
        square = 0.0
        for c in range(3):
            com[c] += scaled.place[k, c]
            square += com[c] * com[c]
        scale_inertia(base, scaled, k)
        for i in range(3):
            for j in range(3):
                half[i, j] = turn[i, 0] * inertia[0, j] + turn[i, 1] * inertia[1, j] + turn[i, 2] * inertia[2, j]
        n = 4
        into[0] += mass
        for i in range(3):
            into[1 + i] += mass * com[i]
            for j in range(i, 3):
                value = half[i, 0] * turn[j, 0] + half[i, 1] * turn[j, 1] + half[i, 2] * turn[j, 2]
                into[n] += ratio * value + mass * ((square if i == j else 0.0) - com[i] * com[j])
                n += 1
        if base.moves[k]:
            body = base.carrier[k]
            for c in range(3):
                model.anchor[body, c] = base.at_child[k, c] * scaled.factor[k, c]
                model.anchor_in_parent[body, c] = base.at_parent[k, c] * scaled.above[k, c]
    model.scaled = 1
    for body in range(1, kernels.NB):
        of = sums[body]
        square = 0.0
        for c in range(3):
            com[c] = of[1 + c] / of[0]
            square += com[c] * com[c]
        model.body_mass[body] = of[0]
        n = 4
        for i in range(3):
            model.body_com[body, i] = com[i]
            for j in range(i, 3):
                value = of[n] - of[0] * ((square if i == j else 0.0) - com[i] * com[j])
                model.body_inertia[body, 3 * i + j] = model.body_inertia[body, 3 * j + i] = value
                n += 1


@entry
def scale_paths(base, model, scaled):
    """Points of the muscles' paths; the knee's and the patella's translations over the knee angle, which belong to the
    femur."""
    there, point = scaled.vector, scaled.half[0]
    for p in range(kernels.NP):
        k = base.point_body[p]
        for c in range(3):
            point[c] = base.point[p, c] * scaled.factor[k, c]
        turned(base.turn[k], point, there)
        for c in range(3):
            model.point[p, c] = scaled.place[k, c] + there[c]
    for j in range(len(base.spline_axis)):
        if base.spline_axis[j] >= 0:
            model.spline_scale[j] *= scaled.person[FACTORS + 3 * THIGH + base.spline_axis[j]]


@entry
def scale_fibres(model, scaled):
    """Fibres and tendons by the muscles' lengths after over before."""
    for k in range(kernels.NM):
        ratio = scaled.length[1, k] / scaled.length[0, k]
        model.l_opt[k] *= ratio
        model.l_slack[k] *= ratio
        model.height[k] *= ratio
        model.l_min[k] *= ratio


@entry
def scale_sole(sole, facets, blocks, scaled):
    """Facets with the foot; their areas by the cofactors of the factors on the normals."""
    first = FACTORS + 3 * FOOT
    x, y, z = scaled.person[first], scaled.person[first + 1], scaled.person[first + 2]
    if x == 1.0 and y == 1.0 and z == 1.0:
        return
    for k in range(len(facets)):
        for j in range(kernels.BLOCK):
            facets[k, 0, j] *= x
            facets[k, 1, j] *= y
            facets[k, 2, j] *= z
            n = sole.normals[k, :, j]
            facets[k, 3, j] *= math.sqrt((y * z) ** 2 * n[0] + (x * z) ** 2 * n[1] + (x * y) ** 2 * n[2])
        for c in range(2):
            blocks[3 * c, k] *= x
            blocks[3 * c + 1, k] *= y
            blocks[3 * c + 2, k] *= z


@njit(error_model="numpy")
def embody(base, sole, model, state, scaled, facets, blocks, person):
    """Makes `model`, `facets` and `blocks` of an instance those of `person` (26,), in the order of interface.PERSON,
    unless that is done or the base person's own serve (`scaled.own` 0)."""
    if is_known(scaled, person):
        return
    state.known = state.valid = scaled.own = 0
    same_body = person[MASS] == BASE_MASS and has_base_lengths(person)
    if same_body and person[FORCE] == 1.0 and has_base_ankle(base.model, person):
        return
    scaled.own = 1
    restore(base.model, sole, model, facets, blocks, person)
    if same_body:
        return
    kernels.muscle_lengths(model, state, facets, blocks, base.measured, scaled.length[0])
    place_bodies(base, scaled)
    scale_bodies(base, model, scaled)
    scale_paths(base, model, scaled)
    scale_sole(sole, facets, blocks, scaled)
    if not has_base_lengths(person):
        kernels.muscle_lengths(model, state, facets, blocks, base.measured, scaled.length[1])
        scale_fibres(model, scaled)
