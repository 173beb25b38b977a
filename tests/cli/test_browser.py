"""The report in a headless Chromium: it draws, complains about nothing, and fits a phone. `make browser` installs one
on Debian and runs these tests."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from sprain_cosim.folders.read import read_folders
from sprain_cosim.report import page as report

CHROMIUM = next((p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None)
REQUIRED = os.environ.get("SPRAIN_BROWSER") == "required"
pytestmark = pytest.mark.skipif(
    CHROMIUM is None and not REQUIRED,
    reason="no Chromium on this machine; `make browser` installs it and runs these tests",
)

# shows the report in a frame of a width that a phone or a desk has, and says what it finds there
LOOK = """<!doctype html><body style="margin:0"><iframe src="r.html" style="width:%dpx;height:3000px;border:0"></iframe><pre id="found"></pre><script>
const frame = document.querySelector("iframe");
frame.onload = () => setTimeout(() => {
  const page = frame.contentDocument, box = page.querySelector(".explore svg[role=img]"), at = box.getBoundingClientRect(), out = {};
  box.dispatchEvent(new frame.contentWindow.PointerEvent("pointermove", {clientX: at.left + 0.6 * at.width, clientY: at.top + 50, bubbles: true}));
  out.readout = page.querySelector(".readout").textContent;
  out.series = page.querySelectorAll(".explore path.series").length;
  out.pictures = [...page.querySelectorAll("figure img")].map((i) => i.naturalWidth);
  out.overflow = page.documentElement.scrollWidth - frame.clientWidth;
  const tick = page.querySelector(".choices input");
  tick.click();
  out.after = page.querySelectorAll(".explore path.series").length;
  tick.click();
  const select = page.querySelector(".explore select");
  select.value = "1"; select.dispatchEvent(new frame.contentWindow.Event("change"));
  out.cleared = page.querySelector(".readout").textContent;
  out.other = [...page.querySelectorAll(".explore text")].map((t) => t.textContent).join("|");
  const views = [...page.querySelectorAll(".view canvas")], shown = () => views.map((c) => c.toDataURL());
  const pause = () => new Promise((done) => setTimeout(done, 60)), type = (e, kind, name, options) => e.dispatchEvent(new frame.contentWindow[kind](name, {bubbles: true, ...options}));
  (async () => {
    out.views = views.length;
    out.frame = page.querySelector(".frame").hidden;
    const steps = [shown()], last = () => steps[steps.length - 1], fresh = () => shown().filter((picture, k) => picture !== last()[k]).length;
    const drawn = async () => { for (let k = 0; k < 25 && fresh() < 2; k++) await pause(); steps.push(shown()); };
    ["pointerdown", "pointermove", "pointerup"].forEach((name, k) => type(views[0], "PointerEvent", name, {pointerId: 1, clientX: 60 + 30 * Math.min(k, 1), clientY: 60}));
    await drawn();
    const slider = page.querySelector("input[type=range]");
    slider.value = "30"; type(slider, "Event", "input");
    await drawn();
    type(views[0], "KeyboardEvent", "keydown", {key: "ArrowUp"});
    await drawn();
    page.querySelectorAll(".bar button")[4].click();
    await drawn();
    out.changed = steps.slice(1).map((now, k) => now.filter((picture, n) => picture !== steps[k][n]).length);
    out.now = page.querySelector(".figures-now").textContent;
    const pixels = document.createElement("canvas").getContext("2d");
    pixels.drawImage(views[0], 0, 0, 300, 150);
    out.colours = new Set(Array.from(new Uint32Array(pixels.getImageData(0, 0, 300, 150).data.buffer))).size;
    out.small = [...page.querySelectorAll("button, select, .stage input")].filter((e) => e.getBoundingClientRect().right > frame.clientWidth).length;
    out.reached = [...page.querySelectorAll("canvas, .explore svg[role=img], .figures figure")].every((e) => e.tabIndex === 0);
    out.cells = [...page.querySelectorAll("td")].filter((e) => e.textContent.trim() && e.getBoundingClientRect().right > frame.clientWidth + 1 && !e.closest("details:not([open])")).length;
    document.getElementById("found").textContent = JSON.stringify(out);
  })();
}, 300);
</script></body>"""


def browse(page: Path, *options: str) -> tuple[str, list[str]]:
    """What Chromium prints, and its console's messages."""
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage", f"--user-data-dir={page.parent / 'profile'}",
        "--hide-scrollbars", "--allow-file-access-from-files", "--enable-logging=stderr", "--virtual-time-budget=6000", *options, page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout, re.findall(r":CONSOLE[:(].*", done.stderr)


def look(folder: Path, width: int) -> tuple[dict, list[str]]:
    (folder / "look.html").write_text(LOOK % width, "utf-8")
    dom, console = browse(folder / "look.html", "--dump-dom")
    return json.loads(unescape(re.search(r'<pre id="found">(.*?)</pre>', dom, re.S)[1])), console  # type: ignore[index]


@pytest.fixture(scope="module")
def page(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two studies, a landing and a comparison in one report."""
    folder = tmp_path_factory.mktemp("browser")
    report.write_report(read_folders([results / n for n in ("study", "touching", "run")]), folder / "r.html")
    return folder


def test_the_console_is_read(tmp_path: Path) -> None:
    (tmp_path / "r.html").write_text("<script>undefinedFunction()</script>")
    assert any("undefinedFunction" in message for message in browse(tmp_path / "r.html", "--dump-dom")[1])


@pytest.mark.parametrize("width", [390, 1280])
def test_it_draws_and_fits_without_a_complaint(page: Path, width: int) -> None:
    found, console = look(page, width)
    assert console == []
    assert len(found["pictures"]) >= 9
    assert min(found["pictures"]) > 200, "every figure is a picture that the browser can show"
    assert found["overflow"] <= 0, "nothing sticks out to the right"
    assert found["series"] == 3, "two distributions and one landing"
    assert found["after"] == 2, "a series can be switched off"
    assert re.match(r"At \d+\.\d+ °: \d+\.\d % of published pose", found["readout"])
    assert "peak inversion from neutral [deg]" in found["other"]
    assert found["views"] == 2
    assert found["frame"], "the picture for browsers without WebGL makes room for the landing"
    assert found["changed"] == [2, 2, 2, 2], (
        "dragging, the time, the keyboard and a button each show both landings anew"
    )
    assert found["colours"] > 100, "a lit body, not an empty canvas"
    assert found["now"].startswith("subtalar ")
    assert found["reached"], "whatever can be read off can be reached by keyboard"
    assert found["small"] == 0 and found["cells"] == 0, "no control and no column lies outside"
    assert found["cleared"].startswith("Point at the curves"), "what was read off before is of other curves"


@pytest.mark.parametrize("width", [500, 1280])
def test_a_screenshot_shows_something(page: Path, width: int, tmp_path: Path) -> None:
    browse(page / "r.html", f"--window-size={width},1600", f"--screenshot={tmp_path / 'shot.png'}")
    picture = imread(tmp_path / "shot.png")[..., :3]
    assert picture.shape[1] == width
    assert 0.02 < np.mean(picture.min(axis=2) < 0.9) < 0.6, "ink on paper, neither empty nor black"


def test_it_prints_on_a_few_sheets(results: Path, tmp_path: Path) -> None:
    """The page of a comparison."""
    report.write_report(read_folders([results / "compared"]), tmp_path / "r.html")
    browse(tmp_path / "r.html", "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'r.pdf'}")
    printed = (tmp_path / "r.pdf").read_bytes()
    assert printed.startswith(b"%PDF") and len(printed) > 50_000
    assert 3 <= len(re.findall(rb"/Type\s*/Page[^s]", printed)) <= 6


def test_without_webgl_the_frame_of_the_film_stays(page: Path) -> None:
    off = ("--disable-3d-apis", "--dump-dom")
    dom, console = browse(page / "r.html", *off)
    assert re.search(r'<img class="frame" alt="[^"]+" src="data:image/webp', dom)
    assert 'data-flat="no WebGL"' in dom and "<canvas" not in dom
    assert [line for line in console if "WebGL" not in line] == []
