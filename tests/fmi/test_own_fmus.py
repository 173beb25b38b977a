"""The project's own FMUs seen from outside: description, reproducible build, reset, rollback, other masters."""

from __future__ import annotations

import ast
import hashlib
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.coupling import begin
from sprain_cosim.errors import InputError, SimulationError
from sprain_cosim.fmu import archive, foreign
from sprain_cosim.fmu.build import build_fmu
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import FMI3, FMUS, shipped_fmus
from sprain_cosim.shipped import SOURCES as MODELS
from tests import python_fmu
from tests.fake import brace_variables, make_fmu
from tests.native import SOURCES

NAMES = ("plant", "reflex_controller", "brace_bushing")
EVERTOR, INVERTOR = "ext_dig", "tib_post"


def test_every_brace_describes_itself_by_the_same_three_tables() -> None:
    """Plain data: no function of its own."""
    for path in MODELS.glob("brace_*/interface.py"):
        body = ast.parse(path.read_text("utf-8")).body
        assert not [n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef)], path
        named = {t.id for n in body if isinstance(n, ast.Assign) for t in n.targets if isinstance(t, ast.Name)}
        assert {"MODEL", "DESCRIPTION", "PARAMETERS", "INPUTS", "OUTPUTS"} <= named, path


def component(name: str) -> Component:
    return Component.read(name, FMUS / f"{name}.fmu")


class Bench(Driver):
    """One instance with all inputs and outputs, started with these parameters."""

    def __init__(self, chosen: Component, **parameters: float) -> None:
        super().__init__(chosen)
        self.start(parameters, stop=1.0)

    def move(self, time: float, step: float, **inputs: float) -> np.ndarray:
        self.step(step, inputs, time)
        return np.concatenate([self.input_values, self.output_values])


def start_unchecked(chosen: Component, parameters: dict[str, float]) -> None:
    """The FMU itself is to say what it does not take."""
    with Bench(chosen) as bench:
        bench.instance.reset()
        bench.instance.set_parameters(parameters)
        bench.instance.enter_initialization(0.0, 1.0)
        bench.instance.get_outputs()
        bench.instance.exit_initialization()


@pytest.mark.parametrize("name", NAMES)
def test_fmpy_finds_nothing_to_complain_about(name: str) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(FMUS / f"{name}.fmu") == []


@pytest.mark.parametrize("name", NAMES)
def test_fmpy_simulates_it_alone(name: str) -> None:
    outcome = subprocess.run(
        [sys.executable, "-m", "fmpy", "simulate", str(FMUS / f"{name}.fmu")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert outcome.returncode == 0, outcome.stderr


@pytest.mark.parametrize("name", NAMES)
def test_rebuilding_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as archive:
        platforms = {member.split("/")[1] for member in archive.namelist() if member.startswith("binaries/")}
    build_fmu(MODELS / name, tmp_path / "again.fmu", sorted(platforms))
    assert (tmp_path / "again.fmu").read_bytes() == (FMUS / f"{name}.fmu").read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_everything_has_unit_start_and_a_name_of_its_own(name: str) -> None:
    described = component(name)
    assert described.quirks == ()
    assert described.capabilities.state
    for c in described.connectors.values():
        assert c.unit is not None or c.items, c.name
        assert c.description, c.name
        assert c.causality in ("output", "local") or c.start is not None, c.name


def test_contract_signals_of_the_plant() -> None:
    plant = component("plant")
    axes = (
        "talocrural",
        "subtalar",
        "dorsiflexion",
        "inversion",
        "internal_rotation",
        "rotation_x",
        "rotation_y",
        "rotation_z",
    )
    for axis in axes:
        assert {
            f"{axis}_angle",
            f"{axis}_velocity",
            f"{axis}_effective_inertia",
            f"anatomy_{axis}_moment",
            f"brace_{axis}_moment",
        } <= set(plant.outputs)
        assert {f"brace_{axis}_torque", f"brace_{axis}_stiffness", f"brace_{axis}_damping"} <= set(plant.inputs)
    assert {"brace_inversion_dorsiflexion_stiffness", "brace_rotation_x_rotation_y_damping"} <= set(plant.inputs)
    assert {"ground_force_x", "ground_force", "in_contact", "evertor_activation", "jcs_inversion_raw_angle"} <= set(
        plant.outputs
    )


@pytest.mark.parametrize("model", ["plant", "plant_mujoco"])
def test_a_landing_given_the_state_at_contact_of_another_is_that_landing(model: str) -> None:
    described = component(model)
    named = {"ankle_angle_r": "talocrural_angle", "subtalar_angle_r": "subtalar_angle"}
    rates = {"ankle_angle_r": "talocrural_velocity", "subtalar_angle_r": "subtalar_velocity"}
    local = [n for n, c in described.connectors.items() if c.causality == "local"]
    coordinates = [n.removesuffix("_speed") for n in local if n.endswith("_speed")]
    scenario = load_scenario("incline30_mixed").replace_fmu("plant", model).recording("plant.*")
    other = {
        "plant.talocrural_angle_at_contact": -0.3,
        "plant.knee_angle_r_at_contact": -0.5,
        "plant.hip_rotation_r_speed_at_contact": 1.0,
        "plant.pelvis_list_at_contact": 0.2,
    }
    with scenario.open() as session:
        first = session.run(other)
        state = {"plant.initial_pose": 2.0}
        for c in coordinates:
            speed = "pelvis_vertical_velocity" if c == "pelvis_ty" else f"{rates.get(c, f'{c}_speed')}_at_contact"
            state[f"plant.{named.get(c, c)}_at_contact"] = first[f"plant.{c}"][0]
            state[f"plant.{speed}"] = first[f"plant.{c}_speed"][0]
        assert len(state) == 31
        assert abs(first["plant.pelvis_ty"][0] - described.connectors["pelvis_ty_at_contact"].start) > 1e-3
        again = session.run(state)
        usual = session.run()
    scale = np.abs(first.values).max(axis=0)
    assert (np.abs(again.values - first.values) <= 1e-9 * scale).all()
    assert np.abs(usual.values - first.values).max() > 0.1


TALL = {"body_mass": 80.0, "thigh_scale_y": 1.1, "foot_scale_x": 1.08, "torso_scale_z": 0.95, "muscle_force_scale": 1.2}
SMALL = {"body_mass": 50.0, "pelvis_scale_x": 0.9, "shank_scale_y": 0.85, "foot_scale_x": 0.83, "foot_scale_y": 0.9}


def test_a_saved_state_brings_its_person_along() -> None:
    """Into an instance that is another person, in the same process and as bytes."""
    chosen = component("plant")
    with Bench(chosen, **TALL) as tall, Bench(chosen, **SMALL) as small, Bench(chosen) as base:
        tall.move(0.0, 0.01)
        state = tall.save_state()
        expected = tall.move(0.01, 0.01)
        for other in (small, base):
            other.move(0.0, 0.005)
            other.restore_state(state)
            assert np.array_equal(other.move(0.01, 0.01), expected)
        own = base.save_state()
        small.restore_state(own)
        again = small.move(0.02, 0.01)
        assert np.array_equal(base.move(0.02, 0.01), again)
        for bench in (tall, small):
            bench.start({}, stop=1.0)
        base.start({}, stop=1.0)
        landed = [bench.move(0.0, 0.02) for bench in (tall, small, base)]
        assert np.array_equal(landed[0], landed[1]) and np.array_equal(landed[0], landed[2])
        for each in (state, own):
            tall.free_state(each)


@pytest.mark.parametrize("person", [TALL, SMALL, {"passive_z_quadratic": 30.0, "body_mass": 67.0}])
def test_persons_are_the_same_with_the_dynamics_of_mujoco(person: dict[str, float]) -> None:
    """1e-9 of each signal's largest value; the two people take turns in one process."""
    signals = []
    plant, reference = component("plant"), component("plant_mujoco")
    with Bench(plant, **person) as ours, Bench(reference, **person) as theirs, Bench(reference, **SMALL) as other:
        for k in range(6):
            other.move(0.01 * k, 0.01)
            signals.append([bench.move(0.01 * k, 0.01) for bench in (ours, theirs)])
    first, second = np.array(signals).transpose(1, 0, 2)
    assert (np.abs(first - second).max(axis=0) <= 1e-9 * np.maximum(np.abs(first).max(axis=0), 1e-3)).all()


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"foot_scale_x": 0.2}, "foot_scale_x = 0.2: must lie between 0.5 and 2"),
        ({"body_mass": 5.0}, "body_mass = 5 kg: must lie between 20 and 250"),
        (
            {"initial_pose": 1.0, "thigh_scale_y": 1.1},
            "with length factors other than 1 choose initial_pose = touching",
        ),
    ],
)
def test_a_person_that_cannot_land_is_refused(parameters: dict[str, float], text: str) -> None:
    for name in ("plant", "plant_mujoco"):
        with pytest.raises(SimulationError, match=re.escape(text)):
            start_unchecked(component(name), parameters)


def test_a_heavier_person_may_take_the_published_pose() -> None:
    with Bench(component("plant"), body_mass=90.0, initial_pose=1.0) as bench:
        assert bench["ground_force_y"] > 1e4


def test_an_edge_away_from_the_foot_changes_nothing() -> None:
    with Bench(component("plant")) as whole, Bench(component("plant"), platform_edge_distance=0.5) as far:
        assert np.array_equal(whole.move(0.0, 0.02), far.move(0.0, 0.02))


def test_an_edge_that_leaves_no_foothold_is_refused() -> None:
    with pytest.raises(SimulationError, match="no part of the sole is on this side of the platform's edge"):
        Bench(component("plant"), platform_edge_distance=-0.5)


def test_reset_equals_a_fresh_instance() -> None:
    for name in ("incline30_mixed", "incline30"):
        scenario = load_scenario(name)
        with scenario.open() as session:
            first = session.run()
            session.run({"plant.drop_height": 0.4, "plant.subtalar_angle_at_contact": 0.1})
            again = session.run()
        with scenario.open() as fresh:
            other = fresh.run()
        assert (first.values == again.values).all()
        assert (first.values == other.values).all()


def test_two_scenarios_in_one_process_do_not_disturb_each_other() -> None:
    a, b = load_scenario("incline30_brace"), load_scenario("incline30_reflex")
    alone = a.run().values, b.run().values
    with a.open() as one, b.open() as two:
        together = one.run().values, two.run().values
        later = one.run().values, two.run().values
    for k in range(2):
        assert (alone[k] == together[k]).all()
        assert (alone[k] == later[k]).all()


def test_plant_rolls_back_to_the_bit() -> None:
    bench = Bench(component("plant"), contact_modulus=4.5e7)
    for k in range(100):
        bench.move(k * 5e-4, 5e-4, brace_subtalar_torque=-0.1 * k)
    state = bench.save_state()
    first = [
        bench.move(0.05 + k * 5e-4, 5e-4, brace_subtalar_torque=-20.0, brace_subtalar_stiffness=50.0) for k in range(20)
    ]
    bench.restore_state(state)
    second = [
        bench.move(0.05 + k * 5e-4, 5e-4, brace_subtalar_torque=-20.0, brace_subtalar_stiffness=50.0) for k in range(20)
    ]
    assert (np.array(first) == np.array(second)).all()


def test_controller_rolls_back_with_its_delay_line() -> None:
    bench = Bench(component("reflex_controller"), reflex_gain=3.0, reflex_delay=0.0043)
    signal = np.random.default_rng(5).normal(size=60)
    for k in range(30):
        bench.move(k * 5e-4, 5e-4, **{f"{EVERTOR}_stretch_velocity": signal[k]})
    state = bench.save_state()
    first = [bench.move(k * 5e-4, 5e-4, **{f"{EVERTOR}_stretch_velocity": signal[k]}) for k in range(30, 60)]
    bench.restore_state(state)
    second = [bench.move(k * 5e-4, 5e-4, **{f"{EVERTOR}_stretch_velocity": signal[k]}) for k in range(30, 60)]
    assert (np.array(first) == np.array(second)).all()


@pytest.mark.parametrize("name", shipped_fmus())
def test_every_own_fmu_rolls_back_to_the_bit(name: str) -> None:
    """From a state in mid-run, twice, with other steps in between; delay line, lags and triggers included."""
    parameters = {"reflex_controller": {"reflex_gain": 3.0, "reflex_delay": 0.0043, "coactivation": 0.1}}.get(name, {})
    bench = Bench(component(name), **parameters)
    size = {"angle": 0.3, "velocity": 3.0, "torque": 5.0, "stiffness": 20.0, "damping": 0.2, "excitation": 0.3}
    rng = np.random.default_rng(8)
    signals = {n: size.get(n.rpartition("_")[2], 1.0) * rng.normal(size=60) for n in bench.element.inputs if "_" in n}
    steps = [(k * 5e-4, 5e-4, {n: float(v[k]) for n, v in signals.items()}) for k in range(60)]
    for time, step, inputs in steps[:30]:
        bench.move(time, step, **inputs)
    state = bench.save_state()
    runs = []
    for _ in range(3):
        runs.append([bench.move(time, step, **inputs) for time, step, inputs in steps[30:]])
        bench.restore_state(state)
        bench.move(steps[30][0], 1.3e-3, **steps[45][2])  # elsewhere
        bench.restore_state(state)
    bench.free_state(state)
    assert np.isfinite(runs[0]).all()
    assert (np.array(runs[0]) == np.array(runs[1])).all()
    assert (np.array(runs[0]) == np.array(runs[2])).all()


@pytest.mark.parametrize("scheme", ["gauss-seidel", "impedance"])
def test_a_run_whose_every_step_is_taken_twice_is_the_same_to_the_bit(scheme: str) -> None:
    """Plant, controller with reflex and brace together, through the contact."""
    system = load_scenario("incline30_mixed").override("controller.reflex_gain", 2.0).with_master(stop="80 ms").system()
    assembly = system.open()
    records = []
    for twice in (False, True):
        assembly.start(system.parameters, 0.0, 0.08)
        chosen = begin(scheme, assembly, 5e-4, 160).scheme
        record = [assembly.record.copy()]
        for k in range(160):
            if twice:
                states, bus = [(m, m.instance.save_state()) for m in assembly.members], assembly.bus.copy()
                chosen.step(assembly, k * 5e-4, 1e-3 if k % 3 else 2.5e-4)
                for member, state in states:
                    member.instance.restore_state(state)
                    member.instance.free_state(state)
                    member.inputs_set = False
                assembly.bus[:] = bus
            chosen.step(assembly, k * 5e-4, 5e-4)
            record.append(assembly.record.copy())
        records.append(np.array(record))
    assembly.close()
    assert (records[0] == records[1]).all()


@pytest.mark.parametrize("h", [1e-4, 5e-4, 7e-4, 1e-3])
@pytest.mark.parametrize("delay", [0.0101, 0.06])
def test_reflex_is_the_stretch_one_delay_ago(h: float, delay: float) -> None:
    """excitation = c + gain * the mean of max(0, stretch velocity) over the coming step, one delay before; exact for a
    signal linear in time, the start of the run included."""
    gain, ratio, c = 2.0, 0.9322, 0.1
    bench = Bench(component("reflex_controller"), coactivation=c, reflex_gain=gain, reflex_delay=delay)
    assert bench[f"{EVERTOR}_excitation"] == pytest.approx(c)
    assert bench[f"{INVERTOR}_excitation"] == pytest.approx(ratio * c)
    for k in range(200):
        t = (k + 1) * h
        bench.move(k * h, h, **{f"{EVERTOR}_stretch_velocity": 3.0 * t, f"{INVERTOR}_stretch_velocity": -t})
        begin, end = max(0.0, t - delay), max(0.0, t + h - delay)
        mean = 3.0 * (end**2 - begin**2) / (2.0 * h)
        assert bench[f"{EVERTOR}_excitation"] == pytest.approx(c + gain * mean, abs=1e-12)
        assert bench[f"{INVERTOR}_excitation"] == pytest.approx(ratio * c, abs=1e-12)


def test_a_stretch_that_ends_within_a_step_counts_for_its_part() -> None:
    """From 2 to -1 over a step: the muscle lengthens for two thirds of it, at 1 on average."""
    h, delay = 5e-4, 0.010
    bench = Bench(component("reflex_controller"), reflex_gain=2.0, reflex_delay=delay)
    signal = [0.0] * 10 + [2.0, -1.0] + [-1.0] * 40
    found = []
    for k, value in enumerate(signal):
        bench.move(k * h, h, **{f"{EVERTOR}_stretch_velocity": value})
        found.append(bench[f"{EVERTOR}_excitation"])
    answer = 2.0 * np.array([0.5 * 2.0, 2.0 / 3.0 * 0.5 * 2.0])  # rising from 0 to 2 over one step, then falling
    lag = 20  # the delay in steps; after it follow the two steps that lead to the samples 10 and 11
    assert found[9 + lag : 11 + lag] == pytest.approx(answer, abs=1e-12)
    assert found[8 + lag] == found[11 + lag] == 0.0


def test_bushing_brace_torque_stiffness_and_energy() -> None:
    """Torque and stiffness are the first and second derivatives of the stored energy (central differences)."""
    bench = Bench(component("brace_bushing"), angle_scale=1.7, torque_scale=0.8)
    rng = np.random.default_rng(2)

    def at(angles: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        bench.move(0.0, 1e-3, **{f"rotation_{a}_angle": v for a, v in zip("xyz", angles, strict=True)})
        return (
            bench["stored_energy"],
            np.array([bench[f"rotation_{a}_torque"] for a in "xyz"]),
            np.array([bench[f"rotation_{a}_stiffness"] for a in "xyz"]),
        )

    for angles in rng.uniform(-0.6, 0.6, (20, 3)):
        _, torque, stiffness = at(angles)
        for i in range(3):
            d = 1e-5 * np.eye(3)[i]
            up, down = at(angles + d), at(angles - d)
            assert torque[i] == pytest.approx(-(up[0] - down[0]) / 2e-5, rel=1e-6, abs=1e-6)
            assert stiffness[i] == pytest.approx(-(up[1][i] - down[1][i]) / 2e-5, rel=1e-6, abs=1e-6)


def test_a_parameter_cannot_change_during_a_run() -> None:
    bench = Bench(component("plant"))
    bench.move(0.0, 5e-4)
    with pytest.raises(
        SimulationError, match=r"plant: .* setting drop_height = 0.4: .*can only be set before initialisation"
    ):
        bench.instance.set_parameters({"drop_height": 0.4})


def test_the_plant_states_the_range_it_refuses() -> None:
    with pytest.raises(SimulationError, match=r"drop_height = -1 m: must lie between 0 and 5"):
        start_unchecked(component("plant"), {"drop_height": -1.0})
    with pytest.raises(InputError, match=r"plant.drop_height = -1 m: outside its range 0 ... 5 m"):
        Bench(component("plant"), drop_height=-1.0)


def test_a_hundred_instances_live_and_die() -> None:
    brace = component("brace_bushing")
    for _ in range(100):
        bench = Bench(brace, angle_scale=2.0)
        bench.move(0.0, 1e-3, rotation_x_angle=0.1)
        torque = bench["rotation_x_torque"]
        bench.close()
    assert torque == pytest.approx(-0.2 * (9.52095038 + 0.2 * (-29.57608094 + 0.2 * 169.01588105)))


def test_python_fmus_with_the_same_module_names_do_not_mix(tmp_path: Path) -> None:
    law = """
        def refresh(self):
            self["subtalar_torque"] = {} * self["subtalar_angle"]

        def initialise(self):
            self.refresh()

        def step(self, time, step):
            self.refresh()
    """
    fmus = [make_fmu(tmp_path / str(k), "spring", brace_variables(), law.format(k)) for k in (-1.0, -2.0)]
    benches = [Bench(Component.read("brace", fmu)) for fmu in fmus]
    for bench in benches:
        bench.move(0.0, 1e-3, subtalar_angle=0.5)
    assert [bench["subtalar_torque"] for bench in benches] == [-0.5, -1.0]


SPRING = """
    def refresh(self):
        self["subtalar_torque"] = -self["k"] * self["subtalar_angle"]

    def initialise(self):
        self.refresh()

    def step(self, time, step):
        self.refresh()
"""


@pytest.fixture
def both_binaries(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[Path, Path]:
    """A Python FMU with the binary of its own, and with PythonFMU's, as on a machine without a C compiler."""
    own = make_fmu(tmp_path / "own", "spring", brace_variables(), SPRING)
    monkeypatch.setattr(python_fmu, "_compiled", lambda: None)
    return own, make_fmu(tmp_path / "other", "spring", brace_variables(), SPRING)


def test_both_binaries_give_the_same_landing(both_binaries: tuple[Path, Path]) -> None:
    own, other = (load_scenario("incline30").replace_fmu("brace", fmu).run() for fmu in both_binaries)
    assert own.status == other.status == "completed"
    assert (own.values == other.values).all()


def test_a_host_without_python_is_told_so(both_binaries: tuple[Path, Path], tmp_path: Path) -> None:
    spring = Component.read("brace", both_binaries[0])
    with zipfile.ZipFile(spring.fmu) as archive:
        library = archive.extract(spring.library, tmp_path)
    subprocess.run(["gcc", "-o", tmp_path / "host", SOURCES / "host.c", "-ldl"], check=True)
    outcome = subprocess.run([tmp_path / "host", library], capture_output=True, text=True)
    assert outcome.returncode == 0
    assert (
        outcome.stdout
        == "brace, status 3: this FMU is written in Python and runs inside a Python process only (fmpy, libcosimpy, "
        "...)"
    )


def test_a_process_with_python_fmus_ends_quietly(both_binaries: tuple[Path, Path]) -> None:
    """PythonFMU's binary frees its interpreter state twice at the end of the process unless told otherwise."""
    code = f"""
from sprain_cosim import load_scenario
for _ in range(2):
    load_scenario('incline30').replace_fmu('brace', {str(both_binaries[0])!r}).run()
    load_scenario('incline30').replace_fmu('brace', {str(both_binaries[1])!r}).run()
print('done')"""
    for _ in range(3):
        outcome = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, cwd=MODELS.parent, timeout=120
        )
        assert (outcome.returncode, outcome.stdout.strip(), outcome.stderr) == (0, "done", "")


@pytest.mark.parametrize("name", [name for name in shipped_fmus() if (MODELS / name / "device.py").is_file()])
def test_the_source_of_a_device_does_not_travel(name: str) -> None:
    """No name that stands in its Python files alone, and no line of a docstring, for any platform."""
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    open_to_all = {member for member in members if not member.startswith(("binaries/", "resources/"))}
    known = b" ".join(members[member] for member in open_to_all) + (MODELS / "_native" / "device.c").read_bytes()
    words: set[str] = set()
    for path in sorted((MODELS / name).glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                words |= {node.name, *(argument.arg for argument in node.args.args)}
            if isinstance(node, ast.FunctionDef | ast.Module):
                words |= {line.strip() for line in (ast.get_docstring(node) or "").splitlines()}
            if isinstance(node, ast.Name):
                words.add(node.id)
    # names of two words: the libraries of compilers have texts of their own
    private = {word for word in words if len(word) > 7 and word.encode() not in known and {"_", " "} & set(word)}
    assert private, "nothing to look for"
    for member in members.keys() - open_to_all:
        assert [word for word in sorted(private) if word.encode() in members[member]] == [], member


def test_locals_are_recorded_on_request_and_change_nothing() -> None:
    from sprain_cosim.scenario import load_scenario

    chosen = load_scenario("incline30_brace").with_master(stop="60 ms")
    plain, full = chosen.run(), chosen.recording("plant.*").run()
    assert full.names[: len(plain.names)] == plain.names
    assert np.array_equal(full.values[:, : len(plain.names)], plain.values)
    assert np.array_equal(full["plant.subtalar_angle_r"], full["plant.subtalar_angle"])
    assert np.allclose(full["plant.ankle_angle_r_speed"], full["plant.talocrural_velocity"], rtol=1e-12, atol=0)
    evertors = np.mean(
        [full[f"plant.{m}_r_activation"] for m in ("ext_dig", "per_brev", "per_long", "per_tert")], axis=0
    )
    assert np.allclose(np.maximum(evertors, 0.01), full["plant.evertor_activation"], rtol=0, atol=1e-15)
    # the centre of pressure lies in the platform, under the foot's 30 cm
    touching = full["plant.in_contact"] == 1
    assert touching.any()
    pivot, normal = np.array([-0.2, 0.015, 0.35]), np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    points = np.column_stack([full[f"plant.ground_point_{k}"] for k in "xyz"])
    assert np.abs((points[touching] - pivot) @ normal).max() < 1e-12
    assert np.linalg.norm(np.ptp(points[touching], axis=0)) < 0.35
    assert not points[~touching].any()
    fewer = chosen.recording("plant.pelvis_t?").run()
    assert fewer.names[len(plain.names) :] == ("plant.pelvis_tx", "plant.pelvis_ty", "plant.pelvis_tz")
    assert [str(u.name) for u in fewer.units[-3:] if u] == ["m", "m", "m"]
    assert np.array_equal(fewer["plant.pelvis_ty"], full["plant.pelvis_ty"])


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("plant.nothing*", r"recording 'plant.nothing\*': no output, input or local number"),
        ("plant.pelvis_tz_", "did you mean plant.pelvis_tz"),
        ("plant.drop_height", "recording 'plant.drop_height'"),  # a parameter
        ("plnt.*", "recording 'plnt"),
    ],
)
def test_a_pattern_of_locals_that_nothing_matches_is_refused(pattern: str, said: str) -> None:
    """It was passed over in silence."""
    from sprain_cosim.scenario import load_scenario

    chosen = load_scenario("incline30_brace").with_master(stop="1 ms")
    with pytest.raises(InputError, match=said):
        chosen.recording("plant.*", pattern).run()
    anyway = chosen.recording("brace.rotation_z_torque").run()  # on record in any case
    assert anyway.names == chosen.run().names


@pytest.mark.parametrize("suffix", ["", FMI3])
def test_a_copy_of_a_shipped_fmu_is_known_by_its_content(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And only shipped files of its size are read for that."""
    copy = tmp_path / "copy.fmu"
    copy.write_bytes((FMUS / f"brace_bushing{suffix}.fmu").read_bytes())
    sha256 = hashlib.sha256(copy.read_bytes()).hexdigest()
    foreign._shipped.cache_clear()
    read: list[str] = []
    real = archive.read
    monkeypatch.setattr(archive, "read", lambda path: (read.append(path.stem), real(path))[1])
    assert not foreign.is_foreign(copy, sha256)
    assert not foreign.is_foreign(FMUS / f"brace_bushing{suffix}.fmu", sha256)
    assert len(read) < 4
    copy.write_bytes(copy.read_bytes() + b" ")
    assert foreign.is_foreign(copy, hashlib.sha256(copy.read_bytes()).hexdigest())
    assert foreign.is_foreign(tmp_path / "gone.fmu", sha256)


def test_a_shipped_fmu_goes_by_its_name_in_either_version() -> None:
    named = load_scenario("incline30_brace").replace_fmu("brace", "brace_bushing_fmi3")
    assert named.fmus["brace"] == FMUS / "brace_bushing_fmi3.fmu"
