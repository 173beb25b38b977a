"""The files that a study was begun with. Its trials run from copies of them, so that what happens to a file meanwhile
changes no trial; the copies stay in the cache by the hash of their content."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..fmu import cache
from ..fmu.archive import same_model
from ..scenario import Scenario
from .plan import Plan


def with_kept_files(scenario: Scenario) -> Scenario:
    """The same scenario from copies of its FMUs and mapping files. Raises InputError, EnvironmentProblem."""
    fmus, maps = (
        {name: cache.kept(path)[0] for name, path in files.items()} for files in (scenario.fmus, scenario.maps)
    )
    return replace(scenario, fmus=fmus, maps=maps)


def as_begun(scenario: Scenario, hashes: Mapping[str, Mapping[str, str]]) -> Scenario:
    """The scenario with the copy of each FMU whose file was built again since, for more or fewer platforms, and is the
    same model: rows of both are rows of one study. `hashes` as `restored` takes them."""
    fmus = dict(scenario.fmus)
    for name, path in scenario.fmus.items():
        then = hashes.get("fmus", {}).get(name)
        copy = cache.found(path.name, then) if then and cache.file_sha256(path) != then else None
        if copy is not None and same_model(copy, path):
            fmus[name] = copy
    return replace(scenario, fmus=fmus)


def changed_files(scenario: Scenario, copies: Scenario) -> list[str]:
    """What has become of the files meanwhile, one warning each."""
    found = []
    for files, kept_files in ((scenario.fmus, copies.fmus), (scenario.maps, copies.maps)):
        for name, path in files.items():
            sha256 = cache.file_sha256(kept_files[name])
            try:
                now = cache.file_sha256(path)
            except OSError:
                now = ""
            if now != sha256:
                became = f"has changed (SHA-256 {now[:12]})" if now else "is gone"
                found.append(
                    f"{path} {became} since the study began; all its trials are of the file as it was then "
                    f"(SHA-256 {sha256[:12]}), kept as {kept_files[name]}"
                )
    return found


def edited_files(study: Plan, hashes: Mapping[str, Mapping[str, str]]) -> list[str]:
    """The files of a finished study that have another content now than `hashes` {"fmus" or "maps": {component:
    SHA-256}}, and its own file, a line each; files that are not here are passed over, they may be another machine's."""
    found = []
    for kind, files in (("fmus", study.scenario.fmus), ("maps", study.scenario.maps)):
        for name, path in files.items():
            then = hashes.get(kind, {}).get(name)
            try:
                now = cache.file_sha256(path)
            except OSError:
                continue
            if then is not None and now != then:
                found.append(
                    f"{name}: {path.name} has another content now (SHA-256 {now[:12]}) than when this ran "
                    f"({then[:12]}); what is shown is of then"
                )
    source = Path(study.source)
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if study.text and source.is_file() and source.read_text("utf-8") != study.text:
            found.append(f"{study.source} has been edited since; what is shown is of the copy in study.toml")
    return found


def restored(scenario: Scenario, hashes: Mapping[str, Mapping[str, str]]) -> Scenario:
    """The scenario with copies in place of those files that are gone or have another content than `hashes`
    {"fmus" or "maps": {component: SHA-256}}, as far as there are copies."""

    def place(path: Path, sha256: str | None) -> Path:
        try:
            if sha256 is None or cache.file_sha256(path) == sha256:
                return path
        except OSError:
            pass
        return cache.found(path.name, sha256) or path if sha256 else path

    fmus, maps = (
        {name: place(path, hashes.get(kind, {}).get(name)) for name, path in files.items()}
        for kind, files in (("fmus", scenario.fmus), ("maps", scenario.maps))
    )
    return replace(scenario, fmus=fmus, maps=maps)
