"""FMUs compiled from the C sources of tests/sources, with gcc and the FMI headers that fmpy ships."""

from __future__ import annotations

import math
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
    "spin",
    "gorge",
    "hang_load",
]
SUBTALAR = """
    <ScalarVariable name="subtalar_angle" valueReference="0" causality="input" variability="continuous"><Real unit="rad" start="0"/></ScalarVariable>
    <ScalarVariable name="subtalar_torque" valueReference="1" causality="output" variability="continuous"><Real unit="N.m"/></ScalarVariable>
    <ScalarVariable name="stiffness" valueReference="2" causality="parameter" variability="fixed"><Real unit="N.m/rad" start="20"/></ScalarVariable>
    <ScalarVariable name="fault" valueReference="3" causality="parameter" variability="fixed"><Real start="0" min="0" max="20"/></ScalarVariable>
"""


MISCHIEF = [
    "none",
    "fork_once",
    "fork_stays",
    "kill_parent",
    "stop_parent",
    "leave_session",
    "write_descriptors",
    "round_up",
    "trap",
    "flush_to_zero",
    "umask",
    "environment",
    "folder",
    "locale",
    "handler",
    "thread",
    "own_file",
    "socket",
    "steal",
    "exit_in_step",
    "exit_in_reset",
    "unknown_status",
    "negative_status",
    "close_descriptors",
    "stop_itself",
    "daemon",
    "exit_in_free",
    "crash_in_free",
    "exit_in_instantiate",
    "crash_in_instantiate",
    "exit_in_start",
    "hang_in_instantiate",
    "licence_server",
    "own_server",
    "interpreter",
    "licence_file",
]
HARMED = (
    SUBTALAR.replace('name="fault"', 'name="mischief"').replace('max="20"', 'max="40"')
    + """
    <ScalarVariable name="seen" valueReference="4" causality="output" variability="continuous"><Real unit="1"/></ScalarVariable>
"""
)


def mischief(target: Path, kind: str = "none", folder: Path | None = None, port: int = 0) -> Path:
    """tests/sources/mischief.c as an FMI 2.0 co-simulation FMU that does a `kind` of harm from the start on; `folder` is
    what it is after, `port` that of the licence server that it asks."""
    macros = (f"-DAT_START={kind.upper()}", f'-DTARGET="{folder}"', f"-DPORT={port}")
    return compile_fmu(target, "mischief", HARMED, (2, 5), macros=macros)


def compile_fmu(
    target: Path,
    source: str = "faulty",
    variables: str = SUBTALAR,
    outputs: tuple[int, ...] = (2,),
    fault: str = "none",
    macros: tuple[str, ...] = (),
) -> Path:
    """An FMI 2.0 co-simulation FMU of tests/sources/`source`.c; `outputs` are the 1-based indices of the output
    variables, `fault` the one that is set from the start."""
    library = target.with_suffix(".so")
    subprocess.run(
        [
            "gcc",
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            f"-DFAULT_AT_START={FAULTS.index(fault)}",
            *macros,
            f"-I{HEADERS}",
            "-o",
            library,
            SOURCES / f"{source}.c",
            "-lm",
        ],
        check=True,
    )
    structure = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{source}" guid="{{{source}}}" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{source}" canHandleVariableCommunicationStepSize="true" canBeInstantiatedOnlyOncePerProcess="false"/>
  <UnitDefinitions>
    <Unit name="rad"><BaseUnit rad="1"/></Unit>
    <Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>
    <Unit name="N.m/rad"><BaseUnit kg="1" m="2" s="-2" rad="-1"/></Unit>
    <Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
    <Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="1"><BaseUnit/></Unit>
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


SPEECH = [
    "silent",
    "informs",
    "warns",
    "fails",
    "controls",
    "unknown",
    "negative",
    "thread",
    "after_free",
    "prints",
    "only_status",
    "many",
    "dies",
]
UNITS = {  # factor to base units and their exponents, as attributes of BaseUnit
    "rad": (1.0, 'rad="1"'),
    "deg": (math.pi / 180, 'rad="1"'),
    "N.m": (1.0, 'kg="1" m="2" s="-2"'),
    "N.mm": (1e-3, 'kg="1" m="2" s="-2"'),
    "lbf.in": (0.45359237 * 9.80665 * 0.0254, 'kg="1" m="2" s="-2"'),
    "N.m/rad": (1.0, 'kg="1" m="2" s="-2" rad="-1"'),
    "1/s": (1.0, 's="-1"'),
    "s": (1.0, 's="1"'),
    "N": (1.0, 'kg="1" m="1" s="-2"'),
    "kN": (1e3, 'kg="1" m="1" s="-2"'),
    "V": (1.0, 'kg="1" m="2" s="-3" A="-1"'),
    "1": (1.0, ""),
}


def device(
    target: Path,
    fmi: int = 2,
    model_exchange: bool = False,
    sign: float = 1.0,
    angle: str = "rad",
    torque: str = "N.m",
    names: tuple[str, str] = ("subtalar_angle", "subtalar_torque"),
    declared: bool = True,
    extra: dict[str, str] | None = None,
    behaviour: dict[str, float] | None = None,
    saves: bool = True,
    attributes: str = "",
    supply: bool = False,
    cables: bool = False,
    speaks: bool = False,
) -> Path:
    """tests/sources/device.c as an FMU of the version and kind; `sign` -1 pushes instead of resisting; `declared` False
    leaves the units out; `behaviour` are macros of the source, `saves`: declares that it saves its state, `attributes`
    further capabilities; `supply`: an input in V at whose 48 V it gives the torque, and in proportion to it; `cables`:
    the outputs medial [N] and lateral [kN], cables on 40 mm whose difference gives the torque; `speaks`: a parameter
    `speech` says what of SPEECH it says."""
    library = target.with_suffix(".so")
    macros = [
        f"-DFMI={fmi}",
        f"-DSIGN={sign}",
        f"-DANGLE_UNIT={UNITS[angle][0]!r}",
        f"-DTORQUE_UNIT={UNITS[torque][0]!r}",
    ]
    macros += ["-DSUPPLIED=48.0"] if supply else []
    macros += ["-DSPEAKS", "-pthread"] if speaks else []
    macros += [f"-D{name}={value}" for name, value in (behaviour or {}).items()]
    subprocess.run(
        [
            "gcc",
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            *macros,
            f"-I{HEADERS}",
            "-o",
            library,
            SOURCES / "device.c",
            SOURCES / "stubs.c",
            "-lm",
        ],
        check=True,
    )
    variables = [  # name, reference, causality, variability, unit, start
        (names[0], 0, "input", "continuous", angle, "0"),
        (names[1], 1, "output", "continuous", torque, None),
        ("stiffness", 2, "parameter", "fixed", "N.m/rad", "20"),
        ("z", 3, "local", "continuous", "rad", "0" if fmi != 2 else None),
        ("der(z)", 4, "local", "continuous", "1/s", None),
        *([("supply", 6, "input", "continuous", "V", "0")] if supply else []),
        *([("medial", 7, "output", "continuous", "N", None)] if cables else []),
        *([("lateral", 8, "output", "continuous", "kN", None)] if cables else []),
        *([("speech", 9, "parameter", "fixed", "1", "0")] if speaks else []),
        *([("time", 5, "independent", "continuous", "s", None)] if fmi == 3 else []),
    ]
    used = sorted({v[4] for v in variables})

    def unit(name: str) -> str:
        return f' unit="{name}"' if declared else ""

    tag = "ModelExchange" if model_exchange else "CoSimulation"
    states = f' canGetAndSetFMU{"State" if fmi == 3 else "state"}="true"' if saves else ""
    states += f" {attributes}"
    handles = "" if model_exchange else ' canHandleVariableCommunicationStepSize="true"'
    if fmi == 1:
        units = "".join(f'<BaseUnit unit="{u}"/>' for u in used)
        listed = "".join(
            f'<ScalarVariable name="{n}" valueReference="{r}" '
            f'causality="{c if c in ("input", "output") else "internal"}"'
            f' variability="{"parameter" if c == "parameter" else "continuous"}">'
            f"<Real{unit(u)}{f' start={chr(34)}{s}{chr(34)}' if s else ''}/></ScalarVariable>"
            for n, r, c, _, u, s in variables
        )
        implementation = (
            ""
            if model_exchange
            else "<Implementation><CoSimulation_StandAlone><Capabilities "
            'canHandleVariableCommunicationStepSize="true"/></CoSimulation_StandAlone></Implementation>'
        )
        body = f"""<fmiModelDescription fmiVersion="1.0" modelName="device" modelIdentifier="device" guid="{{device}}" numberOfContinuousStates="1"
            numberOfEventIndicators="1"><UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{listed}</ModelVariables>
            {implementation}</fmiModelDescription>"""
    else:
        units = "".join(f'<Unit name="{u}"><BaseUnit {UNITS[u][1]} factor="{UNITS[u][0]!r}"/></Unit>' for u in used)
        listed = ""
        for n, r, c, v, u, s in variables:
            start = f' start="{s}"' if s else ""
            derivative = f' derivative="{4 if fmi == 2 else 3}"' if n == "der(z)" else ""
            initial = ' initial="exact"' if n == "z" and s else ""
            common = f'name="{n}" valueReference="{r}" causality="{c}" variability="{v}"{initial}'
            listed += (
                f"<ScalarVariable {common}><Real{unit(u)}{start}{derivative}/></ScalarVariable>"
                if fmi == 2
                else f"<Float64 {common}{unit(u)}{start}{derivative}/>"
            )
        if fmi == 2:
            pulls = "".join(f'<Unknown index="{k}"/>' for k, v in enumerate(variables, 1) if v[1] in (7, 8))
            structure = (
                f'<Outputs><Unknown index="2"/>{pulls}</Outputs><Derivatives><Unknown index="5"/></Derivatives>'
                f'<InitialUnknowns><Unknown index="2"/><Unknown index="4"/><Unknown index="5"/>{pulls}</InitialUnknowns>'
            )
        else:
            pulls = [k for k in (7, 8) if cables]
            structure = "".join(f'<Output valueReference="{k}"/>' for k in (1, *pulls)) + (
                '<ContinuousStateDerivative valueReference="4"/><InitialUnknown valueReference="1"/>'
            )
            structure += "".join(f'<InitialUnknown valueReference="{k}"/>' for k in pulls)
            structure += '<InitialUnknown valueReference="4"/><EventIndicator valueReference="3"/>'
        identity = 'guid="{device}" numberOfEventIndicators="1"' if fmi == 2 else 'instantiationToken="{device}"'
        body = f"""<fmiModelDescription fmiVersion="{fmi}.0" modelName="device" {identity}>
            <{tag} modelIdentifier="device"{handles}{states}/><UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{listed}</ModelVariables>
            <ModelStructure>{structure}</ModelStructure></fmiModelDescription>"""
    machine = (
        {"aarch64": "aarch64-linux"}.get(platform.machine(), "linux64") if fmi < 3 else f"{platform.machine()}-linux"
    )
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", '<?xml version="1.0" encoding="UTF-8"?>\n' + body)
        archive.write(library, f"binaries/{machine}/device.so")
        for name, text in (extra or {}).items():
            archive.writestr(name, text)
    return target


def changed(fmu: Path, target: Path, changes: dict[str, str], extra: dict[str, str] | None = None) -> Path:
    """The FMU with {old: new} in its description, and with more files."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode()
                for before, after in changes.items():
                    assert before in text, before
                    text = text.replace(before, after, 1)
                data = text.encode()
            new.writestr(name, data)
        for name, content in (extra or {}).items():
            new.writestr(name, content)
    return target


QUIRKS = [
    "plain",
    "late",
    "refuses",
    "silent",
    "stale_reset",
    "stale_state",
    "memory",
    "extra",
    "preload",
    "plastic",
    "damper",
    "snap",
    "ball",
    "once",
    "nearly",
    "bad_reset",
]


def quirk(target: Path, name: str, sign: float = 1.0, extra: dict[str, str] | None = None) -> Path:
    """tests/sources/quirks.c as an FMI 2.0 co-simulation FMU; `sign` is that of the damper."""
    library = target.with_suffix(".so")
    macros = ["-DFMI=2", f"-DQUIRK={QUIRKS.index(name)}", f"-DSIGN={sign}"]
    command = [
        "gcc",
        "-shared",
        "-fPIC",
        "-O1",
        "-w",
        *macros,
        f"-I{HEADERS}",
        "-o",
        library,
        SOURCES / "quirks.c",
        SOURCES / "stubs.c",
        "-lm",
    ]
    subprocess.run(command, check=True)
    listed = [
        ("subtalar_angle", "input", "rad"),
        ("subtalar_velocity", "input", "rad/s"),
        ("subtalar_torque", "output", "N.m"),
        ("strap_tension", "output", "N"),
    ]
    if name == "ball":
        listed = [("e", "parameter", "1"), ("g", "parameter", "m/s2"), ("h", "output", "m"), ("v", "output", "m/s")]
    exponents = {
        "1": "",
        "rad": 'rad="1"',
        "rad/s": 'rad="1" s="-1"',
        "m": 'm="1"',
        "m/s": 'm="1" s="-1"',
        "m/s2": 'm="1" s="-2"',
        "N": 'kg="1" m="1" s="-2"',
    }
    exponents["N.m"] = 'kg="1" m="2" s="-2"'
    units = "".join(
        f'<Unit name="{u}"><BaseUnit {exponents[u]}/></Unit>' for u in dict.fromkeys(u for _, _, u in listed)
    )
    variables = "".join(
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="{c}" '
        f'variability="{"fixed" if c == "parameter" else "continuous"}">'
        f"<Real unit={chr(34)}{u}{chr(34)}{'' if c == 'output' else ' start=' + chr(34) + '0' + chr(34)}/></ScalarVariable>"
        for k, (n, c, u) in enumerate(listed)
    )
    structure = '<Unknown index="3"/><Unknown index="4"/>'
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{{{name}}}">
  <CoSimulation modelIdentifier="quirks" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
    canBeInstantiatedOnlyOncePerProcess="{str(name == "once").lower()}"/>
  <UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{variables}</ModelVariables>
  <ModelStructure><Outputs>{structure}</Outputs><InitialUnknowns>{structure}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    folder = {"aarch64": "aarch64-linux"}.get(platform.machine(), "linux64")
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{folder}/quirks.so")
        for path, text in (extra or {}).items():
            archive.writestr(path, text)
    return target
