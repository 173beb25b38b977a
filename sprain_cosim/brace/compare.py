"""The same landings with each of several braces and with none.

A scenario is one landing per brace; a study is its sample, drawn once and run with every brace, so that row i is the
same landing for all and differences are paired. Everything native runs in child processes: a brace that crashes or
hangs costs its own column, with the reason.

OUT/none, OUT/NAME     a run or a study each, as `run --out` and `study --out` leave them
OUT/compare.json       the table as data
OUT/figures/compare.*  the figure; where persons vary, figures/persons.* by their measures
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import EnvironmentProblem, InputError, SimulationError, without_name
from ..files import check_folder, is_partial, read_toml, write_json
from ..folders.comparison import FILE, NONE, ComparisonSummary
from ..folders.read import read_folder
from ..folders.run import SIGNALS, check_run_folder, read_run
from ..notebook import Plottable, Rows
from ..process import Limits
from ..scenario import Value, load_scenario
from ..scenario.file import NAME
from ..shipped import is_file, shipped_scenarios, shipped_studies
from ..study.file import load_study
from ..study.methods import SAMPLED
from ..study.progress import Progress, shown_to
from ..study.study import Study
from ..units import proportion, whole_number
from .bench import Bench
from .comparison import PEAKS, Entry, Source, comparison_listing, summarise_comparison, with_derived
from .decision import check_decidable, land_until_decided
from .doubts import device_doubts

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ..cosim.result import Result

log = logging.getLogger("sprain_cosim")
RESERVED = (NONE, "plant", "controller", "figures")
ROLE = "brace"  # what each of them is called in its landings
BESIDE = (FILE, "figures", "report.html", "animation.webp")  # what stands in the folder besides those of the braces


@dataclass(frozen=True, repr=False)
class Comparison(Plottable):
    """What `compare_braces` did.

    entries  one for each brace, "none" first
    summary  what compare.json holds
    out      the folder
    """

    entries: tuple[Entry, ...]
    summary: ComparisonSummary
    out: Path

    @property
    def failed(self) -> list[Entry]:
        return [e for e in self.entries if e.status != "completed"]

    def text(self) -> str:
        """The table that `sprain-cosim compare` prints."""
        return comparison_listing(self.summary)

    def plot(self, kind: str = "") -> Figure:
        return read_folder(self.out).plot(kind)

    def card(self) -> tuple[str, Rows]:
        heading, rows = self.summary.card()
        return heading, [*rows, ("folder", str(self.out))]


def load_source(name: str) -> Source:
    """A scenario or a study, from a file or the name of one that ships. Raises InputError."""
    path = Path(name)
    if is_file(path):
        try:
            content = read_toml(path)
        except InputError:
            content = {}
        return load_study(path) if isinstance(content.get("scenario"), str) else load_scenario(path)
    return load_study(name) if name in shipped_studies() and name not in shipped_scenarios() else load_scenario(name)


def compare_braces(
    source: Source | str,
    braces: Mapping[str, Path | str],
    *,
    maps: Mapping[str, Path | str] | None = None,
    settings: Mapping[str, Value] | None = None,
    subject: str | None = None,
    scheme: str | None = None,
    step: str | None = None,
    stop: str | None = None,
    out: Path | str,
    trials: int | None = None,
    decide: bool = False,
    workers: int | None = None,
    resume: bool = False,
    max_failed: float | str = 0.01,
    limits: Limits | None = None,
    progress: Progress | str | None = "auto",
    say: Callable[[str], None] = lambda text: None,
    command: str = "",
    in_process: bool = False,
) -> Comparison:
    """Runs the same landings with each brace and with none; writes `out` and returns what it holds, also when braces
    failed.

    source                       scenario or study, or its file or name
    braces                       {name: FMU file or name of a shipped one}
    maps                         {name: mapping file}
    settings                     {"plant.drop_height": for all, "NAME.parameter": of that brace}
    subject                      who lands, such as "female, 1.63 m, 62 kg"; None: whom the source names
    scheme, step, stop           as in Scenario.with_master, for all
    trials                       landings of a study
    decide                       pairs of braces stop when it is decided which has the lower peak; `trials` at most
    workers ... progress         of a study, see `Study.run`
    say                          is called with the name of each brace as it begins
    command                      what the manifests say was typed
    in_process                   foreign FMUs run without a sandbox; still in processes of their own

    Raises InputError before anything has run: names, files, mappings, parameters, a folder in use.

    >>> import sprain_cosim as sc
    >>> comparison = sc.compare_braces("incline30", {"mine": "my_brace.fmu"}, stop="60 ms", out="runs/compared")
    >>> list(comparison.summary.completed)
    ['none', 'mine']
    """
    if not isinstance(braces, Mapping):
        raise InputError(f'braces = {braces!r}: must be {{name: FMU}}, such as {{"mine": "my_brace.fmu"}}')
    trials = None if trials is None else whole_number(trials, "trials", 1)
    max_failed = proportion(max_failed, "max_failed")
    source = (load_source(source) if isinstance(source, str) else source).with_master(scheme, step, stop)
    if subject is not None:
        source = source.with_subject(subject)
    if in_process:
        source = source.unconfined()
    folder, limits = Path(out), limits or Limits()
    if limits.trial is None and isinstance(source, Study):
        limits = replace(limits, trial=source.trial_limit)
    if decide:
        check_decidable(source, list(braces), trials)
    source, variants = _variants(source, braces, maps or {}, settings or {}, trials)
    _check(folder, list(variants), isinstance(source, Study), resume)
    options = {
        "workers": workers,
        "progress": shown_to(progress),
        "command": command,
        "resume": resume,
        "max_failed": max_failed,
    }
    warnings = {name: _warnings(name, variant) for name, variant in variants.items()}

    def land(name: str, rows: int | None = None, before: Entry | None = None) -> Entry:
        say(name if rows is None else f"{name}, the first {rows} landings")
        fmu = None if name == NONE else str(braces[name])
        again = resume or before is not None
        more = options | {"resume": again} | ({} if rows is None else {"rows": rows})
        return _run(name, fmu, variants[name], folder / name, limits, more, warnings[name], before)

    if decide:
        entries, looks, decisions = land_until_decided(list(variants), _numbers(variants), land)
        summary = summarise_comparison(source, entries, looks, decisions)
    else:
        entries = [land(name) for name in variants]
        summary = summarise_comparison(source, entries)
    comparison = Comparison(tuple(entries), summary, folder)
    _write(comparison)
    return comparison


def _numbers(variants: Mapping[str, Source]) -> Sequence[int]:
    """Of the trials that all variants of a study share."""
    study = variants[NONE]
    assert isinstance(study, Study)
    return study.numbers


def _warnings(name: str, variant: Source) -> tuple[str, ...]:
    """What is known of the brace before it has run. Raises InputError for units that no brace has."""
    if name == NONE:
        return ()
    scenario = variant.scenario if isinstance(variant, Study) else variant
    try:
        said = (*scenario.doubts(), *device_doubts(scenario))
    except InputError as problem:
        raise InputError(f"{name}: {without_name(ROLE, problem)}") from None
    own = [line for line in said if line != without_name(ROLE, line)]
    return tuple(without_name(ROLE, line) for line in (*scenario.warnings, *own))


def _run(
    name: str,
    fmu: str | None,
    variant: Source,
    folder: Path,
    limits: Limits,
    options: Mapping[str, Any],
    warnings: tuple[str, ...],
    before: Entry | None = None,
) -> Entry:
    """The landings of one brace, left in `folder`; a failure of the device is the entry's status. `before`: what it did
    in fewer landings."""
    scenario = variant.scenario if isinstance(variant, Study) else variant
    entry = Entry(name, fmu, warnings=warnings)
    held: Mapping[str, float] | None = None
    with Bench(scenario, limits) as bench:
        try:
            if isinstance(variant, Study):
                means = {k: m.mean for k, m in variant.marginals.items() if k.startswith("brace.")}
                if before is not None:
                    held = before.resistance
                elif fmu is not None:
                    held = bench.hold(means)
                bench.close()
                entry = replace(entry, resistance=held)
                done = variant.run(out=folder, limits=limits, **options)
                landings, total = done.trials, len(done.trials)
                said = {n: m.text(total) for n, m in done.summary.fmu_messages.items() if m.grave}
            else:
                result = bench.land(folder)
                landings = _as_table(result)
                warnings = (*warnings, result.warning) if result.warning else warnings
                entry = replace(entry, warnings=warnings, coupling_doubt=result.coupling_doubt)
                said = {n: m.text for n, m in bench.messages.items() if m.grave}
                held = bench.hold() if fmu is not None else None
        except SimulationError as problem:
            return replace(entry, status="failed", message=without_name(ROLE, problem), landings=None)
    spoken = tuple(without_name(ROLE, f"{component}: {text}") for component, text in said.items())
    return replace(entry, landings=with_derived(landings), resistance=held, warnings=(*entry.warnings, *spoken))


def _as_table(result: Result) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame([{"trial": 0, "status": result.status, "message": "", **result.metrics}])


# ---- what is compared


def _variants(
    source: Source,
    braces: Mapping[str, Path | str],
    maps: Mapping[str, Path | str],
    settings: Mapping[str, Value],
    trials: int | None,
) -> tuple[Source, dict[str, Source]]:
    """The source with the values that hold for all, and {brace: what runs with it}, checked."""
    source, own = _settings(source, braces, settings)
    if isinstance(source, Study):
        source = _sampled(replace(source, trials=trials) if trials is not None else source)
    elif trials is not None:
        raise InputError(f"--trials {trials}: {source.source} is one landing; name a study, such as study6")
    variants: dict[str, Source] = {
        NONE: source.without("brace"),
        **{n: _variant(source, n, f, maps.get(n), own.get(n, {})) for n, f in braces.items()},
    }
    if isinstance(source, Study):
        variants = _rows(variants, source)
    for name, variant in variants.items():
        try:
            _ = variant.checked() if isinstance(variant, Study) else variant.system()
        except InputError as problem:
            raise InputError(f"{name}: {without_name(ROLE, problem)}") from None
    return source, variants


def _settings(
    source: Source, braces: Mapping[str, Any], settings: Mapping[str, Value]
) -> tuple[Source, dict[str, dict[str, Value]]]:
    """The source with the values that hold for all, and {brace: {parameter: value}}."""
    if not braces:
        raise InputError("--brace NAME=FILE: name at least one brace to compare with none")
    for name in braces:
        if not NAME.fullmatch(name) or name in RESERVED:
            raise InputError(
                f"--brace {name}=...: a name has letters, digits and _, begins with a letter, and is none of "
                f"{', '.join(RESERVED)}"
            )
    own: dict[str, dict[str, Value]] = {}
    for full, value in settings.items():
        name, _, parameter = full.partition(".")
        if name in braces:
            own.setdefault(name, {})[parameter] = value
        elif name == "brace":
            raise InputError(f"--set {full}: say whose, such as {next(iter(braces))}.{parameter}")
        else:
            source = source.override(full, value)
    return source, own


def _sampled(study: Study) -> Study:
    """The study, checked. Raises InputError for a search, which has no sample to share."""
    if study.method not in SAMPLED:
        raise InputError(
            f"{study.source}: method {study.method} chooses its landings one after another; compare over a sampled "
            "study, such as study6"
        )
    if study.watched:
        log.warning(
            "%s: until is not asked here: braces are compared over all landings, or stop with --decide", study.source
        )
    return replace(study.checked(), published={}, until=())


def _variant(
    source: Source, name: str, fmu: Path | str, mapping: Path | str | None, parameters: Mapping[str, Value]
) -> Source:
    try:
        variant = source.replace_fmu("brace", fmu, mapping)
    except InputError as problem:
        raise InputError(f"--brace {name}={fmu}: {without_name(ROLE, problem)}") from None
    for parameter, value in parameters.items():
        try:
            variant = variant.override(f"brace.{parameter}", value)
        except InputError as problem:
            raise InputError(f"--set {name}.{parameter}: {problem}") from None
    return variant


def _rows(variants: Mapping[str, Source], base: Study) -> dict[str, Source]:
    """Every variant on the rows that the base study draws."""
    rows = base.sample()
    numbers = base.numbers or range(len(rows))
    responses = tuple(r for r in base.responses if "brace" not in r) or PEAKS[:1]
    return {
        n: replace(v.with_rows(base.names, rows, numbers), responses=responses)
        for n, v in variants.items()
        if isinstance(v, Study)
    }


def _check(folder: Path, names: Sequence[str], study: bool, resume: bool) -> None:
    """Raises InputError when the folder holds something else than an earlier comparison of these braces, or a study
    that is not resumed."""
    check_folder(folder)
    if not folder.is_dir():
        return
    strangers = sorted(p.name for p in folder.iterdir() if p.name not in (*names, *BESIDE) and not is_partial(p))
    if strangers:
        raise InputError(f"{folder}: holds other files ({', '.join(strangers[:3])}); name a new folder with --out")
    if study and any((folder / n / SIGNALS).exists() for n in names):
        raise InputError(f"{folder}: holds a comparison of single landings; name a new folder with --out")
    if study and not resume and any((folder / n).exists() for n in names):
        raise InputError(
            f"{folder}: holds a comparison already; continue it with --resume, or name a new folder with --out"
        )
    for name in () if study else names:
        check_run_folder(folder / name)


def _write(comparison: Comparison) -> None:
    from ..figures import save
    from ..figures.comparison import comparison_figure
    from ..figures.persons import persons_figure

    folder, summary = comparison.out, comparison.summary
    landed = {e.name: e for e in comparison.entries if e.landings is not None}
    runs = {} if summary.is_study else {name: read_run(folder / name).result for name in landed}
    peaks = {name: e.completed[PEAKS[0]].to_numpy(float) for name, e in landed.items() if PEAKS[0] in e.completed}
    drawn = comparison_figure(summary, runs, peaks)
    try:
        write_json(folder / FILE, summary.to_json(), parents=True)
        (folder / "figures").mkdir(exist_ok=True)
        save(drawn, folder / "figures" / "compare")
        if summary.persons is not None and summary.persons.bands:
            save(persons_figure(summary), folder / "figures" / "persons")
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None
