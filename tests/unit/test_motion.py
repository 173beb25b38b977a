"""A measured motion as the start of a landing: files read, signs turned, speeds by splines, first contact, and what is
refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sprain_cosim.animate.skeleton import Skeleton
from sprain_cosim.cli import _run
from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.export.landing import COORDINATES, TRANSLATIONS, write_landing
from sprain_cosim.folders.landing import Landing
from sprain_cosim.motion.contact import first_contact
from sprain_cosim.motion.coordinates import MIRRORED, read_course
from sprain_cosim.motion.offsets import PLANT_PLACES, measured_length
from sprain_cosim.motion.osim import read_osim
from sprain_cosim.motion.page import motion_page, motion_warnings
from sprain_cosim.motion.speeds import smoothed, spline_speed, value_at
from sprain_cosim.motion.start import MotionStart, motion_start
from sprain_cosim.motion.storage import read_storage
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import fmu_path
from tests.reference import needs_reference
from tools.reference import FOLDER

PLANT = fmu_path("plant", Path.cwd(), "plant")
FILE = FOLDER / "motion" / "drop_jump.mot"
FLOOR = 0.4  # s, when the fall of `fall` ends


def fall(knee: float = 16.0) -> dict[str, np.ndarray]:
    """A person who falls onto a level floor and stands: columns in degrees and metres, the knee positive in flexion."""
    time = np.arange(70) / 100
    own = {"hip_flexion_r": 30.0, "hip_adduction_r": -13.0, "hip_rotation_r": -12.0, "knee_angle_r": knee}
    own |= {"ankle_angle_r": -34.0, "subtalar_angle_r": 1.0, "pelvis_tilt": -13.0, "pelvis_list": 8.0}
    own |= {"pelvis_rotation": 17.0, "lumbar_extension": -10.0, "lumbar_bending": -9.0, "lumbar_rotation": -12.0}
    own |= {"pelvis_tx": -0.4, "pelvis_tz": 0.3, "mtp_angle_r": 0.0, "knee_angle_l": 50.0}
    falling = np.minimum(time, FLOOR)
    height = 1.05 + 0.5 * 9.80665 * (FLOOR**2 - falling**2)
    return {"time": time} | {c: np.full(len(time), v) for c, v in own.items()} | {"pelvis_ty": height}


def storage(path: Path, columns: Mapping[str, np.ndarray], head: str = "inDegrees=yes") -> Path:
    rows = ["\t".join(f"{v:.12g}" for v in row) for row in zip(*columns.values(), strict=True)]
    lines = ["Coordinates", "version=1", f"nRows={len(rows)}", f"nColumns={len(columns)}", head, "endheader"]
    path.write_text("\n".join([*lines, "\t".join(columns), *rows]) + "\n")
    return path


@pytest.fixture(scope="module")
def landed() -> Landing:
    chosen = load_scenario("incline30_mixed").recording("plant.*")
    return Landing("landing", chosen.heading, chosen.initial_pose(), chosen.run(), {}, PLANT)


@pytest.mark.parametrize(("name", "pose"), [("x.sto", "touching"), ("x.sto", "given"), ("x.mot", "touching")])
def test_a_landing_that_was_exported_starts_again(name: str, pose: str, landed: Landing, tmp_path: Path) -> None:
    """Through the folder that a run leaves, at the first row: the same landing to 1e-9."""
    kept = tmp_path / "signals.csv"
    kept.write_text(landed.result.csv())
    stored = Landing("kept", "", landed.pose, Result.read_csv(kept), {}, PLANT)
    write_landing(stored, tmp_path / name, speeds=True)
    start = motion_start(tmp_path / name, pose=pose, base="incline30_mixed")
    assert start.contact.at == 0.0
    assert "first row" in start.contact.how
    again = start.scenario.recording("plant.*").run()
    scale = np.abs(landed.result.values).max(axis=0)
    assert (np.abs(again.values - landed.result.values) <= 1e-9 * scale).all()
    assert {v.by_column for v in start.values.values()} == {True}


def test_the_command_leaves_a_scenario_a_page_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, target = storage(tmp_path / "fall.mot", fall()), tmp_path / "own.toml"
    assert _run(["motion", str(file), "--side", "right", "-o", str(target), "--json"], []) == 0
    told = capsys.readouterr()
    content = json.loads(told.out)
    assert content["initial_pose"] == "touching"
    assert content["unused"] == {"mtp_angle_r": "locked", "knee_angle_l": "locked"}
    scenario = load_scenario(target)
    assert scenario.parameters["plant.knee_angle_r_at_contact"] == "-16.0 deg"
    assert "fall.mot" in scenario.heading
    result = scenario.run()
    assert result.metrics["peak_subtalar_angle_deg"] == pytest.approx(content["peak_subtalar_angle_deg"][""], abs=1e-9)
    idle = scenario.override("plant.drop_height", "0.5 m").doubts()
    assert idle == scenario.without_effect(["plant.drop_height"]) != []
    assert "plant.drop_height has no effect: the pelvis falls with 3.92 m/s" in idle[0]
    assert (
        "has no effect with plant.initial_pose = touching" in scenario.without_effect(["plant.pelvis_ty_at_contact"])[0]
    )
    assert scenario.without_effect(["plant.contact_modulus"]) == scenario.doubts() == []
    assert load_scenario("incline30").without_effect(["plant.drop_height"]) == []
    page = (tmp_path / "own.md").read_text()
    for words in ("the sign was turned", "mtp_angle_r", "15 Hz", "one row earlier", "own.png", "touching"):
        assert words in page
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")


def test_first_contact_is_the_last_row_of_the_fall(tmp_path: Path) -> None:
    start = motion_start(storage(tmp_path / "fall.mot", fall()))
    assert start.contact.at == pytest.approx(FLOOR)
    assert start.values["pelvis_ty"].speed == pytest.approx(-9.80665 * FLOOR, rel=1e-6)
    assert start.drop == pytest.approx(0.5 * 9.80665 * FLOOR**2, rel=1e-6)
    named = motion_start(start.table.path, at=0.3)
    assert named.values["pelvis_ty"].speed == pytest.approx(-9.80665 * 0.3, rel=1e-6)
    between = motion_start(start.table.path, at=0.305).values["pelvis_ty"]
    assert between.value == pytest.approx(1.05 + 0.5 * 9.80665 * (FLOOR**2 - 0.305**2), abs=1e-7)
    for rate in (50, 100, 1000):
        for floor in (0.401, 0.405, 0.409):
            time = np.arange(rate) / rate
            found = first_contact(time, -0.5 * 9.80665 * np.minimum(time, floor) ** 2).at
            assert abs(found - floor) <= 1.0 / min(rate, 100), (rate, floor)
    hops = np.interp(np.arange(120) / 100, [0, 0.2, 0.4, 0.5, 0.8, 1.0, 1.2], [0.4, 0.4, 0, 0, 0.3, 0, 0])
    assert first_contact(np.arange(120) / 100, hops).at == pytest.approx(0.4)
    time = np.arange(100) / 100
    with pytest.raises(InputError, match="never comes down faster"):
        first_contact(time, np.full(100, 0.1) - 0.01 * time)
    with pytest.raises(InputError, match="ends before the foot stands"):
        first_contact(time, 0.5 - 3.0 * time)


def test_what_speaks_for_another_instant_is_said() -> None:
    """A fall that is not the landing, a file that begins after contact, rows that are missing before it."""
    time = np.arange(120) / 100
    hops = np.interp(time, [0, 0.2, 0.4, 0.5, 0.8, 0.9, 1.2], [0.4, 0.4, 0.1, 0.1, 0.3, 0, 0])
    (other,) = first_contact(time, hops).doubts
    assert "faster later (3.00 m/s" in other
    assert "say the instant with --at" in other
    landing = np.interp(time, [0, 0.5, 0.7, 1.2], [0.4, 0.4, 0, 0])
    assert first_contact(time, landing).doubts == ()
    braked = 0.02 * np.exp(-time / 0.02)
    assert "may touch already in its first row" in first_contact(time, braked).doubts[0]


def test_rows_that_are_missing_and_rows_too_far_apart_are_said(tmp_path: Path) -> None:
    columns = fall()
    columns["ankle_angle_r"] = -34.0 + 5.0 * np.sin(2 * np.pi * 9.0 * columns["time"])
    whole = motion_start(storage(tmp_path / "whole.mot", columns))
    assert not any("evenly" in line or "too few" in line for line in motion_warnings(whole))
    holes = {c: np.delete(v, range(34, 38)) for c, v in columns.items()}
    told = motion_warnings(motion_start(storage(tmp_path / "holes.mot", holes)))
    assert any("10 ms apart in the middle, 50 ms from 0.33 s on" in line for line in told)
    thin = motion_start(storage(tmp_path / "thin.mot", {c: v[::4] for c, v in columns.items()}), at=0.4)
    assert any(
        "25 rows a second are too few for speeds that are smoothed with 15 Hz" in w for w in motion_warnings(thin)
    )
    speed = thin.values["ankle_angle_r"]
    assert speed.low <= math.radians(columns["ankle_angle_r"][40] - columns["ankle_angle_r"][36]) / 0.04 <= speed.high


def test_a_left_footed_landing_is_mirrored(tmp_path: Path) -> None:
    columns = fall() | {"knee_angle_r": fall()["knee_angle_l"]}
    del columns["knee_angle_l"]
    left = {(f"{c[:-2]}_l" if c.endswith("_r") else c): -v if c in MIRRORED else v for c, v in columns.items()}
    left["hip_flexion_r"] = np.full(70, 77.0)
    ours = motion_start(storage(tmp_path / "right.mot", columns), at=0.35)
    theirs = motion_start(storage(tmp_path / "left.mot", left), at=0.35, side="left")
    for c in COORDINATES:
        assert theirs.values[c].value == pytest.approx(ours.values[c].value, abs=1e-12), c
        assert theirs.values[c].speed == pytest.approx(ours.values[c].speed, abs=1e-9), c
    assert any("mirrored" in line for line in theirs.course.turned)
    assert theirs.course.unused["hip_flexion_r"] == "locked"
    assert theirs.values["knee_angle_r"].label == "knee_angle_l"


def test_a_motion_turned_about_the_vertical_is_the_same_motion(tmp_path: Path) -> None:
    """A person who walks along another axis of the laboratory, with speeds in columns and by splines."""
    columns = fall()
    columns["pelvis_tx"] = -0.4 + 0.5 * columns["time"]
    columns["pelvis_list"] = 8.0 + 20.0 * columns["time"]
    plain = motion_start(storage(tmp_path / "plain.mot", columns), at=0.2)
    row = {"time": np.array([0.2])} | {c: np.array([v.value]) for c, v in plain.values.items()}
    row |= {f"{c}_u": np.array([v.speed]) for c, v in plain.values.items()}
    here = read_storage(storage(tmp_path / "row.sto", row, "inDegrees=no"))
    turned = read_course(here, knee="extension", turn=math.radians(50.0))
    far = {"time": row["time"], **turned.values, **{f"{c}_u": v for c, v in turned.speeds.items()}}
    with pytest.raises(InputError, match=r'faces 6\d deg to the left.*say --turn "-6\d deg"'):
        motion_start(storage(tmp_path / "far.sto", far, "inDegrees=no"), at=0.2, knee="extension")
    back = motion_start(tmp_path / "far.sto", at=0.2, knee="extension", turn=math.radians(-50.0))
    for c in COORDINATES:
        assert back.values[c].value == pytest.approx(plain.values[c].value, abs=1e-9), c
        assert back.values[c].speed == pytest.approx(plain.values[c].speed, abs=1e-5), c


def test_splines_pass_what_their_cutoff_says_and_a_fall_untouched() -> None:
    time = 3.0 + np.arange(200) / 100
    for hertz, share in ((5.0, 1 / (1 + (5 / 15) ** 6)), (15.0, 0.5), (30.0, 1 / (1 + 2**6))):
        wave = np.sin(2 * np.pi * hertz * time)
        slope = 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * 4.0)
        assert smoothed(time, wave, 15.0)(4.0, 1) / slope == pytest.approx(share, rel=0.02)
    drop = 1.0 - 0.5 * 9.80665 * (time - 3.0) ** 2
    speed = spline_speed(time, drop, time[-1])
    assert speed.one_sided
    assert (speed.low, speed.high) == pytest.approx((-9.80665 * 1.99,) * 2, rel=1e-6)
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 60))
    assert smoothed(uneven, uneven**2, 15.0)(0.5, 1) == pytest.approx(1.0, rel=1e-6)
    assert value_at(time, drop, time[7]) == drop[7]


def test_what_is_missing_of_the_trunk_is_filled_and_said(tmp_path: Path) -> None:
    columns = {c: v for c, v in fall().items() if not c.startswith(("lumbar", "subtalar"))}
    start = motion_start(storage(tmp_path / "legs.mot", columns), at=0.35)
    told = "has no subtalar_angle_r, lumbar_extension, lumbar_bending, lumbar_rotation: filled with 0, at rest"
    assert any(told in line for line in motion_warnings(start))
    assert told in motion_page(start, {}, "x.toml", "x.png")
    assert start.scenario.parameters["plant.lumbar_bending_at_contact"] == "0.0 deg"


def changed(**more: float | None) -> Callable[[], dict[str, np.ndarray]]:
    """`fall` with columns set to a number; None: without them."""

    def columns() -> dict[str, np.ndarray]:
        out = fall()
        for name, value in more.items():
            if value is None:
                del out[name]
            else:
                out[name] = np.full(70, value)
        return out

    return columns


def gap() -> dict[str, np.ndarray]:
    out = fall()
    out["hip_flexion_r"][33] = np.nan
    return out


def still() -> dict[str, np.ndarray]:
    return fall() | {"pelvis_ty": np.full(70, 1.0)}


def one_row() -> dict[str, np.ndarray]:
    return {c: v[:1] for c, v in fall().items()}


def renamed(names: Callable[[str], str]) -> Callable[[], dict[str, np.ndarray]]:
    return lambda: {c if c == "time" else names(c): v for c, v in fall().items()}


def doubled() -> dict[str, np.ndarray]:
    return fall() | {"/jointset/hip_r/hip_flexion_r/value": fall()["time"]}


def in_radians() -> dict[str, np.ndarray]:
    return {c: v if c in ("time", *TRANSLATIONS) else np.radians(v) for c, v in fall().items()}


HEADS = {"no unit": "name=x", "degrees said to be radians": "inDegrees=no"}
BAD: dict[str, tuple[Callable[[], dict[str, np.ndarray]], str, str]] = {
    "no knee": (changed(knee_angle_r=None), "", "has no column knee_angle_r, without which"),
    "another spelling": (
        renamed(lambda c: c.replace("hip_flexion", "hip_flex")),
        "",
        "has no column hip_flexion_r, without which there is no landing (did you mean hip_flex_r?)",
    ),
    "another model": (
        renamed(lambda c: f"R{c}X"),
        "",
        "none of its columns (Rhip_flexion_rX, Rhip_adduction_rX, Rhip_rotation_rX, Rknee_angle_rX, ...) has a name",
    ),
    "no unit": (fall, "", "no line inDegrees=yes or inDegrees=no, and its angles (up to 34) look like degrees"),
    "degrees said to be radians": (fall, "", "can only be degrees"),
    "radians said to be degrees": (in_radians, "", "no angle is larger than 0.593, which can only be radians"),
    "a gap": (gap, "", "line 41 (time 0.33 s): column hip_flexion_r: no number"),
    "before the file": (fall, "--at|-1 s", "--at -1 s lies outside the file, which goes from 0 to 0.69 s"),
    "no time": (fall, "--at|1 deg", "--at"),
    "no landing": (still, "", "never comes down faster than 0.5 m/s"),
    "knee unknown": (changed(knee_angle_r=5.0, knee_angle_l=None), "", "positive in flexion cannot be told"),
    "knee of two minds": (
        changed(knee_angle_r=-40.0, knee_angle_r_beta=1.0),
        "",
        "contradicts itself: + flexion by column knee_angle_r_beta",
    ),
    "inside the floor": (
        fall,
        "--at|0.39 s|--pose|given",
        "mm inside the platform of incline30; take an earlier instant",
    ),
    "backwards": (changed(pelvis_rotation=-170.0), "--at|0.3 s", "to the right of the plant's forward axis (+x)"),
    "too far": (changed(ankle_angle_r=-95.0), "--at|0.3 s", "talocrural_angle_at_contact"),
    "too far, and no instant": (changed(ankle_angle_r=-95.0), "", "say the instant with --at"),
    "another base": (fall, "--base|incline3", "none of that name ships (did you mean incline30?)"),
    "twice": (doubled, "", "are both the value of hip_flexion_r"),
    "one row": (one_row, "--at|0 s", "1 rows give no speed of pelvis_tilt (a spline needs 8)"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns, options, said = BAD[case]
    file = storage(tmp_path / "x.mot", columns(), HEADS.get(case, "inDegrees=yes"))
    more = options.split("|") if options else []
    assert _run(["motion", str(file), *more, "-o", str(tmp_path / "x.toml")], []) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith("error: ")
    assert told.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.mot"]


TEXTS = {
    "no header": ("time\tpelvis_tilt\n0\t1\n", "has no line `endheader`"),
    "no rows": ("inDegrees=yes\nendheader\ntime\tpelvis_tilt\n", "has column labels and no rows"),
    "no labels": ("inDegrees=yes\nendheader\n", "a line of column labels must come that begins with `time`"),
    "an empty row": ("inDegrees=yes\nendheader\ntime\ta\n0\t1\n\n1\t2\n", "line 5 is empty; delete it"),
    "a short row": ("inDegrees=yes\nendheader\ntime\ta\n0\t1\n1\n", "line 5 has 1 cells, the labels are 2"),
    "time back": ("inDegrees=yes\nendheader\ntime\ta\n1\t1\n0\t1\n", "line 5: time 0 s does not rise (before it 1 s)"),
    "time missing": ("inDegrees=yes\nendheader\ntime\ta\nx\t1\n", "line 4: its time is no number"),
    "a word": ("inDegrees=maybe\nendheader\ntime\ta\n0\t1\n", "inDegrees=maybe: must be yes or no"),
    "twice": ("inDegrees=yes\nendheader\ntime\ta\ta\n0\t1\t1\n", "column a is given twice"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_a_text_that_is_no_storage_file_is_refused(case: str, tmp_path: Path) -> None:
    text, said = TEXTS[case]
    (tmp_path / "x.mot").write_text(text)
    with pytest.raises(InputError) as problem:
        read_storage(tmp_path / "x.mot")
    assert said in str(problem.value)
    assert str(problem.value).startswith(str(tmp_path / "x.mot"))


def test_a_header_of_the_old_tools_and_rows_that_are_fewer_than_announced(tmp_path: Path) -> None:
    (tmp_path / "x.mot").write_text(
        "name x\r\ndatacolumns 2\r\ndatarows 3\r\nendheader\r\n\r\ntime a\r\n0 1\r\n1 2\r\n\r\n"
    )
    table = read_storage(tmp_path / "x.mot")
    assert table.in_degrees is None
    assert table.notes == ("the header announces 3 rows, the file has 2",)
    assert table.columns["a"].tolist() == [1.0, 2.0]


def differs(start: MotionStart, row: int) -> None:
    """Coordinates are those of the file's row; speeds of the cubic spline lie in the range that the page states."""
    for c, value in start.values.items():
        factor = 1.0 if c in TRANSLATIONS else math.pi / 180.0
        column = factor * start.table.columns[value.label] * (-1.0 if c == "knee_angle_r" else 1.0)
        assert value.value == pytest.approx(column[row], abs=1e-12), c
        slope = float(CubicSpline(start.table.time, column)(start.table.time[row], 1))
        assert value.low - 1e-9 <= slope <= value.high + 1e-9, c


@needs_reference
def test_a_measured_drop_jump_lands() -> None:
    start = motion_start(FILE)
    assert start.contact.at == pytest.approx(1.26)
    assert any("knee: + flexion" in line and "knee_angle_r_beta" in line for line in start.course.turned)
    differs(start, 30)
    result = start.scenario.recording("plant.*").run()
    assert result.status == "completed"
    for c, value in start.values.items():
        if c != "pelvis_ty":  # which touching moves
            assert result[f"plant.{c}"][0] == pytest.approx(value.value, abs=1e-12), c
        assert result[f"plant.{c}_speed"][0] == pytest.approx(value.speed, abs=1e-12), c
    differs(motion_start(FILE, at=1.2), 24)
    left = motion_start(FILE, side="left")
    assert left.values["ankle_angle_r"].label == "ankle_angle_l"
    assert left.scenario.run().status == "completed"


def osim(path: Path, foot: str = "0.9 0.91 0.92", knee: str = "0 2.4", mass: str = "8") -> Path:
    scales = {"pelvis": "0.95 0.96 0.97", "femur_r": "0.92 0.92 0.92", "femur_l": "0.95 0.92 0.92", "calcn_r": foot}
    drawn = "<attached_geometry><Mesh><scale_factors>{}</scale_factors></Mesh></attached_geometry>"
    bodies = [f'<Body name="{n}">{drawn.format(s)}<mass>{mass}</mass></Body>' for n, s in scales.items()]
    path.write_text(
        f"<OpenSimDocument><Model name='S01'><BodySet>{''.join(bodies)}"
        "<Body name='head'><mass>30</mass></Body></BodySet>"
        f'<Coordinate name="knee_angle_r"><range>{knee}</range></Coordinate></Model></OpenSimDocument>'
    )
    return path


def test_the_size_of_a_person_comes_from_a_model_file(tmp_path: Path) -> None:
    columns = fall(knee=5.0) | {"knee_angle_l": np.zeros(70)}
    file = storage(tmp_path / "x.mot", columns)
    start = motion_start(file, at=0.3, model=osim(tmp_path / "x.osim"))
    assert any("range of the knee in the model file" in line for line in start.course.turned)
    parameters = start.scenario.parameters
    assert parameters["plant.body_mass"] == "62.0 kg"
    assert [parameters[f"plant.foot_scale_{a}"] for a in "xyz"] == [0.9, 0.91, 0.92]
    assert parameters["plant.thigh_scale_x"] == 0.92
    assert "plant.torso_scale_x" not in parameters
    assert start.scenario.run().status == "completed"
    page = motion_page(start, {}, "x.toml", "x.png")
    for words in ("thigh: the factors of femur_r are taken; those of femur_l differ", "plant has not: head", "62 kg"):
        assert words in page
    assert "torso: the file has no scale factors of torso; 1 is taken" in page
    assert read_osim(tmp_path / "x.osim", "left").parameters()["thigh_scale_x"] == 0.95


FACTORS = {"pelvis": (0.95, 0.96, 0.97), "femur_r": (1.1, 1.1, 1.1), "tibia_r": (1.0, 1.05, 1.0), "calcn_r": (0.9,) * 3}
ENDS = {"pelvis": "femur_r", "femur_r": "tibia_r", "tibia_r": "talus_r", "calcn_r": "toes_r"}
SEGMENT = {"pelvis": "pelvis", "femur_r": "thigh", "tibia_r": "shank", "calcn_r": "foot"}


KNEE = """<TransformAxis name="translation2"><axis>0 1 0</axis><function><MultiplierFunction><function>
<SimmSpline><x>-2 0 0.1</x><y>-0.5 -0.1 0</y></SimmSpline></function><scale>1.2</scale></MultiplierFunction></function>
</TransformAxis>"""
JOINT = {
    3: """<Joint><CustomJoint><parent_body>{inner}</parent_body><location_in_parent>{at}</location_in_parent>
<location>0 0.01 0</location>{moved}</CustomJoint></Joint>""",
    4: """<CustomJoint><socket_parent_frame>{inner}_offset</socket_parent_frame>
<socket_child_frame>{body}_offset</socket_child_frame><frames>
<PhysicalOffsetFrame name="{inner}_offset"><socket_parent>/bodyset/{inner}</socket_parent>
<translation>{at}</translation></PhysicalOffsetFrame>
<PhysicalOffsetFrame name="{body}_offset"><socket_parent>/bodyset/{body}</socket_parent>
<translation>0 0.01 0</translation></PhysicalOffsetFrame></frames>{moved}</CustomJoint>""",
}
DRAWN = {
    3: """<VisibleObject><GeometrySet><objects><DisplayGeometry><scale_factors>1 1 1</scale_factors></DisplayGeometry>
</objects></GeometrySet><scale_factors>{}</scale_factors></VisibleObject>""",
    4: """<FrameGeometry><scale_factors>0.2 0.2 0.2</scale_factors></FrameGeometry>
<attached_geometry><Mesh><scale_factors>{}</scale_factors></Mesh></attached_geometry>""",
}


def scaled_osim(path: Path, version: int) -> Path:
    """As OpenSim 3 and 4 write a model nine tenths of the plant's size after scaling it: the drawings of frames, the
    factors of meshes, a joint with a place in either body, the knee as a spline that is not 0 at 0."""

    def three(values: Iterable[float]) -> str:
        return " ".join(f"{v:.9g}" for v in values)

    bodies, joints = "", ""
    for body in (*FACTORS, "talus_r", "toes_r"):
        joint = ""
        for inner in (b for b, end in ENDS.items() if end == body):
            place = 0.9 * np.array(FACTORS[inner]) * np.array(PLANT_PLACES[SEGMENT[inner]])
            place[1] += 0.01 + 0.12 * (body == "tibia_r")
            moved = KNEE if body == "tibia_r" else ""
            joint = JOINT[version].format(inner=inner, body=body, at=three(place), moved=moved)
        drawn = DRAWN[version].format(three(FACTORS.get(body, (1.0, 1.0, 1.0))))
        bodies += f'<Body name="{body}">{drawn}<mass>10</mass>{joint if version == 3 else ""}</Body>'
        joints += joint if version == 4 else ""
    sets = f"<BodySet><objects>{bodies}</objects></BodySet><JointSet><objects>{joints}</objects></JointSet>"
    path.write_text(f"<OpenSimDocument><Model name='S'>{sets}</Model></OpenSimDocument>")
    return path


@pytest.mark.parametrize("version", [3, 4])
def test_factors_are_against_the_plant_whatever_model_was_scaled(version: int, tmp_path: Path) -> None:
    found = read_osim(scaled_osim(tmp_path / "x.osim", version))
    for body, factors in FACTORS.items():
        segment = SEGMENT[body]
        assert found.stated[segment] == pytest.approx(factors)
        assert found.factors[segment] == pytest.approx([0.9 * f for f in factors], abs=2e-6), segment
        plant = measured_length(segment, np.array(PLANT_PLACES[segment]) * factors)
        assert found.lengths[segment] == pytest.approx(0.9 * plant, rel=1e-6)
    assert not any("as they stand" in note for note in found.notes)
    assert "torso: the file has no scale factors of torso; 1 is taken" in found.notes


def test_places_of_the_plants_joints_are_its_tables() -> None:
    from fmus.plant.model import load_bodies

    bodies = {body.name: body for body in load_bodies()}
    for segment, end in (("pelvis", "femur_r"), ("shank", "talus_r"), ("foot", "toes_r"), ("torso", "humerus_r")):
        assert PLANT_PLACES[segment] == pytest.approx(tuple(bodies[end].at_parent)), segment
    pose = Skeleton.read(PLANT).pose(dict.fromkeys(Skeleton.read(PLANT).coordinates, 0.0))
    (hip, turn), (knee, _) = pose["femur_r"], pose["tibia_r"]
    assert turn.T @ (knee - hip) == pytest.approx(np.array(PLANT_PLACES["thigh"]), abs=1e-6)


def test_a_model_as_it_came_and_a_model_of_something_else(tmp_path: Path) -> None:
    text = scaled_osim(tmp_path / "x.osim", 4).read_text()
    for factors in FACTORS.values():
        text = text.replace(f"<scale_factors>{' '.join(f'{f:.9g}' for f in factors)}<", "<scale_factors>1 1 1<")
    (tmp_path / "y.osim").write_text(text)
    assert "all scale factors are 1" in read_osim(tmp_path / "y.osim").notes[-1]
    for body in (*FACTORS, "talus_r", "toes_r"):
        text = text.replace(f'<Body name="{body}">', f'<Body name="my_{body}">')
    (tmp_path / "z.osim").write_text(text)
    with pytest.raises(InputError, match=r"none of its bodies is one of this plant's .* it has my_pelvis"):
        read_osim(tmp_path / "z.osim")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            {"foot": "0.2 0.2 0.2"},
            "scale_factors of calcn_r are 0.2 0.2 0.2: no person is 0.2 times as large as the model",
        ),
        ({"foot": "1 1"}, "scale_factors of calcn_r: '1 1' are not three numbers"),
        ({"mass": "-1"}, "mass of pelvis: '-1' is no mass"),
        ({"mass": "200"}, "plant.body_mass = 830"),
    ],
)
def test_a_model_file_that_fits_no_person_is_refused(more: dict[str, str], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as problem:
        motion_start(storage(tmp_path / "x.mot", fall()), at=0.3, model=osim(tmp_path / "x.osim", **more))
    assert said in str(problem.value)
    (tmp_path / "y.osim").write_text("<OpenSimDocument>")
    with pytest.raises(InputError, match="is no XML of an OpenSim model"):
        motion_start(tmp_path / "x.mot", at=0.3, model=tmp_path / "y.osim")
    (tmp_path / "y.osim").write_text("<Model/>")
    with pytest.raises(InputError, match=r"it has no <Model> with bodies"):
        motion_start(tmp_path / "x.mot", at=0.3, model=tmp_path / "y.osim")
