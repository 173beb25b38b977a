"""What a study's trials say: moments, percentiles with intervals, sensitivities, injury questions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..cosim.result import CONVERGED, UNCONVERGED
from ..cosim.system import LEFT
from ..metrics import LATE, SUNK, THROWN_TEXT, earlier, longer, pose_artefacts, unit_of
from ..processor import one_thread
from ..records import finite
from ..uq import sensitivity, statistics
from ..uq.dependent import dependent_shares
from ..uq.design import DesignResult
from ..uq.distributions import Array, LogNormal, Marginal, Normal, Weibull
from ..uq.exceedance import Bounds, Exceedance, doubted_exceedance, input_interval, weighted_exceedance
from ..uq.measured import Measured
from ..uq.reliability import FormResult, LevelCheck, LevelResult, RareEvent, Status, level_exceedance
from ..uq.sensitivity import SobolIndices
from .design import design_summary
from .groups import input_groups
from .looks import confidence_of, until_rule
from .marginals import Fitted
from .plan import Plan
from .questions import LITERATURE, Question, computed_response, threshold_text
from .summary import (
    GIVEN_ROWS,
    PAIR,
    Axis,
    ChaosFit,
    Coefficient,
    Curve,
    FactorIntervals,
    Factors,
    FormSearch,
    Grid,
    InputSensitivity,
    Level,
    LevelSearch,
    LevelTest,
    LinearFit,
    Percentile,
    Probability,
    Response,
    SampleFit,
    Sensitivity,
    SobolIndex,
    SobolSearch,
    StoppingRule,
    StudySummary,
)
from .summary import Threshold as Limit
from .worker import AGAIN, made_again

if TYPE_CHECKING:
    import pandas as pd

Found = LevelResult | FormResult | RareEvent | SobolIndices | DesignResult  # by a search

PERCENTILES = (0.05, 0.5, 0.95)  # that every summary has
FEWEST = 4  # completed trials for moments
LEAST = 20  # completed trials for sensitivities and probabilities
RESAMPLES = 1000  # of the bootstrap
# trials above which intervals of sensitivity factors are ± 1.96 standard errors, and polynomial chaos takes the first
# rows alone
MANY = 20_000
FOR_CHAOS = 100  # completed trials for polynomial chaos
PREDICTED = 0.95  # of left-out variance, below which what is missing is told
CHAOS_DEGREE = 3  # at most; seconds instead of minutes for ten inputs and thousands of trials
SHARES = tuple(f"{kind}{end}" for kind in ("first", "total", "shapley") for end in ("", "_low", "_high"))
FACTORS = ("dmean_dmean", "dmean_dsd", "dsd_dmean", "dsd_dsd")
PEAK_TIME = "time_of_peak_subtalar_s"
CURVE = 41  # thresholds of a curve
REWEIGHTED = 4_000  # rows that specimens behind inputs are judged from
UNCHECKED = (
    "the levels were not tested on random landings: slopes, curvature and order alone have called levels right that "
    "are off by ten percentage points; leave --no-check out"
)
GIVEN_DATA = (
    "a Monte Carlo sample of a few hundred trials gives these indices too (Sobol first total in its table), more "
    "exactly and from fewer landings wherever the polynomial behind them predicts 90 % or more of left-out variance"
)
FIRST_ORDER_ALONE = (
    "first order alone: one design point, no test of the sphere, no curvature, no interval; leave --no-check out for a "
    "probability with one"
)
TWO_THRESHOLDS = (
    "the two injury questions measure different things and need not agree: an angle at which ankles of cadavers "
    "failed, and a moment that this model's passive ankle reaches long before that angle; compare braces by one of them"
)


@one_thread()
def summarise(study: Plan, trials: pd.DataFrame, found: Found | None) -> StudySummary:
    """What the trials say, or what a search `found`. Raises InputError for a response that is no metric.

    What they cannot say is left out or None, and `notes` says why."""
    done = trials[trials["status"] == "completed"]
    metrics = list(trials.columns[3 + len(study.names) :])
    for name in dict.fromkeys((*study.responses, *(q.response for q in study.questions))) if len(done) else ():
        computed_response(name, metrics)
    apart = study.scenario.isolation(of_trials=True)
    summary = StudySummary(
        study=study.source,
        title=study.heading,
        method=study.method,
        seed=study.seed,
        initial_pose=study.scenario.initial_pose(),
        n_requested=study.trials if found is None and study.method != "grid" and not study.watched else len(trials),
        n_completed=len(done),
        n_failed=len(trials) - len(done),
        failures={
            str(status): int(count)
            for status, count in trials["status"].value_counts().items()
            if status != "completed"
        },
        warnings=tuple(dict.fromkeys((*study.warnings, *study.scenario.doubts()))) or None,
        dropped=tuple(study.scenario.dropped),
        isolation=apart.kind,
        granted=apart.granted,
        fits={name: _fit(fit) for name, fit in study.fits.items() if name in _specimens(study)} or None,
    )
    if found is not None:
        return _with_search(summary, study, found)
    summary = _with_sample(summary, study, trials, done, metrics)
    if study.method == "grid":
        return summary
    values = {name: done[name].to_numpy(float) for name in study.responses if name in done}
    return replace(summary, groups=input_groups(study.headings, done, values, list(values)))


def _fit(fit: Fitted) -> SampleFit:
    return SampleFit(fit.law, fit.n, fit.file, finite(fit.aicc), fit.anderson_darling, fit.p_value, fit.warnings)


def _specimens(study: Plan) -> dict[str, Measured | None]:
    """{input that varies as it was measured: its law and the specimens behind it; None where the doubt about its
    parameters cannot be carried on}."""
    correlated = np.zeros(len(study.marginals), bool)
    if study.correlation is not None:
        correlated = (study.correlation != np.eye(len(study.marginals))).any(axis=1)
    found = dict[str, Measured | None]()
    for (name, marginal), joined in zip(study.marginals.items(), correlated, strict=True):
        if name in study.fits and not marginal.is_fixed:
            alone = isinstance(marginal, Normal | LogNormal | Weibull) and not joined
            found[name] = Measured(marginal, study.fits[name].n) if alone else None
    return found


def _with_search(summary: StudySummary, study: Plan, found: Found) -> StudySummary:
    if isinstance(found, FormResult):
        said = (FIRST_ORDER_ALONE, *_without_specimens(study), *_other_questions(study))
        return replace(summary, form=_form(study, found), notes=said)
    if isinstance(found, RareEvent):
        form, said = _rare(study, found)
        return replace(summary, form=form, notes=(*said, *_other_questions(study)))
    if isinstance(found, SobolIndices):
        said = (GIVEN_DATA, *_unbalanced(study.trials, study.sequences))
        if any(np.isnan(end).any() for end in (found.first_low, found.total_low)):
            said = (f"{study.trials} points are too few for intervals of these indices: nobody knows them", *said)
        return replace(summary, sobol=_sobol(study, found), notes=said)
    if isinstance(found, DesignResult):
        return design_summary(summary, study, found)
    notes: list[str] = []
    questions = _questions_of_levels(study, found, notes)
    if found.check is None:
        notes.append(UNCHECKED)
    elif open_levels := [f"{100 * p:g} %" for p, v in found.check.verdict.items() if v == "undecided"]:
        notes.append(
            f"{found.check.n} random landings could not settle whether these levels are right: "
            f"{', '.join(open_levels)}; their intervals say how far off they may be"
        )
    return replace(summary, amv=_levels(study, found), questions=questions, notes=tuple(notes))


def _coupling(study: Plan, done: pd.DataFrame) -> list[str]:
    """How many of the trials that were made again at half their step have not converged."""
    told = int(done["message"].astype(str).str.startswith(UNCONVERGED).sum())
    if not told:
        return []
    again = sum(made_again(row) for row in done[study.headings].to_numpy(float).tolist())
    return [
        f"{UNCONVERGED} in {told} of the {again} trials that were made again at half the step (one in {AGAIN}): there "
        f"the peak of the foot is uncertain by more than {CONVERGED:g} deg; the messages in trials.csv say by how much"
    ]


def _left_ranges(done: pd.DataFrame) -> list[str]:
    """How many of the landings brought a device where its FMU is not declared for."""
    told = done["message"].astype(str)
    told = told[told.str.contains(LEFT, regex=False)]
    if told.empty:
        return []
    inputs = sorted({part.split()[0] for text in told for part in text.split("; ") if LEFT in part})
    return [
        f"in {len(told)} of {len(done)} trials {', '.join(inputs)} went {LEFT}: what the device does there was not "
        "measured; the messages in trials.csv say how far"
    ]


def _doubtful_peaks(study: Plan, done: pd.DataFrame) -> list[str]:
    """How many of the landings end before the foot has turned back, have no roll, or their peak when the body lies."""
    if PEAK_TIME not in done:
        return []
    stop, time, found = study.scenario.master.stop, done[PEAK_TIME], []
    cut, never, late = (int(n.sum()) for n in (time >= stop * (1.0 - 1e-9), time == 0.0, time > LATE))
    if cut:
        found.append(
            f"in {cut} of {len(done)} trials the foot still turned at the stop ({1e3 * stop:g} ms): their peaks are "
            f"the largest angles until then; {longer(stop)}"
        )
    if never:
        found.append(
            f"in {never} of {len(done)} trials the foot never rolled outwards: their peaks are the angles at contact"
        )
    if late:
        found.append(f"{SUNK} (supination in {late} of {len(done)} trials); {earlier()}")
    return found


def _unknown_factors(n: int) -> list[str]:
    least = sensitivity.FOURTH_ORDER
    too_few = f"{n} completed trials: factors dSD/dSD without errors below {least}, which would be too small"
    return [too_few] if n < least else []


def _with_sample(
    summary: StudySummary, study: Plan, trials: pd.DataFrame, done: pd.DataFrame, metrics: Sequence[str]
) -> StudySummary:
    notes: list[str] = []
    sample = _Sample.of(study, done, summary.n_failed, notes)
    if len(done) < FEWEST:
        notes.append(f"{len(done)} completed trials: mean, SD and percentiles take {FEWEST}, probabilities {LEAST}")
    elif len(done) < LEAST:
        notes.append(f"{len(done)} completed trials: no sensitivities and no probabilities below {LEAST}")
    values = {name: done[name].to_numpy(float) for name in metrics}
    responses = {}
    if len(done) >= FEWEST:
        responses = {name: sample.response(y, study.levels_of(name)) for name, y in values.items()}
        first = study.responses[0]
        notes += _open_ends(responses[first], sample, len(done)) + _whatever_failed(
            first, responses[first], len(trials)
        )
    moved: dict[str, Sensitivity] = {}
    if study.method == "monte-carlo" and len(done) >= LEAST:
        x = done[study.headings].to_numpy(float)
        moved = {name: _sensitivity(study, x, values[name]) for name in study.responses}
        notes += _unknown_factors(len(done))
    questions, curves = dict[str, Probability](), dict[str, Curve]()
    notes += _apart(study, moved) + _not_predicted(moved)
    if len(done) >= LEAST and study.method != "grid":
        asked = [q for q in study.exceedances if q.response in values]
        questions = {q.name: sample.question(q, values[q.response]) for q in asked}
        questions = _with_inputs(study, done, questions, asked, notes)
        curves = {q.response: sample.curve(values[q.response]) for q in asked}
        if all(q.name in questions for q in LITERATURE):
            notes.append(TWO_THRESHOLDS)
    notes += [*_coupling(study, done), *_left_ranges(done), *_doubtful_peaks(study, done)]
    thrown = pose_artefacts(responses, summary.initial_pose)
    if thrown:
        notes.append(f"{THROWN_TEXT} ({', '.join(thrown)})")
    return replace(
        summary,
        responses=responses,
        sensitivity=moved,
        questions=questions,
        curves=curves or None,
        notes=tuple(notes),
        grid=_grid(study, trials) if study.method == "grid" else None,
        stopping=_stopping(study, sample, values[study.responses[0]]) if responses else None,
        until=until_rule(study, trials),
    )


def _with_inputs(
    study: Plan,
    done: pd.DataFrame,
    found: Mapping[str, Probability],
    asked: Sequence[Question],
    notes: list[str],
) -> dict[str, Probability]:
    """The probabilities with what the specimens behind measured inputs leave open, where the trials can tell."""
    specimens = _specimens(study)
    columns = {k: specimens[name] for k, name in enumerate(study.names) if specimens.get(name) is not None}
    lost = [name for name, law in specimens.items() if law is None]
    if lost:
        notes.append(f"the specimens behind {', '.join(lost)} are not carried on: its law is cut or correlated")
    if not columns:
        return dict(found)
    rows = done.iloc[:REWEIGHTED]
    x, out = rows[study.headings].to_numpy(float), dict[str, Probability]()
    for question in asked:
        probability = out[question.name] = found[question.name]
        threshold = question.threshold
        if threshold is None or isinstance(threshold, Bounds):
            continue
        law = threshold.marginal if isinstance(threshold, Measured) else threshold
        y = rows[question.response].to_numpy(float)
        try:
            e = input_interval(x, y, law, {k: m for k, m in columns.items() if m is not None}, seed=study.seed)
        except ValueError as problem:
            notes.append(f"{question.name}: what the inputs' specimens leave open is not known: {problem}")
            continue
        more = f" The specimens behind the inputs leave {e.low:.3g} ... {e.high:.3g} open."
        out[question.name] = replace(
            probability,
            inputs_ci=(finite(e.low), finite(e.high)),
            sentence=f"{probability.sentence or ''}{more}".strip(),
        )
    return out


@dataclass(frozen=True)
class _Sample:
    """How the trials were drawn, hence which intervals they allow.

    failed       number of trials that did not complete
    independent  rows are independent draws
    replicates   of a complete Sobol' study, else None
    confidence   of each interval; where one looks several times, so that all looks hold together with 95 %
    bounded      the mean's interval is at most that of independent rows
    """

    failed: int
    independent: bool
    replicates: int | None
    confidence: float = 0.95
    bounded: bool = False

    @classmethod
    def of(cls, study: Plan, done: pd.DataFrame, failed: int, notes: list[str]) -> Self:
        """Adds to `notes` how the intervals come about."""
        replicates = None
        if study.method == "sobol":
            whole = (
                not failed and np.array_equal(done["trial"], np.arange(len(done))) and len(done) % study.sequences == 0
            )
            if whole and study.sequences >= statistics.MIN_REPLICATES:
                replicates = study.sequences
                notes.append(f"intervals from the spread over {replicates} scrambled Sobol' sequences")
                notes += _unbalanced(len(done), replicates)
            else:
                notes.append(
                    f"no intervals of percentiles: they need {statistics.MIN_REPLICATES} complete replicates; "
                    "probabilities as from independent trials"
                )
        elif study.method == "lhs":
            notes.append(
                "one Latin hypercube has no intervals of its own: percentiles and standard deviations are given "
                "without; those of mean and probabilities are the ones of independent trials, which a Latin hypercube "
                "does not exceed (A. B. Owen, SIAM J. Numer. Anal. 34, 1997, 1884)"
            )
        elif study.method == "table":
            notes.append(GIVEN_ROWS)
            notes += _held_in_table(study, done)
        elif study.method == "grid":
            notes.append("a grid is no sample: moments and percentiles describe its points, no probability is theirs")
        confidence = confidence_of(study)
        if study.watched:
            notes.append(
                f"intervals of percentiles, moments and probabilities are {100 * confidence:.3g} % each, so that they "
                "hold with 95 % however often one looked"
            )
        return cls(failed, study.method in ("monte-carlo", "table"), replicates, confidence, study.method == "lhs")

    def percentile(self, y: Array, p: float) -> statistics.Estimate:
        if self.replicates:
            return statistics.replicated_percentile(y, self.replicates, p)
        e = statistics.percentile(y, p, self.confidence)
        return e if self.independent else statistics.Estimate(e.value, math.nan, math.nan)

    def exceedance(self, y: Array, threshold: float | Marginal) -> statistics.Estimate:
        if self.replicates:
            return statistics.replicated_exceedance(y, self.replicates, threshold)
        return statistics.exceedance(y, threshold, self.confidence, self.failed)

    def question(self, question: Question, y: Array) -> Probability:
        assert question.threshold is not None
        found = doubted_exceedance(
            y, question.threshold, failed=self.failed, sampler=lambda threshold: self.exceedance(y, threshold)
        )
        return _probability(question, found, self.failed)

    def curve(self, y: Array) -> Curve:
        """Over the range of the sample."""
        at = np.linspace(y.min(), y.max(), CURVE)
        found = [self.exceedance(y, float(t)) for t in at]
        return Curve(
            tuple(at.tolist()),
            tuple(finite(e.value) for e in found),
            tuple(finite(e.low) for e in found),
            tuple(finite(e.high) for e in found),
        )

    def response(self, y: Array, levels: Iterable[float]) -> Response:
        """With the percentiles that every summary has, and those of `levels`."""
        if self.replicates:
            mean, sd = statistics.replicated_moments(y, self.replicates)
        else:
            mean, sd = (
                statistics.mean(y, self.confidence, skewed=True),
                statistics.standard_deviation(y, self.confidence),
            )
        percentiles = {}
        for p in sorted({*PERCENTILES, *levels}):
            e = self.percentile(y, p)
            bounds = None
            if self.failed:
                low, high = statistics.percentile_bounds(y, self.failed, p)
                bounds = (finite(low), finite(high))
            percentiles[f"{100 * p:g}"] = Percentile(finite(e.value), finite(e.low), finite(e.high), bounds)
        mean_ci, sd_ci = ((finite(e.low), finite(e.high)) for e in (mean, sd))
        if not (self.independent or self.replicates):
            known = mean_ci if self.bounded else None
            return Response(finite(mean.value), finite(sd.value), percentiles, known, failed=self.failed or None)
        return Response(finite(mean.value), finite(sd.value), percentiles, mean_ci, sd_ci, self.failed or None)


def _open_ends(found: Response, sample: _Sample, n: int) -> list[str]:
    """The levels whose interval has an open end, since too few trials lie beyond, and how many would close it."""
    levels = [level for level, p in found.percentiles.items() if None in (p.ci_low, p.ci_high)]
    if not levels or not sample.independent:
        return []
    tail = min(min(float(level), 100.0 - float(level)) for level in levels) / 100.0
    needed = math.ceil(math.log(0.5 * (1.0 - sample.confidence)) / math.log1p(-tail))
    return [
        f"{n} trials leave an end of the interval of {', '.join(f'{level} %' for level in levels)} open: the level may "
        f"lie anywhere beyond it; {needed} trials close it"
    ]


def _whatever_failed(name: str, found: Response, n: int) -> list[str]:
    """Between which values the levels would lie, whatever the failed trials had given."""
    if not found.failed:
        return []
    levels = []
    for level, p in found.percentiles.items():
        if p.with_failures is not None:
            ends = ("open" if end is None else f"{end:.2f}" for end in p.with_failures)
            levels.append(f"{level} % {' ... '.join(ends)}")
    return [
        f"{found.failed} of {n} landings failed: levels, moments and what moves them are those of the landings that "
        f"completed. Whatever the failed ones had given, {name} is {', '.join(levels)}"
    ]


def _held_in_table(study: Plan, done: pd.DataFrame) -> list[str]:
    """The inputs that were meant to vary and have one value in all rows of a table."""
    held = [
        name
        for (name, marginal), heading in zip(study.marginals.items(), study.headings, strict=True)
        if not marginal.is_fixed and len(done) > 1 and done[heading].nunique() == 1
    ]
    return [f"the same in all rows of the table, so that nothing here is due to it: {', '.join(held)}"] if held else []


def _unbalanced(n: int, sequences: int) -> list[str]:
    """A word where a Sobol' sequence ends between two powers of two."""
    points = n // sequences
    if not points & (points - 1):
        return []
    below = (1 << (points.bit_length() - 1)) * sequences
    return [
        f"{points} points a sequence are no power of two, where a Sobol' sequence is balanced: {below} or {2 * below} "
        "trials tell more for their number"
    ]


def _stopping(study: Plan, sample: _Sample, y: Array) -> StoppingRule | None:
    if study.half_width is None:
        return None
    rule = statistics.stopping_of({p: sample.percentile(y, p) for p in study.levels}, len(y), study.half_width)
    half = {f"{100 * p:g}": finite(h) for p, h in rule.half_width.items()}
    return StoppingRule(study.responses[0], rule.wanted, half, rule.met, rule.needed)


def _grid(study: Plan, trials: pd.DataFrame) -> Grid:
    shape = [len(levels) for levels in study.grid.values()]
    axes = tuple(Axis(name, study.units[name], tuple(levels)) for name, levels in study.grid.items())
    if len(trials) != math.prod(shape):
        return Grid(axes, {})
    values = {
        name: trials[name].where(trials["status"] == "completed").to_numpy(float).reshape(shape)
        for name in study.responses
        if name in trials
    }
    return Grid(axes, {name: _nested(v) for name, v in values.items()})


def _nested(values: Array) -> list[Any]:
    """An array as nested lists, None for NaN."""
    if values.ndim == 1:
        return [finite(v) for v in values]
    return [_nested(row) for row in values]


@dataclass(frozen=True)
class _Slopes:
    """Importance of the inputs (d,) with its standard error, and the share of the variance that is linear."""

    importance: Array
    error: Array
    r2: float

    @classmethod
    def of(cls, study: Plan, x: Array, y: Array) -> Self:
        """Of dependent inputs in physical space, where the order of the study's lines does not matter."""
        marginals = tuple(study.marginals.values())
        if study.correlation is None:
            fit = sensitivity.importance(x, y, marginals)
            return cls(fit.alpha, fit.standard_error, fit.r2)
        order = list(study.drawing)  # sums in one order, so that the last digit does not depend on the lines either
        correlation = study.correlation[np.ix_(order, order)]
        found = sensitivity.importance_x(x[:, order], y, [marginals[k] for k in order], correlation)
        column = np.argsort(order)
        return cls(found.alone[column], found.alone_error[column], found.r2)


def _physical(study: Plan, alpha: Array) -> Array:
    """A search's unit vector along each input's own standard score: of dependent inputs the one along independent
    variables depends on the order of the study's lines. A threshold after the inputs stays where it is."""
    if study.correlation is None:
        return alpha
    joint = study.joint
    turned = alpha.copy()
    turned[: len(joint)] = np.linalg.solve(joint.cholesky.T, alpha[: len(joint)])
    turned[[k for k, m in enumerate(joint.marginals) if m.is_fixed]] = 0.0
    norm = float(np.linalg.norm(turned))
    return turned / norm if norm > 0 else turned


def _sensitivity(study: Plan, x: Array, y: Array) -> Sensitivity:
    marginals = tuple(study.marginals.values())
    active = [i for i, m in enumerate(marginals) if not m.is_fixed]
    if not active or not np.ptp(y) > 0:
        return Sensitivity()
    r, rho = sensitivity.pearson(x[:, active], y), sensitivity.spearman(x[:, active], y)
    factors = sensitivity.sensitivity_factors(
        x, y, marginals, study.correlation, resamples=RESAMPLES if len(y) <= MANY else 0, seed=study.seed
    )
    slopes = None
    smooth = not any(m.is_discrete for m in marginals)  # a choice has no slope, and no place in a polynomial
    if smooth and len(y) > len(active) + 1:
        slopes = _Slopes.of(study, x, y)
    chaos = None
    if smooth and len(y) >= FOR_CHAOS:
        chaos = _indices(study, x[:MANY], y[:MANY])
    inputs = {}
    for k, i in enumerate(active):
        shares = dict[str, Any]() if chaos is None else _shares_of(chaos, i)
        inputs[study.names[i]] = InputSensitivity(
            _coefficient(r, k),
            _coefficient(rho, k),
            finite(factors.dmean_dmean[i]),
            finite(factors.dmean_dsd[i]),
            finite(factors.dsd_dmean[i]),
            finite(factors.dsd_dsd[i]),
            standard_error=Factors(*(finite(getattr(factors.standard_error, f)[i]) for f in FACTORS)),
            ci=FactorIntervals(*(_factor_interval(factors, f, i) for f in FACTORS)),
            importance=None if slopes is None else finite(slopes.importance[i]),
            importance_standard_error=None if slopes is None else finite(slopes.error[i]),
            **shares,
        )
    return Sensitivity(
        inputs,
        None if slopes is None else LinearFit(finite(slopes.r2)),
        None if chaos is None else ChaosFit(chaos.degree, chaos.terms, finite(chaos.q2)),
    )


def _indices(study: Plan, x: Array, y: Array) -> sensitivity.GivenDataIndices:
    """Of dependent inputs in one order, so that the last digit does not depend on the study's lines either."""
    marginals, seed = tuple(study.marginals.values()), study.seed
    if study.correlation is None:
        return sensitivity.given_data_indices(x, y, marginals, CHAOS_DEGREE, seed=seed)
    order = list(study.drawing)
    correlation, column = study.correlation[np.ix_(order, order)], np.argsort(order)
    drawn = [marginals[k] for k in order]
    found = dependent_shares(x[:, order], y, drawn, correlation, max_degree=CHAOS_DEGREE, seed=seed)
    return replace(found, **{name: getattr(found, name)[column] for name in SHARES})


def _shares_of(found: sensitivity.GivenDataIndices, i: int) -> dict[str, Any]:
    shares = dict[str, Any]()
    for ours, theirs in (("sobol_first", "first"), ("sobol_total", "total"), ("shapley", "shapley")):
        value, low, high = (finite(getattr(found, theirs + end)[i]) for end in ("", "_low", "_high"))
        shares |= {ours: value, f"{ours}_ci": (low, high)} if value is not None else {}
    return shares


def _apart(study: Plan, moved: Mapping[str, Sensitivity]) -> list[str]:
    """Where first and total shares of correlated inputs say different things: one line a response."""
    lines = []
    for response, found in moved.items() if study.correlation is not None else ():
        gaps = [
            (first - total, name, first, total, v.shapley)
            for name, v in found.inputs.items()
            if (first := v.sobol_first) is not None
            and (total := v.sobol_total) is not None
            and _disjoint(v.sobol_first_ci, v.sobol_total_ci)
        ]
        if gaps:
            _, name, first, total, shapley = max(gaps, key=lambda gap: abs(gap[0]))
            share = "" if shapley is None else f"; Shapley's share, which adds up over the inputs, is {shapley:.2f}"
            lines.append(
                f"{response}: {name} explains {first:.2f} of the variance with what goes along with it (first), and "
                f"{total:.2f} when all other inputs are known (total){share}"
            )
    return lines


def _not_predicted(moved: Mapping[str, Sensitivity]) -> list[str]:
    """Where the polynomial behind the shares of variance leaves much of it: one line a response."""
    shares = {name: found.chaos.q2 for name, found in moved.items() if found.chaos is not None}
    return [
        f"{name}: the polynomial behind the Sobol' and Shapley shares predicts {100 * max(q2, 0.0):.0f} % of left-out "
        f"variance; the other {100 * min(1.0 - q2, 1.0):.0f} % may belong to any input, which the intervals of these "
        "shares do not allow for"
        for name, q2 in shares.items()
        if q2 is not None and q2 < PREDICTED
    ]


def _disjoint(one: PAIR | None, other: PAIR | None) -> bool:
    (low, high), (least, most) = one or (None, None), other or (None, None)
    if low is None or high is None or least is None or most is None:
        return False
    return high < least or most < low


def _factor_interval(factors: sensitivity.SensitivityFactors, name: str, i: int) -> tuple[float | None, float | None]:
    if factors.low and factors.high:
        return finite(getattr(factors.low, name)[i]), finite(getattr(factors.high, name)[i])
    value, half = float(getattr(factors, name)[i]), 1.96 * float(getattr(factors.standard_error, name)[i])
    return finite(value - half), finite(value + half)


def _coefficient(r: sensitivity.Correlation, k: int) -> Coefficient:
    return Coefficient(*(finite(np.atleast_1d(end)[k]) for end in (r.value, r.low, r.high)))


def _named(names: Iterable[str], values: Iterable[float]) -> dict[str, float | None]:
    return {name: finite(value) for name, value in zip(names, values, strict=True)}


def _form(study: Plan, found: FormResult) -> FormSearch:
    threshold, names = study.limit, list(study.names)
    if isinstance(threshold, Marginal):
        limit = Limit(finite(threshold.mean), threshold_text(threshold, unit_of(study.responses[0])))
        names.append("threshold")
    else:
        limit = Limit(finite(threshold))
    return FormSearch(
        found.evaluations.requested,
        found.evaluations.executed,
        found.status,
        tuple(found.reasons),
        study.responses[0],
        finite(found.beta),
        finite(found.probability),
        limit,
        _named(names, _physical(study, found.alpha)),
        _named(names, found.design_point),
    )


def _rare(study: Plan, found: RareEvent) -> tuple[FormSearch, tuple[str, ...]]:
    """The estimate of sampling with what is not known of the threshold, and first and second order beside it; notes."""
    curved = found.sorm
    second = None
    if curved is not None:
        formulas = {"Breitung": curved.breitung, "Hohenbichler-Rackwitz": curved.hohenbichler, "Tvedt": curved.tvedt}
        second = {name: finite(value) for name, value in formulas.items()}
    form = replace(
        _form(study, found.form),
        evaluations_requested=found.evaluations.requested,
        evaluations_executed=found.evaluations.executed,
        status=found.status,
        reasons=found.reasons,
        probability=finite(found.probability.value),
        ci_low=finite(found.probability.low),
        ci_high=finite(found.probability.high),
        cov=finite(found.cov),
        first_order=finite(found.form.probability),
        second_order=second,
        sampled=found.sampling.trials,
        design_points=len(found.design_points.points),
        remarks=found.remarks,
    )
    threshold, rows = study.sought, found.sampling
    assert threshold is not None
    if not found.probability.value > 0:
        return form, ()
    try:
        open_of_it = weighted_exceedance(rows.y, rows.weights, threshold, found.probability, seed=study.seed)
    except ValueError as problem:
        return form, (str(problem),)
    known = open_of_it.threshold
    return replace(
        form,
        threshold_ci=None if known is None else (finite(known.low), finite(known.high)),
        shapes=dict(open_of_it.shapes) or None,
        specimens=open_of_it.specimens,
        dominates=open_of_it.dominates,
        sentence=open_of_it.sentence().replace("more trials", "more landings"),
    ), ()


def _without_specimens(study: Plan) -> tuple[str, ...]:
    """What first order alone leaves out of its threshold."""
    if not isinstance(study.sought, Measured):
        return ()
    return (f"the {study.sought.n} specimens behind the threshold are not in first order alone",)


def _other_questions(study: Plan) -> tuple[str, ...]:
    """What a search for one threshold does not answer."""
    asked = [q for q in study.exceedances if not q.literature]
    answered = (Question(study.responses[0], study.sought), Question(study.responses[0], study.limit))
    others = [q.name for q in asked if q not in answered]
    return (f"no answer to {', '.join(others)}: form asks one question",) if others else ()


def _sobol(study: Plan, found: SobolIndices) -> SobolSearch:
    ends = (found.first, found.first_low, found.first_high, found.total, found.total_low, found.total_high)
    indices = {name: SobolIndex(*(finite(end[i]) for end in ends)) for i, name in enumerate(study.names)}
    return SobolSearch(study.responses[0], finite(found.mean), finite(found.variance), found.evaluations, indices)


def _levels(study: Plan, found: LevelResult) -> LevelSearch:
    levels = {}
    for p, value in found.value.items():
        key = f"{100 * p:g}"
        known = study.beside.get("monte_carlo", {}).get(f"{key} % [deg]")
        levels[key] = Level(
            finite(value),
            _named(study.names, _physical(study, found.importance[p])),
            _named(study.names, found.design_point[p]),
            found.iterations[p],
            # a method of the mean value family matches Monte Carlo if it lies in its interval
            statistics.agreement(value, statistics.Estimate(*known)) if known else None,
        )
    return LevelSearch(
        found.evaluations.requested,
        found.evaluations.executed,
        _worse(found.status, found.check.status) if found.check else found.status,
        (*found.reasons, *(found.check.reasons if found.check else ())),
        study.responses[0],
        levels,
        _named(study.names, _physical(study, found.linear_importance)),
        finite(found.mean),
        finite(found.sd),
        None if found.check is None else _level_test(found.check),
    )


def _worse(one: Status, other: Status) -> Status:
    order: tuple[Status, ...] = ("ok", "suspect", "rejected")
    return max(one, other, key=order.index)


def _level_test(check: LevelCheck) -> LevelTest:
    """In percentage points."""
    return LevelTest(
        check.n,
        {f"{100 * p:g}": finite(100 * e.value) for p, e in check.off.items()},
        {f"{100 * p:g}": (finite(100 * e.low), finite(100 * e.high)) for p, e in check.off.items()},
        {f"{100 * p:g}": v for p, v in check.verdict.items()},
    )


def _questions_of_levels(study: Plan, found: LevelResult, notes: list[str]) -> dict[str, Probability]:
    asked = [q for q in study.exceedances if q.response == study.responses[0]]
    others = [q.name for q in study.exceedances if not q.literature and q not in asked]
    if others:
        notes.append(f"no answer to {', '.join(others)}: a search looks at {study.responses[0]} alone")
    if not asked:
        notes.append(
            f"no injury probabilities: they need a response among {', '.join(q.response for q in LITERATURE)}, a "
            "threshold or a question"
        )
        return {}
    notes.append(
        "probabilities interpolate the levels; a search has no sampling error, and its own error is not known: no "
        "interval"
        if found.check is None
        else f"probabilities interpolate the levels, corrected by the {found.check.n} random landings that test them, "
        "from which their intervals come"
    )
    try:
        y = statistics.levels_as_sample(found.value)
    except ValueError as problem:
        notes.append(f"no probability: {problem}")
        return {}
    return {q.name: _of_levels(study, q, y, found) for q in asked}


def _of_levels(study: Plan, question: Question, y: Array, levels: LevelResult) -> Probability:
    """The question put to the distribution `y` between levels. With random landings that test them its value and its
    interval are theirs, the distribution being their control variate."""
    assert question.threshold is not None
    found = doubted_exceedance(y, question.threshold)
    if levels.check is not None:

        def corrected(threshold: float | Marginal) -> statistics.Estimate:
            assert levels.check is not None
            return level_exceedance(tuple(study.marginals.values()), levels, levels.check, threshold, study.correlation)

        tested = doubted_exceedance(y, question.threshold, sampler=corrected)
        sentence = tested.sentence().replace("more trials", "more landings")
        if not isinstance(question.threshold, Bounds):
            sentence = f"The levels alone say {found.value:.3g}. {sentence}"
        return replace(_probability(question, tested, None), trials=levels.check.n, sentence=sentence)
    found = replace(found, sampling=statistics.Estimate(found.value, math.nan, math.nan))
    sentence = "How far the levels are off is not in it; "
    if found.threshold is not None:
        sentence += f"the threshold leaves {found.threshold.low:.3g} ... {found.threshold.high:.3g} open."
    else:
        sentence += "nothing is known of the threshold beyond its law." if found.shapes else "the threshold is known."
    return replace(_probability(question, found, None), trials=None, dominates=None, sentence=sentence)


def _probability(question: Question, found: Exceedance, failed: int | None) -> Probability:
    sampling, threshold = found.sampling, found.threshold
    low, high = finite(sampling.low), finite(sampling.high)
    return Probability(
        question.event,
        finite(found.value),
        low,
        high,
        question.response,
        question.source,
        None if low is None or high is None else (low, high),
        None if threshold is None else (finite(threshold.low), finite(threshold.high)),
        dict(found.shapes) or None,
        found.specimens,
        found.dominates,
        found.sentence(),
        trials=found.trials,
        failed=failed,
    )
