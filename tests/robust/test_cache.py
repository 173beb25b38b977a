"""The cache of FMUs against edits, cuts and other users: what is opened is what was unpacked, or unpacked again."""

from __future__ import annotations

import logging
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.fmu import archive, cache
from tests.native import device

NOBODY = 65534
as_root = pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="changes the user, which root may")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return device(tmp_path_factory.mktemp("fmu") / "device.fmu", extra={"resources/table.csv": "1,2\n3,4\n"})


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache and a temporary folder of this test's own."""
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", str(tmp_path / "cache"))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    cache._warn.cache_clear()
    return tmp_path / "cache"


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def opened(fmu: Path) -> Path:
    return cache.unpacked(fmu, archive.read(fmu).sha256)


def test_unpacked_once(fmu: Path) -> None:
    folder = opened(fmu)
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    assert opened(fmu) == folder
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == before
    assert all(stat.S_IMODE(p.stat().st_mode) == 0o444 for p in folder.rglob("*") if p.is_file())


def test_200_flipped_bits(fmu: Path) -> None:
    """Anywhere in the cache, the manifest included; with the times put back as they were."""
    good = content(opened(fmu))
    entry = opened(fmu).parent
    files = [p for p in entry.rglob("*") if p.is_file()]
    rng = np.random.default_rng(17)
    for k in range(200):
        file = files[int(rng.integers(len(files)))] if k % 4 else entry / cache.MANIFEST
        status = file.stat()
        file.chmod(0o644)
        data = bytearray(file.read_bytes())
        bit = int(rng.integers(8 * len(data)))
        data[bit // 8] ^= 1 << bit % 8
        file.write_bytes(data)
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
        assert content(opened(fmu)) == good, (file, bit)


@pytest.mark.parametrize(
    "damage", ["cut", "emptied", "gone", "linked", "replaced", "no manifest", "no content", "added"]
)
def test_damage_is_mended_in_silence(damage: str, fmu: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = opened(fmu)
    good = content(folder)
    table = folder / "resources" / "table.csv"
    library = next((folder / "binaries").rglob("*.so"))
    library.chmod(0o644)
    if damage == "cut":
        os.truncate(library, library.stat().st_size // 2)
    elif damage == "emptied":
        os.truncate(library, 0)
    elif damage == "gone":
        table.unlink()
    elif damage == "linked":
        table.unlink()
        table.symlink_to("/etc/hostname")
    elif damage == "replaced":
        table.unlink()
        table.write_bytes(b"5,6\n7,8\n")
    elif damage == "no manifest":
        (folder.parent / cache.MANIFEST).unlink()
    elif damage == "no content":
        shutil.rmtree(folder)
    else:
        (folder / "resources" / "__pycache__").mkdir()
        (folder / "resources" / "__pycache__" / "json.cpython-311.pyc").write_bytes(b"x")
        (folder / "numpy.py").write_text("raise SystemExit")
    assert content(opened(fmu)) == good
    assert not caplog.records


def test_a_copied_cache_is_read_once_and_then_known(fmu: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened(fmu)
    shutil.copytree(place, place.parent / "copy")
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", str(place.parent / "copy"))
    read: list[Path] = []
    monkeypatch.setattr(cache, "file_sha256", lambda p, real=cache.file_sha256: read.append(p) or real(p))
    folder = opened(fmu)
    assert place.parent / "copy" in folder.parents
    assert len(read) == len(content(folder))
    opened(fmu)
    assert len(read) == len(content(folder))


def test_a_file_that_changed_is_refused_and_a_kept_one_is_not(fmu: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.fmu"
    shutil.copy(fmu, own)
    known = archive.read(own).sha256
    copy, sha256 = cache.kept(own)
    assert (sha256, copy.name, stat.S_IMODE(copy.stat().st_mode)) == (known, "own.fmu", 0o444)
    device(own, extra={"resources/table.csv": "9,9\n9,9\n"})
    with pytest.raises(InputError, match=r"own\.fmu: has changed since it was read \(SHA-256 .{12} then, .{12} now\)"):
        cache.unpacked(own, known)
    assert (cache.unpacked(copy, known) / "resources" / "table.csv").read_text() == "1,2\n3,4\n"
    assert (cache.unpacked(own, known) / "resources" / "table.csv").read_text() == "1,2\n3,4\n"  # it is in the cache
    copy.chmod(0o644)
    copy.write_bytes(b"x")
    shutil.copy(fmu, own)
    assert cache.kept(own) == (copy, known)
    assert copy.read_bytes() == fmu.read_bytes()


def test_a_folder_that_cannot_be_made_is_refused_by_name(fmu: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", "/dev/null/cache")
    with pytest.raises(EnvironmentProblem, match=r"^/dev/null/cache: cannot be written .*set SPRAIN_COSIM_CACHE"):
        opened(fmu)


@pytest.mark.parametrize("home", ["/dev/null/home", "/proc"])
def test_a_home_that_cannot_be_written_means_a_temporary_folder_and_one_warning(
    home: str, fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("SPRAIN_COSIM_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", home)
    with caplog.at_level(logging.WARNING):
        folder = opened(fmu)
        cache.kept(fmu)
        opened(fmu)
    assert tmp_path / "temporary" in folder.parents
    assert [r.getMessage().partition(": cannot be written")[0] for r in caplog.records] == [
        f"{home}/.cache/sprain-cosim"
    ]
    assert stat.S_IMODE(cache.temporary_folder().stat().st_mode) == 0o700


def test_no_home_at_all(fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SPRAIN_COSIM_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)

    def nobody() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nobody)
    assert tmp_path / "temporary" in opened(fmu).parents


def test_a_cache_of_the_users_own_is_private(fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SPRAIN_COSIM_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    (tmp_path / "home" / "sprain-cosim").mkdir(parents=True)
    (tmp_path / "home" / "sprain-cosim").chmod(0o777)
    folder = opened(fmu)
    assert tmp_path / "home" in folder.parents
    assert stat.S_IMODE((tmp_path / "home" / "sprain-cosim").stat().st_mode) == 0o700


def test_a_folder_that_others_can_write_to_is_not_used(
    fmu: Path, place: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    good = opened(fmu)
    place.chmod(0o777)
    table = good / "resources" / "table.csv"
    table.chmod(0o644)
    table.write_text("9,9\n9,9\n")
    with caplog.at_level(logging.WARNING):
        assert tmp_path / "temporary" in opened(fmu).parents
    assert "can be written by others" in caplog.text


@pytest.fixture
def passable(tmp_path: Path) -> Iterator[None]:
    """Other users may walk to this test's folder."""
    changed = [p for p in tmp_path.parents if p.is_relative_to(tempfile.gettempdir()) or "pytest" in str(p)]
    modes = {p: p.stat().st_mode for p in changed}
    for p in changed:
        p.chmod(stat.S_IMODE(modes[p]) | 0o055)
    tmp_path.chmod(0o755)
    yield
    for p, mode in modes.items():
        p.chmod(stat.S_IMODE(mode))


AS_NOBODY = """
import hashlib, logging, os, sys, tempfile
from pathlib import Path
from sprain_cosim.fmu import archive, cache
fmu = Path(sys.argv[1])
archive.read(fmu)  # what Python loads late, while it may: its own files can be out of reach for the other user
tempfile.TemporaryFile().close()
os.setgid(65534); os.setuid(65534)
folder = cache.unpacked(fmu, archive.read(fmu).sha256)
print(folder)
"""


@as_root
def test_a_cache_that_root_made_works_for_others(fmu: Path, place: Path, tmp_path: Path, passable: None) -> None:
    """Read-only: what is in it is used, what is not or is damaged goes to the temporary folder with one warning."""
    (tmp_path / "temporary").chmod(0o1777)
    shutil.copy(fmu, tmp_path / "device.fmu")
    folder = opened(fmu)
    environment = os.environ | {"TMPDIR": str(tmp_path / "temporary"), "PYTHONDONTWRITEBYTECODE": "1"}

    def other() -> tuple[str, str]:
        command = [sys.executable, "-c", AS_NOBODY, str(tmp_path / "device.fmu")]
        ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout.strip(), ran.stderr.strip()

    assert other() == (str(folder), "")
    table = folder / "resources" / "table.csv"
    table.chmod(0o644)
    table.write_text("9,9\n9,9\n")
    where, said = other()
    assert where.startswith(f"{tmp_path}/temporary/sprain-cosim-{NOBODY}/")
    assert (Path(where) / "resources" / "table.csv").read_text() == "1,2\n3,4\n"
    assert said.count("\n") == 0
    assert f"{place}: cannot be written (Permission denied); FMUs are unpacked to" in said


def test_a_large_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    sparse = tmp_path / "sparse.fmu"
    with sparse.open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(InputError, match=r"3072 MB; at most 512 MB are accepted"):
        archive.read(sparse)
