"""What a set of results says, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from .. import figures as plots
from ..figures.braces import threshold_doubts
from ..figures.selection import Named, same_question
from ..folders.comparison import (
    INJURY,
    INVERSION,
    NONE,
    ComparisonFolder,
    ComparisonSummary,
    Decisions,
    MeanEstimate,
    PairLook,
    called,
)
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..folders.study import PEAK, StudyFolder
from ..literature import INJURY_INVERSION
from ..records import ends_of
from ..study.summary import (
    GIVEN_ROWS,
    FormSearch,
    Level,
    LevelSearch,
    LevelTest,
    Percentile,
    Probability,
    SobolSearch,
    Threshold,
    UntilRule,
)
from ..units import RARE, percentage, percentage_ends
from .blocks import Block, Paragraph, Verdict, rich
from .design import design_verdict
from .persons import persons_sentence
from .words import WithInterval, ends, interval, percent, rounded, signed, unit_after

MEAN, SD = INJURY_INVERSION
MOST_NAMED = 3  # inputs of a sentence
Change = tuple[
    float, str, WithInterval
]  # of the peak against no brace, name of the brace, the change with its interval
NOT_RANDOM = " No interval: these landings are no random sample."
EXCEEDS = f"Probability that inversion exceeds the injury range ({MEAN:g} ± {SD:g}° from neutral)"
LIMITED = Markup(
    'These are figures of a model, with its <a href="#limits">limits</a>; they rank braces, they do not certify one.'
)


def verdicts(folders: Sequence[Folder], items: Sequence[Named]) -> list[Block]:
    """One for each comparison and each result; landings of a comparison only where some failed."""
    comparisons = [folder for folder in folders if isinstance(folder, ComparisonFolder)]
    found = [_of_comparison(folder) for folder in comparisons]
    compared = {id(member) for folder in comparisons for member in folder.members.values()}
    for name, item in items:
        shown = name if len(items) > 1 else ""
        if isinstance(item, RunFolder):
            if id(item) not in compared:
                warned = bool(_said_of_run(item)) or item.summary.coupling_converged is False
                found.append(Verdict(_of_run(item), shown, warned))
        elif item.summary.n_failed or id(item) not in compared:
            told = _of_trials(item, shown, items)
            if id(item) not in compared and (said := _said_before(item)):
                told = replace(told, text=told.text + _warned(*said), warn=True)
            found.append(told)
    studies = [(name, item) for name, item in items if isinstance(item, StudyFolder)]
    notes, of_all = _shared([(name, _notes(study, id(study) in compared)) for name, study in studies])
    first = notes if compared else [*of_all, *notes]
    return [*(v for v in found if v is not None), *(Paragraph(n, "about") for n in first), Paragraph(LIMITED)]


def notes_of_comparisons(folders: Sequence[Folder], items: Sequence[Named]) -> list[Block]:
    """What all studies of the page have to say alike, where braces are compared: below the numbers, since the answer is
    the difference."""
    if not any(isinstance(folder, ComparisonFolder) for folder in folders):
        return []
    _, of_all = _shared([(name, _notes(study, True)) for name, study in items if isinstance(study, StudyFolder)])
    return [Paragraph(note, "about") for note in of_all]


def _shared(notes: Sequence[tuple[str, Sequence[str]]]) -> tuple[list[str], list[str]]:
    """Each note once: those of some studies, with their names, and those of all."""
    found: dict[str, list[str]] = {}
    for name, said in notes:
        for note in said:
            found.setdefault(note, []).append(name)
    of_some = [
        f"{', '.join(names)}: {note[:1].lower()}{note[1:]}" for note, names in found.items() if len(names) < len(notes)
    ]
    return of_some, [note for note, names in found.items() if len(names) == len(notes)]


def _of_trials(study: StudyFolder, name: str, items: Sequence[Named]) -> Verdict:
    if study.summary.design is not None:
        return design_verdict(study, study.summary.design, name)
    search = study.summary.search
    failed = study.summary.n_failed > 0
    if search is None:
        return Verdict(_of_study(study), name, failed)
    missed = _beside_sample(study, search, items)
    text = _of_search(study, search) + missed
    return Verdict(text, name, failed or search.status != "ok" or "outside" in missed)


def _beside_sample(study: StudyFolder, search: LevelSearch | FormSearch, items: Sequence[Named]) -> Markup:
    """Where the levels lie beside the first sample of the same landings among the `items`."""
    if not isinstance(search, LevelSearch):
        return Markup("")
    for name, other in items:
        if not isinstance(other, StudyFolder) or not other.is_sample or not same_question(other, study):
            continue
        found = other.summary.responses.get(study.response)
        levels = [] if found is None else [(k, v, found.percentiles.get(k)) for k, v in search.levels.items()]
        words = [_level_beside(level, value, p, unit_after(study.response)) for level, value, p in levels if p]
        if any(words):
            return rich(" Beside {name}: {words}.", name=name, words="; ".join(w for w in words if w))
    return Markup("")


def _level_beside(level: str, found: Level, sampled: Percentile, unit: str) -> str:
    """A level against the interval of the sampled percentile; nothing where there is none."""
    if found.value is None or sampled.value is None or sampled.ci_low is None or sampled.ci_high is None:
        return ""
    where = "inside" if sampled.ci_low <= found.value <= sampled.ci_high else "outside"
    ends = f"{rounded(sampled.ci_low)} … {rounded(sampled.ci_high)}{unit}"
    return f"the {level} % level lies {where} the 95 % interval of {ends}"


def _of_comparison(folder: ComparisonFolder) -> Verdict | None:
    """Which brace lowered the peak most, paired over the same landings."""
    rows = []
    for name, brace in folder.summary.braces.items():
        change = brace.difference_to_none.get(PEAK)
        if change is not None and change.value is not None:
            rows.append((change.value, name, change))
    headline, text = _best_first(folder, rows) if rows else (Markup(""), Markup(""))
    failed = "; ".join(f"{name}: {brace.message}" for name, brace in folder.summary.failed.items())
    if failed:
        text += rich(" <b>Failed:</b> {failed}.", failed=failed)
    said = [f"{called(name)}: {line}" for name in folder.summary.braces for line in _said_of(folder, name)]
    text += _warned(*said)
    return Verdict(text, warn=bool(failed or said), headline=headline) if text else None


def _said_of(folder: ComparisonFolder, name: str) -> list[str]:
    """The warnings about a brace."""
    member = folder.members.get(name)
    return _telling(folder.summary.braces[name].warnings, () if member is None else member.summary.dropped)


def _best_first(folder: ComparisonFolder, rows: Sequence[Change]) -> tuple[Markup, Markup]:
    """The answer in one line, which is read in ten seconds, and what else is known, by (change of the peak against no
    brace, name, the change with its interval)."""
    summary = folder.summary
    lowest = None if summary.decisions is None else summary.decisions.lowest(name for _, name, _ in rows)
    rows = sorted(rows, key=lambda row: (row[1] != lowest, row[0]))
    best = rows[0][1]
    text = _injuries(folder, best)
    if rows[1:]:
        others = [f"{n} {signed(v)}°{_within(e, False, ' (', ')')}" for v, n, e in rows[1:]]
        text += f" Peak of supination against no brace, the others: {', '.join(others)}."
    if summary.decisions is None:
        text += f" Every brace made the same {summary.count if summary.is_study else 'landing'}."
    if summary.has_intervals and summary.decisions is None and len(rows) > 2:
        text += f" Each interval holds by itself: the best of {len(rows)} was chosen by these same landings."
    alike = [] if summary.decisions is not None else _not_apart(folder, best, [name for _, name, _ in rows[1:]])
    if alike:
        text += rich(" These landings cannot tell {best} from {alike}.", best=best, alike=" and ".join(alike))
    text += _decided(summary.decisions) if summary.decisions is not None else Markup("")
    return _headline(summary, rows, lowest, alike), text + persons_sentence(summary.persons, best)


def _headline(summary: ComparisonSummary, rows: Sequence[Change], lowest: str | None, alike: Sequence[str]) -> Markup:
    """Which brace, by how much, how sure: against no brace, and against the next. A brace is called the best only where
    every other one is told apart from it; one landing tells nothing of the next, and says so."""
    value, best, change = rows[0]
    known = change.ci_low is None or change.ci_high is None or change.ci_low * change.ci_high > 0
    text = rich(
        "<b>{by}° {word}</b> than without a brace{sure}{doubt}",
        by=f"{abs(value):.1f}",
        word="less" if value < 0 else "more",
        sure=_within(change, value < 0, " (95 % sure: ", "°)"),
        doubt="" if known else rich(", <b>which is not told apart from none</b>"),
    )
    lead = rich("With <b>{best}</b> the ankle rolls ", best=best)
    ahead = {name: _ahead(summary, best, name) for _, name, _ in rows[1:]}
    if ahead:
        nearest = rows[1][1]
        if alike or (summary.decisions is not None and lowest is None):
            names = " and ".join(alike or ahead)
            gaps = "".join(_within(ahead[n], False, " (", "°)") for n in alike[:1])
            text += rich("; <b>not told apart from {names}</b>{gaps}", names=names, gaps=gaps)
        else:
            least = (
                "With <b>{best}</b> the ankle rolls least: "
                if value < 0
                else "No brace helps; with <b>{best}</b> it rolls "
            )
            lead = rich(least, best=best)
            e = ahead[nearest]
            text += rich(
                ", {gap}than with {nearest}, the next{sure}",
                gap="less " if e is None or e.value is None else f"{abs(e.value):.1f}° less ",
                nearest=nearest,
                sure=_within(e, True, " (", "°)"),
            )
    alone = "" if summary.has_intervals else " One landing: no interval." if not summary.is_study else NOT_RANDOM
    return lead + text + "." + alone


def _ahead(summary: ComparisonSummary, best: str, name: str) -> MeanEstimate | None:
    """The peak with `best` minus that with another brace, over the same landings."""
    e, flip = summary.pairs.get(f"{best} - {name}", {}).get(PEAK), 1.0
    if e is None:
        e, flip = summary.pairs.get(f"{name} - {best}", {}).get(PEAK), -1.0
    if e is None or e.value is None:
        return e
    if e.ci_low is None or e.ci_high is None:
        return replace(e, value=flip * e.value)
    low, high = sorted((flip * e.ci_low, flip * e.ci_high))
    return replace(e, value=flip * e.value, ci_low=low, ci_high=high)


def _within(e: WithInterval | None, negate: bool, before: str, after: str) -> str:
    """ "9.1 to 9.8", with as many digits as tell the ends apart; nothing where there is no interval."""
    if e is None or e.ci_low is None or e.ci_high is None:
        return ""
    low, high = sorted((-e.ci_low, -e.ci_high) if negate else (e.ci_low, e.ci_high))
    digits = 1 if high - low >= 0.15 else 2
    return f"{before}{low:.{digits}f} to {high:.{digits}f}{after}".replace("-", "−")


def _not_apart(folder: ComparisonFolder, best: str, others: Sequence[str]) -> list[str]:
    """The other braces of a study whose peak may as well be the lower one: 0 lies in the interval of the difference."""
    found = []
    for name in others if folder.summary.is_study else ():
        e = _ahead(folder.summary, best, name)
        if e is None or e.ci_low is None or e.ci_high is None or e.ci_low <= 0.0 <= e.ci_high:
            found.append(name)
    return found


def _decided(found: Decisions) -> Markup:
    """Which brace of each pair has the lower peak, and what it took to know."""
    text = Markup("")
    for pair, d in found.pairs.items():
        if d.lower is not None:
            text += rich(
                " <b>{lower}</b> keeps the peak lower than {higher}: decided after {n} paired landings{by}.",
                lower=d.lower,
                higher=d.higher,
                n=d.n,
                by="".join(f", by {size}°" for look in d.looks[-1:] for size in ends(*_size(look), 1)),
            )
        else:
            text += rich(
                " Which of {pair} is the lower stays undecided after {n} paired landings{by}.",
                pair=pair.replace(" - ", " and "),
                n=d.n,
                by="".join(f" (difference {e}°)" for k in d.looks[-1:] for e in ends(k.ci_low, k.ci_high)),
            )
    return text + f" {found.saved} of {found.landed + found.saved} landings were saved."


def _size(look: PairLook) -> tuple[float | None, float | None]:
    """The ends of a difference that excludes zero, without its sign."""
    if look.ci_low is None or look.ci_high is None:
        return None, None
    low, high = sorted((abs(look.ci_low), abs(look.ci_high)))
    return low, high


def _injuries(folder: ComparisonFolder, best: str) -> Markup:
    """The probability of injury without a brace and with the best one, with both of its doubts."""
    braces = folder.summary.braces
    without, with_best = (braces[n].metrics.get(INJURY) if n in braces else None for n in (NONE, best))
    if without is None or with_best is None or without.value is None or with_best.value is None:
        return Markup("")
    doubts = [f"as far as the landings know it {e} %" for e in percentage_ends(with_best.ci_low, with_best.ci_high)]
    thresholds = threshold_doubts(folder)
    doubts += [f"as far as the threshold is known {e} %" for e in percentage_ends(*thresholds.get(best, (None, None)))]
    beside = [f"{e} %" for e in percentage_ends(without.ci_low, without.ci_high)]
    beside += [f"{e} %" for e in percentage_ends(*thresholds.get(NONE, (None, None)))]
    return rich(
        "{exceeds}: <b>{best}</b>{doubts} instead of {without}{beside}.",
        exceeds=EXCEEDS,
        beside=f" ({'; '.join(beside)})" if beside else "",
        without=percent(without.value, interval=(without.ci_low, without.ci_high)),
        best=percent(with_best.value, interval=(with_best.ci_low, with_best.ci_high)),
        doubts=f" ({'; '.join(doubts)})" if doubts else "",
    )


def _of_run(run: RunFolder) -> Markup:
    m = {key: value for key, value in run.summary.metrics.items() if value is not None}
    if PEAK not in m:
        return rich("Ended as {status}. {message}", status=run.summary.status, message=run.summary.message)
    at = f" at {1e3 * m['time_of_peak_subtalar_s']:.0f} ms" if "time_of_peak_subtalar_s" in m else ""
    text = rich("In this landing the ankle supinated to <b>{peak:z.1f}°</b>{at}", peak=m[PEAK], at=at)
    text += _by_the_step(run.summary.coupling_doubt_deg)
    if INVERSION in m:
        where = "below" if m[INVERSION] < MEAN - SD else "above" if m[INVERSION] > MEAN + SD else "inside"
        text += (
            f" Inversion from neutral peaked at {m[INVERSION]:z.1f}°, {where} the range of {MEAN:g} ± {SD:g}° in "
            "which ankles of cadavers failed."
        )
    anatomy, brace = m.get("anatomy_subtalar_moment_Nm"), m.get("brace_subtalar_moment_Nm")
    if anatomy is not None and brace is not None and anatomy + brace:
        share = 100 * brace / (anatomy + brace)
        text += f" At the peak the brace bore {brace:z.1f} of {anatomy + brace:z.1f} N·m ({share:z.0f} %)."
    if run.summary.coupling_error is not None:
        text += f" Coupling error: {percentage(run.summary.coupling_error)} % of the energy exchanged."
    if run.summary.estimates_doubt_deg is not None:
        text += f" What is estimated of the body leaves ± {run.summary.estimates_doubt_deg:.2g}° open (one SD)."
    return text + _warned(*_said_of_run(run))


def _said_of_run(run: RunFolder) -> list[str]:
    """The warnings of a landing."""
    return [*_said_before(run), *([run.summary.warning] if run.summary.warning else [])]


def _said_before(item: RunFolder | StudyFolder) -> list[str]:
    """The warnings of scenario and device."""
    return _telling(item.summary.warnings or (), item.summary.dropped)


def _telling(warnings: Iterable[str], dropped: Sequence[str]) -> list[str]:
    """Without those of parameters that the device lacks, which stand among the inputs."""
    return [line for line in warnings if not (dropped and line.endswith("dropped"))]


def _warned(*lines: str) -> Markup:
    """What `run`, `study` and `compare` warned of."""
    return Markup("").join(
        rich(" <b>Warning:</b> {line}{end}", line=line, end="" if line.endswith(("?", ".")) else ".") for line in lines
    )


def _by_the_step(doubt: float | None) -> str:
    if doubt is None:
        return "; what the communication step leaves open of it is not known."
    return f" (± {doubt:.2g}° by the communication step)."


def _of_study(study: StudyFolder) -> Markup:
    summary = study.summary
    n, done, failed = summary.n_requested, summary.n_completed, summary.n_failed
    text = _distribution(study)
    if summary.sobol is not None:
        text += _of_indices(summary.sobol)
    own = [(key, q) for key, q in summary.questions.items() if q.source == "own"]
    for key, q in own:
        text += _answer(f"Probability that the {plots.label(q.response or key).partition(', +')[0]} lies {q.event}", q)
    question = summary.questions.get(INVERSION)
    if question is not None:
        text += _answer(EXCEEDS, question)
    if summary.until is not None:
        text += until_words(summary.until, summary.responses)
    if failed:
        kinds = ", ".join(f"{count} {status}" for status, count in summary.failures.items())
        text += rich(
            " <b>{failed} of {n} landings failed</b> ({kinds}); percentiles count only the others.",
            failed=failed,
            n=n,
            kinds=kinds,
        )
    else:
        text += " No landing failed." if done == n else f" {n - done} landings are missing."
    return text


def _of_indices(found: SobolSearch) -> Markup:
    """The inputs that explain most of the variance alone, with their intervals."""
    first = sorted(found.indices.items(), key=lambda kv: -(kv[1].first or 0.0))[:MOST_NAMED]
    words = [
        f"{plots.label(name).partition(',')[0]} {percent(v.first)}{_percents(v.first_low, v.first_high)}"
        for name, v in first
        if v.first is not None
    ]
    return rich(" Of its variance these explain most by themselves: <b>{words}</b>.", words=", ".join(words))


def _percents(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return ""
    return f" ({100 * low:.0f} … {100 * high:.0f} %)".replace("-", "−")


def _notes(study: StudyFolder, compared: bool) -> list[str]:
    """What a sample has to say of itself besides its answer, with responses by the names that readers know. Rows of a
    study that is `compared` were handed to it by the comparison, which says how it drew them."""
    summary, found = study.summary, list[str]()
    for note in summary.notes if summary.search is None and summary.design is None else ():
        if compared and note == GIVEN_ROWS:
            continue
        note = _as_read(note, summary.responses)
        found.append(f"{note[:1].upper()}{note[1:]}.")
    return found


def _as_read(text: str, responses: Iterable[str]) -> str:
    """A text that names responses as files do, with the names that readers know."""
    for response in sorted(responses, key=len, reverse=True):
        text = text.replace(response, plots.label(response).partition(", ")[0])
    return text


def until_words(rule: UntilRule, responses: Iterable[str] = ()) -> Markup:
    """What was to be known, whether it is, and what stopping saved; `responses` that it may name."""
    found = _as_read("; ".join(w.text(name) for name, w in rule.watched.items()), responses).replace(" ... ", " … ")
    looks = len([n for n in rule.planned if n <= rule.trials])
    if not rule.known:
        return rich(
            " What was to be known is <b>not known</b> after all {n} landings: {found}.", n=rule.trials, found=found
        )
    return rich(
        " It stopped when it knew enough, after {looks} looks: {found}. <b>{saved} of {most} landings saved.</b>",
        looks=looks,
        found=found,
        saved=rule.saved,
        most=rule.at_most,
    )


def _answer(event: str, q: Probability) -> Markup:
    """A probability with its doubts, apart, and the sentence on which of them dominates."""
    of = "its larger end " if q.probability is None else ""
    doubts = [f"{of}as far as {q.trials or 'the'} landings know it {e} %" for e in percentage_ends(q.ci_low, q.ci_high)]
    behind = f"the {q.specimens} specimens behind the threshold" if q.specimens else "the threshold's ends"
    doubts += [f"as far as {behind} know it {e} %" for e in percentage_ends(*(q.threshold_ci or (None, None)))]
    if q.shapes and not q.specimens:
        shapes = ends_of(q.shapes) or (None, None)
        doubts += [f"for thresholds of other shapes {e} %" for e in percentage_ends(*shapes)]
    return rich(
        " {event}: <b>{p}</b>{doubts}.{dominates}",
        event=event,
        p="not one number" if q.probability is None else percent(q.probability, interval=(q.ci_low, q.ci_high)),
        doubts=f" ({'; '.join(doubts)})" if doubts else "",
        dominates=_dominates(q),
    )


def _threshold_open(found: FormSearch) -> Markup:
    """What is not known of the threshold of a search, in a sentence of its own."""
    behind = f"the {found.specimens} specimens behind the threshold"
    low, high = found.threshold_ci or (None, None)
    doubts = [f"as far as {behind} know it {e} %" for e in percentage_ends(low, high, RARE)]
    if found.shapes and not found.specimens:
        least, most = ends_of(found.shapes) or (None, None)
        doubts += [f"for thresholds of other shapes {e} %" for e in percentage_ends(least, most, RARE)]
    return rich(" What is not known of the threshold: {doubts}.", doubts="; ".join(doubts)) if doubts else Markup("")


def _dominates(q: Probability | FormSearch) -> str:
    """Which doubt is the wider, and what would narrow it."""
    specimens = "more specimens would" if q.specimens else "narrower bounds would"
    if q.threshold_ci is None:
        specimens = "its law, and how many specimens stand behind it, would have to be known"
    words = {
        "threshold": f"The threshold is what is known least: more landings change nothing; {specimens}",
        "failures": "What failed is known least: more landings that fail as often narrow nothing",
        "sampling": "The sample is what is known least: more landings narrow it",
        "both": "Sample and threshold leave about as much open: more landings and more knowledge of it are needed",
    }
    return f" {words[q.dominates]}." if q.dominates is not None and q.dominates in words else ""


def _distribution(study: StudyFolder) -> Markup:
    """Where the response lies: median and nine in ten of a sample, the ends of anything else."""
    done, response = study.summary.n_completed, study.response
    found, unit = study.summary.responses.get(response), unit_after(response)
    values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
    if len(values) and not (found and study.is_sample):
        of_grid = study.summary.method == "grid"
        low, high = rounded(float(values.min())), rounded(float(values.max()))
        return rich(
            "{where} the {name} {lay}.",
            where="In one landing"
            if done == 1
            else f"At {done} points of a grid"
            if of_grid
            else f"In {done} simulated landings",
            name=_called(response),
            lay=rich("was <b>{low}{unit}</b>", low=low, unit=unit)
            if len(values) == 1
            else rich("lay between <b>{low} and {high}{unit}</b>", low=low, high=high, unit=unit),
        )
    if found is None:
        return Markup("")
    p5, p50, p95 = (found.percentiles.get(level, Percentile(None)) for level in ("5", "50", "95"))
    return rich(
        "In {done} simulated landings the {name} was <b>{p50}{unit}</b> in the median{about}, and between {p5} and "
        "{p95}{unit} in nine of ten.",
        done=done,
        name=_called(response),
        p50=rounded(p50.value),
        unit=unit,
        about=interval(p50, 1, unit),
        p5=rounded(p5.value),
        p95=rounded(p95.value),
    )


def _called(response: str) -> str:
    """A response inside a sentence."""
    return "peak of supination" if response == PEAK else plots.label(response).partition(",")[0]


def _of_search(study: StudyFolder, found: LevelSearch | FormSearch) -> Markup:
    unit, response = unit_after(study.response), plots.label(study.response).partition(", ")[0]
    cost = f"{found.evaluations_executed} landings"
    if isinstance(found, LevelSearch):
        text = rich(
            "With {cost} the method {method} puts the {response} at <b>{levels}</b>.",
            cost=cost,
            method=study.summary.method,
            response=response,
            levels=", ".join(f"{rounded(v.value)}{unit} ({level} %)" for level, v in found.levels.items()),
        )
    else:
        text = rich(
            "With {cost}: the probability that {response} exceeds {threshold} is <b>{p}</b>{beside}.",
            cost=cost,
            response=response,
            threshold=_threshold(found.threshold, unit),
            p=percent(found.probability, RARE, (found.ci_low, found.ci_high)),
            beside=_beside_estimate(found),
        )
    reasons = "; ".join(found.reasons)
    if isinstance(found, FormSearch) and found.ci_low is not None:
        return text + rich(
            "{doubts}{dominates} Sphere test and sampling say <b>{status}</b>{reasons}.",
            doubts=_threshold_open(found),
            dominates=_dominates(found),
            status=found.status,
            reasons=f": {reasons}" if reasons else "",
        )
    if isinstance(found, LevelSearch) and found.check is not None:
        return text + rich(
            " {n} random landings test it: {levels}. With that, slopes, curvature and the order of the "
            "levels the method's own test says <b>{status}</b>.",
            n=found.check.n,
            levels="; ".join(_tested(found.check, level) for level in found.check.off),
            status=found.status,
        )
    return text + rich(
        " The method's own test of slopes, curvature and the order of the levels says <b>{status}</b>{reasons}; it "
        "does not measure how far a level is off.",
        status=found.status,
        reasons=f": {reasons}" if reasons else "",
    )


def _beside_estimate(found: FormSearch) -> str:
    beta = "–" if found.beta is None else f"{found.beta:z.2f}"
    if found.ci_low is None:
        return f" (first order, β = {beta}: no interval)"
    ends = "".join(f"95 % interval {e} %" for e in percentage_ends(found.ci_low, found.ci_high, RARE))
    return f" ({ends}; first order alone {percent(found.first_order, RARE)}, β = {beta})"


def _tested(check: LevelTest, level: str) -> str:
    """A level with the share that really lies below it."""
    off, (low, high) = check.off[level], check.ci[level]
    if off is None or low is None or high is None:
        return f"the {level} % level unknown"
    return f"below the {level} % level lie {float(level) + off:.3g} % (off by {signed(low)} to {signed(high)} points)"


def _threshold(threshold: Threshold, unit: str) -> str:
    if threshold.distribution is not None:
        return f"the uncertain threshold {threshold.distribution}"
    return f"{rounded(threshold.mean)}{unit}"
