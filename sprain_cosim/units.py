"""Units: names to base-unit exponents, "30 deg" to radians, and back.

A unit is a factor, an offset and the exponents of FMI's eight base units: value in base units = factor * value +
offset. Dimensions are equal when the exponents are equal, whatever the names; the radian is a base unit of its own, as
in FMI."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass, replace
from functools import lru_cache
from numbers import Integral, Real

from .errors import InputError, nearest

SHOWN = {"rad": "deg", "rad/s": "deg/s"}  # units that people read in another
FINEST, SURE = 0.01, 0.5  # percent, of a probability
RARE = 0.0  # in place of FINEST, for what a search found
BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """`factor` and `offset` lead to base units; `exponents` (8,) follow BASE."""

    name: str
    exponents: tuple[int, ...] = (0,) * 8
    factor: float = 1.0
    offset: float = 0.0

    @property
    def dimensionless(self) -> bool:
        return not any(self.exponents)

    def equivalent(self, other: Unit) -> bool:
        """Whether it is the same under another name."""
        return (self.exponents, self.factor, self.offset) == (other.exponents, other.factor, other.offset)

    def same_dimension(self, other: Unit) -> bool:
        return self.exponents == other.exponents

    def to_base(self, value: float) -> float:
        return self.factor * value + self.offset

    def from_base(self, value: float) -> float:
        return (value - self.offset) / self.factor

    def dimension(self) -> str:
        """The exponents as a product of base units, such as kg.m2/s2."""
        over = [f"{b}{e if e > 1 else ''}" for b, e in zip(BASE, self.exponents, strict=True) if e > 0]
        under = [f"{b}{-e if e < -1 else ''}" for b, e in zip(BASE, self.exponents, strict=True) if e < 0]
        text = ".".join(over) or "1"
        if under:
            text += "/" + (under[0] if len(under) == 1 else f"({'.'.join(under)})")
        return text


def _symbol(factor: float, offset: float = 0.0, **exponents: int) -> tuple[float, float, tuple[int, ...]]:
    return factor, offset, tuple(exponents.get(base, 0) for base in BASE)


_G0, _LB, _IN, _FT = 9.80665, 0.45359237, 0.0254, 0.3048
SYMBOLS = {
    "1": _symbol(1.0),
    "%": _symbol(0.01),
    "kg": _symbol(1.0, kg=1),
    "g": _symbol(1e-3, kg=1),
    "lb": _symbol(_LB, kg=1),
    "m": _symbol(1.0, m=1),
    "in": _symbol(_IN, m=1),
    "inch": _symbol(_IN, m=1),
    "ft": _symbol(_FT, m=1),
    "s": _symbol(1.0, s=1),
    "min": _symbol(60.0, s=1),
    "h": _symbol(3600.0, s=1),
    "Hz": _symbol(1.0, s=-1),
    "rad": _symbol(1.0, rad=1),
    "rpm": _symbol(2 * math.pi / 60, rad=1, s=-1),
    "deg": _symbol(math.pi / 180, rad=1),
    "°": _symbol(math.pi / 180, rad=1),
    "rev": _symbol(2 * math.pi, rad=1),
    "N": _symbol(1.0, kg=1, m=1, s=-2),
    "kgf": _symbol(_G0, kg=1, m=1, s=-2),
    "lbf": _symbol(_LB * _G0, kg=1, m=1, s=-2),
    "ozf": _symbol(_LB * _G0 / 16, kg=1, m=1, s=-2),
    "Nm": _symbol(1.0, kg=1, m=2, s=-2),
    "Nmm": _symbol(1e-3, kg=1, m=2, s=-2),
    "Ncm": _symbol(1e-2, kg=1, m=2, s=-2),
    "Pa": _symbol(1.0, kg=1, m=-1, s=-2),
    "bar": _symbol(1e5, kg=1, m=-1, s=-2),
    "J": _symbol(1.0, kg=1, m=2, s=-2),
    "W": _symbol(1.0, kg=1, m=2, s=-3),
    "A": _symbol(1.0, A=1),
    "V": _symbol(1.0, kg=1, m=2, s=-3, A=-1),
    "K": _symbol(1.0, K=1),
    "degC": _symbol(1.0, 273.15, K=1),
    "mol": _symbol(1.0, mol=1),
    "cd": _symbol(1.0, cd=1),
}
SPELLINGS = {  # of the same symbol
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "meter": "m",
    "metre": "m",
    "newton": "N",
}
SIGNS = str.maketrans(  # characters that look alike or mean the same
    {"⋅": ".", "·": ".", "∙": ".", "•": ".", "×": ".", "º": "°", "˚": "°", "μ": "µ", "⁄": "/", "∕": "/", "−": "-"}
    | dict(zip("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789", strict=True))
)
HYPHEN = re.compile(r"(?<=[^\W\d_])-(?=[^\W\d_])")  # between letters, a product: N-m, in-lbf
PREFIXES = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3, "M": 1e6, "G": 1e9}
PREFIXED = {"g", "m", "s", "Hz", "rad", "N", "Nm", "Pa", "J", "W", "A", "V", "K", "mol", "bar"}
PREFIXES_OF_ANGLES = "muµn"  # a krad is 57296 deg, or an old dose of radiation
SMALL = {"g", "m", "s", "rad", "K", "mol"}  # of which nobody means a million: Mm is mm in capitals, Grad a degree
GRADS = "write deg for degrees of angle; a gradian (400 to a turn) is 0.9 deg"

_FACTOR = re.compile(r"1|([^\d^.*/()\s-]+)(?:\^?(-?[1-9]))?")


@lru_cache(maxsize=512)
def unit(name: str) -> Unit:
    """The unit of a name such as N.m/rad, kg.m^2, deg/s, MPa/m or lbf.in, in the spellings that people use: N⋅m, N-m,
    m/s², rad⁻¹, degrees. Raises InputError."""
    over, slash, under = HYPHEN.sub(".", name.translate(SIGNS)).strip().partition("/")
    under = under.strip()
    together = under.startswith("(") and under.endswith(")")
    if together:
        under = under[1:-1]
    elif slash and len(below := re.split(r"[.*·\s]+", under)) > 1:
        above, rest = ("" if over.strip() == "1" else f"{over.strip()}."), ".".join(below[1:])
        readings = f"{above}{rest}/{below[0]} or {over.strip()}/({'.'.join(below)})"
        raise InputError(f"unit {name!r}: what stands below its slash has two readings; write {readings}")
    parts = [(part, 1) for part in re.split(r"[.*·\s]+", over.strip())]
    parts += [(part, -1) for part in re.split(r"[.*·\s]+", under)] if slash else []
    factor, exponents, offset = 1.0, [0] * 8, 0.0
    for part, sign in parts:
        match = _FACTOR.fullmatch(part)
        if not match:
            raise InputError(f"unit {name!r}: cannot read {part!r}; write units as N.m/rad, m/s2 or deg")
        scale, shift, dims = _lookup(match[1] or "1", name)
        power = sign * int(match[2] or 1)
        if sign < 0 < power:
            plain = f"{match[1]}{power if power > 1 else ''}"
            raise InputError(f"unit {name!r}: {part} below a slash has two readings; write /{plain} or .{part}")
        factor *= scale**power
        exponents = [e + power * d for e, d in zip(exponents, dims, strict=True)]
        offset = offset or shift
    if not 0.0 < factor < math.inf:
        raise InputError(f"unit {name!r}: its factor to base units is {factor:g}")
    if offset and len(parts) > 1:
        raise InputError(f"unit {name!r}: degC cannot be part of a product; use K")
    return Unit(name.strip(), tuple(exponents), factor, offset)


def _lookup(symbol: str, name: str) -> tuple[float, float, tuple[int, ...]]:
    symbol = SPELLINGS.get(symbol.lower(), symbol)
    if symbol in SYMBOLS:
        return SYMBOLS[symbol]
    prefix, rest = symbol[0], symbol[1:]
    if symbol.lower() in ("grad", "grads", "gon", "gradian", "gradians"):
        raise InputError(f"unit {name!r}: {symbol} has two meanings; {GRADS}")
    if prefix in "MG" and rest in SMALL:
        raise InputError(f"unit {name!r}: {symbol} would be {PREFIXES[prefix]:g} {rest}; write m{rest} or {rest}")
    if rest == "rad" and prefix not in PREFIXES_OF_ANGLES and prefix in PREFIXES:
        raise InputError(f"unit {name!r}: {symbol} is no measure of an angle here; write mrad, rad or deg")
    if prefix in PREFIXES and rest in PREFIXED:
        factor, offset, dims = SYMBOLS[rest]
        return PREFIXES[prefix] * factor, offset, dims
    raise InputError(f"unit {name!r}: unknown symbol {symbol!r}{nearest(symbol, SYMBOLS)}")


_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")


def shown_unit(own: Unit | str | None) -> tuple[float, str]:
    """The unit in which people read numbers of `own` (one, or its name), and the factor that leads to it; no name for a
    pure number. A name that an FMU alone defines stays as it is."""
    if isinstance(own, str):
        try:
            own = unit(own) if own else None
        except InputError:
            return 1.0, str(own)
    if own is None or own.dimensionless:
        return 1.0, ""
    shown = SHOWN.get(own.name)
    return (1.0, own.name) if shown is None else (own.factor / unit(shown).factor, shown)


def split(text: str) -> tuple[float, str] | None:
    """ "0.30 m" to (0.30, "m"); the unit is empty where there is none; None when it does not begin with a number."""
    match = _QUANTITY.fullmatch(text)
    return (float(match[1]), match[2] or "") if match else None


def quantity(value: float | str, target: Unit | None, what: str, proposed: str = "", difference: bool = False) -> float:
    """A number or "number unit" in the unit `target` (None: not declared, so SI is assumed). `what` begins the
    messages, which propose the unit `proposed` to a number without one; empty: what people usually write. A
    `difference`, such as a standard deviation, has no zero: 5 degC are 5 K of it.

    Raises InputError when the unit is missing, unknown or of another dimension, or the number is not finite."""
    dimensionless = target is None or target.dimensionless
    if isinstance(value, bool) or not isinstance(value, Real | str):
        raise InputError(f"{what} = {value!r}: expected a number, such as {_example(target)}")
    if isinstance(value, str):
        parts = split(value)
        if parts is None:
            raise InputError(
                f"{what} = {value!r}: expected {'a number' if dimensionless else 'a number and a unit'}, such as "
                f"{_example(target)}"
            )
        number, name = parts
    else:
        number, name = float(value) if abs(value) <= sys.float_info.max else math.inf, ""
    if not math.isfinite(number):
        raise InputError(f"{what} = {value!r}: must be finite")
    if not name:
        if not dimensionless:
            raise InputError(f"{what} = {value}: needs a unit, for example {_example(target, number, proposed)}")
        name = "1"
    try:
        own = target if target is not None and target.name == name else unit(name)  # an FMU's own is what it says
    except InputError as problem:
        raise InputError(f"{what} = {value!r}: {problem}") from None
    if difference:
        own, target = replace(own, offset=0.0), None if target is None else replace(target, offset=0.0)
    if target is None:
        return own.to_base(number)
    if not own.same_dimension(target):
        raise InputError(
            f"{what} = {value!r}: {name} has the dimension {own.dimension()}, expected {target.dimension()}, for "
            f"example {_example(target, number)}"
        )
    if own.name == target.name:
        return number
    return target.from_base(own.to_base(number))


SECOND = unit("s")


def seconds(value: float | str, what: str) -> float:
    """[s]: a number is in seconds, a text such as "0.5 ms" has its unit. Raises InputError."""
    return quantity(stated(value, SECOND), SECOND, what)


def whole_number(value: int, what: str, least: int, most: int | None = None) -> int:
    """A whole number of Python or numpy. Raises InputError for anything else, below `least` and above `most`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{what} = {value!r}: must be a whole number, {least} or more")
    if most is not None and value > most:
        raise InputError(f"{what} = {value!r}: at most {most}")
    return int(value)


def proportion(value: float | str, what: str) -> float:
    """0.01 or "1 %". Raises InputError unless it lies between 0 and 1."""
    share = quantity(value.replace("%", " %") if isinstance(value, str) else value, unit("1"), what)
    if not 0.0 <= share <= 1.0:
        raise InputError(f"{what} = {value}: must lie between 0 % and 100 %")
    return share


def percentage(p: float, finest: float = FINEST, figures: int = 2) -> str:
    """A probability 0 ... 1 in percent, without the sign: two figures, none of them finer than `finest` percent. No
    random landings know more than a hundredth; a search for a RARE event does."""
    share = 100 * p
    if 0 < share < finest:
        return f"< {finest:g}"
    if 100 - SURE < share < 100:
        return f"> {100 - SURE:g}"
    return f"{share:.{figures - 2}f}" if share >= 10 or share == 0 else f"{share:.{figures}g}"


def percentage_ends(low: float | None, high: float | None, finest: float = FINEST) -> tuple[str, ...]:
    """The interval of a probability, "2.1 … 2.4", by the rule of `percentage`, with a third figure where two do not
    tell its ends apart; none where there is none. Whoever shows the interval takes it from here."""
    if low is None or high is None:
        return ()
    figures = _figures_of(low, high, finest)
    return (" … ".join(percentage(end, finest, figures) for end in (low, high)),)


def percentage_within(p: float, low: float | None, high: float | None, finest: float = FINEST) -> str:
    """A probability with as many figures as its interval, outside which it would lie otherwise."""
    return percentage(p, finest, 2 if low is None or high is None else _figures_of(low, high, finest))


def _figures_of(low: float, high: float, finest: float) -> int:
    return 3 if low < high and percentage(low, finest) == percentage(high, finest) else 2


def stated(value: float | str, own: Unit | None) -> float | str:
    """A number of a program, which is in the unit `own`, as a file has it: "0.35 m", or a plain number where there is
    no dimension. Anything else stays as it is."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return value
    return plain_number(value) if own is None or own.dimensionless else f"{float(value)!r} {own.name}"


def plain_number(value: float | str) -> float | str:
    """A number of numpy as one of Python, which files take; anything else as it is."""
    return float(value) if isinstance(value, Real) and type(value) not in (bool, int, float) else value


def _example(target: Unit | None, number: float = 1.0, proposed: str = "") -> str:
    """People write angles in degrees, and times of a landing in milliseconds."""
    if target is None or target.dimensionless:
        return f"{number:g}"
    if proposed:
        return f'"{number:g} {proposed}"'
    if target.name == "s":
        return f'"{number:g} ms"'
    return f'"{number:g} {target.name.replace("rad", "deg") if target.name in ("rad", "rad/s") else target.name}"'
