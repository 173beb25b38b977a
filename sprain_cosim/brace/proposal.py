"""A mapping file to start from, guessed from the names, units and causality of a device's variables."""

from __future__ import annotations

import json
import re

from ..contract import INPUTS, OUTPUTS, plain
from ..errors import visible
from ..fmu.component import Component
from ..fmu.element import Connector
from ..units import unit

Words = dict[str, tuple[tuple[str, ...], tuple[str, ...]]]
WORDS: Words = {  # beginnings of words in vendors' names: of an anatomic axis, and of the motion against it
    "subtalar": (("subtalar", "supin", "inv", "roll"), ("ever", "evr", "pron")),
    "talocrural": (("talocrural", "dorsi", "flex", "pitch"), ("plantar",)),
}
WORDS_JCS: Words = {  # the same for the joint coordinate system
    "internal_rotation": (("internal", "introt", "axial", "yaw"), ("external", "extrot")),
    "inversion": (("inv", "supin", "roll"), ("ever", "evr", "pron")),
    "dorsiflexion": (("dorsi", "flex", "pitch"), ("plantar",)),
}
FORCE = unit("N")
LISTED = 40  # variables that are listed for a person to choose from
LONG = 5  # letters from which it is also looked for inside words and across them
PARTS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
QUANTITIES = {  # parts of names that mean a quantity, for variables without a unit
    "torque": ("torque", "moment", "tau", "m_"),
    "angle": ("angle", "ang", "phi", "theta", "rot"),
    "velocity": ("vel", "omega", "rate", "speed"),
}
CHOICES = {"torque": "N.m or N.mm", "angle": "deg or rad", "velocity": "deg/s or rad/s"}  # for a unit nobody declared


def could_be(connector: Connector, kind: str) -> bool:
    """Whether the variable may be a `kind` (torque, angle, velocity): by its unit, or by its name where it has none."""
    if connector.unit is not None and not connector.unit.dimensionless:
        return connector.unit.same_dimension((OUTPUTS if kind == "torque" else INPUTS)[f"subtalar_{kind}"])
    return any(word in connector.name.lower() for word in QUANTITIES[kind])


def propose(component: Component) -> str:
    """Text of the mapping file; lines that a person must look at end in `# review`."""
    names = [n for c in ("input", "output") for n, v in component.select(c).items() if v.scalar_number and _kind(v)]
    jcs = any(_axis(name, WORDS_JCS)[0] == "internal_rotation" for name in names)
    lines = ["# Proposed by sprain-cosim check: look at every line, then delete this one."]
    lines += ["[inputs]", *_candidates(component, "input", "to", ("angle", "velocity"), jcs)]
    lines += ["[outputs]", *_candidates(component, "output", "from", ("torque",), jcs)]
    lines += _unused(component, "\n".join(lines))
    return "\n".join(lines) + "\n"


def _candidates(component: Component, causality: str, link: str, kinds: tuple[str, ...], jcs: bool) -> list[str]:
    """Lines for variables that may be one of the kinds; where none may, forces with a lever arm."""
    lines: list[str] = []
    taken: set[str] = set()
    for kind in kinds:
        for name, connector in component.select(causality).items():
            if connector.scalar_number and could_be(connector, kind):
                lines.append(_line(name, connector, kind, link, WORDS_JCS if jcs else WORDS, taken))
    if not taken:
        forces = [n for n, c in component.outputs.items() if causality == "output" and _is_force(c)]
        lines += [_lever_line([name], jcs) for name in forces]
        lines += [_lever_line(forces, jcs)] if len(forces) > 1 else []
        lines.append("# no candidate found")
    return lines


def _unused(component: Component, shown: str) -> list[str]:
    """The other scalar variables, as comments."""
    rest = [
        f"#   {causality} {_plain(name)} [{connector.unit.name if connector.unit else 'no unit'}]"
        for causality in ("input", "output")
        for name, connector in component.select(causality).items()
        if connector.scalar_number and quoted(name) not in shown
    ]
    if not rest:
        return []
    more = [f"#   and {len(rest) - LISTED} more"] if len(rest) > LISTED else []
    return ["# Not used above; an entry may name any of these:", *rest[:LISTED], *more]


def quoted(name: str) -> str:
    """A name as a text of TOML."""
    return json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f")


def _plain(name: str) -> str:
    """A name as it may stand in a comment."""
    return visible(" ".join(name.split()))


def _is_force(connector: Connector) -> bool:
    """Whether it may be the pull of a cable or a strap."""
    if not connector.scalar_number:
        return False
    if connector.unit is not None and not connector.unit.dimensionless:
        return connector.unit.same_dimension(FORCE)
    return any(word in connector.name.lower() for word in ("force", "tension", "pull"))


def _lever_line(names: list[str], jcs: bool) -> str:
    axis = _axis(names[0], WORDS_JCS if jcs else WORDS)[0] or next(iter(WORDS))
    if len(names) == 1:
        entry = f'{axis}_torque = {{ from = {quoted(names[0])}, arm = "40 mm" }}'
        return f"# {entry}   # review: a force; state its lever arm and take the first # away"
    listed, signs = ", ".join(map(quoted, names)), ", ".join("1" for _ in names)
    entry = f'{axis}_torque = {{ from = [{listed}], factor = [{signs}], arm = "40 mm" }}'
    return f"# {entry}   # review: or their sum; -1 for one that pulls the other way"


def _kind(connector: Connector) -> bool:
    return any(could_be(connector, kind) for kind in QUANTITIES)


def _axis(name: str, words: Words) -> tuple[str | None, bool]:
    """The axis that a vendor's name means, and whether it means the motion against it: eversion, plantarflexion,
    external rotation."""
    parts = [part.lower() for part in PARTS.findall(name)]
    for axis, (along, against) in words.items():
        for motions, turned in ((against, True), (along, False)):
            if any(any(p.startswith(m) for p in parts) or (len(m) >= LONG and m in "".join(parts)) for m in motions):
                return axis, turned
    return None, False


def _line(name: str, connector: Connector, kind: str, link: str, words: Words, taken: set[str]) -> str:
    """One entry; adds its target to `taken`, and is a comment where the target is there already. A unit that nobody
    declared stays open, since no guess is safe."""
    axis, turned = _axis(name, words)
    own = {plain(signal): signal for signal in (*INPUTS, *OUTPUTS) if signal.endswith(f"_{kind}")}.get(plain(name))
    if own is not None:  # the contract's own name, without its unit
        axis, turned = own.removesuffix(f"_{kind}"), False
    target = f"{axis or next(iter(WORDS))}_{kind}"
    declared = connector.unit is not None and not connector.unit.dimensionless
    entry = f"{link} = {quoted(name)}" + ("" if declared else ', unit = "?"') + (", factor = -1" if turned else "")
    line = f"{target} = {{ {entry} }}"
    if target in taken:
        return f"# {line}   # review: a second candidate"
    taken.add(target)
    doubts = [] if declared else [f"unit {CHOICES[kind]}?"]
    doubts += ["against the axis, hence the factor"] if turned else []
    if doubts:
        return f"{line}   # review: {'; '.join(doubts)}"
    return line if axis is not None else f"{line}   # review"
