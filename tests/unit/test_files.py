"""Files are whole or absent; what cannot be read says where and why in one line."""

from __future__ import annotations

import ast
import os
import threading
from pathlib import Path

import pandas as pd
import pytest

from sprain_cosim import files
from sprain_cosim.errors import EnvironmentProblem, InputError

PACKAGE = Path(files.__file__).parent


def test_a_text_is_written_whole_and_leaves_nothing_beside(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    files.write(target, "one\r\n°\n")
    files.write(target, "two\r\n°\n")
    assert target.read_bytes() == "two\r\n°\n".encode()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_writer_that_raises_keeps_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "film.webp"
    target.write_text("old")

    def draw() -> None:
        with files.whole_file(target) as partial:
            assert partial.suffix == ".webp"
            partial.write_text("half")
            raise KeyError("frame")

    with pytest.raises(KeyError):
        draw()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["film.webp"]


def test_a_full_disk_is_one_line_with_the_advice(tmp_path: Path) -> None:
    target = tmp_path / "a.json"
    with pytest.raises(EnvironmentProblem) as caught, files.whole_file(target, "; continue with --resume"):
        raise OSError(28, "No space left on device")
    assert str(caught.value) == f"{target}: cannot be written: No space left on device; continue with --resume"
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_absent_or_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path, parents in ((tmp_path / "no" / "a", False), (tmp_path / "file" / "a", True)):
        with pytest.raises(EnvironmentProblem, match=rf"{path}: cannot be written: "):
            files.write(path, "", parents=parents)
    files.write(tmp_path / "no" / "a", "made", parents=True)
    assert (tmp_path / "no" / "a").read_text() == "made"


def test_a_file_is_no_folder_and_not_replaced_by_what_stands_beside_it(tmp_path: Path) -> None:
    """`motion -o start.md` and `brace calibrate -o values.png` were replaced by the page and the picture."""
    for path in (Path(), Path("/"), tmp_path):
        with pytest.raises(InputError, match="is a folder; name a file"):
            files.check_file(path)
    with pytest.raises(InputError, match=r"start.png: the .png of that name is written beside it"):
        files.check_file(tmp_path / "start.png", beside=(".md", ".png"))
    files.check_file(tmp_path / "start.toml", beside=(".md", ".png"))


def test_a_file_is_not_written_over_what_it_is_made_of(tmp_path: Path) -> None:
    """`anatomy from-csv table.csv -o table.csv` left a scenario where the measurements had been."""
    table = tmp_path / "table.csv"
    files.check_file(table, [table])
    table.write_text("angle [deg]\n")
    with pytest.raises(InputError, match=r"table.csv: is what it would be made of; name another file"):
        files.check_file(tmp_path / ".." / tmp_path.name / "table.csv", [None, tmp_path / "other.csv", table])


def test_a_folder_called_tilde_is_no_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with files.whole_file(Path("~/x/t.csv"), parents=True) as partial:
        pd.DataFrame({"a": [1]}).to_csv(partial, index=False)
    assert (tmp_path / "~" / "x" / "t.csv").read_text() == "a\n1\n"
    assert files.read_frame(Path("~/x/t.csv"))["a"].tolist() == [1]


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "here").write_text("")
    with pytest.raises(EnvironmentProblem, match=r"here/x: cannot be written: .*here is a file$"):
        files.write(tmp_path / "here" / "x", "", parents=True)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_written_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    files.write(pipe, b"through")
    reader.join(10)
    assert received == [b"through"]
    assert pipe.is_fifo()


def test_two_writers_of_one_file_never_mix(tmp_path: Path) -> None:
    target = tmp_path / "a.bin"
    contents = [bytes([k]) * 300_000 for k in range(8)]
    writers = [threading.Thread(target=files.write, args=(target, content)) for content in contents]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert target.read_bytes() in contents
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_the_owner_of_a_folder_removes_half_written_files(tmp_path: Path) -> None:
    with files.whole_file(tmp_path / "a.csv.gz") as partial:
        partial.write_text("x")
        assert files.is_partial(partial)
        (tmp_path / ".b.0123abcd.partial.csv").write_text("half")
    for name in (".lock", "a.partial.csv", ".partial"):
        (tmp_path / name).write_text("")
    files.sweep(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv.gz", ".lock", "a.partial.csv", ".partial"}


def test_json_goes_out_and_comes_back(tmp_path: Path) -> None:
    content = {"a": [1, 0.1, None, "°"], "b": {"c": True}}
    files.write_json(tmp_path / "a.json", content)
    assert files.read_json(tmp_path / "a.json") == content
    with pytest.raises(ValueError, match="JSON"):
        files.write_json(tmp_path / "a.json", {"a": float("nan")})
    assert files.read_json(tmp_path / "a.json") == content


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b'{"a": 1,\n "b" 2}', "cannot be read: not valid JSON: Expecting ':' delimiter (at line 2, column 6)"),
        (b"", "cannot be read: not valid JSON: Expecting value (at line 1, column 1)"),
        (b"[1]", "cannot be read: must hold one JSON object"),
        (b"\xff\xfe{", "is not UTF-8 text"),
        (b"[" * 200_000, "cannot be read: brackets nested too deeply"),
        (b'{"a": ' + b"9" * 10_000 + b"}", "cannot be read: Exceeds the limit"),
    ],
)
def test_json_that_cannot_be_read_says_where_and_why(tmp_path: Path, content: bytes, cause: str) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        files.read_json(path)
    assert str(caught.value).startswith(f"{path}: {cause}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b"a = 1\nb =\n", "not valid TOML: Invalid value (at line 2, column 4)"),
        (b"a = '\xe9'", "is not UTF-8 text"),
        (b"a = " + b"[" * 200_000, "not valid TOML: "),
        (b"a = " + b"9" * 10_000, "not valid TOML: "),
    ],
)
def test_toml_that_cannot_be_read_says_where_and_why(tmp_path: Path, content: bytes, cause: str) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        files.read_toml(path)
    assert str(caught.value).startswith(f"{path}: {cause}")
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert files.read_toml(tmp_path / "a.toml") == {"a": 1}
    assert files.parse_toml("\ufeffa = 1\n", "vendor.fmu:map") == {"a": 1}


def test_a_file_that_is_absent_or_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"^{tmp_path / 'no.json'}: no such file$"):
        files.read_json(tmp_path / "no.json")
    with pytest.raises(InputError, match=rf"^{tmp_path}: cannot be read: "):
        files.read_toml(tmp_path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such device here")
def test_what_has_no_size_and_no_end_is_not_read_whole() -> None:
    """It took all memory of the machine."""
    with pytest.raises(InputError, match=r"^/dev/zero: more than 2\.0 MB are not accepted$"):
        files.read_text(Path("/dev/zero"))
    for reader in (files.read_json, files.read_toml, lambda path: list(files.read_csv(path)), files.read_frame):
        with pytest.raises(InputError, match=r"^/dev/zero: "):
            reader(Path("/dev/zero"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_text_from_a_pipe_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_bytes, args=(b"\xef\xbb\xbfa\r\nb\n",))
    writer.start()
    assert files.read_text(tmp_path / "pipe") == "a\nb\n"
    writer.join()


def test_only_this_module_renames_files_and_parses_toml_or_json_from_disk() -> None:
    """`json.loads` of a pipe or of a database's cell is not from disk."""
    forbidden = {"os.replace", "SYSTEM.rename", "tomllib.load", "tomllib.loads", "json.load"}
    for path in sorted(PACKAGE.rglob("*.py")):
        calls = {ast.unparse(node.func) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)}
        if path.name == "cache.py":
            calls.discard("SYSTEM.rename")  # of folders
        assert path.name == "files.py" or path.parent.name == "machine" or not calls & forbidden, path


def test_control_characters_are_shown_not_sent() -> None:
    from sprain_cosim.errors import visible

    assert visible("a\x1b[31mred\x07\x9b2J\u202eé ·\n") == "a\\x1b[31mred\\x07\\x9b2J\\u202eé ·\n"


def test_a_path_of_windows_in_toml_is_explained() -> None:
    with pytest.raises(InputError, match="write a path of Windows with / , or between single quotes"):
        files.parse_toml('[components.brace]\nfmu = "C:\\vendor\\brace.fmu"\n', "own.toml")
    with pytest.raises(InputError) as other:
        files.parse_toml("[components.brace\n", "own.toml")
    assert "Windows" not in str(other.value)
