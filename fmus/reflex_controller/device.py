"""Co-activation and delayed stretch reflex of the eight ankle-controlled muscles (equations and sources: README.md)."""

import numpy as np

from .interface import EVERTORS, MUSCLES

N, N_EVERTORS = len(MUSCLES), len(EVERTORS)
CAPACITY = 4096  # communication steps that the delay may span
GROUPS = {kind: [f"{muscle}_{kind}" for muscle in MUSCLES] for kind in ("stretch_velocity", "excitation")}
# a ring of samples: position of the oldest, their number, the size of the last step, their times, max(0, velocity)
STATE = {"first": 0, "count": 0, "step": 0.0, "time": np.zeros(CAPACITY), "stretch": np.zeros((CAPACITY, N))}
REASONS = ("", f"the reflex delay spans more than {CAPACITY} communication steps; take larger ones")


def keep(values, state, slot):
    for m in range(N):
        state.stretch[slot, m] = max(0.0, values.stretch_velocity[m])


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


def write(values, state):
    """Excitations for the stretch velocity one delay before the middle of the coming step, over which the plant will
    hold them; 0 before the start of the run. The newest sample stands for what is not known yet."""
    newest = state.time[(state.first + state.count - 1) % CAPACITY]
    back = min(newest + 0.5 * state.step - values.reflex_delay, newest)
    while state.count > 2 and state.time[(state.first + 1) % CAPACITY] <= back:
        state.first = (state.first + 1) % CAPACITY
        state.count -= 1
    old, new = state.first, (state.first + 1) % CAPACITY
    weight = (back - state.time[old]) / (state.time[new] - state.time[old]) if state.count > 1 else 0.0
    for m in range(N):
        delayed = 0.0
        if values.reflex_gain != 0.0 and back >= state.time[old]:
            delayed = state.stretch[old, m]
            if state.count > 1:
                delayed += weight * (state.stretch[new, m] - state.stretch[old, m])
        base = values.coactivation if m < N_EVERTORS else values.coactivation * values.invertor_ratio
        values.excitation[m] = base + values.reflex_gain * delayed
