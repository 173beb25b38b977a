"""What is drawn: the pose against MuJoCo's, the ray caster against geometry, films of a short landing."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from scipy.spatial.transform import Rotation

from sprain_cosim.animate.bones import bones
from sprain_cosim.animate.film import HOLD, RATE, animate
from sprain_cosim.animate.moving import HALF_PLATFORM, MovingBodies, platform_axes, platform_outline
from sprain_cosim.animate.skeleton import Skeleton
from sprain_cosim.animate.solid import PAPER, Camera
from sprain_cosim.animate.stage import Stage
from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.figures.style import BRACE, GROUND, SeriesLook, lines_of
from sprain_cosim.folders.landing import Landing
from sprain_cosim.report.scene import _content
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import fmu_path

X, Y, Z = np.eye(3)
PLANT = fmu_path("plant", Path.cwd(), "plant")
AWAY = np.array([0.0, -9.0, 0.0])  # the box, out of sight


@pytest.fixture(scope="module")
def braced() -> Landing:
    chosen = load_scenario("incline30_brace").with_master(stop="48 ms").recording("plant.*")
    return Landing(
        "braced", chosen.heading, chosen.initial_pose(), chosen.run(), {"plant.platform_incline": np.pi / 6}, PLANT
    )


def test_pose_is_that_of_the_kernels() -> None:
    from tools.direct import plant

    mine, theirs = Skeleton.read(PLANT), plant()
    assert list(mine.coordinates) == theirs.skeleton.coordinates
    random = np.random.default_rng(4)
    for _ in range(30):
        q = theirs.skeleton.initial()[0] + random.uniform(-0.4, 0.4, 15)
        q[9] = random.uniform(-2.0, 0.1)
        theirs.state["q"], theirs.state["valid"] = q, 0
        theirs.observe()
        pose = mine.pose(dict(zip(mine.coordinates, q, strict=True)))
        for k, name in enumerate(theirs.skeleton.names, 1):
            if name == "patella_r":
                continue
            assert (
                np.abs(pose[name][0] - theirs.state["xpos"][k]).max() < 1e-5
            )  # the knee's splines are tabulated every degree
            assert np.abs(pose[name][1] - theirs.state["xmat"][k].reshape(3, 3)).max() < 1e-12


def test_the_platform_is_drawn_where_a_motion_lands(braced: Landing) -> None:
    """A foot beside the drawn part takes it and the camera along: two places give the same picture."""
    pictures = []
    for place in ("-1 m", "-2.5 m"):
        chosen = load_scenario("incline30").override("plant.pelvis_tz_at_contact", place).override(
            "plant.pelvis_tx_at_contact", place
        )  # fmt: skip
        result = chosen.with_master(stop="0.5 ms").recording("plant.*").run()
        landing = Landing("", "", None, result, {"plant.platform_incline": np.pi / 6}, PLANT)
        stage = Stage([landing], 20.0)
        pictures.append(next(iter(stage.frames(np.zeros(1)))).astype(int))
        assert np.abs(stage.actors[0].pivot - stage.actors[0].skeleton.content["platform"]["pivot"]).max() > 0.5
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.05
    usual = Stage([braced], 20.0).actors[0]
    assert usual.pivot.tolist() == usual.skeleton.content["platform"]["pivot"]


def test_the_platform_is_drawn_up_to_its_edge() -> None:
    """Where the sole bears on it, and no further: the centre of pressure stays on what is drawn, and comes near its
    edge."""
    edge = {"plant.platform_edge_distance": -0.02, "plant.platform_edge_direction": np.pi / 2}
    result = load_scenario("step_edge").with_master(stop="120 ms").recording("plant.*").run()
    landing = Landing("", "", None, result, {"plant.platform_incline": 0.0, **edge}, PLANT)
    moving = MovingBodies.of(landing)
    assert moving.edge is not None
    borne = np.linalg.norm(moving.force, axis=1) > 50.0
    at = ((moving.point[borne] - moving.pivot) @ platform_axes(moving.tilt).T)[:, [0, 2]]
    room = moving.edge[2] - at @ moving.edge[:2]
    assert -1e-9 < room.min() < 0.01
    assert moving.outline[:, 1].max() == pytest.approx(moving.edge[2])
    (stage,) = Stage([landing], 20.0).actors
    assert stage.cut is not None
    assert stage.cut[[0, 2, 3]] == pytest.approx(moving.edge)


def test_the_outline_of_a_platform_with_an_edge() -> None:
    x, _, z = HALF_PLATFORM
    whole = platform_outline(None)
    assert whole.tolist() == platform_outline(np.array([0.6, 0.8, 9.0])).tolist()
    assert len(platform_outline(np.array([0.6, 0.8, -9.0]))) == 0
    half = platform_outline(np.array([0.0, 1.0, 0.1]))
    assert half == pytest.approx(np.array([[-x, -z], [x, -z], [x, 0.1], [-x, 0.1]]))
    corner = platform_outline(np.array([np.sqrt(0.5), np.sqrt(0.5), 0.9 * np.sqrt(2) * x]))
    assert len(corner) == 5
    assert corner.sum(axis=1).max() == pytest.approx(1.8 * x)


def test_the_drawing_scales_with_the_person() -> None:
    """Bodies where the kernels have them, and every fused body where the scaling of the plant puts it."""
    from fmus.plant.model import load_bodies
    from fmus.plant.plant import Plant, person_with

    factors = {
        f"{segment}_scale_{axis}": 0.9 + 0.05 * j + 0.02 * k
        for j, segment in enumerate(("pelvis", "thigh", "shank", "foot", "torso"))
        for k, axis in enumerate("xyz")
    }
    theirs, mine = Plant(), Skeleton.read(PLANT).scaled(factors.__getitem__)
    theirs.embody(person_with(**factors))
    q = theirs.skeleton.initial()[0]
    theirs.state["q"], theirs.state["valid"] = q, 0
    theirs.observe()
    pose = mine.pose(dict(zip(mine.coordinates, q, strict=True)))
    for k, body in enumerate(load_bodies()):
        if body.name in pose:
            carrier = theirs._base[0]["carrier"][k]
            turn = theirs.state["xmat"][carrier].reshape(3, 3)
            place = theirs.state["xpos"][carrier] + turn @ theirs._scaled[0]["place"][k]
            assert np.abs(pose[body.name][0] - place).max() < 1e-5, body.name
    assert {"femur_l", "hand_r", "toes_l"} <= set(pose)
    usual = Skeleton.read(PLANT)
    rest = dict.fromkeys(usual.coordinates, 0.0)
    ratio = mine.volumes(mine.pose(rest))[:, 6:] / usual.volumes(usual.pose(rest))[:, 6:]
    assert ratio.min() > 0.9 and ratio.max() < 1.15


def test_bodies_that_move_are_the_poses(braced: Landing) -> None:
    moving, skeleton = MovingBodies.of(braced), Skeleton.read(PLANT)
    k = moving.peak
    at = int(np.argmin(np.abs(braced.result.time - moving.time[k])))
    pose = skeleton.pose({c: float(braced.result[f"plant.{c}"][at]) for c in skeleton.coordinates})
    for body, places in moving.places.items():
        assert np.abs(places[k] - pose[body][0]).max() < 1e-9
        assert np.abs(Rotation.from_quat(moving.turns[body][k]).as_matrix() - pose[body][1]).max() < 1e-9
        steps = np.einsum("ij,ij->i", moving.turns[body][1:], moving.turns[body][:-1])
        assert steps.min() > 0.9, "from one time to the next a quaternion goes the short way"
    assert np.abs(np.linalg.norm(moving.axis, axis=1) - 1).max() < 1e-6
    assert {v["part"] for v in moving.volumes} > {"bone", "brace", "sole"}
    drawn = [v for v in moving.volumes if v["part"] != "bone"]
    starts = [
        Rotation.from_quat(moving.turns[v["body"]][k]).apply(v["from"]) + moving.places[v["body"]][k] for v in drawn
    ]
    assert np.abs(np.array(starts) - skeleton.volumes(pose)[:, :3]).max() < 1e-9, "also of bodies fixed to others"


def test_bones_reach_from_joint_to_joint() -> None:
    bodies = Skeleton.read(PLANT).content["bodies"]
    found = bones(bodies)
    tibia = [v for v in found if v["body"] == "tibia_r"]
    ankle = next(b for b in bodies if b["name"] == "talus_r")["at_parent"][1]
    lowest = min(min(v["from"][1], v["to"][1]) for v in tibia)
    assert abs(lowest - ankle) < 0.02
    longer = [dict(b, at_parent=[0.0, 1.2 * ankle, 0.0]) if b["name"] == "talus_r" else b for b in bodies]
    stretched = [v for v in bones(longer) if v["body"] == "tibia_r"]
    assert abs(min(min(v["from"][1], v["to"][1]) for v in stretched) - 1.2 * ankle) < 0.02
    assert bones([]) == []


def test_drawing_is_made_from_the_tables() -> None:
    tools = str(Path(__file__).parents[2] / "tools")
    sys.path.insert(0, tools)
    try:
        from make_skeleton import drawing
    finally:
        sys.path.remove(tools)
    assert json.loads(json.dumps(drawing())) == Skeleton.read(PLANT).content


def test_sole_touches_the_platform_when_the_contact_does(braced: Landing) -> None:
    skeleton, result = Skeleton.read(PLANT), braced.result
    lowest = []
    normal = np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    for k in (0, int(np.argmax(result["plant.ground_force"]))):
        volumes = skeleton.volumes(skeleton.pose({c: float(result[f"plant.{c}"][k]) for c in skeleton.coordinates}))
        foot = volumes[[part == "sole" for part in skeleton.parts]]
        ends = np.vstack([foot[:, :3], foot[:, 3:6]]) - np.array([-0.2, 0.015, 0.35])
        lowest.append(float((ends @ normal - np.tile(foot[:, 6], 2)).min()))
    assert abs(lowest[0]) < 0.006  # the touching pose: its deepest facet lies in the plane
    assert -0.025 < lowest[1] < 0.0  # at 9 kN the sole is some millimetres deep


def picture(
    volumes: list[list[float]],
    colours: list[list[float]],
    scale: float = 100.0,
    box: np.ndarray = AWAY,
    turn: np.ndarray | None = None,
    cut: np.ndarray | None = None,
) -> np.ndarray:
    camera = Camera(X, Y, np.zeros(3), scale, 200, 160)
    return camera.picture(
        np.array(volumes),
        np.array(colours),
        box,
        np.eye(3) if turn is None else turn,
        np.array([0.6, 0.2, 0.6]),
        np.array([0.6, 0.6, 0.6]),
        cut,
    )


def drawn(image: np.ndarray) -> np.ndarray:
    """Pixels that are covered by half or more."""
    off = np.abs(image.astype(float) - 255 * PAPER).max(axis=2)
    return off > 0.5 * np.median(off[off > 6])


def test_silhouettes_are_those_of_geometry() -> None:
    ball = drawn(picture([[0.1, 0.2, 0.0, 0.1, 0.2, 0.0, 0.5, 0.5]], [[0.8, 0.3, 0.2]]))
    assert ball.sum() == pytest.approx(np.pi * 50**2, rel=0.02)
    rows, columns = np.nonzero(ball)
    assert (columns.mean(), rows.mean()) == pytest.approx((110 - 0.5, 60 - 0.5), abs=0.3)
    # a cone with round ends of 0.3 and 0.1 over 1.0: outline of two circles and their common tangents
    cone = drawn(picture([[-0.5, 0.0, 0.0, 0.5, 0.0, 0.0, 0.3, 0.1]], [[0.8, 0.3, 0.2]]))
    lean = np.arcsin(0.2)
    area = np.cos(lean) * (0.3 + 0.1) + (np.pi / 2 + lean) * 0.3**2 + (np.pi / 2 - lean) * 0.1**2
    assert cone.sum() == pytest.approx(1e4 * area, rel=0.02)
    assert np.array_equal(cone, drawn(picture([[0.5, 0.0, 0.0, -0.5, 0.0, 0.0, 0.1, 0.3]], [[0.8, 0.3, 0.2]])))


def test_the_nearer_volume_hides_the_other_and_the_box_is_tilted() -> None:
    red, blue = [0.9, 0.1, 0.1], [0.1, 0.1, 0.9]
    back, front = [0.0, 0.0, -0.5, 0.0, 0.0, -0.5, 0.3, 0.3], [0.0, 0.0, 0.5, 0.0, 0.0, 0.5, 0.3, 0.3]
    for order in ([back, front], [front, back]):
        image = picture(order, [red if v is back else blue for v in order])
        assert image[80, 100, 2] > 2 * image[80, 100, 0]
    tilt = np.radians(20.0)
    turn = np.array([[np.cos(tilt), np.sin(tilt), 0.0], [-np.sin(tilt), np.cos(tilt), 0.0], [0.0, 0.0, 1.0]])
    plank = drawn(picture([[9.0, 9.0, 0.0, 9.0, 9.0, 0.0, 0.1, 0.1]], [red], box=np.zeros(3), turn=turn))
    rows, columns = np.nonzero(plank)
    spread = np.linalg.eigh(np.cov(columns, -rows))[1][:, 1]
    assert np.degrees(np.arctan(spread[1] / spread[0])) == pytest.approx(20.0, abs=0.5)
    assert plank.sum() == pytest.approx(1.2 * 0.4 * 1e4, rel=0.02)
    for cut, share in (((1.0, 0.0, 0.0, 0.2), 0.8 / 1.2), ((-0.6, 0.8, 0.0, 0.0), 0.5), ((0.0, 0.0, 1.0, 0.1), 1.0)):
        left = drawn(
            picture([[9.0, 9.0, 0.0, 9.0, 9.0, 0.0, 0.1, 0.1]], [red], box=np.zeros(3), turn=turn, cut=np.array(cut))
        )
        assert left.sum() == pytest.approx(share * plank.sum(), rel=0.02)


def test_projection_agrees_with_the_picture() -> None:
    camera = Camera(Z, Y, np.array([0.3, 0.1, -0.2]), 90.0, 200, 160)
    ball = np.array([[0.0, 0.3, 0.1, 0.0, 0.3, 0.1, 0.05, 0.05]])
    image = camera.picture(ball, np.array([[0.1, 0.1, 0.1]]), AWAY, np.eye(3), np.full(3, 0.01), np.zeros(3))
    rows, columns = np.nonzero(drawn(image))
    assert camera.project(ball[0, :3]) == pytest.approx((columns.mean() + 0.5, rows.mean() + 0.5), abs=0.3)


def test_long_headings_take_three_lines_and_end_at_a_word(braced: Landing) -> None:
    title = "A landing whose name is as long as this on a slope of thirty degrees with a brace of a long name " * 4
    usual, long = Stage([braced], 20.0), Stage([replace(braced, title=title)] * 2, 20.0)
    assert usual.titles == [[braced.title]]
    for *first, last in long.titles:
        assert len(first) == 2
        assert last.endswith("…")
        assert title.startswith(f"{' '.join(first)} {last[:-1]} ")
    assert len(long.titles[0][0]) > len(long.titles[1][0])  # beside the clock
    assert [dot.get_marker() for *_, dot in long.charts[0].curves] == ["o", "s"], "the curves' dots differ in shape"
    assert long.height - Stage([braced] * 2, 20.0).height in (38, 40)
    word = lines_of("Einbeinlandung" * 9, 200.0, 10.0)
    assert len(word) == 1
    assert word[0].endswith("…")
    assert lines_of("Acme_Sport_Pro_2000_rigid_left_foot", 130.0, 10.0) == ["Acme_Sport_Pro_2000_", "rigid_left_foot"]
    assert lines_of("", 200.0, 10.0) == []
    assert lines_of("one two", 200.0, 10.0, most=1) == ["one two"]


@pytest.mark.parametrize("count", [1, 2])
def test_a_brace_has_one_colour(count: int, braced: Landing) -> None:
    """The arc of its moment was ochre beside a blue brace, which a report's landing to turn had blue."""
    stage = Stage([braced] * count, 20.0)
    for actor, view in ((panel.actor, panel) for panel in stage.panels if panel.arcs):
        worn = actor.colours[[part == "brace" for part in actor.skeleton.parts]]
        (arc,) = [line for _, signal, line, _ in view.arcs if "brace" in signal]
        assert (worn == to_rgb(arc.get_color())).all()
    looks = {f"{n}": SeriesLook(colour, "-", "o") for n, colour in enumerate(stage.colours)}
    told = _content([(name, MovingBodies.of(braced)) for name in looks], [0], looks)["landings"]
    assert [one["colour"] for one in told] == [actor.cuff for actor in stage.actors]


def test_a_film_says_what_its_chart_leaves_out(braced: Landing) -> None:
    values = braced.result.values.copy()
    values[0, braced.result.index["plant.ground_force_y"]] = 80_000.0
    deep = replace(braced, result=replace(braced.result, values=values))
    assert [t.get_text() for t in Stage([deep], 20.0).charts[2].axes.texts] == ["cut off: 80 kN in the first 5 ms"]
    assert not Stage([braced], 20.0).charts[2].axes.texts


def test_an_arrow_that_is_longer_than_drawn_is_hollow(braced: Landing) -> None:
    peak = float(braced.result.time[np.argmax(braced.result["plant.ground_force"])])
    values = braced.result.values.copy()
    for signal in ("plant.ground_force", "plant.ground_force_y"):
        values[0, braced.result.index[signal]] = 80_000.0
    values[0, braced.result.index["plant.in_contact"]] = 1.0
    stage = Stage([replace(braced, result=replace(braced.result, values=values))], 20.0)
    arrow, filled = stage.panels[-1].arrow, []
    for _ in stage.frames(np.array([0.0, peak])):
        filled.append(np.allclose(arrow.get_facecolor()[:3], to_rgb(GROUND)))
    assert filled == [False, True]
    said = [any("hollow" in t.get_text() for t in s.page.texts) for s in (stage, Stage([braced], 20.0))]
    assert said == [True, False]


def test_film_of_two_landings_in_step(braced: Landing, tmp_path: Path) -> None:
    short = replace(
        braced,
        label="short",
        result=replace(braced.result, time=braced.result.time[:41], values=braced.result.values[:41]),
    )
    target = tmp_path / "film.webp"
    count = animate([braced, short], target, slow=10.0)
    assert count == int(0.048 * 10 * RATE) + 1
    film = Image.open(target)
    assert film.n_frames == count
    durations = []
    for k in range(count):
        film.seek(k)
        film.load()
        durations.append(film.info["duration"])
    assert sum(durations) == pytest.approx(1e3 * ((count - 1) / RATE + HOLD))
    assert sum(durations[:-1]) == pytest.approx(10 * 48, abs=1e3 / RATE)
    assert target.stat().st_size < 1_000_000
    assert [p.name for p in tmp_path.iterdir()] == ["film.webp"]


def test_pictures_move_and_show_force_and_moment(braced: Landing) -> None:
    stage = Stage([braced], 30.0)
    peak = float(braced.result.time[np.argmax(braced.result["plant.ground_force"])])
    first, last = stage.frames(np.array([0.0, peak]))
    assert first.shape == last.shape == (stage.height, stage.width, 3)
    close = stage.panels[-1]
    inside = (slice(close.top, close.top + close.tall), slice(close.left, close.left + close.view.width))
    assert (np.abs(first[inside].astype(int) - last[inside]).max(axis=2) > 20).mean() > 0.05
    arrow = 255 * np.array(to_rgb(GROUND))
    dark = [(np.abs(image[inside].astype(int) - arrow).max(axis=2) < 24).sum() for image in (first, last)]
    assert dark[1] > dark[0] + 400  # 9 kN against none
    force = np.array(
        [float(np.interp(peak, braced.result.time, braced.result[f"plant.ground_force_{k}"])) for k in "xyz"]
    )
    outline = close.arrow.get_xy()
    assert np.linalg.norm(outline[3] - 0.5 * (outline[0] + outline[6])) == pytest.approx(
        close.reach * np.hypot(force[1], force[2]), rel=0.01
    )


def test_without_a_brace_no_brace_is_drawn(braced: Landing) -> None:
    result = braced.result
    kept = [
        k for k, name in enumerate(result.names) if not (name.startswith("plant.brace_") and name.endswith("_torque"))
    ]
    names, units = (tuple(values[k] for k in kept) for values in (result.names, result.units))
    bare = replace(braced, result=replace(result, names=names, units=units, values=result.values[:, kept]))
    with_one, without = (next(Stage([run], 30.0).frames(np.array([0.02]))) for run in (braced, bare))
    worn = [
        (
            (i[..., 0] > 80)
            & (np.abs(i / np.maximum(i[..., :1], 1) - np.array(to_rgb(BRACE)) / to_rgb(BRACE)[0]) < 0.15).all(-1)
        ).sum()
        for i in (with_one, without)
    ]
    assert worn[0] > 2000
    assert worn[1] < 200


def test_what_cannot_be_drawn_says_why(braced: Landing, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"film.avi: ends in .avi"):
        animate([braced], tmp_path / "film.avi")
    with pytest.raises(InputError, match="7 landings: up to 6"):
        animate([braced] * 7, tmp_path / "film.webp")
    with pytest.raises(InputError, match="slowed 0 times"):
        animate([braced], tmp_path / "film.webp", slow=0.0)
    plain = load_scenario("incline30").with_master(stop="2 ms").run()
    with pytest.raises(InputError, match=r"old: its record has no pelvis_tx, .* run it again"):
        animate([replace(braced, label="old", result=plain)], tmp_path / "film.webp")
    with pytest.raises(InputError, match="cannot be drawn"):
        Skeleton.read(fmu_path("brace_bushing", Path.cwd(), "brace"))
    (tmp_path / "file").write_text("")
    with pytest.raises(EnvironmentProblem, match="cannot be written"):
        animate([braced], tmp_path / "file" / "film.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_video_without_its_extra_says_how(braced: Landing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(EnvironmentProblem, match=r"\[video\]"):
        animate([braced], tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_video(braced: Landing, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    assert animate([braced], tmp_path / "film.mp4", slow=5.0) == 7
    count, seconds = ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))
    assert count == 7 + round(HOLD * RATE)
    assert seconds == pytest.approx(count / RATE, abs=0.05)
