"""What `check` notes of a device's conduct, from what it was seen to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim import check_brace
from sprain_cosim.errors import InputError
from sprain_cosim.sandbox.kernel import SIGNAL_ABI, offered
from tests.native import mischief

pytestmark = pytest.mark.skipif(
    offered().landlock < SIGNAL_ABI or not offered().seccomp, reason=f"this kernel offers {offered()}"
)
SEEN = {
    "thread": "starts threads",
    "own_file": "writes files into its working folder, which is gone after it: device.log",
    "umask": "changes of its process: umask",
    "folder": "changes of its process: working folder",
    "environment": "changes of its process: environment",
    "round_up": "changes of its process: rounding mode",
    "trap": "changes of its process: traps of arithmetic",
    "socket": 'allow = ["network"]',
    "fork_stays": 'allow = ["exec"]',
    "kill_parent": "tries what the sandbox refuses: signals",
}


@pytest.mark.parametrize("kind", SEEN)
def test_what_it_does_is_noted(kind: str, tmp_path: Path) -> None:
    notes = check_brace(mischief(tmp_path / "brace.fmu", kind)).notes
    assert [note for note in notes if SEEN[kind] in note], notes


def test_what_it_reads_and_writes_elsewhere_is_named(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.mkdir()
    (target / "secret").write_text("x")
    notes = " ".join(check_brace(mischief(tmp_path / "brace.fmu", "steal", target)).notes)
    assert f'allow = ["read:{target}/secret"]' in notes
    assert f"tries to write outside its own folder, which is refused: {target}/stolen" in notes


def test_a_quiet_device_has_no_such_notes(tmp_path: Path) -> None:
    notes = " ".join(check_brace(mischief(tmp_path / "brace.fmu")).notes)
    for word in ("threads", "writes", "changes of its process", "sandbox", "allow"):
        assert word not in notes


def test_a_crash_while_it_is_freed_is_told_from_one_before(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="crashes while it is freed: ended by signal SIGSEGV"):
        check_brace(mischief(tmp_path / "a.fmu", "crash_in_free"))
    with pytest.raises(InputError, match="cannot be instantiated: ended by signal SIGSEGV"):
        check_brace(mischief(tmp_path / "b.fmu", "crash_in_instantiate"))
