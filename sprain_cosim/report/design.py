"""A design question on the page: the answer in sentences, then its numbers."""

from __future__ import annotations

from collections.abc import Mapping

from markupsafe import Markup

from .. import figures as plots
from ..folders.study import StudyFolder
from ..records import ends_of
from ..study.summary import Comfort, DesignPoint, DesignSearch, in_figures
from ..units import percentage_ends
from .blocks import Block, Cell, PageTable, Paragraph, Row, Verdict, rich
from .words import UNKNOWN, percent, rounded

ABOUT = (
    "Small: 95 % intervals. “95 % sure” is as far as landings go: it says nothing of the threshold, whose doubt stands "
    "beside it. Resistance: the device alone, held at 5 and 10° of ordinary motion; the lower, the more comfortable."
)
PLACES = {"value": "at the value", "value_95": "at the value that is 95 % sure", "low": "low end", "high": "high end"}


def design_verdict(study: StudyFolder, found: DesignSearch, name: str) -> Verdict:
    """What a manager takes along: which value, how sure, what it costs."""
    text = rich("The question to {landings} landings: {goal}. ", landings=found.landings, goal=_goal(found))
    if len(found.points) == 1:
        (point,) = found.points
        text += _answer(found, point)
    else:
        text += _answers(found)
    notes = "".join(f" {note[:1].upper()}{note[1:]}." for note in study.summary.notes)
    return Verdict(text + notes, name, not found.met or found.failed > 0)


def _goal(found: DesignSearch) -> Markup:
    response, _, event = found.goal.partition("(")[2].rpartition(")")[0].partition(" ")
    return rich(
        "for which {parameter} is the probability of {response} {event} at most {most}",
        parameter=_named(found.parameter),
        response=plots.label(response).partition(", +")[0],
        event=event,
        most=percent(found.at_most),
    )


def _named(parameter: str) -> str:
    return plots.label(parameter)


def _unit(found: DesignSearch) -> str:
    return f" {found.unit}" if found.unit else ""


def _answer(found: DesignSearch, point: DesignPoint) -> Markup:
    p, unit, low_high = point.probability, _unit(found), found.range
    searched = f"{_figures(low_high[0])} … {_figures(low_high[1])}{unit}"
    if point.status == "nowhere":
        is_open = found.verdict(point) == "undecided"
        return rich(
            "<b>{what}</b> The best is {value}{unit}, with a probability of "
            "{p}{ends}. A wider range, another device or another goal would have to be taken{open}.",
            what=f"Whether any value from {searched} meets the goal is open."
            if is_open
            else f"No value from {searched} meets the goal.",
            open=", or more landings" if is_open else "",
            value=_figures(point.value),
            unit=unit,
            p=percent(p.value),
            ends="".join(f" ({e} %)" for e in _ends(p.sampling_ci)),
        )
    if point.status == "everywhere":
        text = rich("<b>By the best estimate every value from {searched} meets the goal.</b>", searched=searched)
    else:
        text = rich(
            "<b>The {find} is {value}{unit}</b>{ends}.",
            find=found.find,
            value=_figures(point.value),
            unit=unit,
            ends=_value_ends(point, unit),
        )
    if point.value_95 is None:
        text += " No value in the range holds with 95 % confidence: whether the goal is met is open."
    else:
        word = "at least" if found.find == "least" else "at most"
        text += rich(
            " To be 95 % sure, as far as landings go, take {word} <b>{sure}{unit}</b>.",
            word=word,
            sure=_on_the_safe_side(found, point.value_95),
            unit=unit,
        )
    return text + _threshold(found, point) + _comfort(point)


def _ends(interval: tuple[float | None, float | None] | None) -> tuple[str, ...]:
    return percentage_ends(*(interval or (None, None)))


def _figures(value: float | None) -> str:
    """A value of the parameter, with as many figures as in all other places."""
    return UNKNOWN if value is None else in_figures(value).replace("-", "−")


def _on_the_safe_side(found: DesignSearch, value: float | None) -> str:
    return "none in the range" if value is None else _figures(found.on_the_safe_side(value))


def _held_at(found: DesignSearch, held: Comfort) -> str:
    return _on_the_safe_side(found, held.value) if held.at == "value_95" else _figures(held.value)


def _value_ends(point: DesignPoint, unit: str) -> str:
    if point.ci_low is None and point.ci_high is None:
        return ""
    low = "below the range" if point.ci_low is None else _figures(point.ci_low)
    high = "above the range" if point.ci_high is None else f"{_figures(point.ci_high)}{unit}"
    return f" (95 % interval {low} … {high})"


def _threshold(found: DesignSearch, point: DesignPoint) -> Markup:
    """What the threshold leaves open, in words of its own."""
    p = point.probability
    behind = f"the {p.specimens} specimens behind the threshold" if p.specimens else "the ends of the threshold"
    known = [f"as far as {behind} know it, it may be {e} %" for e in _ends(p.threshold_ci)]
    if p.shapes and not p.specimens:
        ends = _ends(ends_of(p.shapes))
        known = [f"with a threshold of another shape it would be {e} %" for e in ends]
    if not known:
        return Markup("")
    sampled = "".join(f" ({e} % by landings)" for e in _ends(p.sampling_ci))
    least = " The threshold is what is known least: more landings change nothing." if p.dominates == "threshold" else ""
    at = f"{_figures(point.value)}{_unit(found)}"
    value = (
        ""
        if p.value is None
        else f"At {at} the probability is {percent(p.value, interval=p.sampling_ci or (None, None))}{sampled}; "
    )
    words = known[0] if value else f"{known[0][:1].upper()}{known[0][1:]}"
    return rich(" {value}{words}.{least}", value=value, words=words, least=least)


def _comfort(point: DesignPoint) -> str:
    held = next((c for c in point.comfort if c.at == "value_95"), None)
    if held is None:
        return ""
    resisted, free = point.motions
    words = [f"with {rounded(held.resistance_Nm.get(f'{m}_10deg'))} N·m against 10° of {m}" for m in resisted]
    words += [f"not at all against {' and '.join(free)}"] if free else []
    return f" What it costs in comfort: the device then resists {', '.join(words)}."


def _answers(found: DesignSearch) -> Markup:
    rows = [p for p in found.points if p.status != "nowhere"]
    if not rows:
        is_open = any(found.verdict(p) == "undecided" for p in found.points)
        open_pair = "Whether any pair of values in the range meets the goal is open."
        return rich("<b>{said}</b>", said=open_pair if is_open else "No pair of values in the range meets the goal.")
    second, unit = _named(found.second or ""), f" {found.second_unit}" if found.second_unit else ""
    words = [f"{_figures(p.value)}{_unit(found)} at {rounded(p.second)}{unit}" for p in rows]
    text = rich("The {find} is <b>{words}</b> of {second}.", find=found.find, words=", ".join(words), second=second)
    at = {
        verdict: ", ".join(f"{rounded(p.second)}{unit}" for p in found.points if found.verdict(p) == verdict)
        for verdict in ("not met", "undecided")
    }
    text += f" No value in the range meets the goal at {at['not met']}." if at["not met"] else ""
    return text + (f" Whether one does is open at {at['undecided']}." if at["undecided"] else "")


def design_blocks(found: DesignSearch) -> list[Block]:
    """The numbers of one question."""
    if len(found.points) == 1:
        table = PageTable(["", ""], _rows(found, found.points[0]))
    else:
        heads = [_named(found.second or ""), f"{found.find} {_named(found.parameter)}", "95 % sure", "probability"]
        table = PageTable(heads, _trade_off(found))
    return [table, Paragraph(ABOUT, "about")]


def _rows(found: DesignSearch, point: DesignPoint) -> list[Row]:
    unit, p = _unit(found), point.probability
    status = {"nowhere": "none in the range", "everywhere": "all of the range"}.get(point.status, "")
    low, high = (None if e is None else _figures(e) for e in (point.ci_low, point.ci_high))
    notes = (f"{low or 'below the range'} … {high or 'above the range'}",) if point.status == "met" else ()
    doubts = [f"landings {e}" for e in _ends(p.sampling_ci)]
    behind = f"threshold, n = {p.specimens}:" if p.specimens else "threshold's ends"
    doubts += [f"{behind} {e}" for e in _ends(p.threshold_ci)]
    if p.shapes:
        doubts += [f"threshold's shape {e}" for e in _ends(ends_of(p.shapes))]
    rows: list[Row] = [
        [f"{found.find} {_named(found.parameter)}", Cell(status or f"{_figures(point.value)}{unit}", notes)],
        ["95 % sure", f"{_on_the_safe_side(found, point.value_95)}{unit if point.value_95 is not None else ''}"],
        [
            f"probability at {_figures(point.value)}{unit}",
            Cell(percent(p.value, interval=p.sampling_ci or (None, None)), tuple(doubts)),
        ],
        ["goal", found.in_words(point)],
        ["landings", Cell(str(found.landings), (f"{point.fresh} of them fresh, at the value",))],
    ]
    for held in (c for c in point.comfort if c.at in PLACES):
        label = f"resists 5 / 10° {PLACES[held.at]}, {_held_at(found, held)}{unit} [N·m]"
        shown = [f"{m} {_pair(held.resistance_Nm, m)}" for m in point.motions[0]]
        rows.append([label, Cell("; ".join(shown) or "nothing")])
    return rows


def _trade_off(found: DesignSearch) -> list[Row]:
    unit = _unit(found)
    rows: list[Row] = []
    for p in found.points:
        met = p.status != "nowhere"
        ends = (f"{_figures(p.ci_low)} … {_figures(p.ci_high)}",) if p.status == "met" else ()
        value = f"{_figures(p.value)}{unit}" if met else "none in the range"
        sure = f"{_on_the_safe_side(found, p.value_95)}{unit if p.value_95 is not None else ''}"
        doubt = _ends(p.probability.sampling_ci)
        rows.append([rounded(p.second), Cell(value, ends), sure, Cell(percent(p.probability.value), doubt)])
    return rows


def _pair(held: Mapping[str, float | None], motion: str) -> str:
    return " / ".join(rounded(held.get(f"{motion}_{d}deg")) for d in (5, 10))
