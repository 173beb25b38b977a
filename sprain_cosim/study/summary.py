"""What a study found, as its summary.json holds it. None is a number that the trials do not give.

Everything that is counted, estimated or searched for stands here with its interval where there is one; how it is
estimated is `evaluation.py`'s, how it is printed `listing.py`'s."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from ..errors import InputError
from ..files import read_json
from ..fmu.messages import spoke
from ..metrics import unit_of
from ..notebook import Card, Rows, with_interval
from ..records import FORMAT, Record, Summary, ends_of, known_format, optional
from .questions import law_name

FILE = "summary.json"
PAIR = tuple[float | None, float | None]
PEAK = "peak_subtalar_angle_deg"
TORQUE = 5e-3  # N.m that are shown as something
GIVEN_ROWS = "intervals hold if the given rows are independent draws"
FIGURES = 4  # of a parameter's value that a design found


def in_figures(value: float | None) -> str:
    """A value of a parameter that a design varies, wherever it is shown; nothing where there is none."""
    return "" if value is None else f"{value:.{FIGURES}g}"


@dataclass(frozen=True)
class Percentile(Record):
    """A percentile of a response, in the response's unit.

    value            type 7, of the completed trials
    ci_low, ci_high  95 % interval; None for a sample that allows none
    with_failures    smallest and largest value, whatever the failed trials would have given; only where trials failed
    """

    value: float | None
    ci_low: float | None = None
    ci_high: float | None = None
    with_failures: PAIR | None = optional()


@dataclass(frozen=True)
class Response(Record):
    """A response over the completed trials, in its own unit.

    mean, sd         of the sample; `sd` with n - 1
    percentiles      {"5": ...}
    mean_ci, sd_ci   95 % intervals, where the sample allows them
    failed           trials that are in none of these numbers, where there are any
    """

    mean: float | None
    sd: float | None
    percentiles: Mapping[str, Percentile] = field(default_factory=dict)
    mean_ci: PAIR | None = optional()
    sd_ci: PAIR | None = optional()
    failed: int | None = optional()

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        found = super().from_json(content, place)
        _percents(found.percentiles, f"{place}, percentiles")
        return found


@dataclass(frozen=True)
class Coefficient(Record):
    """A correlation coefficient, -1 ... 1, and its 95 % interval."""

    value: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Factors(Record):
    """The four sensitivity factors of one input, or what is known of each: d(mean or SD of the response) by d(mean or
    SD of the input), normalised by the standard deviations (1/1)."""

    dmean_dmean: float | None = None
    dmean_dsd: float | None = None
    dsd_dmean: float | None = None
    dsd_dsd: float | None = None


@dataclass(frozen=True)
class FactorIntervals(Record):
    """95 % intervals of the four factors."""

    dmean_dmean: PAIR | None = None
    dmean_dsd: PAIR | None = None
    dsd_dmean: PAIR | None = None
    dsd_dsd: PAIR | None = None


@dataclass(frozen=True)
class InputSensitivity(Record):
    """What one input does to one response.

    pearson, spearman           correlation with the response
    dmean_dmean ... dsd_dsd     see Factors
    standard_error, ci          of those four
    importance                  its part in the unit vector of a linear fit in standard space; + raises the response. Of
                                correlated inputs along each one's own standard score, the others held
    importance_standard_error   its standard error
    sobol_first, sobol_total    Sobol' indices from polynomial chaos, 0 ... 1. Of correlated inputs: an input with all
                                that goes along with it, and what is left of it when all others are known
    shapley                     its share of the variance over all orders in which inputs become known; adds up to 1
    sobol_first_ci ... shapley_ci  their 95 % intervals
    """

    pearson: Coefficient
    spearman: Coefficient
    dmean_dmean: float | None
    dmean_dsd: float | None
    dsd_dmean: float | None
    dsd_dsd: float | None
    standard_error: Factors
    ci: FactorIntervals
    importance: float | None = optional()
    importance_standard_error: float | None = optional()
    sobol_first: float | None = optional()
    sobol_total: float | None = optional()
    shapley: float | None = optional()
    sobol_first_ci: PAIR | None = optional()
    sobol_total_ci: PAIR | None = optional()
    shapley_ci: PAIR | None = optional()


@dataclass(frozen=True)
class VarianceShare(Record):
    """The share of a response's variance that a group of inputs explains by itself, 0 ... 1, with its 95 %
    interval."""

    value: float | None
    ci_low: float | None = None
    ci_high: float | None = None


@dataclass(frozen=True)
class LinearFit(Record):
    """Share of the response's variance that the linear fit behind `importance` explains, 0 ... 1."""

    r2: float | None


@dataclass(frozen=True)
class ChaosFit(Record):
    """The polynomial chaos behind the Sobol' indices.

    degree, terms   of the polynomial
    q2              share of left-out variance that it predicts, at most 1
    """

    degree: int
    terms: int
    q2: float | None


@dataclass(frozen=True)
class Sensitivity(Record):
    """What moves one response. In the file the two fits stand beside the inputs, as _importance and _given_data.

    inputs   {"component.parameter": ...}
    linear   None where there were too few trials
    chaos    None where there were too few trials, or choices
    """

    inputs: Mapping[str, InputSensitivity] = field(default_factory=dict)
    linear: LinearFit | None = None
    chaos: ChaosFit | None = None

    def to_json(self) -> dict[str, Any]:
        out = {name: found.to_json() for name, found in self.inputs.items()}
        fits = {"_importance": self.linear, "_given_data": self.chaos}
        return out | {key: fit.to_json() for key, fit in fits.items() if fit is not None}

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        if not isinstance(content, dict):
            raise InputError(f"{place}: must be an object")
        linear, chaos = content.get("_importance"), content.get("_given_data")
        return cls(
            {
                name: InputSensitivity.from_json(found, f"{place}, {name}")
                for name, found in content.items()
                if not name.startswith("_")
            },
            None if linear is None else LinearFit.from_json(linear, f"{place}, _importance"),
            None if chaos is None else ChaosFit.from_json(chaos, f"{place}, _given_data"),
        )


@dataclass(frozen=True)
class Curve(Record):
    """The probability that a response exceeds each of several fixed thresholds, with 95 % intervals, each by itself."""

    threshold: tuple[float, ...]
    probability: tuple[float | None, ...]
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]


@dataclass(frozen=True, repr=False)
class Probability(Card, Record):
    """The probability of an event, 0 ... 1, with what is not known of it: of the sample and of the threshold, apart.

    event            in words, such as "above 35 ± 6 deg"
    probability      None for bounds, which state none
    ci_low, ci_high  the ends of `sampling_ci`
    response         the metric
    source           whose threshold it is, literature or own; folders of version 0.1 lack this and what follows
    sampling_ci      95 % interval from the finite sample; of the larger end for bounds; None where none is known
    threshold_ci     what the specimens behind the threshold leave open, 95 %, or its bounds; None where that is not
                     stated
    shapes           the same mean and SD of the threshold in another law: {"normal": ..., "lognormal": ..., ...}
    specimens        behind the threshold
    dominates        which of the two is wider: sampling, threshold, both, none; None where one is not known
    sentence         says so, and what would narrow it
    inputs_ci        what the specimens behind measured inputs leave open, 95 %; None where no input was measured
    trials, failed   behind the number
    """

    event: str
    probability: float | None
    ci_low: float | None = None
    ci_high: float | None = None
    response: str | None = optional()
    source: str | None = optional()
    sampling_ci: PAIR | None = optional()
    threshold_ci: PAIR | None = optional()
    shapes: Mapping[str, float] | None = optional()
    specimens: int | None = optional()
    dominates: str | None = optional()
    sentence: str | None = optional()
    inputs_ci: PAIR | None = optional()
    trials: int | None = optional()
    failed: int | None = optional()

    @property
    def asked(self) -> str:
        """ "P(peak_subtalar_angle_deg above 35 deg)"."""
        return f"P({self.response or 'the response'} {self.event})"

    @property
    def doubted(self) -> str:
        """The probability with its doubts, apart."""
        doubts = {"sample": self.sampling_ci, "threshold": self.threshold_ci, "measured inputs": self.inputs_ci}
        return _in_doubt(self.probability, doubts, self.shapes)

    def card(self) -> tuple[str, Rows]:
        rows = [("probability", self.doubted)]
        if self.shapes:
            shapes = ", ".join(f"{law_name(law)} {p:.3g}" for law, p in self.shapes.items())
            rows.append(("threshold of another shape", shapes))
        rows += [("trials", f"{self.trials}{f', {self.failed} failed' if self.failed else ''}")] if self.trials else []
        return self.asked, [*rows, *([("so", self.sentence)] if self.sentence else [])]


def _in_doubt(probability: float | None, doubts: Mapping[str, PAIR | None], shapes: Mapping[str, float] | None) -> str:
    """ "0.0146 (95 %: sample 0.0115 ... 0.0241; threshold of another shape 0.00512 ... 0.0238)". The shapes say how far
    a threshold is known where no number of specimens does."""
    value = "between" if probability is None else f"{probability:.3g}"
    known = [
        f"{name} {' ... '.join('open' if end is None else f'{end:.3g}' for end in pair)}"
        for name, pair in doubts.items()
        if pair is not None
    ]
    said = [f"95 %: {', '.join(known)}" if known else "no interval"]
    if not doubts.get("threshold") and (ends := ends_of(shapes)):
        said.append(f"threshold of another shape {ends[0]:.3g} ... {ends[1]:.3g}")
    return f"{value} ({'; '.join(said)})"


def _percents(levels: Iterable[str], place: str) -> None:
    """Raises InputError for a level that is none."""
    for level in levels:
        if not re.fullmatch(r"\d{1,3}(\.\d+)?", level):
            raise InputError(f"{place}: {level!r} must be a level in percent")


@dataclass(frozen=True)
class Level(Record):
    """A percentile that a search found.

    value                in the response's unit
    importance           {input: part in the unit vector; + raises the response}
    design_point         {input: value in its own unit}
    iterations           until it was found
    against_monte_carlo  whether it lies in the interval of the published Monte Carlo trials: inside, above by ...
    """

    value: float | None
    importance: Mapping[str, float | None]
    design_point: Mapping[str, float | None]
    iterations: int | None = optional()
    against_monte_carlo: str | None = optional()


@dataclass(frozen=True)
class LevelTest(Record):
    """What random landings of the same inputs say of the levels of a search.

    n        landings
    off      {"5": by how many percentage points the share below the level's value is more than its own 5 %}
    ci       {"5": its 95 % interval}
    verdict  {"5": ok, suspect, or undecided}
    """

    n: int
    off: Mapping[str, float | None] = field(default_factory=dict)
    ci: Mapping[str, PAIR] = field(default_factory=dict)
    verdict: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        found = super().from_json(content, place)
        _percents(found.off, f"{place}, off")
        for name in ("ci", "verdict"):
            if set(getattr(found, name)) != set(found.off):
                raise InputError(f"{place}, {name}: must have the levels of off")
        return found


@dataclass(frozen=True)
class LevelSearch(Record):
    """What a method of the mean value family (mean-value, amv, amv+, hmv) found: the value of the response at levels
    of probability.

    evaluations_requested, _executed   landings that the method asked for, and those that were not known before; without
                                       those of `check`
    status, reasons                    ok, or why not: of the method's own check and of `check`
    levels                             {"5": ...}, in percent
    linear_importance                  {input: part in the unit vector at the mean point}
    mean, sd                           of the linearised response
    check                              None where it was not asked for
    """

    evaluations_requested: int
    evaluations_executed: int
    status: str
    reasons: tuple[str, ...]
    response: str
    levels: Mapping[str, Level] = field(default_factory=dict)
    linear_importance: Mapping[str, float | None] = field(default_factory=dict)
    mean: float | None = None
    sd: float | None = None
    check: LevelTest | None = optional()

    def rows(self) -> Rows:
        """What is shown in brief."""
        unit = unit_of(self.response)
        levels = ", ".join(f"{k} %: {v.value:.4g}" for k, v in self.levels.items() if v.value is not None)
        tested = f"; tested on {self.check.n} landings" if self.check else "; not tested"
        return [
            (f"levels of {self.response}", f"{levels}{f' {unit}' if unit else ''}"),
            ("own check", f"{self.status}{tested}"),
        ]

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        found = super().from_json(content, place)
        _percents(found.levels, f"{place}, levels")
        return found


@dataclass(frozen=True)
class Threshold(Record):
    """What the response must not exceed, in the response's unit. In the file a number, or an object with both keys.

    mean          the threshold, or the mean of its distribution
    distribution  in words, None for a fixed threshold
    """

    mean: float | None
    distribution: str | None = None

    def to_json(self) -> Any:
        return self.mean if self.distribution is None else {"distribution": self.distribution, "mean": self.mean}

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        return super().from_json(content if isinstance(content, dict) else {"mean": content}, place)


@dataclass(frozen=True)
class FormSearch(Record):
    """What first order, second order and sampling about the design points found of an event.

    evaluations_requested ... response   see LevelSearch
    beta                                 reliability index of first order
    probability                          that the response exceeds the threshold: the best estimate, from sampling
    ci_low, ci_high, cov                 its 95 % interval and its coefficient of variation; None where first order
                                         stands alone (also in folders of version 0.1)
    first_order                          probability of first order
    second_order                         {formula: probability}, None where a formula gives none
    sampled                              landings about the design points
    design_points                        their number
    remarks                              what first and second order miss
    threshold_ci, shapes ... sentence    see Probability; from the landings about the design points
    importance, design_point             by input, and "threshold" where it is uncertain
    """

    evaluations_requested: int
    evaluations_executed: int
    status: str
    reasons: tuple[str, ...]
    response: str
    beta: float | None
    probability: float | None
    threshold: Threshold
    importance: Mapping[str, float | None] = field(default_factory=dict)
    design_point: Mapping[str, float | None] = field(default_factory=dict)
    ci_low: float | None = optional()
    ci_high: float | None = optional()
    cov: float | None = optional()
    first_order: float | None = optional()
    second_order: Mapping[str, float | None] | None = optional()
    sampled: int | None = optional()
    design_points: int | None = optional()
    remarks: tuple[str, ...] | None = optional()
    threshold_ci: PAIR | None = optional()
    shapes: Mapping[str, float] | None = optional()
    specimens: int | None = optional()
    dominates: str | None = optional()
    sentence: str | None = optional()

    def rows(self) -> Rows:
        """What is shown in brief."""
        sampled = None if self.ci_low is None or self.ci_high is None else (self.ci_low, self.ci_high)
        text = _in_doubt(self.probability, {"sample": sampled, "threshold": self.threshold_ci}, self.shapes)
        return [(f"P of {self.response}", text), ("own check", self.status)]


@dataclass(frozen=True)
class SobolIndex(Record):
    """First-order and total Sobol' index of one input, 0 ... 1, with 95 % intervals."""

    first: float | None
    first_low: float | None
    first_high: float | None
    total: float | None
    total_low: float | None
    total_high: float | None


@dataclass(frozen=True)
class SobolSearch(Record):
    """What the method sobol-indices found, in the response's unit; `evaluations` landings."""

    response: str
    mean: float | None
    variance: float | None
    evaluations: int
    indices: Mapping[str, SobolIndex] = field(default_factory=dict)


@dataclass(frozen=True)
class DoubtedProbability(Record):
    """A probability, 0 ... 1, with its two doubts apart; see Probability."""

    value: float | None
    sampling_ci: PAIR | None = None
    threshold_ci: PAIR | None = None
    shapes: Mapping[str, float] = field(default_factory=dict)
    specimens: int | None = optional()
    dominates: str | None = None
    sentence: str = ""


@dataclass(frozen=True)
class DesignCurve(Record):
    """P over the values of the parameter: (m,) each; `low` is 0 where the curve says no more than "less than"."""

    parameter: tuple[float, ...]
    probability: tuple[float | None, ...]
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]


@dataclass(frozen=True)
class Comfort(Record):
    """What the device resists in postures of ordinary motion: {posture: N.m} at a value of the parameter; `at` says
    which: value, value_95, low and high (the ends of the range), between (them)."""

    at: str
    value: float
    resistance_Nm: Mapping[str, float | None]


@dataclass(frozen=True)
class DesignPoint(Record):
    """What was found at one value of the second parameter (None: there is none).

    status           met, everywhere (the goal holds in all of the range), nowhere
    value            of the parameter that divides the range; its end for everywhere, where P is smallest for nowhere
    ci_low, ci_high  95 % interval of it; None where it reaches beyond the range
    value_95         what holds with 95 % confidence; None where nothing in the range does
    probability      at `value`, corrected by the fresh landings
    surface          what the polynomial alone says there
    other_end        where the goal ceases to hold again, or None
    comfort          empty where the parameter is none of the brace's
    fresh, failed    landings behind the probability, and those of them that failed
    """

    status: str
    value: float
    ci_low: float | None
    ci_high: float | None
    value_95: float | None
    probability: DoubtedProbability
    curve: DesignCurve
    fresh: int
    failed: int
    second: float | None = optional()
    other_end: float | None = optional()
    comfort: tuple[Comfort, ...] = ()
    surface: float | None = optional()

    @property
    def motions(self) -> tuple[list[str], list[str]]:
        """The ordinary motions against which the device resists at some value of the parameter, and those against which
        it never does."""
        most = dict[str, float]()
        for held in self.comfort:
            for posture, torque in held.resistance_Nm.items():
                motion = posture.rpartition("_")[0]
                most[motion] = max(most.get(motion, 0.0), TORQUE if torque is None else abs(torque))
        return [m for m, t in most.items() if t >= TORQUE], [m for m, t in most.items() if t < TORQUE]


@dataclass(frozen=True)
class DesignSearch(Record):
    """For which values of a parameter a goal holds. With one parameter the object in the file has the keys of its point
    as well; each point there has its `verdict`.

    goal              in words
    at_most           the bound of the probability
    response          the metric
    parameter, unit   what is searched; "" for no unit
    range             that was searched
    find              least or largest
    second            the parameter at whose values it was searched, and its unit
    landings, failed  in all
    q2                share of the variance that the polynomial predicts of landings left out, at most 1
    residual          what it leaves near the goal, root mean square, in the response's unit
    """

    goal: str
    at_most: float
    response: str
    parameter: str
    unit: str
    range: PAIR
    find: str
    points: tuple[DesignPoint, ...]
    landings: int
    failed: int
    q2: float | None
    residual: float | None
    second: str | None = optional()
    second_unit: str | None = optional()

    def rows(self) -> Rows:
        """What is shown in brief."""
        found = [(f"{self.find} {self.parameter}", self._in_brief(point)) for point in self.points[:2]]
        more = [("further values", str(len(self.points) - 2))] if len(self.points) > 2 else []
        return [("goal", self.goal), *found, *more]

    def _in_brief(self, point: DesignPoint) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if point.status == "nowhere":
            return f"none in the range; goal {self.in_words(point)}"
        low = "below the range" if point.ci_low is None else in_figures(point.ci_low)
        high = "above the range" if point.ci_high is None else in_figures(point.ci_high)
        where = (
            f"; all of {in_figures(self.range[0])} ... {in_figures(self.range[1])}"
            if point.status == "everywhere"
            else ""
        )
        p = point.probability
        there = _in_doubt(p.value, {"sample": p.sampling_ci, "threshold": p.threshold_ci}, p.shapes)
        found = f"{in_figures(point.value)}{unit} (95 %: {low} ... {high}){where}"
        return f"{found}; goal {self.in_words(point)}; P there {there}"

    @property
    def met(self) -> bool:
        """Whether the best estimate of some value meets the goal at every point."""
        return all(point.status != "nowhere" for point in self.points)

    def verdict(self, point: DesignPoint) -> str:
        """As far as the landings know it: met (some value in the range holds with 95 % confidence), not met (none
        does), undecided."""
        if point.value_95 is not None:
            return "met"
        low = (point.probability.sampling_ci or (None, None))[0]
        return "not met" if point.status == "nowhere" and low is not None and low > self.at_most else "undecided"

    @property
    def doubt(self) -> str:
        """What a yes or no by the best estimate, `met`, leaves out; empty where the landings decide."""
        undecided = sum(self.verdict(point) == "undecided" for point in self.points)
        where = f" at {undecided} of {len(self.points)} values of {self.second}" if len(self.points) > 1 else ""
        best = "meets" if self.met else "does not meet"
        return (
            f"the exit code goes by the best estimate, which {best} the goal; whether it holds with 95 % confidence is "
            f"undecided{where}: more landings (--landings) would tell"
            if undecided
            else ""
        )

    def in_words(self, point: DesignPoint) -> str:
        """The verdict with what it rests on."""
        unit = f" {self.unit}" if self.unit else ""
        if point.value_95 is not None:
            return f"met with 95 % confidence at {in_figures(self.on_the_safe_side(point.value_95))}{unit}"
        if self.verdict(point) == "undecided":
            return f"undecided: the landings leave open whether it holds at {in_figures(point.value)}{unit}"
        return "not met by any value in the range, with 95 % confidence"

    def on_the_safe_side(self, value: float) -> float:
        """A value that holds with confidence, rounded to FIGURES to where the goal holds: a least value up, a largest
        down."""
        if value == 0.0:
            return value
        step = 10.0 ** (math.floor(math.log10(abs(value))) + 1 - FIGURES)
        steps = value / step
        return step * (math.ceil(steps - 1e-9) if self.find == "least" else math.floor(steps + 1e-9))

    def to_json(self) -> dict[str, Any]:
        content = super().to_json()
        points = [held | {"verdict": self.verdict(p)} for held, p in zip(content["points"], self.points, strict=True)]
        return (points[0] if len(points) == 1 else {}) | content | {"points": points}


@dataclass(frozen=True)
class Axis(Record):
    """A parameter of a grid: its name, unit ("" for none) and levels."""

    name: str
    unit: str
    levels: tuple[float, ...]


@dataclass(frozen=True)
class Grid(Record):
    """The responses as arrays of the grid's shape, in the order of `axes`: nested lists, None where a trial failed.
    Without responses while trials are missing."""

    axes: tuple[Axis, ...]
    responses: Mapping[str, Any]


@dataclass(frozen=True)
class StoppingRule(Record):
    """Whether the intervals of the first response are as narrow as the study file asks.

    wanted          largest half width that is accepted, in the response's unit
    half_width      {"5": ...} that the trials give
    met             all are as narrow
    trials_needed   an estimate of how many it takes
    """

    response: str
    wanted: float
    half_width: Mapping[str, float | None]
    met: bool
    trials_needed: int | None


@dataclass(frozen=True)
class UntilLook(Record):
    """What was known after so many trials: a value and its interval."""

    n: int
    value: float | None
    ci_low: float | None
    ci_high: float | None


@dataclass(frozen=True)
class Watched(Record):
    """A number that is to be known.

    response       the metric
    wanted         how far the interval may reach to either side, in the response's unit; of a probability 0 ... 1
    unit           of people: that of the response, % for a probability
    looks          in their order
    known          whether the last of them is as narrow
    trials_needed  an estimate of how many it takes; None where it is known
    """

    response: str
    wanted: float
    unit: str
    looks: tuple[UntilLook, ...]
    known: bool
    trials_needed: int | None

    def text(self, name: str) -> str:
        """ "p95 of peak_subtalar_angle_deg = 31.2 deg (30.8 ... 31.6; wanted ± 0.5)"."""
        factor, last = 100.0 if self.unit == "%" else 1.0, self.looks[-1]
        value, low, high = (None if v is None else factor * v for v in (last.value, last.ci_low, last.ci_high))
        if value is None:
            return f"{name}: no value yet"
        ends = " ... ".join("open" if end is None else f"{end:.4g}" for end in (low, high))
        return f"{name} = {value:.4g} {self.unit} ({ends}; wanted ± {factor * self.wanted:g})"


@dataclass(frozen=True)
class UntilRule(Record):
    """How a sample stopped when it told enough.

    confidence  of the intervals of all looks together
    each        of the intervals of one look by themselves
    planned     numbers of trials at which one would look
    at_most     trials that were allowed
    trials      that were run
    known       whether all is known
    watched     {"p95 of peak_subtalar_angle_deg": ...}
    """

    confidence: float
    each: float
    planned: tuple[int, ...]
    at_most: int
    trials: int
    known: bool
    watched: Mapping[str, Watched]

    @property
    def saved(self) -> int:
        return self.at_most - self.trials

    def to_json(self) -> dict[str, Any]:
        return super().to_json() | {"saved": self.saved}

    @property
    def sentence(self) -> str:
        """What is known after how many trials, and what that saved or lacks."""
        found = "; ".join(watched.text(name) for name, watched in self.watched.items())
        if self.known:
            return f"known after {self.trials} trials, {self.saved} of {self.at_most} saved: {found}"
        needed = [w.trials_needed for w in self.watched.values() if not w.known]
        more = f"; about {max(n for n in needed if n)} trials would do" if all(needed) else ""
        return f"not known after {self.trials} trials, all that were allowed: {found}{more}"


@dataclass(frozen=True)
class Kept(Record):
    """Which trials have their signals in trajectories/. In the file `first` stands beside the roles.

    roles   {"p50", "max" ...: number of the trial that stands for it}
    first   how many from the first on
    """

    roles: Mapping[str, int]
    first: int

    def to_json(self) -> dict[str, Any]:
        return {**self.roles, "first": self.first}

    @classmethod
    def from_json(cls, content: Any, place: str) -> Self:
        if not isinstance(content, dict):
            raise InputError(f"{place}: must be an object")
        roles = {name: trial for name, trial in content.items() if name != "first"}
        return super().from_json({"roles": roles, "first": content.get("first", 0)}, place)


@dataclass(frozen=True)
class SampleFit(Record):
    """The law fitted to measured values of an input.

    law                        normal, lognormal or weibull
    n, file                    number of values, and where they stand
    aicc                       Akaike's criterion with the correction for small samples; None for three values
    anderson_darling, p_value  the statistic of the fitted law, and how likely a larger one is if the law holds
    warnings                   what speaks against it
    """

    law: str
    n: int
    file: str
    aicc: float | None
    anderson_darling: float
    p_value: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class MessagesOfTrials(Record):
    """What one FMU said in the trials of a study, see Messages.

    trials           in how many it said something
    count, warnings  of all of them
    first            of the first trial in which it warned; else of the first in which it spoke
    trial            the number of that one
    grave            whether it warned in any
    """

    trials: int
    count: int
    warnings: int
    first: str
    trial: int
    grave: bool

    def text(self, of: int) -> str:
        """One line, about `of` trials."""
        first = f"; the first, in trial {self.trial}: {self.first}" if self.first else ""
        return f"its FMU {spoke(self.count, self.warnings)} in {self.trials} of {of} trials{first}"


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class StudySummary(Card, Summary):
    """Content of a study's summary.json, and what a campaign's `summary` is.

    format                     of the file
    study, title               where the study comes from, and what it is
    method, seed               of the sample or the search
    initial_pose               of every landing
    n_requested, n_completed   trials
    n_failed, failures         how many and how the others ended: {status: count}
    responses                  {metric: over the completed trials}
    sensitivity                {response: what moves it}
    groups                     {response: {person, posture, ...: its share of the variance}}, where persons vary
    questions                  {question: its probability}; those of the literature are called by their metric
    curves                     {metric: the probability that it exceeds fixed thresholds}, where something is asked
    fits                       {input: the law fitted to its measured values}
    notes                      what a reader must know about the numbers
    warnings                   what was said of study, scenario and device before the trials; absent for none
    dropped                    parameters that the FMU put in a component's place does not have
    isolation                  sandbox or process: where the trials ran
    granted                    {component: what its mapping file allows it beyond the sandbox}
    fmu_messages               {component: what its FMU said}, of those that said anything
    form, sobol, amv, design   what a search found; at most one of them is there
    grid                       of a grid
    stopping                   of a study that asks for a half width
    until                      of a study that stops when it knows enough
    trajectories               which signals are kept; of a study with a folder
    not_reproduced             trials that gave other numbers when they ran again for their trajectories
    shard                      (k, n): only the k-th of n parts
    wall_s                     wall time [s]
    merged                     folders that were joined
    """

    format: int = FORMAT
    study: str | None = None
    title: str
    method: str
    seed: int | None = None
    initial_pose: str | None = None
    n_requested: int
    n_completed: int
    n_failed: int
    failures: Mapping[str, int] = field(default_factory=dict)
    responses: Mapping[str, Response] = field(default_factory=dict)
    sensitivity: Mapping[str, Sensitivity] = field(default_factory=dict)
    groups: Mapping[str, Mapping[str, VarianceShare]] | None = optional()
    questions: Mapping[str, Probability] = field(default_factory=dict)
    curves: Mapping[str, Curve] | None = optional()
    fits: Mapping[str, SampleFit] | None = optional()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] | None = optional()
    dropped: tuple[str, ...] = ()
    isolation: str = ""
    granted: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    fmu_messages: Mapping[str, MessagesOfTrials] = field(default_factory=dict)
    form: FormSearch | None = optional()
    sobol: SobolSearch | None = optional()
    amv: LevelSearch | None = optional()
    design: DesignSearch | None = optional()
    grid: Grid | None = optional()
    stopping: StoppingRule | None = optional()
    until: UntilRule | None = optional()
    trajectories: Kept | None = optional()
    not_reproduced: tuple[int, ...] | None = optional()
    shard: tuple[int, int] | None = optional()
    wall_s: float | None = None
    merged: tuple[str, ...] | None = optional()

    @property
    def search(self) -> LevelSearch | FormSearch | None:
        """What the method itself judged, of a search."""
        return self.amv or self.form

    def card(self) -> tuple[str, Rows]:
        failed = f", {self.n_failed} failed" if self.n_failed else ""
        rows = [("status", f"{self.n_completed} of {self.n_requested} landings completed{failed}")]
        found = self.amv or self.form or self.design
        if found is not None:
            rows += found.rows()
        else:
            name = PEAK if PEAK in self.responses else next(iter(self.responses), "")
            levels = self.responses[name].percentiles if name and self.grid is None else {}
            for level in [key for key in ("50", "95") if key in levels]:
                e = levels[level]
                text = with_interval(e.value, e.ci_low, e.ci_high, unit_of(name))
                rows.append((f"{level} % of {name}", text))
            rows += [(q.asked, q.doubted) for q in self.questions.values() if q.source == "own"]
        rows += [("notes", f"{len(self.notes)}, the first: {self.notes[0]}")] if self.notes else []
        return f"{self.title}, {self.method}", rows

    @property
    def first_kept(self) -> int:
        """How many trials from the first on have their signals kept."""
        return self.trajectories.first if self.trajectories else 0


def read_summary(folder: Path) -> StudySummary:
    """The summary of a study's folder. Raises InputError when there is none, or one of a later version."""
    path = folder / FILE
    content = known_format(read_json(path), path)
    for key in StudySummary.lacking(content):
        raise InputError(f"{folder}: not a folder of `sprain-cosim study`: {key} is missing")
    return StudySummary.from_json(content, str(path))
