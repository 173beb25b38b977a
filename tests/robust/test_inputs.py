"""The table of inputs that a user brings: what is wrong in it is named with the file's own row and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError

HEADER = "plant.drop_height [m],brace.angle_scale"
GOOD = f"{HEADER}\n0.30,1.5\n0.35,2.0\n0.25,1.2\n"
WRONG = {  # name: (text, words of the message)
    "one cell more": (f"{HEADER}\n0.30,1.5,9\n0.35,2.0,9\n", r"row 2: 3 cells, the header has 2\n?.*row 3: 3 cells"),
    "one cell less": (f"{HEADER}\n0.30,1.5\n0.35\n", "row 3: 1 cells, the header has 2"),
    "blank lines": (f"{HEADER}\n0.30,1.5\n\n\n0.25,abc\n", "row 5: .*brace.angle_scale.*abc"),
    "semicolons": (GOOD.replace(",", ";"), "separated by semicolons; save it with commas"),
    "tabs": (GOOD.replace(",", "\t"), "separated by tabs"),
    "semicolons below": (f"{HEADER}\n0.30;1.5\n", "row 2: 1 cells, .* separated by semicolons"),
    "decimal commas": (f"{HEADER}\n0,30,1,5\n", "row 2: 4 cells, .* decimal commas; write points"),
    "quoted decimal commas": (
        f'{HEADER}\n"0,30","1,5"\n',
        r"row 2: plant.drop_height \[m\] = '0,30': has a decimal comma",
    ),
    "a column twice": (
        f"{HEADER},brace.angle_scale\n0.3,1,2\n",
        r"column 3 'brace.angle_scale': given twice, also as column 2",
    ),
    "twice in other units": (
        f"{HEADER},plant.drop_height [cm]\n0.3,1,35\n",
        r"column 3 .*plant.drop_height is given twice",
    ),
    "an empty cell": (f"{HEADER}\n0.30,\n", "row 2: brace.angle_scale: the cell is empty"),
    "no rows": (f"{HEADER}\n\n", "has no rows"),
    "nothing": ("", "is empty"),
    "not text": (b"\xff\xfe\x00", "is not UTF-8"),
    "a name nobody has": ("plant.drop_heigth [m]\n0.3\n", "did you mean drop_height"),
    "no component": ("drop_height [m]\n0.3\n", r"column 1 'drop_height \[m\]': expected component.parameter \[unit\]"),
    "no unit": ("plant.drop_height\n0.3\n", "row 2: .*unit"),
    "another dimension": ("plant.drop_height [s]\n0.3\n", "row 2: "),
    "the same trial twice": ("trial,plant.drop_height [m]\n3,0.3\n3,0.4\n", "numbers must be different"),
    "no number of a trial": ("trial,plant.drop_height [m]\n3.5,0.3\n", "row 2: trial = '3.5': not a whole number"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name: str, tmp_path: Path) -> None:
    text, words = WRONG[name]
    table = tmp_path / "inputs.csv"
    table.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=words) as caught:
        sc.load_study("study6").with_inputs(table)
    assert str(caught.value).startswith(str(table))


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        GOOD.replace(" [m]", "[m]"),
        GOOD.replace(" [m],", "  [ m ] , "),
        GOOD.replace("\n0.35", "\n\n , \n0.35"),
        "plant.drop_height [cm],brace.angle_scale\n30,1.5\n35,2.0\n25,1.2\n",
        GOOD.removesuffix("\n"),
    ],
)
def test_what_is_read(text: str, tmp_path: Path) -> None:
    """Line ends, byte-order mark, blanks and blank lines as spreadsheets write them; units are converted."""
    table = tmp_path / "inputs.csv"
    table.write_bytes(text.encode())
    study = sc.load_study("study6").with_inputs(table)
    columns = [study.names.index(name) for name in ("plant.drop_height", "brace.angle_scale")]
    assert study.sample()[:, columns] == pytest.approx(np.array([[0.30, 1.5], [0.35, 2.0], [0.25, 1.2]]))
