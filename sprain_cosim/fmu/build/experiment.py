"""A reference experiment for every device: what it answers to moving inputs, computed by its functions as plain Python,
which share nothing with the compiled code but the source.

Layout and format as fmu/reference.py reads them. Every variable is in its own unit; inputs are set at the beginning of
a communication step and hold over it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from posixpath import basename, dirname
from typing import Any
from xml.etree import ElementTree as ET

from ..reference import MANIFEST, STANDARD, TYPES, VERSION
from .device import Device
from .interpreter import Interpreted

NAME = "smoke-test"
STEP, STEPS = 0.002, 40  # s; of the device's own EXPERIMENT where it has one
SIZES = {"rad": 0.3, "N.m": 5.0, "1": 0.2, "N": 500.0, "N.m/rad": 10.0, "N.m.s/rad": 0.1}  # of an input, by its unit
BOTH_WAYS = ("rad", "N.m")  # the others stay positive
MANIFEST_SPACE = "http://fmi-standard.org/fmi-ls-manifest"
PARAMETER_SPACE = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"


def experiment(device: Device) -> dict[str, bytes]:
    """{path in the FMU: content}; `device` has plain functions. Empty where its law stops on the way, or needs what
    plain Python does not have."""
    step, steps = float(device.experiment.get("step", STEP)), int(device.experiment.get("steps", STEPS))
    parameters: Mapping[str, float] = device.experiment.get("parameters", {})
    times = [_rounded(k * step) for k in range(steps + 1)]
    inputs = [v for v in device.variables if v["causality"] == "input"]
    moves = [_moves(inputs, time, steps * step) for time in times]
    outputs = [v["name"] for v in device.variables if v["causality"] == "output"]
    try:
        answers = _answers(device, parameters, times, moves, outputs)
    except Exception:  # a reason to stop, or an error, of the device's own
        return {}
    names = [v["name"] for v in inputs]
    files = {
        basename(MANIFEST): _manifest(),
        f"{NAME}.exp": _experiments(times[-1], step, bool(parameters)),
        f"{NAME}-in.csv": _table(names, times, ([move[n] for n in names] for move in moves)),
        f"{NAME}-ref.csv": _table(outputs, times, answers),
    }
    if parameters:
        files[f"{NAME}.ssv"] = _parameter_set(parameters)
    return {f"{dirname(MANIFEST)}/{name}": text.encode() for name, text in files.items()}


def _answers(
    device: Device,
    parameters: Mapping[str, float],
    times: Sequence[float],
    moves: Sequence[Mapping[str, float]],
    outputs: Sequence[str],
) -> list[list[float]]:
    run = Interpreted(device)
    for name, value in {**parameters, **moves[0]}.items():
        run[name] = value
    run.initialise(times[0])
    rows = [[run[name] for name in outputs]]
    for k in range(len(times) - 1):
        for name, value in moves[k].items():
            run[name] = value
        run.step(times[k], times[k + 1] - times[k])
        rows.append([run[name] for name in outputs])
    if not all(math.isfinite(value) for row in rows for value in row):
        raise ValueError("not finite")
    return rows


def _moves(inputs: Sequence[Mapping[str, Any]], time: float, whole: float) -> dict[str, float]:
    """{input: value}: a sine each, one after the other; the velocity of an angle is its derivative."""
    values = {}
    phases = {v["name"]: k / max(1, len(inputs)) for k, v in enumerate(inputs)}
    for v in inputs:
        name, unit = v["name"], v["unit"]
        angle = name.removesuffix("_velocity") + "_angle"
        turn = 2.0 * math.pi * (time / whole + phases[angle if angle in phases else name])
        if unit == "rad/s":
            values[name] = SIZES["rad"] * 2.0 * math.pi / whole * math.cos(turn)
        elif unit in BOTH_WAYS:
            values[name] = SIZES[unit] * math.sin(turn)
        else:
            values[name] = 0.5 * SIZES.get(unit, 0.0) * (1.0 + math.sin(turn))
    return {name: _rounded(value) for name, value in values.items()}


def _rounded(value: float) -> float:
    """As the tables show it: no digit that depends on the machine's C library."""
    return float(f"{value:.12g}")


def _table(names: Sequence[str], times: Sequence[float], rows: Iterable[Sequence[float]]) -> str:
    lines = [",".join(["time", *names])]
    lines += [",".join(f"{value:.12g}" for value in (time, *row)) for time, row in zip(times, rows, strict=True)]
    return "\n".join(lines) + "\n"


def _manifest() -> str:
    ET.register_namespace("fmi-ls", MANIFEST_SPACE)
    root = ET.Element(
        "fmiReferences",
        {
            f"{{{MANIFEST_SPACE}}}fmi-ls-name": STANDARD,
            f"{{{MANIFEST_SPACE}}}fmi-ls-version": VERSION,
            f"{{{MANIFEST_SPACE}}}fmi-ls-description": "Layered Standard providing information on related files "
            "included in an FMU.",
        },
    )
    ET.SubElement(
        root,
        "Related",
        type=TYPES[0],
        source=f"{NAME}.exp",
        role="experiment/smoke-test",
        description="Moving inputs, and the outputs of the same source run as plain Python",
    )
    return _text(root)


def _experiments(stop: float, step: float, parameters: bool) -> str:
    root = ET.Element("Experiments", name=NAME, description="Smoke test of the FMU in a simulation environment")
    entry = ET.SubElement(root, "Experiment", name=NAME, tolerance="1e-09")
    ET.SubElement(entry, "TransientSimulation", startTime="0", stopTime=f"{stop:.12g}", stepSize=f"{step:.12g}")
    if parameters:
        ET.SubElement(entry, "Parameters", source=f"{NAME}.ssv")
    ET.SubElement(entry, "Stimuli", source=f"{NAME}-in.csv")
    ET.SubElement(entry, "References", source=f"{NAME}-ref.csv")
    return _text(root)


def _parameter_set(parameters: Mapping[str, float]) -> str:
    ET.register_namespace("ssv", PARAMETER_SPACE)
    root = ET.Element(f"{{{PARAMETER_SPACE}}}ParameterSet", version="1.0", name=NAME)
    listed = ET.SubElement(root, f"{{{PARAMETER_SPACE}}}Parameters")
    for name, value in parameters.items():
        parameter = ET.SubElement(listed, f"{{{PARAMETER_SPACE}}}Parameter", name=name)
        ET.SubElement(parameter, f"{{{PARAMETER_SPACE}}}Real", value=repr(float(value)))
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
