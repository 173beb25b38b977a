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

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..cosim.system import System, problems_to_error
from ..errors import InputError, nearest
from ..files import parse_toml, read_text
from ..fmu.component import Component, Connector
from ..scenario import Scenario, Value, load_scenario
from ..shipped import scenario_folder, shipped_studies
from ..units import Unit, quantity, unit
from ..uq import sampling
from ..uq.distributions import Array, Fixed, JointDistribution, LogNormal, Marginal, Normal, Truncated, Uniform

if TYPE_CHECKING:
    from ..uq.reliability import Difference, Space
    from .runner import Campaign

SAMPLED = ("monte-carlo", "lhs", "sobol", "grid", "table")
SEARCHES = ("mean-value", "amv", "amv+", "hmv", "form", "sobol-indices")  # the trials depend on the method's own plan
METHODS = (*SAMPLED, *SEARCHES)
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
IMPOSSIBLE = 1e-6  # a marginal may lie outside its parameter's range with at most this probability
NARROW = math.radians(0.25)  # a smaller spread of an angle is likely to be radians written as degrees
TOLERANCE = 1e-3  # of searches, in standard deviations of the response: a landing's own noise is 1e-4 of them


@dataclass(frozen=True)
class Study:
    """What is varied and asked. Declarative: `sample()` gives the trials, `run()` runs them.

    `marginals` {"component.parameter": Marginal in the parameter's own unit}, `units` {the same: that unit};
    `correlation` (d, d) or None; `grid` {parameter: levels}; `table` (n, d) given inputs and `numbers` (n,) their trial
    numbers, for method table."""

    title: str
    scenario: Scenario
    marginals: Mapping[str, Marginal]
    units: Mapping[str, str]
    responses: tuple[str, ...] = ("peak_subtalar_angle_deg",)
    method: str = "monte-carlo"
    trials: int = 1000
    seed: int = 0
    correlation: Array | None = None
    grid: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    levels: tuple[float, ...] = (0.05, 0.5, 0.95)
    threshold: float | Marginal | None = None
    half_width: float | None = None
    replicates: int = 8
    space: Space = "x"
    step: float = 0.1
    difference: Difference | None = None
    tolerance: float = TOLERANCE
    budget: int = 2000
    table: Array | None = None
    numbers: tuple[int, ...] = ()
    published: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    text: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The varied parameters, in the order of the columns."""
        return tuple(self.grid) if self.method == "grid" else tuple(self.marginals)

    @property
    def headings(self) -> list[str]:
        """Columns of the inputs: "component.parameter [unit]"."""
        return [f"{name} [{self.units[name]}]" if self.units[name] else name for name in self.names]

    @property
    def joint(self) -> JointDistribution:
        return JointDistribution(tuple(self.marginals.values()), self.correlation)

    def sample(self) -> Array:
        """(n, d) inputs in their own units, one row a trial. Row i of a Monte Carlo or Sobol' study depends on the
        study and i alone.

        Raises InputError for a method that is a search, not a sample."""
        if self.method == "monte-carlo":
            return sampling.monte_carlo(self.joint, self.trials, self.seed)
        if self.method == "lhs":
            return sampling.latin_hypercube(self.joint, self.trials, self.seed)
        if self.method == "sobol":
            return sampling.sobol(self.joint, self.trials, self.seed, self.replicates)
        if self.method == "grid":
            return sampling.full_factorial([self.grid[name] for name in self.names])
        if self.method == "table":
            assert self.table is not None
            return self.table
        raise InputError(f"method {self.method} chooses its trials one after another; there is no sample")

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """The sample piece by piece: numbers (k,) and inputs (k, d). A Monte Carlo study of any size is drawn in
        constant memory."""
        if self.method == "monte-carlo":
            for first, x in sampling.monte_carlo_blocks(self.joint, self.trials, self.seed):
                yield np.arange(first, first + len(x)), x
        else:
            x = self.sample()
            yield np.array(self.numbers or range(len(x)), np.int64), x

    def search(self, function: Callable[[Array], Array]) -> Any:
        """Runs the method, one of SEARCHES, on `function`: (n, d) inputs in their own units to (n,) values of the first
        response.

        Differences are forward for mean-value and amv, as in the paper, and central for the others, unless the study
        says otherwise."""
        from ..uq import reliability, sensitivity

        marginals = tuple(self.marginals.values())
        if self.method == "sobol-indices":
            return sensitivity.sobol_indices(function, marginals, self.trials, self.seed, replicates=self.replicates)
        first_order = self.method in ("mean-value", "amv")
        options: dict[str, Any] = {
            "correlation": self.correlation,
            "step": self.step,
            "difference": self.difference or ("forward" if first_order else "central"),
        }
        if not first_order:
            options |= {"tolerance": self.tolerance, "budget": self.budget}
        if self.method == "form":
            assert self.threshold is not None
            return reliability.form_exceedance(function, marginals, self.threshold, **options)
        method = {
            "mean-value": reliability.mean_value,
            "amv": reliability.amv,
            "amv+": reliability.amv_plus,
            "hmv": reliability.hmv,
        }[self.method]
        return method(function, marginals, levels=self.levels, space=self.space, **options)

    @property
    def identity(self) -> dict[str, Any]:
        """What a ledger must have been made with to be continued. The number of trials counts only where a row depends
        on it."""
        scenario = self.scenario
        return {
            "version": __version__,
            "fmus": {name: Component.read(name, path).sha256 for name, path in scenario.fmus.items()},
            **(
                {"maps": {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in scenario.maps.items()}}
                if scenario.maps
                else {}
            ),
            "parameters": dict(scenario.parameters),
            "connections": dict(scenario.connections),
            "master": [scenario.master.communication_step, scenario.master.stop, scenario.master.scheme],
            "marginals": {name: repr(marginal) for name, marginal in self.marginals.items()},
            "correlation": None if self.correlation is None else self.correlation.tolist(),
            "grid": {name: list(levels) for name, levels in self.grid.items()},
            "method": self.method,
            "seed": self.seed,
            "trials": self.trials if self.method in ("lhs", "sobol-indices") else None,
            "replicates": self.replicates if self.method in ("sobol", "sobol-indices") else None,
            "search": [
                *self.levels,
                repr(self.threshold),
                self.space,
                self.step,
                self.difference,
                self.tolerance,
                self.budget,
                self.responses[0],
            ]
            if self.method in SEARCHES
            else None,
            "table": None
            if self.table is None
            else hashlib.sha256(self.table.tobytes() + repr(self.numbers).encode()).hexdigest(),
        }

    @property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()

    def checked(self) -> Self:
        """Itself. Raises InputError with all problems: names, samples outside a parameter's range, sizes,
        correlations."""
        system = self.scenario.system()
        problems: list[str] = []
        for name in (*self.marginals, *self.grid):
            try:
                connector = _parameter(system, name)
            except InputError as problem:
                problems.append(str(problem))
                continue
            if name in self.marginals:
                outside = self.marginals[name].probability_outside(connector.minimum, connector.maximum)
                if outside > IMPOSSIBLE:
                    problems.append(
                        f"marginals.{name}: {100 * outside:.2g} % of the trials would lie outside "
                        f"{connector.minimum:g} ... {connector.maximum:g} "
                        f"{self.units[name]}; correct mean and sd (and their units), take lognormal, or truncate with "
                        "low and high"
                    )
            problems += [
                f"grid.{name}: {level:g} lies outside {connector.minimum:g} ... {connector.maximum:g} "
                f"{self.units[name]}"
                for level in self.grid.get(name, ())
                if not connector.minimum <= level <= connector.maximum
            ]
        if self.method not in METHODS:
            problems.append(
                f"method {self.method!r}: unknown{nearest(self.method, METHODS)}; one of {', '.join(METHODS)}"
            )
        if self.method == "grid" and not self.grid:
            problems.append('method grid: needs [grid] with "component.parameter" = [levels]')
        if self.method == "table" and self.table is None:
            problems.append("method table: needs --inputs TABLE.csv")
        if self.method == "form" and self.threshold is None:
            problems.append(
                'method form: needs study.threshold, such as "35 deg" or { normal = { mean = "35 deg", sd = "6 deg" } }'
            )
        if self.method not in ("grid", "table") and not self.marginals:
            problems.append("no marginals: nothing would vary")
        if self.trials < 1:
            problems.append(f"trials = {self.trials}: must be at least 1")
        if self.method.startswith("sobol") and (self.replicates < 1 or self.trials % self.replicates):
            problems.append(
                f"trials = {self.trials}: a Sobol' study needs a multiple of its {self.replicates} replicates"
            )
        if self.method == "sobol-indices" and self.correlation is not None:
            problems.append("method sobol-indices: defined for independent inputs only; leave [correlation] out")
        if not problems and self.marginals:
            try:
                _ = self.joint
            except ValueError as problem:
                problems.append(f"correlation: {problem}")
        problems_to_error(self.source or self.title, problems)
        return self

    def override(self, parameter: str, value: Value) -> Self:
        """The same study with a parameter at another value; a marginal of it is thereby fixed."""
        scenario = self.scenario.override(parameter, value)
        if parameter in self.marginals:
            connector = scenario.system().find(parameter)
            return replace(self, marginals={**self.marginals, parameter: Fixed(connector.value(value, parameter))})
        return replace(self, scenario=scenario, grid={k: v for k, v in self.grid.items() if k != parameter})

    def replace_fmu(self, name: str, fmu: Path | str, mapping: Path | str | None = None) -> Self:
        """Another device; marginals and grid columns of it that it lacks are dropped with a warning."""
        scenario = self.scenario.replace_fmu(name, fmu, mapping)
        component = Component.read(name, scenario.fmus[name])
        lost = [
            k
            for k in (*self.marginals, *self.grid)
            if k.startswith(f"{name}.") and k.partition(".")[2] not in component.parameters
        ]
        correlation = self.correlation
        if correlation is not None:
            kept = [i for i, k in enumerate(self.marginals) if k not in lost]
            correlation = correlation[np.ix_(kept, kept)]
        warning = (
            (f"{name}: {Path(fmu).name} has no {', '.join(k.partition('.')[2] for k in lost)}; not varied",)
            if lost
            else ()
        )
        return replace(
            self,
            scenario=scenario,
            marginals={k: m for k, m in self.marginals.items() if k not in lost},
            grid={k: v for k, v in self.grid.items() if k not in lost},
            correlation=correlation,
            warnings=self.warnings + warning,
        )

    def without(self, name: str) -> Self:
        """The same study without a component; what varied of it goes with it."""
        kept = [i for i, k in enumerate(self.marginals) if not k.startswith(f"{name}.")]
        return replace(
            self,
            scenario=self.scenario.without(name),
            marginals={k: m for k, m in self.marginals.items() if not k.startswith(f"{name}.")},
            grid={k: v for k, v in self.grid.items() if not k.startswith(f"{name}.")},
            correlation=None if self.correlation is None else self.correlation[np.ix_(kept, kept)],
        )

    def with_rows(self, names: Sequence[str], rows: Array, numbers: Sequence[int]) -> Self:
        """Method table: the given `rows` (n, len(names)) instead of a sample; columns of parameters that this study
        does not vary are left out, and a marginal that is fixed stays at its value."""
        gridded = self.method == "grid"
        varied: dict[str, Marginal] = {name: Fixed(0.0) for name in self.grid} if gridded else dict(self.marginals)
        columns = {name: rows[:, k] for k, name in enumerate(names)}
        table = np.empty((len(rows), len(varied)))
        for k, (name, marginal) in enumerate(varied.items()):
            table[:, k] = columns[name] if name in columns and (gridded or not marginal.is_fixed) else marginal.mean
        return replace(
            self,
            method="table",
            table=table,
            numbers=tuple(numbers),
            trials=len(rows),
            marginals=varied,
            correlation=None,
            grid={},
        )

    def isolated(self) -> Self:
        """The same with every FMU in a process of its own beside its worker."""
        return replace(self, scenario=self.scenario.isolated())

    def with_inputs(self, path: Path) -> Self:
        """Method table: the rows of a CSV file with header `component.parameter [unit]`, an optional column `trial`
        numbering them.

        Marginals without a column stay at their mean. Raises InputError naming row and column."""
        import pandas as pd

        try:
            given = pd.read_csv(path, dtype=str, keep_default_na=False)
        except FileNotFoundError:
            raise InputError(f"{path}: no such file") from None
        except (ValueError, OSError) as problem:
            raise InputError(f"{path}: cannot be read as a table: {' '.join(str(problem).split())}") from None
        system, problems, warnings = self.scenario.system(), list[str](), list[str]()
        columns: dict[str, Array] = {}
        numbers = range(len(given))
        if given.empty:
            problems.append("has no rows")
        for heading in given.columns:
            name, _, rest = str(heading).partition(" [")
            unit = rest.rstrip("] ")
            values = []
            if name == "trial":
                column, connector = "trial", None
            elif name.partition(".")[0] not in self.scenario.fmus:
                if name.partition(".")[0] in ("plant", "controller", "brace"):
                    warnings.append(
                        f"{path}: column {heading} is dropped: the scenario has no {name.partition('.')[0]}"
                    )
                elif name not in ("status", "message"):
                    problems.append(
                        f"column {heading!r}: expected component.parameter [unit]{nearest(name, self.names)}"
                    )
                continue
            else:
                try:
                    column, connector = name, _parameter(system, name)
                except InputError as problem:
                    problems.append(f"column {heading}: {problem}")
                    continue
            for row, text in enumerate(given[heading], 2):
                try:
                    values.append(
                        float(int(text))
                        if connector is None
                        else connector.value(f"{text.strip()} {unit}".strip(), heading)
                    )
                except InputError as problem:
                    problems.append(f"row {row}: {problem}")
                except ValueError:
                    problems.append(f"row {row}: {heading} = {text!r}: not a whole number")
                if len(problems) > 5:
                    break
            if connector is None:
                numbers = [int(v) for v in values]  # type: ignore[assignment]
            else:
                columns[column] = np.array(values)
        if len(set(numbers)) != len(numbers) or any(n < 0 for n in numbers):
            problems.append("column trial: numbers must be different and not negative")
        problems_to_error(str(path), problems)
        marginals = {**self.marginals, **{name: Fixed(0.0) for name in columns if name not in self.marginals}}
        units = {**self.units, **{name: _unit_name(_parameter(system, name).unit) for name in columns}}
        table = np.column_stack([columns.get(name, np.full(len(given), m.mean)) for name, m in marginals.items()])
        return replace(
            self,
            method="table",
            table=table,
            numbers=tuple(numbers),
            trials=len(given),
            marginals=marginals,
            units=units,
            correlation=None,
            grid={},
            warnings=(*self.warnings, *warnings),
        )

    def run(self, **options: Any) -> Campaign:
        """Runs the study: `trials`, `seed`, `method` on top of the file's, and the options of `runner.run`."""
        from .runner import run

        changed = {k: options.pop(k) for k in ("trials", "seed", "method") if options.get(k) is not None}
        return run(replace(self, **changed), **{k: v for k, v in options.items() if v is not None})


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
                connector = _parameter(system, key)
                units[key] = _unit_name(connector.unit)
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


def _unit_name(unit: Unit | None) -> str:
    return "" if unit is None or unit.dimensionless else unit.name


def _parameter(system: System, name: str) -> Connector:
    connector = system.find(name)
    if connector.causality != "parameter":
        raise InputError(f"{name}: is an {connector.causality}, not a parameter")
    if connector.kind != "real":
        raise InputError(
            f"{name}: only real parameters can vary, not "
            f"{'an enumeration' if connector.items else f'a {connector.kind}'}"
        )
    return connector


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
    from ..metrics import unit_of

    name = unit_of(response).replace("·", ".")
    own = unit(name) if name else None
    return _marginal(given, own, what) if isinstance(given, dict) else quantity(given, own, what)
