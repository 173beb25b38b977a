"""Braces by the hundred, from one library (tests/sources/campaign.c): what differs stands in their descriptions."""

from __future__ import annotations

import math
import platform
import subprocess
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sprain_cosim.contract import AXES
from sprain_cosim.literature import ORTHOSES
from tests.native import HEADERS, SOURCES

DEG = math.pi / 180
FACTORS = {"rad": 1.0, "deg": DEG, "N.m": 1.0, "N.mm": 1e-3}
BASES = {
    "rad": 'rad="1"',
    "deg": f'rad="1" factor="{DEG!r}"',
    "rad/s": 'rad="1" s="-1"',
    "deg/s": f'rad="1" s="-1" factor="{DEG!r}"',
    "N.m": 'kg="1" m="2" s="-2"',
    "N.mm": 'kg="1" m="2" s="-2" factor="0.001"',
}
REACHED = ("subtalar", "inversion", "internal_rotation", "rotation_x")  # on these a landing turns by 30 deg and more
WRONG = ("sign", "angle", "torque")  # what may be wrong


@dataclass(frozen=True)
class Device:
    """A brace and what is said of it.

    axes       of its torques
    stiffness  [N.m/rad]; damping [N.m.s/rad]; slack [rad]; period [s] of its samples, 0 for none
    angle      unit of its angles, and with /s of its velocities, in truth; torque that of its torques
    declared   "description" (the FMU declares the units), "names" (it declares none, its names are the contract's),
               "map" (neither; a mapping file states them)
    wrong      "" or what is wrong of WRONG: its sign, or the stated unit of its angles or torques
    """

    axes: tuple[str, ...]
    stiffness: float
    damping: float
    slack: float
    period: float
    angle: str
    torque: str
    declared: str
    wrong: str

    @property
    def stated(self) -> tuple[str, str]:
        """The units of angles and torques as they are stated, or taken for SI."""
        angle = {"deg": "rad", "rad": "deg"}[self.angle] if self.wrong == "angle" else self.angle
        torque = {"N.mm": "N.m", "N.m": "N.mm"}[self.torque] if self.wrong == "torque" else self.torque
        return angle, torque


def draw(random: np.random.Generator, right: bool) -> Device:
    """A device with the stiffness of measured orthoses; `right` as stated, or not."""
    declared = str(random.choice(["description", "names", "map"]))
    wrong = "" if right else str(random.choice(WRONG))
    angle, torque = str(random.choice(["rad", "deg"])), str(random.choice(["N.m", "N.mm"]))
    if declared == "names":  # taken for SI: what is wrong is another unit in truth
        angle = "deg" if wrong == "angle" else "rad"
        torque = "N.mm" if wrong == "torque" else "N.m"
    axis = str(random.choice([*AXES[:5], *REACHED[3:], "three"]))
    axes = ("dorsiflexion", "inversion", "internal_rotation") if axis == "three" else (axis,)
    return Device(
        axes,
        float(np.exp(random.uniform(*np.log(ORTHOSES)))),
        float(random.choice([0.0, random.uniform(0.05, 0.5)])),
        float(random.choice([0.0, 5.0, 10.0, 15.0])) * DEG,
        float(random.choice([0.0, 0.001, 0.005, 0.010])),
        angle,
        torque,
        declared,
        wrong,
    )


def library(folder: Path) -> Path:
    target = folder / "campaign.so"
    sources = [SOURCES / "campaign.c", SOURCES / "stubs.c"]
    options = ["-shared", "-fPIC", "-O1", "-w", "-DFMI=2", f"-I{HEADERS}"]
    subprocess.run(["gcc", *options, "-o", target, *sources, "-lm"], check=True)
    return target


def fmu(target: Path, device: Device, compiled: Path) -> Path:
    """The device's FMU; its own names where a mapping file leads to the contract."""
    sign = -1.0 if device.wrong == "sign" else 1.0
    unit = FACTORS[device.angle]
    numbers = (sign, device.stiffness, device.damping, device.slack, device.period, unit, unit, FACTORS[device.torque])
    angle, torque = device.stated
    units = {"angle": angle, "velocity": f"{angle}/s", "torque": torque}
    own = device.declared == "map"
    listed = ""
    for k, axis in enumerate(device.axes):
        for j, kind in enumerate(units):
            said = f' unit="{units[kind]}"' if device.declared == "description" else ""
            start = "" if kind == "torque" else ' start="0.0"'
            listed += (
                f'<ScalarVariable name="{f"{kind}{k}" if own else f"{axis}_{kind}"}" valueReference="{3 * k + j}" '
                f'causality="{"output" if kind == "torque" else "input"}"><Real{said}{start}/></ScalarVariable>'
            )
    definitions = ""
    if device.declared == "description":
        found = "".join(f'<Unit name="{u}"><BaseUnit {BASES[u]}/></Unit>' for u in units.values())
        definitions = f"<UnitDefinitions>{found}</UnitDefinitions>"
    outputs = "".join(f'<Unknown index="{3 * k + 3}"/>' for k in range(len(device.axes)))
    experiment = f'<DefaultExperiment stepSize="{device.period!r}"/>' if device.period else ""
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="campaign" guid="{",".join(map(repr, numbers))}">
  <CoSimulation modelIdentifier="campaign" canHandleVariableCommunicationStepSize="{str(not device.period).lower()}"/>
  {definitions}{experiment}<ModelVariables>{listed}</ModelVariables>
  <ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    place = {"aarch64": "aarch64-linux"}.get(platform.machine(), "linux64")
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(compiled, f"binaries/{place}/campaign.so")
    return target


def mapping(target: Path, device: Device, units: tuple[str, str] | None = None) -> Path:
    """The mapping file of a device with names of its own, or of one that is asked for its units; `units` of angles and
    torques, as stated without."""
    angle, torque = units or device.stated
    own = device.declared == "map"
    inputs, outputs = list[str](), list[str]()
    for k, axis in enumerate(device.axes):
        for kind, unit in (("angle", angle), ("velocity", "?" if angle == "?" else f"{angle}/s")):
            name = f"{kind}{k}" if own else f"{axis}_{kind}"
            inputs.append(f'{axis}_{kind} = {{ to = "{name}", unit = "{unit}" }}')
        name = f"torque{k}" if own else f"{axis}_torque"
        outputs.append(f'{axis}_torque = {{ from = "{name}", unit = "{torque}" }}')
    target.write_text("\n".join(["[inputs]", *inputs, "[outputs]", *outputs, ""]))
    return target
