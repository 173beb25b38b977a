"""Wiring: every illegal connection once, automatic connections, units on the wire."""

from __future__ import annotations

import math

import pytest

from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError, problems_to_error
from sprain_cosim.fmu.element import Capabilities
from tests.fake import FakeComponent, connector


def component(name: str, *connectors, **more) -> FakeComponent:
    return FakeComponent(name, {c.name: c for c in connectors}, **more)


def plant(**more) -> FakeComponent:
    axes = ("subtalar", "dorsiflexion", "rotation_x")
    outputs = [connector(f"{a}_angle", "output", "rad") for a in axes]
    inputs = [
        connector(f"brace_{a}_{kind}", "input", u)
        for a in axes
        for kind, u in (("torque", "N.m"), ("stiffness", "N.m/rad"))
    ]
    return component(
        "plant", *outputs, *inputs, connector("height", "parameter", "m"), output=lambda s, i: [0.1, 0.2, 0.3], **more
    )


def device(axis: str, name: str = "brace", angle: str = "rad", torque: str = "N.m", **more) -> FakeComponent:
    return component(
        name, connector(f"{axis}_angle", "input", angle), connector(f"{axis}_torque", "output", torque), **more
    )


ILLEGAL = [
    ("brase.subtalar_angle", "plant.subtalar_angle", "no component 'brase' (did you mean brace?)"),
    ("brace.subtalar_angel", "plant.subtalar_angle", "has no variable 'subtalar_angel' (did you mean subtalar_angle?)"),
    ("brace.subtalar_angle", "plant.subtalar_agle", "has no variable 'subtalar_agle' (did you mean subtalar_angle?)"),
    ("brace.subtalar_torque", "plant.subtalar_angle", "is an output; only an input can be fed"),
    ("brace.subtalar_angle", "plant.brace_subtalar_torque", "is an input; only an output can feed an input"),
    ("brace.subtalar_angle", "plant.height", "is a parameter; only an output can feed an input"),
    ("plant.brace_subtalar_torque", "plant.subtalar_angle", "the units do not match"),
]


@pytest.mark.parametrize(("target", "source", "words"), ILLEGAL)
def test_illegal_connections(target: str, source: str, words: str) -> None:
    system = System((plant(), device("subtalar")), {target: source})
    assert any(words in p and target in p and source in p for p in system.check())


def test_all_problems_are_reported_together() -> None:
    system = System((plant(), device("subtalar")), {t: s for t, s, _ in ILLEGAL})
    problems = system.check()
    assert len(problems) >= len({t for t, _, _ in ILLEGAL})
    with pytest.raises(InputError) as one_line:
        problems_to_error("file.toml", problems)
    assert str(one_line.value).startswith(f"file.toml: {len(problems)} problems: (1) ")
    assert "\n" not in str(one_line.value)


def test_parameters_must_exist_and_be_parameters() -> None:
    system = System((plant(), device("subtalar")), {}, {"plant.heigth": 1.0, "plant.subtalar_angle": 0.0})
    problems = " ".join(system.check())
    assert "did you mean height?" in problems
    assert "is an output, not a parameter" in problems


def test_devices_connect_themselves() -> None:
    renamed = component(
        "brace",
        connector("Subtalar.Angle", "input", "rad"),
        connector("SUBTALAR_TORQUE", "output", "N.m"),
        connector("subtalar_stiffness", "output", "N.m/rad"),
    )
    connections, problems = connect((plant(), renamed), {})
    assert not problems
    assert connections == {
        "brace.Subtalar.Angle": "plant.subtalar_angle",
        "plant.brace_subtalar_torque": "brace.SUBTALAR_TORQUE",
        "plant.brace_subtalar_stiffness": "brace.subtalar_stiffness",
    }


def test_explicit_connections_win() -> None:
    connections, problems = connect((plant(), device("subtalar")), {"brace.subtalar_angle": "plant.dorsiflexion_angle"})
    assert not problems
    assert connections["brace.subtalar_angle"] == "plant.dorsiflexion_angle"
    assert connections["plant.brace_subtalar_torque"] == "brace.subtalar_torque"


def test_two_devices_on_one_input() -> None:
    _, problems = connect((plant(), device("subtalar"), device("subtalar", "second")), {})
    assert problems == [
        "plant.brace_subtalar_torque: fed by brace.subtalar_torque and by second.subtalar_torque; keep one of the two "
        "devices"
    ]


def test_torques_of_two_profiles_are_ambiguous() -> None:
    both = component(
        "brace", connector("dorsiflexion_torque", "output", "N.m"), connector("rotation_x_torque", "output", "N.m")
    )
    _, problems = connect((plant(), both), {})
    assert len(problems) == 1
    assert "several profiles (jcs, bushing)" in problems[0]


def test_a_device_that_matches_nothing_is_named() -> None:
    stranger = component("brace", connector("height", "output", "m"))
    parts = (plant(), stranger)
    system = System(parts, connect(parts, {})[0])
    assert any(p.startswith("brace: connects to nothing") for p in system.check())


@pytest.mark.parametrize(
    ("own", "asked", "fits"),
    [(1e-3, 1e-3, True), (1e-3, 2e-3, True), (1e-3, 5e-4, False), (1e-3, 2.5e-3, False), (1e-4, 5e-4, True)],
)
def test_a_plant_with_a_fixed_step_takes_whole_multiples(own: float, asked: float, fits: bool) -> None:
    """A device with one is called at its own rate (test_schedule.py)."""
    able = Capabilities("2.0", fixed_step=own)
    parts = (plant(capabilities=able), device("subtalar"))
    problems = System(parts, connect(parts, {})[0]).check(asked)
    assert (not problems) == fits
    assert fits or ("plant" in problems[0] and f"{1e3 * own:g} ms" in problems[0])
    parts = (plant(), device("subtalar", capabilities=able))
    assert not System(parts, connect(parts, {})[0]).check(asked)


def test_units_are_converted_on_the_wire() -> None:
    spring = device("subtalar", angle="deg", torque="N.mm", output=lambda s, i: [-10.0 * i["subtalar_angle"]])
    parts = (plant(), spring)
    system = System(parts, connect(parts, {})[0])
    assert not system.check()
    result = Master(stop=1e-3).run(system.open(), {})
    degrees = math.degrees(0.1)
    assert result["brace.subtalar_angle"] == pytest.approx([degrees] * 3)
    assert result["plant.brace_subtalar_torque"] == pytest.approx([-0.01 * degrees] * 3)
