"""Archives that must be refused before anything is unpacked, and the cache of unpacked ones."""

from __future__ import annotations

import stat
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.fmu import archive, cache
from sprain_cosim.fmu.component import Component
from sprain_cosim.shipped import FMUS

GOOD = FMUS / "brace_bushing.fmu"
DESCRIPTION = zipfile.ZipFile(GOOD).read("modelDescription.xml")


def pack(target: Path, entries: list[tuple[str | zipfile.ZipInfo, bytes]], packing: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(target, "w", packing) as made:
        for name, data in entries:
            made.writestr(name, data)
    return target


def link(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


HOSTILE = {
    "absolute": ([("/etc/passwd", b"x")], "not a plain relative path"),
    "parent": ([("resources/../../x", b"x")], "not a plain relative path"),
    "backslash": ([("resources\\..\\x", b"x")], "not a plain relative path"),
    "drive": ([("C:/x", b"x")], "not a plain relative path"),
    "device": ([("resources/nul.txt", b"x")], "not a plain relative path"),
    "empty part": ([("resources//x", b"x")], "not a plain relative path"),
    "symlink": ([(link("resources/x"), b"/etc/passwd")], "symbolic link"),
    "duplicate": ([("a.txt", b"x"), ("a.txt", b"y")], "two entries"),
    "case collision": ([("a.txt", b"x"), ("A.TXT", b"y")], "two entries"),
    "file and folder": ([("a", b"x"), ("a/b", b"y")], "both a file and a folder"),
}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("attack", HOSTILE)
def test_hostile_names_are_refused(attack: str, tmp_path: Path) -> None:
    entries, words = HOSTILE[attack]
    fmu = pack(tmp_path / "x.fmu", [("modelDescription.xml", DESCRIPTION), *entries])
    with pytest.raises(InputError, match=words):
        archive.read(fmu)
    assert [p.name for p in tmp_path.iterdir()] == ["x.fmu"]


def test_bombs_are_refused(tmp_path: Path) -> None:
    bomb = pack(
        tmp_path / "ratio.fmu", [("modelDescription.xml", DESCRIPTION), ("x", bytes(50_000_000))], zipfile.ZIP_DEFLATED
    )
    with pytest.raises(InputError, match="times its size"):
        archive.read(bomb)
    many = pack(
        tmp_path / "many.fmu", [("modelDescription.xml", DESCRIPTION), *((f"r/{k}", b"") for k in range(10_000))]
    )
    with pytest.raises(InputError, match="10001 entries"):
        archive.read(many)


XML = {
    "doctype": (b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><fmiModelDescription/>', "DOCTYPE"),
    "not xml": (b"hello", "not valid"),
    "not utf-8": ("é".encode("latin-1"), "not UTF-8"),
    "empty": (b"", "not valid"),
    "another root": (b"<model/>", "not valid"),
    "no version": (b"<fmiModelDescription/>", "not valid"),
}


@pytest.mark.parametrize("kind", XML)
def test_bad_descriptions_are_refused(kind: str, tmp_path: Path) -> None:
    data, words = XML[kind]
    with pytest.raises(InputError, match=words):
        Component.read("x", pack(tmp_path / "x.fmu", [("modelDescription.xml", data)]))


def test_damaged_files_are_refused_in_one_line(tmp_path: Path) -> None:
    good = GOOD.read_bytes()
    for k, length in enumerate((0, 1, 30, 1000, len(good) // 2, len(good) - 5)):
        (tmp_path / f"{k}.fmu").write_bytes(good[:length])
        with pytest.raises(InputError) as problem:
            Component.read("x", tmp_path / f"{k}.fmu")
        assert "\n" not in str(problem.value)
    with pytest.raises(InputError, match="is a folder"):
        Component.read("x", tmp_path)


def test_a_missing_binary_names_those_that_are_there(tmp_path: Path) -> None:
    fmu = pack(tmp_path / "x.fmu", [("modelDescription.xml", DESCRIPTION), ("binaries/beos/brace_bushing.so", b"")])
    with pytest.raises(InputError, match=r"no binary for this platform.* made for others \(beos\)"):
        Component.read("x", fmu)


def test_unpacking_once_and_at_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", str(tmp_path))
    checked = archive.read(GOOD)
    with ThreadPoolExecutor(8) as pool:
        folders = set(pool.map(lambda _: cache.unpacked(GOOD, checked.sha256), range(32)))
    assert len(folders) == 1
    assert [p.name for p in (tmp_path / "unpacked").iterdir()] == [checked.sha256[:32]]
    assert (next(iter(folders)) / "modelDescription.xml").read_bytes() == DESCRIPTION
