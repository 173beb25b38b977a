"""Co-activation and delayed stretch reflex of the eight ankle-controlled muscles (equations and sources: README.md)."""

import numpy as np

from .interface import EVERTORS, MUSCLES

N, N_EVERTORS = len(MUSCLES), len(EVERTORS)
CAPACITY = 4096  # communication steps that the delay may span
GROUPS = {kind: [f"{muscle}_{kind}" for muscle in MUSCLES] for kind in ("stretch_velocity", "excitation")}
# a ring of samples: position of the oldest, their number, the size of the last step, their times, their velocities
STATE = {"first": 0, "count": 0, "step": 0.0, "time": np.zeros(CAPACITY), "stretch": np.zeros((CAPACITY, N))}
REASONS = ("", f"the reflex delay spans more than {CAPACITY} communication steps; take larger ones")

EXPERIMENT = {"parameters": {"coactivation": 0.1, "reflex_gain": 2.0, "reflex_delay": 0.02}}


def keep(values, state, slot):
    for m in range(N):
        state.stretch[slot, m] = values.stretch_velocity[m]


def initialise(values, state, time):
    state.first, state.count, state.step = 0, 1, 0.0
    state.time[0] = time
    keep(values, state, 0)
    write(values, state)


def step(values, state, time, step):
    """The inputs are those at `time + step`: the controller takes its step after the plant."""
    if values.reflex_gain != 0.0:
        if state.count == CAPACITY:
            return 1
        slot = (state.first + state.count) % CAPACITY
        state.count += 1
        state.step = step
        state.time[slot] = time + step
        keep(values, state, slot)
    write(values, state)
    return 0


def refresh(values, state):
    if values.reflex_gain != 0.0:
        keep(values, state, (state.first + state.count - 1) % CAPACITY)
    write(values, state)


def lengthening(low, high, duration):
    """Integral of max(0, velocity) over a time in which the velocity goes from `low` to `high` in a straight line."""
    if low >= 0.0 and high >= 0.0:
        return 0.5 * (low + high) * duration
    if low <= 0.0 and high <= 0.0:
        return 0.0
    top = max(low, high)
    return 0.5 * top * top / abs(high - low) * duration


def delayed(state, m, begin, end):
    """Mean of max(0, stretch velocity) of muscle m from `begin` to `end`, straight between samples; 0 before the start
    of the run. The newest sample stands for what is not known yet."""
    newest = (state.first + state.count - 1) % CAPACITY
    total = 0.0
    for k in range(state.count - 1):
        old, new = (state.first + k) % CAPACITY, (state.first + k + 1) % CAPACITY
        if state.time[old] >= end:
            break
        span = state.time[new] - state.time[old]
        slope = (state.stretch[new, m] - state.stretch[old, m]) / span
        left, right = max(begin, state.time[old]), min(end, state.time[new])
        if right > left:
            low = state.stretch[old, m] + slope * (left - state.time[old])
            total += lengthening(low, low + slope * (right - left), right - left)
    after = end - max(begin, state.time[newest])
    if after > 0.0:
        total += max(0.0, state.stretch[newest, m]) * after
    return total / (end - begin)


def write(values, state):
    """Excitations for the mean of the lengthening over the coming step, over which the plant will hold them, one delay
    before it. At the start there is no step yet: they are those of that instant."""
    newest = state.time[(state.first + state.count - 1) % CAPACITY]
    begin = newest - values.reflex_delay
    while state.count > 2 and state.time[(state.first + 1) % CAPACITY] <= begin:
        state.first = (state.first + 1) % CAPACITY
        state.count -= 1
    for m in range(N):
        stretch = 0.0
        if values.reflex_gain != 0.0:
            if state.step > 0.0:
                stretch = delayed(state, m, begin, begin + state.step)
            elif values.reflex_delay == 0.0:
                stretch = max(0.0, state.stretch[state.first, m])
        base = values.coactivation if m < N_EVERTORS else values.coactivation * values.invertor_ratio
        values.excitation[m] = base + values.reflex_gain * stretch
