"""Turns a folder with a Python slave into an FMI 2.0 co-simulation FMU.

The folder holds `interface.py` (MODEL, DESCRIPTION, `variables()`, optionally COMPILED and FIXED_STEP [s]; plain data,
it is run here) and `slave.py` (class Slave; it is not run here). The binary is compiled from `_fmi.c` where a C
compiler is found; for other platforms those of PythonFMU are packed. Model description and archive are our own, so that
units, start values and unknowns are declared and the same sources give the same bytes. The sources travel inside a
package whose name ends in the hash of its content, so that no two FMUs in one process can mistake each other's modules.
The sources of a COMPILED model are imported from a per-user cache instead of the extraction folder: numba keeps its
machine code beside the source, and random extraction folders would lose it."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

from ...errors import EnvironmentProblem, InputError
from ...process import run_program
from .description import GUID_PLACE, load_interface, model_description, variables_of
from .link import LIBRARIES
from .packing import digest, tree, write_fmu

SKIPPED = ("resources", "extra")

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


def build_python_fmu(folder: Path, target: Path, support: Path | None = None) -> str:
    """Writes `target` from the model in `folder`; `support` is the slave base class (default: `_fmi.py` beside the
    folder).

    Returns the GUID. Raises InputError when the folder is not a model."""
    support = support or folder.parent / "_fmi.py"
    interface = load_interface(folder / "interface.py")
    name: str = interface.MODEL
    sources = {
        "_fmi.py": support.read_bytes(),
        "__init__.py": b"",
        **{f"{name}/{path}": data for path, data in tree(folder, SKIPPED).items() if not path.endswith(".md")},
    }
    documents = {path.name: path.read_bytes() for path in sorted(folder.glob("*.md"))}
    package = f"{name}_{digest(sources)[:12]}"
    locate = LOCATE_CACHED.format(package=package) if getattr(interface, "COMPILED", False) else ""
    stub = f"{package}_slave"
    files = {
        **{f"resources/{package}/{path}": data for path, data in sources.items()},
        "resources/slavemodule.txt": stub.encode(),
        f"resources/{stub}.py": STUB.format(locate=locate, package=package, name=name).encode(),
        **{f"resources/{path}": data for path, data in tree(folder / "resources").items()},
        **{f"extra/{path}": data for path, data in tree(folder / "extra").items()},
        **{f"documentation/{path}": data for path, data in documents.items()},
        **_binaries(name, support.with_suffix(".c")),
    }
    description = model_description(
        name,
        interface.DESCRIPTION,
        variables_of(interface, folder / "interface.py"),
        getattr(interface, "FIXED_STEP", None),
    )
    guid = digest({**files, "modelDescription.xml": description.replace(GUID_PLACE, "").encode()})
    files["modelDescription.xml"] = description.replace(GUID_PLACE, guid).encode()
    write_fmu(target, files)
    return guid


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
