"""The paper's Figures 1C, 4 and 5 by one command, with the published figures beside ours."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.figures.paper import LAWS
from sprain_cosim.figures.style import Form
from sprain_cosim.literature import PASSIVE
from sprain_cosim.validation.paper_figures import law_torques, repeat_paper, write_paper_figures


@pytest.mark.parametrize("name", LAWS)
def test_the_laws_of_figure_1c_are_measured_on_the_fmus(name: str) -> None:
    """The published polynomial of the angle times f, from the plant's parameters and the bushing's outputs."""
    for axis, (angle, torque) in law_torques(name, LAWS[name]).items():
        a, b, c = PASSIVE[axis]
        t = LAWS[name] * angle
        np.testing.assert_allclose(torque, a * t + b * t**2 + c * t**3, rtol=1e-9, atol=1e-9)


def test_wrong_requests_are_answered_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--trials 5: the paper's levels need 20 landings or more"):
        repeat_paper(tmp_path / "x", trials=5)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: is a file; name a folder"):
        repeat_paper(tmp_path / "file")
    assert not (tmp_path / "x").exists()


@pytest.mark.long
def test_the_figures_of_the_paper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What ran is continued, not run again; each caption says how far ours is from the published figures."""
    monkeypatch.delenv("SPRAIN_REFERENCE", raising=False)
    folders = repeat_paper(tmp_path, trials=40, workers=2)
    assert [f.path.name for f in folders] == [*(f"study{n}" for n in range(1, 7)), "amv6"]
    before = [(f.path / "trials.csv").stat().st_mtime_ns for f in folders]
    assert [(f.path / "trials.csv").stat().st_mtime_ns for f in repeat_paper(tmp_path, trials=40)] == before
    written = write_paper_figures(folders, tmp_path, ["pdf"], Form())
    assert [p.name for p in written] == ["figure_1c.pdf", "figure_4.pdf", "figure_5.pdf", "captions.txt"]
    law, distributions, search = written[-1].read_text("utf-8").strip().split("\n\n")
    assert all("Yoder, Petrella & Farrokhi 2021" in caption for caption in (law, distributions, search))
    assert "n = " not in law
    assert re.search(
        r"\d+ of the 18 published levels lie within our 95 % intervals; the largest gap is [+−]\d", distributions
    )
    assert "Missing here: the authors' own trials (SPRAIN_REFERENCE names their folder)" in distributions
    gaps = [float(gap.replace("−", "-")) for gap in re.findall(r"([+−]\d\.\d+)° at", search)]
    assert len(gaps) == 3
    assert max(map(abs, gaps)) < 0.6, "the search is the same whatever the sample"
