"""Persons land: a subject as parameters of the plant, persons as inputs of studies, ankles that have sprained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.cli import main
from sprain_cosim.errors import InputError
from sprain_cosim.folders.comparison import read_comparison_summary
from sprain_cosim.folders.read import read_folders
from sprain_cosim.folders.run import RunSummary
from sprain_cosim.report.page import write_report
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.scenario.body import OWNER
from sprain_cosim.study.manifest import read_manifest
from sprain_cosim.study.replay import replay
from sprain_cosim.study.study import Study
from sprain_cosim.subject import Subject, anthropometry, base_person, parse_subject
from sprain_cosim.subject.person import BASE
from sprain_cosim.uq.distributions import Normal

PEAK = "peak_subtalar_angle_deg"
WOMAN = "female, 1.63 m, 62 kg"
PAPER = ("_reflex", "_coactivation", "_brace", "_mixed")


@pytest.fixture(scope="module")
def mixed() -> Scenario:
    return load_scenario("incline30_mixed").with_master(stop="60 ms")


@pytest.mark.parametrize("name", ["level", *(f"incline30{w}" for w in ("", *PAPER))])
def test_the_base_person_said_in_any_way_lands_as_nobody_named(name: str) -> None:
    """To the bit, in every signal: by stature and mass, by all measures, by the plant's mass and factors."""
    plain = load_scenario(name).with_master(stop="60 ms")
    factors = {f"plant.{key}": value for key, value in BASE.parameters().items()}
    assert len(factors) == 16
    assert {value for key, value in factors.items() if "_scale_" in key} == {1.0}
    ways = {
        "stature and mass": plain.with_subject("female, 1.80 m, 67.54377325440001 kg"),
        "all measures": plain.with_subject(Subject("female", base_person().measures)),
        "factors": plain.with_parameters(factors | {"plant.muscle_force_scale": 1.0}),
    }
    expected = plain.run()
    assert expected.metrics
    for way, scenario in ways.items():
        found = scenario.run()
        assert found.metrics == expected.metrics, way
        for signal in expected.signals:
            assert np.array_equal(found.signals[signal], expected.signals[signal]), f"{way}: {signal}"


def test_another_person_between_two_landings_leaves_nothing(mixed: Scenario) -> None:
    """In one session, as trials follow each other."""
    woman = mixed.with_subject(WOMAN)
    with woman.open() as session:
        base = {f"{OWNER}{name}": value for name, value in base_person().measures.items()}
        runs = [session.run(base if k % 2 else {}) for k in range(4)]
    alone = mixed.run()
    assert runs[0].metrics == runs[2].metrics != runs[1].metrics
    for run in (runs[1], runs[3]):
        assert all(np.array_equal(run.signals[name], alone.signals[name]) for name in alone.signals)


def test_a_subject_is_its_parameters(mixed: Scenario) -> None:
    woman = mixed.with_subject(WOMAN)
    values = woman.values()
    assert values["plant.body_mass"] == "62.0 kg"
    explicit = mixed
    for name, value in values.items():
        explicit = explicit.override(name, value)
    ran = woman.run()
    assert ran.metrics == explicit.run().metrics
    assert ran.metrics[PEAK] != pytest.approx(mixed.run().metrics[PEAK], abs=0.1)
    assert woman.heading.startswith("30° slope, woman, 1.63 m, 62 kg, 150 % brace")
    summary = RunSummary.of(woman, ran)
    assert summary.subject is not None
    assert summary.subject.measures["foot_length"].sd > 0.005
    assert RunSummary.from_json(summary.to_json(), "x").subject == summary.subject
    assert mixed.override("plant.drop_height", "0.3 m").subject is None


def test_one_measure_may_be_set_and_a_parameter_wins_over_the_subject(mixed: Scenario) -> None:
    woman = mixed.with_subject(WOMAN)
    heavier = woman.override("subject.mass", "70 kg")
    assert heavier.heading.startswith("30° slope, woman, 1.63 m, 70 kg")
    assert heavier.system().parameters["plant.body_mass"] == 70.0
    stated = woman.override("plant.body_mass", "80 kg")
    assert stated.system().parameters["plant.body_mass"] == 80.0
    assert stated.system().parameters["plant.thigh_scale_x"] == woman.system().parameters["plant.thigh_scale_x"]
    lax = mixed.with_subject(f"{WOMAN}, passive mass-height").system().parameters
    own = mixed.system().find("plant.passive_x_cubic").start
    assert own is not None
    assert lax["plant.passive_x_cubic"] == pytest.approx(own * 1.63 * 62 / (1.80 * 67.54377325440001))


def test_a_file_says_who_lands(tmp_path: Path) -> None:
    path = tmp_path / "woman.toml"
    path.write_text(
        'base = "incline30"\n[subject]\nsex = "female"\nstature = "163 cm"\nmass = "62 kg"\nfoot_scale = 1.05\n'
    )
    scenario = load_scenario(path)
    assert scenario.system().parameters["plant.foot_scale_z"] == 1.05
    assert "foot scaled by 1.05" in scenario.heading
    path.write_text('base = "incline30"\n[subject]\nstature = "163 cm"\n')
    with pytest.raises(InputError, match=r"subject: needs sex"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (["--subject", "female, 1,63 m"], "decimal comma"),
        (["--subject", "male, 300 kg"], "body_mass = 300 lies outside the plant's"),
        (["--set", "subject.mass=60 kg"], "nobody is described"),
        (["--subject", WOMAN, "--set", "subject.masss=60 kg"], "no such name (did you mean subject.mass?)"),
        (["--subject", WOMAN, "--set", "subject.mass=60"], "needs a unit"),
        (["--subject", WOMAN, "--set", "subject.sex=x"], "must be female or male"),
    ],
)
def test_bad_persons_get_one_line(options: list[str], part: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "incline30", *options])
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert part in said
    assert said.count("\n") == 1


# ---- studies


@pytest.fixture(scope="module")
def population() -> Study:
    return sc.load_study("population_mixed").with_master(stop="60 ms")


def test_a_population_lands(population: Study, tmp_path: Path) -> None:
    """Its rows repeat to the bit, alone and continued, and the folder says who landed."""
    done = population.run(trials=44, workers=2, out=tmp_path / "all", trajectories=0)
    rows = done.trials
    assert set(rows["subject.sex"]) == {0.0, 1.0}
    assert rows["subject.stature [m]"].between(1.3, 2.2).all()
    assert (rows["status"] == "completed").all()
    assert done.summary.groups is not None
    assert "person" in done.summary.groups[population.responses[0]]
    population.run(trials=10, workers=1, out=tmp_path / "part", trajectories=0)
    again = population.run(trials=44, workers=1, out=tmp_path / "part", resume=True, trajectories=0)
    assert again.trials.equals(rows)
    repeated = replay(tmp_path / "all", 5)
    assert repeated.same
    assert repeated.study.scenario.subject is not None
    assert repeated.study.scenario.subject.measures["mass"] == rows["subject.mass [kg]"][5]
    assert read_manifest(tmp_path / "all").identity["population"]["Population"]["shares"] == {
        "female": 0.5,
        "male": 0.5,
    }


def test_measures_of_ones_own_persons(population: Study, tmp_path: Path, mixed: Scenario) -> None:
    """A measure without a column is estimated person by person, so a row is a run of that subject."""
    table = tmp_path / "team.csv"
    table.write_text("subject.sex,subject.stature [m],subject.mass [kg]\nfemale,1.63,62\nmale,1.91,104\n")
    given = population.with_inputs(table)
    assert "persons of varied sex, stature, mass" in given.heading
    done = given.run(workers=1)
    for row, words in zip(done.trials.to_dict("records"), (WOMAN, "male, 1.91 m, 104 kg"), strict=True):
        alone = mixed.with_subject(words)
        for name, marginal in population.marginals.items():
            if not name.startswith("subject."):
                unit = population.units[name]
                alone = alone.override(name, f"{marginal.mean!r} {unit}" if unit else marginal.mean)
        assert alone.run().metrics[PEAK] == row[PEAK]
    table.write_text("subject.sex,subject.mass [kg]\nmale,80\n")
    shared = population.override("subject.stature", "1.90 m").with_inputs(table).scenario.subject
    assert shared is not None
    assert shared.measures == {"stature": 1.9}
    table.write_text("subject.stature [m]\n1.63\n")
    with pytest.raises(InputError, match=r"needs a column subject.sex"):
        population.with_inputs(table)
    table.write_text("plant.drop_height [m]\n0.3\n")
    with pytest.raises(InputError, match="needs columns of the persons"):
        population.with_inputs(table)


def test_a_population_may_share_a_measure(population: Study) -> None:
    tall = population.override("subject.stature", "1.90 m").override("subject.sex", "male")
    assert "stature 1.9 m" in tall.heading
    x = pd.DataFrame(tall.sample()[:50], columns=list(tall.names))
    assert set(x["subject.stature"]) == {1.9}
    assert "subject.sex" not in x
    assert x["subject.trochanterion_height"].mean() > 0.95
    assert tall.correlation is not None
    sitting = population.override("subject.sitting_height", "0.95 m")  # none of the inputs: it must hold all the same
    assert sitting.scenario.subject is not None
    assert sitting.scenario.subject.measures == {"sitting_height": 0.95}
    assert sitting.marginals["subject.stature"].mean > population.marginals["subject.stature"].mean + 0.05


def test_what_no_population_allows(population: Study, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="samples a population of women and men"):
        population.with_subject(WOMAN)
    with pytest.raises(InputError, match="independent inputs only"):
        population.run(method="sobol-indices", trials=64)
    with pytest.raises(InputError, match="choices have no slope"):
        population.run(method="amv")
    women = sc.load_study("population_women")
    assert women.correlation is not None
    path = tmp_path / "twice.toml"
    path.write_text(
        'scenario = "incline30"\n[population]\nmen = 1\n[marginals]\n'
        '"subject.mass" = { normal = { mean = "80 kg", sd = "5 kg" } }\n'
    )
    with pytest.raises(InputError, match=r"subject.mass describes persons too"):
        sc.load_study(path)


def test_those_who_share_a_measure_are_of_the_sexes_that_have_it(population: Study) -> None:
    """By Bayes' rule: of the women and men of a large sample who are that tall, as many are women."""
    shared = population.override("subject.stature", "1.70 m")
    assert shared.population is not None
    women = shared.population.drawn["female"]
    x = pd.DataFrame(replace(population, trials=100_000).sample(), columns=list(population.names))
    near = x[(x["subject.stature"] - 1.70).abs() < 0.005]
    assert women == pytest.approx((near["subject.sex"] == 0).mean(), abs=3 * 0.5 / len(near) ** 0.5)
    assert f"women and men ({100 * women:.3g} : {100 * (1 - women):.3g} %), stature 1.7 m" in shared.heading
    assert shared.warnings == population.warnings
    again = shared.override("subject.mass", "70 kg").override("subject.stature", "1.70 m")
    other = population.override("subject.mass", "70 kg").override("subject.stature", "1.70 m")
    assert again.population is not None
    assert other.population is not None
    assert again.population.drawn == pytest.approx(other.population.drawn, rel=1e-12)
    giants = population.override("subject.stature", "2.30 m")
    assert "population of men, stature 2.3 m" in giants.heading
    assert giants.warnings[-1] == (
        "population: stature 2.3 m is by their law above all 4082 men measured; what else is drawn extrapolates"
    )


def test_rows_of_unusual_persons_are_counted(population: Study, tmp_path: Path) -> None:
    """More of them than a sample of the population has by chance."""
    table = tmp_path / "team.csv"
    table.write_text("subject.sex,subject.stature [m],subject.mass [kg]\nfemale,1.63,62\nmale,1.91,104\nmale,2.4,60\n")
    said = population.with_inputs(table).warnings[-1]
    assert "team.csv: 1 of 3 persons have measures outside what is usual; trial 2: stature 2.4 m is by their" in said
    names = [name for name in population.names if name.startswith(OWNER)]
    rows = replace(population, trials=500).sample()[:, : len(names)]
    heads = [f"{n} [{population.units[n]}]" if population.units[n] else n for n in names]
    table.write_text("\n".join([",".join(heads), *(",".join(map(repr, row)) for row in rows.tolist())]))
    assert not any("outside what is usual" in line for line in population.with_inputs(table).warnings)


def test_one_measure_of_a_subject_varies(tmp_path: Path) -> None:
    (tmp_path / "woman.toml").write_text('base = "incline30"\n[subject]\nsex = "female"\nstature = "1.63 m"\n')
    path = tmp_path / "mass.toml"
    text = 'scenario = "woman.toml"\n[marginals]\n"subject.mass" = { lognormal = { mean = "62 kg", sd = "8 kg" } }\n'
    path.write_text(text)
    study = sc.load_study(path)
    assert "woman, 1.63 m, varied mass" in study.heading
    path.write_text(text.replace("woman.toml", "incline30"))
    with pytest.raises(InputError, match="nobody is described"):
        sc.load_study(path)


def test_a_comparison_over_persons_without_parts(population: Study, tmp_path: Path) -> None:
    """Persons who differ in a measure by which none are shown: the worst tenth is told, nothing is drawn."""
    from sprain_cosim.brace.compare import compare_braces

    (tmp_path / "legs.toml").write_text(
        'scenario = "incline30_mixed"\n[population]\nwomen = 1\nmeasures = ["trochanterion_height"]\n'
    )
    study = sc.load_study(tmp_path / "legs.toml").with_master(stop="20 ms")
    assert "population of women, drawn by trochanterion height alone" in study.heading
    compare_braces(study, {"linear": "brace_linear"}, trials=40, out=tmp_path / "compared")
    persons = read_comparison_summary(tmp_path / "compared").persons
    assert persons is not None
    assert not persons.bands
    assert set(persons.worst) == {"none", "linear"}
    page = write_report(read_folders([tmp_path / "compared"]), tmp_path / "page.html").read_text("utf-8")
    assert "The worst tenth: linear" in page
    assert "For whom does each brace work?" not in page


@pytest.mark.long
def test_for_whom_does_a_brace_work(population: Study, tmp_path: Path) -> None:
    from sprain_cosim.brace.compare import compare_braces

    out = tmp_path / "compared"
    compare_braces(population, {"paper": "brace_bushing"}, trials=120, out=out)
    persons = read_comparison_summary(out).persons
    assert persons is not None
    assert len(persons.bands["subject.stature"]) == 5
    assert set(persons.worst) == {"none", "paper"}
    assert (out / "figures" / "persons.png").is_file()
    page = write_report(read_folders([out]), tmp_path / "page.html").read_text("utf-8")
    assert "For whom does each brace work?" in page
    assert "The worst tenth: paper" in page


# ---- ankles that have sprained


def test_unstable_ankles_roll_farther() -> None:
    names = ("stable", "functional_instability", "mechanical_instability", "chronic_instability")
    peaks = {name: load_scenario(f"ankle_{name}").run().metrics[PEAK] for name in names}
    assert peaks["stable"] < peaks["functional_instability"] < peaks["chronic_instability"]
    assert peaks["stable"] < peaks["mechanical_instability"] < peaks["chronic_instability"]


def test_every_number_of_an_unstable_ankle_has_its_source() -> None:
    """The page names each parameter that differs from the stable ankle, and its range is the study's."""
    page = (Path(__file__).parents[2] / "docs" / "unstable-ankles.md").read_text("utf-8")
    stable, worst = (dict(load_scenario(f"ankle_{n}").parameters) for n in ("stable", "chronic_instability"))
    different = {name for name in worst if worst[name] != stable.get(name)}
    assert len(different) == 4
    study = sc.load_study("unstable_ankles")
    for name in different:
        assert f"`{name}`" in page
        low, high = study.marginals[name].support
        value = load_scenario("ankle_chronic_instability").system().parameters[name]
        assert low < value <= high


def test_the_published_pose_is_the_base_persons(mixed: Scenario) -> None:
    """Known before any landing, so that it is an input matter, of scenarios and of studies."""
    published = mixed.override("plant.initial_pose", "published")
    assert published.with_subject("female, 1.80 m, 67.54377325440001 kg").system().parameters["plant.body_mass"] > 0
    words = "published: is the height of the base person.* set plant.initial_pose=touching"
    for other in (
        lambda: published.with_subject(WOMAN).system(),
        lambda: published.override("plant.foot_scale_x", 0.95).system(),
        lambda: sc.load_study("population_mixed").override("plant.initial_pose", "published").checked(),
    ):
        with pytest.raises(InputError, match=words + "$"):
            other()
    study = sc.load_study("study6")
    with pytest.raises(InputError, match=words + " and plant.fibre_start=equilibrium$"):
        study.with_subject(WOMAN).checked()
    varied = replace(
        study,
        marginals={**study.marginals, "plant.foot_scale_x": Normal(1.0, 0.05)},
        units={**study.units, "plant.foot_scale_x": ""},
    )
    with pytest.raises(InputError, match=words):
        varied.checked()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--set", "plant.initial_pose=given", "--set", "plant.pelvis_ty_at_contact=0.7 m"), "mm inside the platform"),
        (("--set", "plant.platform_edge_distance=-0.9 m"), "no part of the sole is on this side"),
    ],
)
def test_a_landing_that_cannot_start_is_bad_input(
    options: tuple[str, ...],
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in (("run",), ("compare", "--brace", "a=brace_linear", "--out", "never", "--progress", "none")):
        monkeypatch.setattr("sys.argv", ["sprain-cosim", command[0], "incline30", *options, *command[1:]])
        with pytest.raises(SystemExit) as end:
            main()
        lines = capsys.readouterr().err.splitlines()
        assert end.value.code == 2
        assert [line for line in lines if line.startswith("error: ") and words in line] == lines[-1:]


def test_rows_that_are_no_persons_are_named_before_any_landing(tmp_path: Path) -> None:
    table = tmp_path / "team.csv"
    table.write_text(
        "trial,subject.sex,subject.stature [in],subject.trochanterion_height [m]\n3,female,64,0.85\n7,male,71,0.3\n"
    )
    with pytest.raises(InputError, match=r"team.csv: trial 7: subject: the measures leave a thigh length of -15 mm"):
        sc.load_study("population_mixed").with_inputs(table)


def test_a_person_takes_the_place_of_what_the_scenario_says_of_one(tmp_path: Path) -> None:
    """Factors in a file, as of a scaled model or of an SSP package, are another person's."""
    other = tmp_path / "other.toml"
    other.write_text(
        'base = "incline30_mixed"\n[parameters]\n"plant.body_mass" = "90 kg"\n"plant.foot_scale_x" = 1.2\n'
    )
    bare, plain = load_scenario(other), load_scenario("incline30_mixed").with_subject(WOMAN).system().parameters
    woman = bare.with_subject(WOMAN)
    assert woman.system().parameters == plain
    assert woman.warnings[-1] == (
        "subject: takes the place of plant.body_mass, plant.foot_scale_x, which the scenario set"
    )
    heir = tmp_path / "heir.toml"
    who = '[subject]\nsex = "female"\nstature = "1.63 m"\nmass = "62 kg"\n'
    heir.write_text(f'base = "other.toml"\n{who}')
    assert load_scenario(heir).system().parameters == plain
    own = tmp_path / "own.toml"
    own.write_text(f'base = "other.toml"\n{who}[parameters]\n"plant.foot_scale_x" = 1.1\n')
    stated = load_scenario(own)
    assert stated.system().parameters == {**plain, "plant.foot_scale_x": 1.1}
    assert stated.heading.startswith("30° slope, woman, 1.63 m, 62 kg, foot_scale_x 1.1, 150 % brace")
    study = tmp_path / "study.toml"
    study.write_text('scenario = "other.toml"\n[population]\nmen = 1\n[study]\ntrials = 20\n')
    men = sc.load_study(study)
    assert not {"plant.body_mass", "plant.foot_scale_x"} & men.scenario.parameters.keys()
    assert any("takes the place of plant.body_mass" in line for line in men.warnings)
    lax = bare.override("plant.passive_x_linear", "20 N.m/rad")
    with pytest.raises(InputError, match=r"mass times stature contradicts plant.passive_x_linear, which the scenario"):
        lax.with_subject(f"{WOMAN}, passive mass-height")
    assert lax.with_subject(WOMAN).parameters["plant.passive_x_linear"] == "20 N.m/rad"
    idle = stated.without_effect(["subject.mass"])
    assert idle == ["plant.foot_scale_x: set by the scenario, so that subject.mass cannot move it"]


def test_the_doubt_of_a_person_is_the_spread_of_people_who_share_what_is_known() -> None:
    subject = parse_subject("female, 1.63 m, 62 kg")
    names, centre, covariance = anthropometry("female").rest(subject.measures)
    scenario = load_scenario("incline30").with_subject(subject)
    people = np.random.default_rng(3).multivariate_normal(centre, covariance, 60)
    with scenario.open() as session:
        peaks = [
            session.run({f"{OWNER}{n}": v for n, v in zip(names, person, strict=True)}).metrics[PEAK]
            for person in people.tolist()
        ]
    result = scenario.run(halve=True)
    assert result.estimates_doubt == pytest.approx(np.std(peaks, ddof=1), rel=3 / np.sqrt(2 * 59))
    assert result.estimates_doubt > 20 * result.coupling_doubt  # deg: the step is not what is uncertain
    everything = replace(subject, measures={**subject.measures, **dict(zip(names, centre.tolist(), strict=True))})
    assert load_scenario("incline30").with_subject(everything).run(halve=True).estimates_doubt is None
    assert load_scenario("incline30").run(halve=True).estimates_doubt is None
