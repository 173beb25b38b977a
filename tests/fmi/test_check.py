"""`check`: every wrong sign is caught, no false alarm on devices that are right, broken ones end in one line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from sprain_cosim import InputError, check_brace, load_scenario, load_study
from sprain_cosim.brace import check as module
from sprain_cosim.brace import readings
from sprain_cosim.cli import _run, cli
from sprain_cosim.mapping import UNKNOWN, parse
from sprain_cosim.shipped import shipped_fmus
from tests.fake import FakeComponent, connector
from tests.laws import BRACES, brace, sampled
from tests.native import FAULTS, QUIRKS, SUBTALAR, compile_fmu, device, quirk

OWN = [n for n in shipped_fmus() if n.startswith("brace_")]
HANGS = ("hang_step", "hang_start", "spin")
HARMLESS = ("none", "leak", "flood", "change_folder", "change_locale", "fork", "huge")


@pytest.fixture(autouse=True)
def enough_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a loaded machine; tests of what hangs have a shorter limit."""
    for each in (module, readings):
        monkeypatch.setattr(each, "PROBE_LIMIT", 60.0)


@pytest.mark.parametrize(("fmi", "model_exchange"), [(1, False), (2, False), (3, False), (2, True), (3, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sign(fmi: int, model_exchange: bool, sign: float, tmp_path: Path) -> None:
    report = check_brace(device(tmp_path / "device.fmu", fmi, model_exchange, sign=sign))
    assert report.fits == (sign > 0), report.text()
    assert report.profile == "subtalar"
    if sign > 0:
        assert not report.warnings
        assert "pushes it back with 4.03 N.m" in report.text()  # 20 x (1 + 4 x^2) + 5 (x - z) at 10 deg held for 20 ms
    else:
        assert len(report.problems) == 1
        assert "sign" in report.problems[0]
        assert "factor = -1" in report.problems[0]


QUICK = [(3, "deg", "N.mm"), (2, "rad", "lbf.in")]
ALL = [(f, a, t) for f in (2, 3) for a in ("rad", "deg") for t in ("N.m", "N.mm", "lbf.in")]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("fmi", "angle", "torque"), [c if c in QUICK else pytest.param(*c, marks=pytest.mark.long) for c in ALL]
)
def test_wrong_sign_in_a_mapping(sign: float, fmi: int, angle: str, torque: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu", fmi, sign=-1.0, angle=angle, torque=torque, names=("In1_InvAngle", "M_out"))
    (tmp_path / "map.toml").write_text(
        f'[inputs]\nsubtalar_angle = "In1_InvAngle"\n[outputs]\nsubtalar_torque = {{ from = "M_out", factor = {sign} }}'
    )
    report = check_brace(fmu, tmp_path / "map.toml")
    assert report.fits == (sign < 0), report.text()
    assert sign < 0 or "change that of factor in outputs.subtalar_torque" in report.problems[0]


def test_active_devices_may_push(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text("active = true")
    report = check_brace(device(tmp_path / "device.fmu", sign=-1.0), tmp_path / "map.toml")
    assert report.fits
    assert "sign" in report.warnings[0]


@pytest.mark.parametrize("name", OWN)
def test_own_braces_fit(name: str) -> None:
    """And give what their source gives as plain Python (the reference experiment that each carries)."""
    report = check_brace(Path(module.__file__).parent.parent / "_fmus" / f"{name}.fmu")
    assert report.fits, report.text()
    assert not report.warnings, report.text()
    assert [r["name"] for r in report.references if r["difference"] < 1e-9] == ["smoke-test"]


@pytest.mark.parametrize("fault", [f for f in FAULTS if f not in HANGS and f not in ("hang_load", "hang_reset")])
def test_faults(fault: str, tmp_path: Path) -> None:
    report = check_brace(compile_fmu(tmp_path / "device.fmu", fault=fault))
    assert report.fits == (fault in HARMLESS), report.text()
    assert all("\n" not in line for line in (*report.problems, *report.warnings))


@pytest.mark.parametrize("fault", HANGS)
def test_hangs(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PROBE_LIMIT", 2.0)
    report = check_brace(compile_fmu(tmp_path / "device.fmu", fault=fault))
    assert not report.fits
    assert "overran its limit" in report.text()


def test_a_library_that_hangs_when_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No usable FMU: exit 2."""
    monkeypatch.setattr(module, "START_LIMIT", 3.0)
    with pytest.raises(InputError, match="cannot be instantiated: overran its limit"):
        check_brace(compile_fmu(tmp_path / "device.fmu", fault="hang_load"))


HABITS = {  # quirk: (verdict, a word of the report)
    "plain": ("fits", "symmetric"),
    "late": ("fits", "one communication step late"),
    "refuses": (
        "fits with warnings",
        "fixed step of its own that it does not declare: takes 1, 2, 5 ms, refuses 0.1, 0.2, 0.5 ms",
    ),
    "silent": ("does not fit", "whatever step it is asked for"),
    "stale_reset": ("fits", "no run uses it, every run takes a fresh instance"),
    "bad_reset": ("fits", "its reset fails"),
    "nearly": ("fits", "the tolerance of its solver"),
    "stale_state": ("does not fit", "withdraw the claim"),
    "memory": ("does not fit", "runs cannot be repeated"),
    "extra": ("does not fit", "strap_tension is nan"),
    "preload": ("fits", "the other way"),
    "plastic": ("fits", "takes 2.5"),
    "damper": ("fits", "it slows the foot; velocity and torque both of the other sign would look the same"),
    "snap": ("does not fit", "away from rest at +20, +30, +45 deg"),
    "ball": ("does not fit", "no brace"),
    "once": ("fits", "one instance per process"),
}


@pytest.mark.parametrize("name", QUIRKS)
def test_habits(name: str, tmp_path: Path) -> None:
    """Faults are named, what is merely unusual is no alarm; what to type next is always said."""
    report = check_brace(quirk(tmp_path / "device.fmu", name))
    verdict, word = HABITS[name]
    assert report.verdict == verdict, report.text()
    assert word in report.text()
    assert "sprain-cosim" in report.next_step


def test_a_damper_of_the_wrong_sign(tmp_path: Path) -> None:
    report = check_brace(quirk(tmp_path / "device.fmu", "damper", -1.0))
    assert not report.fits
    assert "pushed faster" in report.problems[0]
    (tmp_path / "map.toml").write_text(report.proposal)
    assert check_brace(tmp_path / "device.fmu", tmp_path / "map.toml").fits


WRONG = {  # law of laws.c: words of the problem
    "LOCK": "does net work on the foot, which a passive brace cannot: gives 4.29 J in a cycle of +-15 deg",
    "STOP": "sign: foot rolled outward (supination) 45 deg (subtalar +): the brace pushes it further with 10.5 N.m",
}


@pytest.mark.parametrize("law", WRONG)
def test_a_wrong_sign_beyond_a_threshold(law: str, tmp_path: Path) -> None:
    """Neither shows at small angles held or at 200 deg/s; the mapping that the report proposes makes it fit."""
    fmu = brace(tmp_path / "device.fmu", law)
    report = check_brace(fmu)
    assert not report.fits
    assert WRONG[law] in report.text()
    (tmp_path / "map.toml").write_text(report.proposal)
    assert check_brace(fmu, tmp_path / "map.toml").verdict == "fits"


def test_an_active_device_is_told_how_much(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text("active = true")
    report = check_brace(brace(tmp_path / "device.fmu", "LOCK"), tmp_path / "map.toml")
    assert report.fits
    assert any(note.startswith("subtalar: active, gives 4.29 J in a cycle of +-15 deg") for note in report.notes)
    assert report.facts["landing"]["work_taken_from_zero_to_zero_J"] < -1.0


def test_over_centre(tmp_path: Path) -> None:
    """Conservative: a warning; no reason to call it active or wrong."""
    report = check_brace(brace(tmp_path / "device.fmu", "OVER"))
    assert report.verdict == "fits with warnings", report.text()
    assert report.warnings[0].startswith(
        "subtalar: pushes the foot away from rest at -10, -5, -2, +2, +5, +10 deg, and back at"
    )
    assert "over centre" in report.warnings[0]


@pytest.mark.parametrize("law", BRACES)
def test_braces_with_free_steps_fit(law: str, tmp_path: Path) -> None:
    """Slack, friction, hysteresis, preload that shows after the first step only, a late answer: none is a sign."""
    report = check_brace(brace(tmp_path / "device.fmu", law))
    assert report.fits, report.text()
    assert not any(word in w for w in report.warnings for word in ("sign", "away", "work")), report.text()


@pytest.mark.parametrize("fixed", [True, False])
def test_a_hold_is_no_active_device(fixed: bool, tmp_path: Path) -> None:
    """A spring that is sampled gives energy by its hold alone: a note."""
    report = check_brace(sampled(tmp_path / "device.fmu", "subtalar", 60.0, 0.0, 0.01, fixed=fixed))
    assert report.verdict == "fits", report.text()
    assert any("sampled" in note for note in report.notes)
    if not fixed:
        note = next(n for n in report.notes if "no more than torques" in n)
        assert "that are 5 ms old on average do, like a negative damping of about 0.3 N.m.s/rad" in note


def test_a_last_digit_that_wobbles_is_no_step_of_its_own(tmp_path: Path) -> None:
    assert check_brace(brace(tmp_path / "device.fmu", "WOBBLE")).verdict == "fits"


@pytest.mark.parametrize(("fmi", "angle", "torque"), ALL)
def test_every_wrong_sign_is_caught(fmi: int, angle: str, torque: str, tmp_path: Path) -> None:
    """And the mapping that the report proposes makes it fit."""
    fmu = device(tmp_path / "device.fmu", fmi, sign=-1.0, angle=angle, torque=torque)
    report = check_brace(fmu)
    assert not report.fits
    assert report.problems[0].startswith("sign: foot rolled outward")
    if (angle, torque) == ("deg", "lbf.in"):
        (tmp_path / "map.toml").write_text(report.proposal)
        assert check_brace(fmu, tmp_path / "map.toml").verdict == "fits"


def test_its_own_step(tmp_path: Path) -> None:
    """Found by the probes, written into the mapping, kept to by every run, whatever the communication step."""
    fmu = quirk(tmp_path / "device.fmu", "refuses")
    mapping = tmp_path / "map.toml"
    mapping.write_text(check_brace(fmu).proposal)
    report = check_brace(fmu, mapping)
    assert report.verdict == "fits"
    assert report.facts["own_step_s"] == 1e-3
    assert any(note.startswith("sampled every 1 ms: every run calls it at that rate") for note in report.notes)
    assert "--step" not in report.next_step
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, mapping)
    usual, coarse = scenario.run(), scenario.with_master("gauss-seidel", "1 ms").run()
    assert (usual.status, coarse.status) == ("completed", "completed")
    assert usual.held["brace"].period == 1e-3
    peak = usual.metrics["peak_subtalar_angle_deg"]
    assert coarse.metrics["peak_subtalar_angle_deg"] == pytest.approx(peak, abs=0.02)
    mapping.write_text(mapping.read_text() + "continuous = true\n")
    assert any("carried on by its stiffness" in note for note in check_brace(fmu, mapping).notes)
    assert load_scenario("incline30").replace_fmu("brace", fmu, mapping).run().held == {}
    study = load_study("study2").replace_fmu("brace", fmu, mapping)
    assert study.run(trials=1, workers=1, out=tmp_path / "study").summary.n_completed == 1


def test_a_reset_that_is_said_to_work(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text("reset = true")
    assert check_brace(quirk(tmp_path / "plain.fmu", "plain"), tmp_path / "map.toml").facts["reset_works"]
    report = check_brace(quirk(tmp_path / "stale.fmu", "stale_reset"), tmp_path / "map.toml")
    assert "take that line out" in report.problems[0]
    report = check_brace(quirk(tmp_path / "bad.fmu", "bad_reset"), tmp_path / "map.toml")
    assert "reset = true says so; take that line out" in report.problems[0]


def test_a_reset_that_hangs_and_that_no_run_uses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PROBE_LIMIT", 4.0)
    report = check_brace(compile_fmu(tmp_path / "device.fmu", fault="hang_reset"))
    assert report.verdict == "fits", report.text()
    assert any("its reset fails (the device overran its limit" in note for note in report.notes)


def test_a_slow_device_has_the_time_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """1 ms a step: its cycles take longer than the limit of a quick device; what is done meanwhile is shown."""
    monkeypatch.setattr(module, "PROBE_LIMIT", 1.0)
    lines: list[str] = []
    report = check_brace(brace(tmp_path / "device.fmu", "SLOW", PAUSE=1000), say=lines.append)
    assert report.verdict == "fits", report.text()
    assert any(line.startswith("in closed cycles") for line in lines)


@pytest.mark.parametrize("name", ["stale_reset", "plain"])
def test_runs_repeat_whatever_the_reset_does(name: str, tmp_path: Path) -> None:
    """Without a word on its reset every run has a fresh instance: three runs on open instances are the same to the
    bit."""
    scenario = (
        load_scenario("incline30")
        .replace_fmu("brace", quirk(tmp_path / "device.fmu", name))
        .with_master("gauss-seidel", stop="60 ms")
    )
    with scenario.open() as session:
        first, *others = (session.run().signals for _ in range(3))
    assert all(other.equals(first) for other in others)


def test_names_that_read_the_same(tmp_path: Path) -> None:
    second = '<ScalarVariable name="Subtalar.Torque" valueReference="3" causality="output"><Real/></ScalarVariable>'
    variables = re.sub(r'<ScalarVariable name="fault".*?</ScalarVariable>', second, SUBTALAR)
    report = check_brace(compile_fmu(tmp_path / "twice.fmu", variables=variables, outputs=(2, 4)))
    assert "subtalar_torque and Subtalar.Torque both read as subtalar_torque" in report.problems[0]


def test_proposal_for_a_joint_coordinate_system() -> None:
    """Three axes with vendors' names, told apart by words; none is guessed as subtalar."""
    from sprain_cosim.brace.proposal import propose

    names = [f"{axis}_{kind}" for axis in ("DorsiFlex", "Inv", "IntRot") for kind in ("Ang", "Mom")]
    connectors = {
        n: connector(n, "output" if n.endswith("Mom") else "input", "N.m" if n.endswith("Mom") else "deg")
        for n in names
    }
    text = propose(FakeComponent("brace", connectors))  # type: ignore[arg-type]
    parsed = parse(text, "proposal")
    assert {k: v.variables[0] for k, v in parsed.inputs.items()} == {
        "dorsiflexion_angle": "DorsiFlex_Ang", "inversion_angle": "Inv_Ang", "internal_rotation_angle": "IntRot_Ang",
    }  # fmt: skip
    assert {k: v.variables[0] for k, v in parsed.outputs.items()} == {
        "dorsiflexion_torque": "DorsiFlex_Mom", "inversion_torque": "Inv_Mom", "internal_rotation_torque": "IntRot_Mom",
    }  # fmt: skip


def test_proposal_of_three_axes_the_other_way_round() -> None:
    """Eversion, plantarflexion and external rotation run against the axes; an undeclared unit stays open."""
    from sprain_cosim.brace.proposal import propose

    names = [f"{axis}_{k}" for axis in ("eversion", "plantarflexion", "external_rotation") for k in ("angle", "moment")]
    connectors = {n: connector(n, "output" if n.endswith("moment") else "input", None) for n in names}
    text = propose(FakeComponent("brace", connectors))  # type: ignore[arg-type]
    parsed = parse(text, "proposal")
    vendors = {"inversion": "eversion", "dorsiflexion": "plantarflexion", "internal_rotation": "external_rotation"}
    assert {k: (*s.variables, *s.factors) for k, s in parsed.inputs.items()} == {
        f"{own}_angle": (f"{vendor}_angle", -1.0) for own, vendor in vendors.items()
    }
    assert {k: (*s.variables, *s.factors) for k, s in parsed.outputs.items()} == {
        f"{own}_torque": (f"{vendor}_moment", -1.0) for own, vendor in vendors.items()
    }
    assert len([s for s in (*parsed.inputs.values(), *parsed.outputs.values()) if s.unit == UNKNOWN]) == 6
    assert "radians" not in text
    assert "unit deg or rad?; against the axis" in text


def test_proposal_for_a_cable() -> None:
    """A force is offered with a lever arm; whatever else could be mapped is listed with its unit."""
    from sprain_cosim.brace.proposal import propose

    kinds = {"lever": ("input", "m"), "angle": ("input", "deg"), "medial": ("output", "N"), "y": ("output", None)}
    text = propose(FakeComponent("brace", {n: connector(n, *kind) for n, kind in kinds.items()}))  # type: ignore[arg-type]
    assert '# subtalar_torque = { from = "medial", arm = "40 mm" }   # review: a force; state its lever arm' in text
    assert "#   input lever [m]\n#   output y [no unit]\n" in text
    taken = text.replace('# subtalar_torque = { from = "medial"', 'subtalar_torque = { from = "medial"')
    assert parse(taken, "proposal").outputs["subtalar_torque"].arm == 0.04


@pytest.mark.parametrize(
    ("name", "axis", "turned"),
    [
        ("LeverAngle", None, False),
        ("AnkleEversion", "subtalar", True),
        ("ankle_pronation_deg", "subtalar", True),
        ("supinationAngle", "subtalar", False),
        ("PlantarFlexionAngle", "talocrural", True),
        ("FlexAngle", "talocrural", False),
        ("phi", None, False),
    ],
)
def test_axes_of_vendors_names(name: str, axis: str | None, turned: bool) -> None:
    from sprain_cosim.brace.proposal import WORDS, _axis

    assert _axis(name, WORDS) == (axis, turned)


def test_units_that_nobody_declared_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither radians nor degrees are guessed: the proposal leaves them open, `check` shows both, `run` takes none."""
    monkeypatch.chdir(tmp_path)
    fmu, mapping = Path("my vendor.fmu"), Path("my vendor.map.toml")
    device(fmu, names=("angle", "torque"), angle="deg", declared=False)
    ran = CliRunner().invoke(cli, ["check", str(fmu)], standalone_mode=False)
    assert ran.return_value == 1
    assert "sprain-cosim check 'my vendor.fmu' --map 'my vendor.map.toml'" in ran.output
    assert 'subtalar_angle = { to = "angle", unit = "?" }   # review: unit deg or rad?' in mapping.read_text()
    report = check_brace(fmu, mapping)
    assert len(report.problems) == 1
    # 20 N.m/rad and a cubic part, per degree of the angle that it is fed
    right, wrong = (check_brace(fmu, write_map(unit)) for unit in ("deg", "rad"))
    at = [r.facts["subtalar"]["torque_Nm"]["20deg"] for r in (right, wrong)]
    for words, torque in (("as degrees", at[0]), ("as radians", at[1])):
        assert (
            f"{words}: {torque:.3g} N.m at 20 deg of subtalar (foot rolled outward (supination))" in report.problems[0]
        )
    assert 'in place of "?"' in report.problems[0]
    assert "(too weak for a brace)" in report.problems[0]
    assert "only as degrees is plausible (assumed of braces: 3.5 to 600 N.m in a landing" in report.problems[0]
    with pytest.raises(InputError, match=r"unit = \"\?\": deg or rad\? the FMU does not say"):
        load_scenario("incline30").replace_fmu("brace", fmu, mapping)


def test_the_contract_s_names_without_units_are_si_where_that_is_plausible(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A law in radians fits with both readings; one in degrees is refused by check and run, until a file states it."""
    right = device(tmp_path / "right.fmu", declared=False)
    report = check_brace(right)
    assert report.verdict == "fits with warnings"
    assert report.warnings[0].startswith(
        "no unit is declared for subtalar_angle, subtalar_torque; the contract's SI units are assumed: as radians: "
    )
    assert "as degrees: " in report.warnings[0]
    wrong = device(tmp_path / "wrong.fmu", declared=False, angle="deg")
    report = check_brace(wrong)
    assert "SI units are not plausible" in report.problems[0]
    assert "only as degrees is plausible" in report.problems[0]
    assert 'subtalar_angle = { to = "subtalar_angle", unit = "?" }' in report.proposal
    assert _run(["run", "incline30", "--fmu", f"brace={wrong}"], []) == 2
    assert "only as degrees is plausible" in capsys.readouterr().err
    (tmp_path / "map.toml").write_text(report.proposal.replace('"?"', '"deg"', 1).replace('"?"', '"N.m"', 1))
    assert check_brace(wrong, tmp_path / "map.toml").verdict == "fits"


def test_a_torque_without_a_unit_is_read_as_newton_metres_and_millimetres(tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu", torque="N.mm", names=("angle", "torque"), declared=False)
    (tmp_path / "map.toml").write_text(
        '[inputs]\nsubtalar_angle = { to = "angle", unit = "rad" }\n[outputs]\nsubtalar_torque = "torque"\n'
    )
    report = check_brace(fmu, tmp_path / "map.toml")
    assert report.problems[0].startswith("units that nobody declared (subtalar_torque): as N.m: ")
    assert "only as N.mm is plausible" in report.problems[0]
    with pytest.raises(InputError, match=r"no unit: N\.m or N\.mm\? the FMU does not say"):
        load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "map.toml")


def write_map(angle: str) -> Path:
    path = Path(f"{angle}.toml")
    path.write_text(
        f'[inputs]\nsubtalar_angle = {{ to = "angle", unit = "{angle}" }}\n'
        '[outputs]\nsubtalar_torque = { from = "torque", unit = "N.m" }\n'
    )
    return path


@pytest.mark.parametrize(("torque", "factor"), [("N.mm", 1e-3), ("N.m", 1e3)])
def test_a_unit_that_is_declared_wrong(torque: str, factor: float, tmp_path: Path) -> None:
    """Newton metres declared as millimetres, and the other way round: the size gives it away."""
    (tmp_path / "map.toml").write_text(
        f'[outputs]\nsubtalar_torque = {{ from = "subtalar_torque", factor = {factor if torque == "N.m" else 1.0}, '
        f'unit = "{torque}" }}'
    )
    report = check_brace(device(tmp_path / "device.fmu"), tmp_path / "map.toml")
    assert report.verdict == "fits with warnings"
    assert "are its units right" in report.warnings[0]


def test_a_law_per_radian_that_is_fed_degrees(tmp_path: Path) -> None:
    """744 N.m in a landing, 859 N.m/rad."""
    report = check_brace(brace(tmp_path / "device.fmu", "FED"))
    assert report.verdict == "fits with warnings"
    warning = report.warnings[0]
    assert " N.m in a landing and 859 N.m/rad: too strong for a brace (assumed of braces: 3.5 to 600 N.m in" in warning


def test_a_unit_whose_factor_contradicts_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """N.mm declared as 1 N.m: nobody can know which of the two is meant, until a mapping file says so."""
    from tests import native

    monkeypatch.setitem(native.UNITS, "N.mm", (1.0, native.UNITS["N.mm"][1]))
    fmu = device(tmp_path / "device.fmu", torque="N.mm")
    report = check_brace(fmu)
    assert report.problems == [
        "subtalar_torque: its unit N.mm is declared with the factor 1, but N.mm is 0.001 kg.m2/s2; correct the "
        "description, or state the true unit in a mapping file"
    ]
    (tmp_path / "map.toml").write_text('[outputs]\nsubtalar_torque = { from = "subtalar_torque", unit = "N.m" }\n')
    assert check_brace(fmu, tmp_path / "map.toml").fits


def test_a_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The proposal is printed instead; the verdict stands."""
    device(tmp_path / "vendor.fmu", names=("In1_InvAngle", "M_out"))
    monkeypatch.setattr(Path, "write_text", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    told = CliRunner().invoke(cli, ["check", str(tmp_path / "vendor.fmu")], standalone_mode=False)
    assert told.return_value == 1
    assert 'subtalar_torque = { from = "M_out" }' in told.output


def test_no_brace(tmp_path: Path) -> None:
    """A model without angles and torques is told so."""
    variables = (
        SUBTALAR.replace("subtalar_angle", "u").replace("subtalar_torque", "h").replace('unit="N.m"', 'unit="rad"')
    )
    report = check_brace(compile_fmu(tmp_path / "ball.fmu", variables=variables))
    assert not report.fits
    assert "no brace" in report.problems[0]


def test_proposal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names differ: a mapping is written, with what is uncertain marked, and completes the check."""
    monkeypatch.chdir(tmp_path)
    device(Path("vendor.fmu"), names=("In1_InvAngle", "M_out"))
    told = CliRunner().invoke(cli, ["check", "vendor.fmu"], standalone_mode=False)
    assert told.return_value == 1
    assert "docs/figures/axes.png" in " ".join(told.output.split())
    text = Path("vendor.map.toml").read_text()
    assert 'subtalar_angle = { to = "In1_InvAngle" }\n' in text
    assert 'subtalar_torque = { from = "M_out" }   # review' in text
    told = CliRunner().invoke(cli, ["check", "vendor.fmu", "--map", "vendor.map.toml", "--json"], standalone_mode=False)
    assert told.return_value == 0
    assert "axes.png" not in told.output
    content = json.loads(told.output)
    assert content["verdict"].startswith("fits")
    assert content["facts"]["subtalar"]["torque_Nm"]["10deg"] == pytest.approx(-4.03, abs=0.01)


def test_missing_functions(tmp_path: Path) -> None:
    import zipfile

    fmu = device(tmp_path / "device.fmu")
    with zipfile.ZipFile(fmu) as archive:
        files = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "cut.fmu", "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data.replace(b"fmi2DoStep", b"fmi2NoStep"))
    with pytest.raises(InputError, match="lacks the FMI functions fmi2DoStep"):
        check_brace(tmp_path / "cut.fmu")


def test_cannot_be_instantiated(tmp_path: Path) -> None:
    import zipfile

    fmu = device(tmp_path / "device.fmu")
    with zipfile.ZipFile(fmu) as archive:
        files = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "cut.fmu", "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data.replace(b"\0exp\0", b"\0exq\0"))
    with pytest.raises(InputError, match=r"cannot be instantiated: .*exq"):
        check_brace(tmp_path / "cut.fmu")
