"""Do our own FMUs keep to FMI? Description, reset, saved states, honoured steps, and the brace contract."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ...brace.check import check_brace
from ...brace.new import build_brace, new_brace
from ...cosim.schedule import RECORD
from ...fmu.build import build_fmu
from ...fmu.component import Component
from ...fmu.driver import Driver
from ...fmu.instance import Values
from ...scenario import load_scenario
from ...shipped import FMI3, FMUS, SOURCES, has_library_here, shipped_fmus
from ..check import Check, CheckRow
from ..laboratory import Laboratory, scenario

PEAK = "peak_subtalar_angle_deg"
STEP = 5e-4


def component(name: str) -> Component:
    return Component.read(name, FMUS / f"{name}.fmu")


def fmus() -> list[str]:
    """Those that ship and have a library for this system."""
    return [name for name in shipped_fmus() if has_library_here(name)]


def braces() -> list[str]:
    return [name for name in fmus() if name.startswith("brace_")]


def moved(driver: Driver, k: int) -> Values:
    """Step `k` with all inputs moving: (outputs,)."""
    wave = 0.05 * np.sin(0.3 * k + np.arange(len(driver.inputs)))
    driver.step(STEP, dict(zip(driver.inputs, wave.tolist(), strict=True)), k * STEP)
    return driver.output_values.copy()


def complaints(_: Laboratory) -> list[CheckRow]:
    names = [name + version for name in fmus() for version in ("", FMI3)]
    return [CheckRow(name, float(len(component(name).complaints())), 0, 0, "complaints") for name in names]


def units(_: Laboratory) -> list[CheckRow]:
    """Inputs, outputs and parameters without a unit, and inputs and parameters without a start value."""
    rows = []
    for name in fmus():
        bad = [
            c
            for c in component(name).connectors.values()
            if (c.unit is None and not c.items) or (c.causality in ("input", "parameter") and c.start is None)
        ]
        rows.append(CheckRow(name, float(len(bad)), 0, 0, "variables"))
    return rows


def reset_instances(_: Laboratory) -> list[CheckRow]:
    """Largest difference of any output over 20 steps between a reset instance and a fresh one."""
    rows = []
    for name in fmus():
        chosen = component(name)
        with Driver(chosen) as driver:
            driver.start(stop=1.0)
            first = np.array([moved(driver, k) for k in range(20)])
            driver.start(stop=1.0)
            again = np.array([moved(driver, k) for k in range(20)])
        rows.append(CheckRow(name, float(np.abs(first - again).max()), 0, 0))
    return rows


def landings_repeat(_: Laboratory) -> list[CheckRow]:
    """The same landing after others in one session, and in a session of its own."""
    rows = []
    for name in ("incline30", "incline30_mixed"):
        chosen = scenario(name)
        with chosen.open() as session:
            first = session.run().values
            session.run({"plant.drop_height": 0.4, "plant.subtalar_angle_at_contact": 0.1})
            again = session.run().values
        with chosen.open() as other:
            fresh = other.run().values
        rows.append(CheckRow(f"{name}, again in the session", float(np.abs(first - again).max()), 0, 0))
        rows.append(CheckRow(f"{name}, in a fresh session", float(np.abs(first - fresh).max()), 0, 0))
    return rows


def saved_states(_: Laboratory) -> list[CheckRow]:
    """After going back to a saved state the same steps give the same outputs."""
    rows = []
    for name in fmus():
        chosen = component(name)
        if not chosen.capabilities.state:
            continue
        with Driver(chosen) as driver:
            driver.start(stop=1.0)
            for k in range(10):
                moved(driver, k)
            state = driver.save_state()
            first = np.array([moved(driver, k) for k in range(10, 30)])
            driver.restore_state(state)
            again = np.array([moved(driver, k) for k in range(10, 30)])
            driver.free_state(state)
        rows.append(CheckRow(name, float(np.abs(first - again).max()), 0, 0))
    return rows


def honoured_steps(laboratory: Laboratory) -> list[CheckRow]:
    """The plant alone, no controller activity: where it is at 150 ms does not depend on how often it is asked."""
    rows = []
    truth = laboratory.run("incline30", {"plant.tolerance": 1e-5})
    for step in ("0.1 ms", "1 ms", "5 ms"):
        run = laboratory.run("incline30", step=step)
        rows.append(
            CheckRow(
                f"angle at 150 ms, steps of {step}",
                math.degrees(run["plant.subtalar_angle"][-1]),
                math.degrees(truth["plant.subtalar_angle"][-1]),
                0.1,
                "deg",
            )
        )
        size = _seconds(step)
        rows.append(CheckRow(f"exchanges, steps of {step}", float(run.exchanges), round(0.15 / size), 0))
        record = round(0.15 / min(size, RECORD)) + 1
        rows.append(CheckRow(f"points on record, steps of {step}", float(len(run.time)), record, 0))
    return rows


def _seconds(step: str) -> float:
    return float(step.removesuffix(" ms")) * 1e-3


def contract(_: Laboratory) -> list[CheckRow]:
    return [
        CheckRow(name, float(len(check_brace(FMUS / f"{name}.fmu").problems)), 0, 0, "problems") for name in braces()
    ]


def rebuilt(_: Laboratory) -> list[CheckRow]:
    """1 where building from the sources gives the shipped file to the byte."""
    sources, rows = SOURCES, []
    with TemporaryDirectory() as folder:
        for name in shipped_fmus():
            target = Path(folder) / f"{name}.fmu"
            build_fmu(sources / name, target)
            same = (
                hashlib.sha256(target.read_bytes()).digest()
                == hashlib.sha256((FMUS / target.name).read_bytes()).digest()
            )
            rows.append(CheckRow(name, float(same), 1, 0))
    return rows


def compiled_brace(laboratory: Laboratory) -> list[CheckRow]:
    """The template in C is the paper's brace: built here, it must fit and give the landing of ours in Python."""
    with TemporaryDirectory() as folder:
        project = Path(folder) / "compiled"
        new_brace(project, "c")
        fmu = build_brace(project, Path(folder) / "compiled.fmu")
        problems = float(len(check_brace(fmu).problems))
        run = laboratory.land(load_scenario("incline30_brace").replace_fmu("brace", fmu))
    ours = laboratory.run("incline30_brace", {"brace.angle_scale": run.parameters["brace.angle_scale"]})
    return [
        CheckRow("problems of the contract", problems, 0, 0),
        CheckRow("peak subtalar angle", run.metrics[PEAK], ours.metrics[PEAK], 1e-9, "deg"),
    ]


def isolated_landing(laboratory: Laboratory) -> list[CheckRow]:
    """Largest difference of any signal between FMUs in this process and each in a process of its own."""
    here = laboratory.run("incline30_brace")
    return [
        CheckRow(
            "incline30_brace",
            float(np.abs(laboratory.land(scenario("incline30_brace").isolated()).values - here.values).max()),
            0,
            0,
        )
    ]


def versions_of_fmi(laboratory: Laboratory) -> list[CheckRow]:
    """Largest difference of any signal between the landing in FMI 2.0 and in FMI 3.0."""
    rows = []
    for name in ("incline30_brace", "incline30_mixed"):
        chosen = scenario(name)
        for part, fmu in chosen.fmus.items():
            chosen = chosen.replace_fmu(part, FMUS / f"{fmu.stem}{FMI3}.fmu")
        off = np.abs(laboratory.land(chosen).values - laboratory.run(name).values)
        rows.append(CheckRow(name, float(off.max()), 0, 0))
    return rows


BITS = "to the bit: nothing random, the same operations in the same order"


CHECKS = (
    Check(
        "fmi-01",
        "fmpy's validation of our FMUs",
        "none is allowed",
        "FMI 2.0.4 and 3.0, as fmpy checks them",
        complaints,
    ),
    Check(
        "fmi-02",
        "Every variable has a unit, every input and parameter a start value",
        "none may lack them",
        "FMI 2.0.4, 2.2.7",
        units,
    ),
    Check("fmi-03", "Reset equals a fresh instance", BITS, "FMI 2.0.4, fmi2Reset", reset_instances),
    Check("fmi-04", "A landing repeats after others, and in another session", BITS, "by construction", landings_repeat),
    Check("fmi-05", "A restored state continues as it did", BITS, "FMI 2.0.4, fmi2SetFMUstate", saved_states),
    Check(
        "fmi-06",
        "Communication steps are honoured",
        "the integrator's own error, 0.1 deg (numerics-01)",
        "the plant at tolerance 1e-5",
        honoured_steps,
    ),
    Check("fmi-07", "Our braces fit the brace contract", "none is allowed", "docs/brace-contract.md", contract),
    Check(
        "fmi-08",
        "Building an FMU again gives the same bytes",
        "to the byte",
        "by construction",
        rebuilt,
        needs=("clone",),
    ),
    Check(
        "fmi-09",
        "The paper's brace compiled from C",
        "rounding of the same formula",
        "brace_bushing, in Python",
        compiled_brace,
        needs=("compiler",),
    ),
    Check(
        "fmi-10",
        "FMUs in processes of their own give the same landing",
        BITS,
        "the same FMUs in this process",
        isolated_landing,
    ),
    Check("fmi-11", "FMI 2.0 and FMI 3.0 give the same landing", BITS, "the same models in FMI 2.0", versions_of_fmi),
)
