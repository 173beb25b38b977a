"""The credibility report, in the order of ASME V&V 40-2018: what this run shows, what only the user can supply, what is
missing.

It gives no score: how much credibility a decision needs is the user's judgement of risk, and the last word that of
whoever relies on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..literature import DEPTH_TEXT, GROUND_TEXT
from .check import FAIL, GAP, NOT_RUN, PASS, CheckOutcome
from .suite import Report


@dataclass(frozen=True)
class Section:
    """One section of the report; each entry is a sentence.

    - title, intro: its heading and its question
    - shown: what this run shows
    - supply: what the user must supply
    - missing: what the software, or its evidence, lacks
    """

    title: str
    intro: str
    shown: tuple[str, ...] = ()
    supply: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evidence:
    """A section whose evidence is the outcome of the checks in `groups`; the other fields as in Section."""

    title: str
    intro: str
    groups: tuple[str, ...]
    supply: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


PURPOSE = (
    Section(
        "1 Question of interest and context of use",
        "The question that the model helps to answer, and the part it plays beside other evidence.",
        supply=(
            "the question, in one sentence (for example: does brace A reduce inversion on a 30° slope more than "
            "brace B?)",
            "the role of the model: the only evidence, or beside bench tests and studies with people",
            "the population, the movement and the range of slopes, drop heights and braces for which the answer "
            "is to hold",
        ),
    ),
    Section(
        "2 Quantities of interest",
        "What is computed, with units, signs and zeros in the names of the metrics.",
        shown=(
            "peak subtalar supination, peak talocrural dorsiflexion, angles and velocities of the joint "
            "coordinate system [deg, deg/s]",
            "moments borne by anatomy and brace at each axis' own peak [N·m], vertical ground reaction [N]",
            "percentiles, correlations, sensitivity factors and exceedance probabilities over a study's inputs, "
            "with intervals",
        ),
        supply=("which of them decides, and the difference that matters in practice",),
        missing=("no injury criterion: the model says how far the ankle goes, not whether a ligament fails",),
    ),
    Section(
        "3 Model risk",
        "Influence of the model on the decision, and consequence of a wrong decision.",
        supply=(
            "influence: how much weight the model has beside other evidence",
            "consequence: what happens to a person if the model is wrong",
        ),
        missing=("nothing here grades the risk; the software cannot know it",),
    ),
)
EVIDENCE = (
    Evidence(
        "4a Verification: software",
        "Is the code right? Automatic checks against closed forms and other software.",
        ("code", "uq", "fmi", "pages"),
        supply=("that the installation is the one that was checked: run `sprain-cosim validate` on it",),
        missing=("no independent review of the code by a third party",),
    ),
    Evidence(
        "4b Verification: calculation",
        "Are the numbers converged? Time step, tolerance and coupling over the whole domain of the inputs.",
        ("numerics", "coupling"),
        supply=(
            "for a device of your own: `sprain-cosim check`, and `run --check-coupling` at the corners of your study",
            "that inputs were typed as meant: read the table of inputs in the study's folder",
        ),
    ),
    Evidence(
        "5a Validation: the model against the paper's model",
        "Is the plant the musculoskeletal model of Yoder et al. 2021? Term by term and landing by landing.",
        ("plant",),
        missing=(
            "this compares one implementation of the model with another; it is no comparison with people",
            "persons of another size (plant-23, plant-24) were compared with OpenSim's scaled models alone, factors "
            "of 0.83...1.12, and never with an experiment",
            "landings were compared until 150 ms, one until 250 ms; after that, and for a drop outside 0.2...0.4 m or "
            "an incline outside 0...30°, the numerics alone were checked, to 0.5 s",
            "surfaces other than the paper's (assumptions, but for the friction of ice), a platform with an edge and "
            "a passive ankle with other coefficients were compared with nothing",
            f"the published pose starts {DEPTH_TEXT}; its first milliseconds are an artefact of the records",
        ),
    ),
    Evidence(
        "5b Validation: outcomes against the published studies",
        "Do the six Monte Carlo studies and the AMV study give the published tables?",
        ("paper",),
        missing=(
            "the published outcomes are simulated as well; there are no measured ankle sprains in the comparison",
            f"ground reactions of {GROUND_TEXT}, are not human; those of the paper's own model neither",
        ),
    ),
    Evidence(
        "5c Validation: your own comparisons",
        "Bench tests of a brace, measured landings: checks from your own folder, `--checks FOLDER`.",
        ("custom",),
        supply=(
            "torque-angle measurements of the brace, with repeatability and the condition of the samples",
            "measured landings or a rig's landings under the inputs that the model was given, with their uncertainty",
        ),
    ),
)
UNCERTAINTY = Section(
    "6 Uncertainty",
    "How sure is an answer, given what is not known of the inputs?",
    shown=(
        "intervals of every percentile, correlation and sensitivity in a study's summary.json, failed trials "
        "counted and bounded",
        "over a population: who lands is drawn from ANSUR II with its correlations, and `groups` says what share of "
        "the variance the person explains",
    ),
    supply=(
        "distributions of the inputs for your population and brace, and where they come from",
        "correlations between inputs, if there are any",
    ),
    missing=(
        "uncertainty of the model's form (one subject's anatomy, scaled; rigid foot, straight muscle paths) is in no "
        "interval",
        "a person given by few measures is estimated by conditional means; what they leave open is in no interval of "
        "one landing, a population or a marginal carries it",
    ),
)
APPLICABILITY = Section(
    "7 Applicability",
    "Is the evidence relevant to the context of use?",
    supply=(
        "a comparison of your context with that domain: posture, slope, drop, surface, brace, person",
        "why evidence from one subject may be used for others",
        "for persons: that soldiers of 17 to 58 years (ANSUR II) stand for yours",
        "for unstable ankles: which of the assumptions in docs/unstable-ankles.md hold for yours",
    ),
    missing=(
        "persons other than the base person (67.5 kg, 1.80 m) were compared with scaled models of OpenSim 4.6 alone, "
        "never with landings of measured persons; their forces, stiffness and reflexes are the base person's",
        "unstable ankles were compared with nothing: their numbers are published group differences or assumptions",
        "one landing movement unless you bring your own; braces that act beyond ankle and subtalar joint are outside",
    ),
)
DOMAIN = (
    "the domain in which the numerics were checked (numerics-01): talocrural -49...-19°, subtalar ±15°, drop "
    "0.1...0.45 m, dissipation 2...8 s/m, "
    "modulus 35...65 MPa/m, incline 0...30°"
)


def sections(report: Report) -> Sequence[Section]:
    """The sections in the order of the standard, with the outcomes of `report` where they belong."""
    short = tuple(_sentence(o) for status in (FAIL, GAP, NOT_RUN) for o in report.outcomes if o.status == status)
    converged = any(o.check.id == "numerics-01" and o.status == PASS for o in report.outcomes)
    return [
        *PURPOSE,
        *(_with_outcomes(evidence, report) for evidence in EVIDENCE),
        UNCERTAINTY,
        replace(APPLICABILITY, shown=(DOMAIN,) if converged else ()),
        Section(
            "8 What falls short",
            "Everything in this run that did not pass." if short else "Every check of this run passed.",
            missing=short,
        ),
    ]


def _with_outcomes(evidence: Evidence, report: Report) -> Section:
    """Checks that passed are shown; those that did not are missing."""
    found = [o for o in report.outcomes if o.check.group in evidence.groups]
    shown = tuple(_sentence(o) for o in found if o.status == PASS)
    short = tuple(_sentence(o) for o in found if o.status != PASS)
    return Section(evidence.title, evidence.intro, shown, evidence.supply, (*short, *evidence.missing))


def _sentence(outcome: CheckOutcome) -> str:
    worst = outcome.worst
    verdict = {PASS: "passed", GAP: "KNOWN GAP", FAIL: "FAILED", NOT_RUN: "not run"}[outcome.status]
    if outcome.status == PASS and worst is not None:
        figure = (
            f"{len(outcome.rows)} numbers, the one closest to its bound: {worst.label} {worst.value:.4g} against "
            f"{worst.expected:.4g} ± {worst.tolerance:.2g}"
        )
        return (
            f"{outcome.check.id} {verdict}. {outcome.check.title}: {figure} {worst.unit}".rstrip()
            + f" (tolerance: {outcome.check.why}; source: {outcome.check.source})"
        )
    return f"{outcome.check.id} {verdict}. {outcome.check.title}: {outcome.reason}"


LABELS = (("shown", "Shown automatically"), ("supply", "To be supplied by you"), ("missing", "Missing"))
NOTE = (
    "No score is given: how much evidence is enough follows from the model's risk (section 3), which only its user "
    "can judge."
)


def markdown(report: Report) -> str:
    """The report as a text to fill in."""
    counts = ", ".join(f"{n} {status}" for status, n in report.counts.items())
    lines = [
        "# Credibility report",
        "",
        f"sprain-cosim {report.environment.get('sprain-cosim', '')}, {report.created}. {report.size}: {counts}. {NOTE}",
        "",
    ]
    for section in sections(report):
        lines += [f"## {section.title}", "", section.intro, ""]
        for name, label in LABELS:
            entries = getattr(section, name)
            if entries:
                box = "[ ] " if name == "supply" else ""
                lines += [f"**{label}**", "", *(f"- {box}{entry}" for entry in entries), ""]
    return "\n".join(lines)
