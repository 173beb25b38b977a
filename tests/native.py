"""FMUs compiled from the C sources of tests/sources, with gcc and the FMI headers that fmpy ships."""

from __future__ import annotations

import platform
import subprocess
import zipfile
from pathlib import Path

import fmpy

SOURCES = Path(__file__).parent / "sources"
HEADERS = Path(fmpy.__file__).parent / "c-code"
FAULTS = [
    "none",
    "segfault",
    "abort",
    "exit",
    "hang_step",
    "error",
    "fatal",
    "discard",
    "nan",
    "positive_infinity",
    "negative_infinity",
    "huge",
    "flood",
    "leak",
    "change_folder",
    "change_locale",
    "fork",
    "hang_start",
    "hang_reset",
]
SUBTALAR = """
    <ScalarVariable name="subtalar_angle" valueReference="0" causality="input" variability="continuous"><Real unit="rad" start="0"/></ScalarVariable>
    <ScalarVariable name="subtalar_torque" valueReference="1" causality="output" variability="continuous"><Real unit="N.m"/></ScalarVariable>
    <ScalarVariable name="stiffness" valueReference="2" causality="parameter" variability="fixed"><Real unit="N.m/rad" start="20"/></ScalarVariable>
    <ScalarVariable name="fault" valueReference="3" causality="parameter" variability="fixed"><Real start="0" min="0" max="18"/></ScalarVariable>
"""


def compile_fmu(target: Path, source: str = "faulty", variables: str = SUBTALAR, outputs: tuple[int, ...] = (2,)) -> Path:
    """An FMI 2.0 co-simulation FMU of tests/sources/`source`.c; `outputs` are the 1-based indices of the output variables."""
    library = target.with_suffix(".so")
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-w", f"-I{HEADERS}", "-o", library, SOURCES / f"{source}.c", "-lm"], check=True)
    structure = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{source}" guid="{{{source}}}" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{source}" canHandleVariableCommunicationStepSize="true" canBeInstantiatedOnlyOncePerProcess="false"/>
  <UnitDefinitions>
    <Unit name="rad"><BaseUnit rad="1"/></Unit>
    <Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>
    <Unit name="N.m/rad"><BaseUnit kg="1" m="2" s="-2" rad="-1"/></Unit>
  </UnitDefinitions>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure><Outputs>{structure}</Outputs><InitialUnknowns>{structure}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    folder = {"x86_64": "linux64", "aarch64": "aarch64-linux"}.get(platform.machine(), "linux64")
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{folder}/{source}.so")
    return target
