"""A study over three hosts that loses one of them: network namespaces that the test makes, joined by a bridge in one of
them; nothing leaves them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.study.ledger import Ledger

TRIALS = 90
HUB = "10.77.0.1"
ADDRESS = f"tcp://{HUB}:8786"
LIMIT = 240.0  # s

pytest.importorskip("distributed")
pytestmark = pytest.mark.long


class Host:
    """A network namespace of its own, as long as its first process lives."""

    def __init__(self) -> None:
        self._holder = subprocess.Popen(["unshare", "--net", "sleep", "infinity"], start_new_session=True)
        self._programs: list[subprocess.Popen[bytes]] = []
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        own = os.readlink("/proc/self/ns/net")
        deadline = time.monotonic() + 10.0
        while os.readlink(f"/proc/{self.process}/ns/net") == own:  # until it has left this one
            assert self._holder.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        self.run("ip", "link", "set", "lo", "up")

    @property
    def process(self) -> int:
        return self._holder.pid

    def run(self, *command: str) -> None:
        subprocess.run(self._inside(command), check=True, capture_output=True)

    def start(self, *command: str, **environment: str) -> subprocess.Popen[bytes]:
        started = subprocess.Popen(
            self._inside(command),
            env=os.environ | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            start_new_session=True,
        )
        self._programs.append(started)
        return started

    def _inside(self, command: tuple[str, ...]) -> list[str]:
        return ["nsenter", "--target", str(self.process), "--net", *command]

    def said(self) -> str:
        """What its programs wrote to stderr."""
        self._said.seek(0)
        return self._said.read().decode("utf-8", "replace")

    def end(self) -> None:
        for program in (*self._programs, self._holder):
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
        self._said.close()


@pytest.fixture
def hosts() -> Iterator[tuple[Host, list[Host]]]:
    """One with a bridge, and three that hang on it: 10.77.0.1, and .11 to .13."""
    if os.geteuid() != 0 or not all(shutil.which(tool) for tool in ("ip", "unshare", "nsenter")):
        pytest.skip("three hosts: need root, ip and unshare, to make network namespaces")
    made: list[Host] = []
    try:
        try:
            made += [Host() for _ in range(4)]
            hub, *three = made
            hub.run("ip", "link", "add", "bridge", "type", "bridge")
            hub.run("ip", "address", "add", f"{HUB}/24", "dev", "bridge")
            hub.run("ip", "link", "set", "bridge", "up")
            for k, host in enumerate(three, 1):
                ends = ("ip", "link", "add", f"host{k}", "type", "veth", "peer", "name", "net", "netns")
                hub.run(*ends, str(host.process))
                hub.run("ip", "link", "set", f"host{k}", "master", "bridge", "up")
                host.run("ip", "address", "add", f"10.77.0.{10 + k}/24", "dev", "net")
                host.run("ip", "link", "set", "net", "up")
        except (OSError, subprocess.CalledProcessError, AssertionError) as problem:
            pytest.skip(f"three hosts: this machine makes no network namespaces ({problem})")
        yield hub, three
    finally:
        for host in made:
            host.end()


def test_a_study_that_loses_one_of_three_hosts_is_equal_to_the_byte(
    hosts: tuple[Host, list[Host]], tmp_path: Path
) -> None:
    """The cable is pulled when a third of the trials is in the ledger: the host is silent, not gone. Its trials run on
    the other two."""
    hub, three = hosts
    sc.load_study("study6").run(trials=TRIALS, workers=2, out=tmp_path / "here", trajectories=0)
    python, impatient = (sys.executable, "-m"), {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "6s"}
    dask = (*python, "distributed.cli.dask_scheduler", "--host", HUB, "--port", "8786", "--no-dashboard", "--no-show")
    hub.start(*dask, **impatient)
    for k, host in enumerate(three, 1):
        place = tmp_path / f"host{k}"
        place.mkdir()
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(place))
        own = ("--host", f"10.77.0.{10 + k}", "--death-timeout", "60")
        host.start(*python, "distributed.cli.dask_worker", ADDRESS, *options, *own)
    out = tmp_path / "there"
    options = ("--trials", str(TRIALS), "--workers", "3", "--trajectories", "none", "--progress", "none")
    study = hub.start(*python, "sprain_cosim", "study", "study6", "--scheduler", ADDRESS, *options, "--out", str(out))
    began, pulled = time.monotonic(), False
    while study.poll() is None:
        assert time.monotonic() - began < LIMIT
        time.sleep(0.1)
        if not pulled and _workers_of(out, TRIALS // 3) == 3:
            three[2].run("ip", "link", "set", "net", "down")
            pulled = True
    assert (study.returncode, pulled) == (0, True), hub.said()
    assert (out / "trials.csv").read_bytes() == (tmp_path / "here" / "trials.csv").read_bytes()


def _workers_of(folder: Path, least: int) -> int:
    """How many workers have finished a trial, once there are `least` of them."""
    try:
        with Ledger.read(folder) as ledger:
            rows = list(ledger.rows()) if ledger.count() >= least else []
    except sc.errors.SprainError:  # not yet there
        return 0
    return len({row.worker for row in rows})
