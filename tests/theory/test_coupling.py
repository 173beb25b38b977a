"""Coupling schemes on a split oscillator: a foot (inertia I, plant) and a spring-damper (device), against closed
forms."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sprain_cosim.cosim.coupling import SCHEMES, begin
from sprain_cosim.cosim.identification import Linearisation
from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.result import Result
from sprain_cosim.cosim.stability import verdict
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.element import Capabilities
from sprain_cosim.scenario import load_scenario
from tests.fake import FakeComponent, connector, linear_variables, make_fmu

INERTIA, START = 0.005, np.array([0.1, 0.0])


@lru_cache(maxsize=1024)
def transition(k: float, c: float, inertia: float, step: float) -> np.ndarray:
    """(2, 3): angle, velocity and a constant torque to angle and velocity one step later."""
    return expm(step * np.array([[0, 1, 0], [-k / inertia, -c / inertia, 1 / inertia], [0, 0, 0]]))[:2]


def foot(damping: float, inertia: float = INERTIA) -> FakeComponent:
    """I dw/dt = torque - K (angle - angle at the exchange) - C (w - w at the exchange) - damping w, solved exactly over
    every step."""

    def law(state, inputs, time, step):
        k, c = inputs["brace_subtalar_stiffness"], inputs["brace_subtalar_damping"]
        force = inputs["brace_subtalar_torque"] + k * state[0] + c * state[1]
        return transition(k, c + damping, inertia, step) @ np.array([*state, force])

    names = {"subtalar_angle": ("output", "rad"), "subtalar_velocity": ("output", "rad/s")}
    names |= {
        f"brace_subtalar_{kind}": ("input", u)
        for kind, u in (("torque", "N.m"), ("stiffness", "N.m/rad"), ("damping", "N.m.s/rad"))
    }
    connectors = {
        n: connector(n, causality, u, depends_on=() if causality == "output" else None)
        for n, (causality, u) in names.items()
    }
    return FakeComponent("plant", connectors, advance=law, output=lambda state, inputs: state, initial=START)


def device(stiffness: float, damping: float, cubic: float = 0.0, **more) -> FakeComponent:
    def output(state, inputs):
        t, w = inputs["subtalar_angle"], inputs["subtalar_velocity"]
        return [-stiffness * t - cubic * t**3 - damping * w, stiffness + 3 * cubic * t * t, damping]

    names = {
        "subtalar_angle": ("input", "rad"),
        "subtalar_velocity": ("input", "rad/s"),
        "subtalar_torque": ("output", "N.m"),
    }
    names |= {"subtalar_stiffness": ("output", "N.m/rad"), "subtalar_damping": ("output", "N.m.s/rad")}
    return FakeComponent("brace", {n: connector(n, c, u) for n, (c, u) in names.items()}, output=output, **more)


def two_axes(k: np.ndarray, c: np.ndarray, inertia: float) -> tuple[FakeComponent, FakeComponent]:
    """A plant with two coupled axes that takes all cross terms, and a black box with full matrices."""
    axes = ("talocrural", "subtalar")
    inputs = [f"brace_{a}_torque" for a in axes]
    pairs = [(a, b) for a in axes for b in axes]
    names = {
        f"brace_{a}_{kind}" if a == b else f"brace_{a}_{b}_{kind}": u
        for kind, u in (("stiffness", "N.m/rad"), ("damping", "N.m.s/rad"))
        for a, b in pairs
    }
    plant = {n: connector(n, "input", "N.m") for n in inputs} | {n: connector(n, "input", u) for n, u in names.items()}
    plant |= {
        f"{a}_{q}": connector(f"{a}_{q}", "output", u, depends_on=())
        for q, u in (("angle", "rad"), ("velocity", "rad/s"))
        for a in axes
    }

    def law(state, given, time, step):
        torque = np.array([given[n] for n in inputs])
        stiffness, damping = (
            np.array([given[n] for n in names if n.endswith(kind)]).reshape(2, 2) for kind in ("stiffness", "damping")
        )
        matrix = np.zeros((5, 5))
        matrix[:2, 2:4] = np.eye(2)
        matrix[2:4, :2], matrix[2:4, 2:4] = -stiffness / inertia, -damping / inertia
        matrix[2:4, 4] = (torque + stiffness @ state[:2] + damping @ state[2:]) / inertia
        return (expm(step * matrix) @ np.array([*state, 1.0]))[:4]

    foot = FakeComponent("plant", plant, advance=law, output=lambda s, i: s, initial=np.array([0.05, 0.1, 0.0, 1.0]))
    given = {
        f"{a}_{q}": connector(f"{a}_{q}", "input", u)
        for q, u in (("angle", "deg"), ("velocity", "deg/s"))
        for a in axes
    }
    gives = {f"{a}_torque": connector(f"{a}_torque", "output", "N.mm") for a in axes}

    def output(state, inputs):
        x, v = (np.radians([inputs[f"{a}_{q}"] for a in axes]) for q in ("angle", "velocity"))
        return -1e3 * (k @ x + c @ v)

    return foot, FakeComponent("brace", given | gives, output=output)


def run(scheme: str, step: float, brace: FakeComponent, damping: float, stop: float = 0.1) -> Result:
    parts = (foot(damping), brace)
    system = System(parts, connect(parts, {})[0])
    assert system.check() == []
    result = Master(communication_step=step, stop=stop, scheme=scheme).run(system.open(), {})
    assert result.status == "completed", result.message
    return result


def exact(times: np.ndarray, stiffness: float, damping: float) -> np.ndarray:
    matrix = np.array([[0, 1], [-stiffness / INERTIA, -damping / INERTIA]])
    return np.array([(expm(t * matrix) @ START)[0] for t in times])


def slope(scheme: str, steps: np.ndarray) -> float:
    """Order of convergence of the angle's RMS error."""
    errors = []
    for h in steps:
        result = run(scheme, h, device(100.0, 0.1), 0.2)
        errors.append(np.sqrt(np.mean((result["plant.subtalar_angle"] - exact(result.time, 100.0, 0.3)) ** 2)))
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("scheme", "order"), [("jacobi", 1), ("gauss-seidel", 1), ("gauss-seidel-extrapolated", 2), ("iterative", 2)]
)
def test_order_on_a_linear_oscillator(scheme: str, order: int) -> None:
    steps = 2e-4 * 0.5 ** np.arange(4)
    assert slope(scheme, steps) == pytest.approx(order, abs=0.15)


def test_impedance_is_exact_for_a_linear_device() -> None:
    for stiffness, damping in ((100.0, 0.1), (2000.0, 0.5), (50.0, 20.0)):
        result = run("impedance", 1e-3, device(stiffness, damping), 0.2)
        assert result["plant.subtalar_angle"] == pytest.approx(exact(result.time, stiffness, damping + 0.2), abs=1e-12)
        assert result.coupling_error == pytest.approx(0.0, abs=1e-10)


def test_impedance_is_of_second_order_for_a_cubic_device() -> None:
    k, c, cubic, d = 50.0, 0.1, 2e4, 0.2
    steps, errors = 4e-4 * 0.5 ** np.arange(4), []
    for h in steps:
        result = run("impedance", h, device(k, c, cubic), d)
        truth = solve_ivp(
            lambda t, y: [y[1], (-k * y[0] - cubic * y[0] ** 3 - (c + d) * y[1]) / INERTIA],
            (0, 0.1),
            START,
            t_eval=result.time,
            rtol=1e-11,
            atol=1e-13,
        )
        errors.append(np.sqrt(np.mean((result["plant.subtalar_angle"] - truth.y[0]) ** 2)))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize(("scheme", "share"), [("gauss-seidel", 0.5), ("jacobi", 1.5)])
def test_a_held_torque_is_negative_damping(scheme: str, share: float) -> None:
    """Without damping the amplitude grows at the rate of a damping of -k h/2 (Gauss-Seidel) or -3 k h/2 (Jacobi), to
    first order in h."""
    k, h = 100.0, 2e-5
    result = run(scheme, h, device(k, 0.0), 0.0, stop=0.2)
    angle, velocity = result["plant.subtalar_angle"], result["plant.subtalar_velocity"]
    energy = 0.5 * INERTIA * velocity**2 + 0.5 * k * angle**2
    rate = math.log(energy[-1] / energy[0]) / (result.time[-1] * 2)
    assert rate == pytest.approx(share * k * h / (2 * INERTIA), rel=0.03)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_coupling_error_falls_with_the_step(scheme: str) -> None:
    cubic = device(50.0, 0.05, 2e4)
    coarse, fine = (run(scheme, h, cubic, 0.2).coupling_error for h in (4e-4, 1e-4))
    if (
        scheme == "iterative"
    ):  # what the plant felt is the mean of the device's torques: the residual is that of the iteration
        assert coarse < 1e-4
        assert fine < 1e-4
    else:
        order = 1 if scheme in ("jacobi", "gauss-seidel") else 2
        assert math.log(coarse / fine) / math.log(4) == pytest.approx(order, abs=0.25)


def test_the_coupling_error_ranks_the_schemes_as_their_true_errors_do() -> None:
    stiff = device(300.0, 0.2)
    stated, true = {}, {}
    for scheme in ("jacobi", "gauss-seidel", "gauss-seidel-extrapolated", "impedance"):
        result = run(scheme, 5e-4, stiff, 0.4)
        stated[scheme] = result.coupling_error
        true[scheme] = np.abs(result["plant.subtalar_angle"] - exact(result.time, 300.0, 0.6)).max()
    assert sorted(stated, key=stated.__getitem__) == sorted(true, key=true.__getitem__)


def test_iteration_needs_saved_states() -> None:
    unable = device(100.0, 0.1, capabilities=Capabilities("2.0", state=False))
    with pytest.raises(InputError, match=r"iterative: brace cannot save and restore its state; use auto"):
        run("iterative", 1e-3, unable, 0.2)


def test_an_iteration_that_does_not_settle_is_an_error() -> None:
    """A device whose torque jumps with the sign of the angle has no answer at the jump."""
    jumping = device(0.0, 0.0)
    jumping = FakeComponent(
        "brace", jumping.connectors, output=lambda s, i: [-500.0 if i["subtalar_angle"] > 0.07 else 500.0, 0.0, 0.0]
    )
    parts = (foot(0.0), jumping)
    result = Master(communication_step=1e-3, stop=0.1, scheme="iterative").run(
        System(parts, connect(parts, {})[0]).open(), {}
    )
    assert result.status == "failed"
    assert "plant.brace_subtalar_torque did not settle in 50 iterations" in result.message


@pytest.mark.parametrize(
    ("stiffness", "ratio", "step"), [(500.0, 1.0, 1e-3), (2000.0, 0.0, 1e-3), (500.0, 5.0, 1e-3), (5000.0, 1.0, 2e-3)]
)
def test_the_iteration_holds_where_plain_substitution_diverges(stiffness: float, ratio: float, step: float) -> None:
    """Inertia 0.002 kg.m2; few iterations a step, and the mean of the torques to the tolerance."""
    inertia = 0.002
    brace = device(stiffness, 2 * ratio * math.sqrt(stiffness * inertia))
    parts = (foot(0.0, inertia), brace)
    result = Master(communication_step=step, stop=0.1, scheme="iterative").run(
        System(parts, connect(parts, {})[0]).open(), {}
    )
    assert result.status == "completed", result.message
    points = result["plant.subtalar_angle"][:: round(step / 5e-4)]  # between them it is a parabola
    assert np.abs(points).max() <= 1.001 * START[0]
    assert result.coupling_error < 1e-4
    steps = sum(line.startswith("do_step") for line in brace.journal)
    assert steps <= 4 * result.exchanges


PUBLISHED = {"plant.initial_pose": "published", "plant.fibre_start": "as_published"}
MONOLITHIC = [  # scenario, scale of the brace, start of the paper's studies (whose means these are)
    ("incline30_brace", 2.4, True),
    ("incline30_mixed", 1.5, True),
    ("incline30_brace", 2.4, False),
    ("incline30_brace", 4.0, False),
    ("incline30_mixed", 1.5, False),
]


@pytest.mark.parametrize(("name", "scale", "published"), MONOLITHIC)
def test_default_settings_against_the_brace_inside_the_plant(name: str, scale: float, published: bool) -> None:
    """Peak subtalar angle within 0.05°, the brace's peak moment within 1 %."""
    coupled = load_scenario(name).override("brace.angle_scale", scale)
    for parameter, value in PUBLISHED.items() if published else ():
        coupled = coupled.override(parameter, value)
    inside = coupled.override("brace.torque_scale", 0.0).override("plant.internal_brace_angle_scale", scale)
    a, b = coupled.run(), inside.run()
    assert (a.status, b.status, a.scheme) == ("completed", "completed", "impedance")
    assert a.metrics["peak_subtalar_angle_deg"] == pytest.approx(b.metrics["peak_subtalar_angle_deg"], abs=0.05)
    assert a["plant.brace_subtalar_moment"].max() == pytest.approx(b["plant.brace_subtalar_moment"].max(), rel=0.01)
    assert a.coupling_error < 0.01


@pytest.mark.parametrize("name", ["level", "incline30", "incline30_reflex", "incline30_coactivation"])
def test_the_means_of_the_studies_without_a_brace(name: str) -> None:
    """The controller alone is coupled: a tenth of the step changes the peak by less than 0.05°."""
    scenario = load_scenario(name)
    for parameter, value in PUBLISHED.items():
        scenario = scenario.override(parameter, value)
    fine = scenario.with_master(communication_step="0.05 ms").run().metrics["peak_subtalar_angle_deg"]
    assert scenario.run().metrics["peak_subtalar_angle_deg"] == pytest.approx(fine, abs=0.05)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_scheme_runs_the_real_plant(scheme: str) -> None:
    result = load_scenario("incline30_brace").with_master(scheme, "0.25 ms").run()
    assert result.status == "completed"
    assert result.metrics["peak_subtalar_angle_deg"] == pytest.approx(29.84, abs=0.15)
    assert result.scheme == scheme


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_step_that_is_taken_back_leaves_no_trace_in_the_scheme(scheme: str) -> None:
    """Save, two steps, restore with states and bus: the same two steps again give the same values to the bit."""
    parts = (foot(0.1), device(50.0, 0.05, 2e4))
    assembly = System(parts, connect(parts, {})[0]).open()
    assembly.start({}, 0.0, 1.0)
    chosen = begin(scheme, assembly, 4e-4, 100).scheme
    for k in range(5):
        chosen.step(assembly, 4e-4 * k, 4e-4)
    states, bus, memory = [m.instance.save_state() for m in assembly.members], assembly.bus.copy(), chosen.save()
    rows = []
    for _ in range(2):
        for k in (5, 6):
            chosen.step(assembly, 4e-4 * k, 4e-4)
        rows.append(assembly.bus.copy())
        for member, state in zip(assembly.members, states, strict=True):
            member.instance.restore_state(state)
            member.inputs_set = False
        assembly.bus[:] = bus
        chosen.restore(memory)
    assert (rows[0] == rows[1]).all()
    assert (rows[0] != bus).any()


def light_foot(damping: float = 0.0) -> FakeComponent:
    """The foot, which also tells its inertia."""
    plain = foot(damping)
    connectors = {
        **plain.connectors,
        "subtalar_effective_inertia": connector("subtalar_effective_inertia", "output", "kg.m2", depends_on=()),
    }
    return FakeComponent(
        "plant",
        connectors,
        advance=plain.advance,
        output=lambda state, inputs: [*state, INERTIA],
        initial=np.array([0.1, 1.0]),
    )


def silent(brace: FakeComponent) -> FakeComponent:
    """The same device without its declared stiffness and damping."""
    kept = {n: c for n, c in brace.connectors.items() if not n.endswith(("_stiffness", "_damping"))}
    return FakeComponent("brace", kept, output=lambda state, inputs: brace.output(state, inputs)[:1])


def guarded(scheme: str, step: float, brace: FakeComponent, guard: bool = True) -> Result:
    parts = (light_foot(), brace)
    return Master(communication_step=step, stop=0.15, scheme=scheme, guard=guard).run(
        System(parts, connect(parts, {})[0]).open(), {}
    )


@pytest.mark.parametrize(
    ("scheme", "stiffness", "damping"),
    [
        ("gauss-seidel", 2000.0, 0.0),
        ("jacobi", 700.0, 0.0),
        ("gauss-seidel-extrapolated", 15_000.0, 0.0),
        ("gauss-seidel", 0.0, 25.0),
        ("gauss-seidel-extrapolated", 0.0, 12.0),
        ("jacobi", 0.0, 12.0),
    ],
)
@pytest.mark.parametrize("declared", [True, False])
def test_every_refusal_is_right(scheme: str, stiffness: float, damping: float, declared: bool) -> None:
    """Refused with the step that would do; run unguarded, it fails; at the step named, it does not."""
    brace = device(stiffness, damping) if declared else silent(device(stiffness, damping))
    with pytest.raises(InputError, match=r'may grow .* use .*--step "[\d.e-]+ ms"') as refusal:
        guarded(scheme, 5e-4, brace)
    wild = guarded(scheme, 5e-4, brace, guard=False)
    assert wild.status == "failed" or np.abs(wild["plant.subtalar_angle"]).max() > 20 * START[0]
    step = float(str(refusal.value).split('--step "')[1].split(" ms")[0]) * 1e-3
    calm = guarded(scheme, step, brace)
    assert calm.status == "completed"
    assert np.abs(calm["plant.subtalar_angle"]).max() <= 10 * START[0]


def test_a_refusal_across_the_axes_is_right() -> None:
    """Two axes, coupled by the device; the guard sees the greatest eigenvalue of the matrices, not their diagonal."""
    k = np.array([[700.0, 650.0], [650.0, 700.0]])
    plain, _ = two_axes(k, np.zeros((2, 2)), INERTIA)
    inertia = {
        f"{a}_effective_inertia": connector(f"{a}_effective_inertia", "output", "kg.m2", depends_on=())
        for a in ("talocrural", "subtalar")
    }
    told = FakeComponent(
        "plant",
        {**plain.connectors, **inertia},
        output=lambda s, i: [*s, INERTIA, INERTIA],
        advance=plain.advance,
        initial=np.array([0.05, 0.1, 0.0, 1.0]),
    )

    def go(stiffness: np.ndarray, guard: bool) -> Result:
        parts = (told, two_axes(stiffness, np.zeros((2, 2)), INERTIA)[1])
        return Master(1e-3, 0.15, scheme="gauss-seidel", guard=guard).run(
            System(parts, connect(parts, {})[0]).open(), {}
        )

    with pytest.raises(InputError, match="may grow"):
        go(k, True)
    wild = go(k, False)
    assert np.abs(wild["plant.subtalar_angle"]).max() > 20 * START[0]
    alone = go(np.diag(np.diag(k)), True)  # without the coupling it only deserves a warning
    assert alone.status == "completed"
    assert "may grow" in alone.warning


@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_over_centre_device_is_never_refused_and_no_step_is_advised(scheme: str) -> None:
    """-30 N.m/rad at the centre, then stiffening: it snaps over, by itself, as the exact motion does."""
    result = guarded(scheme, 2e-4, device(-30.0, 0.05, 300.0))
    assert result.status == "completed"
    assert "the device pushes away about subtalar (stiffness" in result.warning
    assert "if it should resist, its sign is wrong (factor = -1 in a mapping file)" in result.warning
    assert "--" not in result.warning
    angle = solve_ivp(
        lambda t, y: [y[1], (30.0 * y[0] - 300.0 * y[0] ** 3 - 0.05 * y[1]) / INERTIA],
        (0, 0.15),
        (0.1, 1.0),
        t_eval=result.time,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    near = {"jacobi": 0.2, "gauss-seidel": 0.08}.get(scheme, 0.02)
    assert np.abs(result["plant.subtalar_angle"] - angle).max() < near * np.abs(angle).max()


def of_guard(result: Result) -> str:
    """The warning without the word on the strength of a device that no brace has."""
    return re.sub(r"the device gave at most .*?angles too\?(; )?", "", result.warning)


def test_what_pushes_away_hides_no_growth_by_the_coupling() -> None:
    """One axis over its centre, the other too stiff for the scheme: refused for the latter."""
    shapes = two_axes(np.diag([-30.0, 2000.0]), np.zeros((2, 2)), INERTIA)
    inertia = {
        f"{a}_effective_inertia": connector(f"{a}_effective_inertia", "output", "kg.m2", depends_on=())
        for a in ("talocrural", "subtalar")
    }
    plain, brace = shapes
    plant = FakeComponent(
        "plant",
        {**plain.connectors, **inertia},
        advance=plain.advance,
        output=lambda s, i: [*s, INERTIA, INERTIA],
        initial=np.array([1e-3, 0.1, 0.0, 1.0]),
    )
    parts = (plant, brace)
    system = System(parts, connect(parts, {})[0])
    with pytest.raises(InputError, match=r"an oscillation about subtalar may grow .* under gauss-seidel"):
        Master(1e-3, 0.15, scheme="gauss-seidel").run(system.open(), {})
    result = Master(1e-3, 0.05).run(system.open(), {})
    assert (result.status, result.scheme) == ("completed", "impedance")
    assert of_guard(result).startswith("the device pushes away about talocrural")


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel", "gauss-seidel-extrapolated"])
def test_every_scheme_and_step_that_is_advised_runs_calmly(scheme: str) -> None:
    brace = device(15_000.0, 0.0)
    with pytest.raises(InputError) as refusal:
        guarded(scheme, 1e-3, brace)
    advice = str(refusal.value).rpartition("; use ")[2].split(" or ")
    assert {a.split()[0] for a in advice} == {"--scheme", "--step"}
    for option in advice:
        word = option.split(" ", 1)[1].strip('"')
        other, step = (word, 1e-3) if option.startswith("--scheme") else (scheme, 1e-3 * float(word.split()[0]))
        result = guarded(other, step, brace)
        assert (result.status, of_guard(result)) == ("completed", "")
        assert np.abs(result["plant.subtalar_angle"]).max() < 10 * START[0]


def test_no_advice_where_nothing_was_found() -> None:
    """A declared stiffness of the wrong sign under impedance, by a device that cannot repeat a step: no step helps."""
    lines = verdict("impedance", hopeless(), 5e-4, 300, ("impedance",))
    assert lines[0] == "refusal"
    assert lines[1].endswith("no scheme or step was found that would do")


def hopeless() -> Linearisation:
    one, zero = np.ones((1, 1)), np.zeros((1, 1))
    return Linearisation(("subtalar",), 1e12 * one, zero, -1e12 * one, zero, np.array([INERTIA]), np.zeros(1))


@pytest.mark.parametrize("scheme", ["impedance", "iterative"])
@pytest.mark.parametrize(
    ("stiffness", "damping"), [(500.0, 0.0), (20_000.0, 0.0), (1e5, 0.0), (0.0, 100.0), (5000.0, 50.0)]
)
def test_what_is_never_refused_never_grows(scheme: str, stiffness: float, damping: float) -> None:
    result = guarded(scheme, 5e-4, device(stiffness, damping))
    assert (result.status, of_guard(result)) == ("completed", "")
    largest = math.hypot(START[0], math.sqrt(INERTIA / stiffness)) if stiffness else 0.1 + INERTIA / damping
    assert np.abs(result["plant.subtalar_angle"]).max() <= 1.05 * largest


def test_a_warning_is_not_a_refusal_and_a_soft_device_passes() -> None:
    assert "may grow" in guarded("gauss-seidel", 5e-4, device(800.0, 0.0)).warning
    assert of_guard(guarded("gauss-seidel", 5e-4, device(50.0, 0.05))) == ""
    for scheme in ("impedance", "iterative"):
        assert of_guard(guarded(scheme, 5e-4, device(2000.0, 0.0))) == ""


LINEAR = """
    def initialise(self):
        self.refresh()

    def refresh(self):
        self["subtalar_torque"] = -self["k"] * self["subtalar_angle"] - self["c"] * self["subtalar_velocity"]
        self["subtalar_stiffness"], self["subtalar_damping"] = self["k"], self["c"]

    def step(self, time, step):
        self.refresh()
"""


@pytest.mark.parametrize(("stiffness", "damping"), [(2000.0, 0.0), (0.0, 20.0)])
def test_stiff_linear_braces_on_the_real_plant(stiffness: float, damping: float, tmp_path) -> None:
    """2000 N.m/rad and 20 N.m.s/rad run stably by default, and half the step changes the peak by less than 0.05°."""
    fmu = make_fmu(tmp_path, "linear", linear_variables(True), LINEAR)
    scenario = (
        load_scenario("incline30")
        .replace_fmu("brace", fmu)
        .override("brace.k", f"{stiffness} N.m/rad")
        .override("brace.c", f"{damping} N.m.s/rad")
    )
    result = scenario.run()
    assert result.status == "completed"
    assert result.scheme == "impedance"
    assert result.metrics["peak_subtalar_angle_deg"] < 25.0
    assert abs(scenario.coupling_check(result)["peak_subtalar_angle_deg"]) < 0.05


def test_a_device_with_a_smaller_step_of_its_own(tmp_path) -> None:
    """0.1 ms under a 0.5 ms master: a hundred steps of its own in 10 ms, at the right times."""
    counting = """
        count = 0

        def step(self, time, step):
            self.count += 1
            assert abs(step - 1e-4) < 1e-12 and abs(time - (self.count - 1) * 1e-4) < 1e-9
            self["subtalar_torque"] = 0.0
    """
    fmu = make_fmu(tmp_path, "quick", linear_variables(True), counting, "FIXED_STEP = 0.0001")
    result = load_scenario("incline30").replace_fmu("brace", fmu).with_master(stop="10 ms").run()
    assert result.status == "completed", result.message
