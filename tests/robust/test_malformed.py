"""Files that are no usable FMU, through `check`: exit 2, one `error:` line, no traceback, quick, nothing left behind."""

from __future__ import annotations

import io
import os
import re
import stat
import struct
import subprocess
import sys
import tarfile
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cli import _run
from sprain_cosim.fmu import cache
from tests.native import device

LIMIT = 2.0  # s of processor time, so that a busy machine does not count; five times that of wall time
GOOD: dict[str, bytes] = {}
"""The content of a good FMU; filled by the fixture."""


def pack(entries: list[tuple[str | zipfile.ZipInfo, bytes]], packing: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", packing) as made:
        warnings.simplefilter("ignore")  # duplicate names are meant
        for name, data in entries:
            made.writestr(name, data)
    return buffer.getvalue()


def with_changed(**changed: bytes | None) -> bytes:
    """The good FMU with other content: `description`, `library`; None leaves the entry out."""
    kinds = {"modelDescription.xml": "description", library(): "library"}
    entries = [(n, changed.get(kinds[n], data)) for n, data in GOOD.items()]
    return pack([(n, d) for n, d in entries if d is not None])


def library() -> str:
    return next(n for n in GOOD if n.startswith("binaries/"))


def description() -> str:
    return GOOD["modelDescription.xml"].decode()


def entry(name: str, mode: int = 0o644, data: bytes = b"x") -> tuple[zipfile.ZipInfo, bytes]:
    info = zipfile.ZipInfo(name)
    info.external_attr = (mode | (0 if mode & 0o170000 else stat.S_IFREG)) << 16
    return info, data


# ---- the cases: {name: bytes of the file}


def not_archives() -> Iterator[tuple[str, bytes]]:
    rng = np.random.default_rng(1)
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as made:
        info = tarfile.TarInfo("modelDescription.xml")
        info.size = len(GOOD["modelDescription.xml"])
        made.addfile(info, io.BytesIO(GOOD["modelDescription.xml"]))
    yield from {
        "empty": b"",
        "one byte": b"P",
        "text": b"hello, this is no FMU\n",
        "xml alone": GOOD["modelDescription.xml"],
        "library alone": GOOD[library()],
        "tar": tar.getvalue(),
        "gzip": b"\x1f\x8b\x08" + bytes(100),
        "seven zip": b"7z\xbc\xaf\x27\x1c" + bytes(100),
        "pdf": b"%PDF-1.4\n%%EOF",
        "zip signature only": b"PK\x03\x04",
        "empty zip": pack([]),
        "end record only": b"PK\x05\x06" + bytes(18),
        "no description": pack([(library(), GOOD[library()])]),
        "description in a folder": pack([(f"fmu/{n}", d) for n, d in GOOD.items()]),
        "description in other case": pack(
            [("modeldescription.xml", GOOD["modelDescription.xml"]), (library(), GOOD[library()])]
        ),
        "description is a folder": pack([("modelDescription.xml/", b""), (library(), GOOD[library()])]),
    }.items()
    for k in range(12):
        yield f"random {k}", rng.bytes(int(10 ** rng.uniform(1, 5)))


def truncated() -> Iterator[tuple[str, bytes]]:
    whole = pack(list(GOOD.items()))
    for k, length in enumerate(np.linspace(1, len(whole) - 1, 40).astype(int)):
        yield f"truncated {k}", whole[:length]
    for k, at in enumerate(np.linspace(0, 0.9, 10)):
        start = int(at * len(whole))
        yield f"hole {k}", whole[:start] + whole[start + len(whole) // 20 :]


def flipped() -> Iterator[tuple[str, bytes]]:
    """Single bits anywhere; those that change no name and no content (dates, attributes) are no damage and left out."""
    rng = np.random.default_rng(2)
    for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        whole = pack(list(GOOD.items()), packing)
        directory = whole.rindex(b"PK\x01\x02", 0, whole.index(b"PK\x05\x06"))
        places = [
            *rng.integers(0, len(whole), 25),
            *rng.integers(0, 60, 10),
            *rng.integers(directory - 80, len(whole), 25),
        ]
        for k, place in enumerate(places):
            damaged = bytearray(whole)
            damaged[place] ^= 1 << int(rng.integers(8))
            if not same_content(bytes(damaged)):
                yield f"bit flip {packing}-{k}", bytes(damaged)


def same_content(data: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as opened:
            return {n: opened.read(n) for n in opened.namelist()} == GOOD
    except Exception:
        return False


def descriptions() -> Iterator[tuple[str, bytes]]:
    good = description()

    def changed(old: str, new: str, count: int = 1) -> bytes:
        assert old in good, old
        return good.replace(old, new, count).encode()

    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    body = good.removeprefix(head)
    variable = re.search(r"<ScalarVariable name=\"subtalar_torque\".*?</ScalarVariable>", good)
    assert variable
    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
    found: dict[str, bytes] = {
        "empty": b"",
        "text": b"hello",
        "json": b'{"fmiModelDescription": {}}',
        "another root": b"<model/>",
        "no attributes": b"<fmiModelDescription/>",
        "cut in the middle": good.encode()[: len(good) // 2],
        "two roots": (good + "<x/>").encode(),
        "text after the end": (good + "hello").encode(),
        "unclosed": changed("</ModelVariables>", ""),
        "stray less-than": changed('name="stiffness"', 'name="stiff<ness"'),
        "stray ampersand": changed('name="stiffness"', 'name="a & b"'),
        "unknown entity": changed('name="stiffness"', 'name="&what;"'),
        "attribute twice": changed('name="stiffness"', 'name="stiffness" name="stiffness"'),
        "nul": changed("subtalar_angle", "subtalar\0angle"),
        "control character": changed("subtalar_angle", "subtalar\x01angle"),
        "bad utf-8": good.encode().replace(b"stiffness", b"stiff\xff\xfeness", 1),
        "latin-1": (head + body.replace("stiffness", "stiffnéss", 1)).encode("latin-1"),
        "overlong utf-8": good.encode().replace(b"stiffness", b"stiff\xc0\xafness", 1),
        "utf-16": (head.replace("UTF-8", "UTF-16") + body).encode("utf-16"),
        "utf-16 without mark": (head.replace("UTF-8", "UTF-16") + body).encode("utf-16-le"),
        "utf-32": (head.replace("UTF-8", "UTF-32") + body).encode("utf-32"),
        "utf-7": head.replace("UTF-8", "UTF-7").encode() + body.encode("utf-7"),
        "ebcdic": head.replace("UTF-8", "cp037").encode() + body.encode(),
        "doctype in utf-7": head.replace("UTF-8", "UTF-7").encode()
        + b'+ADwAIQ-DOCTYPE x +AFsAPAAh-ENTITY a "b"+AD4AXQA+-'
        + body.encode(),
        "unknown encoding": changed("UTF-8", "klingon"),
        "doctype": (head + "<!DOCTYPE fmiModelDescription>" + body).encode(),
        "external doctype": (head + '<!DOCTYPE x SYSTEM "http://localhost:9/x.dtd">' + body).encode(),
        "xxe file": (
            head + '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + body.replace("stiffness", "&e;", 1)
        ).encode(),
        "xxe parameter": (head + '<!DOCTYPE x [<!ENTITY % e SYSTEM "file:///etc/passwd"> %e;]>' + body).encode(),
        "entity bomb": (
            head + f'<!DOCTYPE x [<!ENTITY l0 "ha">{laughs}]>' + body.replace("stiffness", "&l9;", 1)
        ).encode(),
        "quadratic bomb": (
            head + f'<!DOCTYPE x [<!ENTITY a "{"a" * 50000}">]>' + body.replace("stiffness", "&a;" * 1000, 1)
        ).encode(),
        "deeply nested": (head + "<a>" * 20000 + "</a>" * 20000).encode(),
        "no version": re.sub(r' fmiVersion="[^"]*"', "", good).encode(),
        "version 4": changed('fmiVersion="2.0"', 'fmiVersion="4.0"'),
        "version in words": changed('fmiVersion="2.0"', 'fmiVersion="two"'),
        "empty version": changed('fmiVersion="2.0"', 'fmiVersion=""'),
        "version 3 with the body of 2": changed('fmiVersion="2.0"', 'fmiVersion="3.0"'),
        "version 1 with the body of 2": changed('fmiVersion="2.0"', 'fmiVersion="1.0"'),
        "no guid": changed(' guid="{device}"', ""),
        "no model name": changed(' modelName="device"', ""),
        "no interface": re.sub(r"<CoSimulation[^>]*/>", "", good).encode(),
        "no identifier": changed(' modelIdentifier="device"', ""),
        "identifier leads outside": changed('modelIdentifier="device"', 'modelIdentifier="../../../etc/passwd"'),
        "empty identifier": changed('modelIdentifier="device"', 'modelIdentifier=""'),
        "another identifier": changed('modelIdentifier="device"', 'modelIdentifier="brace"'),
        "needs its tool": changed("<CoSimulation ", '<CoSimulation needsExecutionTool="true" '),
        "no variables": re.sub(
            r"<ModelVariables>.*</ModelVariables>", "<ModelVariables></ModelVariables>", good, flags=re.S
        ).encode(),
        "no variables element": re.sub(r"<ModelVariables>.*</ModelVariables>", "", good, flags=re.S).encode(),
        "no structure": re.sub(r"<ModelStructure>.*</ModelStructure>", "", good, flags=re.S).encode(),
        "duplicate variable": changed(variable[0], variable[0] * 2),
        "variable without name": changed(' name="subtalar_torque"', ""),
        "variable with empty name": changed('name="subtalar_torque"', 'name=""'),
        "variable without reference": changed(' valueReference="1"', ""),
        "reference in words": changed('valueReference="1"', 'valueReference="one"'),
        "negative reference": changed('valueReference="1"', 'valueReference="-1"'),
        "reference too large": changed('valueReference="1"', 'valueReference="99999999999999"'),
        "unknown causality": changed('causality="input"', 'causality="inwards"'),
        "unknown variability": changed('variability="fixed"', 'variability="sometimes"'),
        "unknown variable type": changed("<Real", "<Complex").replace(b"</Real", b"</Complex"),
        "no type": changed(re.search(r"<Real[^>]*/>", good)[0], ""),  # type: ignore[index]
        "start in words": changed('start="20"', 'start="twenty"'),
        "undefined declared type": changed("<Real ", '<Real declaredType="Nothing" '),
        "unit without name": changed('<Unit name="N.m">', "<Unit>"),
        "exponent in words": changed('kg="1"', 'kg="one"'),
        "factor in words": re.sub(r'factor="[^"]*"', 'factor="many"', good).encode(),
        "output index out of range": changed('<Outputs><Unknown index="2"/>', '<Outputs><Unknown index="99"/>'),
        "output index zero": changed('<Outputs><Unknown index="2"/>', '<Outputs><Unknown index="0"/>'),
        "output is no output": changed('<Outputs><Unknown index="2"/>', '<Outputs><Unknown index="1"/>'),
        "derivative of nothing": changed('derivative="4"', 'derivative="77"'),
        "unknown element": changed("<ModelVariables>", "<Surprise/><ModelVariables>"),
        "unknown attribute": changed("<CoSimulation ", '<CoSimulation surprise="true" '),
        "boolean in words": changed('canGetAndSetFMUstate="true"', 'canGetAndSetFMUstate="perhaps"'),
        "include": changed(
            "<ModelVariables>",
            '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/passwd"/><ModelVariables>',
        ),
        "namespace": changed("<fmiModelDescription", '<fmiModelDescription xmlns="http://nowhere.example/"'),
    }
    for name, data in found.items():
        yield f"xml {name}", with_changed(description=data)


def libraries() -> Iterator[tuple[str, bytes]]:
    good = GOOD[library()]
    rng = np.random.default_rng(3)
    names = b"\0".join(sorted(set(re.findall(rb"fmi2[A-Za-z]+", good))))
    other = bytearray(good)
    other[18:20] = struct.pack("<H", 0xF3)  # RISC-V
    small = bytearray(good)
    small[4] = 1  # 32 bit
    found: dict[str, bytes | None] = {
        "missing": None,
        "empty": b"",
        "text": b"not a library",
        "zeros": bytes(10000),
        "names only": names,
        "header and names only": good[:64] + names,
        "script": b"#!/bin/sh\nexit 0\n" + names,
        "windows program": b"MZ" + bytes(200) + names,
        "of another processor": bytes(other),
        "of 32 bit": bytes(small),
        "without fmi2DoStep": good.replace(b"fmi2DoStep", b"fmi2NoStep"),
        **{f"random {k}": rng.bytes(5000) + names for k in range(3)},
        **{f"cut at {share} %": good[: len(good) * share // 100] for share in range(5, 100, 10)},
        **{f"cut at {share} %, names kept": good[: len(good) * share // 100] + names for share in range(5, 60, 10)},
    }
    for name, data in found.items():
        yield f"library {name}", with_changed(library=data)
    yield (
        "library under another name",
        pack([("modelDescription.xml", GOOD["modelDescription.xml"]), (library().replace("device", "Device"), good)]),
    )
    yield (
        "library of another platform",
        pack([("modelDescription.xml", GOOD["modelDescription.xml"]), ("binaries/beos/device.so", good)]),
    )
    yield "library is a folder", pack([("modelDescription.xml", GOOD["modelDescription.xml"]), (f"{library()}/", b"")])


def attacks() -> Iterator[tuple[str, bytes]]:
    base: list[tuple[str | zipfile.ZipInfo, bytes]] = list(GOOD.items())
    names = [
        "/etc/passwd", "//server/share/x", "../x", "resources/../../x", "resources/..", "..", "./x", "resources\\..\\..\\x", "\\\\server\\x",
        "C:/x", "c:x", "C:\\x", "resources//x", "resources/./x", "con", "resources/NUL", "resources/nul.txt", "aux.", "resources/COM1.txt", "lpt9",
        "modelDescription.xml", "MODELDESCRIPTION.XML", "Binaries/x", "binaries", "modelDescription.xml/x", "x\0y", "a:b",
        "resources/x:stream", " ", "x ", "x.",
        "resources/ con .txt", "resources/a\nb", "resources/\x07", "r" * 300,
    ]  # fmt: skip
    for k, name in enumerate(names):
        plain = name.replace("\0", "@")  # zipfile would cut there
        yield f"name {k} {name[:30]!r}", pack([*base, (plain, b"x")]).replace(plain.encode(), name.encode())
    yield "symlink", pack([*base, entry("resources/x", stat.S_IFLNK | 0o777, b"/etc/passwd")])
    yield (
        "symlink to a folder, then through it",
        pack([*base, entry("resources/d", stat.S_IFLNK | 0o777, b"/tmp"), ("resources/d/x", b"x")]),
    )
    yield "device file", pack([*base, entry("resources/x", stat.S_IFCHR | 0o666)])
    yield "pipe", pack([*base, entry("resources/x", stat.S_IFIFO | 0o666)])
    yield "case collision", pack([*base, ("resources/a", b"x"), ("resources/A", b"y")])
    yield "collision of composed letters", pack([*base, ("resources/\u00e9", b"x"), ("resources/e\u0301", b"y")])
    yield "file and folder", pack([*base, ("resources/a", b"x"), ("resources/a/b", b"y")])
    yield "file and folder in other case", pack([*base, ("resources/A", b"x"), ("resources/a/b", b"y")])
    yield "bomb by ratio", pack([*base, ("resources/zeros", bytes(200_000_000))], zipfile.ZIP_DEFLATED)
    yield (
        "bomb of the description",
        pack([("modelDescription.xml", b" " * 100_000_000 + GOOD["modelDescription.xml"])], zipfile.ZIP_DEFLATED),
    )
    yield "hundred thousand entries", pack([*base, *((f"resources/{k}", b"") for k in range(100_000))])
    yield "says it is small", lying(file_size=10)
    yield "says it is huge", lying(file_size=2**31)
    yield "says it is encrypted", lying(flag_bits=1)
    yield "unknown compression", lying(compress_type=99)
    yield "entries on top of each other", overlapping()


def lying(**wrong: int) -> bytes:
    """The directory says something else of the library than is there."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in GOOD.items():
            made.writestr(name, data)
        for key, value in wrong.items():
            setattr(made.getinfo(library()), key, value)
    return packed.getvalue()


def overlapping() -> bytes:
    """9000 names for the same 100 kB: nothing much in the file, 900 MB on disk."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in GOOD.items():
            made.writestr(name, data)
        made.writestr("resources/0", np.random.default_rng(4).bytes(100_000))
        first = made.getinfo("resources/0")
        for k in range(1, 9000):
            twin = zipfile.ZipInfo(f"resources/{k}", first.date_time)
            for key in ("compress_type", "flag_bits", "CRC", "compress_size", "file_size", "header_offset"):
                setattr(twin, key, getattr(first, key))
            made.filelist.append(twin)
    return packed.getvalue()


FAMILIES: dict[str, Callable[[], Iterator[tuple[str, bytes]]]] = {
    f.__name__: f for f in (not_archives, truncated, flipped, descriptions, libraries, attacks)
}


@lru_cache
def cases(family: str) -> list[tuple[str, bytes]]:
    return list(FAMILIES[family]())


@pytest.fixture(scope="module", autouse=True)
def good(tmp_path_factory: pytest.TempPathFactory) -> None:
    with zipfile.ZipFile(device(tmp_path_factory.mktemp("good") / "device.fmu")) as opened:
        GOOD.update({n: opened.read(n) for n in opened.namelist()})


@pytest.fixture
def fenced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Temporary and cache folders of this test's own."""
    for name in ("temporary", "cache", "here"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setenv("SPRAIN_COSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


def left(fenced: Path) -> list[str]:
    return sorted(str(p.relative_to(fenced)) for p in fenced.rglob("*") if p.is_file())


class Clock:
    def __init__(self) -> None:
        self.began, self.used = time.perf_counter(), self._used()

    def _used(self) -> float:
        return sum(os.times()[:4])

    def slow(self) -> str:
        wall, used = time.perf_counter() - self.began, self._used() - self.used
        return f"{wall:.2f} s, {used:.2f} s of the processor" if used > LIMIT or wall > 5 * LIMIT else ""


COUNT: dict[str, int] = {}


@pytest.mark.parametrize("family", FAMILIES)
def test_refused_in_one_line(family: str, fenced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = []
    for name, data in cases(family):
        Path("x.fmu").write_bytes(data)
        clock = Clock()
        code = _run(["check", "x.fmu"], [])
        slow = clock.slow()
        out, err = capsys.readouterr()
        COUNT[family] = COUNT.get(family, 0) + 1
        if code != 2 or not re.fullmatch(r"error: [^\n]+\n", err) or out or slow or left(fenced) != ["here/x.fmu"]:
            wrong.append((name, code, err or out, slow, left(fenced)))
        for extra in left(fenced):
            (fenced / extra).unlink()
        if "internal" in err or "Traceback" in err:
            wrong.append((name, err))
    assert not wrong, "\n".join(map(str, wrong))


def test_there_are_enough() -> None:
    assert sum(COUNT.values()) >= 300 or len(COUNT) < len(FAMILIES)


def test_the_undamaged_one_fits(fenced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.fmu").write_bytes(pack(list(GOOD.items())))
    assert _run(["check", "x.fmu"], []) == 0


def test_attacks_are_refused_before_anything_is_unpacked(fenced: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "unpacked", lambda *_: pytest.fail("unpacked"))
    for _, data in cases("attacks"):
        Path("x.fmu").write_bytes(data)
        assert _run(["check", "x.fmu"], []) == 2


def test_no_native_code_is_loaded_for_them(fenced: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What fails in archive or description starts no process, and nothing is loaded into this one."""
    from sprain_cosim.brace import check

    monkeypatch.setattr(check, "Child", lambda *_: pytest.fail("started a process"))
    for family in FAMILIES.keys() - {"libraries"}:
        for _, data in cases(family):
            Path("x.fmu").write_bytes(data)
            assert _run(["check", "x.fmu"], []) == 2


@pytest.mark.parametrize("path", ["nothing.fmu", ".", "/dev/null", "link.fmu"])
def test_no_file(path: str, fenced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("link.fmu").symlink_to("nowhere.fmu")
    assert _run(["check", path], []) == 2
    assert re.fullmatch(r"error: [^\n]+\n", capsys.readouterr().err)


def test_through_the_command(fenced: Path) -> None:
    """A sample through the real command, with its start-up time."""
    for family, name in (("not_archives", "text"), ("truncated", "truncated 20"), ("descriptions", "xml entity bomb"), ("libraries", "library text"),
                         ("attacks", "bomb by ratio"), ("attacks", "hundred thousand entries")):  # fmt: skip
        Path("x.fmu").write_bytes(dict(cases(family))[name])
        clock = Clock()
        told = subprocess.run(
            [sys.executable, "-P", "-m", "sprain_cosim", "check", "x.fmu"], capture_output=True, text=True, timeout=30
        )
        assert (told.returncode, told.stdout) == (2, ""), (name, told)
        assert re.fullmatch(r"error: [^\n]+\n", told.stderr), (name, told.stderr)
        assert not clock.slow(), name
        assert left(fenced) == ["here/x.fmu"]
