"""Study files: a scenario, the distributions of some of its parameters, and what to ask.

scenario = "incline30_mixed"
[parameters]    "plant.initial_pose" = "published"          on top of the scenario's
[marginals]     "plant.drop_height" = { lognormal = { mean = "0.30 m", sd = "0.05 m" } }
                mean and sd of the variable itself; normal, lognormal, uniform = { low, high }, fixed = value;
                `low` and `high` beside normal or lognormal truncate it
[grid]          "controller.reflex_gain" = [0, 5, 10]       for method grid
[correlation]   "plant.a, plant.b" = 0.3                    Pearson, Gaussian copula
[study]         method, trials, seed, responses; half_width = "0.5 deg" (stopping rule: the widest of the levels'
                intervals); replicates for sobol and sobol-indices; levels, space, step, difference, tolerance, budget
                for searches; threshold for form: a value of the first response, or a distribution of it
[published]     figures to print beside the results, with their source
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, nearest, problems_to_error
from ..files import parse_toml, read_text
from ..fmu.element import Connector
from ..metrics import unit_of
from ..scenario import load_scenario
from ..shipped import scenario_folder, shipped_studies
from ..units import Unit, quantity, unit
from ..uq.distributions import Array, Fixed, LogNormal, Marginal, Normal, Truncated, Uniform
from .inputs import parameter, unit_name
from .study import Study

KEYS = ("scenario", "title", "parameters", "marginals", "grid", "correlation", "study", "published")
STUDY_KEYS = (
    "method",
    "trials",
    "seed",
    "responses",
    "half_width",
    "replicates",
    "levels",
    "threshold",
    "space",
    "step",
    "difference",
    "tolerance",
    "budget",
)
NARROW = math.radians(0.25)  # a smaller spread of an angle is likely to be radians written as degrees


def load_study(name: str | Path) -> Study:
    """A study from a file or the name of one that ships. Raises InputError with all problems."""
    path = Path(name)
    if not path.is_file():
        path = scenario_folder() / "studies" / f"{name}.toml"
    if not path.is_file():
        raise InputError(
            f"study {str(name)!r}: no such file, and none of that name ships{nearest(str(name), shipped_studies())}"
        )
    text = read_text(path)
    content = parse_toml(text, str(path))
    problems = [f"unknown key {key!r}{nearest(key, KEYS)}" for key in content if key not in KEYS]
    problems += [f"{key}: must be a table, [{key}]" for key in KEYS[2:] if not isinstance(content.get(key, {}), dict)]
    if not isinstance(content.get("scenario"), str):
        problems.append('needs scenario = "the name of a scenario or a file"')
    problems_to_error(str(path), problems)
    named = content["scenario"]
    beside = path.parent / named
    scenario = load_scenario(beside if beside.is_file() else named)
    for key, value in content.get("parameters", {}).items():
        try:
            scenario = scenario.override(key, value)
        except InputError as problem:
            problems.append(f"parameters.{problem}")
    system = scenario.system()
    marginals, grid, units = dict[str, Marginal](), dict[str, tuple[float, ...]](), dict[str, str]()
    for table in ("marginals", "grid"):
        for key, spec in content.get(table, {}).items():
            what = f"{table}.{key}"
            try:
                connector = parameter(system, key)
                units[key] = unit_name(connector.unit)
                if table == "marginals":
                    marginals[key] = _marginal(spec, connector.unit, what)
                else:
                    grid[key] = _levels(spec, connector, what)
            except InputError as problem:
                problems.append(str(problem) if what in str(problem) else f"{what}: {problem}")
            except ValueError as problem:
                problems.append(f"{what}: {problem}")
    correlation = _correlation(content.get("correlation", {}), list(marginals), problems)
    options = _options(content.get("study", {}), problems)
    problems_to_error(str(path), problems)
    return Study(
        title=content.get("title", scenario.title),
        scenario=scenario,
        marginals=marginals,
        units=units,
        correlation=correlation,
        grid=grid,
        published=content.get("published", {}),
        source=path.stem if path.parent == scenario_folder() / "studies" else str(path),
        text=text,
        warnings=scenario.warnings
        + tuple(
            _narrow(name, marginals[name])
            for name in marginals
            if units[name] == "rad" and 0 < marginals[name].sd < NARROW
        ),
        **options,
    ).checked()


def _narrow(name: str, marginal: Marginal) -> str:
    return (
        f"marginals.{name}: a standard deviation of {math.degrees(marginal.sd):.3g} deg is very small; are these "
        "radians written as degrees?"
    )


def _marginal(spec: Any, own: Unit | None, what: str) -> Marginal:
    kinds = ("normal", "lognormal", "uniform", "fixed")
    if not isinstance(spec, dict):
        raise InputError(f'{what}: must be a distribution, such as {{ normal = {{ mean = "30 deg", sd = "5 deg" }} }}')
    given = [k for k in spec if k in kinds]
    strange = [k for k in spec if k not in (*kinds, "low", "high")]
    if strange or len(given) != 1:
        raise InputError(
            f"{what}: unknown {strange[0]!r}{nearest(strange[0], kinds)}"
            if strange
            else f"{what}: needs exactly one of {', '.join(kinds)}"
        )
    kind = given[0]

    def number(table: Mapping[str, Any], key: str) -> float:
        if key not in table:
            raise InputError(f"{what}: {kind} needs {key}")
        return quantity(table[key], own, f"{what}.{key}")

    ends = {k: number(spec, k) for k in ("low", "high") if k in spec}
    if kind == "fixed":
        if ends:
            raise InputError(f"{what}: a fixed value has no low or high")
        return Fixed(quantity(spec["fixed"], own, what))
    inner = spec[kind]
    wanted = ("low", "high") if kind == "uniform" else ("mean", "sd")
    if not isinstance(inner, dict) or set(inner) != set(wanted):
        raise InputError(f"{what}: {kind} = {{ {wanted[0]} = ..., {wanted[1]} = ... }}")
    first, second = number(inner, wanted[0]), number(inner, wanted[1])
    if kind == "uniform":
        if ends:
            raise InputError(f"{what}: low and high belong inside uniform")
        return Uniform(first, second)
    if kind == "lognormal" and first == 0 and second == 0:
        raise InputError(f"{what}: a lognormal cannot be 0; write {{ fixed = 0 }}")
    parent = Normal(first, second) if kind == "normal" else LogNormal(first, second)
    return Truncated(parent, ends.get("low", -math.inf), ends.get("high", math.inf)) if ends else parent


def _levels(spec: Any, connector: Connector, what: str) -> tuple[float, ...]:
    if not isinstance(spec, list) or not spec:
        raise InputError(f"{what}: must be a list of levels, such as [0, 5, 10]")
    return tuple(quantity(v, connector.unit, what) for v in spec)


def _correlation(spec: Mapping[str, Any], names: Sequence[str], problems: list[str]) -> Array | None:
    if not spec:
        return None
    matrix = np.eye(len(names))
    stated: dict[frozenset[str], str] = {}
    for pair, rho in spec.items():
        both = [p.strip() for p in pair.split(",")]
        unknown = [p for p in both if p not in names]
        if len(both) != 2 or unknown or both[0] == both[-1]:
            where = (
                f"no marginal {unknown[0]!r}{nearest(unknown[0], names)}"
                if unknown
                else 'write "component.a, component.b" = 0.3'
            )
            problems.append(f"correlation.{pair}: {where}")
        elif isinstance(rho, bool) or not isinstance(rho, int | float) or not -1 < rho < 1:
            problems.append(f"correlation.{pair} = {rho!r}: must be a number between -1 and 1")
        else:
            i, j = names.index(both[0]), names.index(both[1])
            if (other := stated.setdefault(frozenset(both), pair)) != pair:
                problems.append(f"correlation.{pair}: is stated twice, also as {other!r}; remove one")
            matrix[i, j] = matrix[j, i] = rho
    return matrix


def _options(spec: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    options = dict(spec)
    problems += [f"study: unknown key {key!r}{nearest(key, STUDY_KEYS)}" for key in spec if key not in STUDY_KEYS]
    for key in ("trials", "seed", "replicates", "budget"):
        if key in options and (isinstance(options[key], bool) or not isinstance(options[key], int) or options[key] < 0):
            problems.append(f"study.{key} = {options[key]!r}: must be a whole number, not negative")
    for key in ("method", "space", "difference"):
        if key in options and not isinstance(options[key], str):
            problems.append(f"study.{key} = {options[key]!r}: must be text")
    for key in ("step", "tolerance"):
        if key in options and not (
            isinstance(options[key], int | float) and not isinstance(options[key], bool) and 0 < options[key] < math.inf
        ):
            problems.append(f"study.{key} = {options[key]!r}: must be a positive number")
    if options.get("space", "x") not in ("x", "u"):
        problems.append(f"study.space = {options['space']!r}: must be x or u")
    if options.get("difference", "forward") not in ("forward", "central"):
        problems.append(f"study.difference = {options['difference']!r}: must be forward or central")
    responses = options.get("responses", ["peak_subtalar_angle_deg"])
    if not isinstance(responses, list) or not responses or not all(isinstance(r, str) for r in responses):
        problems.append('study.responses: must be a list of metrics, such as ["peak_subtalar_angle_deg"]')
    else:
        options["responses"] = tuple(responses)
    levels = options.get("levels", [0.05, 0.5, 0.95])
    if not isinstance(levels, list) or not all(isinstance(v, float | int) and 0 < v < 1 for v in levels) or not levels:
        problems.append("study.levels: must be probabilities between 0 and 1, such as [0.05, 0.5, 0.95]")
    else:
        options["levels"] = tuple(float(v) for v in levels)
    responses = options.get("responses", ("peak_subtalar_angle_deg",))
    if isinstance(responses, tuple):
        for key in ("threshold", "half_width"):
            if key in options:
                try:
                    options[key] = _of_response(options[key], responses[0], f"study.{key}")
                except (InputError, ValueError) as problem:
                    problems.append(str(problem) if f"study.{key}" in str(problem) else f"study.{key}: {problem}")
        if not (isinstance(options.get("half_width", 1.0), float) and options.get("half_width", 1.0) > 0):
            problems.append("study.half_width: must be a positive value of the first response")
    return {k: v for k, v in options.items() if k in STUDY_KEYS}


def _of_response(given: Any, response: str, what: str) -> float | Marginal:
    """A value or a distribution in the unit that the response's name carries, such as "35 deg"."""
    name = unit_of(response).replace("·", ".")
    own = unit(name) if name else None
    return _marginal(given, own, what) if isinstance(given, dict) else quantity(given, own, what)
