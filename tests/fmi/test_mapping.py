"""Mapping files: name, sign, unit, offset; what cannot be honoured is refused."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from sprain_cosim import check_brace, load_scenario, load_study
from sprain_cosim.brace.proposal import propose
from sprain_cosim.cli import _run
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.component import Component
from sprain_cosim.mapping import INSIDE, asked_for, parse, read_component
from sprain_cosim.shipped import PACKAGE
from tests.docs_commands import blocks
from tests.fake import brace_variables, make_fmu
from tests.fmi.test_versions import angles, baseline  # noqa: F401
from tests.native import device

NAMES = ("In1_InvAngle", "M_out")


def text(sign: float, angle: str = "", torque: str = "") -> str:
    units = [f', unit = "{u}"' if u else "" for u in (angle, torque)]
    return f"""
        [inputs]
        subtalar_angle = {{ to = "In1_InvAngle"{units[0]} }}
        [outputs]
        subtalar_torque = {{ from = "M_out", factor = {sign}{units[1]} }}
    """


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", ["rad", "deg"])
@pytest.mark.parametrize("torque", ["N.m", "N.mm", "lbf.in"])
@pytest.mark.parametrize("declared", [True, False])
def test_same_trajectory(
    fmi: int,
    sign: float,
    angle: str,
    torque: str,
    declared: bool,
    baseline: np.ndarray,  # noqa: F811
    tmp_path: Path,
) -> None:
    """Other names, both signs, any units, declared in the FMU or in the mapping: the landing of the SI brace."""
    fmu = device(tmp_path / "vendor.fmu", fmi, sign=sign, angle=angle, torque=torque, names=NAMES, declared=declared)
    (tmp_path / "vendor.map.toml").write_text(text(sign) if declared else text(sign, angle, torque))
    scenario = (
        load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "vendor.map.toml").with_master("gauss-seidel")
    )
    result = scenario.run()
    assert result.status == "completed", result.message
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


def test_carried_inside(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    found = angles(device(tmp_path / "vendor.fmu", sign=-1.0, names=NAMES, extra={INSIDE: text(-1.0)}))
    assert np.abs(found - baseline).max() < 1e-9


def test_in_a_scenario_file(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    device(tmp_path / "vendor.fmu", sign=-1.0, names=NAMES)
    (tmp_path / "vendor.map.toml").write_text(text(-1.0))
    (tmp_path / "mine.toml").write_text(
        'base = "incline30"\n[components.brace]\nfmu = "vendor.fmu"\nmap = "vendor.map.toml"\n[master]\nscheme = '
        '"gauss-seidel"\n'
    )
    result = load_scenario(tmp_path / "mine.toml").run()
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


def test_offset(tmp_path: Path) -> None:
    """Factor and offset act in the FMU's unit: subtalar 0.1 rad arrives as -5.7296 + 3 deg; 20 N.mm leave as 20 * 0.5 +
    4 = 14 N.mm."""
    mapping = parse(
        '[inputs]\nsubtalar_angle = { to = "subtalar_angle", factor = -1, offset = 3 }\n'
        '[outputs]\nsubtalar_torque = { from = "subtalar_torque", factor = 0.5, offset = 4 }',
        "here",
    )
    component = mapping.apply(read_component("brace", device(tmp_path / "d.fmu", angle="deg", torque="N.mm")))
    into, out = component.inputs["subtalar_angle"].unit, component.outputs["subtalar_torque"].unit
    assert into is not None
    assert out is not None
    assert into.from_base(0.1) == pytest.approx(-np.rad2deg(0.1) + 3)
    assert out.to_base(20.0) == pytest.approx(0.014)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('[inputs]\nsubtalar_angel = { to = "In1_InvAngle" }', r"subtalar_angel: is no signal.*subtalar_angle"),
        ('[inputs]\nsubtalar_angle = { to = "In_InvAngle" }', r"no such variable \(did you mean In1_InvAngle"),
        ('[inputs]\nsubtalar_angle = { to = "M_out" }', r"causality output; only an input"),
        ('[inputs]\nsubtalar_angle = { to = "stiffness" }', r"causality parameter"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", unit = "N.m" }', r"dimension"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", gain = 2 }', r"unknown key 'gain'"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", factor = 0 }', r"factor must not be 0"),
        (
            '[inputs]\nsubtalar_angle = { to = "In1_InvAngle" }\ninversion_angle = { to = "In1_InvAngle" }',
            r"mapped to subtalar_angle already",
        ),
        ("inputs = 3", r"must be a table"),
        ("[inputs", r"not valid TOML"),
        ("", r"bad.toml: says nothing; name the FMU's variables in \[inputs\] and \[outputs\]"),
        ("# a draft\n[inputs]\n[outputs]\n", r"says nothing"),
    ],
)
def test_refused(content: str, message: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "vendor.fmu", names=NAMES)
    (tmp_path / "bad.toml").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "bad.toml")
    assert "\n" not in str(caught.value)


def test_nothing_is_dropped_in_silence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that no name connects, undeclared units, a mapping that replaces another: refused or said."""
    fmu = device(tmp_path / "half.fmu", names=("subtalar_angle", "M_out"))
    assert _run(["run", "incline30", "--fmu", f"brace={fmu}"], []) == 2
    assert re.search(
        r"error: .*brace: is moved by the plant but gives nothing back: .*M_out.* mapping file", capsys.readouterr().err
    )

    fmu = device(tmp_path / "silent.fmu", declared=False)
    assert _run(["run", "incline30", "--fmu", f"brace={fmu}", "--scheme", "gauss-seidel"], []) == 0
    assert (
        "warning: brace: silent.fmu declares no unit for subtalar_angle, subtalar_torque; SI is assumed"
        in capsys.readouterr().err
    )

    fmu = device(tmp_path / "vendor.fmu", sign=-1.0, names=NAMES, extra={INSIDE: text(-1.0)})
    (tmp_path / "own.toml").write_text(text(-1.0))
    options = [
        "incline30",
        "--fmu",
        f"brace={fmu}",
        "--map",
        f"brace={tmp_path / 'own.toml'}",
        "--scheme",
        "gauss-seidel",
    ]
    assert _run(["run", *options], []) == 0
    assert "the mapping inside vendor.fmu is not used" in capsys.readouterr().err
    assert "is not used" in check_brace(fmu, tmp_path / "own.toml").text()


def make_spring(folder: Path, axis: str, stiffness: float) -> Path:
    law = f"""
        def refresh(self):
            self["{axis}_torque"] = -{stiffness} * self["{axis}_angle"]

        def initialise(self):
            self.refresh()

        def step(self, time, step):
            self.refresh()
    """
    return make_fmu(folder, f"spring_{axis}", brace_variables(axis=axis), law)


@pytest.mark.parametrize("axis", ["subtalar", "inversion", "internal_rotation", "rotation_x", "talocrural"])
def test_one_axis_of_any_profile_connects_itself(axis: str, tmp_path: Path) -> None:
    """On the real plant: what the spring sees and gives is its law, the plant feels it, and no other axis is fed."""
    scenario = load_scenario("incline30").replace_fmu("brace", make_spring(tmp_path, axis, 20.0))
    connections = scenario.system().connections
    assert {t: s for t, s in connections.items() if "brace" in t + s} == {
        f"brace.{axis}_angle": f"plant.{axis}_angle",
        f"plant.brace_{axis}_torque": f"brace.{axis}_torque",
    }
    free, braced = load_scenario("incline30").run(), scenario.run()
    assert braced.status == "completed", braced.message
    angle = braced[f"plant.{axis}_angle"]
    assert braced[f"brace.{axis}_torque"] == pytest.approx(-20.0 * angle, abs=1e-9)
    assert np.abs(angle - free[f"plant.{axis}_angle"]).max() > np.deg2rad(0.5)
    if axis != "talocrural":  # which begins at its largest angle
        assert np.abs(angle).max() < np.abs(free[f"plant.{axis}_angle"]).max()
    assert braced[f"plant.brace_{axis}_moment"] == pytest.approx(20.0 * angle, abs=0.05 * 20.0 * np.abs(angle).max())


def test_a_study_takes_device_and_mapping_as_a_run_does(tmp_path: Path) -> None:
    """The same landings as with the SI brace, trial by trial; the mapping is part of the study's identity."""
    good = device(tmp_path / "good.fmu")
    turned = device(tmp_path / "vendor.fmu", sign=-1.0, angle="deg", torque="lbf.in", names=NAMES)
    (tmp_path / "vendor.map.toml").write_text(text(-1.0))
    study = load_study("study2")
    trials = []
    for fmu, mapping in ((good, None), (turned, tmp_path / "vendor.map.toml")):
        chosen = study.replace_fmu("brace", fmu, mapping)
        trials.append(chosen.run(trials=3, workers=1, out=tmp_path / fmu.stem).trials)
    numbers = [t.select_dtypes("number").to_numpy() for t in trials]
    assert (trials[1]["status"] == "completed").all()
    assert numbers[1] == pytest.approx(numbers[0], abs=1e-7)
    before = chosen.digest
    (tmp_path / "vendor.map.toml").write_text(text(-1.0) + "\n# changed")
    assert chosen.digest != before


def test_a_cable_pulls_at_its_lever(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    """A force on an arm is a torque, its travel the angle times the arm: 25 times both on 40 mm gives the landing of
    the SI brace."""
    fmu = device(tmp_path / "vendor.fmu", names=NAMES, declared=False)
    (tmp_path / "vendor.map.toml").write_text(
        '[inputs]\nsubtalar_angle = { to = "In1_InvAngle", factor = 25, unit = "m", arm = "40 mm" }\n'
        '[outputs]\nsubtalar_torque = { from = "M_out", factor = 25, unit = "N", arm = "4 cm" }\n'
    )
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "vendor.map.toml")
    result = scenario.with_master("gauss-seidel").run()
    assert result.status == "completed", result.message
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('unit = "N"', 'state the lever of the force with arm = "40 mm"'),
        ('arm = "40 mm"', "expected kg.m/s2"),
        ('unit = "N", arm = "0 mm"', "outputs.subtalar_torque.arm = '0 mm': must be positive"),
        ('unit = "N", arm = 40', "needs a unit"),
    ],
)
def test_an_arm_belongs_to_a_force(entry: str, message: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "vendor.fmu", names=NAMES)
    (tmp_path / "m.toml").write_text(f'[outputs]\nsubtalar_torque = {{ from = "M_out", {entry} }}')
    with pytest.raises(InputError, match=re.escape(message)):
        read_component("brace", fmu, tmp_path / "m.toml")


SCHEMA = json.loads((PACKAGE / "mapping.schema.json").read_text())


def test_schema() -> None:
    """Its names are the contract's; the examples of the page and the mapping that ships pass, near misses do not."""
    from sprain_cosim.contract import INPUTS, OUTPUTS

    assert SCHEMA["properties"]["inputs"]["propertyNames"]["enum"] == list(INPUTS)
    assert SCHEMA["properties"]["outputs"]["propertyNames"]["enum"] == list(OUTPUTS)
    root = PACKAGE.parent
    examples = [
        b.text for b in blocks(root / "docs" / "brace-contract.md") if b.language == "toml" and "base" not in b.text
    ]
    examples.append((root / "fmus" / "brace_active" / "extra" / "sprain-cosim" / "map.toml").read_text())
    assert len(examples) == 4
    for example in examples:
        jsonschema.validate(tomllib.loads(example), SCHEMA)
        parse(example, "here")
    for wrong in (
        '[inputs]\nsubtalar_angel = "x"',
        '[outputs]\nsubtalar_torque = { from = "x", gain = 2 }',
        "activ = true",
        '[inputs]\nsubtalar_angle = { to = "x", factor = 0 }',
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(wrong), SCHEMA)
        with pytest.raises(InputError):
            parse(wrong, "here")


def test_a_mapping_names_the_file_it_is_for_and_what_that_may_do(tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu")
    digest = hashlib.sha256(fmu.read_bytes()).hexdigest()
    table = tmp_path / "device.map.toml"
    table.write_text(f'allow = ["network", "read:/opt/licence"]\nexpect_sha256 = "{digest.upper()}"\n')
    assert read_component("brace", fmu, table).allowed.words() == ["network", "read:/opt/licence"]
    table.write_text(f'expect_sha256 = "{"0" * 64}"\n')
    with pytest.raises(InputError, match=rf"expect_sha256 = 000000000000\.\.\.: device.fmu has .* SHA-256 {digest}"):
        read_component("brace", fmu, table)
    for wrong, words in (
        ('allow = "network"', "must be a list"),
        ('allow = ["netwrk"]', "did you mean network"),
        ('allow = ["read:licence"]', "absolute path"),
        ('expect_sha256 = "abc"', "must be the 64 hexadecimal digits"),
    ):
        with pytest.raises(InputError, match=words):
            parse(wrong, "here")
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(wrong), SCHEMA)


def test_an_fmu_cannot_allow_itself_anything(tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu", extra={"extra/sprain-cosim/map.toml": 'allow = ["network", "exec"]\n'})
    component = read_component("brace", fmu)
    assert not component.allowed
    assert asked_for(component).words() == ["network", "exec"]


HELD = '[constants]\nsupply = "48000 mV"\n'


@pytest.mark.parametrize("fmi", [1, 2, 3])
@pytest.mark.parametrize("isolate", [False, True])
def test_an_input_that_nothing_feeds_holds_a_constant(
    fmi: int,
    isolate: bool,
    baseline: np.ndarray,  # noqa: F811
    tmp_path: Path,
) -> None:
    """At 48 V the supplied device is the SI brace, at 24 V it gives half; a run's value goes before the file's."""
    fmu = device(tmp_path / "motor.fmu", fmi, supply=True, declared=fmi > 1)
    (tmp_path / "m.toml").write_text(HELD)
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "m.toml").with_master("gauss-seidel")
    scenario = scenario.isolated("brace") if isolate else scenario
    with scenario.open() as session:
        for result in (session.run(), session.run()):
            assert result.status == "completed", result.message
            assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9
    assert scenario.values()["brace.supply"] == "48000 mV"
    half, none = scenario.override("brace.supply", "24 V"), scenario.override("brace.supply", "0 V")
    assert half.values()["brace.supply"] == "24 V"
    peaks = [s.run().metrics["peak_subtalar_angle_deg"] for s in (scenario, half, none)]
    assert peaks[0] + 0.5 < peaks[1] < peaks[2] - 0.5


def test_a_run_and_a_comparison_set_a_constant(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = device(tmp_path / "motor.fmu", supply=True)
    run = ["run", "incline30", "--fmu", f"brace={fmu}", "--scheme", "gauss-seidel", "--json"]
    assert _run([*run, "--set", "brace.supply=48 V"], []) == 0
    braced = json.loads(capsys.readouterr().out)
    assert braced["parameters"]["brace.supply"] == "48 V"
    assert _run(run, []) == 0
    free = json.loads(capsys.readouterr().out)
    assert "brace.supply" not in free["parameters"]
    key = "peak_subtalar_angle_deg"
    assert braced["metrics"][key] < free["metrics"][key] - 0.5
    out = tmp_path / "compared"
    compare = ["compare", "incline30", "--brace", f"motor={fmu}", "--set", "motor.supply=48 V", "--out", str(out)]
    assert _run([*compare, "--scheme", "gauss-seidel"], []) == 0
    summary = json.loads((out / "motor" / "summary.json").read_text())
    assert summary["parameters"]["brace.supply"] == "48 V"
    assert summary["metrics"][key] == pytest.approx(braced["metrics"][key], abs=1e-9)
    capsys.readouterr()
    for wrong, words in (
        ("brace.supply=48", "needs a unit, for example"),
        ("brace.supply=48 A", "has the dimension A"),
        ("brace.suply=48 V", "did you mean supply"),
        ("brace.subtalar_angle=1 deg", "is an input, not a parameter; plant.subtalar_angle feeds it"),
    ):
        assert _run([*run, "--set", wrong], []) == 2
        assert re.fullmatch(f"error: .*{re.escape(words)}.*\n", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('supply = "48 A"', "constants.supply = '48 A': A has the dimension A, expected"),
        ("supply = 48", "constants.supply = 48: needs a unit"),
        ('suply = "48 V"', "constants.suply: motor.fmu has no such variable (did you mean supply"),
        ('stiffness = "3 N.m/rad"', "only an input can be held constant; set it with --set brace.stiffness=VALUE"),
        ('subtalar_angle = "3 deg"', "constants.subtalar_angle: is fed as subtalar_angle"),
        ("supply = [48]", "constants.supply = [48]: expected a number"),
    ],
)
def test_a_constant_that_cannot_be_held(content: str, message: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "motor.fmu", supply=True)
    (tmp_path / "m.toml").write_text(f"[constants]\n{content}\n")
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_component("brace", fmu, tmp_path / "m.toml")
    assert "\n" not in str(caught.value)


def test_check_measures_with_what_is_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without its supply the device gives nothing; --set reaches the probes and the next line."""
    fmu = device(tmp_path / "motor.fmu", supply=True)
    assert not check_brace(fmu).facts["landing"]["peak_torque_Nm"]["subtalar"]
    report = check_brace(fmu, settings={"supply": "48 V"})
    plain = check_brace(device(tmp_path / "plain.fmu"))
    assert report.facts["landing"]["peak_torque_Nm"] == pytest.approx(plain.facts["landing"]["peak_torque_Nm"])
    softer = check_brace(fmu, settings={"supply": "48 V", "stiffness": "2 N.m/rad"})
    assert (
        softer.facts["landing"]["peak_torque_Nm"]["subtalar"]
        < 0.5 * plain.facts["landing"]["peak_torque_Nm"]["subtalar"]
    )
    assert _run(["check", str(fmu), "--set", "supply=48 V", "--set", "stiffness=30 N.m/rad"], []) == 0
    shown = capsys.readouterr().out
    assert "measured with supply = 48 V, stiffness = 30 N.m/rad" in shown
    assert f"--fmu brace={fmu} --set 'brace.supply=48 V' --set 'brace.stiffness=30 N.m/rad'" in shown
    (tmp_path / "m.toml").write_text(HELD)
    held = check_brace(fmu, tmp_path / "m.toml")
    assert held.facts["landing"]["peak_torque_Nm"] == pytest.approx(plain.facts["landing"]["peak_torque_Nm"])
    for wrong, words in (
        ("suply=48 V", "did you mean supply"),
        ("supply=48", "needs a unit"),
        ("subtalar_angle=3 deg", "the plant feeds it"),
        ("subtalar_torque=3 N.m", "is of causality output, not a parameter"),
    ):
        assert _run(["check", str(fmu), "--set", wrong], []) == 2
        assert re.fullmatch(f"error: --set .*{re.escape(words)}.*\n", capsys.readouterr().err)


CABLES = 'subtalar_torque = { from = ["medial", "lateral"], factor = [1, -1], arm = "40 mm" }'
FAR = ("subtalar_angle", "M_out")  # the torque itself under a name that the contract does not know


@pytest.mark.parametrize(("fmi", "model_exchange"), [(1, False), (2, False), (3, False), (2, True)])
@pytest.mark.parametrize("isolate", [False, True])
def test_two_cables_are_one_torque(
    fmi: int,
    model_exchange: bool,
    isolate: bool,
    baseline: np.ndarray,  # noqa: F811
    tmp_path: Path,
) -> None:
    """Their difference on 40 mm is the torque of the SI brace, though one is in N and the other in kN."""
    fmu = device(tmp_path / "d.fmu", fmi, model_exchange, names=FAR, cables=True)
    (tmp_path / "m.toml").write_text(f"[outputs]\n{CABLES}\n")
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "m.toml").with_master("gauss-seidel")
    result = (scenario.isolated("brace") if isolate else scenario).run()
    assert result.status == "completed", result.message
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < (
        1e-6 if model_exchange else 1e-9
    )


def test_a_sum_is_checked_identified_and_proposed(tmp_path: Path) -> None:
    """`check` and the coupling that measures stiffness see the sum as they see the torque itself."""
    fmu, plain = device(tmp_path / "d.fmu", names=FAR, cables=True), device(tmp_path / "plain.fmu")
    (tmp_path / "m.toml").write_text(f"[outputs]\n{CABLES}\n")
    (tmp_path / "own.toml").write_text('[outputs]\nsubtalar_torque = { from = ["M_out"], factor = [1] }\n')
    report, same = check_brace(fmu, tmp_path / "m.toml"), check_brace(plain)
    assert report.fits, report.text()
    for fact in ("torque_Nm", "secant_stiffness_Nm_per_rad"):
        assert report.facts["subtalar"][fact] == pytest.approx(same.facts["subtalar"][fact], rel=1e-9)
    runs = [
        load_scenario("incline30").replace_fmu("brace", f, m).with_master("impedance").run()
        for f, m in ((fmu, tmp_path / "m.toml"), (plain, None), (fmu, tmp_path / "own.toml"))
    ]
    angles_of = [np.asarray(run.signals["plant.subtalar_angle"]) for run in runs]
    assert np.abs(angles_of[0] - angles_of[1]).max() < 1e-9
    assert np.array_equal(angles_of[2], angles_of[1])
    component = read_component("brace", fmu, tmp_path / "m.toml")
    assert "medial" not in component.connectors
    assert component.outputs["subtalar_torque"].description == "sum of medial, lateral"
    bare = Component.read("brace", fmu)
    pulling = replace(bare, connectors={n: c for n, c in bare.connectors.items() if n != "M_out"})
    line = next(line for line in propose(pulling).splitlines() if "or their sum" in line)
    assert parse(f"[outputs]\n{line.removeprefix('# ')}", "here").apply(pulling).outputs["subtalar_torque"].parts


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('from = ["medial", "lateral"], factor = [1, -1, 1], arm = "40 mm"', "factor has 3 numbers for 2 variables"),
        ('from = ["medial", "lateral"], factor = [1, 0], arm = "40 mm"', "factor must not be 0"),
        ('from = ["medial", "lateral"], offset = 1, arm = "40 mm"', "offset belongs to a single variable"),
        ('from = ["medial", "medial"], arm = "40 mm"', "medial: is mapped to subtalar_torque already"),
        ('from = ["medial", "latral"], arm = "40 mm"', "no such variable (did you mean lateral"),
        ('from = ["medial", "lateral"]', 'state the lever of the force with arm = "40 mm"'),
        ('from = ["medial", "M_out"], arm = "40 mm"', "M_out: its unit N.m has the dimension"),
        ("from = []", 'needs { from = "variable of the FMU" }'),
        ('from = ["medial", 3]', 'needs { from = "variable of the FMU" }'),
    ],
)
def test_a_sum_that_cannot_be_made(entry: str, message: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "d.fmu", names=FAR, cables=True)
    (tmp_path / "m.toml").write_text(f"[outputs]\nsubtalar_torque = {{ {entry} }}\n")
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_component("brace", fmu, tmp_path / "m.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fmi", [1, 2, 3])
def test_names_with_brackets(fmi: int, baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    """Exporters name the scalars of a vector so; they are names as any other."""
    fmu = device(tmp_path / "vendor.fmu", fmi, names=("phi[1]", "u[1]"))
    (tmp_path / "m.toml").write_text('[inputs]\nsubtalar_angle = "phi[1]"\n[outputs]\nsubtalar_torque = "u[1]"\n')
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "m.toml").with_master("gauss-seidel")
    result = scenario.run()
    assert result.status == "completed", result.message
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


def test_an_element_of_an_array_is_refused_by_name(tmp_path: Path) -> None:
    fmu = device(tmp_path / "vendor.fmu", 3, names=("phi", "M_out"))
    bare = Component.read("brace", fmu)
    arrays = {n: replace(c, kind="array") if n == "phi" else c for n, c in bare.connectors.items()}
    mapping = parse('[inputs]\nsubtalar_angle = "phi[1]"\n', "here")
    with pytest.raises(InputError, match=r"phi\[1\]: phi is an array, whose elements cannot be mapped; export scalars"):
        mapping.apply(replace(bare, connectors=arrays))
