"""A person as people write one: "female, 1.63 m, 62 kg, foot length 24 cm" on the command line, [subject] in a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from .. import keys
from ..errors import InputError, nearest
from ..units import Unit, quantity, split, unit
from .anthropometry import LIKELY, MASS, MEASURES, SEXES, STATURE, YOUNGEST, anthropometry, meaning_of_measure
from .person import ELDEST, FORCE_RULES, PASSIVE_RULES, SCALE_TOOL, SEGMENTS, Subject

SPELLED = {"woman": "female", "f": "female", "w": "female", "man": "male", "m": "male"} | dict(
    zip(SEXES, SEXES, strict=True)
)
YEARS = re.compile(r"(\d+(?:\.\d+)?)\s*(?:years?|yrs?|y|a)(?:\s+old)?", re.IGNORECASE)
AGE = re.compile(r"aged?\s*[=:]?\s*([-+]?\d+(?:\.\d+)?)\s*(?:years?|yrs?|y|a)?(?:\s+old)?", re.IGNORECASE)
FEET = re.compile(r"(\d+)\s*(?:ft|feet|foot|['′’])\s*(\d+(?:\.\d+)?)\s*(?:in|inch|inches|[\"″”]|'')?", re.IGNORECASE)
STONES = re.compile(r"(\d+(?:\.\d+)?)\s*(?:st|stones?)(?:\s*(\d+(?:\.\d+)?)\s*(?:lbs?|pounds?)?)?", re.IGNORECASE)
WORD = re.compile(r"([-+]?[\d.]+)\s*([a-z]+)", re.IGNORECASE)
UNITS = {unit: unit for unit in ("m", "cm", "mm", "kg", "ft", "in", "lb")} | {  # as people write them, in small letters
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("feet", "foot"), "ft"),
    **dict.fromkeys(("inch", "inches"), "in"),
    **dict.fromkeys(("kgs", "kilo", "kilos", "kilogram", "kilograms"), "kg"),
    **dict.fromkeys(("lbs", "pound", "pounds"), "lb"),
}
NAMED = re.compile(r"([A-Za-z][A-Za-z_ ]*?)\s*[=:]?\s*([-+]?[\d.].*)")
RULE = re.compile(r"(force|passive)\s*[=:]?\s*([a-z-]+)", re.IGNORECASE)
OTHER_COMMA = re.compile("[;；，、]")
DECIMAL_COMMA = re.compile(r"\d,\d")
EXAMPLE = '"female, 1.63 m, 62 kg"'
LENGTH, WEIGHT = unit("m"), unit("kg")
SCALE = "_scale"
ALSO = {"height": STATURE, "weight": MASS}


def _scales(value: Any, place: str) -> tuple[float, float, float]:
    listed = value if isinstance(value, list) else [value] * 3
    if len(listed) != 3 or not all(keys.is_number(f) for f in listed):
        raise InputError(f"{place} = {value!r}: must be a factor, or three of them (x forward, y up, z to the right)")
    x, y, z = (float(f) for f in listed)
    return x, y, z


FACTORS = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 3, "maxItems": 3},
    ]
}
SUBJECT = keys.Table(
    (
        keys.Key(
            "sex", keys.choice(SEXES), "whose measures the estimates come from", needs='needs sex = "female" or "male"'
        ),
        *(
            keys.Key(
                name,
                keys.measured(WEIGHT if name == MASS else LENGTH, above_zero=True),
                meaning_of_measure(name),
                "estimated from the others",
            )
            for name in MEASURES
        ),
        keys.Key("age", keys.number(), "years; a growing body is refused"),
        keys.Key("force", keys.choice(tuple(FORCE_RULES)), "rule of the isometric forces", SCALE_TOOL),
        keys.Key("passive", keys.choice(tuple(PASSIVE_RULES)), "rule of the passive ankle's torque", SCALE_TOOL),
        *(
            keys.Key(
                f"{name}{SCALE}",
                keys.Value("number, or three", FACTORS, _scales),
                f"factors of the {name} in place of those of the measures",
                "from the measures",
            )
            for name in SEGMENTS
        ),
    ),
    others=ALSO,
)


def subject_of(content: Mapping[str, Any], place: str) -> Subject:
    """From the keys of SUBJECT, read. Raises InputError that begins with `place`."""
    return Subject(
        content["sex"],
        {name: content[name] for name in MEASURES if name in content},
        content.get("age"),
        content.get("force", SCALE_TOOL),
        content.get("passive", SCALE_TOOL),
        {name: content[f"{name}{SCALE}"] for name in SEGMENTS if f"{name}{SCALE}" in content},
    ).checked(place)


def parse_subject(text: str, place: str = "--subject") -> Subject:
    """A person in words: parts between commas are the sex, the stature (a length), the mass, an age in years, any other
    measure behind its name, and `force` or `passive` with the name of a rule. Raises InputError that begins with
    `place`."""
    if DECIMAL_COMMA.search(text):
        raise InputError(
            f"{place} {text!r}: has a decimal comma; write a point, and commas between the parts: {EXAMPLE}"
        )
    if OTHER_COMMA.search(text):
        raise InputError(f"{place} {text!r}: write commas (,) between the parts: {EXAMPLE}")
    if not text.strip(" ,"):
        raise InputError(f"{place} {text!r}: names nobody; write a person as {EXAMPLE}")
    found: dict[str, Any] = {}
    said: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, value = _part(part, f"{place} {text!r}")
        if name in found:
            raise InputError(f"{place} {text!r}: {name} is given twice, as {said[name]!r} and {part!r}")
        found[name], said[name] = value, part
    if "sex" not in found:
        raise InputError(f"{place} {text!r}: says no sex, on which the measures depend; write {EXAMPLE}")
    return subject_of(found, f"{place} {text!r}")


def _part(part: str, place: str) -> tuple[str, Any]:
    if (sex := SPELLED.get(part.lower().removeprefix("sex").strip(" =:"))) is not None:
        return "sex", sex
    if years := YEARS.fullmatch(part) or AGE.fullmatch(part):
        return "age", float(years[1])
    if rule := RULE.fullmatch(part):
        return rule[1].lower(), rule[2].lower()
    part = _metric(part, place)
    if (bare := split(part)) is not None:
        return _bare(part, *bare, place)
    if (named := NAMED.fullmatch(part)) is None:
        raise InputError(
            f"{place}: cannot read {part!r} as a sex or a quantity{nearest(part.lower(), SPELLED)}; write a person as "
            f"{EXAMPLE}"
        )
    if named[1].split()[0].lower() in SPELLED:
        raise InputError(f"{place}: cannot read {part!r}; write commas between the parts: {EXAMPLE}")
    name = re.sub(r"[\s_]+", "_", named[1].strip().lower())
    name = ALSO.get(name, name)
    if name.removesuffix(SCALE) in SEGMENTS and name.endswith(SCALE):
        return name, _scales(quantity(named[2], unit("1"), f"{place}: {name}"), f"{place}: {name}")
    if name not in MEASURES:
        raise InputError(f"{place}: unknown measure {name!r}{nearest(name, MEASURES)}; one of {', '.join(MEASURES)}")
    return name, _named(name, _metric(named[2], place), f"{place}: {name}")


def _named(name: str, text: str, place: str) -> float:
    """A measure behind its name, in its own unit."""
    kind, target = ("mass", WEIGHT) if name == MASS else ("length", LENGTH)
    if (parts := split(text)) is not None:
        number, own = parts
        usual = f'"{anthropometry(SEXES[0]).mean[name]:.3g} {target.name}"'
        example = next((f'"{number:g} {u}"' for what, u in _units_that_fit(number) if what == name), usual)
        if not own:
            raise InputError(f"{place} = {text}: needs a unit, for example {example}")
        try:
            fits = unit(own).same_dimension(target)
        except InputError as problem:
            raise InputError(f"{place} = {text!r}: {problem}; write {example}") from None
        if not fits:
            raise InputError(f"{place} = {text!r}: {own} is no unit of a {kind}; write {example}")
    return quantity(text, target, place)


def _units_that_fit(number: float) -> list[tuple[str, str]]:
    """(measure or "age", unit) of all that a number without a unit may be of an adult."""
    found = []
    for name in MEASURES:
        laws = [anthropometry(sex) for sex in SEXES]
        for symbol, factor in (("kg", 1.0),) if name == MASS else (("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
            if number > 0 and any(abs(law.score(name, factor * number)) < LIKELY for law in laws):
                found.append((name, symbol))
    return [*found, ("age", "years")] if YOUNGEST <= number <= ELDEST and number == int(number) else found


def _metric(text: str, place: str) -> str:
    """A length or a mass with a unit that is known, where people write it otherwise: 5 ft 4 in, 5'4", 137 lbs, 9 st."""
    for pattern, most, large, small in ((FEET, 12.0, "foot", "in"), (STONES, 14.0, "stone", "lb")):
        if found := pattern.fullmatch(text):
            rest = float(found[2] or 0.0)
            if rest >= most:
                raise InputError(f"{place}: {text!r}: {rest:g} {small} are more than a {large}; write {EXAMPLE}")
            return f"{most * float(found[1]) + rest!r} {small}"
    word = WORD.fullmatch(text)
    return f"{word[1]} {UNITS[word[2].lower()]}" if word and word[2].lower() in UNITS else text


def _bare(part: str, number: float, name_of_unit: str, place: str) -> tuple[str, float]:
    """A quantity without a name: the stature or the mass, by its dimension."""
    if not name_of_unit:
        units = dict.fromkeys(u for what, u in _units_that_fit(number) if what in (STATURE, MASS, "age"))
        meant = " or ".join(f'"{part} {u}"' for u in units) or '"1.63 m", "62 kg", "30 years"'
        raise InputError(f"{place}: {part!r} has no unit; write {meant}")
    try:
        own: Unit = unit(name_of_unit)
    except InputError as problem:
        if any(c.isdigit() for c in name_of_unit):
            raise InputError(
                f"{place}: cannot read {part!r}; write one number with its unit between commas: {EXAMPLE}"
            ) from None
        raise InputError(f"{place}: {part!r}: {problem}; write a person as {EXAMPLE}") from None
    for name, target in ((STATURE, LENGTH), (MASS, WEIGHT)):
        if own.same_dimension(target):
            return name, quantity(part, target, f"{place}: {name}")
    raise InputError(f'{place}: {part!r} is neither a length nor a mass; write "1.63 m", "62 kg", "30 years"')
