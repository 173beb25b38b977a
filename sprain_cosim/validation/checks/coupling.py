"""Is the software right? The coupling against closed forms, energy, and a device inside the plant; numerical
convergence of the landing."""

from __future__ import annotations

import math

import numpy as np

from ..check import Check, CheckRow
from ..laboratory import Laboratory, scenario
from ..oscillator import DAMPING, INERTIA, SpringDevice, exact, order, swing

STEPS = 2e-4 * 0.5 ** np.arange(4)
ORDERS = {"jacobi": 1, "gauss-seidel": 1, "gauss-seidel-extrapolated": 2, "iterative": 2}
CASES = (("incline30_brace", 2.4), ("incline30_brace", 4.0), ("incline30_mixed", 1.5))
PEAK = "peak_subtalar_angle_deg"


def orders(_: Laboratory) -> list[CheckRow]:
    linear = SpringDevice(100.0, 0.1)
    return [CheckRow(name, order(name, STEPS, linear), expected, 0.15) for name, expected in ORDERS.items()]


def order_of_impedance(_: Laboratory) -> list[CheckRow]:
    return [
        CheckRow("impedance, cubic device", order("impedance", 2 * STEPS[:3], SpringDevice(50.0, 0.1, 2e4)), 2.0, 0.15)
    ]


def impedance_is_exact(_: Laboratory) -> list[CheckRow]:
    rows = []
    for device in (SpringDevice(100.0, 0.1), SpringDevice(2000.0, 0.5), SpringDevice(50.0, 20.0)):
        result = swing("impedance", 1e-3, device)
        miss = np.abs(result["plant.subtalar_angle"] - exact(result.time, device)).max()
        rows.append(
            CheckRow(
                f"k = {device.stiffness:g} N·m/rad, c = {device.damping:g} N·m·s/rad", float(miss), 0.0, 1e-12, "rad"
            )
        )
    return rows


def held_torque_grows(_: Laboratory) -> list[CheckRow]:
    rows, device, h = [], SpringDevice(100.0), 2e-5
    for name, share in (("gauss-seidel", 0.5), ("jacobi", 1.5)):
        result = swing(name, h, device, damping=0.0, stop=0.2)
        angle, velocity = result["plant.subtalar_angle"], result["plant.subtalar_velocity"]
        energy = 0.5 * INERTIA * velocity**2 + 0.5 * device.stiffness * angle**2
        rate = math.log(energy[-1] / energy[0]) / (2 * result.time[-1])
        expected = share * device.stiffness * h / (2 * INERTIA)
        rows.append(CheckRow(name, rate, expected, 0.03 * expected, "1/s"))
    return rows


def energy_of_an_undamped_pair(_: Laboratory) -> list[CheckRow]:
    """Nothing takes energy away: what is missing at the end was lost by the coupling."""
    device = SpringDevice(100.0)
    result = swing("impedance", 5e-4, device, damping=0.0, stop=0.2)
    angle, velocity = result["plant.subtalar_angle"], result["plant.subtalar_velocity"]
    energy = 0.5 * INERTIA * velocity**2 + 0.5 * device.stiffness * angle**2
    return [CheckRow("energy at the end over that at the start", float(energy[-1] / energy[0]), 1.0, 1e-10)]


def stated_error(_: Laboratory) -> list[CheckRow]:
    """The coupling error that a run states falls with the step at the scheme's own order."""
    rows, device = [], SpringDevice(50.0, 0.05, 2e4)
    for name, expected in (("jacobi", 1), ("gauss-seidel", 1), ("gauss-seidel-extrapolated", 2), ("impedance", 2)):
        coarse, fine = (swing(name, h, device, DAMPING).coupling_error or math.nan for h in (4e-4, 1e-4))
        rows.append(CheckRow(name, math.log(coarse / fine) / math.log(4), expected, 0.25))
    return rows


def monolithic(laboratory: Laboratory, quantity: str) -> list[CheckRow]:
    """The coupled brace against the same brace evaluated inside the plant at every step of its integrator."""
    rows = []
    for name, scale in CASES:
        coupled = laboratory.run(name, {"brace.angle_scale": scale})
        inside = laboratory.run(
            name, {"brace.angle_scale": scale, "brace.torque_scale": 0.0, "plant.internal_brace_angle_scale": scale}
        )
        label = f"{name}, angle scale {scale:g}"
        if quantity == "peak":
            rows.append(CheckRow(label, coupled.metrics[PEAK], inside.metrics[PEAK], 0.05, "deg"))
        elif quantity == "moment":
            ours, truth = (float(r["plant.brace_subtalar_moment"].max()) for r in (coupled, inside))
            rows.append(CheckRow(label, ours, truth, 0.01 * truth, "N·m"))
        else:
            rows.append(CheckRow(label, 100 * (coupled.coupling_error or math.nan), 0.0, 1.0, "%"))
    return rows


def divided_steps(laboratory: Laboratory) -> list[CheckRow]:
    """Gauss-Seidel with steps divided where the residual energy exceeds 1 %, from two steps on: accuracy by error
    control alone."""
    coupled = scenario("incline30_brace", {"brace.angle_scale": 2.4})
    inside = laboratory.run(
        "incline30_brace",
        {"brace.angle_scale": 2.4, "brace.torque_scale": 0.0, "plant.internal_brace_angle_scale": 2.4},
    )
    rows = []
    for step in ("1 ms", "0.5 ms"):
        run = laboratory.land(coupled.with_master("gauss-seidel", step, adaptive="1 %"))
        rows.append(CheckRow(f"steps of {step} and less", run.metrics[PEAK], inside.metrics[PEAK], 0.05, "deg"))
    return rows


def brace_energy(laboratory: Laboratory) -> list[CheckRow]:
    """Work of the paper's brace along the landing against the energy that its own equation stores."""
    result = laboratory.run("incline30_brace", step="0.1 ms")
    work = 0.0
    for axis in ("rotation_x", "rotation_y", "rotation_z"):
        torque, angle = result[f"brace.{axis}_torque"], result[f"plant.{axis}_angle"]
        work += -float(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle)))
    stored = result["brace.stored_energy"]
    return [
        CheckRow(
            "work taken up by the brace", work, float(stored[-1] - stored[0]), 1e-3 * float(np.abs(stored).max()), "J"
        )
    ]


DOMAIN = {  # low, high of the inputs over which the numerics must hold
    "plant.talocrural_angle_at_contact": (math.radians(-49), math.radians(-19)),
    "plant.subtalar_angle_at_contact": (math.radians(-15), math.radians(15)),
    "plant.drop_height": (0.1, 0.45),
    "plant.contact_dissipation": (2.0, 8.0),
    "plant.contact_modulus": (35e6, 65e6),
    "plant.platform_incline": (0.0, math.radians(30)),
}


def tolerance_over_the_domain(laboratory: Laboratory) -> list[CheckRow]:
    """Corners and seeded points; convergence at the mean alone hides failures."""
    low, high = np.array(list(DOMAIN.values())).T
    count = 12 if laboratory.quick else 120
    rng = np.random.default_rng(20211208)
    corners = rng.integers(0, 2, (count // 2, len(low))).astype(float)
    points = low + (high - low) * np.vstack([corners, rng.random((count - len(corners), len(low)))])
    rows = []
    for pose in ("published", "touching"):
        usual = scenario("incline30", {"plant.initial_pose": pose})
        worst = 0.0
        with usual.open() as ours, usual.override("plant.tolerance", 2.5e-5).open() as tight:
            for point in points:
                inputs = dict(zip(DOMAIN, point.tolist(), strict=True))
                one, two = ours.run(inputs), tight.run(inputs)
                worst = max(worst, abs(one.metrics.get(PEAK, math.inf) - two.metrics.get(PEAK, math.inf)))
        rows.append(CheckRow(f"largest change, {count} inputs, pose {pose}", worst, 0.0, 0.1, "deg"))
    return rows


def step_at_the_means(laboratory: Laboratory) -> list[CheckRow]:
    return [
        CheckRow(
            name,
            laboratory.run(name).metrics[PEAK],
            laboratory.run(name, {"plant.tolerance": 2e-4}, step="0.25 ms").metrics[PEAK],
            0.2,
            "deg",
        )
        for name in laboratory.figures["base_cases"]["touching"]
    ]


CLOSED_FORM = "closed form of a split damped oscillator (foot of 0.005 kg·m², device)"
INSIDE = "the same brace evaluated inside the plant at every step of its integrator"


CHECKS = (
    Check(
        "code-01",
        "Order of convergence of the coupling schemes",
        "a fitted slope over four halvings scatters by about 0.05",
        CLOSED_FORM,
        orders,
    ),
    Check(
        "code-02",
        "Impedance hand-over is of second order for a cubic device",
        "as code-01",
        CLOSED_FORM,
        order_of_impedance,
    ),
    Check(
        "code-03",
        "Impedance hand-over is exact for a linear device",
        "rounding of a hundred matrix products; angles are of 0.1 rad",
        CLOSED_FORM,
        impedance_is_exact,
    ),
    Check(
        "code-04",
        "A held torque grows like a damping of -k h/2 (Gauss-Seidel), -3 k h/2 (Jacobi)",
        "the growth rate is the first term of a series in h; the next is of relative size h times the frequency, "
        "0.3 %, ten times that is allowed",
        "closed form",
        held_torque_grows,
    ),
    Check(
        "code-05",
        "Energy of an undamped pair under impedance hand-over",
        "rounding over 400 steps",
        "conservation of energy",
        energy_of_an_undamped_pair,
    ),
    Check(
        "code-06",
        "The coupling error stated by a run falls at the scheme's order",
        "two steps only, so a quarter of an order",
        "closed form",
        stated_error,
    ),
    Check(
        "coupling-01",
        "Peak subtalar angle, brace as an FMU against brace inside the plant",
        "the bound of 0.05 deg: a quarter of the scatter of the published records' rounding and OpenSim's numerics",
        INSIDE,
        lambda laboratory: monolithic(laboratory, "peak"),
    ),
    Check(
        "coupling-02",
        "Peak moment of the brace, FMU against inside the plant",
        "the bound of 1 %: torque suffers more than the peak angle",
        INSIDE,
        lambda laboratory: monolithic(laboratory, "moment"),
    ),
    Check(
        "coupling-03",
        "Coupling error stated by the default scheme",
        "below 1 % of the exchanged energy the peak angle is within 0.05 deg (coupling-01)",
        "residual energy, Sadjina et al. 2017",
        lambda laboratory: monolithic(laboratory, "error"),
    ),
    Check(
        "coupling-04",
        "Energy that the brace takes up along a landing",
        "trapezoid rule at 0.1 ms: 0.1 % of the largest stored energy",
        "potential of the brace's polynomials",
        brace_energy,
    ),
    Check(
        "coupling-05",
        "Peak subtalar angle, Gauss-Seidel with adaptive communication steps",
        "the bound of 0.05 deg of coupling-01; without dividing its steps the scheme misses by 0.14 deg at 1 ms",
        INSIDE,
        divided_steps,
    ),
    Check(
        "numerics-01",
        "Peaks against a hundredfold tighter integrator tolerance, over the whole domain of the inputs",
        "the bound of 0.1 deg, of the size of the published records' rounding",
        "the same landing at tolerance 2.5e-5",
        tolerance_over_the_domain,
    ),
    Check(
        "numerics-02",
        "Peaks at the study means against half the step and a twelfth of the tolerance",
        "the bound of 0.2 deg: a twentieth of the least standard deviation over a study's inputs (1 deg)",
        "the same landing, finer",
        step_at_the_means,
    ),
)
