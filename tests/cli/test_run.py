"""The command line as a user meets it, in processes of its own: output, exit codes, one line per error, nothing
half-written."""

from __future__ import annotations

import json
import subprocess
import sys
from html import unescape
from pathlib import Path

import pandas as pd
import pytest

from sprain_cosim.shipped import shipped_scenarios
from sprain_cosim.terminal import fitted
from tests.fake import brace_variables, make_fmu
from tests.native import device

ROOT = Path(__file__).parent.parent.parent


def call(*arguments: str, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run(
        [sys.executable, "-P", "-m", "sprain_cosim", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=env,
        timeout=120,
    )


def refused(outcome: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    assert outcome.returncode == code, outcome.stderr
    lines = outcome.stderr.strip().splitlines()
    assert len(lines) == 1, outcome.stderr
    assert lines[0].startswith("error: ")
    assert outcome.stdout == ""
    for word in words:
        assert word in lines[0]


def test_table_and_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    outcome = call("run", "incline30_brace", "--out", str(out))
    assert outcome.returncode == 0, outcome.stderr
    row = next(line for line in outcome.stdout.splitlines() if line.startswith("subtalar supination"))
    value, unit, time = row.removeprefix("subtalar supination").split()
    summary = json.loads((out / "summary.json").read_text())
    assert float(value) == pytest.approx(summary["metrics"]["peak_subtalar_angle_deg"], abs=0.005)
    assert unit == "deg"
    assert float(time) == pytest.approx(1e3 * summary["metrics"]["time_of_peak_subtalar_s"], abs=0.05)
    assert "pose touching" in outcome.stdout
    signals = pd.read_csv(out / "signals.csv")
    assert len(signals) == 301
    assert signals.columns[0] == "time [s]"
    assert signals["plant.subtalar_angle [rad]"].max() == pytest.approx(
        summary["metrics"]["peak_subtalar_angle_deg"] * 0.017453292519943295, rel=1e-8
    )
    assert (out / "landing.png").read_bytes().startswith(b"\x89PNG")
    again = call("run", "incline30_brace", "--out", str(out), "--set", "brace.angle_scale=1.5")
    assert again.returncode == 0
    assert json.loads((out / "summary.json").read_text())["metrics"] != summary["metrics"]
    drawn = call("plot", str(out), "--out", str(tmp_path))
    assert drawn.returncode == 0
    assert (tmp_path / "figures" / "landing.png").stat().st_size > 20_000


def test_an_adaptive_step_reports_on_the_regular_grid(tmp_path: Path) -> None:
    out = tmp_path / "run"
    outcome = call(
        "run",
        "incline30_brace",
        "--scheme",
        "gauss-seidel",
        "--adaptive",
        "1 %",
        "--identify",
        "5",
        "--out",
        str(out),
        "--json",
    )
    assert outcome.returncode == 0, outcome.stderr
    summary = json.loads(outcome.stdout)
    assert summary["exchanges"] > 300
    assert summary["smallest_step_s"] < summary["communication_step_s"] == 5e-4
    assert summary["coupling_error"] <= 0.01
    assert len(pd.read_csv(out / "signals.csv")) == 301
    refused(call("run", "incline30", "--adaptive", "150 %"), 2, "adaptive", "100 %")


def test_json_is_one_object_with_the_promised_keys() -> None:
    outcome = call("run", "incline30", "--json")
    summary = json.loads(outcome.stdout)
    assert outcome.stdout.count("\n") == 1
    assert {"status", "message", "wall_s", "initial_pose", "coupling_error", "metrics"} <= set(summary)
    assert summary["status"] == "completed"
    assert summary["initial_pose"] == "touching"
    assert not [key for key in summary["metrics"] if key.startswith("brace_")]


def test_two_processes_give_identical_numbers() -> None:
    first, second = (json.loads(call("run", "incline30_mixed", "--json").stdout)["metrics"] for _ in range(2))
    assert first == second


BAD = [
    (["run", "incline3"], ["did you mean incline30?"]),
    (["run", "no/such.toml"], ["no/such.toml", "no such scenario file"]),
    (["run", "incline30", "--set", "plant.drop_hight=0.3m"], ["plant.drop_hight", "did you mean drop_height?"]),
    (["run", "incline30", "--set", "plnt.drop_height=0.3m"], ["no component 'plnt'", "did you mean plant?"]),
    (["run", "incline30", "--set", "plant.drop_height=0.3"], ["plant.drop_height", "needs a unit"]),
    (["run", "incline30", "--set", "plant.drop_height=3 deg"], ["plant.drop_height", "expected m"]),
    (
        ["run", "incline30", "--set", "plant.drop_height=-1 m"],
        ["plant.drop_height = -1 m", "outside its range 0 ... 5 m"],
    ),
    (["run", "incline30", "--set", "plant.drop_height"], ["--set", "COMPONENT.PARAMETER=VALUE"]),
    (["run", "incline30", "--set", "plant.initial_pose=sitting"], ["must be one of touching, published"]),
    (["run", "incline30", "--set", "plant.ground_force=1 N"], ["is an output, not a parameter"]),
    (["run", "incline30", "--step", "0.7 ms"], ["not a whole number of steps", "near it are 0.75 ms and 0.625 ms"]),
    (["run", "incline30", "--step", "0.5"], ["needs a unit"]),
    (["run", "incline30", "--scheme", "jakobi"], ["jakobi"]),
    (["run", "incline30", "--fmu", "brase=brace_bushing"], ["did you mean brace?"]),
    (["run", "incline30", "--fmu", "brace=gone.fmu"], ["gone.fmu", "no such FMU file"]),
    (["run", "incline30", "--fmu", "brace=brace_bushin"], ["did you mean brace_bushing?"]),
    (["run", "incline30", "--nonsense"], ["--nonsense"]),
    (["run"], ["SCENARIO"]),
    (["jump"], ["jump"]),
    (["plot", "nowhere"], ["nowhere", "no such folder"]),
    (["plot", "y" * 300], ["no such folder"]),
    (["compare", "y" * 300, "--brace", "a=brace_linear"], ["no such file, and none of that name ships"]),
    (["run", "incline30", "--out", ""], ["--out", "is empty; name a file or a folder"]),
    (["run", "incline30", "--adaptive", "1 ms"], ["adaptive = '1 ms'", "has the dimension s"]),
    (["study", "study2", "--max-failed", "5 ms"], ["--max-failed", "has the dimension s"]),
    (["study", "study2", "--method", ""], ["method ''"]),
    (["study", "study2", "--shard", ""], ["--shard", "K/N"]),
    (["study", "study2", "--trials", "9" * 20], ["at most 10000000"]),
    (["study", "study2", "--workers", "99999"], ["workers = 99999: at most 1024"]),
]


@pytest.mark.parametrize(("arguments", "words"), BAD, ids=lambda v: " ".join(v) if isinstance(v, list) else str(v))
def test_bad_input_is_one_line_and_exit_2(arguments: list[str], words: list[str], tmp_path: Path) -> None:
    refused(call(*arguments, cwd=tmp_path), 2, *words)
    assert list(tmp_path.iterdir()) == []


FILES = [
    ('base = "incline30"\n[parameter]\n', ["unknown key 'parameter'", "did you mean parameters?"]),
    ('base = "incline30"\n[parameters]\nplant.drop_height = "0.3 m"\n', ["quote names with a dot"]),
    ('base = "incline30"\n[parameters]\n"plant.drop_height" = 0.3\n', ['needs a unit, for example "0.3 m"']),
    ('base = "second"\n', ["the bases form a circle (case -> second -> case)"]),
    (
        'base = "incline30"\n[connections]\n"plant.ext_dig_excitation" = "controller.ext_dig_excitatio"\n',
        ["did you mean ext_dig_excitation?"],
    ),
    (
        'base = "incline30"\n[connections]\n"plant.ext_dig_excitation" = "controller.ext_dig_stretch_velocity"\n',
        ["is an input; only an output can feed an input"],
    ),
    (
        'base = "incline30"\n[connections]\n"plant.ext_dig_excitation" = "plant.ground_force"\n',
        ["the units do not match"],
    ),
    ('base = "incline30"\n[connections]\n"a" = "b"\n"a" = "c"\n', ["not valid TOML"]),
    ('base = "incline30"\n[master]\ncommunication_step = 0.5\n', ["master.communication_step", "needs a unit"]),
    ('base = "incline30"\n[master]\nstep = "0.5 ms"\n', ["unknown key 'step'"]),
    ('base = "incline30"\n[components.brace]\nfmu = "gone.fmu"\n', ["gone.fmu", "no such FMU file"]),
    ('base = "incline30"\n[components.brace]\nfmu = "broken.fmu"\n', ["broken.fmu", "not a readable zip archive"]),
    ("[components]\n", ["no components"]),
    ("title = 3\n", ["title: must be text"]),
    ("=", ["not valid TOML"]),
]


@pytest.mark.parametrize(("text", "words"), FILES, ids=[str(k) for k in range(len(FILES))])
def test_bad_scenario_files(text: str, words: list[str], tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(text)
    (tmp_path / "second.toml").write_text('base = "case"\n')
    (tmp_path / "broken.fmu").write_bytes(b"not a zip archive")
    outcome = call("run", "case.toml", "--out", "out", cwd=tmp_path)
    refused(outcome, 2, "second.toml" if "second" in text else "case.toml", *words)  # where the fault stands
    assert not (tmp_path / "out").exists()


def test_all_problems_of_a_file_at_once(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(
        'base = "incline30"\n[parameters]\n"plant.drop_height" = 0.3\n"plant.platform_incline" = "30 '
        'm"\n"plant.gravity" = 9.81\n'
    )
    refused(
        call("run", "case.toml", cwd=tmp_path),
        2,
        "3 problems",
        "plant.drop_height",
        "plant.platform_incline",
        "plant.gravity",
    )


FAULTS = {
    "nan": (
        'def step(self, time, step):\n    self["subtalar_torque"] = float("nan") if time > 0.01 else 0.0',
        ["brace: subtalar_torque = nan at 0.011"],
    ),
    "raises": (
        'def step(self, time, step):\n    if time > 0.01:\n        raise RuntimeError("the strap broke")',
        ["brace: reported an error in the step from 0.0105 s", "RuntimeError: the strap broke"],
    ),
    "at the start": (
        'def initialise(self):\n    raise RuntimeError("no strap")',
        ["brace: reported an error", "RuntimeError: no strap"],
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_failing_device_ends_the_run_with_exit_3(fault: str, tmp_path: Path) -> None:
    body, words = FAULTS[fault]
    fmu = make_fmu(tmp_path, "faulty", brace_variables(), body)
    outcome = call("run", "incline30", "--fmu", f"brace={fmu}", "--out", str(tmp_path / "out"))
    refused(outcome, 3, *words)
    assert not (tmp_path / "out").exists()
    summary = json.loads(call("run", "incline30", "--fmu", f"brace={fmu}", "--json").stdout)
    assert summary["status"] == "failed"
    assert summary["metrics"] == {}


def test_a_run_that_a_device_ends_is_stopped(tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu", behaviour={"ENDS": 0.0303})
    outcome = call("run", "incline30", "--fmu", f"brace={fmu}", "--json", "--out", str(tmp_path / "out"))
    assert outcome.returncode == 3
    assert outcome.stderr.strip() == "error: brace: asked to end the simulation at 0.0303 s"
    summary = json.loads(outcome.stdout)
    assert (summary["status"], summary["metrics"]) == ("stopped", {})
    assert not (tmp_path / "out").exists()


def test_a_device_with_a_step_of_its_own_is_called_at_its_rate(tmp_path: Path) -> None:
    """Whatever --step says; the age of its torque stands beside the coupling error, also at half the step."""
    law = 'def step(self, time, step):\n    self["subtalar_torque"] = -self["k"] * self["subtalar_angle"]\n'
    fmu = make_fmu(tmp_path, "slow", brace_variables(), law, "FIXED_STEP = 0.005")
    arguments = ("run", "incline30", "--fmu", f"brace={fmu}", "--check-coupling")
    usual, coarse = call(*arguments, "--json"), call(*arguments, "--json", "--step", "10 ms", "--stop", "0.15 s")
    assert (usual.returncode, coarse.returncode) == (0, 0), usual.stderr + coarse.stderr
    usual, coarse = json.loads(usual.stdout), json.loads(coarse.stdout)
    assert usual["held"]["brace"]["period_s"] == coarse["held"]["brace"]["period_s"] == 0.005
    assert 0.1 < usual["held"]["brace"]["share"] < 1.0
    assert coarse["metrics"]["peak_vertical_grf_N"] == pytest.approx(usual["metrics"]["peak_vertical_grf_N"], rel=1e-3)
    assert abs(usual["coupling_check"]["peak_subtalar_angle_deg"]) < 0.05
    text = call(*arguments[:-1]).stdout
    assert "brace is sampled every 5 ms" in text


@pytest.mark.parametrize("command", ["run", "study", "compare"])
def test_the_master_s_settings_are_the_same_for_run_study_and_compare(command: str, tmp_path: Path) -> None:
    """--step, --stop and --scheme; a wrong one is refused before anything runs."""
    what = ["study2", "--trials", "1", "--workers", "1"] if command == "study" else ["incline30"]
    more = ["--brace", "soft=brace_linear"] if command == "compare" else []
    refused(call(command, *what, *more, "--scheme", "jacoby"), 2, "did you mean jacobi?")
    refused(call(command, *what, *more, "--step", "7 m"), 2, "communication step")
    out = tmp_path / "out"
    settings = ("--step", "1 ms", "--stop", "20 ms", "--scheme", "gauss-seidel")
    done = call(command, *what, *more, *settings, "--out", str(out))
    assert done.returncode == 0, done.stderr
    if command == "study":
        return
    folders = [out] if command == "run" else [out / "none", out / "soft"]
    for folder in folders:
        summary = json.loads((folder / "summary.json").read_text())
        assert (summary["scheme"], summary["communication_step_s"], summary["exchanges"]) == ("gauss-seidel", 1e-3, 20)


def test_an_input_fed_twice(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text('base = "incline30_brace"\n')
    (tmp_path / "case.toml").write_text(
        'base = "incline30"\n[components.brace]\nfmu = "brace_bushing"\n[components.second]\nfmu = "brace_bushing"\n'
    )
    refused(
        call("run", "case.toml", cwd=tmp_path),
        2,
        "plant.brace_rotation_x_torque: fed by brace.rotation_x_torque and by second.rotation_x_torque",
    )


def test_a_device_that_lacks_a_parameter_gets_one_warning(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, "spring", brace_variables(), 'def refresh(self):\n    self["subtalar_torque"] = '
                                                          '-self["k"] * self["subtalar_angle"]\n\n'
                   "def initialise(self):\n    self.refresh()\n\ndef step(self, time, step):\n    "
                   "self.refresh()")  # fmt: skip
    outcome = call("run", "incline30_brace", "--fmu", f"brace={fmu}", "--json")
    assert outcome.returncode == 0
    assert outcome.stderr.splitlines() == [
        "warning: brace: spring.fmu has no angle_scale; the scenario's value is dropped"
    ]
    assert json.loads(outcome.stdout)["dropped"] == ["brace.angle_scale"]
    refused(
        call("run", "incline30_brace", "--fmu", f"brace={fmu}", "--set", "brace.angle_scale=2"),
        2,
        "brace has no variable 'angle_scale'",
    )


def test_a_folder_in_use_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    refused(call("run", "incline30", "--out", str(tmp_path)), 2, "holds other files (thesis.tex)")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_an_output_that_cannot_be_written(tmp_path: Path) -> None:
    refused(call("run", "incline30", "--out", "/dev/null/run"), 4, "cannot be written")


def test_cache_that_cannot_be_written() -> None:
    refused(call("run", "incline30", SPRAIN_COSIM_CACHE="/dev/null/cache"), 4, "SPRAIN_COSIM_CACHE")


def test_lists_and_doctor() -> None:
    listed = [line.split()[0] for line in call("scenarios", COLUMNS="200").stdout.splitlines()]
    assert listed == ["scenario", *shipped_scenarios()]
    assert {"incline30", "incline30_brace", "incline30_mixed", "level"} <= set(listed)
    healthy = call("doctor")
    assert healthy.returncode == 0
    assert "peak subtalar angle 49.6 deg" in healthy.stdout
    assert call("--version").stdout.startswith("sprain-cosim, version ")


def test_help_does_not_load_the_heavy_libraries() -> None:
    code = """if True:
        import sys
        from sprain_cosim.cli import main
        try:
            main(["--help"])
        except SystemExit:
            print(sorted({"numpy", "fmpy", "pandas", "matplotlib", "numba"} & set(sys.modules)))
    """
    outcome = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert outcome.stdout.strip().endswith("[]")


def test_a_run_loads_what_it_uses(tmp_path: Path) -> None:
    """Tables, statistics and figures are loaded where they are written or drawn, what compiles never."""
    code = """if True:
        import sys
        from sprain_cosim.cli import main
        def loaded(*arguments):
            try:
                main(["run", "incline30", *arguments])
            except SystemExit as end:
                assert not end.code
            heavy = {"scipy", "pandas", "matplotlib", "numba", "llvmlite", "mujoco", "pythonfmu"}
            print("loaded:", sorted(heavy & set(sys.modules)))
        loaded()
        loaded("--out", sys.argv[1])
    """
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    outcome = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    said = [line for line in outcome.stdout.splitlines() if line.startswith("loaded:")]
    assert said[0] == "loaded: []", outcome.stderr
    assert "numba" not in said[1] and "llvmlite" not in said[1] and "mujoco" not in said[1]


@pytest.mark.parametrize("change", [("--set", "plant.drop_height=35 cm"), ("--fmu", "brace=brace_linear")])
def test_published_figures_stand_beside_their_own_study_alone(change: tuple[str, str], tmp_path: Path) -> None:
    """Not beside another drop or device; what was said of it before its trials stays in its folder and its report."""
    out = tmp_path / "s"
    outcome = call(
        "study", "study6", *change, "--trials", "8", "--workers", "1", "--out", str(out), "--progress", "none"
    )
    assert outcome.returncode == 0, outcome.stderr
    assert "29.35" not in outcome.stdout
    assert f"published figures are of another study: this one has {change[1].partition('=')[0]}" in outcome.stdout
    told = [line.removeprefix("warning: ") for line in outcome.stderr.splitlines()]
    assert json.loads((out / "summary.json").read_text()).get("warnings", []) == told
    assert call("report", str(out), "--out", str(tmp_path / "page.html")).returncode == 0
    page = unescape((tmp_path / "page.html").read_text())
    assert all(f"<b>Warning:</b> {line}" in page for line in told)


def test_study_prints_its_table_and_resumes(tmp_path: Path) -> None:
    out = tmp_path / "s"
    outcome = call("study", "study6", "--trials", "24", "--workers", "2", "--out", str(out), "--progress", "none")
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stderr == ""
    assert "24 of 24 trials completed" in outcome.stdout
    assert "29.35" in outcome.stdout, "the published mean stands beside ours"
    before = (out / "trials.csv").read_bytes()
    again = call(
        "study",
        "study6",
        "--trials",
        "24",
        "--workers",
        "1",
        "--out",
        str(out),
        "--resume",
        "--json",
        "--progress",
        "json",
    )
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["n_completed"] == 24
    assert json.loads(again.stderr.splitlines()[-1])["finished"] == 24
    assert (out / "trials.csv").read_bytes() == before
    refused(call("study", "study6", "--trials", "24", "--out", str(out)), 2, "--resume")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('scenario = "incline31"', ["incline31", "incline30"]),
        ('scenario = "incline30"\n[marginals]\n"plant.drop_hight" = { fixed = "0.3 m" }', ["drop_height"]),
        (
            'scenario = "incline30"\n[marginals]\n"plant.drop_height" = { normal = { mean = 0.3, sd = 0.05 } }',
            ["needs a unit"],
        ),
        (
            'scenario = "incline30"\n[marginals]\n"plant.drop_height" = { normal = { mean = "0.1 m", sd = "0.1 m" } }',
            ["% of the trials", "lognormal"],
        ),
        (
            'scenario = "incline30"\n[marginals]\n"plant.subtalar_angle_at_contact" = { normal = { mean = "0 rad", sd '
            '= "5 rad" } }',
            ["% of the trials"],
        ),
        (
            'scenario = "incline30"\n[marginals]\n"plant.drop_height" = { lognormal = { mean = "0 m", sd = "0 m" } }',
            ["fixed"],
        ),
        ('scenario = "incline30"\n[study]\nmethod = "monte-carl"', ["monte-carlo"]),
        ('scenario = "incline30"\n[marginal]\n', ["marginals"]),
    ],
)
def test_study_file_that_cannot_be_used(tmp_path: Path, content: str, words: list[str]) -> None:
    (tmp_path / "mine.toml").write_text(content)
    refused(call("study", "mine.toml", "--trials", "4", cwd=tmp_path), 2, *words)
    assert not (tmp_path / "runs").exists()


def test_compare_prints_its_table_and_ends_with_3_where_a_brace_failed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    bad = make_fmu(
        tmp_path, "bad", brace_variables(), 'def step(self, time, step):\n    raise RuntimeError("the strap broke")'
    )
    braces = [
        "--brace",
        "linear=brace_linear",
        "--brace",
        f"bad={bad}",
        "--set",
        "linear.subtalar_stiffness_coefficient=60 N.m/rad",
    ]
    outcome = call("compare", "incline30", *braces, "--out", str(out), "--progress", "none")
    refused_after_work = [line for line in outcome.stderr.splitlines() if line.startswith("error: ")]
    assert outcome.returncode == 3
    assert len(refused_after_work) == 1
    assert "1 of 3 failed: bad: " in refused_after_work[0]
    assert "the strap broke" in refused_after_work[0]
    for columns in (60, 80, 120):
        lines = fitted(outcome.stdout, columns).splitlines()
        assert [line for line in lines if len(line) > columns and not line.startswith("written:")] == []
    data = json.loads((out / "compare.json").read_text())
    assert (
        f"{data['braces']['linear']['difference_to_none']['peak_subtalar_angle_deg']['value']:+.2f}" in outcome.stdout
    )
    assert data["braces"]["linear"]["resistance_Nm"]["supination_10deg"] == pytest.approx(
        60 * 0.17453292519943295, rel=1e-9
    )
    refused(call("compare", "incline30", "--brace", "linear"), 2, "--brace linear: must read NAME=FILE")
    refused(call("compare", "incline30", "--brace", "a=brace_linear", "--map", "b=x.toml"), 2, "there is no --brace b=")


def test_an_earlier_run_is_overwritten_with_a_warning_or_by_force(tmp_path: Path) -> None:
    arguments = ("run", "incline30", "--stop", "5 ms", "--out", str(tmp_path / "r"))
    assert "overwritten" not in call(*arguments).stderr
    again = call(*arguments)
    assert again.returncode == 0
    assert "r: its earlier run is overwritten; the next version asks for --force" in again.stderr
    forced = call(*arguments, "--force")
    said = "warning: the foot still turned at the stop (5 ms): its peak is the largest angle till then; "
    assert (forced.returncode, forced.stderr) == (0, f'{said}--stop "150 ms" shows how it goes on\n')
