"""The heading of tables, figures and films, made from what runs: a title that an option or a replaced FMU could make
untrue is not repeated.

A file's own title stands with the changes that were made since. RAN in it, or no title at all, is replaced by a
description of what runs: slope, body, brace, muscles."""

from __future__ import annotations

import filecmp
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from ..shipped import FMI3, FMUS
from ..subject.person import SEGMENTS
from ..units import Unit, quantity, unit

RAN = "{ran}"  # what stands in a title for the description
ONE = Unit("1")
SHIPPED = {"plant": "plant", "controller": "reflex_controller"}  # not worth a word
FACTOR = re.compile(rf"plant\.({'|'.join(SEGMENTS)})_scale_[xyz]")
INCLINE, MASS = "plant.platform_incline", "plant.body_mass"
COACTIVATION, GAIN = "controller.coactivation", "controller.reflex_gain"
PASSIVE_SCALE, EVERTORS = "plant.passive_angle_scale", "plant.evertor_strength_scale"
MODULUS, FRICTION, EDGE = "plant.contact_modulus", "plant.contact_friction", "plant.platform_edge_distance"
ANGLE_SCALE, TORQUE_SCALE = "brace.angle_scale", "brace.torque_scale"


def heading(own: str, description: str, changes: Collection[str], named: Collection[str]) -> str:
    """The whole heading.

    own          title of the file; empty for none
    description  of what runs
    changes      made since the file was read, such as "plant.drop_height = 0.35 m"
    named        parameters that the description names: a change of one of them is not listed after it
    """
    if own and RAN not in own:
        return " · ".join([own, *changes])
    rest = [change for change in changes if change.partition(" = ")[0] not in named]
    title = own.replace(RAN, description) or description
    return " · ".join([title[:1].upper() + title[1:], *rest])


@dataclass(frozen=True)
class Ran:
    """What runs.

    fmus        {component: file}
    parameters  {"component.parameter": value, text with the unit where it has a dimension}
    start       gives the start value of a parameter that is not set, in the same form; None where it is not known
    varied      parameters that take several values
    person      who lands, in words; empty for the person with whom the plant was made
    compared    several braces take turns, so that none is named
    """

    fmus: Mapping[str, Path]
    parameters: Mapping[str, float | int | str | bool]
    start: Callable[[str], float | int | str | None]
    varied: Collection[str] = field(default_factory=tuple)
    person: str = ""
    compared: bool = False

    def described(self) -> tuple[str, set[str]]:
        """The description and the names of parameters and components in it. Empty for a system without a plant of the
        contract."""
        if "plant" not in self.fmus:
            return "", set()
        parts, named = list[str](), set[str]()
        found = (
            self._slope(),
            self._ground(),
            self._body(),
            self._ankle(),
            self._brace(),
            self._muscles(),
            self._others(),
        )
        for words, names in found:
            parts += words
            named |= names
        return ", ".join(parts), named

    def _value(self, name: str, unit: Unit) -> float | None:
        """In the unit `wanted`; None where it is not known."""
        value = self.parameters.get(name, self.start(name))
        if value is None or name in self.varied:
            return None
        try:
            return quantity(value, unit, name)
        except InputError:
            return None

    def _slope(self) -> tuple[list[str], set[str]]:
        if INCLINE in self.varied:
            return ["varied slope"], {INCLINE}
        incline = self._value(INCLINE, unit("deg"))
        if incline is None:
            return [], set()
        return [f"{incline:.4g}° slope" if round(incline, 9) else "level floor"], {INCLINE}

    def _ground(self) -> tuple[list[str], set[str]]:
        """A ground that is not the model's, and a platform that ends under the foot."""
        rows = ((MODULUS, "MPa/m", 50.0, "ground {:.4g} MPa/m"), (FRICTION, "1", 0.9, "friction {:.4g}"))
        words, named = list[str](), set[str]()
        for name, of, usual, text in (*rows, (EDGE, "mm", 1e6, "edge at {:.4g} mm")):
            value = self._value(name, unit(of)) if name in self.parameters else None
            if value is not None and round(value / usual, 9) != 1.0:
                words.append(text.format(value))
                named.add(name)
        return words, named

    def _body(self) -> tuple[list[str], set[str]]:
        if self.person:  # with what is set of the body in place of the person's own
            own = {n: v for n, v in self.parameters.items() if n == MASS or FACTOR.fullmatch(n)}
            return [self.person, *(f"{n.partition('.')[2]} {_short(v)}" for n, v in own.items())], {"subject", *own}
        if MASS not in self.parameters:
            return [], set()
        mass = self._value(MASS, unit("kg"))
        return ([] if mass is None else [f"{mass:.4g} kg"]), {MASS}

    def _ankle(self) -> tuple[list[str], set[str]]:
        """A passive ankle that is not the model's, evertors that are not as strong as the model's."""
        words, named = list[str](), set[str]()
        for name, text in ((PASSIVE_SCALE, "passive ankle {:.4g} %"), (EVERTORS, "evertors {:.4g} %")):
            value = self._value(name, ONE) if name in self.parameters else None
            if value is not None and value != 1.0:
                words.append(text.format(100 * value))
                named.add(name)
        return words, named

    def _brace(self) -> tuple[list[str], set[str]]:
        path = self.fmus.get("brace")
        if self.compared:
            return [], {"brace", ANGLE_SCALE, TORQUE_SCALE}
        if path is None:
            return ["no brace"], {"brace"}
        scales = {name: self._value(name, ONE) for name in (ANGLE_SCALE, TORQUE_SCALE)}
        if _shipped(path) == "brace_bushing":
            angle, torque = scales.values()
            words = f"{100 * angle:.4g} % brace" if angle is not None else "brace of varied angle scale"
            if torque is None:
                words += ", varied torque scale"
            elif torque != 1.0:
                words += f" with {torque:.4g} times the torque"
            return [words], {"brace", *scales}
        name = _shipped(path) or path.name
        set_here = {n: v for n, v in self.parameters.items() if n.startswith("brace.") and n not in self.varied}
        values = ", ".join(f"{n.partition('.')[2]} {_short(v)}" for n, v in set_here.items())
        brace = name if name.startswith("brace") else f"brace {name}"
        return [f"{brace} ({values})" if values else brace], {"brace", *set_here}

    def _muscles(self) -> tuple[list[str], set[str]]:
        if "controller" not in self.fmus:
            return [], set()
        words, names = list[str](), {COACTIVATION, GAIN}
        activation, gain = (self._value(name, ONE) for name in (COACTIVATION, GAIN))
        if COACTIVATION in self.varied:
            words.append("varied co-activation")
        elif activation:
            words.append(f"co-activation {100 * activation:.4g} %")
        if GAIN in self.varied:
            words.append("varied reflex gain")
        elif gain:
            words.append(f"reflex gain {gain:.4g}")
        if activation == 0.0 and gain == 0.0:
            words.append("ankle muscles off")
        return words, names

    def _others(self) -> tuple[list[str], set[str]]:
        """FMUs in the place of the shipped plant and controller, and further components."""
        others = {
            name: path
            for name, path in self.fmus.items()
            if name != "brace" and (name not in SHIPPED or _shipped(path) != SHIPPED[name])
        }
        return [f"{name} {path.name}" for name, path in others.items()], set(others)


def _short(value: float | int | str | bool) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _shipped(path: Path) -> str:
    """The model of a shipped FMU, of a copy of one under its own name, or under that of its component, as in a package;
    empty for any other file."""
    built = FMUS.glob("*.fmu") if path.stem in ("brace", *SHIPPED) else [FMUS / path.name]
    return next((file.stem.removesuffix(FMI3) for file in built if _same(path, file)), "")


def _same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other) or filecmp.cmp(path, other, shallow=False)
    except OSError:
        return False
