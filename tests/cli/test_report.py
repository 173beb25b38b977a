"""report: one file, complete without a network, everything from the folders escaped."""

from __future__ import annotations

import base64
import io
import itertools
import json
import re
import shutil
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
import pytest

from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.figures.style import ANATOMY, SERIES, UNBRACED, letters
from sprain_cosim.folders.read import read_folder, read_folders
from sprain_cosim.report import page as report
from sprain_cosim.report.html import breakable

from .test_run import call


class Page(HTMLParser):
    """Headings, texts of sections, tags with their attributes."""

    VOID = ("meta", "link", "img", "br", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.sections: dict[str, str] = {}
        self.section = ""
        self.feed(text)
        assert not self.open, "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs)["id"] or ""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "script" not in self.open and "style" not in self.open:
            self.sections[self.section] = self.sections.get(self.section, "") + " " + " ".join(data.split())

    def charts(self, text: str) -> list[dict]:
        return json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])  # type: ignore[index]


@cache
def made(*given: Path) -> tuple[str, Page]:
    text = report.report_page(read_folders(given))
    return text, Page(text)


def figures(page: Page) -> set[str]:
    return {(a["id"] or "").removeprefix("figure-") for tag, a in page.tags if tag == "figure" and "id" in a}


def test_a_study(results: Path) -> None:
    text, page = made(results / "study")
    summary = json.loads((results / "study" / "summary.json").read_text())
    level = summary["responses"]["peak_subtalar_angle_deg"]["percentiles"]
    verdict = " ".join(page.sections["verdict"].split())
    assert f"{level['50']['value']:.1f}°" in verdict
    assert f"between {level['5']['value']:.1f} and {level['95']['value']:.1f}°" in verdict
    assert "Probability that inversion exceeds the injury range" in verdict
    assert "95 % interval" in verdict
    assert "No landing failed" in verdict
    assert {"cdf", "tornado", "fan", "phase", "sharing", "torque_angle"} <= figures(page)
    assert "lognormal: mean 0.30 m, sd 0.05 m" in page.sections["inputs"]
    manifest = json.loads((results / "study" / "manifest.json").read_text())
    for word in (manifest["fmus"]["plant"]["sha256"], str(manifest["seed"]), manifest["platform"]):
        assert word in page.sections["provenance"]
    assert "Initial pose published" in page.sections[""]
    for word in ("inside the floor", "body weights", "One subject", "No injury threshold", "The brace is an idea"):
        assert word in page.sections["limits"]
    trials = pd.read_csv(results / "study" / "trials.csv")
    first = page.charts(text)[0]["options"][0]
    np.testing.assert_allclose(first["series"][0]["x"], np.sort(trials["peak_subtalar_angle_deg"]), rtol=1e-3)
    assert first["series"][0]["marks"] == [[23.2, 0.05], [29.7, 0.5], [34.0, 0.95]]


def test_a_landing_a_search_and_two_poses(results: Path) -> None:
    _, page = made(results / "run")
    head = json.loads((results / "run" / "summary.json").read_text())
    assert f"{head['metrics']['peak_subtalar_angle_deg']:.1f}°" in page.sections["verdict"]
    assert "the brace bore" in page.sections["verdict"]
    assert f"(± {head['coupling_doubt_deg']:.2g}° by the communication step)" in page.sections["verdict"]
    assert head["sha256"]["brace"] in page.sections["provenance"]
    assert {"landing", "moment_angle", "phase", "sharing"} <= figures(page)
    _, page = made(results / "amv")
    assert "The method's own test of slopes, curvature and the order of the levels says" in page.sections["verdict"]
    assert "importance" in page.sections["sensitivities"]
    _, page = made(results / "study", results / "touching", results / "amv")
    assert {"poses", "amv", "percentiles"} <= figures(page)
    assert "Initial pose published and touching" in page.sections[""]
    assert page.sections["verdict"].count("landings the peak of supination") == 2


def test_a_grid_is_no_sample(tmp_path: Path) -> None:
    head = {
        "title": "g",
        "method": "grid",
        "n_requested": 6,
        "n_completed": 6,
        "n_failed": 0,
        "initial_pose": "touching",
        "study": "g",
        "responses": {},
    }
    (tmp_path / "summary.json").write_text(json.dumps(head))
    grid = '"controller.coactivation" = [0, 1, 2]\n"brace.angle_scale" = [1, 2]'
    (tmp_path / "study.toml").write_text(f'scenario = "x"\n[grid]\n{grid}\n[study]\nmethod = "grid"')
    points = [(a, b) for a in (0.0, 1.0, 2.0) for b in (1.0, 2.0)]
    table = pd.DataFrame(points, columns=["controller.coactivation", "brace.angle_scale"])
    table = table.assign(trial=range(6), status="completed", message="", peak_subtalar_angle_deg=range(30, 36))
    table.to_csv(tmp_path / "trials.csv", index=False)
    _, page = made(tmp_path)
    assert figures(page) == {"grid", "torque_angle"}
    assert "At 6 points of a grid" in page.sections["verdict"]
    assert "between 30.0 and 35.0°" in page.sections["verdict"]
    assert "nine of ten" not in page.sections["verdict"]
    assert "explore" not in page.sections


def test_a_comparison(results: Path) -> None:
    _, page = made(results / "compared")
    data = json.loads((results / "compared" / "compare.json").read_text())
    change = {
        n: b["difference_to_none"]["peak_subtalar_angle_deg"]["value"] for n, b in data["braces"].items() if n != "none"
    }
    best = min(change, key=lambda n: change[n])
    verdict = " ".join(page.sections["verdict"].split())
    assert f"With {best} the ankle rolls least: {-change[best]:.1f}° less than without a brace" in verdict
    assert "change against none" in page.sections["numbers"]
    assert "no brace" in page.sections["numbers"]
    assert {"landing", "sharing", "paired"} <= figures(page)
    assert "One landing: no interval." in verdict
    for brace in data["braces"].values():
        assert f"step ± {brace['coupling_doubt_deg']:.2g}" in page.sections["numbers"].replace("\u00a0", " ")
    assert "no brace" in page.sections["numbers"]
    one, none = (data["braces"][name]["injury_shapes"] for name in (best, "none"))
    ends = sorted(100 * (one[law] - none[law]) for law in one)[::2]
    shown = " … ".join(f"{end:.1f}".replace("-", "−") for end in ends)
    assert f"threshold's shape {shown}" in page.sections["numbers"].replace("\u00a0", " ")
    given = tables(page)["numbers.csv"].set_index(["result", "statistic"])
    line = given.loc[(best, "difference to none, thresholds of other shapes")]
    np.testing.assert_allclose([100 * line["ci_low"], 100 * line["ci_high"]], ends, rtol=1e-4)


def test_warnings_stand_in_the_verdict(results: Path, tmp_path: Path) -> None:
    """A vendor who gets the page alone read a number that `run` had warned of, in silence."""
    shutil.copytree(results / "compared", tmp_path / "compared")
    file = tmp_path / "compared" / "compare.json"
    data = json.loads(file.read_text())
    name = next(n for n in data["braces"] if n != "none")
    data["braces"][name]["warnings"] = ["the device left its range; are its units right?"]
    file.write_text(json.dumps(data))
    run = tmp_path / "compared" / name / "summary.json"
    said = {
        "warning": "coupling not converged at <0.5 ms>",
        "warnings": ["assumed N.m", "x is dropped"],
        "dropped": ["x"],
    }
    run.write_text(json.dumps(json.loads(run.read_text()) | said))
    text, page = made(tmp_path / "compared")
    assert f"Warning: {name}: the device left its range; are its units right?" in page.sections["verdict"]
    assert 'class="verdict warn"' in text
    text, page = made(tmp_path / "compared" / name)
    assert "Warning: coupling not converged at <0.5 ms>." in page.sections["verdict"]
    assert "Warning: assumed N.m." in page.sections["verdict"]
    assert "is dropped" not in page.sections["verdict"], "it stands among the inputs"
    assert 'class="verdict warn"' in text
    assert "step ±" in page.sections["numbers"]


def test_what_all_results_share_is_said_once(results: Path) -> None:
    _, page = made(results / "compared")
    assert page.sections["provenance"].count("reflex_controller.fmu") == 1
    assert page.sections["inputs"].count("plant.platform_incline") == 1


def scene(text: str) -> dict:
    return json.loads(re.search(r'id="scene">(.*?)</script>', text, re.S)[1])  # type: ignore[index]


def test_the_landing_to_turn_is_the_landing(results: Path) -> None:
    text, page = made(results / "compared")
    found = scene(text)
    assert [one["name"] for one in found["landings"]] == ["no brace", "soft", "stiff"]
    assert found["shown"][0] == 0
    for one, name in zip(found["landings"], ("none", "soft", "stiff"), strict=True):
        record = Result.read_csv(results / "compared" / name / "signals.csv")
        table = np.frombuffer(base64.b64decode(one["data"]), "<f4").reshape(one["steps"], -1)
        degrees = np.degrees(
            np.interp(one["step"] * np.arange(one["steps"]), record.time, record["plant.subtalar_angle"])
        )
        np.testing.assert_allclose(table[:, -3], degrees, atol=1e-4)
        assert {group for _, group, _, _ in one["shapes"]} == {"far", "glass", "bone", "sole"} | (
            {"cuff"} if one["braced"] else set()
        )
    (frame,) = [a for tag, a in page.tags if tag == "img" and a.get("class") == "frame"]
    assert "no brace: subtalar angle" in (frame["alt"] or "")


def test_a_study_shows_one_landing_that_gives_its_record(results: Path, tmp_path: Path) -> None:
    text, page = made(results / "study")
    trials = pd.read_csv(results / "study" / "trials.csv").set_index("trial")
    (one,) = scene(text)["landings"]
    number = int(re.search(r"trial (\d+)", one["label"])[1])  # type: ignore[index]
    table = np.frombuffer(base64.b64decode(one["data"]), "<f4").reshape(one["steps"], -1)
    assert abs(table[:, -3].max() - trials.loc[number, "peak_subtalar_angle_deg"]) < 0.05, "the record has a finer grid"
    assert 'id="scene"' not in report.report_page(read_folders([results / "study"]), "none")
    with pytest.raises(InputError, match="--trial best: must be a number, worst, a percentile"):
        report.report_page(read_folders([results / "study"]), "best")
    shutil.copytree(results / "study", tmp_path / "s")
    (tmp_path / "s" / "ledger.sqlite").unlink()
    _, page = made(tmp_path / "s")
    assert "There is no landing to turn here: s: has no ledger.sqlite" in page.sections["verdict"]
    assert "sprain-cosim trial" not in page.sections["verdict"], "it would end in an error"
    _, page = made(tmp_path / "s", results / "study")
    assert "Not every landing can be turned: s: has no ledger.sqlite" in page.sections["verdict"]


def tables(page: Page) -> dict[str | None, pd.DataFrame]:
    """{name: content} of what can be taken along."""
    data = {a["download"]: a["href"] for tag, a in page.tags if tag == "a" and "download" in a}
    return {
        name: pd.read_csv(io.BytesIO(base64.b64decode((href or "").partition("base64,")[2])))
        for name, href in data.items()
    }


def test_the_numbers_can_be_taken_along(results: Path) -> None:
    _, page = made(results / "study")
    trials = pd.read_csv(results / "study" / "trials.csv")
    landings = tables(page)["landings.csv"]
    np.testing.assert_allclose(landings["peak_subtalar_angle_deg"], trials["peak_subtalar_angle_deg"], rtol=1e-5)
    assert "plant.drop_height [m]" in landings
    numbers = tables(page)["numbers.csv"].set_index(["response", "statistic"])
    level = json.loads((results / "study" / "summary.json").read_text())["responses"]["peak_subtalar_angle_deg"]
    for column, key in (("value", "value"), ("ci_low", "ci_low"), ("ci_high", "ci_high")):
        found = numbers.loc[("peak_subtalar_angle_deg", "50 %"), column]
        assert abs(found - level["percentiles"]["50"][key]) < 1e-3


def test_a_chart_names_the_injury_range_where_it_is_drawn(results: Path) -> None:
    for name in ("study", "touching"):
        text, _page = made(results / name)
        reached = pd.read_csv(results / name / "trials.csv")["peak_inversion_from_neutral_deg"]
        assert ("Grey: injury range" in text) == (reached.max() > 35 - 6 and reached.min() < 35 + 6)


def test_importance_and_design_point_stand_under_their_own_names(results: Path, tmp_path: Path) -> None:
    """The importance stood under "design point", as if the foot fell from 0.17 m."""
    shutil.copytree(results / "amv", tmp_path / "form")
    file = tmp_path / "form" / "summary.json"
    data = json.loads(file.read_text())
    levels = data.pop("amv")
    data["form"] = {
        **{key: levels[key] for key in ("evaluations_requested", "evaluations_executed", "status", "reasons")},
        "response": "peak_inversion_from_neutral_deg",
        "beta": 2.04,
        "probability": 0.0207,
        "threshold": {"mean": 35.0, "distribution": "35 ± 6 deg"},
        "importance": {"plant.drop_height": 0.17, "plant.talocrural_angle_at_contact": 0.08, "threshold": -0.96},
        "design_point": {
            "plant.drop_height": 0.313,
            "plant.talocrural_angle_at_contact": -0.5772257,
            "threshold": 23.168,
        },
    }
    file.write_text(json.dumps(data))
    text, page = made(tmp_path / "form")
    for importance, point in (("+0.17", "0.313 m"), ("+0.08", "−33.073 deg"), ("−0.96", "23.168 deg")):
        cells = f'<td data-head="importance (unit vector)">{importance}</td><td data-head="design point">{point}</td>'
        assert cells in text
    assert "raises the response" not in page.sections["sensitivities"]


def test_a_page_for_readers_who_hear_or_type_it(results: Path) -> None:
    """Every picture has words, headings go down by one, ids are unique, the language is stated, tables have heads."""
    for folders in (("study",), ("compared",), ("run", "amv")):
        _text, page = made(*(results / n for n in folders))
        assert all(len(a.get("alt") or "") > 10 for tag, a in page.tags if tag == "img")
        levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
        assert levels[0] == 1 and levels.count(1) == 1
        assert all(b - a <= 1 for a, b in itertools.pairwise(levels))
        ids = [a["id"] for _, a in page.tags if "id" in a]
        assert len(ids) == len(set(ids))
        assert dict(page.tags)["html"] == {"lang": "en"}
        assert {"main", "header", "nav"} <= {tag for tag, _ in page.tags}
        anchors = [a["href"] or "" for tag, a in page.tags if tag == "a" and (a["href"] or "").startswith("#")]
        assert {a[1:] for a in anchors} <= set(ids)


def test_text_can_be_read_on_its_ground() -> None:
    """4.5 to 1 in daylight and in the dark, as WCAG 2.2 counts contrast."""
    css = (Path(report.__file__).parent / "style.css").read_text("utf-8")
    rules = re.findall(r":root \{(.*?)\}", css, re.S)
    assert len(rules) == 2
    colours: dict[str, str] = {}
    for rule in rules:
        colours |= dict(re.findall(r"--(\w+): (#[0-9a-f]+)", rule))
        for ink in ("ink", "muted", "accent", "pass", "gap", "fail"):
            for ground in ("paper", "soft"):
                assert contrast(colours[ink], colours[ground]) >= 4.5, (ink, ground)
    (ground,) = re.findall(r"\.explore \{ --paper: (#\w+); --ink: (#\w+); --muted: (#\w+)", css)
    assert contrast(ground[1], ground[0]) >= 4.5, "curves have a light ground in the dark"
    assert contrast(ground[2], ground[0]) >= 4.5
    assert contrast(UNBRACED, ground[0]) >= 4.5
    for colour in (*SERIES, UNBRACED, ANATOMY):
        assert contrast(letters(colour), "#ffffff") >= 4.5, colour


def contrast(one: str, other: str) -> float:
    def light(colour: str) -> float:
        digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
        parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((light(one), light(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_nothing_is_fetched(results: Path) -> None:
    text, page = made(results / "study")
    for tag, attributes in page.tags:
        for key in ("src", "href"):
            assert (attributes.get(key) or "data:").startswith(("data:", "#")), (tag, attributes)
    assert not re.search(r"url\(|@import|fetch\(|XMLHttpRequest", text)


def test_where_it_goes(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "run", tmp_path / "a")
    assert call("report", str(tmp_path / "a")).returncode == 0
    assert (tmp_path / "a" / "report.html").is_file()
    assert call("report", str(tmp_path / "a"), "--out", str(tmp_path / "new" / "b")).returncode == 0
    assert (tmp_path / "new" / "b" / "report.html").read_bytes() == (tmp_path / "a" / "report.html").read_bytes(), (
        "the same folder, the same bytes"
    )


def test_texts_from_the_folder_are_escaped(results: Path, tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=alert(1)> & $\\frac{"
    for kind in ("study", "run", "compared"):
        shutil.copytree(results / kind, tmp_path / kind)
        for path in (tmp_path / kind).rglob("*.json"):
            content = path.read_text("utf-8")
            data = json.loads(content)
            for key in ("title", "study", "scenario", "command", "platform", "message"):
                if key in data:
                    data[key] = evil
            if "fmus" in data:
                data["fmus"] = {evil: data["fmus"].get("plant")}
            if "failures" in data:
                data |= {"failures": {evil: 1}, "n_failed": 1}
            path.write_text(json.dumps(data), "utf-8")
    trials = tmp_path / "study" / "trials.csv"
    table = pd.read_csv(trials)
    table = table.astype({"message": object})
    table.loc[3, ["status", "message"]] = ["failed", evil]
    table.to_csv(trials, index=False)
    text, page = made(*(tmp_path / kind for kind in ("study", "run", "compared")))
    assert not [a for tag, a in page.tags if "onerror" in a or a.get("src") == "x"]
    assert text.count("</script>") == 4, "data, scene and the two that read them"
    assert "onerror" in page.sections["verdict"], "shown as text"
    assert "Failed landings" in page.sections["numbers"]


def test_failed_landings_are_told(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "study", tmp_path / "s")
    table = pd.read_csv(tmp_path / "s" / "trials.csv")
    table = table.astype({"message": object})
    table.loc[[2, 5], ["status", "message"]] = ["crashed", "brace: the strap broke"]
    table.to_csv(tmp_path / "s" / "trials.csv", index=False)
    head = json.loads((tmp_path / "s" / "summary.json").read_text())
    head |= {"n_failed": 2, "n_completed": len(table) - 2, "failures": {"crashed": 2}}
    (tmp_path / "s" / "summary.json").write_text(json.dumps(head))
    _, page = made(tmp_path / "s")
    assert f"2 of {len(table)} landings failed" in page.sections["verdict"]
    assert page.sections["numbers"].count("the strap broke") == 2


def test_a_thousand_trials_in_ten_seconds_and_five_megabytes(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "study", tmp_path / "s")
    table = pd.read_csv(tmp_path / "s" / "trials.csv")
    table = pd.concat([table] * 42, ignore_index=True).iloc[:1000]
    table["trial"] = range(1000)
    table.to_csv(tmp_path / "s" / "trials.csv", index=False)
    for trial in range(24, 100):
        shutil.copy(
            tmp_path / "s" / "trajectories" / f"{trial % 24:06d}.record",
            tmp_path / "s" / "trajectories" / f"{trial:06d}.record",
        )
    head = json.loads((tmp_path / "s" / "summary.json").read_text())
    head["trajectories"]["first"] = 100
    (tmp_path / "s" / "summary.json").write_text(json.dumps(head))
    began = process_time()
    target = report.write_report([read_folder(tmp_path / "s")], tmp_path / "r.html")
    assert process_time() - began < 10
    assert target.stat().st_size < 5e6


def test_long_words_of_a_table_may_break_and_nothing_else_changes() -> None:
    assert breakable("P(injury) [%] <b>") == "P(injury) [%] &lt;b&gt;"
    word = "Einbeinlandungsversuchsreihe<"
    assert breakable(f"a {word}") == "a Einbeinlandu<wbr>ngsversuchsr<wbr>eihe&lt;"
