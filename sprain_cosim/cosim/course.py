"""What the course of a run shows about its devices that nothing showed at its start: a sign, a unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..literature import BRACE_STIFFNESS, BRACE_TORQUE, BRACES_TEXT
from .energy import Exchange, row_changes
from .stability import WRONG_SIGN

PUSHED, PUSHED_LEAST = 0.1, 0.01  # share of the energy exchanged; J
SLIDING, SLIDING_LEAST, BESIDE = 0.02, 0.2, 8  # share of the torque; N.m; steps
FAR, NEAR = math.radians(40.0), math.radians(5.0)  # turned by more, a torque may be called weak; a secant has a sense


def course_doubts(passed: Exchange | None, axes: Sequence[str], pushing_known: bool) -> list[str]:
    """One sentence each about devices whose torques act about `axes`; `pushing_known`: what pushes away has been
    said."""
    if passed is None or len(passed.torque) < 2:
        return []
    found = []
    gifts = {} if pushing_known else pushed(passed)
    if gifts:
        given = ", ".join(f"{energy:.3g} J about {axes[axis]}" for axis, energy in gifts.items())
        found.append(
            f"the device pushed the foot further away from neutral: {given}; if it should resist, {WRONG_SIGN}"
        )
    found += [
        f"the torque about {axes[axis]} changes by {jump:.2g} N.m within a step where the foot turns back, as that of "
        "a device that slides does (friction, hysteresis): its moment at the peak is uncertain by so much"
        for axis, jump in turning_jumps(passed).items()
    ]
    largest, turned = float(np.abs(passed.torque).max()), float(np.abs(passed.angle).max())
    at_peak, highest = _secants(passed)
    weak = 0 < largest < BRACE_TORQUE[0] and highest < BRACE_STIFFNESS[0] and turned > FAR
    if weak or largest > BRACE_TORQUE[1] or at_peak > BRACE_STIFFNESS[1]:
        found.append(
            f"the device gave at most {largest:.3g} N.m while the foot turned by {math.degrees(turned):.0f} deg: "
            f"{BRACES_TEXT}; are its units right, those of its angles too?"
        )
    return found


def turning_jumps(passed: Exchange) -> dict[int, float]:
    """{axis: largest change of its torque [N.m] in the steps beside its peak angle}, where that is more than SLIDING
    of the torque there and more than its changes a little before: a torque that depends on the direction of motion.
    What a sampled device holds jumps anyway, and is left out."""
    out = {}
    for axis in np.flatnonzero(~passed.held).tolist():
        angle, torque = passed.angle[:, axis], passed.torque[:, axis]
        peak = int(np.argmax(angle))
        if BESIDE < peak < len(angle) - BESIDE:
            changes = np.abs(row_changes(torque[peak - BESIDE : peak + BESIDE + 1]))
            jump = changes[BESIDE - 2 : BESIDE + 2].max()
            if jump <= max(SLIDING * abs(float(torque[peak])), SLIDING_LEAST):
                continue
            near = np.sort(changes)
            if jump > 3.0 * (0.5 * (near[BESIDE - 1] + near[BESIDE])):  # their median
                out[axis] = float(jump)
    return out


def _secants(passed: Exchange) -> tuple[float, float]:
    """Torque by angle [N.m/rad] where an angle is largest, at which a damper gives nothing, and the largest of all
    points; angles of less than NEAR do not count."""
    angle, torque = np.abs(passed.angle), np.abs(passed.torque)
    secants = np.where(angle > NEAR, torque / np.maximum(angle, NEAR), 0.0)
    at_peak = secants[angle.argmax(axis=0), np.arange(angle.shape[1])]
    return float(at_peak.max()), float(secants.max())


def pushed(passed: Exchange | None) -> dict[int, float]:
    """{axis: energy [J] that the foot was given on its way away from neutral}, for the axes about which a device gives
    there more than it takes, by PUSHED of all that it exchanges about the axis and of all axes together. What resists
    takes energy on the way out, whatever it stores, and may give it back on the way home only."""
    if passed is None or len(passed.torque) < 2:
        return {}
    moved, middle = row_changes(passed.angle), 0.5 * (passed.angle[1:] + passed.angle[:-1])
    mean = np.where(passed.held, passed.torque[:-1], 0.5 * (passed.torque[1:] + passed.torque[:-1]))
    given = mean * moved
    outward = np.where(middle * moved > 0, given, 0.0).sum(axis=0)
    exchanged = np.abs(given).sum(axis=0)
    enough = np.maximum(np.maximum(PUSHED * exchanged, PUSHED * exchanged.sum()), PUSHED_LEAST)
    return {int(k): float(outward[k]) for k in np.flatnonzero(outward > enough)}
