"""What was read of a motion, filled, turned and left aside: a page in Markdown, an object for JSON, a few lines for the
terminal; and the scenario file that comes of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ..errors import visible
from .offsets import PLANT_PLACES, measured_length
from .osim import AS_THEY_STAND, SEGMENTS, UNSCALED
from .speeds import coarse
from .start import MotionStart, StartValue

WHY = {
    "locked": "held fast in this plant at its own measured state (left leg, arms, toes of the landing foot)",
    "follows the knee": "the plant moves the patella with the knee",
    "unknown": "no coordinate of this plant",
}


def motion_warnings(start: MotionStart) -> list[str]:
    """What a reader must know before a landing, one line each."""
    found = [*(f"{start.table.path}: {note}" for note in start.table.notes), *start.contact.doubts]
    if start.filled:
        found.append(f"the file has no {', '.join(start.filled)}: filled with 0, at rest")
    if start.side == "left":
        found.append("a left-footed landing is mirrored: the plant's right leg is the person's left one")
    if start.model is not None:
        told = (note for note in start.model.notes if note.endswith((UNSCALED, AS_THEY_STAND, "1 is taken")))
        found += [f"{start.model.name}: {note}" for note in told]
    if start.drop == 0.0:
        found.append("the pelvis does not fall at this instant: is it before the landing?")
    unsure = [c for c, v in start.values.items() if v.tried and v.high - v.low > 0.5 * max(abs(v.speed), 0.5)]
    if unsure:
        found.append(f"the speeds of {', '.join(unsure)} depend on the smoothing by more than half of their value")
    if coarse(start.table.time, start.cutoff) and any(v.tried for v in start.values.values()):
        found.append(
            f"{start.table.rate:.3g} rows a second are too few for speeds that are smoothed with {start.cutoff:g} Hz: "
            "at an impact they may lie outside the ranges too"
        )
    strange = [label for label, why in start.course.unused.items() if why == "unknown"]
    if strange and len(strange) <= 6:
        found.append(f"not used, unknown to this plant: {', '.join(strange)}")
    return found


def motion_page(start: MotionStart, peaks: Mapping[str, float], scenario: str, picture: str) -> str:
    """The page; `scenario` and `picture` are names of files beside it, `peaks` those of doubt.peaks."""
    return visible("\n".join(_lines(start, peaks, scenario, picture))) + "\n"


def _lines(start: MotionStart, peaks: Mapping[str, float], scenario: str, picture: str) -> Iterator[str]:
    table = start.table
    yield f"# {table.path.name} at {start.contact.at:.6g} s, {start.side} foot"
    yield f"\nStart of a landing for `{scenario}` (on top of `{start.base}`). Pose against that without a motion:\n"
    yield f"![pose at contact]({picture})\n"
    yield "## What was read\n"
    rate = f", {table.rate:.4g} rows a second" if table.rate else ""
    yield f"- file: {len(table.time)} rows from {table.time[0]:.6g} to {table.time[-1]:.6g} s{rate}; {_angles(start)}"
    yield f"- instant: {start.contact.at:.6g} s, {start.contact.how}"
    yield f"- pose: {_pose(start)}"
    yield f"- fall: {_fall(start)}"
    for line in start.course.turned:
        yield f"- {line}"
    for line in motion_warnings(start):
        yield f"- **{line}**"
    yield "\n## Coordinates at contact\n"
    yield "| coordinate | column | value | without a motion | speed | by other smoothings | without a motion |"
    yield "|---|---|---|---|---|---|---|"
    for value in start.values.values():
        yield _row(value)
    yield f"\n{_smoothing(start)}"
    yield from _doubts(peaks)
    yield from _unused(start)
    yield from _person(start)
    yield "\n## What a file of coordinates cannot say\n"
    yield "- where its model has the pelvis' frame and its neutral joints: they are taken as those of this plant"
    yield "- the muscles: they begin as in every landing of this plant (activations 0.05, fibres in equilibrium)"
    yield "- the left leg, the arms and the toes: they are held fast, also where the file moves them"


def _angles(start: MotionStart) -> str:
    if start.table.in_degrees is None:
        return "unit of the angles as --angles says"
    return f"angles in {'degrees' if start.table.in_degrees else 'radians'} by its header"


def _pose(start: MotionStart) -> str:
    if start.pose == "given":
        return f"given: all heights as in the file, the sole {1e3 * start.clearance:z.1f} mm above the platform"
    return f"touching: the pelvis is moved by {-1e3 * start.clearance:+z.1f} mm until the sole touches the platform"


def _fall(start: MotionStart) -> str:
    speed = start.values["pelvis_ty"].speed
    if speed >= 0:
        return f"the pelvis moves up with {speed:.3g} m/s"
    return f"{-speed:.3g} m/s, as after {start.drop:.3g} m from rest; the scenario's drop height does not count"


def _row(v: StartValue) -> str:
    unit = "m" if v.unit == "m" else "deg"
    label = f"`{v.label}`".replace("|", "\\|") if v.label else "none: filled"
    if v.tried is not None:
        span = f"{_of(v, v.low):.4g} … {_of(v, v.high):.4g}"
    else:
        span = "column of the file" if v.by_column else "filled"
    cells = (
        v.coordinate,
        label,
        f"{_of(v, v.value):z.4f} {unit}",
        f"{_of(v, v.own[0]):z.4f}",
        f"{_of(v, v.speed):.4g} {unit}/s",
        span,
        f"{_of(v, v.own[1]):.4g}",
    )
    return f"| {' | '.join(cells)} |"


def _of(value: StartValue, number: float) -> float:
    """In degrees or metres."""
    return number if value.unit == "m" else math.degrees(number)


def _smoothing(start: MotionStart) -> str:
    tried = next((v.tried for v in start.values.values() if v.tried), None)
    if tried is None:
        return "Values and speeds are those of the file's columns."
    rows = "the rows up to the instant" if tried.one_sided else "all rows (too few before the instant)"
    return (
        f"Values are those of the file; speeds are the slopes of a quintic smoothing spline of {start.cutoff:g} Hz "
        f"through {rows}. Other smoothings: {'; '.join(tried.tried)} (the last a cubic spline through all rows)."
    )


def _doubts(peaks: Mapping[str, float]) -> Iterator[str]:
    if "" not in peaks:
        return
    yield "\n## What that is worth\n"
    yield "| taken otherwise | peak subtalar angle | change |"
    yield "|---|---|---|"
    yield f"| as written | {peaks['']:z.2f} deg | |"
    for name, peak in peaks.items():
        if name:
            yield f"| {name} | {peak:z.2f} deg | {peak - peaks['']:+z.2f} |"


def _unused(start: MotionStart) -> Iterator[str]:
    if start.course.unused:
        yield "\n## Columns that are not used\n"
    for why, text in WHY.items():
        labels = [label for label, reason in start.course.unused.items() if reason == why]
        if labels:
            yield f"- {text}: {', '.join(labels[:40])}{' ...' if len(labels) > 40 else ''}"


def _person(start: MotionStart) -> Iterator[str]:
    yield "\n## The person\n"
    model = start.model
    if model is None:
        yield "The person of the base scenario: no model was named (`--model FILE.osim`). Angles are kept, lengths not."
        return
    yield f"`{model.name}`: {model.mass:.4g} kg; the shares of the bodies are those of the plant.\n"
    for segment in SEGMENTS:
        x, y, z = model.factors.get(segment, (1.0, 1.0, 1.0))
        line = f"- {segment}: {x:.4g} × {y:.4g} × {z:.4g}"
        if segment in model.lengths:
            plant = measured_length(segment, PLANT_PLACES[segment])
            own = " × ".join(f"{f:.4g}" for f in model.stated.get(segment, (1.0, 1.0, 1.0)))
            line += (
                f"; its joints are {model.lengths[segment]:.4f} m apart, the plant's {plant:.4f} m (in the file: {own})"
            )
        yield line
    yield "- factors are against this plant; those in the file are against the model that was scaled. The distance of a"
    yield "  segment's joints says how long it is, the file's factors how its axes differ"
    for note in model.notes:
        yield f"- {note}"
    if model.others:
        yield f"- bodies that the plant has not: {', '.join(model.others)}"


def motion_json(start: MotionStart, peaks: Mapping[str, float]) -> dict[str, Any]:
    """Values in rad, m, s."""
    return {
        "file": str(start.table.path),
        "at_s": start.contact.at,
        "how": start.contact.how,
        "side": start.side,
        "initial_pose": start.pose,
        "base": start.base,
        "clearance_m": start.clearance,
        "drop_m": start.drop,
        "turned": list(start.course.turned),
        "filled": list(start.filled),
        "unused": dict(start.course.unused),
        "coordinates": {
            c: {
                "column": v.label or None,
                "unit": v.unit,
                "value": v.value,
                "speed": v.speed,
                "speed_low": v.low,
                "speed_high": v.high,
                "speed_from": "column" if v.by_column else "spline" if v.tried else "filled",
            }
            for c, v in start.values.items()
        },
        "peak_subtalar_angle_deg": dict(peaks),
        "warnings": motion_warnings(start),
    }


def motion_listing(start: MotionStart, peaks: Mapping[str, float]) -> str:
    """For the terminal."""
    lines = [f"{start.table.path.name} at {start.contact.at:.6g} s, {start.side} foot ({start.contact.how})"]
    lines += [f"pose {_pose(start)}", f"fall {_fall(start)}", *start.course.turned]
    lines.append(f"\n{'':20}{'value':>10}{'speed':>12}  by other smoothings")
    for v in start.values.values():
        unit = "m" if v.unit == "m" else "deg"
        span = f"{_of(v, v.low):.4g} ... {_of(v, v.high):.4g}" if v.tried else "column" if v.by_column else "filled"
        lines.append(f"{v.coordinate:20}{_of(v, v.value):z10.3f}{_of(v, v.speed):12.4g}  {span} {unit}/s")
    others = [peak for name, peak in peaks.items() if name]
    if "" in peaks and others:
        low, high = min(others), max(others)
        lines.append(
            f"\npeak subtalar angle {peaks['']:z.2f} deg; {low:z.2f} ... {high:z.2f} deg with other smoothings and rows"
        )
    return "\n".join(lines)


def motion_scenario(start: MotionStart, page: str) -> str:
    """The scenario file."""
    head = (
        f"# {start.table.path.name} at {start.contact.at:.6g} s, {start.side} foot: what was read, filled and turned "
        f"stands in {page}"
    )
    lines = [visible(head), f"base = {_quoted(start.base)}", f"title = {_quoted(start.title)}", "\n[parameters]"]
    lines += [f'"{n}" = {v!r}' if isinstance(v, float) else f'"{n}" = "{v}"' for n, v in start.settings().items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + visible(text).replace("\\", "\\\\").replace('"', '\\"') + '"'
