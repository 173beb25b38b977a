"""The ledger against flipped bits: no row that is not as it was written; what is lost is named and runs again."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path, PureWindowsPath

import numpy as np
import pytest

from sprain_cosim.errors import EnvironmentProblem, InputError, SprainError
from sprain_cosim.study.ledger import BEFORE_CHECKSUMS, FILE, Ledger, Row, _address
from sprain_cosim.study.worker import Outcome

IDENTITY = {"seed": 7, "fmus": {"plant": "0" * 64}}
TRIALS = 300


def row(trial: int) -> Row:
    rng = np.random.default_rng(trial)
    failed = trial % 50 == 3
    metrics = {} if failed else {f"metric_{k}": float(v) for k, v in enumerate(rng.normal(size=12))}
    outcome = Outcome(
        "failed" if failed else "completed", "too stiff" if failed else "", metrics, 0.01 * trial, 1, "log"
    )
    return Row(trial, rng.normal(size=5), outcome, str(trial % 2))


def content(found: Row) -> tuple[object, ...]:
    o = found.outcome
    return (
        found.trial,
        found.inputs.tobytes(),
        o.status,
        o.message,
        tuple(o.metrics.items()),
        o.wall,
        o.attempts,
        o.log,
        found.worker,
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ledger") / "whole"
    with Ledger(folder, "digest", IDENTITY, '"the study"') as ledger:
        for trial in range(TRIALS):
            ledger.add(row(trial))
    return folder


def flip(file: Path, bit: int) -> None:
    data = bytearray(file.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    file.write_bytes(data)


def test_200_flipped_bits(written: Path, tmp_path: Path) -> None:
    """A writer has only rows as they were written, or refuses in one line; what it dropped it names, or runs as if it
    had never been. A reader gives such rows or refuses."""
    rng = np.random.default_rng(20260101)
    size = (written / FILE).stat().st_size
    expected = {trial: content(row(trial)) for trial in range(TRIALS)}
    mended = refused = dropped = 0
    said: list[str] = []
    for bit in rng.integers(0, 8 * size, 200).tolist():
        folder = tmp_path / str(bit)
        shutil.copytree(written, folder)
        flip(folder / FILE, bit)
        try:
            with Ledger.read(folder) as ledger:
                assert all(content(found) == expected[found.trial] for found in ledger.rows())
        except InputError as problem:
            said.append(str(problem))
        try:
            with Ledger(folder, "digest", IDENTITY, '"the study"') as ledger:
                have = {found.trial: content(found) for found in ledger.rows()}
                assert set(have) == set(ledger.finished()[0].tolist())
                assert all(expected[trial] == found for trial, found in have.items())
                assert not set(ledger.dropped) & set(have)
                mended, dropped = mended + ledger.mended, dropped + TRIALS - len(have)
                for trial in expected.keys() - have.keys():
                    ledger.add(row(trial))
                ledger.commit()
                assert {found.trial: content(found) for found in ledger.rows()} == expected
        except InputError as problem:
            said.append(str(problem))
            refused += 1
        shutil.rmtree(folder)
    assert not [line for line in said if "\n" in line]
    assert mended > 100
    assert refused < 20
    assert 100 < dropped < TRIALS * mended


def test_pages_full_of_noise(written: Path, tmp_path: Path) -> None:
    """Every page of the file once: the rows of the other pages stay, and the file takes rows again."""
    rng = np.random.default_rng(5)
    data = (written / FILE).read_bytes()
    kept = []
    for page in range(1, len(data) // 4096):
        folder = tmp_path / str(page)
        shutil.copytree(written, folder)
        noisy = bytearray(data)
        noisy[4096 * page : 4096 * (page + 1)] = rng.bytes(4096)
        (folder / FILE).write_bytes(noisy)
        try:
            with Ledger(folder, "digest", IDENTITY) as ledger:
                have = ledger.finished()[0].tolist()
                assert all(content(found) == content(row(found.trial)) for found in ledger.rows())
                kept.append(len(have))
                for trial in set(range(TRIALS)) - set(have):
                    ledger.add(row(trial))
        except InputError:
            kept.append(0)
        shutil.rmtree(folder)
    assert sum(k > TRIALS // 2 for k in kept) > 0.7 * len(kept), kept


def test_damaged_rows_are_named(written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "named"
    shutil.copytree(written, folder)
    database = sqlite3.connect(folder / FILE)
    for trial in (17, 204):
        values = np.frombuffer(database.execute("SELECT metrics FROM trials WHERE trial = ?", (trial,)).fetchone()[0])
        changed = values + 1e-12
        database.execute("UPDATE trials SET metrics = ? WHERE trial = ?", (changed.tobytes(), trial))
    database.commit()
    database.close()
    with (
        Ledger.read(folder) as ledger,
        pytest.raises(InputError, match=r"trial 17 does not fit its checksum; continue .* --resume"),
    ):
        list(ledger.rows())
    with Ledger(folder, "digest", IDENTITY) as ledger:
        assert (ledger.dropped, ledger.mended) == ([17, 204], True)
        assert len(ledger.finished()[0]) == TRIALS - 2
    with Ledger(folder, "digest", IDENTITY) as ledger:
        assert (ledger.dropped, ledger.mended) == ([], False)


def test_rows_of_another_study_do_not_count(written: Path, tmp_path: Path) -> None:
    """Rows carry the study's digest: a ledger whose own word for it was changed has none that fit."""
    folder = tmp_path / "other"
    shutil.copytree(written, folder)
    database = sqlite3.connect(folder / FILE)
    database.execute("UPDATE study SET value = 'other' WHERE key = 'digest'")
    database.commit()
    database.close()
    with pytest.raises(InputError, match="damaged"):
        Ledger.read(folder)
    with pytest.raises(InputError, match="no row in it is as it was written"):
        Ledger(folder, "other", IDENTITY)
    with Ledger(folder, "digest", IDENTITY) as ledger:  # the rows say what they belong to
        assert len(ledger.finished()[0]) == TRIALS


def test_a_folder_of_any_name_is_read(written: Path, tmp_path: Path) -> None:
    """What would mean something in a URI, and the folders of Windows, on a drive and on a server."""
    folder = tmp_path / "50 % of what? #1 – λ"
    shutil.copytree(written, folder)
    with Ledger.read(folder) as ledger:
        assert ledger.count() == TRIALS
    assert _address(PureWindowsPath("C:/my runs/ledger.sqlite")) == "file:///C:/my%20runs/ledger.sqlite"
    assert _address(PureWindowsPath("//server/share/ledger.sqlite")) == "file:////server/share/ledger.sqlite"


def test_reading_leaves_nothing_beside_and_disturbs_no_writer(written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "read"
    shutil.copytree(written, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with Ledger.read(folder) as one, Ledger.read(folder) as other:
        assert one.count() == other.count() == TRIALS
        with pytest.raises(sqlite3.OperationalError, match="readonly"):
            one._database.execute("DELETE FROM trials")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    with Ledger.read(folder) as early, Ledger(folder, "digest", IDENTITY, '"the study"') as writer:
        writer.add(row(TRIALS))
        writer.commit()
        early.close()
        with Ledger.read(folder) as late:
            assert late.count() == TRIALS + 1
        writer.add(row(TRIALS + 1))
        writer.commit()
    with Ledger.read(folder) as ledger:
        assert [found.trial for found in ledger.rows()] == list(range(TRIALS + 2))


def test_a_ledger_without_checksums_is_read(written: Path, tmp_path: Path) -> None:
    """As version 0.1 wrote them."""
    folder = tmp_path / "old"
    shutil.copytree(written, folder)
    database = sqlite3.connect(folder / FILE)
    database.executescript(
        f"ALTER TABLE trials DROP COLUMN checksum; DELETE FROM study WHERE key = 'checksum';"
        f"PRAGMA user_version = {BEFORE_CHECKSUMS};"
    )
    database.close()
    with Ledger.read(folder) as ledger:
        assert [content(found) for found in ledger.rows()] == [content(row(trial)) for trial in range(TRIALS)]
        assert ledger.facts["study"] == '"the study"'
    with pytest.raises(InputError, match="another version"):
        Ledger(folder, "digest", IDENTITY)


def test_what_is_no_ledger_is_one_line(tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(b"SQLite format 3\0" + bytes(200))
    for attempt in (lambda: Ledger.read(tmp_path), lambda: Ledger(tmp_path, "digest", IDENTITY)):
        with pytest.raises((InputError, EnvironmentProblem)) as caught:
            attempt()
        assert isinstance(caught.value, SprainError) and "\n" not in str(caught.value)


def test_a_damaged_study_is_mended_by_resume(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The damaged trial is named, runs again, and the tables are the same to the byte."""
    from sprain_cosim.cli import _run

    command = ["study", "study2", "--trials", "4", "--workers", "1", "--out", str(tmp_path / "s")]
    assert _run(command, []) == 0
    before = (tmp_path / "s" / "trials.csv").read_bytes()
    database = sqlite3.connect(tmp_path / "s" / FILE)
    database.execute("UPDATE trials SET message = 'x' WHERE trial = 2")
    database.commit()
    database.close()
    capsys.readouterr()
    assert _run(["trial", str(tmp_path / "s"), "2"], []) == 2
    assert "trial 2 does not fit its checksum" in capsys.readouterr().err
    assert _run([*command, "--resume"], []) == 0
    assert "warning: " in (said := capsys.readouterr().err)
    assert "its ledger was damaged; trials 2 were dropped and run again" in said
    assert (tmp_path / "s" / "trials.csv").read_bytes() == before
