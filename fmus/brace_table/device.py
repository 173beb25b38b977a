"""Cubic pieces between measured points; where loading and unloading differ, the torque passes from one to the other
(README.md). The FMU reads the points from its resources when it is instantiated, so another table needs no compiler."""

import json

import numpy as np

from .interface import AXES

GROUPS = {kind: [f"{axis}_{kind}" for axis in AXES] for kind in ("angle", "torque", "stiffness")}
BRANCHES = ("loading", "unloading")
CAPACITY = 8192  # points of all curves together
CONSTANTS_IN_RESOURCES = True
STATE = {"last": np.zeros(2), "share": np.zeros(2)}  # by axis: angle, and share of the branch of rising angle, -1 ... 1


def constants(resources):
    """`first`, `count` (axis, branch): where the points of a curve stand; `point` (CAPACITY, 3): angle [rad], torque
    [N.m], slope [N.m/rad]. An axis without a curve has count 0."""
    table = json.loads((resources.parent / "table.json").read_text("utf-8"))
    first, count = np.zeros((2, 2), int), np.zeros((2, 2), int)
    point, used = np.zeros((CAPACITY, 3)), 0
    for i, axis in enumerate(AXES):
        for j, branch in enumerate(BRANCHES if axis in table else ()):
            rows = table[axis][branch]
            first[i, j], count[i, j] = used, len(rows)
            point[used : used + len(rows)] = rows
            used += len(rows)
    return {"first": first, "count": count, "point": point}


def evaluate(point, first, count, angle):
    """Torque, slope and curvature: cubic Hermite between the points, straight on with the end slopes outside."""
    last = first + count - 1
    if angle <= point[first, 0] or angle >= point[last, 0]:
        k = first if angle <= point[first, 0] else last
        return point[k, 1] + point[k, 2] * (angle - point[k, 0]), point[k, 2], 0.0
    low, high = first, last + 1
    while low < high:
        middle = (low + high) // 2
        if angle < point[middle, 0]:
            high = middle
        else:
            low = middle + 1
    x0, y0, m0 = point[low - 1, 0], point[low - 1, 1], point[low - 1, 2]
    x1, y1, m1 = point[low, 0], point[low, 1], point[low, 2]
    h = x1 - x0
    t = (angle - x0) / h
    secant = (y1 - y0) / h
    c = 3.0 * secant - 2.0 * m0 - m1
    d = m0 + m1 - 2.0 * secant
    slope = m0 + t * (2.0 * c + 3.0 * t * d)
    return y0 + h * t * (m0 + t * (c + t * d)), slope, (2.0 * c + 6.0 * t * d) / h


def share_after(values, state, i):
    """Share of the branch of rising angle, before it is clipped to -1 ... 1."""
    return state.share[i] + 2.0 * (values.angle[i] - state.last[i]) / values.turn


def initialise(values, state, constants):
    for i in range(2):
        state.last[i] = values.angle[i]
        state.share[i] = 1.0 if values.angle[i] >= 0.0 else -1.0
    refresh(values, state, constants)


def step(values, state, constants):
    refresh(values, state, constants)
    for i in range(2):
        state.share[i] = min(1.0, max(-1.0, share_after(values, state, i)))
        state.last[i] = values.angle[i]


def law(values, state, constants, i):
    """(torque, stiffness, -d(stiffness)/d(angle)) of one axis, for a torque_scale of 1."""
    if constants.count[i, 0] == 0:
        return 0.0, 0.0, 0.0
    angle, moved = values.angle[i], share_after(values, state, i)
    share = min(1.0, max(-1.0, moved))
    loading, slope_loading, bend_loading = evaluate(
        constants.point, constants.first[i, 0], constants.count[i, 0], angle
    )
    unloading, slope_unloading, bend_unloading = evaluate(
        constants.point, constants.first[i, 1], constants.count[i, 1], angle
    )
    # rising angle is loading beyond zero and unloading before it
    up = 0.5 * (1.0 + share) if angle >= 0.0 else 0.5 * (1.0 - share)
    rate = 0.0 if abs(moved) >= 1.0 else (1.0 if angle >= 0.0 else -1.0) / values.turn
    slope = up * slope_loading + (1.0 - up) * slope_unloading + rate * (loading - unloading)
    bend = up * bend_loading + (1.0 - up) * bend_unloading + 2.0 * rate * (slope_loading - slope_unloading)
    return up * loading + (1.0 - up) * unloading, -slope, bend


def refresh(values, state, constants):
    for i in range(2):
        torque, stiffness, _ = law(values, state, constants, i)
        values.torque[i], values.stiffness[i] = values.torque_scale * torque, values.torque_scale * stiffness


def differentiate(values, state, constants, seed, result):
    for i in range(2):
        _, _, bend = law(values, state, constants, i)
        result.torque[i] = -values.stiffness[i] * seed.angle[i]
        result.stiffness[i] = -values.torque_scale * bend * seed.angle[i]
