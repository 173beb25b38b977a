"""A finished study's sample in the form of SALib and of OpenTURNS, so that any of their analyses can follow.

Columns are in the units of trials.csv, the parameters' own, and named with them. Both tools are needed only to go on
with what they are handed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import EnvironmentProblem, InputError
from ..files import is_missing
from ..folders.study import StudyFolder, read_study
from ..machine.here import SYSTEM
from ..metrics import unit_of
from ..notebook import Card, Rows
from ..study.folder import WORDS, missing, recorded_plan
from ..study.inputs import heading_of
from ..study.ledger import FILE as LEDGER
from ..study.ledger import Ledger
from ..study.plan import Plan
from ..study.summary import FILE as SUMMARY
from ..uq.distributions import (
    Array,
    Beta,
    Choices,
    Empirical,
    Exponential,
    JointDistribution,
    LogNormal,
    Marginal,
    Normal,
    Triangular,
    Truncated,
    Uniform,
    Weibull,
)

if TYPE_CHECKING:
    import pandas as pd

RANDOM = ("monte-carlo", "lhs", "sobol")
INDICES = "sobol-indices"
GIVEN = ("grid", "table")  # rows that somebody chose: their inputs have no distribution
GIVEN_DATA = ("delta", "rbd_fast", "pawn")
PLAIN = "run it with method sobol or monte-carlo, whose sample serves SALib's delta, rbd_fast and pawn"


@dataclass(frozen=True, repr=False)
class SalibSample(Card):
    """What SALib's analyses take: `SALib.analyze.pawn.analyze(s.problem, s.X, s.Y["peak_subtalar_angle_deg"])`.

    problem   num_vars, names ("component.parameter [unit]"), bounds and dists as SALib spells them
    X         (n, d) inputs in those units; of a sobol-indices study in the order of
              `SALib.sample.sobol.sample(problem, N, calc_second_order=False)`
    Y         {response: (n,)}
    units     {input or response: unit}, "1" where there is none
    trials    (n,) trial numbers of the rows
    failed    trials that failed and are left out
    analyses  names of the modules in SALib.analyze that fit the sample; sobol with calc_second_order=False
    notes     what a reader must know about the numbers, one line each
    """

    problem: dict[str, Any]
    X: Array
    Y: Mapping[str, Array]
    units: Mapping[str, str]
    trials: np.ndarray
    failed: int
    analyses: tuple[str, ...]
    notes: tuple[str, ...]

    def card(self) -> tuple[str, Rows]:
        rows = _size(self.problem["names"], self.Y, self.failed)
        return f"{len(self.trials)} trials", [*rows, ("analyses", ", ".join(self.analyses)), *_numbered(self.notes)]


@dataclass(frozen=True, repr=False)
class OpenturnsSample(Card):
    """What OpenTURNS takes.

    inputs        openturns.Sample (n, d) with the names "component.parameter [unit]" as description
    outputs       openturns.Sample (n, m), likewise, of the responses
    distribution  openturns.JointDistribution of the inputs with a normal copula where they are correlated; None where
                  they have none or OpenTURNS has no such, with a note
    size          of a sobol-indices study: `openturns.SaltelliSensitivityAlgorithm(inputs, output, size)`; else 0
    units         {input or response: unit}, "1" where there is none
    trials        (n,) trial numbers of the rows
    failed        trials that failed and are left out
    notes         what a reader must know about the numbers, one line each
    """

    inputs: Any
    outputs: Any
    distribution: Any
    size: int
    units: Mapping[str, str]
    trials: np.ndarray
    failed: int
    notes: tuple[str, ...]

    def card(self) -> tuple[str, Rows]:
        rows = _size(self.inputs.getDescription(), self.outputs.getDescription(), self.failed)
        known = "none" if self.distribution is None else self.distribution.getClassName()
        return f"{len(self.trials)} trials", [*rows, ("distribution", known), *_numbered(self.notes)]


def _size(inputs: Iterable[str], responses: Iterable[str], failed: int) -> list[tuple[str, str]]:
    rows = [("inputs", ", ".join(inputs)), ("responses", ", ".join(responses))]
    return [*rows, ("failed and left out", str(failed))] if failed else rows


def _numbered(notes: Sequence[str]) -> list[tuple[str, str]]:
    return [(f"note {k}", text) for k, text in enumerate(notes, 1)]


def to_salib(folder: str | Path) -> SalibSample:
    """The sample of a study's folder as SALib takes it. Raises InputError for a folder of no finished study, for a
    method that chooses its trials one after another, and for a sobol-indices study with failed trials.

    >>> import sprain_cosim as sc
    >>> sample = sc.to_salib("runs/s6")
    >>> sample.X.shape, sample.problem["names"][0]
    ((8, 10), 'plant.drop_height [m]')
    """
    sample = _Sample.read(Path(folder))
    names, notes = list(sample.names), list(sample.notes)
    bounds, dists, by_ends = list[list[float]](), list[str](), list[str]()
    for name, marginal, column in zip(names, sample.marginals, sample.x.T, strict=True):
        spelled = None if marginal is None else _salib(marginal)
        if spelled is None:
            spelled = "unif", [float(column.min()), float(column.max())]
            by_ends.append(name if marginal is None else f"{name} ({type(marginal).__name__.lower()})")
        dists.append(spelled[0])
        bounds.append(spelled[1])
    if by_ends:
        notes.append(f"without a distribution that SALib has, bounds are the ends of the sample: {', '.join(by_ends)}")
    rows = np.arange(len(sample.x))
    analyses: tuple[str, ...] = () if sample.method == "grid" else GIVEN_DATA
    if sample.size:
        a, b, *mixed = rows.reshape(-1, sample.size)
        rows, analyses = np.stack([a, *mixed, b], axis=1).ravel(), ("sobol",)
    elif sample.correlated or sample.method == "table":
        analyses = tuple(name for name in GIVEN_DATA if name != "rbd_fast")
    if sample.correlated:
        notes.append("the inputs are correlated, which SALib's problem cannot say: rbd_fast does not fit")
    return SalibSample(
        problem={"num_vars": len(names), "names": names, "bounds": bounds, "dists": dists},
        X=sample.x[rows],
        Y={name: values[rows] for name, values in sample.y.items()},
        units=sample.units,
        trials=sample.trials[rows],
        failed=sample.failed,
        analyses=analyses,
        notes=tuple(notes),
    )


def to_openturns(folder: str | Path) -> OpenturnsSample:
    """The sample of a study's folder as OpenTURNS takes it. Raises InputError as `to_salib`, EnvironmentProblem when
    OpenTURNS is not installed.

    >>> import sprain_cosim as sc
    >>> sc.to_openturns("runs/s6").inputs.getSize()
    8
    """
    sample = _Sample.read(Path(folder))
    try:
        import openturns as ot
    except ImportError:
        raise EnvironmentProblem(
            'OpenTURNS needs the extra [reliability]: pip install "sprain-cosim[reliability]"'
        ) from None
    inputs, outputs = ot.Sample(sample.x), ot.Sample(np.column_stack(list(sample.y.values())))
    inputs.setDescription(sample.names)
    outputs.setDescription(list(sample.y))
    distribution, notes = None, sample.notes
    if sample.joint is not None:
        marginals = [_openturns(marginal, ot) for marginal in sample.joint.marginals]
        without = [name for name, marginal in zip(sample.names, marginals, strict=True) if marginal is None]
        if without:
            notes = (*notes, f"OpenTURNS has no distribution of {', '.join(without)}: there is no joint distribution")
        elif sample.correlated:
            copula = ot.NormalCopula(ot.CorrelationMatrix(sample.joint.normal_correlation.tolist()))
            distribution = ot.JointDistribution(marginals, copula)
        else:
            distribution = ot.JointDistribution(marginals)
        if distribution is not None:
            distribution.setDescription(sample.names)
    return OpenturnsSample(
        inputs, outputs, distribution, sample.size, sample.units, sample.trials, sample.failed, notes
    )


@dataclass(frozen=True)
class _Sample:
    """The completed trials of a study, of the inputs that vary.

    x (n, d) and {response: (n,)} y; `size` base points where the rows are Saltelli's blocks A, B, and A with one column
    of B after another, else 0; `marginals` (d,), None where nothing says them; `joint` where all are known."""

    method: str
    names: tuple[str, ...]
    x: Array
    y: Mapping[str, Array]
    units: Mapping[str, str]
    trials: np.ndarray
    failed: int
    marginals: tuple[Marginal | None, ...]
    joint: JointDistribution | None
    correlated: bool
    size: int
    notes: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> _Sample:
        folder = _study_with_sample(path)
        method, done = folder.summary.method, folder.done
        failed, notes = len(folder.trials) - len(done), list(folder.summary.notes)
        if failed:
            notes.append(f"{failed} of {len(folder.trials)} trials failed and are left out")
        if folder.summary.shard is not None:
            notes.append("part {} of {} of a study".format(*folder.summary.shard))
        inputs = [str(c) for c in done.columns if heading_of(str(c))[0] in folder.varied]
        holes = [name for name in inputs if done[name].isna().any()]
        if holes:
            raise InputError(f"{path}: trials.csv, column {holes[0]}: a completed trial has no value")
        still = [name for name in inputs if done[name].min() == done[name].max()]
        names = tuple(name for name in inputs if name not in still)
        if not names:
            raise InputError(f"{path}: no input varies over its completed trials ({len(done)})")
        if still:
            notes.append(f"does not vary, left out: {', '.join(still)}")
        y = _responses(done, inputs, notes)
        if not y:
            raise InputError(f"{path}: its completed trials have no response in common")
        x, numbers = done[list(names)].to_numpy(float), done["trial"].to_numpy()
        plan = _plan_of(folder)
        marginals: tuple[Marginal | None, ...] = (None,) * len(names)
        joint, correlated = None, bool(folder.manifest.identity.get("correlation"))
        if method in GIVEN:
            notes.append(f"the rows of a {method} have no distribution")
        elif plan is None:
            notes.append("its distributions are not recorded")
        else:
            marginals, joint = _distributions(path, plan, names)
            correlated = not joint.is_independent or plan.population is not None  # of two sexes, by the choice of one
        size = _base_points(path, x, numbers, failed) if method == INDICES else 0
        units = {name: heading_of(name)[1] or "1" for name in names} | {name: unit_of(name) or "1" for name in y}
        return cls(method, names, x, y, units, numbers, failed, marginals, joint, correlated, size, tuple(notes))


def _study_with_sample(path: Path) -> StudyFolder:
    """Raises InputError for a folder without a finished sample."""
    if not (path / SUMMARY).is_file():
        if missing := is_missing(path):
            raise InputError(f"{path}: {missing}")
        begun = (path / LEDGER).is_file()
        text = "the study is not finished; continue it with" if begun else "no study in it; make one with"
        out = SYSTEM.quoted(str(path))
        raise InputError(f"{path}: {text} `sprain-cosim study STUDY --out {out}{' --resume' if begun else ''}`")
    folder = read_study(path)
    method = folder.summary.method
    if method not in (*RANDOM, *GIVEN, INDICES):
        raise InputError(f"{path}: method {method} chooses its trials, they are no sample of the inputs; {PLAIN}")
    if folder.done.empty:
        raise InputError(f"{path}: no trial completed; there is nothing to hand over")
    return folder


def _responses(done: pd.DataFrame, inputs: Sequence[str], notes: list[str]) -> dict[str, np.ndarray]:
    """{response: values} of those that every completed trial has; the others are noted."""
    named = [str(c) for c in done.columns if c not in ("trial", *WORDS, *inputs)]
    found = [name for name in named if done[name].notna().any()]
    gaps = [name for name in found if done[name].isna().any()]
    if gaps:
        notes.append(f"not known of every completed trial, left out: {', '.join(gaps)}")
    return {name: done[name].to_numpy(float) for name in found if name not in gaps}


def _plan_of(folder: StudyFolder) -> Plan | None:
    """The study as its ledger records it; None where there is no ledger or an older one that does not say."""
    if not (folder.path / LEDGER).is_file():
        return None
    with Ledger.read(folder.path) as ledger:
        return None if ledger.said("study") is None else recorded_plan(folder.path, ledger)


def _distributions(path: Path, plan: Plan, names: tuple[str, ...]) -> tuple[tuple[Marginal, ...], JointDistribution]:
    place = {heading: k for k, heading in enumerate(plan.headings)}
    strange = [name for name in names if name not in place]
    if strange:
        raise InputError(f"{path}: trials.csv, column {strange[0]}: is no input of the study that the ledger records")
    kept, all_marginals = [place[name] for name in names], list(plan.marginals.values())
    marginals = tuple(all_marginals[k] for k in kept)
    correlation = None if plan.correlation is None else plan.correlation[np.ix_(kept, kept)]
    return marginals, JointDistribution(marginals, correlation)


def _base_points(path: Path, x: Array, numbers: np.ndarray, failed: int) -> int:
    """How many base points a sample of Sobol' indices has. Raises InputError unless it is whole and in its order."""
    designs = x.shape[1] + 2
    if failed or len(x) % designs or not np.array_equal(numbers, np.arange(len(x))):
        lost = sorted({*range(int(numbers.max()) + 1)} - {*numbers.tolist()})
        which = f" (without trial {missing(lost)})" if lost else ""
        raise InputError(f"{path}: Sobol' indices need every trial{which}; {PLAIN}")
    a, b, *mixed = x.reshape(designs, -1, x.shape[1])
    for k, block in enumerate(mixed):
        expected = a.copy()
        expected[:, k] = b[:, k]
        if not np.array_equal(block, expected):
            raise InputError(f"{path}: trials.csv is not in the order of a study of Sobol' indices; {PLAIN}")
    return len(a)


def _salib(marginal: Marginal) -> tuple[str, list[float]] | None:
    """SALib's name and numbers of a distribution (SALib.util, `_nonuniform_scale_samples`); None: it has none."""
    match marginal:
        case Uniform():
            return "unif", [marginal.low, marginal.high]
        case Normal():
            return "norm", [marginal.mean, marginal.sd]
        case Truncated(parent=Normal() as parent):
            return "truncnorm", [marginal.low, marginal.high, parent.mean, parent.sd]
        case LogNormal():
            return "lognorm", [marginal.lam, marginal.zeta]
        case Weibull():
            return "weibull", [marginal.shape, marginal.scale]
        case Exponential():
            return "weibull", [1.0, marginal.mean]
        case Triangular() if marginal.high >= 0 and marginal.mode < marginal.high:  # others it refuses
            return "triang", [
                marginal.low,
                marginal.high,
                (marginal.mode - marginal.low) / (marginal.high - marginal.low),
            ]
    return None


def _openturns(marginal: Marginal, ot: Any) -> Any:
    """The same distribution of OpenTURNS; None: it has none."""
    match marginal:
        case Uniform():
            return ot.Uniform(marginal.low, marginal.high)
        case Normal():
            return ot.Normal(marginal.mean, marginal.sd)
        case LogNormal():
            return ot.LogNormal(marginal.lam, marginal.zeta)
        case Weibull():
            return ot.WeibullMin(marginal.scale, marginal.shape)
        case Exponential():
            return ot.Exponential(1.0 / marginal.mean)
        case Triangular():
            return ot.Triangular(marginal.low, marginal.mode, marginal.high)
        case Beta():
            return ot.Beta(marginal.alpha, marginal.beta, marginal.low, marginal.high)
        case Choices():
            return ot.UserDefined([[value] for value in marginal.values], marginal.probabilities)
        case Empirical() if len(set(marginal.values)) == len(marginal.values):  # a repeated value is a step
            values = np.sort(np.array(marginal.values))
            widths = np.diff(values)
            return ot.Histogram(values[0], widths, 1.0 / widths)
        case Truncated():
            parent, truncated = _openturns(marginal.parent, ot), ot.TruncatedDistribution
            if parent is None:
                return None
            if not math.isfinite(marginal.low):
                return truncated(parent, marginal.high, truncated.UPPER)
            if not math.isfinite(marginal.high):
                return truncated(parent, marginal.low, truncated.LOWER)
            return truncated(parent, marginal.low, marginal.high)
    return None
