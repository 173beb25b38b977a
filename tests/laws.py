"""FMUs of tests/sources/laws.c: a sampled brace and a foreign controller, FMI 2.0 co-simulation in C."""

from __future__ import annotations

import platform
import subprocess
import zipfile
from pathlib import Path

from tests.native import HEADERS, SOURCES

WHEN = ("at once", "end", "step")
UNITS = {
    "rad": 'rad="1"',
    "rad/s": 'rad="1" s="-1"',
    "N.m": 'kg="1" m="2" s="-2"',
    "N.m/rad": 'kg="1" m="2" s="-2" rad="-1"',
    "N.m.s/rad": 'kg="1" m="2" s="-1" rad="-1"',
    "s": 's="1"',
    "1": "",
}
EVERTORS = ("ext_dig", "per_brev", "per_long", "per_tert")
INVERTORS = ("ext_hal", "flex_dig", "flex_hal", "tib_post")

Variable = tuple[str, str, str, float | None]  # name, causality, unit, start


def sampled(target: Path, axis: str, k: float, c: float, period: float, fixed: bool, saves: bool = True) -> Path:
    """Torque -k angle - c velocity [SI] about `axis`, sampled every `period` [s]; `fixed`: it declares that as its
    fixed step, else it takes any step."""
    variables: list[Variable] = [
        (f"{axis}_angle", "input", "rad", 0.0),
        (f"{axis}_velocity", "input", "rad/s", 0.0),
        (f"{axis}_torque", "output", "N.m", None),
        ("k", "parameter", "N.m/rad", k),
        ("c", "parameter", "N.m.s/rad", c),
        ("period", "parameter", "s", period),
    ]
    macros = f"-DSTART_VALUES={{0,0,0,{k!r},{c!r},{period!r}}}"
    return _compiled(target, variables, ("-DLAW=SAMPLED", "-DWHEN=END", macros), period if fixed else None, saves)


BRACES = ("STRAP", "SLACK", "THICK", "DAHL", "CABLE", "LATE")  # right in sign and size; the others of laws.c are not


def brace(target: Path, law: str, saves: bool = False, **macros: float) -> Path:
    """A law of laws.c about the subtalar axis, computed in a step only; `macros`: numbers of the law."""
    variables: list[Variable] = [
        ("subtalar_angle", "input", "rad", 0.0),
        ("subtalar_velocity", "input", "rad/s", 0.0),
        ("subtalar_torque", "output", "N.m", None),
    ]
    return _compiled(target, variables, _given(law, macros), None, saves)


def _given(law: str, macros: dict[str, float]) -> tuple[str, ...]:
    return (f"-DLAW={law}", "-DWHEN=STEP", "-DSTART_VALUES={0}", *(f"-D{k}={v!r}" for k, v in macros.items()))


def controller(target: Path, when: str = "at once", gain: float = 0.0, base: float = 0.0) -> Path:
    """Excitations base + gain * max(0, stretch velocity), without delay; computed `when`."""
    muscles = (*EVERTORS, *INVERTORS)
    variables: list[Variable] = [(f"{m}_stretch_velocity", "input", "1", 0.0) for m in muscles]
    variables += [(f"{m}_excitation", "output", "1", None) for m in muscles]
    variables += [("gain", "parameter", "1", gain), ("base", "parameter", "1", base)]
    name = ("AT_ONCE", "END", "STEP")[WHEN.index(when)]
    macros = f"-DSTART_VALUES={{{'0,' * 16}{gain!r},{base!r}}}"
    return _compiled(target, variables, ("-DLAW=CONTROLLER", f"-DWHEN={name}", macros), None, True)


def _compiled(
    target: Path, variables: list[Variable], macros: tuple[str, ...], fixed: float | None, saves: bool
) -> Path:
    library = target.with_suffix(".so")
    sources = [SOURCES / "laws.c", SOURCES / "stubs.c"]
    command = [
        "gcc",
        "-shared",
        "-fPIC",
        "-O1",
        "-w",
        "-DFMI=2",
        *macros,
        f"-I{HEADERS}",
        "-o",
        library,
        *sources,
        "-lm",
    ]
    subprocess.run(command, check=True)
    used = dict.fromkeys(unit for _, _, unit, _ in variables)
    units = "".join(f'<Unit name="{u}"><BaseUnit {UNITS[u]}/></Unit>' for u in used)
    listed = "".join(
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="{causality}" '
        f'variability="{"fixed" if causality == "parameter" else "continuous"}">'
        f'<Real unit="{unit}"{"" if start is None else f" start={chr(34)}{start!r}{chr(34)}"}/></ScalarVariable>'
        for k, (n, causality, unit, start) in enumerate(variables)
    )
    outputs = "".join(
        f'<Unknown index="{k}"/>' for k, (_, causality, _, _) in enumerate(variables, 1) if causality == "output"
    )
    experiment = "" if fixed is None else f'<DefaultExperiment stepSize="{fixed!r}"/>'
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="laws" guid="{{laws}}" generationTool="another tool">
  <CoSimulation modelIdentifier="laws" canHandleVariableCommunicationStepSize="{str(fixed is None).lower()}"
    canGetAndSetFMUstate="{str(saves).lower()}"/>
  <UnitDefinitions>{units}</UnitDefinitions>{experiment}<ModelVariables>{listed}</ModelVariables>
  <ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    folder = {"aarch64": "aarch64-linux"}.get(platform.machine(), "linux64")
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{folder}/laws.so")
    return target
