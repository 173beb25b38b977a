"""Levels of processors: which one a study takes."""

from __future__ import annotations

import ctypes
import sys
import zipfile
from pathlib import Path

import pytest

from sprain_cosim import processor
from sprain_cosim.fmu.component import Component
from sprain_cosim.shipped import FMUS

OLDER, NEWER = processor.LEVELS


def test_the_lowest_of_the_workers_and_what_is_not_known() -> None:
    assert processor.lowest([NEWER, OLDER, NEWER]) == OLDER
    assert processor.lowest([NEWER]) == NEWER
    assert processor.lowest([NEWER, ""]) == processor.lowest([]) == processor.lowest(["apple-m1"]) == ""


def test_the_variable_stands_before_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(processor.VARIABLE, raising=False)
    assert processor.level() == processor.own()
    monkeypatch.setenv(processor.VARIABLE, OLDER)
    assert processor.level() == OLDER
    monkeypatch.setattr(processor, "own", lambda: OLDER)
    assert processor.runs_here(OLDER)
    assert not processor.runs_here(NEWER)
    assert not processor.runs_here("z80")


def test_the_package_and_the_fmus_agree_about_this_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(processor.VARIABLE, raising=False)
    brace = Component.read("brace", FMUS / "brace_bushing.fmu")
    instance = brace.open()
    library = instance.fmu.dll  # type: ignore[attr-defined]
    library.sprain_cosim_cpu.restype = ctypes.c_char_p
    assert library.sprain_cosim_cpu(ctypes.c_void_p(instance.fmu.component)).decode() == processor.own()  # type: ignore[attr-defined]
    instance.close()
    with zipfile.ZipFile(brace.fmu) as archive:
        assert all(level.encode() in archive.read(brace.library) for level in processor.LEVELS)


def test_what_rounding_may_change() -> None:
    assert processor.within_rounding(49.6, 49.6 * (1 + 1e-12))
    assert processor.within_rounding(float("nan"), float("nan"))
    assert not processor.within_rounding(49.6, 49.6001)
    assert not processor.within_rounding(49.6, float("nan"))


def test_linear_algebra_takes_one_thread_and_gets_its_own_back() -> None:
    before = [count() for count, _ in processor._openblas()]
    with processor.one_thread(), processor.one_thread():
        assert [count() for count, _ in processor._openblas()] == [1] * len(before)
    assert [count() for count, _ in processor._openblas()] == before
    bundled = [p for p in sys.path for _ in Path(p).glob("numpy.libs/*openblas*")]
    assert before or not bundled  # a wheel of NumPy with an OpenBLAS is found
