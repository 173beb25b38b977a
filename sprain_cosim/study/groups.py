"""Person, posture, fall and ground, ankle, control, brace: which group of a study's inputs moves a response."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..records import finite
from ..scenario.body import SEX, is_of_subject
from ..subject.person import BODY_MASS, MUSCLE_FORCE
from ..uq.distributions import Array
from ..uq.groups import group_share
from .summary import VarianceShare

if TYPE_CHECKING:
    import pandas as pd

PERSON = "person"
FEWEST = 20  # completed trials
NOISE = 0.05  # by which shares of independent groups may add up to more than 1
FALL = ("plant.drop_height", "plant.platform_incline", "plant.contact_", "plant.pelvis_vertical_velocity")
ANKLE = ("plant.passive_", "plant.ankle_strength_scale", "plant.evertor_strength_scale")
STARTS = {
    "person": (f"plant.{BODY_MASS}", f"plant.{MUSCLE_FORCE}"),
    "fall and ground": FALL,
    "ankle": ANKLE,
    "control": ("controller.", "plant.body_reflex_scale", "plant.initial_ankle_activation"),
    "brace": ("brace.",),
}


def group_of_input(name: str) -> str:
    """The group of "component.parameter"."""
    if is_of_subject(name) or "_scale_" in name:
        return PERSON
    if name.endswith("_at_contact"):
        return "posture"
    return next((group for group, starts in STARTS.items() if name.startswith(starts)), "other")


def input_groups(
    headings: Sequence[str], done: pd.DataFrame, values: Mapping[str, Array], responses: Sequence[str]
) -> dict[str, dict[str, VarianceShare]] | None:
    """{response: {group: its share of the variance}} over the trials that are `done`, the largest first; None where no
    measures of persons are among the inputs, or too few trials are done to judge every group."""
    members: dict[str, list[str]] = {}
    for heading in headings:
        name = heading.partition(" [")[0]
        if name != SEX:  # it acts through the measures alone
            members.setdefault(group_of_input(name), []).append(heading)
    if len(done) < FEWEST or not any(is_of_subject(heading) for heading in headings):
        return None
    found = {}
    for response in responses:
        shares = {group: group_share(done[names].to_numpy(float), values[response]) for group, names in members.items()}
        if all(np.isfinite(share.value) for share in shares.values()):  # else the rest would not be a rest
            found[response] = {
                group: VarianceShare(finite(share.value), finite(share.low), finite(share.high))
                for group, share in sorted(shares.items(), key=lambda item: -item[1].value)
            }
    return found or None


def groups_listing(response: str, shares: Mapping[str, VarianceShare]) -> list[str]:
    """Lines of a table: which group explains how much of the response's variance."""
    if not shares:
        return []
    lines = ["", f"{response}: share of its variance that each group of inputs explains by itself"]
    for group, share in shares.items():
        ends = "" if share.ci_low is None or share.ci_high is None else _percent_ends(share.ci_low, share.ci_high)
        lines.append(f"  {group:32}{100 * (share.value or 0.0):z8.0f} %{ends:>20}")
    rest = 1.0 - sum(share.value or 0.0 for share in shares.values())
    left = "together, or not smooth" if rest > -NOISE else "twice: groups are correlated"
    return [*lines, f"  {left:32}{100 * (rest if rest > -NOISE else -rest):z8.0f} %"]


def _percent_ends(low: float, high: float) -> str:
    return f"{100 * low:z.0f} ... {100 * high:z.0f}"
