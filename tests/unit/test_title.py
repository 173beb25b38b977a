"""Headings say what ran: no option and no replaced FMU leaves an untrue one."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.folders.run import RunSummary
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.scenario.title import heading
from sprain_cosim.shipped import fmu_path, shipped_scenarios, shipped_studies


@pytest.fixture
def cuff(tmp_path: Path) -> Path:
    shutil.copy(fmu_path("brace_linear", tmp_path, "brace"), tmp_path / "cuff.fmu")
    return tmp_path / "cuff.fmu"


def test_shipped_descriptions_are_made_from_what_runs() -> None:
    """No file that ships states its slope, brace or muscles in words of its own."""
    headings = {name: load_scenario(name).heading for name in shipped_scenarios()}
    assert headings["incline30_brace"] == "30° slope, 240 % brace, ankle muscles off"
    assert headings["incline30_mixed"] == "30° slope, 150 % brace, co-activation 20 %, reflex gain 5"
    assert headings["level"] == "Level floor, no brace, ankle muscles off"
    assert len(set(headings.values())) == len(headings)
    studies = {name: sc.load_study(name).heading for name in shipped_studies()}
    assert studies["study5"] == "Study 5: 30° slope, 240 % brace, ankle muscles off"
    assert studies["demers2017"] == "DeMers 2017: 30° slope, no brace, varied co-activation, varied reflex gain"
    for name in shipped_scenarios():
        assert not load_scenario(name).title


def test_an_option_changes_the_description(cuff: Path) -> None:
    braced = load_scenario("incline30_brace")
    assert braced.override("brace.angle_scale", 1.5).heading == "30° slope, 150 % brace, ankle muscles off"
    assert braced.override("brace.torque_scale", 2).heading.startswith("30° slope, 240 % brace with 2 times the torque")
    assert braced.override("plant.platform_incline", "0.3 rad").heading.startswith("17.19° slope, ")
    assert braced.replace_fmu("brace", cuff).heading == "30° slope, brace cuff.fmu, ankle muscles off"
    assert braced.replace_fmu("brace", "brace_linear").heading == "30° slope, brace_linear, ankle muscles off"
    assert braced.without("brace").heading == "30° slope, no brace, ankle muscles off"
    assert braced.without("brace").without("brace").heading == "30° slope, no brace, ankle muscles off"
    stiff = braced.replace_fmu("brace", "brace_linear").override("brace.subtalar_stiffness_coefficient", "80 N.m/rad")
    assert stiff.heading == "30° slope, brace_linear (subtalar_stiffness_coefficient 80 N.m/rad), ankle muscles off"


def test_what_the_description_does_not_name_is_listed_once() -> None:
    changed = load_scenario("incline30").override("plant.drop_height", "0.4 m").override("plant.drop_height", "0.35 m")
    assert changed.heading == "30° slope, no brace, ankle muscles off · plant.drop_height = 0.35 m"


def test_a_title_of_ones_own_stands_with_all_changes(tmp_path: Path, cuff: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('base = "incline30_brace"\ntitle = "Laboratory, 240 % brace"\n')
    own = load_scenario(path)
    assert own.heading == "Laboratory, 240 % brace"
    assert own.override("brace.angle_scale", 1.5).heading == "Laboratory, 240 % brace · brace.angle_scale = 1.5"
    assert own.replace_fmu("brace", cuff).heading == "Laboratory, 240 % brace · brace = cuff.fmu"
    assert own.without("brace").heading == "Laboratory, 240 % brace · brace = none"
    (tmp_path / "derived.toml").write_text('base = "mine.toml"\n[parameters]\n"brace.angle_scale" = 1.2\n')
    assert load_scenario(tmp_path / "derived.toml").heading == "30° slope, 120 % brace, ankle muscles off", (
        "a title belongs to its own file, not to those that change it"
    )
    path.write_text('base = "incline30_brace"\ntitle = "Laboratory: {ran}"\n')
    assert load_scenario(path).override("brace.angle_scale", 1.5).heading.startswith("Laboratory: 30° slope, 150 % br")


def test_a_study_describes_the_means_of_what_varies(tmp_path: Path, cuff: Path) -> None:
    study = sc.load_study("study6")
    assert study.replace_fmu("brace", cuff).heading == (
        "Study 6: 30° slope, brace cuff.fmu, co-activation 20 %, reflex gain 5"
    )
    assert study.override("controller.coactivation", 0.4).heading.endswith(
        "150 % brace, co-activation 40 %, reflex gain 5"
    )
    assert study.override("plant.drop_height", "0.35 m").heading.endswith("reflex gain 5 · plant.drop_height = 0.35 m")
    path = tmp_path / "s.toml"
    path.write_text('scenario = "incline30"\n[parameters]\n"plant.drop_height" = "0.35 m"\n'
                    '[marginals]\n"controller.coactivation" = { uniform = { low = 0.1, high = 0.3 } }\n')  # fmt: skip
    assert sc.load_study(path).heading == "30° slope, no brace, co-activation 20 % · plant.drop_height = 0.35 m"


def test_the_summary_of_a_run_carries_the_heading() -> None:
    changed = load_scenario("incline30").with_master(stop="2 ms").override("controller.coactivation", "30 %")
    assert RunSummary.of(changed, changed.run()).title == "30° slope, no brace, co-activation 30 %"


def test_headings_never_raise(tmp_path: Path) -> None:
    odd = replace(
        load_scenario("incline30"), parameters={"plant.platform_incline": "steep", "controller.coactivation": "x"}
    )
    assert odd.heading == "No brace"
    gone = replace(odd, fmus={"plant": tmp_path / "gone.fmu", "brace": tmp_path / "soft.fmu"})
    assert gone.heading == "Brace soft.fmu, plant gone.fmu"
    bare = Scenario("", {"device": tmp_path / "x.fmu"}, {}, {}, odd.master, "some/file.toml")
    assert bare.heading == "File"
    assert heading("a {b} {ran}", "r", ["c = 1"], {"c"}) == "A {b} r"


def test_a_copy_of_a_shipped_fmu_is_described_as_what_it_is(tmp_path: Path) -> None:
    """A study runs from copies of its files by content; their place says nothing about what they are."""
    study = sc.load_study("study6")
    copies = {name: Path(shutil.copy(path, tmp_path)) for name, path in study.scenario.fmus.items()}
    assert replace(study, scenario=replace(study.scenario, fmus=copies)).heading == study.heading
    campaign = replace(study, trials=2).run(workers=1)
    assert campaign.summary.title == study.heading
    shutil.copy(fmu_path("brace_linear", tmp_path, ""), copies["brace"])
    assert "brace_bushing.fmu" in replace(study, scenario=replace(study.scenario, fmus=copies)).heading, (
        "the name of a shipped FMU with another content is no shipped FMU"
    )


def test_the_files_of_a_package_are_described_as_what_they_are(tmp_path: Path) -> None:
    """They bear the names of their components."""
    own = load_scenario("incline30_brace")
    names = {"plant": "plant", "controller": "reflex_controller", "brace": "brace_bushing"}
    packed = {c: Path(shutil.copy(fmu_path(n, tmp_path, ""), tmp_path / f"{c}.fmu")) for c, n in names.items()}
    assert replace(own, fmus=packed).heading == own.heading
    (tmp_path / "brace.fmu").write_bytes(b"other")
    assert "brace.fmu (angle_scale 2.4)" in replace(own, fmus=packed).heading


def test_a_comparison_names_no_brace_and_no_value_that_stands_already() -> None:
    study = sc.load_study("population_mixed")
    who = "30° slope, population of women and men (50 : 50 %)"
    assert study.heading == f"{who}, 150 % brace, co-activation 20 %, reflex gain 5"  # its parameters are the defaults
    assert study.heading_of_braces == f"{who}, co-activation 20 %, reflex gain 5"
    braced = load_scenario("incline30_brace")
    assert braced.heading_of_braces == "30° slope, ankle muscles off"
    assert braced.override("plant.drop_height", "300 mm").heading == braced.heading
    assert braced.override("plant.drop_height", "31 cm").heading == f"{braced.heading} · plant.drop_height = 31 cm"
