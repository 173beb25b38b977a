"""The record of a landing in few bytes: exact, and refused when anything in it is not as it was written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.record import MARK, read_record, record_bytes
from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.study.trajectories import read_trajectory
from sprain_cosim.units import Unit


def result(values: np.ndarray) -> Result:
    names = tuple(f"plant.x{k}" for k in range(values.shape[1]))
    units = (Unit("deg/s"), None, *[Unit("N.m")] * (values.shape[1] - 2))
    return Result(5e-4 * np.arange(len(values)), values, names, units, "completed", "", "")


EXTREMES = np.array([[0.1 + 0.2, np.nan, -0.0], [5e-324, 1.7976931348623157e308, np.inf], [-1.0, 1.0, 1e-300]])


@pytest.mark.parametrize("values", [EXTREMES, EXTREMES[:1], np.empty((0, 3)), np.tile(EXTREMES, (200, 1))])
def test_what_is_read_is_what_was_written(values: np.ndarray) -> None:
    written = result(values)
    read = read_record(record_bytes(written), "here")
    assert read.values.tobytes() == written.values.tobytes()
    assert read.values.shape == values.shape
    assert read.time.tobytes() == written.time.tobytes()
    assert (read.names, read.units) == (written.names, written.units)


def test_a_changed_or_shortened_record_is_one_line() -> None:
    data = record_bytes(result(EXTREMES))
    for k in range(len(data)):
        with pytest.raises(InputError, match=r"^here: "):
            read_record(data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :], "here")
        with pytest.raises(InputError, match=r"^here: "):
            read_record(data[:k], "here")


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b'{"names": ["a"], "units": [null], "rows": 100000000}', "more than 256 MB"),
        (b'{"names": ["a"], "units": [null], "rows": -1}', "more than 256 MB"),
        (b'{"names": ["a"], "units": [], "rows": 0}', "damaged"),
        (b'{"names": 3, "units": [], "rows": 0}', "damaged"),
        (b'{"names": ["a"], "units": [["deg"]], "rows": 0}', "damaged"),
        (b"[" * 3000, "nested too deeply|cannot be read"),
    ],
)
def test_a_head_that_no_record_has_is_one_line(head: bytes, words: str) -> None:
    import struct
    import zlib

    data = MARK + struct.pack("<I", len(head)) + head + zlib.compress(b"")
    with pytest.raises(InputError, match=words):
        read_record(data + struct.pack("<I", zlib.crc32(data)), "here")


def test_a_file_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_trajectory(tmp_path / "000001.record")
    with (tmp_path / "000002.record").open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(InputError, match="more than 256 MB"):
        read_trajectory(tmp_path / "000002.record")
