"""Stiffness and damping of a black box by finite differences: found as they are, handed over, and enough to run a stiff
device stably."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sprain_cosim.cosim.coupling import begin
from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.result import Result
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.element import Capabilities
from sprain_cosim.scenario import load_scenario
from tests.fake import FakeComponent, connector, linear_variables, make_fmu
from tests.theory.test_coupling import INERTIA, START, device, exact, foot, light_foot, two_axes

UNABLE = Capabilities("2.0", state=False)
KINDS = ("direct", "late", "mute")
"""Answers at once; only in a step; only in a step and without saving its state."""


def black_box(kind: str, k: float, c: float, cubic: float = 0.0, **more) -> FakeComponent:
    """Torque -k angle - cubic angle^3 - c velocity, nothing declared."""

    def torque(inputs):
        angle, velocity = inputs["subtalar_angle"], inputs["subtalar_velocity"]
        return -k * angle - cubic * angle**3 - c * velocity

    names = {
        "subtalar_angle": ("input", "rad"),
        "subtalar_velocity": ("input", "rad/s"),
        "subtalar_torque": ("output", "N.m"),
    }
    connectors = {n: connector(n, causality, u) for n, (causality, u) in names.items()}
    if kind == "direct":
        return FakeComponent("brace", connectors, output=lambda s, i: [torque(i)], **more)
    capabilities = {} if kind == "late" else {"capabilities": UNABLE}
    first = torque({"subtalar_angle": START[0], "subtalar_velocity": START[1]})
    return FakeComponent(
        "brace",
        connectors,
        advance=lambda s, i, t, h: torque(i),
        output=lambda s, i: [s],
        initial=first,
        **capabilities,
        **more,
    )


def run(brace: FakeComponent, plant: FakeComponent | None = None, scheme: str = "auto", **settings) -> Result:
    parts = (plant or foot(0.2), brace)
    return Master(**{"communication_step": 1e-3, "stop": 0.1, "scheme": scheme, **settings}).run(
        System(parts, connect(parts, {})[0]).open(), {}
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("k", "c"), [(100.0, 0.1), (2000.0, 0.5), (50.0, 20.0)])
def test_a_linear_black_box_is_coupled_exactly(kind: str, k: float, c: float) -> None:
    result = run(black_box(kind, k, c))
    assert (result.status, result.scheme) == ("completed", "impedance")
    assert result["plant.subtalar_angle"] == pytest.approx(exact(result.time, k, c + 0.2), abs=1e-10)
    assert result["plant.brace_subtalar_stiffness"] == pytest.approx(k, rel=1e-7)
    assert result["plant.brace_subtalar_damping"] == pytest.approx(c, rel=1e-6)


def test_the_result_says_how_it_was_found() -> None:
    reasons = {kind: run(black_box(kind, 100.0, 0.1), light_foot()) for kind in KINDS}
    for kind, how in zip(KINDS, ("from its direct answer", "over a repeated step", "over its first step"), strict=True):
        said = reasons[kind].scheme_reason
        assert said.startswith(f"found by finite differences: stiffness and damping of brace about subtalar {how}")
        assert said.endswith("stiffness 100 N.m/rad, damping 0.1 N.m.s/rad about subtalar at the start")
    assert reasons["direct"].warning == reasons["late"].warning == ""
    assert "cannot save its state so they are held as found at the start" in reasons["mute"].warning


@pytest.mark.parametrize("kind", ["direct", "late"])
def test_a_cubic_black_box_is_coupled_as_well_as_a_declared_one(kind: str) -> None:
    """Second order, and no worse than with the tangent declared; found once only, it is of first order."""
    k, c, cubic = 50.0, 0.1, 2e4
    errors: dict[int, list[float]] = {0: [], 1: [], -1: []}
    for every, found in errors.items():
        for h in (2e-4, 1e-4, 5e-5):
            brace = black_box(kind, k, c, cubic) if every >= 0 else device(k, c, cubic)
            result = run(brace, communication_step=h, identify=max(0, every))
            truth = solve_ivp(
                lambda t, y: [y[1], (-k * y[0] - cubic * y[0] ** 3 - (c + 0.2) * y[1]) / INERTIA],
                (0, 0.1),
                START,
                t_eval=result.time,
                rtol=1e-10,
                atol=1e-12,
            )
            found.append(float(np.sqrt(np.mean((result["plant.subtalar_angle"] - truth.y[0]) ** 2))))
    assert math.log2(errors[1][0] / errors[1][2]) / 2 == pytest.approx(2.0, abs=0.3)
    assert math.log2(errors[0][0] / errors[0][2]) / 2 == pytest.approx(1.0, abs=0.3)
    assert (np.array(errors[1]) < 1.1 * np.array(errors[-1])).all()


def test_identification_leaves_the_device_as_it_was() -> None:
    """A Maxwell element: the run with probes along it equals one with the true stiffness declared."""
    k, tau = 300.0, 0.004

    def law(state, inputs, time, step):
        x = inputs["subtalar_angle"]
        return x + (state - x) * math.exp(-step / tau)

    def element(declares: bool) -> FakeComponent:
        names = {"subtalar_angle": ("input", "rad"), "subtalar_torque": ("output", "N.m")} | (
            {"subtalar_stiffness": ("output", "N.m/rad")} if declares else {}
        )
        connectors = {n: connector(n, causality, u) for n, (causality, u) in names.items()}
        return FakeComponent(
            "brace", connectors, advance=law, output=lambda s, i: [-k * (i["subtalar_angle"] - s), k][: len(names) - 1]
        )

    told, probed = run(element(True)), run(element(False))
    assert probed["plant.subtalar_angle"] == pytest.approx(told["plant.subtalar_angle"], abs=1e-10)


def test_cross_terms_are_found_in_the_device_s_own_units() -> None:
    k, c = np.array([[800.0, -300.0], [-200.0, 1500.0]]), np.array([[0.5, 0.2], [0.1, 1.0]])
    parts = two_axes(k, c, INERTIA)
    result = Master(1e-3, 0.1).run(System(parts, connect(parts, {})[0]).open(), {})
    matrix = np.zeros((5, 5))[:4, :4]
    matrix[:2, 2:], matrix[2:, :2], matrix[2:, 2:] = np.eye(2), -k / INERTIA, -c / INERTIA
    truth = np.array([(expm(t * matrix) @ np.array([0.05, 0.1, 0.0, 1.0]))[:2] for t in result.time])
    assert result["plant.talocrural_angle"] == pytest.approx(truth[:, 0], abs=1e-9)
    assert result["plant.subtalar_angle"] == pytest.approx(truth[:, 1], abs=1e-9)
    assert result["plant.brace_talocrural_subtalar_stiffness"] == pytest.approx(-300.0, rel=1e-6)
    assert result["plant.brace_subtalar_talocrural_damping"] == pytest.approx(0.1, rel=1e-5)


def test_only_what_is_not_declared_is_found() -> None:
    brace = black_box("direct", 100.0, 0.4)
    half = FakeComponent(
        "brace",
        {**brace.connectors, "subtalar_stiffness": connector("subtalar_stiffness", "output", "N.m/rad")},
        output=lambda s, i: [brace.output(s, i)[0], 100.0],
    )
    result = run(half)
    assert result["plant.subtalar_angle"] == pytest.approx(exact(result.time, 100.0, 0.6), abs=1e-10)
    assert result.scheme_reason.startswith(
        "the device declares brace.subtalar_stiffness; found by finite differences: damping of brace about subtalar "
        "from"
    )


def test_a_declared_stiffness_that_is_not_true_is_named_and_refused_where_it_matters() -> None:
    """Declared per degree by mistake: a 57th of the truth."""
    k = 2000.0
    brace = black_box("direct", k, 0.0)
    connectors = {**brace.connectors, "subtalar_stiffness": connector("subtalar_stiffness", "output", "N.m/rad")}
    wrong = FakeComponent("brace", connectors, output=lambda s, i: [brace.output(s, i)[0], k / 57.3])
    with pytest.raises(
        InputError, match=r"may grow 7830-fold over the run under impedance .* use --scheme iterative or --step"
    ):
        run(wrong, light_foot())
    wild = run(wrong, light_foot(), guard=False)
    assert np.abs(wild["plant.subtalar_angle"]).max() > 20 * START[0]
    mild = FakeComponent("brace", connectors, output=lambda s, i: [brace.output(s, i)[0], 0.4 * k])
    assert (
        "brace.subtalar_stiffness says 800 where the torque answers with 2000 (SI)"
        in run(mild, light_foot(), guard=True, communication_step=2e-4).warning
    )


def test_one_instance_per_process_cannot_be_probed() -> None:
    brace = black_box("mute", 2000.0, 0.0)
    single = FakeComponent(
        "brace", brace.connectors, Capabilities("2.0", single=True), brace.output, brace.advance, brace.initial
    )
    result = run(single, light_foot(), communication_step=5e-5)
    assert (result.scheme, result.scheme_reason) == (
        "gauss-seidel",
        "stiffness and damping are neither declared nor to be found",
    )
    assert "allows one instance only: they stay unknown" in result.warning


def test_auto_without_a_plant_that_takes_stiffness() -> None:
    """A soft device: Gauss-Seidel; a stiff one: iteration, or the guard's refusal where that cannot be."""
    simple = light_foot()
    connectors = {n: c for n, c in simple.connectors.items() if not n.endswith(("_stiffness", "_damping"))}
    zeros = {"brace_subtalar_stiffness": 0.0, "brace_subtalar_damping": 0.0}
    plant = FakeComponent(
        "plant",
        connectors,
        output=simple.output,
        advance=lambda s, i, t, h: simple.advance(s, i | zeros, t, h),
        initial=simple.initial,
    )
    assert run(black_box("direct", 20.0, 0.02), plant).scheme == "gauss-seidel"
    stiff = run(black_box("direct", 2000.0, 0.0), plant)
    assert (stiff.status, stiff.scheme) == ("completed", "iterative")
    assert "gauss-seidel would not be stable: stiffness 2000 N.m/rad" in stiff.scheme_reason
    with pytest.raises(InputError, match="may grow 9100-fold over the run under gauss-seidel"):
        run(black_box("direct", 2000.0, 0.0, capabilities=UNABLE), plant)


def test_no_probe_beyond_the_stop_time() -> None:
    brace = black_box("late", 100.0, 0.0)
    run(brace)
    assert max(float(line.split()[1]) for line in brace.journal if line.startswith("do_step")) < 0.0995


def test_an_identification_begins_on_consistent_values() -> None:
    """The bus after `begin` is that of before, stiffness and damping apart."""
    parts = (light_foot(), black_box("late", 100.0, 0.1))
    assembly = System(parts, connect(parts, {})[0]).open()
    assembly.start({}, 0.0, 1.0)
    before = dict(zip(assembly.names, assembly.record.copy(), strict=True))
    begin("auto", assembly, 1e-3, 100)
    after = dict(zip(assembly.names, assembly.record, strict=True))
    assert {n for n in before if before[n] != after[n]} == {
        "plant.brace_subtalar_stiffness",
        "plant.brace_subtalar_damping",
    }


TORQUE = 'self["subtalar_torque"] = -self["k"] * self["subtalar_angle"] - self["c"] * self["subtalar_velocity"]'
SLAVES = {
    "direct": f"def initialise(self):\n    self.refresh()\n\ndef refresh(self):\n    {TORQUE}\n\ndef step(self, time, "
    "step):\n    self.refresh()\n",
    "late": f"def step(self, time, step):\n    {TORQUE}\n",
}


@pytest.mark.parametrize("kind", SLAVES)
def test_a_stiff_black_box_on_the_real_plant(kind: str, tmp_path) -> None:
    """2000 N.m/rad and 20 N.m.s/rad, undeclared: stable by default, the peak as with the shipped linear brace, which
    declares both."""
    fmu = make_fmu(tmp_path, kind, linear_variables(False), SLAVES[kind])
    box, known = (
        load_scenario("incline30").replace_fmu("brace", fmu),
        load_scenario("incline30").replace_fmu("brace", "brace_linear"),
    )
    for k, c in ((2000.0, 0.0), (0.0, 20.0)):
        result = box.override("brace.k", f"{k} N.m/rad").override("brace.c", f"{c} N.m.s/rad").run()
        told = (
            known.override("brace.subtalar_stiffness_coefficient", f"{k} N.m/rad")
            .override("brace.subtalar_damping_coefficient", f"{c} N.m.s/rad")
            .run()
        )
        assert (result.status, result.scheme) == ("completed", "impedance")
        assert result["plant.subtalar_angle"] == pytest.approx(told["plant.subtalar_angle"], abs=1e-7)
        assert result.coupling_error < 1e-9
