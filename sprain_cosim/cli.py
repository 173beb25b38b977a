"""The command line. It reads options, calls the package, prints; it holds no logic. Heavy modules are imported inside
the commands."""

from __future__ import annotations

import contextlib
import errno
import functools
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import click

from . import __version__, guidance, signals, terminal
from .errors import InputError, SimulationError, SprainError, visible
from .machine.here import SYSTEM

if TYPE_CHECKING:
    from .cosim.result import Result
    from .scenario import Scenario
    from .study.campaign import Campaign
    from .study.study import Study

Command = TypeVar("Command", bound=Callable[..., Any])
NOBODY_READS = 141  # as a shell has it of SIGPIPE
NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)  # of what was typed
# for NumPy, and for the allocator that pyarrow brings: of one thread, this process can be copied
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "JE_ARROW_MALLOC_CONF": "background_thread:false"}
RENAMED = {"--output": "--out"}  # spellings of version 0.1, which this version still takes


class _NamedPath(click.Path):
    """One that is empty, such as of a variable of the shell that is not set, is not the folder that one stands in."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("is empty; name a file or a folder", param, ctx)
        return super().convert(value, param, ctx)


PATH = _NamedPath(path_type=Path)


def out_option(text: str, **more: Any) -> Callable[[Command], Command]:
    """Where a command writes, spelled alike everywhere."""
    return click.option("-o", "--out", type=PATH, help=text, **more)


OUT = out_option("Folder for signals, summary and figure.")
FOLDERS = click.argument("folders", nargs=-1, required=True, type=PATH)
FMUS = click.option(
    "--fmu",
    "fmus",
    multiple=True,
    metavar="NAME=FILE",
    shell_complete=guidance.devices,
    help="Put another FMU in a component's place.",
)
MAPS = click.option(
    "--map", "maps", multiple=True, metavar="NAME=FILE", help="Mapping file of the FMU given with --fmu."
)
SET = click.option(
    "--set", "settings", multiple=True, metavar="COMPONENT.PARAMETER=VALUE", help='Such as plant.drop_height="0.35 m".'
)
WORKERS = click.option("--workers", type=click.IntRange(1), help="Worker processes (default: one per core).")
SCHEDULER = click.option("--scheduler", metavar="ADDRESS", help="Run on Dask: tcp://host:8786, or local-cluster.")
RESUME = click.option("--resume", is_flag=True, help="Continue what --out holds.")
PARQUET = click.option("--parquet", is_flag=True, help="Write trials.parquet beside trials.csv.")
PROGRESS = click.option(
    "--progress",
    type=click.Choice(["auto", "plain", "json", "none"]),
    default="auto",
    show_default=True,
    help="auto: a bar on a terminal, else lines; plain: lines; json: an object a line; none: silent.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
SCHEME = click.option(
    "--scheme",
    shell_complete=guidance.schemes,
    help="auto, jacobi, gauss-seidel, gauss-seidel-extrapolated, iterative, impedance.",
)
STEP = click.option("--step", metavar='"0.5 ms"', help="Communication step.")
TRIAL_LIMIT = click.option(
    "--trial-limit", metavar='"20 s"', help="Wall time after which a landing in a process of its own is ended."
)
STOP = click.option("--stop", metavar='"150 ms"', help="End of the landing.")
SUBJECT = click.option(
    "--subject", metavar='"female, 1.63 m, 62 kg"', help="Who lands: sex, stature, mass and any other body measure."
)
FORCE = click.option("--force", is_flag=True, help="Overwrite an earlier result in --out without a warning.")
ISOLATE = click.option(
    "--isolate",
    is_flag=True,
    help="Every FMU in a process of its own: a crash or a hang ends the run, not this program.",
)
IN_PROCESS = click.option(
    "--in-process",
    is_flag=True,
    help="Foreign FMUs without a sandbox: of a run in this process, of trials in their own.",
)


@click.group(cls=guidance.Guided, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__)
def cli() -> None:
    """Simulate single-leg landings and the ankle braces that should make them safe."""


@cli.command("run")
@click.argument("scenario", shell_complete=guidance.scenarios)
@FMUS
@MAPS
@SET
@SUBJECT
@SCHEME
@STEP
@STOP
@click.option(
    "--identify",
    type=click.IntRange(0),
    metavar="N",
    help="Find undeclared stiffness and damping anew every N steps (0: at the start only).",
)
@click.option(
    "--adaptive",
    is_flag=False,
    flag_value="0.1 %",
    metavar="[SHARE]",
    help="Divide steps whose residual energy exceeds SHARE (0.1 %).",
)
@click.option(
    "--check-coupling", is_flag=True, help="Run again at half the step and report the change of every metric."
)
@ISOLATE
@IN_PROCESS
@TRIAL_LIMIT
@OUT
@FORCE
@JSON
def run_command(
    scenario: str,
    fmus: tuple[str, ...],
    maps: tuple[str, ...],
    settings: tuple[str, ...],
    subject: str | None,
    scheme: str | None,
    step: str | None,
    stop: str | None,
    identify: int | None,
    adaptive: str | None,
    check_coupling: bool,
    isolate: bool,
    in_process: bool,
    trial_limit: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Run one landing: SCENARIO is a file, or the name of one that ships."""
    from .brace.doubts import device_doubts
    from .scenario import load_scenario

    chosen = _changed(load_scenario(scenario), fmus, maps, settings, subject)
    chosen = chosen.with_master(scheme, step, stop, identify=identify, adaptive=adaptive)
    if isolate:
        chosen = chosen.isolated()
    if in_process:
        chosen = chosen.unconfined()
    doubts = (*chosen.warnings, *chosen.doubts(), *device_doubts(chosen))
    for warning in doubts:
        _warn(warning)
    if out is not None:
        _warn_of_run(out, force)
        chosen = chosen.recording("plant.*")
    result = chosen.run(halve=True, limits=None if trial_limit is None else _limits(trial_limit))
    if result.warning:
        _warn(result.warning)
    said = {name: m for name, m in result.messages.items() if not m.first or m.first not in result.message}
    _print_messages({name: (m.grave, m.text) for name, m in said.items()})  # but what the error quotes anyway
    completed = result.status == "completed"
    finer = (result.halved or chosen.coupling_check(result)) if check_coupling and completed else None
    if as_json or out is not None:
        from .folders.run import RunSummary

        summary = replace(RunSummary.of(chosen, result), coupling_check=finer, warnings=doubts or None)
    if out is not None and completed:
        from .figures.landings import leave_run

        leave_run(out, result, summary)
    if as_json:
        _show(json.dumps(summary.to_json(), allow_nan=False))
    elif completed:
        _show_run(chosen, result, finer or {}, out)
    if not completed:
        raise (InputError if chosen.refused(result) else SimulationError)(result.message)


def _show_run(scenario: Scenario, result: Result, finer: Mapping[str, float], out: Path | None) -> None:
    _print_table(scenario.heading, scenario.initial_pose(), result)
    for key, change in finer.items():
        _show(f"{'at half the step:' if key == 'peak_subtalar_angle_deg' else '':18}{key:44}{change:+.4g}")
    if out is not None:
        from .folders.run import FILES

        _show(f"\nwritten: {', '.join(str(out / name) for name in FILES)}")


def _warn_of_run(out: Path, force: bool) -> None:
    """Before a run is written where one is. Raises InputError for a folder with anything else in it."""
    from .folders.run import FILE, check_run_folder

    check_run_folder(out)
    if (out / FILE).exists() and not force:
        _warn(f"{out}: its earlier run is overwritten; the next version asks for --force")


def _warn_of_file(target: Path, force: bool, sources: Iterable[Path | None]) -> None:
    """Before a file that people edit is written anew. Raises InputError where it is made of that file."""
    from .files import check_file

    check_file(target, sources)
    if target.exists() and not force:
        _warn(f"{target}: is overwritten; the next version asks for --force")


def _print_messages(lines: Mapping[str, tuple[bool, str]]) -> None:
    """{component: (whether it warned, what its FMU said)}."""
    for name, (grave, text) in lines.items():
        _show(f"{'warning' if grave else 'note'}: {name}: {_one_line(text)}", err=True)


def _print_table(title: str, pose: str | None, result: Result) -> None:
    from .metrics import THROWN_TEXT, pose_artefacts, table

    _show(
        f"{title}  ·  {f'pose {pose}, ' if pose else ''}{result.scheme}, {len(result.time) - 1} steps, "
        f"{1e3 * result.wall:.0f} ms wall time\n"
    )
    rows = table(result)
    if rows:
        _show(f"{'':30}{'value':>10}  {'unit':7}{'time [ms]':>10}")
    for label, value, unit, time in rows:
        _show(f"{label:30}{value:z10.2f}  {unit:7}{1e3 * time:10.1f}")
    if pose_artefacts(result.metrics, pose):
        _show(THROWN_TEXT)
    if result.coupling_error is not None:
        _show(f"{'coupling error':30}{100 * result.coupling_error:10.2f}  % of the energy exchanged")
    if result.coupling_doubt is not None:
        _show(
            f"{'doubt of the step':30}{result.coupling_doubt:10.2f}  deg     of the peak, twice its change at half the "
            f"step{'' if result.converged else ': not converged'}"
        )
    if result.estimates_doubt is not None:
        _show(
            f"{'doubt of the person':30}{result.estimates_doubt:10.2f}  deg     of the peak, one SD over what is "
            "estimated of the body"
        )
    for name, held in result.held.items():
        _show(
            f"{'age of a held torque':30}{held.largest_change:10.2f}  N·m     {name} is sampled every "
            f"{1e3 * held.period:g} ms; {held.axis} torque, {100 * held.share:.0f} % of its largest, at most, from one "
            "call to the next"
        )


@dataclass(frozen=True)
class CampaignOptions:
    """What every command that lands many times takes: another device, the master, where the landings run, what becomes
    of failures, where the results go."""

    fmus: tuple[str, ...]
    maps: tuple[str, ...]
    settings: tuple[str, ...]
    subject: str | None
    scheme: str | None
    step: str | None
    stop: str | None
    workers: int | None
    scheduler: str | None
    isolate: bool
    in_process: bool
    trial_limit: str | None
    resume: bool
    max_failed: str
    parquet: bool
    progress: str
    out: Path | None
    as_json: bool

    def read(self, name: str) -> Study:
        """The study of that file or name, with what these options change."""
        from .study.file import load_study

        chosen: Study = _changed(load_study(name), self.fmus, self.maps, self.settings, self.subject)
        chosen = chosen.with_master(self.scheme, self.step, self.stop)
        chosen = chosen.isolated() if self.isolate else chosen
        return chosen.unconfined() if self.in_process else chosen

    def land(self, study: Study, folder: Path, warnings: Sequence[str] = (), **options: Any) -> Campaign:
        """Runs it, in `folder` unless --out names another; what a reader must know goes to stderr, and when it ends
        early the command that continues it."""
        from .brace.doubts import device_doubts
        from .study.progress import reporter

        idle = study.scenario.without_effect(study.names)
        doubts = (*idle, *study.scenario.doubts(), *device_doubts(study.scenario))
        study = replace(study, warnings=tuple(dict.fromkeys((*study.warnings, *warnings, *doubts))))
        for warning in study.warnings:
            _warn(warning)
        again, out = _again(), self.out or folder
        share, limits = _share(self.max_failed), _limits(self.trial_limit)
        try:
            done = study.run(
                workers=self.workers,
                scheduler=self.scheduler,
                resume=self.resume,
                max_failed=share,
                limits=limits,
                out=out,
                progress=reporter(self.progress),
                parquet=self.parquet,
                command=again,
                **options,
            )
        except (signals.Interrupted, SimulationError) as end:
            failed = isinstance(end, SimulationError)  # which the same command would meet again
            more = " --max-failed 100%" if failed and "--max-failed" in str(end) else ""
            if not (failed and study.needs_all):
                _show(f"{chr(10) if sys.stderr.isatty() else ''}continue with: {again} --resume{more}", err=True)
            raise
        _warn_of_trials(done, out)
        return done


def campaign_options(failures: str, out: str) -> Callable[[Command], Command]:
    """The options of a command that lands many times, handed to it as `how`; `failures` and `out` are its defaults."""

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def called(**given: Any) -> Any:
            shared = {field.name: given.pop(field.name) for field in fields(CampaignOptions)}
            return command(**given, how=CampaignOptions(**shared))

        wrapped: Any = called
        for option in reversed(
            (
                FMUS,
                MAPS,
                SET,
                SUBJECT,
                SCHEME,
                STEP,
                STOP,
                WORKERS,
                SCHEDULER,
                ISOLATE,
                IN_PROCESS,
                TRIAL_LIMIT,
                RESUME,
                click.option(
                    "--max-failed", default=failures, show_default=True, help="Share of failed trials that is accepted."
                ),
                PARQUET,
                PROGRESS,
                out_option(out),
                JSON,
            )
        ):
            wrapped = option(wrapped)
        return cast("Command", wrapped)

    return decorate


def _again() -> str:
    """The command that was typed, without --resume."""
    return _command(*(a for a in sys.argv[1:] if a != "--resume"))


def _command(*words: object) -> str:
    """As it is typed."""
    return f"sprain-cosim {' '.join(SYSTEM.quoted(str(word)) for word in words)}"


@cli.command("study")
@click.argument("study", shell_complete=guidance.studies)
@click.option(
    "--method",
    shell_complete=guidance.methods,
    help="monte-carlo, lhs, sobol, grid, table, mean-value, amv, amv+, hmv, form, sobol-indices.",
)
@click.option("--trials", type=click.IntRange(1), help="Number of trials.")
@click.option("--seed", type=click.IntRange(0), help="Seed of the sample.")
@click.option(
    "--question",
    "questions",
    multiple=True,
    metavar="QUESTION",
    help='Such as "P(peak_inversion_from_neutral_deg > 35 +- 6 deg, n = 10)"; several.',
)
@click.option(
    "--until",
    multiple=True,
    metavar='"p95 0.5 deg"',
    help='Stop when it is known so narrowly, after --trials at most; also "mean 0.2 deg", "P(RESPONSE > 35 +- 6 deg) 1 '
    '%"; several.',
)
@click.option(
    "--no-check",
    is_flag=True,
    help="Of amv and its relatives: no random landings that test the levels; of form: first order alone.",
)
@click.option(
    "--inputs",
    type=PATH,
    metavar="TABLE.csv",
    help="Run these rows: header component.parameter [unit].",
)
@campaign_options("1%", "Folder of the study (default: runs/STUDY).")
@click.option("--shard", metavar="K/N", help="Run the K-th of N parts; `merge` joins them.")
@click.option(
    "--trajectories",
    default="100",
    show_default=True,
    metavar="N|all|none",
    help="Record the first N trials besides percentile and failed ones.",
)
def study_command(
    study: str,
    method: str | None,
    trials: int | None,
    seed: int | None,
    questions: tuple[str, ...],
    until: tuple[str, ...],
    no_check: bool,
    inputs: Path | None,
    shard: str | None,
    trajectories: str,
    how: CampaignOptions,
) -> None:
    """Run many landings: STUDY is a file, or the name of one that ships."""
    from .study.listing import study_listing
    from .study.shards import shard as part
    from .study.trajectories import first_trajectories

    chosen = how.read(study).with_questions(*questions)
    if no_check:
        chosen = replace(chosen, check=False)
    if inputs is not None:
        if method not in (None, "table") or trials is not None:
            raise InputError("--inputs: its rows are the trials; leave --method and --trials out")
        chosen = chosen.with_inputs(inputs)
    portion = None if shard is None else part(shard)
    name = Path(study).stem + (f"-{portion[0]}of{portion[1]}" if portion else "")
    done = how.land(
        chosen,
        Path("runs") / name,
        chosen.passed_over(method),
        method=method,
        trials=trials,
        seed=seed,
        until=until,
        shard=portion,
        trajectories=first_trajectories(trajectories),
    )
    _show(
        json.dumps(done.summary.to_json(), allow_nan=False)
        if how.as_json
        else f"{study_listing(done.study, done.summary)}\n\nwritten: {done.out}"
    )


def _warn_of_trials(done: Campaign, folder: Path) -> None:
    """What a reader of the table must know."""
    for warning in done.warnings:
        _warn(warning)
    summary = done.summary
    trials = summary.n_completed + summary.n_failed
    _print_messages({name: (said.grave, said.text(trials)) for name, said in summary.fmu_messages.items()})
    if done.summary.not_reproduced:
        _warn(
            f"trials {list(done.summary.not_reproduced)} gave other numbers when they were run again for their "
            "trajectories"
        )
    if done.summary.n_failed:
        _warn(
            f"{done.summary.n_failed} trials failed; how, and the commands that run them again: "
            f"{folder / 'failures.json'}"
        )


@cli.command("design")
@click.argument("study", shell_complete=guidance.studies)
@click.option(
    "--vary",
    "varied",
    multiple=True,
    metavar="COMPONENT.PARAMETER=LOW..HIGH",
    help="The parameter and its range, such as brace.angle_scale=0.5..3; a second one gives a trade-off curve.",
)
@click.option(
    "--goal",
    metavar="GOAL",
    help='What must hold, such as "P(peak_inversion_from_neutral_deg > 35 +- 6 deg) <= 2 %".',
)
@click.option(
    "--find",
    type=click.Choice(["least", "largest"]),
    help="The least or the largest value for which it holds (default: by where it holds).",
)
@click.option("--landings", type=click.IntRange(1), help="Landings in all (default: 300).")
@click.option("--seed", type=click.IntRange(0), help="Seed of the sample.")
@campaign_options("5%", "Folder of the design (default: runs/design_STUDY).")
def design_command(
    study: str,
    varied: tuple[str, ...],
    goal: str | None,
    find: Literal["least", "largest"] | None,
    landings: int | None,
    seed: int | None,
    how: CampaignOptions,
) -> int:
    """Find the least (or largest) value of a parameter for which a goal holds, with confidence: STUDY is a file or the
    name of one that ships; what varies in it is uncertain. Exit code 1 when by the best estimate no value in the range
    meets the goal; a warning says where that is undecided with 95 % confidence."""
    from .study.listing import study_listing

    chosen = how.read(study).asking(goal, varied, find, landings)
    done = how.land(chosen, Path("runs") / f"design_{Path(study).stem}", seed=seed)
    found = done.summary.design
    assert found is not None
    _show(
        json.dumps(found.to_json(), allow_nan=False)
        if how.as_json
        else f"{study_listing(done.study, done.summary)}\n\nwritten: {done.out}\nnext: {_command('report', done.out)}"
    )
    if found.doubt:
        _warn(found.doubt)
    return 0 if found.met else 1


@cli.command("merge")
@FOLDERS
@out_option("Folder of the whole study (default: runs/STUDY).")
@PARQUET
@JSON
def merge_command(folders: tuple[Path, ...], out: Path | None, parquet: bool, as_json: bool) -> None:
    """Join the FOLDERS of a study's shards into one, as if it had run in one piece."""
    from .study.listing import study_listing
    from .study.merge import merge

    done = merge(folders, out, parquet)
    for line in done.warnings:
        _warn(line)
    _show(
        json.dumps(done.summary.to_json(), allow_nan=False)
        if as_json
        else f"{study_listing(done.study, done.summary)}\n\nwritten: {done.out}"
    )


@cli.command("trial")
@click.argument("folder", type=PATH)
@click.argument("number", type=click.IntRange(0))
@TRIAL_LIMIT
@OUT
@FORCE
@JSON
def trial_command(
    folder: Path, number: int, trial_limit: str | None, out: Path | None, force: bool, as_json: bool
) -> int:
    """Run trial NUMBER of the study in FOLDER again, in a process of its own, and say whether it gives the recorded
    numbers to the bit."""
    from .figures.landings import leave_run
    from .folders.run import RunSummary
    from .study.replay import replay

    if out is not None:
        _warn_of_run(out, force)
    again = replay(folder, number, _limits(trial_limit))
    scenario, outcome = again.study.scenario, again.outcome
    result = again.result
    verdict = "the recorded numbers to the bit" if again.same else "OTHER numbers than recorded"
    if result is None:
        raise SimulationError(
            f"trial {number} {outcome.status}: {outcome.message} (recorded: {again.row.outcome.status})"
        )
    summary = replace(
        RunSummary.of(scenario, result), metrics=dict(outcome.metrics), trial=number, reproduced=again.same
    )
    if out is not None:
        leave_run(out, result, summary)
    if as_json:
        _show(json.dumps(summary.to_json(), allow_nan=False))
    elif result.status == "completed":
        _print_table(f"{scenario.heading}, trial {number}", summary.initial_pose, result)
    if not as_json:
        _show(f"\n{outcome.status}: {verdict}{f'; written: {out}' if out else ''}")
    if result.status != "completed":
        raise SimulationError(
            f"trial {number} {outcome.status}: {outcome.message} (recorded: {again.row.outcome.status})"
        )
    return 0 if again.same else 1


@cli.command("reproduce")
@click.argument("manifest", type=PATH)
@WORKERS
@PROGRESS
@out_option("Folder of the repetition (default: the study's folder with -again).")
@JSON
def reproduce_command(manifest: Path, workers: int | None, progress: str, out: Path | None, as_json: bool) -> int:
    """Run the study of a MANIFEST again: exit code 0 identical (or rounded otherwise by code for another
    level of processors, which is named), 1 not, and which trial is the first that differs."""
    from .study.progress import reporter
    from .study.reproduce import reproduce

    done = reproduce(manifest, out, workers, reporter(progress))
    _show(json.dumps(done.to_json(), allow_nan=False) if as_json else done.text())
    return 0 if done.identical or done.rounding else 1


@cli.command("check")
@click.argument("fmu", type=PATH)
@click.option(
    "--map",
    "mapping",
    type=PATH,
    help="Mapping file: the FMU's names, signs and units to the contract's.",
)
@click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", help="Of a parameter, or of an input that nothing feeds."
)
@JSON
def check_command(fmu: Path, mapping: Path | None, settings: tuple[str, ...], as_json: bool) -> int:
    """Does the device FMU fit the brace contract? Exit code 0 fits, 1 does not, 2 not a usable FMU."""
    from .brace.check import check_brace, set_options
    from .scenario import parse_value
    from .shipped import fmu_path

    fmu = fmu if os.path.exists(fmu) else fmu_path(str(fmu), Path(), str(fmu))
    values = {n: parse_value(v) for n, v in (_pair(text, "--set", "NAME=VALUE") for text in settings)}
    report = check_brace(fmu, mapping, values, lambda line: _show(line, err=True))
    proposed = Path(f"{fmu.stem}.map.toml")
    if report.proposal and mapping is None and not proposed.exists():
        try:
            proposed.write_text(report.proposal, "utf-8")
            report.next_step = (
                f"look at the lines marked review in {proposed}, then sprain-cosim check {SYSTEM.quoted(str(fmu))} "
                f"--map {SYSTEM.quoted(str(proposed))}{set_options(values)}"
            )
        except OSError as problem:
            report.next_step = (
                f"write these lines to a mapping file ({proposed} cannot be written: "
                f"{problem.strerror}), then check with --map:\n{report.proposal}"
            )
    if as_json:
        _show(json.dumps(report.as_dict(), allow_nan=False))
    else:
        _show(report.text())
    return 0 if report.fits else 1


@cli.command("compare")
@click.argument("source", metavar="SCENARIO|STUDY", shell_complete=guidance.scenarios_and_studies)
@click.option(
    "--brace",
    "braces",
    multiple=True,
    metavar="NAME=FILE",
    shell_complete=guidance.devices,
    help="A brace to compare: an FMU, or the name of a shipped one.",
)
@click.option("--map", "maps", multiple=True, metavar="NAME=FILE", help="Mapping file of the brace NAME.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME.PARAMETER=VALUE",
    help="Of one brace (soft.angle_scale=1.5) or of all (plant.drop_height=...).",
)
@SUBJECT
@SCHEME
@STEP
@STOP
@click.option("--trials", type=click.IntRange(2), help="Landings of a study.")
@click.option(
    "--decide",
    is_flag=True,
    help="Stop a pair of braces when it is decided which has the lower peak, --trials landings at most (a study only).",
)
@click.option("--workers", type=click.IntRange(1), help="Worker processes of a study (default: one per core).")
@click.option("--resume", is_flag=True, help="Continue what --out holds of a study.")
@click.option("--max-failed", default="1%", show_default=True, help="Share of failed landings that is accepted.")
@IN_PROCESS
@TRIAL_LIMIT
@PROGRESS
@out_option("Folder of the comparison (default: runs/compare_NAME).")
@JSON
def compare_command(
    source: str,
    braces: tuple[str, ...],
    maps: tuple[str, ...],
    settings: tuple[str, ...],
    subject: str | None,
    scheme: str | None,
    step: str | None,
    stop: str | None,
    trials: int | None,
    decide: bool,
    workers: int | None,
    resume: bool,
    max_failed: str,
    in_process: bool,
    trial_limit: str | None,
    progress: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """The same landings with each brace and with none: peaks, paired differences, loads, ordinary motion."""
    from .brace.compare import compare_braces, load_source
    from .brace.comparison import comparison_listing
    from .scenario import parse_value
    from .study.progress import reporter
    from .study.study import Study

    devices = _devices(braces, maps, "--brace")
    pairs = [_pair(s, "--set", "NAME.PARAMETER=VALUE") for s in settings]
    again, landed = _again(), load_source(source)
    if resume and not isinstance(landed, Study):
        _warn(f"--resume: {source} is one landing with each brace; they run again")
    try:
        done = compare_braces(
            landed,
            {name: file for name, file, _ in devices},
            maps={name: mapping for name, _, mapping in devices if mapping is not None},
            settings={name: parse_value(value) for name, value in pairs},
            subject=subject,
            scheme=scheme,
            step=step,
            stop=stop,
            out=out or Path("runs") / f"compare_{Path(source).stem}",
            trials=trials,
            decide=decide,
            workers=workers,
            resume=resume,
            command=again,
            max_failed=_share(max_failed),
            in_process=in_process,
            limits=_limits(trial_limit),
            progress=reporter(progress),
            say=lambda name: None if progress == "none" else _show(f"{name} ...", err=True),
        )
    except signals.Interrupted:
        many = isinstance(landed, Study)
        _show(f"continue with: {again} --resume" if many else f"begin again with: {again}", err=True)
        raise
    for entry in done.entries:
        for warning in entry.warnings:
            _warn(f"{entry.name}: {warning}")
    _show(
        json.dumps(done.summary.to_json(), allow_nan=False)
        if as_json
        else f"{comparison_listing(done.summary)}\n\nwritten: {done.out}/compare.json, {done.out}/figures/compare.png"
    )
    if done.failed:
        raise SimulationError(
            f"{len(done.failed)} of {len(done.entries)} failed: "
            f"{'; '.join(f'{e.name}: {e.message}' for e in done.failed)}"
        )


PLATFORM = click.option(
    "--platform",
    "platforms",
    multiple=True,
    metavar="NAME",
    help="Of the libraries: linux64, win64, darwin64; may be given more than once (default: this machine's, and win64 "
    "where mingw-w64 is installed).",
)


@cli.group("brace", cls=guidance.Guided)
def brace_group() -> None:
    """Make a brace FMU: from a measured table, or from a template."""


@brace_group.command("new")
@click.argument("folder", type=PATH)
@click.option("--lang", type=click.Choice(["python", "c"]), required=True, help="Language of the brace.")
def brace_new(folder: Path, lang: str) -> None:
    """Start a brace project in FOLDER: sources that build as they are, and a README."""
    from .brace.new import new_brace

    made = ", ".join(str(path) for path in new_brace(folder, lang))
    _show(f"written: {made}\nnext: {_command('brace', 'build', folder)}")


@brace_group.command("build")
@click.argument("folder", type=PATH)
@out_option("FMU to write (default: FOLDER's name .fmu, here).")
@PLATFORM
def brace_build(folder: Path, out: Path | None, platforms: tuple[str, ...]) -> None:
    """Build the FMU of a brace project (C: with $CC, cc, gcc or clang, else CMake)."""
    from .brace.new import build_brace

    target = build_brace(folder, out, platforms)
    _show(f"written: {target}\nnext: {_command('check', target)}")


@brace_group.command("from-csv")
@click.argument("table", type=PATH)
@out_option("FMU to write (default: TABLE with the ending .fmu).")
def from_csv_command(table: Path, out: Path | None) -> None:
    """Turn a torque-angle TABLE (CSV: angle [deg], subtalar_resistance [N.m], ...) into an FMU; no compiler needed."""
    from .brace.from_csv import brace_from_csv

    made = brace_from_csv(table, out)
    _show_spans(made.spans)
    _show(f"written: {made.fmu}\nnext: {_command('check', made.fmu)}")


@brace_group.command("calibrate")
@click.argument("fmu", type=PATH)
@click.option(
    "--bench",
    required=True,
    type=PATH,
    metavar="TABLE.csv",
    help="Measured torques, as from-csv reads them.",
)
@click.option(
    "--vary",
    "varied",
    multiple=True,
    required=True,
    metavar="NAME=LOW..HIGH",
    help='A parameter and its range, such as "stiffness=10..80 N.m/rad".',
)
@click.option(
    "--map",
    "mapping",
    type=PATH,
    help="Mapping file: the FMU's names, signs and units to the contract's.",
)
@out_option("File for the values, a figure beside it (default: FMU's name -values.toml, here).")
@FORCE
def brace_calibrate(
    fmu: Path, bench: Path, varied: tuple[str, ...], mapping: Path | None, out: Path | None, force: bool
) -> None:
    """Fit parameters of the device FMU to torques measured on a bench, before it lands."""
    from .brace.calibrate import calibrate, write_calibration

    found = calibrate(fmu, bench, dict(_pair(text, "--vary", "NAME=LOW..HIGH") for text in varied), mapping)
    target = out or Path(f"{fmu.stem}-values.toml")
    _warn_of_file(target, force, (fmu, bench, mapping))
    write_calibration(target, found, bench.name)
    _show(f"{found.listing()}\n\nwritten: {target}, {target.with_suffix('.png')}")
    _show(f"next: {_command('design', 'STUDY', '--fmu', f'brace={fmu}')} {found.settings()} --vary ... --goal ...")


@cli.group("anatomy", cls=guidance.Guided)
def anatomy_group() -> None:
    """Take the passive ankle from measurements."""


@anatomy_group.command("from-csv")
@click.argument("table", type=PATH)
@click.option(
    "--with-brace",
    "worn",
    type=PATH,
    metavar="TABLE2.csv",
    help="The same ankle with a brace on: their difference becomes the brace's FMU.",
)
@click.option("--base", default="incline30", show_default=True, metavar="SCENARIO", help="What the ankle changes.")
@click.option("--talocrural", metavar='"0 deg"', help="Where it was held while the subtalar joint was turned.")
@click.option("--subtalar", metavar='"0 deg"', help="Where it was held while the talocrural joint was turned.")
@out_option("Scenario file, a figure and the brace beside it (default: TABLE's name .toml, here).")
@FORCE
def anatomy_from_csv(
    table: Path,
    worn: Path | None,
    base: str,
    talocrural: str | None,
    subtalar: str | None,
    out: Path | None,
    force: bool,
) -> None:
    """Fit the passive ankle to a torque-angle TABLE measured without a brace (CSV: angle [deg], subtalar_resistance
    [N.m], or about rotation_x, rotation_y, rotation_z)."""
    from .brace.ankle import brace_between, measured_ankle, write_ankle, write_difference
    from .shipped import fmu_path
    from .units import quantity, unit

    held = {
        name: quantity(text, unit("rad"), f"--{name}")
        for name, text in (("talocrural", talocrural), ("subtalar", subtalar))
        if text is not None
    }
    found, curves = measured_ankle(table, base, **held)
    brace = None if worn is None else brace_between(worn, curves, table)
    target = out or Path(f"{table.stem}.toml")
    _warn_of_file(target, force, (table, worn, Path(base)))
    write_ankle(target, found, table.name, base)
    _show(f"{found.listing()}\n\nwritten: {target}, {target.with_suffix('.png')}")
    device = target.with_name(f"{target.stem}_brace.fmu")
    if brace is not None and worn is not None:
        spans = write_difference(device, brace, worn, fmu_path("brace_table", Path.cwd(), "brace_table"))
        _show_spans(spans)
        _show(f"written: {device}")
    _show(f"next: {_command('run', target, *([] if brace is None else ['--fmu', f'brace={device}']))}")


def _show_spans(spans: Mapping[str, tuple[float, float]]) -> None:
    """Where the data of a table's brace end."""
    from .brace.from_csv import measured_span

    for axis, (low, high) in spans.items():
        _show(f"{axis}: {measured_span(low, high)}")


def form_options(command: Command) -> Command:
    """What figures are written as."""
    for option in reversed(
        (
            click.option(
                "--format",
                "kinds",
                default="png,svg",
                show_default=True,
                help="Of pdf, svg, png, tiff; several with commas.",
            ),
            click.option(
                "--width", metavar="single|double|CM", help="8.5, 17.8 or so many cm (default: single; 16 on a screen)."
            ),
            click.option(
                "--style",
                type=click.Choice(["journal", "screen"]),
                default="journal",
                show_default=True,
                help="As a journal prints it, or larger for slides.",
            ),
            click.option("--panels", is_flag=True, help="A, B, C on the panels."),
        )
    ):
        command = option(command)
    return command


@cli.command("plot")
@FOLDERS
@form_options
@click.option("--only", metavar="NAME,...", help="These figures alone, such as cdf,tornado.")
@click.option("--response", metavar="NAME", help="Of studies, in place of the first that their files name.")
@out_option("Where figures/ goes (default: the first folder).")
def plot_command(
    folders: tuple[Path, ...],
    kinds: str,
    width: str | None,
    style: str,
    only: str | None,
    response: str | None,
    panels: bool,
    out: Path | None,
) -> None:
    """Draw what the FOLDERS of runs, studies and comparisons hold, over each other; captions.txt beside the figures."""
    from .figures.gallery import figure_form, figure_kinds, write_figures
    from .folders.read import read_folders

    form, chosen = figure_form(width, style == "screen", panels), figure_kinds(kinds)
    names = [name.strip() for name in (only or "").split(",") if name.strip()]
    if only is not None and not names:
        raise InputError(f"--only {only!r}: name figures, such as cdf,tornado")
    for path in write_figures(read_folders(folders), out or folders[0], chosen, form, names, response):
        _show(f"written: {path}")


@cli.command("paper")
@click.option("--trials", type=click.IntRange(1), help="Landings of each study, instead of the paper's 1000.")
@click.option("--workers", type=click.IntRange(1), help="Worker processes (default: one per core).")
@form_options
@PROGRESS
@out_option("Folder of the studies and the figures (default: runs/paper).")
def paper_command(
    trials: int | None,
    workers: int | None,
    kinds: str,
    width: str | None,
    style: str,
    panels: bool,
    progress: str,
    out: Path | None,
) -> None:
    """Repeat the paper: its six studies and its search, then its Figures 1C, 4 and 5 with the published figures beside
    ours. What the folder holds already is continued. Yoder, Petrella & Farrokhi 2021, doi 10.3389/fbioe.2021.765331."""
    from .figures.gallery import figure_form, figure_kinds
    from .study.progress import reporter
    from .validation.paper_figures import repeat_paper, write_paper_figures

    form, chosen = figure_form(width, style == "screen", panels), figure_kinds(kinds)
    target = out or Path("runs/paper")

    def begin(name: str) -> Any:
        _show(name, err=True)
        return reporter(progress)

    try:
        folders = repeat_paper(target, trials, workers, begin)
    except (signals.Interrupted, SimulationError):
        _show(f"{chr(10) if sys.stderr.isatty() else ''}continue with: {_again()}", err=True)
        raise
    for path in write_paper_figures(folders, target, chosen, form):
        _show(f"written: {path}")


TRIAL = click.option(
    "--trial",
    metavar="N|worst|pXX",
    help="Of a study: a number, the largest first response, a percentile of it (default p50).",
)


@cli.command("animate")
@FOLDERS
@TRIAL
@click.option("--slow", type=float, default=20.0, show_default=True, help="How many times slower than real time.")
@out_option("File: .webp, .gif, .mp4, or .png for one picture (default: animation.webp in the first folder).")
def animate_command(folders: tuple[Path, ...], trial: str | None, slow: float, out: Path | None) -> None:
    """Show the landings of up to six FOLDERS (or of the braces in a comparison's) side by side in slow motion."""
    from .animate.film import animate
    from .folders.landing import load_landings

    target = out or folders[0] / "animation.webp"
    runs = [run for folder in folders for run in load_landings(folder, trial)]
    for run in runs:
        _show(f"{run.label}: {run.title}", err=True)  # the film may have room for its beginning alone
    count = animate(runs, target, slow)
    _show(f"written: {target} ({count} picture{'s' if count > 1 else ''}, {target.stat().st_size / 1e6:.1f} MB)")


@cli.command("export")
@click.argument("folder", type=PATH)
@TRIAL
@click.option(
    "--format",
    "kind",
    type=click.Choice(["sto", "mot", "csv", "parquet", "glb"]),
    help="Default: by the ending of the file.",
)
@click.option(
    "--content",
    type=click.Choice(["coordinates", "states", "forces", "ground", "signals"]),
    help="Default: states in .sto, coordinates in .mot, else signals.",
)
@click.option("--speeds", is_flag=True, help="Of coordinates: their rates beside them (_u), for `motion` to the bit.")
@out_option("File to write.", required=True)
def export_command(
    folder: Path, trial: str | None, kind: str | None, content: str | None, speeds: bool, out: Path
) -> None:
    """Write the landing in FOLDER for other tools: OpenSim .sto and .mot, CSV, Parquet, glTF (.glb)."""
    from .export.landing import write_landing
    from .folders.landing import load_landing

    if (kind or out.suffix.lower().removeprefix(".")) == "glb":
        from .export.gltf import write_glb

        if content or speeds:
            raise InputError(f"{out}: a .glb holds what moves; leave --content and --speeds out")
        poses, seconds = write_glb(load_landing(folder, trial), out)
        _show(f"written: {out} ({poses} poses, an animation of {seconds:.1f} s, {out.stat().st_size / 1e6:.1f} MB)")
        return
    rows, columns = write_landing(load_landing(folder, trial), out, kind, content, speeds)
    _show(f"written: {out} ({rows} rows, {columns} columns and time)")


@cli.group("ssp", cls=guidance.Guided)
def ssp_group() -> None:
    """Landings and devices as systems of the SSP standard: FILE.ssp."""


@ssp_group.command("export")
@click.argument("scenario")
@FMUS
@MAPS
@SET
@SUBJECT
@SCHEME
@STEP
@click.option(
    "--version",
    "standard",
    type=click.Choice(["1.0", "2.0"]),
    help="Of the SSP standard (default: 1.0).",
)
@click.option("--container", is_flag=True, help="One FMU, FILE.fmu, for tools that do not read SSP.")
@out_option("File to write: FILE.ssp, or FILE.fmu with --container.", required=True)
def ssp_export(
    scenario: str,
    fmus: tuple[str, ...],
    maps: tuple[str, ...],
    settings: tuple[str, ...],
    subject: str | None,
    scheme: str | None,
    step: str | None,
    standard: str | None,
    container: bool,
    out: Path,
) -> None:
    """Write SCENARIO with all its FMUs as one package that other tools open."""
    from .export.container import export_container
    from .export.package import export_package
    from .scenario import load_scenario

    ending = ".fmu" if container else ".ssp"
    if out.suffix.lower() != ending:
        raise InputError(f"{out}: must end in {ending}{'' if container else ' (--container writes an .fmu)'}")
    if container and standard is not None:
        raise InputError("--version is of the SSP standard; a container is an FMU of FMI 2.0")
    chosen = _changed(load_scenario(scenario), fmus, maps, settings, subject)
    chosen = chosen.with_master(scheme=scheme, communication_step=step)
    for warning in chosen.warnings:
        _warn(warning)
    for note in export_container(chosen, out) if container else export_package(chosen, out, standard or "1.0"):
        _show(f"note: {note}")
    _show(f"written: {out} ({out.stat().st_size / 1e6:.1f} MB)")


@ssp_group.command("check")
@click.argument("file", type=PATH)
@JSON
def ssp_check(file: Path, as_json: bool) -> None:
    """Say whether FILE.ssp can be run here: archive, schema, references, units, connections, loops. Nothing runs."""
    from .scenario.inspection import inspected

    found = inspected(file)
    if as_json:
        _show(json.dumps(found))
        return
    for name, lines in found.items():
        for k, line in enumerate([lines] if isinstance(lines, str) else lines):
            _show(f"{'' if k else name:14}{line}")


@cli.command("motion")
@click.argument("file", type=PATH)
@click.option("--at", metavar='"0.81 s"', help="Instant in the file (default: first contact of the foot).")
@click.option("--side", type=click.Choice(["right", "left"]), default="right", show_default=True, help="Landing foot.")
@click.option(
    "--pose",
    type=click.Choice(["touching", "given"]),
    default="touching",
    show_default=True,
    help="given: the pelvis at the file's height; touching: where the sole touches.",
)
@click.option("--base", default="incline30", show_default=True, metavar="SCENARIO", help="What the landing changes.")
@click.option("--cutoff", metavar='"15 Hz"', help="Of the smoothing spline that gives the speeds.")
@click.option(
    "--knee", type=click.Choice(["flexion", "extension"]), help="The file's positive direction, if it is not seen."
)
@click.option("--angles", type=click.Choice(["degrees", "radians"]), help="Of the file, where its header does not say.")
@click.option("--turn", metavar='"90 deg"', help="Turn the motion about the vertical, + to the left.")
@click.option("--model", type=PATH, metavar="FILE.osim", help="The person's scaled model: size, mass.")
@out_option("Scenario file, a page and a picture beside it (default: FILE's name .toml, here).")
@FORCE
@JSON
def motion_command(
    file: Path,
    at: str | None,
    side: str,
    pose: str,
    base: str,
    cutoff: str | None,
    knee: str | None,
    angles: str | None,
    turn: str | None,
    model: Path | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Start a landing as a measured motion: FILE (.mot, .sto of OpenSim, OpenCap, AddBiomechanics) -> a scenario."""
    from .motion.doubt import peak_doubts
    from .motion.page import motion_json, motion_listing, motion_warnings
    from .motion.start import motion_start
    from .motion.write import write_motion
    from .units import quantity, unit

    def of(text: str | None, name: str, option: str) -> dict[str, float]:
        proposed = "s" if name == "s" else ""  # an instant in a file, not one after contact
        return {} if text is None else {option: quantity(text, unit(name), f"--{option}", proposed)}

    numbers = of(at, "s", "at") | of(cutoff, "Hz", "cutoff") | of(turn, "rad", "turn")
    start = motion_start(file, side=side, pose=pose, base=base, knee=knee, angles=angles, model=model, **numbers)
    for warning in motion_warnings(start):
        _warn(warning)
    peaks = peak_doubts(start)
    target = out or Path(f"{file.stem}.toml")
    _warn_of_file(target, force, (file, model, Path(base)))
    written = write_motion(start, peaks, target)
    if as_json:
        _show(json.dumps(motion_json(start, peaks), allow_nan=False))
        return
    _show(f"{motion_listing(start, peaks)}\n\nwritten: {', '.join(str(path) for path in written)}")
    _show(f"next: {_command('run', written[0])}")


@cli.command("report")
@FOLDERS
@click.option(
    "--trial",
    metavar="N|worst|pXX|none",
    help="Landing of a study that can be turned (default p50); none: no landing, nothing is simulated.",
)
@out_option("Where report.html goes (default: the first folder).", metavar="FILE|DIR")
def report_command(folders: tuple[Path, ...], trial: str | None, out: Path | None) -> None:
    """Write one HTML file about what the FOLDERS of runs, studies and comparisons hold: verdict, tables, figures,
    inputs, provenance, limits."""
    from .folders.read import edited_since, read_folders
    from .report.page import write_report

    found = read_folders(folders)
    for line in edited_since(found):
        _warn(line)
    _show(f"written: {write_report(found, out or folders[0], trial)}")


@cli.command("list")
@click.argument("kind", required=False, type=click.Choice(guidance.LISTED))
@click.argument("scenario", required=False, shell_complete=guidance.scenarios)
@FMUS
@MAPS
@JSON
def list_command(
    kind: str | None, scenario: str | None, fmus: tuple[str, ...], maps: tuple[str, ...], as_json: bool
) -> None:
    """List every name that may be typed: scenarios, studies and braces that ship, the parameters of a SCENARIO with
    unit, range, default, value and meaning, the responses of a landing. Without KIND: all that needs no scenario."""
    from .catalogue import catalogue, catalogue_table
    from .scenario import load_scenario

    if kind != "parameters" and (scenario or fmus or maps):
        raise InputError("list: only `list parameters` takes a SCENARIO, --fmu and --map")
    chosen = None if scenario is None else _changed(load_scenario(scenario), fmus, maps, (), None)
    kinds = (kind,) if kind else tuple(k for k in guidance.LISTED if k != "parameters")
    if as_json:
        heard = {"scenario": scenario} if scenario else {}
        _show(json.dumps(heard | {k: catalogue(k, chosen) for k in kinds}, allow_nan=False))
        return
    _show("\n\n".join(catalogue_table(k, terminal.width(), chosen) for k in kinds))
    if kind is None:
        _show("\nnext: sprain-cosim list parameters incline30_brace")


@cli.command("scenarios", hidden=True)
@JSON
def scenarios_command(as_json: bool) -> None:
    """List the scenarios that ship: another name of `list scenarios`."""
    from .catalogue import catalogue, catalogue_table
    from .shipped import scenario_folder

    if as_json:
        names = {record["name"]: record["heading"] for record in catalogue("scenarios")}
        _show(json.dumps({"folder": str(scenario_folder()), "scenarios": names}))
        return
    _show(catalogue_table("scenarios", terminal.width()))


@cli.command("subject")
@click.argument("person", required=False)
@JSON
def subject_command(person: str | None, as_json: bool) -> None:
    """Show what a PERSON such as "female, 1.63 m, 62 kg" makes of the plant: measures, estimates with what they leave
    open, factors. Without PERSON: the base person, with whom the plant was made."""
    from .subject.person import BASE
    from .subject.record import SubjectRecord, subject_listing
    from .subject.words import parse_subject

    chosen = BASE if person is None else parse_subject(person, "PERSON")
    _show(json.dumps(SubjectRecord.of(chosen).to_json(), allow_nan=False) if as_json else subject_listing(chosen))


@cli.command("build")
@click.argument("models", nargs=-1)
@PLATFORM
@click.option(
    "--quick",
    is_flag=True,
    help="Only what landings on this machine need: no win64 unless named, no plant_mujoco (the plant's reference).",
)
def build_command(models: tuple[str, ...], platforms: tuple[str, ...], quick: bool) -> None:
    """Build the FMUs of the clone's fmus/ folder (all, or the MODELS named) whose sources have changed, and the
    package's own libraries."""
    from .cosim.native_libraries import build_libraries
    from .fmu.build import build_all, own_platform

    here = own_platform()
    if quick and here:
        platforms = platforms or (here,)
    built = build_all(models, platforms, ("plant_mujoco",) if quick else (), lambda line: _show(line, err=True))
    for fmu in built:
        _show(f"{fmu.file}  {fmu.guid[:12]}{'' if fmu.new else '  current'}")
    if not built:
        _show("nothing to build: the FMUs ship with the package")
    for library, new in build_libraries(platforms) if built and not models else ():
        _show(f"{library}{'' if new else '  current'}")


@cli.command("validate")
@click.option("--quick", is_flag=True, help="Smaller studies, no long checks: under two minutes on two cores.")
@click.option("--list", "listed", is_flag=True, help="List the checks and run none.")
@click.option(
    "--only",
    multiple=True,
    metavar="ID",
    help="An id, a group (paper) or a pattern (uq-0*); may be given more than once.",
)
@click.option("--checks", "folder", type=PATH, metavar="FOLDER", help="Your own checks: *.toml files.")
@click.option("--workers", type=click.IntRange(1), help="Worker processes of the studies (default: one per core).")
@click.option("--strict", is_flag=True, help="Known gaps and checks that could not run fail the validation too.")
@out_option("Folder for validation.html, validation.json, junit.xml, credibility.md.", metavar="DIR")
@click.option("--junit", type=PATH, metavar="FILE", help="JUnit XML.")
@JSON
@click.pass_obj
def validate_command(
    received: list[int] | None,
    quick: bool,
    listed: bool,
    only: tuple[str, ...],
    folder: Path | None,
    workers: int | None,
    strict: bool,
    out: Path | None,
    junit: Path | None,
    as_json: bool,
) -> int:
    """Is this installation right, and is it the model of the paper? Exit code 1 when a check fails."""
    from .validation import suite
    from .validation import writers as output
    from .validation.laboratory import Laboratory

    known = suite.suite(folder)
    checks = suite.select(known, only)
    if listed:
        for check in checks:
            _show(f"{check.id:14}{'quick' if check.quick else 'full':7}{check.title}")
        return 0
    output.check_targets(out, junit)

    def keep(report: suite.Report) -> None:
        output.write_validation(report, out, junit)

    report = suite.run_checks(
        checks,
        Laboratory(quick, workers),
        lambda done: _show(suite.outcome_line(done), err=as_json),
        only,
        keep,
        lambda: bool(received),
        len(known),
    )
    keep(report)
    _show(
        output.json_text(report).strip()
        if as_json
        else f"\n{suite.totals(report)}" + (f"\nwritten: {out}" if out else "")
    )
    return 0 if report.passes(strict) else 1


@cli.command("doctor")
@JSON
def doctor_command(as_json: bool) -> None:
    """Check this installation: libraries, FMUs, caches, one short landing."""
    from .doctor import findings

    found = findings()
    if as_json:
        _show(json.dumps([{"ok": ok, "what": what, "detail": detail} for ok, what, detail in found]))
    else:
        for ok, what, detail in found:
            _show(f"{'ok     ' if ok else 'problem'}  {what:22}{detail}")
    if not all(ok for ok, _, _ in found):
        raise SystemExit(4)


def _changed(
    chosen: Any, fmus: tuple[str, ...], maps: tuple[str, ...], settings: tuple[str, ...], subject: str | None
) -> Any:
    """A scenario or a study with what --fmu, --map, --subject and --set ask for."""
    from .scenario import parse_value

    for name, file, mapping in _devices(fmus, maps):
        chosen = chosen.replace_fmu(name, file, mapping)
    if subject is not None:
        chosen = chosen.with_subject(subject)
    for text in settings:
        name, value = _pair(text, "--set", "COMPONENT.PARAMETER=VALUE")
        if value.startswith("@") and "." not in name:
            described = getattr(chosen, "scenario", chosen)
            for full, member in described.values_of_set(name, value[1:]).items():
                chosen = chosen.override(full, member)
            continue
        chosen = chosen.override(name, parse_value(value))
    return chosen


def _share(text: str) -> float:
    from .units import proportion

    return proportion(text, "--max-failed")


def _limits(text: str | None) -> Any:
    """Of processes, with that limit of wall time for a landing."""
    from .process import Limits
    from .units import quantity, unit

    if text is None:
        return Limits()
    seconds = quantity(text, unit("s"), "--trial-limit", "s")
    if seconds <= 0:
        raise InputError(f"--trial-limit {text}: must be positive")
    return Limits(trial=seconds)


def _devices(fmus: tuple[str, ...], maps: tuple[str, ...], option: str = "--fmu") -> list[tuple[str, str, str | None]]:
    """(name, FMU, mapping file or None) of each."""
    mapped = dict(_pair(text, "--map", "NAME=FILE") for text in maps)
    devices = [(*_pair(text, option, "NAME=FILE"), None) for text in fmus]
    names = [name for name, _, _ in devices]
    for name in mapped:
        if name not in names:
            raise InputError(f"--map {name}=...: there is no {option} {name}=... that it could belong to")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{option} {name}=...: given twice")
    return [(name, file, mapped.get(name)) for name, file, _ in devices]


def _pair(text: str, option: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise InputError(f"{option} {text}: must read {form}")
    return name.strip(), value.strip()


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line; errors become one line on stderr and the exit code of interface and README."""
    for library, value in ONE_THREAD.items():
        os.environ.setdefault(library, value)
    received = signals.interrupt()
    _keep_stdout()
    terminal.make_readable()
    code = _delivered(_run(arguments, received))
    if received:
        signals.settle()
    sys.exit(signals.exit_code(received[0]) if received else code)


def _delivered(code: int) -> int:
    """The exit code once all that was printed is out: a full disk is no success, a reader that has gone no failure of
    ours."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError) as problem:
        _silence()
        gone = isinstance(problem, BrokenPipeError)
        return code or (NOBODY_READS if gone else _say(f"standard output: {_of_system(problem)}", 4))
    return code


def _silence() -> None:
    """What is still to be printed goes nowhere, so that nothing fails once more at the end."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _keep_stdout() -> None:
    """From here on the results alone go where the caller reads them: what foreign code in this process prints into
    descriptor 1 goes to where the warnings are."""
    if sys.stdout is not sys.__stdout__ or sys.stdout is None:
        return
    try:
        sys.stdout.flush()
        own = os.dup(sys.stdout.fileno())
        os.dup2(2, 1)
    except (OSError, ValueError):  # closed, or none
        return
    sys.stdout = open(own, "w", encoding=sys.stdout.encoding, errors=sys.stdout.errors)  # noqa: SIM115 - to the end


def _run(arguments: list[str] | None, received: list[int]) -> int:
    """The exit code. A signal that arrives while a Python FMU runs in this interpreter comes back as an FMI error,
    hence `received`."""
    log = logging.getLogger("sprain_cosim")
    log.addHandler(warnings := _Warnings(logging.WARNING))
    try:
        code = (
            cli.main(
                _renamed(sys.argv[1:] if arguments is None else arguments),
                prog_name="sprain-cosim",
                standalone_mode=False,
                obj=received,
            )
            or 0
        )
    except click.exceptions.NoArgsIsHelpError as problem:  # whose message is the help itself
        _show(problem.format_message(), err=True)
        code = problem.exit_code
    except click.ClickException as problem:
        where = problem.ctx.command_path if isinstance(problem, click.UsageError) and problem.ctx else "sprain-cosim"
        code = _say(f"{_one_line(problem.format_message())} (see `{where} --help`)", 2)
    except SprainError as problem:
        code = _say("interrupted" if received else _one_line(str(problem)), problem.exit_code)
    except (click.Abort, signals.Interrupted):
        code = _say("interrupted", 130)
    except (signals.NobodyReads, BrokenPipeError):
        _silence()
        code = NOBODY_READS
    except (OSError, ImportError) as problem:
        if os.environ.get("SPRAIN_COSIM_DEBUG"):
            raise
        code = _say(_one_line(_of_system(problem)), 2 if getattr(problem, "errno", None) in NO_NAME else 4)
    except MemoryError:
        code = _say("this machine has too little memory for it", 4)
    except Exception as problem:
        if os.environ.get("SPRAIN_COSIM_DEBUG"):
            raise
        code = _say(
            f"internal: {type(problem).__name__}: {_one_line(str(problem))}; please report it (SPRAIN_COSIM_DEBUG=1 "
            "shows where)",
            4,
        )
    finally:
        log.removeHandler(warnings)
    return code


def _renamed(arguments: list[str]) -> list[str]:
    """Options in their present spelling; one warning for each that had another."""
    present = []
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if name in RENAMED:
            _warn(f"{name} is called {RENAMED[name]} now; the next version no longer takes it")
        present.append(f"{RENAMED.get(name, name)}{equals}{value}")
    return present


class _Warnings(logging.Handler):
    """What the package logs, as the command line says it."""

    def emit(self, record: logging.LogRecord) -> None:
        _warn(record.getMessage())


def _say(message: str, code: int) -> int:
    _show(f"error: {message}", err=True)
    return code


def _warn(text: str) -> None:
    _show(f"warning: {_one_line(text)}", err=True)


def _show(text: str, err: bool = False) -> None:
    """The one way to the terminal, within its width: titles, names and paths come from strangers."""
    columns = terminal.width(sys.stderr if err else sys.stdout)
    click.echo(terminal.coloured(terminal.fitted(visible(text), columns), columns), err=err)


def _of_system(problem: Exception) -> str:
    """What this system says of a file, without the number that it has for that."""
    if not isinstance(problem, OSError) or problem.strerror is None:
        return str(problem)
    return f"{problem.filename}: {problem.strerror}" if problem.filename is not None else problem.strerror


def _one_line(text: str) -> str:
    return visible(" ".join(text.split()))
