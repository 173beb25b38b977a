"""When who is called: rates, points of exchange, points of the record."""

from __future__ import annotations

import numpy as np
import pytest

from sprain_cosim.cosim.schedule import FINEST, Rate, own_rates, schedule
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.element import Capabilities
from tests.fake import FakeComponent


def part(name: str, fixed: float | None = None, **more: bool) -> FakeComponent:
    return FakeComponent(name, {}, capabilities=Capabilities("2.0", fixed_step=fixed, **more))


PLANT, FREE = part("plant"), part("controller")


@pytest.mark.parametrize("steps", [1, 300, 3001])
def test_without_a_rate_of_its_own_every_component_takes_every_step(steps: int) -> None:
    plan = schedule((PLANT, FREE, part("brace")), 0.0, 5e-4, steps)
    assert plan.regular
    assert not plan.rates
    assert not plan.due
    assert (plan.time == 5e-4 * np.arange(steps + 1)).all()
    assert (plan.record == plan.time).all()
    assert (plan.step == 5e-4).all()


@pytest.mark.parametrize("step", [2e-4, 5e-4, 7.5e-4, 1e-3, 1e-2])
def test_the_record_lies_on_the_smaller_of_the_step_and_half_a_millisecond(step: float) -> None:
    plan = schedule((PLANT, part("brace", 7e-3)), 0.0, step, round(0.15 / step))
    assert np.diff(plan.record) == pytest.approx(min(step, 5e-4))
    assert (plan.record[0], plan.record[-1]) == (0.0, pytest.approx(0.15))
    assert plan.time[plan.row >= 0] == pytest.approx(plan.record[plan.row[plan.row >= 0]])


def test_a_record_that_ends_between_its_points_has_the_stop_too() -> None:
    plan = schedule((PLANT,), 0.0, 7e-4, 11)
    assert plan.record[-2:] == pytest.approx([7.5e-3, 7.7e-3])
    assert plan.row[-1] == len(plan.record) - 1


@pytest.mark.parametrize("period", [1e-2, 3e-3, 5e-4, 7.3e-4, 1e-4, 1e-3 / 3])
def test_a_sampled_device_is_due_at_its_own_times(period: float) -> None:
    """Also where they are no communication points; those stay."""
    plan = schedule((PLANT, FREE, part("brace", period)), 0.0, 5e-4, 300)
    assert plan.rates == {"brace": Rate(period, True)}
    due = np.array(sorted(plan.due))
    assert plan.time[due] == pytest.approx(period * np.arange(1, len(due) + 1), abs=1e-9)
    assert len(due) == int(0.15 / period * (1 + 1e-9))
    assert set(5e-4 * np.arange(301)) <= set(plan.time)
    assert plan.step.sum() == pytest.approx(0.15, rel=1e-12)
    assert plan.step.min() > 1e-9
    assert (plan.time[0], plan.time[-1]) == (0.0, 0.15)


def test_several_rates_at_once() -> None:
    plan = schedule((PLANT, part("controller", 2e-3), part("brace", 5e-3)), 0.0, 1e-3, 20)
    by_time = {round(1e3 * plan.time[k], 9): names for k, names in plan.due.items()}
    assert by_time[10.0] == ("controller", "brace")
    assert by_time[4.0] == ("controller",)
    assert by_time[5.0] == ("brace",)
    assert 3.0 not in by_time


def test_a_continuous_device_takes_its_steps_within_the_communication_step_where_they_fit() -> None:
    assert own_rates((PLANT, part("brace", 1e-4, continuous=True)), 5e-4) == {}
    assert own_rates((PLANT, part("brace", 5e-4, continuous=True)), 5e-4) == {}
    assert own_rates((PLANT, part("brace", 2e-3, continuous=True)), 5e-4) == {"brace": Rate(2e-3, False)}
    assert own_rates((PLANT, part("brace", 3e-4, continuous=True)), 5e-4) == {"brace": Rate(3e-4, False)}
    assert own_rates((PLANT, part("brace", FINEST)), 5e-4) == {}  # too fine to be told from continuous


def test_who_needs_regular_steps_gets_them_where_another_one_stops_in_between() -> None:
    """An FMU whose step may not vary, and one whose own steps fit into the communication step only."""
    rigid, fine = part("controller", variable_step=False), part("brace", 1e-4, continuous=True)
    assert own_rates((PLANT, rigid, fine, part("third", 1e-2)), 5e-4) == {"third": Rate(1e-2, True)}
    assert own_rates((PLANT, rigid, fine, part("third", 3e-4)), 5e-4) == {
        "third": Rate(3e-4, True),
        "brace": Rate(1e-4, False),
        "controller": Rate(5e-4, False),
    }


def test_a_plant_that_cannot_stop_anywhere() -> None:
    """Its record lies on its own steps; a device between two communication points is refused by name."""
    fixed = part("plant", 1e-3)
    for own, record in ((1e-3, 1e-3), (2e-4, 4e-4)):
        plan = schedule((part("plant", own), part("brace", 4e-3)), 0.0, 2e-3, 10)
        assert np.diff(plan.record) == pytest.approx(record)
    rigid = part("plant", variable_step=False)
    assert (schedule((rigid, part("brace", 4e-3)), 0.0, 2e-3, 10).record == 2e-3 * np.arange(11)).all()
    with pytest.raises(InputError, match=r"plant takes only steps of 2 ms, but brace every 3 ms is due between them"):
        schedule((fixed, part("brace", 3e-3)), 0.0, 2e-3, 10)


def test_more_calls_than_can_be_made() -> None:
    for absurd in (1e-20, 1e300, float("nan")):
        with pytest.raises(InputError, match=r"its own step of .* must lie between"):
            Capabilities("2.0", fixed_step=absurd)
    with pytest.raises(InputError, match=r"brace every 0.06 ms: too many calls"):
        schedule((PLANT, part("brace", 6e-5)), 0.0, 1.0, 1000)
