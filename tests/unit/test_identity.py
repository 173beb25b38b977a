"""The identity of a study: every field of its descriptions moves the digest, but for those that change no row."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.cosim.master import Master
from sprain_cosim.errors import InputError
from sprain_cosim.scenario import Scenario
from sprain_cosim.scenario.wiring import Wiring
from sprain_cosim.shipped import fmu_path
from sprain_cosim.study.codec import encode
from sprain_cosim.study.folder import load_study_plan, recorded_plan
from sprain_cosim.study.goal import Goal
from sprain_cosim.study.identity import CHANGES_NO_ROW, COUNTS_FOR, changes
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.study.manifest import Manifest
from sprain_cosim.study.marginals import Fitted
from sprain_cosim.study.merge import merge
from sprain_cosim.study.methods import METHODS
from sprain_cosim.study.plan import Plan
from sprain_cosim.study.population import Population
from sprain_cosim.study.previous import facts_today
from sprain_cosim.study.questions import Question
from sprain_cosim.study.reproduce import differences_of
from sprain_cosim.study.until import Until
from sprain_cosim.subject import Subject
from sprain_cosim.units import unit
from sprain_cosim.uq.distributions import Marginal, Normal, Truncated

METHOD = {
    "replicates": "sobol",
    "trials": "lhs",
    "threshold": "form",
    "responses": "form",
    "check": "form",
    "goal": "design",
    "vary": "design",
}  # one for which it counts


def ledger(study: Plan, folder: Path) -> Ledger:
    return Ledger(folder, study.digest, study.identity, json.dumps(encode(study)))


@pytest.fixture(scope="module")
def study() -> sc.Study:
    return sc.load_study("study6")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two mapping files of different content."""
    folder = tmp_path_factory.mktemp("maps")
    for name in ("one", "other"):
        (folder / f"{name}.toml").write_text(f"# {name}\n")
    return {name: folder / f"{name}.toml" for name in ("one", "other")}


def other(value: Any) -> Any:
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, str):
        return f"{value}x"
    if isinstance(value, tuple):
        return (*value, value[-1] if value else "x")
    raise AssertionError(f"say what another {type(value).__name__} is")


def of_master(study: Plan, name: str) -> Plan:
    master = study.scenario.master
    changed = replace(master, **{name: other(getattr(master, name))})
    return replace(study, scenario=replace(study.scenario, master=changed))


SCENARIO: dict[str, Callable[[Plan, dict[str, Path]], Any]] = {
    "fmus": lambda s, _: {**s.scenario.fmus, "brace": fmu_path("brace_linear", Path(), "")},
    "parameters": lambda s, _: {**s.scenario.parameters, "plant.drop_height": "0.31 m"},
    "connections": lambda *_: {"plant.brace_subtalar_torque": "brace.subtalar_torque"},
    "master": lambda *_: Master(stop=0.1),
    "maps": lambda _, files: {"brace": files["one"]},
    "isolate": lambda *_: ("brace",),
    "warnings": lambda *_: ("x",),
    "dropped": lambda *_: ("x",),
    "subject": lambda *_: Subject("female", {"stature": 1.63}),
    "wiring": lambda *_: Wiring(units={"brace.x": unit("deg")}, complete=("brace",)),
}
PLAN: dict[str, Callable[[Plan], Any]] = {
    "marginals": lambda s: {**s.marginals, "plant.drop_height": Normal(0.3, 0.04)},
    "units": lambda s: {**s.units, "plant.drop_height": "cm"},
    "correlation": lambda _: np.eye(10),
    "grid": lambda _: {"plant.drop_height": (0.3, 0.4)},
    "threshold": lambda _: 35.0,
    "fits": lambda _: {"brace.angle_scale": Fitted("normal", 9, "bench.csv", 1.0, 0.3, 0.5)},
    "questions": lambda _: (Question("peak_inversion_from_neutral_deg", 35.0),),
    "goal": lambda _: Goal(Question("peak_inversion_from_neutral_deg", 35.0), 0.02),
    "vary": lambda _: {"brace.angle_scale": (0.5, 3.0)},
    "tolerance": lambda _: 1e-4,
    "replicates": lambda _: 4,
    "half_width": lambda _: 0.5,
    "until": lambda _: (Until("peak_subtalar_angle_deg", 0.5, level=0.95),),
    "difference": lambda _: "central",
    "trial_limit": lambda _: 20.0,
    "levels": lambda _: (0.1, 0.9),
    "table": lambda _: np.ones((2, 10)),
    "numbers": lambda _: (0, 2),
    "population": lambda _: Population({"female": 1.0}),
    "published": lambda _: {"source": "x"},
    "responses": lambda _: ("peak_inversion_from_neutral_deg",),
    "scenario": lambda s: replace(s.scenario, parameters={}),
    "method": lambda s: "lhs" if s.method != "lhs" else "sobol",
    "warnings": lambda _: ("x",),
}


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Master)])
def test_every_field_of_the_master_moves_the_digest(study: sc.Study, name: str) -> None:
    changed = of_master(study, name)
    assert changed.digest != study.digest
    assert changes(study.identity, changed.identity)[0].startswith(f"master.{name}: ")


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Scenario)])
def test_every_field_of_the_scenario_moves_the_digest(study: sc.Study, files: dict[str, Path], name: str) -> None:
    make = SCENARIO.get(name, lambda s, _: other(getattr(s.scenario, name)))
    changed = replace(study, scenario=replace(study.scenario, **{name: make(study, files)}))
    if f"Scenario.{name}" in CHANGES_NO_ROW:
        assert changed.digest == study.digest
    else:
        assert changed.digest != study.digest
        assert changes(study.identity, changed.identity)[0].startswith(name if name != "fmus" else "fmus.brace")


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Plan)])
def test_every_field_of_the_plan_moves_the_digest(study: sc.Study, name: str) -> None:
    method = METHOD.get(name, "amv" if name in COUNTS_FOR else study.method)
    before = replace(study, method=method)
    value = PLAN[name](before) if name in PLAN else other(getattr(before, name))
    changed = replace(before, **{name: value})
    if f"Plan.{name}" in CHANGES_NO_ROW and name != "scenario":
        assert changed.digest == before.digest
    else:
        assert changed.digest != before.digest
    if name in COUNTS_FOR:
        free = next(m for m in METHODS if m not in COUNTS_FOR[name])
        assert replace(changed, method=free).digest == replace(before, method=free).digest


def test_every_number_of_every_distribution_moves_the_digest(study: sc.Study) -> None:
    def with_marginal(marginal: Marginal) -> Plan:
        return replace(study, marginals={**study.marginals, "plant.drop_height": marginal})

    for marginal in (*study.marginals.values(), Truncated(Normal(0.3, 0.05), 0.2, 0.4)):
        before = with_marginal(marginal)
        for field in dataclasses.fields(marginal):
            if field.init:
                value = getattr(marginal, field.name)
                changed = Normal(0.31, 0.05) if isinstance(value, Marginal) else value * 1.01 + 0.001
                assert with_marginal(replace(marginal, **{field.name: changed})).digest != before.digest, field.name


def test_files_count_by_their_content(study: sc.Study, files: dict[str, Path], tmp_path: Path) -> None:
    """The same content elsewhere is the same study, another content at the same place is not."""
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(study.scenario.fmus["brace"].read_bytes())
    moved = replace(study, scenario=replace(study.scenario, fmus={**study.scenario.fmus, "brace": copy}))
    assert moved.digest == study.digest
    copy.write_bytes(copy.read_bytes() + b"x")
    assert changes(study.identity, moved.identity)[0].startswith("fmus.brace: ")
    one, two = (replace(study, scenario=replace(study.scenario, maps={"brace": f})) for f in files.values())
    assert one.digest != two.digest


def test_the_order_of_inputs_and_components_counts(study: sc.Study) -> None:
    """The ledger holds inputs without their names, and components are stepped in their order."""
    turned = replace(study, marginals=dict(reversed(study.marginals.items())))
    assert turned.digest != study.digest
    fmus = dict(reversed(study.scenario.fmus.items()))
    assert replace(study, scenario=replace(study.scenario, fmus=fmus)).digest != study.digest


def test_what_changes_no_row_is_a_field_that_exists() -> None:
    fields = {f"{c.__name__}.{f.name}" for c in (Plan, Scenario) for f in dataclasses.fields(c)}
    assert set(CHANGES_NO_ROW) <= fields
    assert {f"Plan.{name}" for name in COUNTS_FOR} <= fields - set(CHANGES_NO_ROW)


def test_long_tables_count_by_their_hash(study: sc.Study) -> None:
    x = np.arange(20_000.0).reshape(-1, 10)
    long = replace(study, method="table", table=x, numbers=tuple(range(len(x))))
    assert len(str(long.identity)) < 5000
    assert replace(long, table=x + 1).digest != long.digest
    assert replace(long, numbers=tuple(range(1, len(x) + 1))).digest != long.digest


def test_resume_and_merge_name_the_field_that_changed(study: sc.Study, tmp_path: Path) -> None:
    changed = of_master(study, "adaptive")
    ledger(study, tmp_path / "a").close()
    for name in ("adaptive", "identify", "start", "guard"):
        with pytest.raises(InputError, match=rf"holds another study \(master.{name}: \S+ then, \S+ now\)"):
            ledger(of_master(study, name), tmp_path / "a")
    ledger(changed, tmp_path / "b").close()
    with pytest.raises(InputError, match=r"another study than .*/a \(master.adaptive: 0.0 there, 1.0 here\)"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")


def test_a_folder_says_which_file_has_changed(study: sc.Study, tmp_path: Path) -> None:
    brace = tmp_path / "edited.fmu"  # of which the cache has no copy from another test
    brace.write_bytes(study.scenario.fmus["brace"].read_bytes())
    own = study.replace_fmu("brace", brace)
    ledger(own, tmp_path / "s").close()
    with Ledger.read(tmp_path / "s") as written:
        assert load_study_plan(tmp_path / "s", written).digest == own.digest
        brace.write_bytes(fmu_path("brace_linear", Path(), "").read_bytes())
        with pytest.raises(InputError, match=r"fmus.brace: \w{12} then, \w{12} now"):
            load_study_plan(tmp_path / "s", written)
        assert recorded_plan(tmp_path / "s", written).heading == own.heading


def test_a_correlated_sample_of_the_previous_version_is_not_continued(study: sc.Study) -> None:
    """Its columns were drawn in the order of the file's lines, ours are in that of their names."""
    correlation = np.eye(10)
    correlation[0, 6] = correlation[6, 0] = 0.5
    joined = replace(study, correlation=correlation)
    then = {"version": "0.1.0", "master": ["0.5 ms", "0.15 s", "auto"]}
    facts = facts_today({"identity": json.dumps(then), "study": json.dumps(encode(joined))})
    different = changes(json.loads(facts["identity"]), joined.identity, ("version", "fmus", "maps"))
    assert [line.partition(":")[0] for line in different] == ["order.drawing"]
    alone = facts_today({"identity": json.dumps(then), "study": json.dumps(encode(study))})
    assert not changes(json.loads(alone["identity"]), study.identity, ("version", "fmus", "maps"))


def test_software_and_mapping_files_that_differ_are_named() -> None:
    then = Manifest({"numpy": "1.0", "scipy": "1.17"}, platform="there", identity={"maps": {"brace": "a" * 64}})
    now = replace(then, versions={"numpy": "2.0", "scipy": "1.17"}, identity={"maps": {"brace": "b" * 64}})
    assert differences_of(then, now) == [
        "numpy 1.0 then, 2.0 now",
        "mapping file brace: SHA-256 aaaaaaaaaaaa then, bbbbbbbbbbbb now",
    ]
    assert differences_of(then, then) == []
