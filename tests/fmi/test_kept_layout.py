"""What is kept of a system between runs meets no other: after another landing in the same process, every changed one is
that of a fresh process, to the bit."""

from __future__ import annotations

import hashlib
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.cosim.layout import layout
from sprain_cosim.cosim.system import coupled
from sprain_cosim.mapping import read_component
from tests.native import device

STOP = "30 ms"
MAPPED = '[inputs]\nsubtalar_angle = "phi"\n[outputs]\nsubtalar_torque = {{ from = "M_out", factor = {factor} }}\n'


def braced() -> sc.Scenario:
    return sc.load_scenario("incline30_brace").with_master(stop=STOP)


def vendors(folder: Path) -> sc.Scenario:
    scenario = braced().replace_fmu("brace", folder / "vendor.fmu", folder / "vendor.map.toml")
    return scenario.unconfined()


CHANGES: dict[str, Callable[[Path], sc.Scenario]] = {
    "nothing": lambda _: braced(),
    "plant": lambda _: braced().with_parameters(plant={"drop_height": "35 cm"}),
    "brace": lambda _: braced().with_parameters(brace={"angle_scale": 1.5}),
    "step": lambda _: braced().with_master(communication_step="0.25 ms"),
    "stop": lambda _: braced().with_master(stop="20 ms"),
    "gauss-seidel": lambda _: braced().with_master(scheme="gauss-seidel"),
    "jacobi": lambda _: braced().with_master(scheme="jacobi", communication_step="0.25 ms"),
    "adaptive": lambda _: braced().with_master(adaptive=True),
    "without": lambda _: braced().without("brace"),
    "other brace": lambda _: braced().replace_fmu("brace", "brace_semi_rigid"),
    "fmi 3": lambda _: braced().replace_fmu("brace", "brace_bushing_fmi3"),
    "locals": lambda _: braced().recording("plant.*_fibre_length"),
    "subject": lambda _: (
        braced().with_subject("female, 1.63 m, 62 kg").with_parameters(plant={"initial_pose": "touching"})
    ),
    "vendor": vendors,
}


def digest(result: sc.Result) -> str:
    """Of all that a run says, times on the wall apart."""
    assert result.status == "completed", result.message
    said = (
        *(result.names, [u and u.name for u in result.units], result.scheme_reason, result.warning),
        *(result.coupling_error, result.parameters, result.metrics, result.exchanges),
    )
    content = result.time.tobytes() + result.values.tobytes() + repr(said).encode()
    return hashlib.sha256(content).hexdigest()


def fresh(change: str, folder: Path) -> str:
    """The digest in a process that has run nothing else."""
    command = [sys.executable, "-m", __name__, change, str(folder)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def deliver(folder: Path, factor: float = 1.0, **of_device: object) -> None:
    """A vendor's device and its mapping file, in the place of any before."""
    device(folder / "vendor.fmu", names=("phi", "M_out"), **of_device)
    (folder / "vendor.map.toml").write_text(MAPPED.format(factor=factor))


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """The landing that every other one comes after in this process, and the vendor's folder."""
    folder = tmp_path_factory.mktemp("vendor")
    deliver(folder)
    return digest(braced().run()), folder


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_landing_is_that_of_a_fresh_process(change: str, before: tuple[str, Path]) -> None:
    first, folder = before
    scenario = CHANGES[change](folder)
    assert digest(scenario.run()) == digest(scenario.run()) == fresh(change, folder)
    assert digest(braced().run()) == first
    assert (digest(scenario.run()) == first) == (change in ("nothing", "fmi 3"))


def test_files_that_change_under_their_names(tmp_path: Path) -> None:
    """The same description of a landing runs with what its files hold at each time."""
    deliver(tmp_path)
    scenario = vendors(tmp_path)
    found = [digest(scenario.run())]
    for factor, of_device in ((1.5, {}), (1.5, {"torque": "N.mm"}), (0.5, {"fmi": 3})):
        deliver(tmp_path, factor, **of_device)
        found.append(digest(scenario.run()))
        assert found[-1] == digest(scenario.run()) == fresh("vendor", tmp_path)
    assert len(set(found)) == len(found)
    deliver(tmp_path)
    assert digest(scenario.run()) == found[0]


def test_two_open_at_a_time_share_nothing_that_changes() -> None:
    one, other = braced(), braced().with_parameters(brace={"angle_scale": 1.5})
    alone = digest(one.run()), digest(other.run())
    with one.open() as first, other.open() as second:
        assert first.system.layout is second.system.layout
        for _ in range(2):
            assert (digest(first.run()), digest(second.run())) == alone
        assert digest(first.run({"brace.angle_scale": 1.5})) == alone[1]


def test_a_layout_belongs_to_its_components_and_connections() -> None:
    """Another content, name, connection or link is another layout; its arrays cannot be written."""
    system = braced().system()
    known = layout(system.components, system.connections, system.links)
    assert known is system.layout
    assert coupled(system.components, {})[0] is coupled(system.components, {})[0]
    fewer = dict(list(system.connections.items())[:-1])
    assert layout(system.components, fewer, system.links) is not known
    assert layout(system.components, system.connections, {"brace.rotation_x_angle": (2.0, 0.0)}) is not known
    assert layout(system.components[::-1], system.connections, system.links).names != known.names
    plant = next(c for c in system.components if c.name == "plant")
    assert read_component("plant", plant.fmu) is plant
    assert read_component("other", plant.fmu) is not plant
    for place in known.places:
        with pytest.raises(ValueError, match="read-only"):
            place.factor[:] = 0.0


def test_a_system_that_travels_finds_its_layout_again() -> None:
    """Nothing of this process, such as an address, goes along."""
    scenario = braced()
    with scenario.open() as session:
        here = digest(session.run())
        there = pickle.loads(pickle.dumps(session.system))
    assert (there.layout.names, there.layout is session.system.layout) == (session.system.layout.names, False)
    with scenario.open(system=there) as again:
        assert digest(again.run()) == here


if __name__ == "__main__":
    print(digest(CHANGES[sys.argv[1]](Path(sys.argv[2])).run()))
