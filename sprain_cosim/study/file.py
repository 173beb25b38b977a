"""Study files: a scenario, the distributions of some of its parameters, and what to ask. `FILE` says what they may
hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .. import keys
from ..cosim.system import System
from ..errors import InputError, nearest, problems_to_error
from ..files import parse_toml, read_text
from ..fmu.element import Connector
from ..machine.here import SYSTEM
from ..scenario import Scenario, load_scenario
from ..scenario.body import is_of_subject
from ..scenario.file import PARAMETERS, VARIABLE
from ..scenario.title import RAN
from ..shipped import is_file, scenario_folder, shipped_scenarios, shipped_studies
from ..units import SECOND, quantity, shown_unit
from ..uq.distributions import Array, Exponential, JointDistribution, LogNormal, Marginal, Truncated, Weibull
from .goal import GRAMMAR as GOAL
from .goal import LANDINGS, Goal, parse_goal, varied_range
from .inputs import InputTable, parameter, unit_name, unusual_persons
from .marginals import DISTRIBUTION, NUMBER, Measurements, marginal
from .methods import METHODS
from .plan import BEFORE_SAMPLING, TOLERANCE
from .population import POPULATION, population_of
from .questions import THRESHOLD, law_name, questions_of, threshold_of, unit_of_response
from .study import Study
from .until import GRAMMAR as UNTIL
from .until import parse_untils

LEVELS = keys.simple(
    "probabilities",
    {
        "type": "array",
        "items": {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1},
        "minItems": 1,
    },
    lambda value: (
        isinstance(value, list) and bool(value) and all(isinstance(v, float | int) and 0 < v < 1 for v in value)
    ),
    "{at}: must be probabilities between 0 and 1, such as [0.05, 0.5, 0.95]",
    lambda value: tuple(float(v) for v in value),
)
TRIED = 1000  # persons
CUT = 0.05  # of its standard deviation by which a cut law may lie beside the one stated without a word
NARROW = math.radians(0.25)  # a smaller spread of an angle is likely to be radians written as degrees
NEEDS_SCENARIO = 'needs scenario = "the name of a scenario or a file"'
RESPONSE = "peak_subtalar_angle_deg"
CORRELATIONS = ("correlation", "rank_correlation")
T = TypeVar("T")


def _names(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, str) for v in value)


SETTINGS = keys.Table(
    (
        keys.Key(
            "method",
            keys.simple("name", {"enum": list(METHODS)}, lambda v: isinstance(v, str), "{at} = {value}: must be text"),
            f"how the trials are chosen: {', '.join(METHODS)}",
            "monte-carlo",
        ),
        keys.Key("trials", keys.whole(), "number of trials; of landings for method design", "1000, design 300"),
        keys.Key("seed", keys.whole(), "of everything random", "0"),
        keys.Key(
            "responses",
            keys.simple(
                "names",
                {"type": "array", "items": {"type": "string"}, "minItems": 1},
                _names,
                f'{{at}}: must be a list of metrics, such as ["{RESPONSE}"]',
                tuple,
            ),
            "metrics that tables and sensitivities are made of; a search and a stopping rule look at the first",
            RESPONSE,
        ),
        keys.Key(
            "half_width",
            keys.raw("quantity", NUMBER, "that of the first response"),
            "stopping rule: half width that the widest of the levels' intervals may have",
        ),
        keys.Key(
            "until",
            keys.simple(
                "text, or several",
                {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]},
                lambda value: isinstance(value, str) or _names(value),
                f"{{at}}: must be text, or a list of texts, such as {UNTIL}",
            ),
            f"stops when a number is known so narrowly, after `trials` at most: {UNTIL}; several have all to be known",
        ),
        keys.Key(
            "replicates",
            keys.whole(),
            "scrambled sequences of methods sobol and sobol-indices",
            "8; 1 for sobol-indices",
        ),
        keys.Key(
            "levels",
            LEVELS,
            "percentiles that tables show, a search looks for and a stopping rule watches",
            "[0.05, 0.5, 0.95]",
        ),
        keys.Key(
            "threshold",
            THRESHOLD,
            "asks how likely the first response exceeds it; what method form searches",
        ),
        keys.Key("space", keys.choice(("x", "u")), "of amv and hmv: inputs as they are, or standard normal", "x"),
        keys.Key("step", keys.positive(), "of differences, in standard deviations of the input", "0.1"),
        keys.Key(
            "difference",
            keys.choice(("forward", "central")),
            "how slopes are taken",
            "forward for mean-value and amv, else central",
        ),
        keys.Key(
            "tolerance",
            keys.positive(),
            "where a search ends, in standard deviations of the response",
            f"{TOLERANCE:g}; {BEFORE_SAMPLING:g} for form with check",
        ),
        keys.Key("budget", keys.whole(), "landings that a search may take at most", "2000"),
        keys.Key(
            "check",
            keys.flag(),
            "random landings test the levels of mean-value, amv, amv+, hmv; form goes on with second order and "
            "sampling about the design points",
            "true",
        ),
        keys.Key(
            "trial_limit",
            keys.measured(SECOND, above_zero=True),
            "wall time after which a landing is ended",
            "learned: 20 times the median of those before it, at least 10 s; 60 s for the first",
        ),
    )
)
QUESTION = keys.Table(
    (
        keys.Key("response", keys.text(), "a metric", needs=f'needs response = "{RESPONSE}"'),
        keys.Key(
            "above",
            THRESHOLD,
            "asks how likely the response exceeds this: a value, a distribution (with n, the specimens behind it), or "
            "low and high alone",
        ),
        keys.Key("levels", LEVELS, "asks for these percentiles of the response besides the study's own"),
    )
)
DESIGN = keys.Table(
    (
        keys.Key("goal", keys.text(), f"what must hold: {GOAL}", needs=f"needs goal = {GOAL}"),
        keys.Key(
            "vary",
            keys.Named(
                '"component.parameter"',
                keys.raw("quantities", {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}, "its own"),
                VARIABLE,
            ),
            "the range that is searched; of two parameters the first is searched at values of the second",
            needs='needs vary = { "component.parameter" = [low, high] }',
        ),
        keys.Key("find", keys.choice(("least", "largest")), "from which value on, or up to which", "where it holds"),
    )
)
FILE = keys.File(
    "study files",
    "study",
    "Many landings: a scenario, what varies in it, and what is asked.",
    keys.Table(
        (
            keys.Key(
                "scenario",
                keys.text(NEEDS_SCENARIO),
                "a file beside this one, or the name of a scenario that ships",
                needs=NEEDS_SCENARIO,
            ),
            keys.Key(
                "title",
                keys.text(),
                f"heading of tables and figures, followed by the changes that options make; {RAN} in it stands for "
                "what runs, at the means of what varies",
                "the scenario's",
            ),
            keys.Key("parameters", PARAMETERS, "values on top of the scenario's", "the scenario's"),
            keys.Key(
                "marginals",
                keys.Named('"component.parameter"', DISTRIBUTION, VARIABLE),
                "what varies: a distribution of a parameter",
            ),
            keys.Key(
                "population",
                POPULATION,
                "who lands: persons drawn from a population, whose measures are inputs",
                "one person, the scenario's",
            ),
            keys.Key(
                "grid",
                keys.Named(
                    '"component.parameter"',
                    keys.raw("quantities", {"type": "array", "items": NUMBER, "minItems": 1}, "its own"),
                    VARIABLE,
                ),
                "for method grid: the levels of a parameter",
            ),
            keys.Key(
                "correlation",
                keys.Named(
                    '"component.a, component.b"',
                    keys.raw("number", {"type": "number", "exclusiveMinimum": -1, "exclusiveMaximum": 1}),
                    r"^\S+\s*,\s*\S+$",
                ),
                "Pearson's correlation of two marginals, joined by a Gaussian copula",
                "0",
            ),
            keys.Key(
                "rank_correlation",
                keys.Named(
                    '"component.a, component.b"',
                    keys.raw("number", {"type": "number", "exclusiveMinimum": -1, "exclusiveMaximum": 1}),
                    r"^\S+\s*,\s*\S+$",
                ),
                "the same by Spearman's correlation, that of the ranks",
                "0",
            ),
            keys.Key("study", SETTINGS, "how many landings, and what is asked of them"),
            keys.Key("questions", keys.Tables(QUESTION), "what else is asked; several"),
            keys.Key("design", DESIGN, "method design: for which values of a parameter a goal holds"),
            keys.Key(
                "published",
                keys.raw("table", {"type": "object"}),
                "figures to print beside the results, with their `source`",
            ),
        )
    ),
)


def load_study(name: str | Path) -> Study:
    """A study from a file or the name of one that ships. Raises InputError with all problems.

    >>> import sprain_cosim as sc
    >>> study = sc.load_study("study6")
    >>> study.method, study.trials, study.units["plant.drop_height"]
    ('monte-carlo', 1000, 'm')
    """
    path = Path(name)
    if not is_file(path):
        path = scenario_folder() / "studies" / f"{name}.toml"
    if not is_file(path):
        if str(name) in shipped_scenarios():
            raise InputError(
                f"{name}: is a scenario, one landing; `sprain-cosim run {name}` runs it, a study varies it"
            )
        raise InputError(
            f"study {str(name)!r}: no such file, and none of that name ships{nearest(str(name), shipped_studies())}; "
            "`sprain-cosim list studies` shows them"
        )
    text = read_text(path)
    problems: list[str] = []
    raw = parse_toml(text, str(path))
    if raw.keys() & {"base", "components"} and "scenario" not in raw:
        raise InputError(
            f"{path}: is a scenario, one landing; `sprain-cosim run {SYSTEM.quoted(str(path))}` runs it, a study "
            f'file names it: scenario = "{path.name}"'
        )
    content: dict[str, Any] = FILE.table.read(raw, "", problems)
    if "scenario" not in content:
        problems_to_error(str(path), problems)
    try:
        scenario = _scenario(content, path, problems)
    except InputError as problem:
        problems_to_error(str(path), [*problems, str(problem)] if problems else [])
        raise
    _check_population(content, scenario, path)
    system = scenario.system()
    measured = Measurements(path.parent)

    def distribution(spec: Any, own: Connector, place: str) -> Marginal:
        return marginal(spec, own.unit, place, measured, own.value)

    marginals, units = _varied("marginals", content, system, problems, distribution)
    grid, units_of_grid = _varied("grid", content, system, problems, _levels)
    correlation = _correlation(content, marginals, problems)
    options = content.get("study", {})
    options |= _of_responses(options, problems, measured)
    questions = questions_of(content.get("questions", []), problems, measured)
    asked = _design(content.get("design"), options, system, problems)
    problems_to_error(str(path), problems)
    study = Study(
        title=content.get("title", ""),
        scenario=replace(scenario, changes=()) if "title" in content else scenario,
        marginals=marginals,
        units=units | units_of_grid,
        correlation=correlation,
        fits={n: measured.fits[f"marginals.{n}"] for n in marginals if f"marginals.{n}" in measured.fits},
        grid=grid,
        questions=questions,
        published=content.get("published", {}),
        source=path.stem if path.parent == scenario_folder() / "studies" else str(path),
        text=text,
        warnings=(
            *scenario.warnings,
            *(f"{place}: {warning}" for place, fit in measured.fits.items() for warning in fit.warnings),
            *(_narrow(n, m) for n, m in marginals.items() if _is_narrow(m, units[n])),
            *(line for n, m in marginals.items() for line in _unlike_stated(n, m, units[n], system)),
        ),
        **options,
    )
    study = _of_population(study, content, path)
    study = (study if asked is None else study.with_goal(*asked)).checked()
    return replace(study, warnings=(*study.warnings, *_unusual(study)))


def _unusual(study: Study) -> list[str]:
    """A warning where persons whose measures vary one by one lie outside what was measured of many."""
    persons = [name for name in study.marginals if is_of_subject(name)]
    if not persons or study.population is not None or study.scenario.subject is None:
        return []
    drawn = replace(study, method="monte-carlo", trials=TRIED).sample()
    columns = {name: column for name, column in zip(study.names, drawn.T, strict=True) if name in persons}
    lines = unusual_persons(InputTable(columns, study.units, tuple(range(TRIED))), study.scenario.subject)
    return [f"marginals: of persons drawn from them, {line}" for line in lines]


def _check_population(content: Mapping[str, Any], scenario: Scenario, path: Path) -> None:
    """Raises InputError for persons described twice."""
    varied = [name for table in ("marginals", "grid") for name in content.get(table, {}) if is_of_subject(name)]
    who = varied or (["the scenario's [subject]"] if scenario.subject else [])
    if "population" in content and who:
        raise InputError(f"{path}: population: {who[0]} describes persons too; keep one of the two")


def _of_population(study: Study, content: Mapping[str, Any], path: Path) -> Study:
    if "population" not in content:
        return study
    population, rules = population_of(content["population"], f"{path}: population")
    return study.with_population(population, rules, kept=content.get("parameters", {}))


def _design(
    spec: Mapping[str, Any] | None, options: Mapping[str, Any], system: System, problems: list[str]
) -> tuple[Goal, dict[str, tuple[float, float]], dict[str, str], int] | None:
    """What Plan.with_goal takes; None for a study without [design]."""
    if spec is None or problems:
        return None
    if options.get("method", "design") != "design":
        problems.append(f'study.method = "{options["method"]}": [design] goes with method design alone')
    vary, units = dict[str, tuple[float, float]](), dict[str, str]()
    try:
        for name, ends in spec["vary"].items():
            vary[name], units[name] = varied_range(name, ends, system, f"design.vary.{name}")
        return parse_goal(spec["goal"], spec.get("find"), "design.goal"), vary, units, options.get("trials", LANDINGS)
    except InputError as problem:
        problems.append(str(problem))
    return None


def _scenario(content: Mapping[str, Any], path: Path, problems: list[str]) -> Scenario:
    """The study's scenario with the parameters of the study on top."""
    beside = path.parent / content["scenario"]
    scenario = load_scenario(beside if is_file(beside) else content["scenario"])
    for key, value in content.get("parameters", {}).items():
        try:
            scenario = scenario.override(key, value)
        except InputError as problem:
            problems.append(f"parameters.{problem}")
    return scenario


def _varied(
    table: str,
    content: Mapping[str, Any],
    system: System,
    problems: list[str],
    read: Callable[[Any, Connector, str], T],
) -> tuple[dict[str, T], dict[str, str]]:
    """What stands in a table of parameters that vary, and their units."""
    found, units = dict[str, T](), dict[str, str]()
    for key, spec in content.get(table, {}).items():
        place = f"{table}.{key}"
        try:
            own = parameter(system, key, isinstance(spec, dict) and "choices" in spec)
            units[key] = unit_name(own.unit)
            found[key] = read(spec, own, place)
        except (InputError, ValueError) as problem:
            known = isinstance(problem, InputError) and place in str(problem)
            problems.append(str(problem) if known else f"{place}: {problem}")
    return found, units


def _is_narrow(marginal: Marginal, unit: str) -> bool:
    return unit == "rad" and 0 < marginal.sd < NARROW


def _narrow(name: str, marginal: Marginal) -> str:
    return (
        f"marginals.{name}: a standard deviation of {math.degrees(marginal.sd):.3g} deg is very small; are these "
        "radians written as degrees?"
    )


def _unlike_stated(name: str, marginal: Marginal, unit: str, system: System) -> Iterator[str]:
    """What a law is that its numbers do not show: cut, or counted from the zero of a unit that has one of its own."""
    law, own = marginal, system.find(name).unit
    if isinstance(marginal, Truncated):
        law = marginal.parent
        if max(abs(marginal.mean - law.mean), abs(marginal.sd - law.sd)) > CUT * law.sd:
            factor, shown = shown_unit(unit)
            drawn, stated = (
                f"{factor * m.mean + 0.0:.4g} ± {factor * m.sd:.3g} {shown}".rstrip() for m in (marginal, law)
            )
            yield f"marginals.{name}: low and high cut it: what is drawn has {drawn} (mean ± SD), not {stated}"
    if own is not None and own.offset and isinstance(law, LogNormal | Weibull | Exponential):
        kind = law_name(type(law).__name__.lower())
        yield f"marginals.{name}: {kind} counts from 0 {unit}; from the zero of another unit it is another law"


def _levels(spec: Any, own: Connector, place: str) -> tuple[float, ...]:
    if not isinstance(spec, list) or not spec:
        raise InputError(f"{place}: must be a list of levels, such as [0, 5, 10]")
    return tuple(quantity(v, own.unit, place) for v in spec)


def _correlation(content: Mapping[str, Any], marginals: Mapping[str, Marginal], problems: list[str]) -> Array | None:
    """Pearson's, whichever of the two is stated."""
    names, matrix, stated = list(marginals), np.eye(len(marginals)), dict[frozenset[str], str]()
    for table in CORRELATIONS:
        for pair, rho in content.get(table, {}).items():
            place, both = f"{table}.{pair}", [p.strip() for p in pair.split(",")]
            unknown = [p for p in both if p not in names]
            if len(both) != 2 or unknown or both[0] == both[-1]:
                where = (
                    f"no marginal {unknown[0]!r}{nearest(unknown[0], names)}"
                    if unknown
                    else 'write "component.a, component.b" = 0.3'
                )
                problems.append(f"{place}: {where}")
            elif isinstance(rho, bool) or not isinstance(rho, int | float) or not -1 < rho < 1:
                problems.append(f"{place} = {rho!r}: must be a number between -1 and 1")
            else:
                if (other := stated.setdefault(frozenset(both), place)) != place:
                    problems.append(f"{place}: is stated twice, also as {_in_words(other, table)}; remove one")
                i, j = (names.index(name) for name in both)
                try:
                    matrix[i, j] = matrix[j, i] = rho if table == CORRELATIONS[0] else _pearson(marginals, both, rho)
                except ValueError as problem:
                    problems.append(f"{place}: {str(problem).removeprefix('inputs 0 and 1: ')}")
    return matrix if stated else None


def _in_words(place: str, table: str) -> str:
    """The pair alone where it stands in the same table."""
    other, _, pair = place.partition(".")
    return repr(pair) if other == table else place


def _pearson(marginals: Mapping[str, Marginal], pair: Sequence[str], spearman: float) -> float:
    """Pearson's correlation of two marginals whose ranks have this one."""
    joint = JointDistribution([marginals[name] for name in pair], [[1.0, spearman], [spearman, 1.0]], "spearman")
    return 0.0 if joint.correlation is None else float(joint.correlation[0, 1])


def _of_responses(options: Mapping[str, Any], problems: list[str], measured: Measurements) -> dict[str, Any]:
    """The settings that are values of responses: threshold, half_width, until."""
    own, found = unit_of_response(options.get("responses", (RESPONSE,))[0]), dict[str, Any]()
    for key in ("threshold", "half_width"):
        if key not in options:
            continue
        place, spec = f"study.{key}", options[key]
        try:
            found[key] = threshold_of(spec, own, place, measured) if key == "threshold" else quantity(spec, own, place)
        except (InputError, ValueError) as problem:
            problems.append(str(problem) if place in str(problem) else f"{place}: {problem}")
    try:
        if "until" in options:
            found["until"] = parse_untils(options["until"], options.get("responses", (RESPONSE,))[0], "study.until")
    except InputError as problem:
        problems.append(str(problem))
    if not found.get("half_width", 1.0) > 0:
        problems.append("study.half_width: must be a positive value of the first response")
    return found
