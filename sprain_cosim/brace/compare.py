"""The same landings with each of several braces and with none.

A scenario is one landing per brace; a study is its sample, drawn once and run with every brace, so that row i is the
same landing for all and differences are paired. Everything native runs in child processes: a brace that crashes or
hangs costs its own column, with the reason.

OUT/none, OUT/NAME     a run or a study each, as `run --out` and `study --out` leave them
OUT/compare.json       the table as data
OUT/figures/compare.*  the figure
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from ..errors import EnvironmentProblem, InputError, SimulationError
from ..files import read_toml, write_json
from ..folders import run as runfolder
from ..process import Limits
from ..scenario import Scenario, Value, load_scenario
from ..scenario.file import NAME
from ..shipped import shipped_scenarios, shipped_studies
from ..study.evaluation import QUESTIONS
from ..study.file import load_study
from ..study.plan import SAMPLED
from ..study.study import Study
from ..uq import statistics
from .bench import POSTURES, Bench

if TYPE_CHECKING:
    import pandas as pd

NONE = "none"
RESERVED = (NONE, "plant", "controller", "figures")
INVERSION = "peak_inversion_from_neutral_deg"
PEAKS = ("peak_subtalar_angle_deg", INVERSION, "peak_jcs_inversion_deg")
INJURY, SHARE = "probability_of_injury", "anatomy_share"
MOMENTS = ("anatomy_subtalar_moment_Nm", "brace_subtalar_moment_Nm")  # at the peak
KEYS = (
    *PEAKS,
    INJURY,
    "peak_brace_subtalar_moment_Nm",
    "brace_subtalar_work_to_peak_J",
    "brace_work_J",
    *MOMENTS,
    SHARE,
)

Source = Scenario | Study


@dataclass(frozen=True)
class Entry:
    """What one brace did: `status` completed or failed, `landings` one row a landing (trial, status, metrics and what
    is derived from them), `resistance` {posture: N.m that resist it} or None."""

    name: str
    fmu: str | None
    status: str = "completed"
    message: str = ""
    landings: pd.DataFrame | None = None
    resistance: Mapping[str, float] | None = None
    warnings: tuple[str, ...] = ()

    @property
    def completed(self) -> pd.DataFrame:
        assert self.landings is not None
        return self.landings[self.landings["status"] == "completed"]


@dataclass(frozen=True)
class Comparison:
    """`entries` with "none" first; `data` what compare.json holds; `out` the folder."""

    entries: tuple[Entry, ...]
    data: dict[str, Any]
    out: Path

    @property
    def failed(self) -> list[Entry]:
        return [e for e in self.entries if e.status != "completed"]


def load(name: str) -> Source:
    """A scenario or a study, from a file or the name of one that ships. Raises InputError."""
    path = Path(name)
    if path.is_file():
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
    scheme: str | None = None,
    step: str | None = None,
    stop: str | None = None,
    out: Path | str,
    trials: int | None = None,
    workers: int | None = None,
    resume: bool = False,
    max_failed: float = 0.01,
    limits: Limits | None = None,
    progress: Callable[[int, int, int, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    command: str = "",
) -> Comparison:
    """`braces` {name: FMU file or name of a shipped one}; `settings` {"plant.drop_height": for all, "NAME.parameter":
    of that brace}; `scheme`, `step` and `stop` as in Scenario.with_master, for all; `say` hears one line as each brace
    begins; `command` what the manifests say was typed. Writes `out` and returns what it holds, also when braces failed.

    Raises InputError before anything has run: names, files, mappings, parameters, a folder in use."""
    source = (load(source) if isinstance(source, str) else source).with_master(scheme, step, stop)
    folder, limits = Path(out), limits or Limits()
    source, own = _settings(source, braces, settings or {})
    if isinstance(source, Study):
        source = _sampled(replace(source, trials=trials) if trials is not None else source)
    elif trials is not None:
        raise InputError(f"--trials {trials}: {source.source} is one landing; name a study, such as study6")
    variants: dict[str, Source] = {
        NONE: source.without("brace"),
        **{n: _variant(source, n, f, (maps or {}).get(n), own.get(n, {})) for n, f in braces.items()},
    }
    if isinstance(source, Study):
        variants = _rows(variants, source)
    scenarios = {n: v.scenario if isinstance(v, Study) else v for n, v in variants.items()}
    for name, variant in variants.items():
        try:
            _ = variant.checked() if isinstance(variant, Study) else variant.system()
        except InputError as problem:
            raise InputError(f"{name}: {problem}") from None
    _check(folder, list(variants), isinstance(source, Study), resume)
    entries = []
    for name, variant in variants.items():
        say(name)
        fmu = None if name == NONE else str(braces[name])
        entry = Entry(name, fmu, warnings=scenarios[name].warnings if name != NONE else ())
        with Bench(scenarios[name], limits) as bench:
            try:
                if isinstance(variant, Study):
                    if fmu is not None:
                        means = {k: m.mean for k, m in variant.marginals.items() if k.startswith("brace.")}
                        entry = replace(entry, resistance=bench.hold(means))
                    bench.close()
                    campaign = variant.run(
                        out=folder / name,
                        workers=workers,
                        resume=resume,
                        max_failed=max_failed,
                        limits=limits,
                        progress=progress,
                        command=command,
                    )
                    entry = replace(entry, landings=campaign.trials)
                else:
                    entry = replace(entry, landings=bench.land(folder / name))
                    if fmu is not None:
                        entry = replace(entry, resistance=bench.hold())
            except SimulationError as problem:
                entry = replace(entry, status="failed", message=str(problem), landings=None)
        entries.append(entry if entry.landings is None else replace(entry, landings=_derived(entry.landings)))
    comparison = Comparison(tuple(entries), _data(source, entries), folder)
    _write(comparison, isinstance(source, Study))
    return comparison


# ---- what is compared


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
    return replace(study.checked(), published={})


def _variant(
    source: Source, name: str, fmu: Path | str, mapping: Path | str | None, parameters: Mapping[str, Value]
) -> Source:
    try:
        variant = source.replace_fmu("brace", fmu, mapping)
    except InputError as problem:
        raise InputError(f"--brace {name}={fmu}: {problem}") from None
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
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder with --out")
    if not folder.is_dir():
        return
    strangers = sorted(
        p.name
        for p in folder.iterdir()
        if p.name not in (*names, "compare.json", "figures", "report.html", "animation.webp")
    )
    if strangers:
        raise InputError(f"{folder}: holds other files ({', '.join(strangers[:3])}); name a new folder with --out")
    if study and not resume and any((folder / n).exists() for n in names):
        raise InputError(
            f"{folder}: holds a comparison already; continue it with --resume, or name a new folder with --out"
        )
    for name in () if study else names:
        runfolder.check(folder / name)


# ---- what it says


def _derived(landings: pd.DataFrame) -> pd.DataFrame:
    """The landings with the share of the subtalar moment that the anatomy bears at the peak, and the probability that
    the inversion exceeds the injury threshold, itself uncertain, in that landing."""
    more = {}
    if INVERSION in landings:
        more[INJURY] = ndtr(QUESTIONS[INVERSION][1].to_standard(landings[INVERSION].to_numpy(float)))
    if MOMENTS[1] in landings:
        anatomy, brace = (landings[key] for key in MOMENTS)
        more[SHARE] = (anatomy / (anatomy + brace)).where(anatomy + brace > 0)
    return landings.assign(**more)


def _data(source: Source, entries: Sequence[Entry]) -> dict[str, Any]:
    """Content of compare.json. Every estimate is {value, ci_low, ci_high, n}: the landing's value, or the mean over the
    n landings that completed, with Student's 95 % interval where they are a random sample."""
    random = isinstance(source, Study) and source.method in ("monte-carlo", "table")
    scenario = source.scenario if isinstance(source, Study) else source
    completed = {e.name: e.completed.set_index("trial") for e in entries if e.landings is not None}

    def difference(a: str, b: str) -> dict[str, Any]:
        both = completed[a].index.intersection(completed[b].index)
        keys = [k for k in KEYS if k in completed[a] and k in completed[b]]
        return {
            k: _estimate((completed[a].loc[both, k] - completed[b].loc[both, k]).to_numpy(float), random) for k in keys
        }

    braces = {}
    for e in entries:
        rows = completed.get(e.name)
        braces[e.name] = {
            "fmu": e.fmu,
            "status": e.status,
            "message": e.message,
            "warnings": list(e.warnings),
            "folder": e.name,
            "n_completed": 0 if rows is None else len(rows),
            "n_failed": None if e.landings is None else len(e.landings) - len(e.completed),
            "metrics": {}
            if rows is None
            else {k: _estimate(rows[k].to_numpy(float), random) for k in KEYS if k in rows},
            "difference_to_none": difference(e.name, NONE)
            if e.name != NONE and e.name in completed and NONE in completed
            else {},
            "resistance_Nm": None if e.resistance is None else dict(e.resistance),
        }
    names = [n for n in completed if n != NONE]
    return {
        "kind": "study" if isinstance(source, Study) else "scenario",
        "source": source.source,
        "title": source.title,
        "initial_pose": scenario.initial_pose(),
        "method": source.method if isinstance(source, Study) else None,
        "seed": source.seed if isinstance(source, Study) else None,
        "landings": source.trials if isinstance(source, Study) else 1,
        "injury": f"inversion from neutral {QUESTIONS[INVERSION][0]}",
        "braces": braces,
        "pairs": {f"{b} - {a}": difference(b, a) for i, a in enumerate(names) for b in names[i + 1 :]},
    }


def _estimate(y: np.ndarray, random: bool) -> dict[str, Any]:
    y = y[np.isfinite(y)]
    if not len(y):
        return {"value": None, "ci_low": None, "ci_high": None, "n": 0}
    if not random or len(y) < 2:
        return {"value": float(np.mean(y)), "ci_low": None, "ci_high": None, "n": len(y)}
    e = statistics.mean(y)
    return {"value": e.value, "ci_low": e.low, "ci_high": e.high, "n": len(y)}


LINES: tuple[tuple[str, str, float], ...] = (  # label, metric, factor
    ("peak supination [deg]", "peak_subtalar_angle_deg", 1.0),
    ("peak inversion from neutral [deg]", INVERSION, 1.0),
    ("peak inversion, raw angle [deg]", "peak_jcs_inversion_deg", 1.0),
    ("P(inversion from neutral > 35 ± 6 deg) [%]", INJURY, 100.0),
    ("largest moment of the brace [N·m]", "peak_brace_subtalar_moment_Nm", 1.0),
    ("work it takes from the roll, to the peak [J]", "brace_subtalar_work_to_peak_J", 1.0),
    ("work it takes, all axes, whole landing [J]", "brace_work_J", 1.0),
    ("at the peak: moment of the anatomy [N·m]", "anatomy_subtalar_moment_Nm", 1.0),
    ("             moment of the brace [N·m]", "brace_subtalar_moment_Nm", 1.0),
    ("             borne by the anatomy [%]", SHARE, 100.0),
)
CHANGED = (*PEAKS[:2], INJURY)  # the raw angle changes as the one from neutral does
PAIRED = 6  # pairs that are printed; compare.json has all


def text(data: Mapping[str, Any]) -> str:
    """The table that `compare` prints: one column a brace."""
    braces = data["braces"]
    study = data["kind"] == "study"
    pose = f"pose {data['initial_pose']}, " if data["initial_pose"] else ""
    count = f"{data['landings']} landings" if study else "one landing"
    lines = [f"{data['source']}  ·  {pose}{count}, the same for every brace"]
    if study:
        lines.append(
            "mean ± half of its 95 % interval; changes are paired"
            if data["method"] in ("monte-carlo", "table")
            else "means; changes are paired"
        )
    width = max(16, *(len(n) + 2 for n in braces))
    lines += ["", f"{'':44}" + "".join(f"{n:>{width}}" for n in braces)]

    def row(label: str, cells: Sequence[str]) -> None:
        if any(cells):
            lines.append(f"{label:44}" + "".join(f"{c:>{width}}" for c in cells).rstrip())

    for label, key, factor in LINES:
        row(label, [_cell(b["metrics"].get(key), factor) for b in braces.values()])
        if key in CHANGED:
            row(
                "    change against none",
                [_cell(b["difference_to_none"].get(key), factor, sign=True) for b in braces.values()],
            )
    for kind in dict.fromkeys(p.rpartition("_")[0] for p in POSTURES):
        held = [b["resistance_Nm"] for b in braces.values()]
        row(
            f"resists {kind} of 5 / 10 deg [N·m]",
            [f"{_small(h[f'{kind}_5deg'])} / {_small(h[f'{kind}_10deg'])}" if h else "" for h in held],
        )
    counts = [
        f"{b['n_completed']} of {data['landings']}" if b["status"] == "completed" else "failed" for b in braces.values()
    ]
    row("landings completed", counts)
    if 0 < len(data["pairs"]) <= PAIRED:
        lines += ["", f"{'':44}{'peak supination [deg]':>{width + 8}}{'inversion [deg]':>{width}}"]
        for pair, d in data["pairs"].items():
            supination, inversion = (_cell(d.get(peak), 1.0, sign=True) for peak in PEAKS[:2])
            lines.append(f"{pair:44}{supination:>{width + 8}}{inversion:>{width}}")
    lines += [f"\n{n}: failed: {b['message']}" for n, b in braces.items() if b["status"] != "completed"]
    return "\n".join(lines)


def _cell(estimate: Mapping[str, Any] | None, factor: float, sign: bool = False) -> str:
    if not estimate or estimate["value"] is None:
        return ""
    half = "" if estimate["ci_low"] is None else f" ± {0.5 * factor * (estimate['ci_high'] - estimate['ci_low']):.2f}"
    return f"{factor * estimate['value']:{'+' if sign else ''}.2f}{half}"


def _small(value: float) -> str:
    return f"{0.0 if abs(value) < 5e-3 else value:.2f}"


def _write(comparison: Comparison, study: bool) -> None:
    from ..figures import save
    from ..figures.comparison import figure

    folder = comparison.out
    drawn = figure(
        comparison,
        {}
        if study
        else {e.name: runfolder.read(folder / e.name)[1] for e in comparison.entries if e.landings is not None},
    )
    try:
        write_json(folder / "compare.json", comparison.data, parents=True)
        (folder / "figures").mkdir(exist_ok=True)
        save(drawn, folder / "figures" / "compare")
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None
