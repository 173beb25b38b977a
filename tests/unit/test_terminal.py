"""What a console has no sign for is written in letters."""

from __future__ import annotations

import ast
import codecs
import io
import sys

import click
import pytest

from sprain_cosim import shipped, terminal

codecs.register_error(terminal.NAME, terminal.replacement)


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("utf-8", "30° · −1.5 → λ ≥ 10⁻⁶ m²"),
        ("cp437", "30° · -1.5 -> lamda ≥ 10^-6 m²"),
        ("cp1252", "30° · -1.5 -> lamda >= 10^-6 m²"),
        ("ascii", "30 deg . -1.5 -> lamda >= 10^-6 m^2"),
    ],
)
def test_signs_become_letters_where_there_are_none(encoding: str, shown: str) -> None:
    assert "30° · −1.5 → λ ≥ 10⁻⁶ m²".encode(encoding, terminal.NAME).decode(encoding) == shown


@pytest.mark.parametrize("encoding", ["cp437", "cp1252", "cp850", "ascii"])
def test_no_text_of_the_package_is_lost(encoding: str) -> None:
    """Every sign in a string of the package can be read, and no question mark comes that was not there."""
    signs = {
        sign
        for path in shipped.PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for sign in node.value
        if ord(sign) > 126 and sign.isprintable()
    }
    assert len(signs) > 50
    lost = [sign for sign in sorted(signs) if b"?" in sign.encode(encoding, terminal.NAME)]
    assert not lost


def test_what_asks_for_attention_is_coloured_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "ok     x\nwarning: a\n  error: b\nnext: sprain-cosim run x\nan error: none"
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    shown = terminal.coloured(text, 80)
    assert shown.count("\x1b[0m") == 3
    assert click.unstyle(shown) == text
    assert terminal.coloured(text, None) == text
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal.coloured(text, 80) == text
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert terminal.coloured(text, 80) == text


def test_a_stream_takes_what_it_cannot_encode(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.TextIOWrapper(written, encoding="cp437"))
    terminal.make_readable()
    print("30° → γ", flush=True)
    assert written.getvalue().decode("cp437").strip() == "30° -> gamma"
