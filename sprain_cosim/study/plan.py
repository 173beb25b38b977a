"""The plan of a study: what is varied, how its trials are drawn, what is asked of them. A description, frozen and
picklable; it knows no files and runs nothing (study.py does)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..cosim.system import System
from ..errors import InputError, nearest, problems_to_error
from ..files import parse_toml
from ..fmu.component import Component
from ..metrics import NAMES
from ..notebook import Card, Rows
from ..scenario import Scenario, Value
from ..scenario.body import OWNER, SEX, is_of_subject, pose_problem, without_person
from ..subject.anthropometry import SEXES
from ..subject.person import Subject
from ..units import shown_unit
from ..uq import sampling
from ..uq.distributions import Array, Fixed, JointDistribution, Marginal, Uniform
from ..uq.exceedance import Bounds, Threshold
from ..uq.measured import Measured
from .goal import GRAMMAR, LANDINGS, Goal, goal_problems, parse_goal, parse_vary
from .identity import digest_of, identity
from .inputs import parameter as varied_parameter
from .inputs import persons_problems, read_table, unusual_persons
from .marginals import Fitted, strangeness
from .methods import METHODS, SEARCHES, USED_BY
from .population import Population
from .questions import LITERATURE, Question, parse_question
from .until import Until, parse_untils

if TYPE_CHECKING:
    from ..uq.design import DesignResult, Find
    from ..uq.reliability import Difference, LevelCheck, LevelResult, Space

MOST_TRIALS = 10_000_000
SMALLEST_STEP, LARGEST_STEP = 1e-6, 5.0  # of differences, in standard deviations
IMPOSSIBLE = 1e-6  # a marginal may lie outside its parameter's range with at most this probability
ABOUT = 450  # landings about the design points: a coefficient of variation of 0.15 at probabilities of 1e-4
BEFORE_SAMPLING = 0.03  # tolerance of a search that only has to say where to sample
TOLERANCE = 1e-3  # of searches, in standard deviations of the response: a landing's own noise is 1e-4 of them


@dataclass(frozen=True, repr=False)
class Plan(Card):
    """What is varied and asked. `sample()` gives the trials of a method that draws them, `search()` runs one that
    chooses them one after another.

    title        of the file; empty for none. What people read is `heading`
    scenario     what runs in every trial
    marginals    {"component.parameter": its distribution, in the parameter's own unit}
    units        {the same names and those of `grid`: that unit; "" where there is no dimension}
    responses    names of metrics; the first is the one that a search and a stopping rule look at
    method       one of METHODS
    trials       number of trials; of landings for method sobol-indices
    seed         of everything random
    correlation  (d, d) Pearson correlations of the marginals in their order, joined by a Gaussian copula; None: none
    fits         {"component.parameter": the fit to measured values that its marginal is}
    grid         {"component.parameter": levels in its own unit}, for method grid
    levels       probabilities at which a search looks for the response's value, and a stopping rule for its interval
    threshold    of the first response, whose exceedance is asked for
    questions    what else is asked of the trials
    goal         for method design: what must hold
    vary         for method design: {parameter: the range that is searched, in its own unit}; among the marginals it is
                 uniform there, after the inputs
    half_width   stopping rule: the half width that the widest of the levels' intervals may have, in the first
                 response's unit
    until        what is to be known before a sample stops; `trials` are then the most that it may take
    replicates   scrambled sequences that the trials of method sobol or sobol-indices are divided into; None: 8, and 1
                 for sobol-indices, whose error is least then
    space        of amv and its kin: "x", inputs as they are, or "u", the standard normal space
    step         of differences, in standard deviations of the input
    difference   "forward" or "central"; None: forward for mean-value and amv, as in the paper, else central
    tolerance    at which a search ends, in standard deviations of the response; None: 1e-3, and 0.03 where sampling
                 about the design point follows
    budget       landings that a search may take at most
    check        random landings test the levels of mean-value, amv, amv+ and hmv; form is followed by a test of the
                 sphere, second order and sampling about the design points
    table        (n, d) inputs of method table, in the order of `marginals`
    numbers      (n,) their trial numbers; empty: 0 ... n-1
    trial_limit  [s] of wall time that a trial may take; None: learned from those before it
    population   whose measures are inputs, the first of them; None: the scenario's subject lands
    published    figures to print beside the results, with their source
    source       the file, or the name of one that ships
    text         the file as it was read
    warnings     one line each
    """

    title: str
    scenario: Scenario
    marginals: Mapping[str, Marginal]
    units: Mapping[str, str]
    responses: tuple[str, ...] = ("peak_subtalar_angle_deg",)
    method: str = "monte-carlo"
    trials: int = 1000
    seed: int = 0
    correlation: Array | None = None
    fits: Mapping[str, Fitted] = field(default_factory=dict)
    grid: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    levels: tuple[float, ...] = (0.05, 0.5, 0.95)
    threshold: Threshold | None = None
    questions: tuple[Question, ...] = ()
    goal: Goal | None = None
    vary: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    half_width: float | None = None
    until: tuple[Until, ...] = ()
    replicates: int | None = None
    space: Space = "x"
    step: float = 0.1
    difference: Difference | None = None
    tolerance: float | None = None
    budget: int = 2000
    check: bool = True
    table: Array | None = None
    numbers: tuple[int, ...] = ()
    trial_limit: float | None = None
    population: Population | None = None
    published: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    text: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """The heading of tables and figures: the file's title, else the scenario's, else what runs, at the means of
        what varies; with the changes since."""
        return self._heading()

    @property
    def heading_of_braces(self) -> str:
        """That of a comparison of braces over it."""
        return self._heading(compared=True)

    def _heading(self, compared: bool = False) -> str:
        means = {
            n: f"{m.mean!r} {self.units[n]}" if self.units[n] else m.mean
            for n, m in self.marginals.items()
            if n not in self.vary and not is_of_subject(n)
        }
        varied = (*self.grid, *self.vary)
        return self.scenario.heading_with(means, varied, self.title or None, self._persons, compared)

    @property
    def beside(self) -> Mapping[str, Any]:
        """The published figures that may stand beside the results: none where another pose, person, device or value
        was put in the place of the file's."""
        return {} if self.scenario.changes else self.published

    def card(self) -> tuple[str, Rows]:
        rows = [("method", f"{self.method}, {self.trials} trials, seed {self.seed}")]
        rows += [("responses", ", ".join(self.responses)), ("varied", ", ".join(self.names))]
        return self.heading, [*rows, *((name, self._in_words(name, m)) for name, m in self.marginals.items())]

    def _in_words(self, name: str, marginal: Marginal) -> str:
        """ "Normal, mean -34 deg, SD 5 deg"."""
        if marginal.is_discrete or marginal.is_fixed:
            return repr(marginal)
        factor, shown = shown_unit(self.units[name])
        mean, sd = (f"{factor * value + 0.0:.4g} {shown}".rstrip() for value in (marginal.mean, marginal.sd))
        return f"{type(marginal).__name__}, mean {mean}, SD {sd}"

    @property
    def _persons(self) -> str:
        """Who lands, where it is not the scenario's subject."""
        if self.population is not None:
            return self.population.words
        varied = [name.removeprefix(OWNER) for name in (*self.marginals, *self.grid) if is_of_subject(name)]
        subject = self.scenario.subject
        if not varied or subject is None:
            return ""
        stated = {name: value for name, value in subject.measures.items() if name not in varied}
        words = ", ".join(name.replace("_", " ") for name in varied)
        if SEX in self.marginals:
            return f"persons of varied {words}"
        return f"{replace(subject, measures=stated).words}, varied {words}"

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
        return self._law(self.marginals, self.correlation)

    def _law(self, marginals: Mapping[str, Marginal], correlation: Array | None) -> JointDistribution:
        if self.population is not None and self.method != "table":
            return self.population.joint(marginals, correlation)
        return JointDistribution(tuple(marginals.values()), correlation)

    @property
    def drawing(self) -> tuple[int, ...]:
        """The columns in the order in which numbers are drawn for them: their own, or with correlations that of their
        names, so that the lines of a file may stand in any order."""
        if self.correlation is None:
            return tuple(range(len(self.names)))
        return tuple(sorted(range(len(self.names)), key=lambda k: self.names[k]))

    def _drawn(self) -> tuple[JointDistribution, list[int]]:
        """The inputs in the order of drawing, and where each column stands in it."""
        order = list(self.drawing)
        correlation = None if self.correlation is None else self.correlation[np.ix_(order, order)]
        marginals = {self.names[k]: self.marginals[self.names[k]] for k in order}
        return self._law(marginals, correlation), np.argsort(order).tolist()

    def sample(self) -> Array:
        """(n, d) inputs in their own units, one row a trial. Row i of a Monte Carlo or Sobol' study depends on the
        study and i alone.

        Raises InputError for a method that is a search, not a sample."""
        if self.method in ("monte-carlo", "lhs", "sobol"):
            joint, column = self._drawn()
            if self.method == "monte-carlo":
                return sampling.monte_carlo(joint, self.trials, self.seed)[:, column]
            if self.method == "lhs":
                return sampling.latin_hypercube(joint, self.trials, self.seed)[:, column]
            return sampling.sobol(joint, self.trials, self.seed, self.sequences)[:, column]
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
            joint, column = self._drawn()
            for first, x in sampling.monte_carlo_blocks(joint, self.trials, self.seed):
                yield np.arange(first, first + len(x)), x[:, column]
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
            return sensitivity.sobol_indices(function, marginals, self.trials, self.seed, replicates=self.sequences)
        if self.method == "design":
            return self._design(function)
        options: dict[str, Any] = {"correlation": self.correlation, "step": self.step, "difference": self.side}
        if self.method in USED_BY["tolerance"]:
            options |= {"tolerance": self.settling, "budget": self.budget}
        if self.method == "form":
            assert self.limit is not None
            if not self.check:
                return reliability.form_exceedance(function, marginals, self.limit, **options)
            return reliability.rare_event(
                function, marginals, self.limit, above=True, curvature=True, n=ABOUT, seed=self.seed, **options
            )
        method = {
            "mean-value": reliability.mean_value,
            "amv": reliability.amv,
            "amv+": reliability.amv_plus,
            "hmv": reliability.hmv,
        }[self.method]
        return method(function, marginals, levels=self.levels, space=self.space, **options)

    def _design(self, function: Callable[[Array], Array]) -> DesignResult:
        from ..uq.design import design

        assert self.goal is not None and self.goal.question.threshold is not None
        inputs = list(self.marginals.values())[: len(self.marginals) - len(self.vary)]
        active = [k for k, marginal in enumerate(inputs) if not marginal.is_fixed]
        at_rest = np.array([marginal.mean for marginal in inputs])

        def landings(x: Array) -> Array:
            rows = np.column_stack([np.tile(at_rest, (len(x), 1)), x[:, len(active) :]])
            rows[:, active] = x[:, : len(active)]
            return function(rows)

        return design(
            landings,
            [inputs[k] for k in active],
            tuple(self.vary.values()),
            self.goal.question.threshold,
            self.goal.at_most,
            evaluations=self.trials,
            seed=self.seed,
            correlation=None if self.correlation is None else self.correlation[np.ix_(active, active)],
            find=self.goal.find,
        )

    def asking(
        self, goal: str | None, vary: Sequence[str] = (), find: Find | None = None, landings: int | None = None
    ) -> Self:
        """Method design, asked in words: "P(peak_inversion_from_neutral_deg > 35 +- 6 deg) <= 2 %" over
        ["brace.angle_scale=0.5..3"]; what is left out is taken from the study's [design]. Raises InputError."""
        if goal is None and self.goal is None:
            raise InputError(f"--goal: is missing, and {self.source} has no [design]; write {GRAMMAR}")
        if not vary and not self.vary:
            raise InputError(f"--vary: is missing, and {self.source} has no [design]; name a parameter and its range")
        asked = self.goal if goal is None else parse_goal(goal)
        assert asked is not None
        vary = [vary] if isinstance(vary, str) else vary
        system, ranges, units = self.scenario.system(), dict(self.vary), dict(self.units)
        if vary:
            ranges = {}
            for text in vary:
                name, ends, unit = parse_vary(text, system)
                if name in ranges:
                    raise InputError(f"--vary {text}: {name} is given twice")
                ranges[name], units[name] = ends, unit
        size = landings or (self.trials if self.method == "design" else LANDINGS)
        return self.with_goal(replace(asked, find=find or asked.find), ranges, units, size)

    def with_goal(
        self, goal: Goal, vary: Mapping[str, tuple[float, float]], units: Mapping[str, str], landings: int = LANDINGS
    ) -> Self:
        """Method design: the same inputs, but `vary` {parameter: range in its own unit}, whose own marginals are
        dropped. `units` of these parameters."""
        kept = [i for i, name in enumerate(self.marginals) if name not in vary]
        correlation = None if self.correlation is None else self.correlation[np.ix_(kept, kept)]
        if correlation is not None:
            correlation = np.block(
                [
                    [correlation, np.zeros((len(kept), len(vary)))],
                    [np.zeros((len(vary), len(kept))), np.eye(len(vary))],
                ]
            )
        response = goal.question.response
        left = [name for name in ("threshold", "questions", "half_width", "until") if getattr(self, name)]
        return replace(
            self,
            method="design",
            goal=goal,
            vary=dict(vary),
            trials=landings,
            responses=(response, *(name for name in self.responses if name != response)),
            marginals={name: m for name, m in self.marginals.items() if name not in vary}
            | {name: Uniform(low, high) for name, (low, high) in vary.items()},
            units={**self.units, **units},
            correlation=correlation,
            grid={},
            published={},
            threshold=None,
            questions=(),
            half_width=None,
            until=(),
            warnings=(
                *self.warnings,
                *(f"{self.source}: its {name} is not asked: a design asks its goal" for name in left),
            ),
        )

    def level_check(self, function: Callable[[Array], Array], found: LevelResult) -> LevelCheck:
        """The levels that `search` found, tested on random rows of the same inputs."""
        from ..uq.reliability import check_levels

        return check_levels(function, tuple(self.marginals.values()), found, self.correlation, seed=self.seed)

    @property
    def sequences(self) -> int:
        """Scrambled sequences of a Sobol' sample."""
        return self.replicates if self.replicates is not None else 1 if self.method == "sobol-indices" else 8

    @property
    def needs_all(self) -> bool:
        """Whether the method says nothing where a single trial fails."""
        return self.method in SEARCHES and self.method != "design"

    @property
    def side(self) -> Difference:
        """How slopes are taken."""
        return self.difference or ("forward" if self.method in ("mean-value", "amv") else "central")

    @property
    def settling(self) -> float:
        """The tolerance of the search."""
        sampled = self.method == "form" and self.check
        return self.tolerance or (BEFORE_SAMPLING if sampled else TOLERANCE)

    @property
    def limit(self) -> float | Marginal | None:
        """What method form searches the exceedance of, its law alone."""
        found = self.sought
        return found.marginal if isinstance(found, Measured) else found

    @property
    def sought(self) -> float | Marginal | Measured | None:
        """What method form searches the exceedance of: `threshold`, else that of the first question about the first
        response; None where there is none, or bounds alone. Where a question states the specimens behind the same law,
        they count."""
        asked = (self.threshold, *(q.threshold for q in self.questions if q.response == self.responses[0]))
        found = next((t for t in asked if t is not None and not isinstance(t, Bounds)), None)
        return next((t for t in asked if isinstance(t, Measured) and t.marginal == found), found)

    @property
    def exceedances(self) -> tuple[Question, ...]:
        """The questions about thresholds: the study's own, then the literature's."""
        own = () if self.threshold is None else (Question(self.responses[0], self.threshold),)
        asked = [*own, *(q for q in self.questions if q.threshold is not None)]
        asked += [Question(u.response, u.threshold) for u in self.until if u.threshold is not None]
        return (*dict.fromkeys(asked), *LITERATURE)

    def levels_of(self, response: str) -> tuple[float, ...]:
        """Probabilities whose percentiles are asked for, ascending."""
        more = (level for q in self.questions if q.response == response for level in q.levels)
        known = (u.level for u in self.until if u.response == response and u.level is not None)
        return tuple(sorted({*self.levels, *more, *known}))

    @property
    def watched(self) -> tuple[Until, ...]:
        """What `until` asks, of a method whose first rows are independent draws."""
        return self.until if self.method in USED_BY["until"] else ()

    def passed_over(self, method: str | None = None) -> tuple[str, ...]:
        """What its file states and `method` (its own by default) does not look at, a line each: a file may serve
        several methods, but nothing is passed over in silence."""
        method = self.method if method is None else method
        if method not in METHODS:  # which is refused
            return ()
        written = parse_toml(self.text, self.source).get("study", {}) if self.text else {}
        lost = [f"study.{key}" for key, methods in USED_BY.items() if key in written and method not in methods]
        lost = [key for key in lost if (key, method) != ("study.trials", "table")]  # its rows are as many as they are
        lost += ["grid"] if self.grid and method != "grid" else []
        lost += ["questions"] if self.questions and method == "design" else []
        return tuple(f"{key}: method {method} does not look at it" for key in lost)

    def with_questions(self, *texts: str) -> Self:
        """The same study with more questions, as "P(peak_inversion_from_neutral_deg > 35 +- 6 deg, n = 10)". Raises
        InputError."""
        return replace(self, questions=(*self.questions, *(parse_question(text) for text in texts)))

    def with_until(self, texts: Sequence[str], method: str | None = None) -> Self:
        """The same study that stops when these numbers are known, such as "p95 0.5 deg"; none: as its file says.
        Raises InputError."""
        if not texts:
            return self
        if (method := self.method if method is None else method) not in USED_BY["until"]:
            raise InputError(
                f"--until: the first trials of method {method} are no random sample that one could stop; take "
                "--method monte-carlo"
            )
        return replace(self, until=parse_untils(texts, self.responses[0]))

    @property
    def identity(self) -> dict[str, Any]:
        """All that the rows depend on: what a ledger must have been made with to be continued."""
        return identity(self)

    @property
    def digest(self) -> str:
        return digest_of(self.identity)

    def checked(self) -> Self:
        """Itself. Raises InputError with all problems: names, samples outside a parameter's range, sizes,
        correlations."""
        system = self.scenario.system()
        problems = [*self._range_problems(system), *self._method_problems(), *self._size_problems()]
        if "plant.initial_pose" not in self.marginals:
            varied = (*self.marginals, *self.grid, *self.vary)
            problems += filter(None, [pose_problem(system, system.parameters, varied)])
        if not problems and self.marginals:
            try:
                _ = self.joint
            except ValueError as problem:
                problems.append(f"correlation: {self._named(str(problem))}")
        problems_to_error(self.source or self.heading, problems)
        return self

    def _named(self, problem: str) -> str:
        """A message about "inputs 0 and 3" with their names."""
        names = list(self.marginals)
        return re.sub(r"inputs (\d+) and (\d+)", lambda m: f"{names[int(m[1])]} and {names[int(m[2])]}", problem)

    def _range_problems(self, system: System) -> Iterator[str]:
        """Names that are no parameters, marginals and levels outside a parameter's range, marginals of no width."""
        strange = {name: said for name, m in self.marginals.items() if (said := strangeness(m))}
        yield from (f"marginals.{name}: {said}" for name, said in strange.items())
        for name in (n for n in (*self.marginals, *self.grid) if n not in strange):
            try:
                marginal = self.marginals.get(name)
                connector = varied_parameter(
                    system, name, marginal is not None and (marginal.is_discrete or marginal.is_fixed)
                )
            except InputError as problem:
                yield str(problem)
                continue
            allowed = f"{connector.minimum:g} ... {connector.maximum:g} {self.units[name]}"
            outside = marginal.probability_outside(connector.minimum, connector.maximum) if marginal else 0.0
            if outside > IMPOSSIBLE:
                yield (
                    f"marginals.{name}: {100 * outside:.2g} % of the trials would lie outside {allowed}; correct mean "
                    "and sd (and their units), take lognormal, or truncate with low and high"
                )
            for level in self.grid.get(name, ()):
                if not connector.minimum <= level <= connector.maximum:
                    yield f"grid.{name}: {level:g} lies outside {allowed}"

    def _method_problems(self) -> Iterator[str]:
        """What the method needs and the plan lacks."""
        if self.method not in METHODS:
            yield f"method {self.method!r}: unknown{nearest(self.method, METHODS)}"
        if self.method == "grid" and not self.grid:
            yield 'method grid: needs [grid] with "component.parameter" = [levels]'
        if self.method == "table" and self.table is None:
            yield "method table: needs --inputs TABLE.csv"
        if self.method == "form" and self.limit is None:
            yield (
                'method form: needs study.threshold, such as "35 deg" or { normal = { mean = "35 deg", sd = "6 deg" } '
                "}, or a question about the first response"
            )
        if self.questions and self.method in ("grid", "sobol-indices"):
            yield f"questions: method {self.method} draws no sample that could answer them; leave them out"
        if self.method not in ("grid", "table") and not self.marginals:
            yield "no marginals: nothing would vary"
        steps = [name for name, m in self.marginals.items() if m.is_discrete]
        if steps and self.method in SEARCHES and self.method != "sobol-indices":
            yield f"marginals.{steps[0]}: choices have no slope that method {self.method} could follow; take a sample"
        yield from self._design_problems()
        yield from self._search_problems()
        for name in self.responses:
            if name not in NAMES:
                yield f"response {name!r}: no such metric{nearest(name, NAMES)}"

    def _design_problems(self) -> Iterator[str]:
        if self.method == "design":
            yield from goal_problems(self.goal, self.vary, self.trials)
        elif self.goal is not None:
            yield f"method {self.method}: the study has [design], which goes with method design alone"
        for name in self.vary:
            if self.marginals.get(name) != Uniform(*self.vary[name]):
                gone = "is fixed by --set" if name in self.marginals else "is no parameter of the device that runs"
                yield f"design.vary {name}: {gone}; a design question varies it"
        if self.vary and all(m.is_fixed for name, m in self.marginals.items() if name not in self.vary):
            yield "design: no marginals besides the varied parameter: nothing is uncertain, so no probability is asked"

    def _search_problems(self) -> Iterator[str]:
        """Settings with which a search along slopes cannot take its first step."""
        if self.method in USED_BY["step"] and not SMALLEST_STEP <= self.step <= LARGEST_STEP:
            yield (
                f"study.step = {self.step:g}: must lie between {SMALLEST_STEP:g} and {LARGEST_STEP:g} standard "
                "deviations; below, a landing's rounding is all that differs, 0.1 is usual"
            )
        elif self.method in USED_BY["step"]:
            for name, m in self.marginals.items():
                if not m.is_fixed and m.mean + 0.01 * self.step * m.sd == m.mean:
                    yield f"study.step = {self.step:g}: is lost in rounding beside the mean of {name}, {m.mean:g}"
        if self.method in USED_BY["tolerance"] and not self.settling < 1.0:
            yield f"study.tolerance = {self.settling:g}: must be less than one standard deviation of the response"
        if self.method in USED_BY["budget"]:
            slopes = 1 + sum(not m.is_fixed for m in self.marginals.values()) * (2 if self.side == "central" else 1)
            least = slopes + (0 if self.method == "form" else sum(level != 0.5 for level in self.levels))
            if self.budget < least:
                yield f"study.budget = {self.budget}: the first step of method {self.method} takes {least} landings"

    def _size_problems(self) -> Iterator[str]:
        if self.trials < 1:
            yield f"trials = {self.trials}: must be at least 1"
        size = math.prod(len(levels) for levels in self.grid.values()) if self.method == "grid" else self.trials
        if size > MOST_TRIALS:
            yield f"{'points of the grid' if self.method == 'grid' else 'trials'} = {size}: at most {MOST_TRIALS}"
        if self.method.startswith("sobol") and (self.sequences < 1 or self.trials % self.sequences):
            yield f"trials = {self.trials}: a Sobol' study needs a multiple of its {self.sequences} replicates"
        if self.method == "sobol-indices" and (self.correlation is not None or self.population is not None):
            yield "method sobol-indices: defined for independent inputs only; leave [correlation] out"

    def override(self, parameter: str, value: Value) -> Self:
        """The same study with a parameter at another value; a marginal of it is thereby fixed."""
        if self.population is not None and is_of_subject(parameter):
            number = self.scenario.system().find(parameter).value(value, parameter)
            fixed_one = self.population.fixing(parameter, number)
            same = replace(self, scenario=self.scenario.noted(f"{parameter} = {value}"))
            return same.with_population(fixed_one, self.scenario.subject)
        scenario = self.scenario.override(parameter, value)
        if parameter in self.marginals:
            connector = scenario.system().find(parameter)
            fixed = {**self.marginals, parameter: Fixed(connector.value(value, parameter))}
            return replace(self, scenario=self.scenario.noted(f"{parameter} = {value}"), marginals=fixed)
        return replace(self, scenario=scenario, grid={k: v for k, v in self.grid.items() if k != parameter})

    def with_parameters(
        self, values: Mapping[str, float | str] | None = None, /, **of_component: Mapping[str, float | str]
    ) -> Self:
        """The same study with other values, see Scenario.with_parameters; marginals of theirs are thereby fixed."""
        changed = self
        for name, value in self.scenario.in_words(values, of_component).items():
            changed = changed.override(name, value)
        return changed

    def with_subject(self, subject: Subject | str) -> Self:
        """The same study of one person, such as "female, 1.63 m, 62 kg". Raises InputError where the persons vary."""
        varied = [name for name in (*self.marginals, *self.grid) if is_of_subject(name)]
        if self.population is not None or varied:
            what = f"samples a {self.population.words}" if self.population else f"varies {', '.join(varied)}"
            raise InputError(f"{self.source}: {what}; name one person for a study of one, such as study6")
        scenario = self.scenario.with_subject(subject)
        return replace(self, scenario=scenario, warnings=(*self.warnings, *scenario.warnings))

    def with_population(
        self, population: Population, subject: Subject | None = None, kept: Collection[str] = ()
    ) -> Self:
        """The same study of persons from a population, before its other inputs, in the place of what parameters say of
        one, but those `kept`. `subject`: whose rules hold for all. Raises InputError for a plant that cannot be other
        persons."""
        subject = subject or Subject(SEXES[0])
        sex = subject.sex if subject.sex in population.drawn else next(iter(population.drawn))
        one = replace(subject, sex=sex, measures=dict(population.fixed))
        parameters, gone = without_person(
            self.scenario.parameters, one, self.scenario.parameters if self.population else kept
        )
        scenario = replace(self.scenario, subject=one, parameters=parameters)
        scenario.system()
        others = {name: m for name, m in self.marginals.items() if not is_of_subject(name)}
        rows = [k for k, name in enumerate(self.marginals) if name in others]
        rest = None if self.correlation is None else self.correlation[np.ix_(rows, rows)]
        marginals = {**population.marginals, **others}
        return replace(
            self,
            scenario=scenario,
            population=population,
            marginals=marginals,
            units={**population.units, **{name: unit for name, unit in self.units.items() if not is_of_subject(name)}},
            correlation=population.correlations(list(marginals), rest),
            warnings=tuple(dict.fromkeys((*self.warnings, *gone, *population.warnings))),
        )

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

    def with_master(
        self, scheme: str | None = None, communication_step: str | None = None, stop: str | None = None
    ) -> Self:
        """The same study with other settings of the master, as Scenario.with_master. Raises InputError."""
        return replace(self, scenario=self.scenario.with_master(scheme, communication_step, stop))

    def isolated(self) -> Self:
        """The same with every FMU in a process of its own beside its worker."""
        return replace(self, scenario=self.scenario.isolated())

    def unconfined(self) -> Self:
        """The same without a sandbox around foreign FMUs."""
        return replace(self, scenario=self.scenario.unconfined())

    def with_inputs(self, path: Path | str) -> Self:
        """Method table: the rows of a CSV file with header `component.parameter [unit]`, an optional column `trial`
        numbering them.

        Marginals without a column stay at their mean. Raises InputError naming row and column."""
        system = self.scenario.system()
        rows = read_table(path := Path(path), system, self.names)
        n, persons = len(rows.numbers), {name for name in rows.columns if is_of_subject(name)}
        if self.population is not None and (not persons or (SEX in self.marginals and SEX not in persons)):
            lacking = f"a column {SEX}" if persons else "columns of the persons, such as subject.stature [m]"
            raise InputError(f"{path}: needs {lacking}: the study is about a {self.population.words}")
        # a measure without a column follows from those that have one, person by person
        own = {name: m for name, m in self.marginals.items() if name in persons or not is_of_subject(name)}
        marginals = {**own, **{name: Fixed(0.0) for name in rows.columns if name not in own}}
        table = np.column_stack([rows.columns.get(name, np.full(n, m.mean)) for name, m in marginals.items()])
        held = ", ".join(
            f"{name} ({_read(m.mean, self.units[name])})"
            for name, m in own.items()
            if name not in rows.columns and not m.is_fixed
        )
        left: tuple[str, ...] = (
            (f"{path}: has no column for {held}; held at that, its mean, in all rows",) if held else ()
        )
        scenario = self.scenario
        if self.population is not None and scenario.subject is not None:
            scenario = replace(scenario, subject=replace(scenario.subject, measures=self.population.fixed))
        if scenario.subject is not None:
            problems_to_error(str(path), persons_problems(rows, scenario.subject, system))
            left += tuple(f"{path}: {line}" for line in unusual_persons(rows, scenario.subject))
        return replace(
            self,
            scenario=scenario,
            population=None,
            method="table",
            table=table,
            numbers=rows.numbers,
            trials=n,
            marginals=marginals,
            units={**self.units, **rows.units},
            correlation=None,
            grid={},
            warnings=(*self.warnings, *rows.warnings, *left),
        )


def _read(value: float, own: str) -> str:
    """A value as people read it."""
    factor, shown = shown_unit(own)
    return f"{factor * value:.5g} {shown}".strip()
