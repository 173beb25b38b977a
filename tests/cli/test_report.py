"""report: one file, complete without a network, everything from the folders escaped."""

from __future__ import annotations

import json
import re
import shutil
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd

from sprain_cosim.folders.read import read_folder, read_folders
from sprain_cosim.report import page as report

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
    for word in ("inside the floor", "ten body weights", "One subject", "No injury threshold", "The brace is an idea"):
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
    assert head["sha256"]["brace"] in page.sections["provenance"]
    assert {"landing", "moment_angle", "phase", "sharing"} <= figures(page)
    _, page = made(results / "amv")
    assert "The method's own check of slopes, curvature and order says" in page.sections["verdict"]
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
    assert f"{best} lowered the peak of supination most of all: by {-change[best]:.1f}°" in verdict
    assert "change against none" in page.sections["numbers"]
    assert "no brace" in page.sections["numbers"]
    assert {"landing", "sharing"} <= figures(page)


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
    assert text.count("</script>") == 2
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
