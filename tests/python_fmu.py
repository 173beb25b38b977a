"""Python FMUs for tests: a folder with a slave in Python as an FMI 2.0 co-simulation FMU, like those of PythonFMU.

The folder holds `interface.py` (MODEL, DESCRIPTION, `variables()`, optionally FIXED_STEP [s]; plain data, it is run
here) and `slave.py` (class Slave of `sources/python_slave.py`; it is not run here). The binary is compiled from
`sources/python_slave.c`; for other platforms, and where `_compiled` gives none, those of PythonFMU are packed. The
sources travel inside a package whose name ends in the hash of its content, so that no two FMUs in one process can
mistake each other's modules."""

from __future__ import annotations

import importlib.util
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path

from sprain_cosim.fmu.build.description import GUID_PLACE, load_interface, model_description, variables_of
from sprain_cosim.fmu.build.packing import digest, tree, write_fmu

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
from {package}.{name}.slave import Slave


class {name}(Slave):
    pass
'''
SUPPORT = Path(__file__).parent / "sources" / "python_slave.py"


def build_python_fmu(folder: Path, target: Path) -> None:
    """Writes `target` from the model in `folder`."""
    interface = load_interface(folder / "interface.py")
    name: str = interface.MODEL
    sources = {"_fmi.py": SUPPORT.read_bytes(), "__init__.py": b""}
    sources |= {f"{name}/{path}": data for path, data in tree(folder, ("resources", "extra")).items()}
    package = f"{name}_{digest(sources)[:12]}"
    stub = f"{package}_slave"
    files = {
        **{f"resources/{package}/{path}": data for path, data in sources.items()},
        "resources/slavemodule.txt": stub.encode(),
        f"resources/{stub}.py": STUB.format(package=package, name=name).encode(),
        **{f"resources/{path}": data for path, data in tree(folder / "resources").items()},
        **{f"extra/{path}": data for path, data in tree(folder / "extra").items()},
        **_binaries(name),
    }
    variables = variables_of(interface, folder / "interface.py")
    description = model_description(name, interface.DESCRIPTION, variables, getattr(interface, "FIXED_STEP", None))
    guid = digest({**files, "modelDescription.xml": description.replace(GUID_PLACE, "").encode()})
    files["modelDescription.xml"] = description.replace(GUID_PLACE, guid).encode()
    write_fmu(target, files)


def _binaries(name: str) -> dict[str, bytes]:
    """PythonFMU's for every platform it has, ours in place of that of this platform."""
    found = importlib.util.find_spec("pythonfmu")
    assert found is not None and found.submodule_search_locations
    folder = Path(found.submodule_search_locations[0]) / "resources" / "binaries"
    binaries = {
        f"binaries/{library.parent.name}/{name}{library.suffix}": library.read_bytes()
        for library in sorted(folder.glob("*/*pythonfmu-export.*"))
    }
    own = _compiled()
    return binaries if own is None else binaries | {f"binaries/linux64/{name}.so": own}


@lru_cache(maxsize=1)
def _compiled() -> bytes | None:
    """The library made from python_slave.c."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "library"
        options = ["-std=gnu11", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-s", "-Wl,--build-id=none"]
        subprocess.run(["gcc", *options, "-o", library, SUPPORT.with_suffix(".c"), "-ldl"], check=True)
        return library.read_bytes()
