"""The folder that `run --out` leaves: signals.csv, landing.png, summary.json. The summary is written last: without it
the folder is not complete."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from .. import __version__, files
from ..cosim.result import PEAK, Result
from ..errors import EnvironmentProblem, InputError
from ..fmu.messages import Messages
from ..machine.here import SYSTEM
from ..notebook import Card, Plottable, Rows, coupling_share, with_doubt
from ..records import FORMAT, Record, Summary, finite, known_format, optional
from ..scenario import Scenario
from ..subject.record import SubjectRecord

FILE = "summary.json"
SIGNALS = "signals.csv"
FILES = (SIGNALS, "landing.png", FILE)
BESIDE = (*FILES, "figures", "report.html")  # what other commands leave in the folder


@dataclass(frozen=True)
class HeldOutput(Record):
    """How old the torques of a sampled device become between two of its calls.

    period_s            of its calls [s]
    largest_change_Nm   of a torque from one call to the next [N·m]
    share               of that torque's largest magnitude
    axis                of that torque
    """

    period_s: float | None
    largest_change_Nm: float | None
    share: float | None
    axis: str


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class RunSummary(Card, Summary):
    """One landing: content of its summary.json, and what `run --json` prints.

    format                     of the file
    status, message            completed, stopped or failed, and why
    wall_s                     wall time [s]
    initial_pose               None for a plant that has no such choice
    coupling_error             share of the exchanged energy, 0 ... 1; None where nothing is exchanged
    metrics                    {metric: value in the unit of its name}
    scenario, title            where the scenario comes from, and what it is
    scheme, scheme_reason      coupling scheme, and why it was chosen
    warning                    of the stability guard; empty for none
    warnings                   what `run` said of scenario and device before the landing, one line each; absent for none
    communication_step_s       [s]
    held                       {component: what holding its torques between its own times may cost}
    exchanges                  communication steps taken
    smallest_step_s            of those [s]
    fmus, sha256               {component: file name}, {component: of the file's content}
    version                    of this package
    parameters                 {"component.parameter": as it was set}, inputs held constant among them
    dropped                    parameters that the FMU put in a component's place does not have
    isolation                  sandbox, process or none: where foreign FMUs ran
    granted                    {component: what its mapping file allows it beyond the sandbox}
    coupling_doubt_deg         how uncertain the peak of the foot is by the communication step, twice its change at half
                               of it [deg]; None where that was not run
    estimates_doubt_deg        standard deviation of the peak over the persons who share what is known of the subject,
                               to first order [deg]; absent: nobody is estimated, or it is not known
    coupling_converged         whether that is at most 0.1 deg; None where it is not known
    fmu_messages               {component: what its FMU said}, of those that said anything
    subject                    who landed; absent: the person with whom the plant was made
    coupling_check             {metric: its change at half the communication step}; of a run that was checked so
    trial, reproduced          of a study's trial that ran again: its number, and whether its numbers are the same
    """

    format: int = FORMAT
    status: str
    message: str
    wall_s: float | None = None
    initial_pose: str | None = None
    coupling_error: float | None = None
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    scenario: str = ""
    title: str
    scheme: str
    scheme_reason: str = ""
    warning: str = ""
    communication_step_s: float | None = None
    held: Mapping[str, HeldOutput] = field(default_factory=dict)
    exchanges: int = 0
    smallest_step_s: float | None = None
    fmus: Mapping[str, str | None] = field(default_factory=dict)
    sha256: Mapping[str, str | None] = field(default_factory=dict)
    version: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    isolation: str = ""
    granted: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    coupling_doubt_deg: float | None = None
    coupling_converged: bool | None = None
    fmu_messages: Mapping[str, Messages] = field(default_factory=dict)
    warnings: tuple[str, ...] | None = optional()
    subject: SubjectRecord | None = optional()
    estimates_doubt_deg: float | None = optional()
    coupling_check: Mapping[str, float | None] | None = optional()
    trial: int | None = optional()
    reproduced: bool | None = optional()

    @classmethod
    def of(cls, scenario: Scenario, result: Result) -> Self:
        apart = scenario.isolation()
        return cls(
            status=result.status,
            message=result.message,
            wall_s=round(result.wall, 6),
            initial_pose=scenario.initial_pose(),
            coupling_error=finite(result.coupling_error),
            metrics={name: finite(value) for name, value in result.metrics.items()},
            scenario=scenario.source,
            title=scenario.heading,
            scheme=result.scheme,
            scheme_reason=result.scheme_reason,
            warning=result.warning,
            communication_step_s=scenario.master.communication_step,
            held={name: HeldOutput(h.period, h.largest_change, h.share, h.axis) for name, h in result.held.items()},
            exchanges=result.exchanges,
            smallest_step_s=result.smallest_step,
            fmus={name: path.name for name, path in scenario.fmus.items()},
            sha256={component.name: component.sha256 for component in scenario.components()},
            version=__version__,
            parameters=scenario.values(),
            dropped=tuple(scenario.dropped),
            isolation=apart.kind,
            granted=apart.granted,
            coupling_doubt_deg=finite(result.coupling_doubt),
            coupling_converged=result.converged,
            fmu_messages=result.messages,
            estimates_doubt_deg=finite(result.estimates_doubt),
            subject=None if scenario.subject is None else SubjectRecord.of(scenario.subject),
        )

    def card(self) -> tuple[str, Rows]:
        rows = [("status", f"{self.status}: {self.message}" if self.message else self.status)]
        if PEAK in self.metrics:
            rows.append(("peak supination", with_doubt(self.metrics[PEAK], self.coupling_doubt_deg, "deg")))
        rows.append(("coupling error", coupling_share(self.coupling_error)))
        return self.title, [*rows, ("warning", self.warning)] if self.warning else rows


@dataclass(frozen=True, repr=False)
class RunFolder(Plottable):
    """One landing: its folder, summary and signals."""

    path: Path
    summary: RunSummary
    result: Result

    @property
    def title(self) -> str:
        return self.summary.title

    def card(self) -> tuple[str, Rows]:
        heading, rows = self.summary.card()
        return heading, [*rows, ("folder", str(self.path))]

    @property
    def pose(self) -> str:
        """The initial pose; empty for a plant that has none."""
        return self.summary.initial_pose or ""


def check_run_folder(folder: Path) -> None:
    """Raises InputError when the folder holds something else than an earlier run, or cannot be there at all."""
    files.check_folder(folder)
    if folder.is_dir():
        strangers = sorted(
            p.name
            for p in folder.iterdir()
            if p.name not in BESIDE and p.stem != "animation" and not files.is_partial(p)
        )
        if strangers:
            raise InputError(f"{folder}: holds other files ({', '.join(strangers[:3])}); name a new folder")


def write_run(folder: Path, result: Result, picture: bytes, summary: RunSummary) -> None:
    """Replaces an earlier run; `picture` is the content of landing.png. Raises EnvironmentProblem when the folder
    cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files.sweep(folder)
        SYSTEM.remove(folder / FILE)
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    files.write(folder / SIGNALS, result.csv())
    files.write(folder / "landing.png", picture)
    files.write_json(folder / FILE, summary.to_json())


def read_run(folder: Path) -> RunFolder:
    """Raises InputError when the folder holds no complete run."""
    path = folder / FILE
    if missing := files.is_missing(folder):
        raise InputError(f"{folder}: {missing}")
    if not path.exists():
        raise InputError(
            f"{folder}: no complete run in it; make one with `sprain-cosim run SCENARIO --out "
            f"{SYSTEM.quoted(str(folder))}`"
        )
    content = known_format(files.read_json(path), path)
    for key in RunSummary.lacking(content):
        raise InputError(f"{folder}: not a folder of `sprain-cosim run`: summary.json lacks {key}")
    summary = RunSummary.from_json(content, str(path))
    record = Result.read_csv(folder / SIGNALS)
    head = {key: getattr(summary, key) for key in ("status", "message", "scheme", "coupling_error")}
    result = replace(record, **head)
    return RunFolder(folder, summary, result)


def coupling_note(summaries: Sequence[RunSummary]) -> str:
    """What stands below a figure: initial pose and coupling."""

    def all_of(texts: list[str]) -> str:
        return " and ".join(dict.fromkeys(texts))

    pose = all_of([s.initial_pose for s in summaries if s.initial_pose])
    known = [s.communication_step_s for s in summaries if s.communication_step_s is not None]
    steps = all_of([f"{1e3 * step:g}" for step in known])
    coupling = f"{all_of([s.scheme for s in summaries])} coupling every {steps} ms"
    return f"{f'Initial pose: {pose}; ' if pose else ''}{coupling}."
