"""Turns a folder with a Python slave into an FMI 2.0 co-simulation FMU.

The folder holds `interface.py` (MODEL, DESCRIPTION, `variables()`, optionally COMPILED and FIXED_STEP [s]; plain data,
it is run here) and `slave.py` (class Slave; it is not run here). The binary is compiled from `_fmi.c` where a C
compiler is found; for other platforms those of PythonFMU are packed. Model description and archive are our own, so that
units, start values and unknowns are declared and the same sources give the same bytes. The sources travel inside a
package whose name ends in the hash of its content, so that no two FMUs in one process can mistake each other's modules.
The sources of a COMPILED model are imported from a per-user cache instead of the extraction folder: numba keeps its
machine code beside the source, and random extraction folders would lose it."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import os
import platform
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

from ..errors import EnvironmentProblem, InputError, nearest
from ..files import write
from ..process import run_program
from ..shipped import FMUS, SOURCES

LIBRARIES = {  # (system, machine): folder of FMI 2.0 and ending of a shared library
    ("Linux", "x86_64"): ("linux64", ".so"),
    ("Linux", "aarch64"): ("linux64", ".so"),
    ("Darwin", "x86_64"): ("darwin64", ".dylib"),
    ("Darwin", "arm64"): ("darwin64", ".dylib"),
}
BASE_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "s": {"s": 1},
    "s/m": {"s": 1, "m": -1},
    "Pa/m": {"kg": 1, "m": -2, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "kg.m2": {"kg": 1, "m": 2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
SKIPPED = {"__pycache__", "resources", "extra"}
EPOCH = (1980, 1, 1, 0, 0, 0)

STUB = '''"""Start of the FMU's Python side; runs at every instantiation."""
import atexit
import ctypes
import sys
from pathlib import Path

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))  # PythonFMU's binary drops one reference too many per instance
for _binary in (Path(__file__).parent.parent / "binaries").glob("linux64/*.so" if sys.platform == "linux" else "-"):
    # at the end of the process PythonFMU's binary would free its interpreter state twice; told to here, it does so once
    _finalise = getattr(ctypes.CDLL(str(_binary)), "finalizePythonInterpreter", None)
    if _finalise:
        atexit.register(_finalise)
{locate}
from {package}.{name}.slave import Slave


class {name}(Slave):
    pass
'''
LOCATE_CACHED = """

def _stable_folder():
    import os
    import shutil
    import tempfile

    here = Path(__file__).parent
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sprain-cosim"
    root = Path(os.environ.get("SPRAIN_COSIM_CACHE") or default) / "kernels"
    target = root / "{package}"
    if not target.is_dir():
        try:
            root.mkdir(parents=True, exist_ok=True)
            fresh = Path(tempfile.mkdtemp(dir=root))
            shutil.copytree(here / "{package}", fresh / "{package}", ignore=shutil.ignore_patterns("__pycache__"))
            try:
                os.rename(fresh / "{package}", target)
            except OSError:
                pass  # another process was faster
            shutil.rmtree(fresh, ignore_errors=True)
        except OSError:
            return str(here)
    return str(root) if target.is_dir() else str(here)


_folder = _stable_folder()
if _folder not in sys.path:
    sys.path.insert(0, _folder)
"""


def build_all(names: Iterable[str] = ()) -> list[tuple[Path, str]]:
    """Builds the models of the clone's fmus/ folder (or those named) to where the package looks for them: (file, GUID)
    of each.

    Raises InputError outside a clone or for a name that is no model."""
    models = {
        p.parent.name: p.parent
        for p in sorted(SOURCES.glob("*/interface.py"))
        if not p.parent.name.startswith("brace_template_")
    }
    if not models:
        raise InputError(f"{SOURCES}: no models to build; an installed package ships its FMUs ready")
    for name in names:
        if name not in models:
            raise InputError(f"model {name!r} is not in {SOURCES}{nearest(name, models)}")
    chosen = list(names) or list(models)
    return [(target, build_fmu(models[n], target)) for n in chosen for target in [FMUS / f"{n}.fmu"]]


def build_fmu(folder: Path, target: Path, support: Path | None = None) -> str:
    """Writes `target` from the model in `folder`; `support` is the slave base class (default: `_fmi.py` beside the
    folder).

    Returns the GUID. Raises InputError when the folder is not a model."""
    for needed in ("interface.py", "slave.py"):
        if not (folder / needed).is_file():
            raise InputError(f"{folder}: no {needed}; a model folder holds interface.py and slave.py")
    support = support or folder.parent / "_fmi.py"
    interface = _load(folder / "interface.py")
    name: str = interface.MODEL
    sources = {
        "_fmi.py": support.read_bytes(),
        "__init__.py": b"",
        **{f"{name}/{path}": data for path, data in _tree(folder, SKIPPED).items() if not path.endswith(".md")},
    }
    documents = {path.name: path.read_bytes() for path in sorted(folder.glob("*.md"))}
    package = f"{name}_{_digest(sources)[:12]}"
    locate = LOCATE_CACHED.format(package=package) if getattr(interface, "COMPILED", False) else ""
    stub = f"{package}_slave"
    files = {
        **{f"resources/{package}/{path}": data for path, data in sources.items()},
        "resources/slavemodule.txt": stub.encode(),
        f"resources/{stub}.py": STUB.format(locate=locate, package=package, name=name).encode(),
        **{f"resources/{path}": data for path, data in _tree(folder / "resources", {"__pycache__"}).items()},
        **{f"extra/{path}": data for path, data in _tree(folder / "extra", set()).items()},
        **{f"documentation/{path}": data for path, data in documents.items()},
        **_binaries(name, support.with_suffix(".c")),
    }
    description = model_description(
        name, interface.DESCRIPTION, interface.variables(), getattr(interface, "FIXED_STEP", None)
    )
    guid = _digest({**files, "modelDescription.xml": description.replace(GUID_PLACE, "").encode()})
    files["modelDescription.xml"] = description.replace(GUID_PLACE, guid).encode()
    write(target, pack(files), parents=True)
    return guid


GUID_PLACE = "@GUID@"


def model_description(
    name: str, description: str, variables: list[dict[str, Any]], fixed_step: float | None = None
) -> str:
    """modelDescription.xml of FMI 2.0 with GUID_PLACE for the GUID; value references are positions in `variables`.
    `fixed_step` [s] is the model's own step where it cannot take another one."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=GUID_PLACE,
        description=description,
        generationTool="sprain-cosim",
        variableNamingConvention="flat",
    )
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        needsExecutionTool="false",
        canHandleVariableCommunicationStepSize="false" if fixed_step else "true",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({v["unit"] for v in variables if "unit" in v}):
        base = {key: str(exponent) for key, exponent in BASE_UNITS[unit].items()}
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", base)
    enumerations = [v for v in variables if "items" in v]
    if enumerations:
        types = ET.SubElement(root, "TypeDefinitions")
        for variable in enumerations:
            kind = ET.SubElement(ET.SubElement(types, "SimpleType", name=variable["name"]), "Enumeration")
            for item, value in variable["items"].items():
                ET.SubElement(kind, "Item", name=item, value=str(value))
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logAll")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="0.15", stepSize=repr(fixed_step or 0.0005))
    listed = ET.SubElement(root, "ModelVariables")
    position = {v["name"]: k + 1 for k, v in enumerate(variables)}
    for k, variable in enumerate(variables):
        entry = {key: variable[key] for key in ("name", "causality", "variability", "description")}
        if variable["causality"] == "output":
            entry["initial"] = "calculated"
        elif variable["causality"] == "parameter":
            entry["initial"] = "exact"
        if "items" in variable:
            entry["variability"] = "fixed"
            tag, detail = "Enumeration", {"declaredType": variable["name"], "start": str(variable["start"])}
        else:
            tag, detail = "Real", {"unit": variable["unit"]}
            detail |= {key: repr(float(variable[key])) for key in ("min", "max", "start") if key in variable}
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", entry, valueReference=str(k)), tag, detail)
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [v for v in variables if v["causality"] == "output"]
    for section in ("Outputs", "InitialUnknowns"):
        group = ET.SubElement(structure, section)
        for variable in outputs:
            unknown = ET.SubElement(group, "Unknown", index=str(position[variable["name"]]))
            if section == "Outputs" and "depends" in variable:
                unknown.set("dependencies", " ".join(str(position[n]) for n in variable["depends"]))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("_interface", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _tree(folder: Path, skip: set[str]) -> dict[str, bytes]:
    files = sorted(p for p in folder.rglob("*") if p.is_file() and not skip.intersection(p.relative_to(folder).parts))
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


def _digest(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for path, data in sorted(files.items()):
        digest.update(f"{path}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def _binaries(name: str, source: Path) -> dict[str, bytes]:
    """PythonFMU's for every platform it has, ours in place of that of this platform."""
    try:
        found = importlib.util.find_spec("pythonfmu")
        assert found is not None and found.submodule_search_locations
    except (ImportError, AssertionError):
        raise InputError(
            "the package pythonfmu, whose binary carries Python FMUs, is not installed: pip install pythonfmu"
        ) from None
    folder = Path(found.submodule_search_locations[0]) / "resources" / "binaries"
    binaries = {}
    for library in sorted(folder.glob("*/*pythonfmu-export.*")):
        binaries[f"binaries/{library.parent.name}/{name}{library.suffix}"] = library.read_bytes()
    place = LIBRARIES.get((platform.system(), platform.machine()))
    own = _compiled(source) if source.is_file() and place else None
    if own is not None and place:
        binaries[f"binaries/{place[0]}/{name}{place[1]}"] = own
    return binaries


@lru_cache(maxsize=1)
def _compiled(source: Path) -> bytes | None:
    """The library made from `source` by the platform's C compiler; None without one."""
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "library"
        options = ["-std=gnu11", "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]
        if sys.platform == "linux":
            options += ["-s", "-Wl,--build-id=none"]
        command = [compiler, *options, "-o", str(library), source.name, "-ldl"]
        outcome = run_program(command, source.parent)
        if outcome.returncode:
            raise EnvironmentProblem(
                f"{source}: {compiler} cannot compile it: {(outcome.stderr.splitlines() or ['no message'])[0]}"
            )
        return library.read_bytes()


def pack(files: dict[str, bytes]) -> bytes:
    """The archive of {path: content}. Stored, not deflated: the bytes do not depend on the version of zlib."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for path, data in sorted(files.items(), key=lambda item: (item[0] != "modelDescription.xml", item[0])):
            entry = zipfile.ZipInfo(path, EPOCH)
            entry.external_attr = 0o644 << 16
            entry.create_system = 3
            archive.writestr(entry, data)
    return buffer.getvalue()
