"""Measured tables of a brace: what a column may have been meant to be."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim.brace.from_csv import from_csv
from sprain_cosim.errors import InputError
from sprain_cosim.shipped import fmu_path


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("inversion_resistance", "inversion is an axis of the joint coordinate system, another rotation than"),
        ("internal_rotation_torque", "internal_rotation is an axis of the joint coordinate system"),
        ("eversion_torque", "eversion is inversion with angle and torque of the other sign; inversion is an axis of"),
        ("plantarflexion_resistance", "plantarflexion is dorsiflexion with angle and torque of the other sign"),
        ("external_rotation_torque", "external_rotation is internal_rotation with angle and torque of the other sign"),
        ("dorsiflexion_torque", "dorsiflexion is an axis of the joint coordinate system"),
        ("pronation_torque", "pronation turns against subtalar; turn the signs of angle and torque"),
        ("supination_torque", "supination is the positive direction of subtalar; name the column subtalar_torque"),
        ("subtlar_torque", "did you mean subtalar_torque?"),
        ("subtalar_moment", "did you mean subtalar_torque?"),
        ("knee_torque", "known: talocrural, subtalar"),
    ],
)
def test_another_axis_is_never_offered(column: str, words: str, tmp_path: Path) -> None:
    """A near name of another axis would be another brace."""
    table = tmp_path / "table.csv"
    table.write_text(f"angle [deg],{column} [N.m]\n-20,-5\n0,0\n10,1.5\n")
    with pytest.raises(InputError) as refused:
        from_csv(table, tmp_path / "table.fmu", fmu_path("brace_table", Path.cwd(), ""))
    message = str(refused.value)
    assert words in message
    axis = column.partition("_")[0]
    assert axis in ("subtlar", "subtalar") or "did you mean" not in message


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("-20,-8\n0,0\n1e-300,8", "row 4, column 1 (angle): 1e-300 does not rise"),
        ("-20,-8\n0,0\n1e300,8", "column 1 (angle) reaches 1e+300 deg; is its unit right?"),
        ("-20,-8e6\n0,0\n20,8e6", "column 2: reaches 8e+06 N.m; is its unit right?"),
    ],
)
def test_a_table_that_no_joint_has_is_refused(rows: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(f"angle [deg],subtalar_resistance [N.m]\n{rows}\n")
    with pytest.raises(InputError) as refused:
        from_csv(tmp_path / "table.csv", tmp_path / "table.fmu", fmu_path("brace_table", Path.cwd(), ""))
    assert words in str(refused.value)
    assert not (tmp_path / "table.fmu").exists()
