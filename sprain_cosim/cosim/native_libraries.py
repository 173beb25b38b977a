"""The package's own libraries in C: the communication steps, and a landing as one FMU. Each says which sources it was
built from, so that one of another source is not used."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from .. import files
from ..shipped import FMUS

FOLDER = Path(__file__).parent
SOURCES = {  # what is compiled, and what it includes
    "native_steps": ("native_steps.c",),
    "container": ("container.c", "native_steps.c"),
}
PLATFORMS_OF_CONTAINER = ("linux64", "win64")
LOADER = ("-Wl,--push-state,--no-as-needed", "-l:libdl.so.2", "-Wl,--pop-state")  # where older systems have dlopen


def source_digest(name: str) -> str:
    """SHA-256 over the sources of a library."""
    return hashlib.sha256(b"".join((FOLDER / source).read_bytes() for source in SOURCES[name])).hexdigest()


def library_content(name: str, platform: str) -> bytes | None:
    """A library for a platform, such as linux64; None where it is not built, or from other sources."""
    path = _path(name, platform)
    content = path.read_bytes() if path.is_file() else b""
    return content if source_digest(name).encode() in content else None


def build_libraries(platforms: Sequence[str] = ()) -> list[tuple[Path, bool]]:
    """The libraries for `platforms` (default: those of `fmu.build`) where the package looks for them, compiled where
    they are not what their sources give: (file, new) of each. Raises EnvironmentProblem where a compiler is needed and
    missing."""
    from ..fmu.build.link import link_source
    from ..fmu.build.models import usual_platforms

    found = []
    for name, sources in SOURCES.items():
        for platform in platforms or usual_platforms():
            if name == "container" and platform not in PLATFORMS_OF_CONTAINER:
                continue
            target = _path(name, platform)
            new = library_content(name, platform) is None
            if new:
                digest = f'-DSOURCE="{source_digest(name)}"'
                loader = LOADER if (name, platform) == ("container", "linux64") else ()
                content = link_source([FOLDER / source for source in sources], platform, digest, *loader)
                files.write(target, content, parents=True)
            found.append((target, new))
    return found


def _path(name: str, platform: str) -> Path:
    from ..fmu.build.link import PLATFORMS

    return FMUS / f"{name}-{platform}{PLATFORMS[platform].ending}"
