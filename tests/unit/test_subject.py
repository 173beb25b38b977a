"""Persons and populations, as far as no landing is needed: words, estimates, factors, samples."""

from __future__ import annotations

import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtrc, ndtri

from sprain_cosim.errors import InputError
from sprain_cosim.scenario.body import OWNER, SEX
from sprain_cosim.study.codec import decode, encode
from sprain_cosim.study.population import Population, population_of
from sprain_cosim.subject import Person, Subject, anthropometry, base_person, parse_subject
from sprain_cosim.subject.anthropometry import MASS, MEASURES, SEXES, Anthropometry
from sprain_cosim.subject.person import BASE, SCALING, SEGMENTS
from sprain_cosim.uq import sampling
from sprain_cosim.uq.distributions import Mixture, Normal
from tests.reference import needs_reference
from tools.reference import FOLDER

N, SEED = 4000, 3  # one in two seeds has one of some 200 comparisons beyond three standard errors, by chance


def scaled(subject: Subject) -> dict[str, float]:
    return {name: value for name, value in subject.parameters().items() if "_scale_" in name}


def test_the_base_person_has_factors_of_one_to_the_bit() -> None:
    assert set(scaled(BASE).values()) == {1.0}
    assert len(scaled(BASE)) == 3 * len(SEGMENTS)
    assert BASE.parameters()["body_mass"] == 67.54377325440001
    text = parse_subject("female, 180 cm, 67.54377325440001 kg")
    assert set(scaled(text).values()) == {1.0}
    assert (base_person().force_factor, base_person().size) == (1.0, 1.0)


def test_an_estimate_is_the_conditional_mean_and_says_what_it_leaves_open() -> None:
    """Against the closed form of two variables; a given measure is itself, and none given gives the table."""
    table = anthropometry("female")
    person = Person.estimated("female", {"stature": 1.70})
    rho, ratio = 0.7222, table.sd["foot_length"] / table.sd["stature"]
    expected = table.mean["foot_length"] + rho * ratio * (1.70 - table.mean["stature"])
    assert person.measures["foot_length"] == pytest.approx(expected, rel=1e-12)
    assert person.sd["foot_length"] == pytest.approx(table.sd["foot_length"] * math.sqrt(1 - rho**2), rel=1e-12)
    assert (person.measures["stature"], person.sd["stature"]) == (1.70, 0.0)
    anybody = Person.estimated("male", {})
    assert anybody.measures == pytest.approx(dict(anthropometry("male").mean), rel=1e-12)
    assert anybody.sd == pytest.approx(dict(anthropometry("male").sd), rel=1e-12)


def test_factors_follow_the_measures() -> None:
    longer = Subject("female", {**base_person().measures, "foot_length": 1.1 * base_person().measures["foot_length"]})
    assert scaled(longer)["foot_scale_x"] == pytest.approx(1.1, rel=1e-12)
    assert [v for k, v in scaled(longer).items() if k != "foot_scale_x"] == pytest.approx([1.0] * 14)
    stated = parse_subject("female, 1.63 m, 62 kg, foot_scale 1.05")
    assert [scaled(stated)[f"foot_scale_{axis}"] for axis in "xyz"] == [1.05] * 3
    small, tall = (scaled(Subject("female", {"stature": s, MASS: 60.0})) for s in (1.55, 1.75))
    assert all(small[name] < tall[name] for name in small if not name.startswith(("pelvis", "foot_scale_z")))


def test_rules_by_name_are_none_of_the_default() -> None:
    plain, strong = (Subject("male", {"stature": 1.85, MASS: 95.0}, force=f) for f in ("scale-tool", "handsfield"))
    assert "muscle_force_scale" not in plain.parameters()
    assert plain.rules == ()
    volume = (47.05 * 1.85 * 95.0 + 1289.6) / (47.05 * 1.80 * 67.54377325440001 + 1289.6)
    factor = strong.parameters()["muscle_force_scale"]
    assert 1.0 < factor == pytest.approx(volume * base_person()._leg / Person.of(strong)._leg, rel=1e-12)
    assert "Handsfield" in strong.words
    lax = Subject("male", {"stature": 1.85, MASS: 95.0}, passive="mass-height")
    assert lax.parameters()["passive_x_cubic"] == pytest.approx(1.85 * 95 / (1.80 * 67.54377325440001), rel=1e-12)
    assert "passive" in lax.words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("female, 1.63 m, 62 kg", "woman, 1.63 m, 62 kg"),
        ("62 kg, 163cm, f", "woman, 1.63 m, 62 kg"),
        ("female,\u00a01.63\u00a0m,\u202f62\u2009kg,", "woman, 1.63 m, 62 kg"),
        ("female, 5 ft 4 in, 9 st 10, aged 30", "woman, 1.626 m, 61.69 kg"),
        ("female, 1.63 m, 62 kg, force: Handsfield", "woman, 1.63 m, 62 kg, isometric force by muscle volume"),
        ("man, 30 years, mass 180 lb, height = 5.9 ft", "man, 1.798 m, 81.65 kg"),
        ("male, 1.8 m, foot length 27 cm", "man, 1.8 m, foot length 0.27 m"),
    ],
)
def test_a_person_in_words(text: str, words: str) -> None:
    assert parse_subject(text).words.startswith(words)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("1.63 m, 62 kg", "says no sex"),
        ("female, 1,63 m", "decimal comma"),
        ("female, 1.63, 62 kg", "'1.63' has no unit; write \"1.63 m\""),
        ("female, 62 degC", "neither a length nor a mass"),
        ("female, 1.63 furlong", "unknown symbol 'furlong'"),
        ("fmale, 1.6 m", "did you mean female?"),
        ("female, 1.6 m, 1.7 m", "stature is given twice"),
        ("female, foot lenght 24 cm", "did you mean foot_length?"),
        ("female, foot length 24 kg", "foot_length = '24 kg': kg is no unit of a length; write \"24 cm\""),
        ("female, height 163 kg", 'write "163 cm"'),
        ("female, mass 1.63 m", 'm is no unit of a mass; write "6'),
        ("female, foot length 24", 'needs a unit, for example "24 cm"'),
        ("female, 163 cm, 62", '\'62\' has no unit; write "62 kg" or "62 years"'),
        ("163", 'write "163 cm" or'),
        ("163 cm 62", "cannot read '163 cm 62'; write one number with its unit between commas"),
        ("woman, 1m63", "cannot read '1m63'; write one number"),
        ("female, 1.63 +- 0.05 m", "write one number with its unit"),
        ("female; 1.63 m; 62 kg", "write commas (,) between the parts"),
        ("female，1.63 m", "write commas (,) between the parts"),
        ("female, 1.63 kg", "mass = 1.63 kg: no adult's (13.6 ... 342 kg is taken); did you mean a stature of 1.63 m?"),
        ("female, 62 m", "did you mean a mass of 62 kg?"),
        ("female, 1.63 mm", "did you mean 1.63 m?"),
        ("female, foot length 24 m", "did you mean 0.24 m?"),
        ("female, 62 cm, 163 kg", 'the units are exchanged, write "163 cm, 62 kg"'),
        ("female, 5'14\"", "14 in are more than a foot"),
        ("female, 9 st 20", "20 lb are more than a stone"),
        ("female, m, 1.63 m", "sex is given twice, as 'female' and 'm'"),
        ("hat", "cannot read 'hat' as a sex or a quantity"),
        (" , ", "names nobody"),
        ("female, 0 m", "stature = 0: must be positive"),
        ("girl, 12 years, 1.5 m", "cannot read 'girl'"),
        ("female, 16 years, 1.6 m", "age 16"),
        ("female, 1.6 m, force strong", "must be scale-tool or handsfield"),
        ("female, lateral epicondyle height 1.2 m, trochanterion height 0.8 m", "leave a thigh length of -400 mm"),
        ("", "names nobody"),
        ("female 1.63 m 62 kg", "write commas between the parts"),
        ("female, 163 m", "stature = 163 m: no adult's (0.326 ... 7.02 m is taken); did you mean 1.63 m?"),
        ("female, foot length 240 m", "foot_length = 240 m: no adult's"),
        ("female, age 12", "age 12: those measured were 17 to 58"),
        ("female, age -5", "age -5: must lie between 0 and 120 years"),
        ("female, 250 years", "age 250: must lie between 0 and 120 years"),
        ("female, age 30, 31 years", "age is given twice"),
        ("female, sex male", "sex is given twice"),
        ("female, 62 kg, 8 stone", "mass is given twice"),
        ("female, nan m", "cannot read 'nan m'"),
        ("female, -1.63 m", "stature = -1.63: must be positive"),
        ("female, foot_scale -1", "foot_scale = -1: must be positive"),
        ("female, 1.63 x", "unknown symbol 'x'; write a person as \"female, 1.63 m, 62 kg\""),
    ],
)
def test_words_that_are_no_person_get_one_line(text: str, part: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_subject(text)
    assert part in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        "64 in, 137 lb",
        "5 ft 4 in, 137 lbs",
        "5'4\", 9 st 11 lb",
        "64 inches, 137 pounds",
        "5ft 4, 9.785714285714286 stone",
    ],
)
def test_feet_and_pounds_as_people_write_them(text: str) -> None:
    found = parse_subject(f"female, {text}, age 30 years").measures
    assert found["stature"] == pytest.approx(64 * 0.0254, rel=1e-12)
    assert found["mass"] == pytest.approx(137 * 0.45359237, rel=1e-12)
    assert parse_subject("Female, 1.63M, 62 KG").measures == {"stature": 1.63, "mass": 62.0}


def test_unusual_measures_are_told() -> None:
    assert parse_subject("female, 1.63 m, 62 kg").warnings == ()
    (one,) = parse_subject("male, 2.10 m, 110 kg").warnings
    assert "stature 2.1 m is by their law above all 4082 men measured; " in one
    (short,) = parse_subject("female, 1.42 m, 50 kg").warnings
    assert "stature 1.42 m is below all but 0.06 % of the women measured; " in short
    beside = parse_subject("female, 1.75 m, foot length 23 cm").warnings
    assert any("measured with stature 1.75 m" in line for line in beside)
    assert "age 70" in parse_subject("female, 1.63 m, 62 kg, 70 years").warnings[0]
    assert "68 kg is estimated, which leaves ± 9 kg open" in parse_subject("female, 1.63 m").warnings[0]
    assert (
        "stature is not stated; 161 cm is estimated, which leaves ± 5 cm open"
        in parse_subject("female, 62 kg").warnings[0]
    )


def test_a_tail_of_a_fitted_law_is_no_share_of_people() -> None:
    """1986 women say nothing of 1 in 10 million."""
    for text in ("female, 1.63 m, 20 kg", "male, 2.2 m", "female, 1.63 m, 62 kg, foot length 32 cm"):
        for line in parse_subject(text).warnings:
            for share in re.findall(r"all but (\S+) %", line):
                assert float(share) / 100 >= 1 / 4082, line


def test_what_estimates_leave_open_is_that_of_people_who_share_what_is_known() -> None:
    """The covariance of the directions is the table's, given what is known."""
    subject = parse_subject("female, 1.63 m, 62 kg")
    names, centre, covariance = anthropometry("female").rest(subject.measures)
    at = [k for k, name in enumerate(names) if name in SCALING]
    off = np.array([[d[names[k]] - centre[k] for k in at] for d in subject.deviations])
    assert off.T @ off == pytest.approx(covariance[np.ix_(at, at)], abs=1e-12)
    assert parse_subject("female, 1.63 m").deviations[0].keys() >= {MASS}


def test_descriptions_travel() -> None:
    subject = parse_subject("female, 1.63 m, 62 kg, foot_scale 1.05")
    population = Population({"female": 0.5, "male": 0.5}, fixed={"stature": 1.7})
    for value in (subject, population):
        assert pickle.loads(pickle.dumps(value)) == value
        assert decode(encode(value)) == value


# ---- populations


def drawn(population: Population, seed: int = SEED) -> tuple[np.ndarray, list[str]]:
    marginals = population.marginals
    joint = population.joint(marginals, population.correlations(list(marginals), None))
    return sampling.monte_carlo(joint, N, seed), list(marginals)


def deviations(x: np.ndarray, names: list[str], table: Anthropometry) -> np.ndarray:
    """Of a sample's means, SD and correlations (in Fisher's z, the mass's by its logarithm) from the table's, in
    standard errors."""
    shown = [name.removeprefix(OWNER) for name in names]
    n, found = len(x), []
    for k, name in enumerate(shown):
        mean, sd = table.mean[name], table.sd[name]
        skewed = math.sqrt((np.mean((x[:, k] - mean) ** 4) / sd**4 - 1) / 4)
        found += [(np.mean(x[:, k]) - mean) / sd, (np.std(x[:, k], ddof=1) - sd) / (sd * skewed)]
    z = np.column_stack([np.log(x[:, k]) if name == MASS else x[:, k] for k, name in enumerate(shown)])
    at = [table.names.index(name) for name in shown]
    above = np.triu_indices(len(at), 1)
    gap = np.arctanh(np.corrcoef(z.T)[above]) - np.arctanh(table.correlation[np.ix_(at, at)][above])
    return np.array([*(math.sqrt(n) * f for f in found), *(math.sqrt(n - 3) * gap)])


def moments(x: np.ndarray, names: list[str], sex: str) -> None:
    """Means, SD and correlations of a sample are the table's within three standard errors."""
    assert np.abs(deviations(x, names, anthropometry(sex))).max() < 3


def scores(table: Anthropometry, name: str, values: np.ndarray) -> np.ndarray:
    """Standard scores of a measure, which are straight in its value or, of the mass, in its logarithm."""
    ends = table.mean[name] * np.array([0.9, 1.1])
    along = [np.log(v) if name == MASS else v for v in (values, ends)]
    low, high = (table.score(name, end) for end in ends)
    return low + (high - low) * (along[0] - along[1][0]) / (along[1][1] - along[1][0])


def chi_squares(x: np.ndarray, names: list[str], table: Anthropometry) -> dict[str, tuple[float, int]]:
    """{what is tested: (statistic, degrees of freedom)} of a sample against the table's law as a whole.

    Its scores, made independent by the table's correlations, are standard normal: their mean (Hotelling's T²,
    covariance known) and their second moments (likelihood ratio; T. W. Anderson, An Introduction to Multivariate
    Statistical Analysis, 3rd ed., 10.8)."""
    shown = [name.removeprefix(OWNER) for name in names]
    at = [table.names.index(name) for name in shown]
    z = np.column_stack([scores(table, name, x[:, k]) for k, name in enumerate(shown)])
    w = np.linalg.solve(np.linalg.cholesky(table.correlation[np.ix_(at, at)]), z.T)
    p, n = w.shape
    second = w @ w.T / n
    ratio = n * (np.trace(second) - np.linalg.slogdet(second)[1] - p)
    return {"mean": (n * float(np.sum(w.mean(axis=1) ** 2)), p), "spread": (float(ratio), p * (p + 1) // 2)}


@pytest.mark.parametrize("sex", SEXES)
def test_a_sampled_population_is_the_table(sex: str) -> None:
    x, names = drawn(Population({sex: 1.0}))
    assert names == [OWNER + name for name in SCALING]
    moments(x, names, sex)


def test_a_mixed_population_is_the_table_within_each_sex() -> None:
    x, names = drawn(Population({"female": 0.3, "male": 0.7}))
    assert names[0] == SEX
    women = x[:, 0] == 0.0
    assert abs(women.mean() - 0.3) < 3 * math.sqrt(0.3 * 0.7 / N)
    moments(x[women, 1:], names[1:], "female")
    moments(x[~women, 1:], names[1:], "male")
    masses = x[:, names.index("subject.mass")]
    assert np.all(masses > 0)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0], ids=["men", "mixed", "women"])
def test_sampled_populations_are_the_table_whatever_the_seed(share: float) -> None:
    """Ten seeds. All comparisons of means, SD and correlations together by Bonferroni's bound, and the law as a whole
    by chi-square, each seed by itself (Holm) and all together: a right sampler fails one of a thousand such tests."""
    alarm = 1e-3 / 3  # of each of the three statements
    worst, count, tests = 0.0, 0, dict[str, list[tuple[float, int]]]()
    for seed in range(10):
        x, names = drawn(Population({sex: s for sex, s in (("female", share), ("male", 1.0 - share)) if s}), seed)
        mixed = names[0] == SEX
        for number, sex in enumerate(SEXES):
            rows = x[x[:, 0] == number, 1:] if mixed else x
            if (mixed or sex == SEXES[share == 0.0]) and len(rows):
                found = deviations(rows, names[mixed:], anthropometry(sex))
                worst, count = max(worst, float(np.abs(found).max())), count + len(found)
                for what, test in chi_squares(rows, names[mixed:], anthropometry(sex)).items():
                    tests.setdefault(what, []).append(test)
    assert count in (10 * 54, 20 * 54)
    assert worst < ndtri(1.0 - 0.5 * alarm / count)
    single = [chdtrc(freedom, value) for found in tests.values() for value, freedom in found]
    assert min(single) > alarm / len(single)  # Holm's first step rejects none
    together = [chdtrc(sum(f for _, f in found), sum(v for v, _ in found)) for found in tests.values()]
    assert min(together) > alarm / len(together)


def test_that_test_meets_small_errors() -> None:
    """A foot 1 mm longer, a spread 10 % larger, one correlation 0.04 smaller, a normal mass: each in one sample."""
    x, names = drawn(Population({"female": 1.0}))
    table = anthropometry("female")
    longer = replace(table, mean={**table.mean, "foot_length": table.mean["foot_length"] + 1e-3})
    wider = replace(table, sd={**table.sd, "foot_breadth": 1.1 * table.sd["foot_breadth"]})
    one, other = table.names.index("stature"), table.names.index("foot_length")
    matrix = table.correlation.copy()
    matrix[one, other] -= 0.04
    matrix[other, one] = matrix[one, other]
    looser = replace(table, correlation=matrix)
    for wrong, what in ((longer, "mean"), (wider, "spread"), (looser, "spread")):
        value, freedom = chi_squares(x, names, wrong)[what]
        assert chdtrc(freedom, value) < 1e-6
    k = names.index("subject.mass")
    normal = x.copy()
    normal[:, k] = table.mean[MASS] + table.sd[MASS] * scores(table, MASS, x[:, k])
    assert chdtrc(*chi_squares(normal, names, table)["spread"][::-1]) < 1e-6


def test_the_mixture_of_two_laws_is_their_sum() -> None:
    law = Mixture((Normal(1.63, 0.064), Normal(1.76, 0.069)), (0.3, 0.7))
    u = np.linspace(-5, 5, 41)
    x = law.from_standard(u)
    np.testing.assert_allclose(law.to_standard(x), u, atol=1e-9)
    np.testing.assert_allclose(law.slope(u[1:-1]), np.gradient(law.from_standard(u), u)[1:-1], rtol=0.05)
    sample = law.from_standard(np.random.default_rng(1).standard_normal(200_000))
    assert law.mean == pytest.approx(sample.mean(), abs=5e-4)
    assert law.sd == pytest.approx(sample.std(), rel=5e-3)


def test_those_who_share_a_measure_are_the_conditional_population() -> None:
    tall = Population({"male": 1.0}).fixing("subject.stature", 1.90)
    x, names = drawn(tall)
    assert set(x[:, names.index("subject.stature")]) == {1.90}
    mean, sd = anthropometry("male").conditional({"stature": 1.90})
    for k, name in enumerate(names):
        own = name.removeprefix(OWNER)
        if own != "stature":
            assert abs(x[:, k].mean() - mean[own]) < 3 * sd[own] / math.sqrt(N), name
    assert Population({"female": 0.5, "male": 0.5}).fixing(SEX, 1.0).shares == {"male": 1.0}
    with pytest.raises(InputError, match="has no women"):
        tall.fixing(SEX, 0.0)


def test_a_population_as_a_file_states_it() -> None:
    population, subject = population_of({"women": 1, "men": 3, "force": "handsfield"}, "x: population")
    assert population.shares == {"female": 0.25, "male": 0.75}
    assert population.words == "population of women and men (25 : 75 %)"
    assert subject.force == "handsfield"
    with pytest.raises(InputError, match="needs women"):
        population_of({}, "x: population")


@needs_reference
def test_the_table_is_that_of_the_reference() -> None:
    import pandas as pd

    rows = pd.read_csv(FOLDER / "population" / "ansur2_marginals.csv")
    joined = pd.read_csv(FOLDER / "population" / "ansur2_correlations.csv")
    for sex in SEXES:
        table = anthropometry(sex)
        own = rows[rows["sex"] == sex]
        np.testing.assert_allclose(list(table.mean.values()), own["mean"], rtol=1e-5)
        np.testing.assert_allclose(list(table.sd.values()), own["sd"], rtol=1e-5)
        matrix = joined[joined["sex"] == sex].iloc[:, 2:].to_numpy(float)
        np.testing.assert_allclose(table.correlation, matrix, atol=1e-9)
        assert table.n == own["n"].iloc[0]
    assert len(MEASURES) == 15
