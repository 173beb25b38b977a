"""A mapping file to start from, guessed from the names, units and causality of a device's variables."""

from __future__ import annotations

from ..contract import INPUTS, OUTPUTS
from ..fmu.component import Component
from ..fmu.element import Connector

Words = dict[str, tuple[str, ...]]
WORDS: Words = {  # parts of vendors' names that mean an anatomic axis
    "subtalar": ("subtalar", "supin", "inv", "ever", "roll"),
    "talocrural": ("talocrural", "dorsi", "plantar", "flex", "pitch"),
}
WORDS_JCS: Words = {  # the same for the joint coordinate system
    "internal_rotation": ("internal", "axial", "yaw", "introt"),
    "inversion": ("inv", "ever", "supin", "roll"),
    "dorsiflexion": ("dorsi", "plantar", "flex", "pitch"),
}
QUANTITIES = {  # parts of names that mean a quantity, for variables without a unit
    "torque": ("torque", "moment", "tau", "m_"),
    "angle": ("angle", "ang", "phi", "theta", "rot"),
    "velocity": ("vel", "omega", "rate", "speed"),
}
UNITS = {"torque": "N.m", "angle": "rad", "velocity": "rad/s"}


def could_be(connector: Connector, kind: str) -> bool:
    """Whether the variable may be a `kind` (torque, angle, velocity): by its unit, or by its name where it has none."""
    if connector.unit is not None and not connector.unit.dimensionless:
        return connector.unit.same_dimension((OUTPUTS if kind == "torque" else INPUTS)[f"subtalar_{kind}"])
    return any(word in connector.name.lower() for word in QUANTITIES[kind])


def propose(component: Component) -> str:
    """Text of the mapping file; lines that a person must look at end in `# review`."""
    jcs = any(w in n.lower() for n in (*component.inputs, *component.outputs) for w in WORDS_JCS["internal_rotation"])
    lines = ["# Proposed by sprain-cosim check: look at every line, then delete this one."]
    for section, link, kinds in (("inputs", "to", ("angle", "velocity")), ("outputs", "from", ("torque",))):
        lines.append(f"[{section}]")
        taken: set[str] = set()
        for kind in kinds:
            for name, connector in component.select(section[:-1]).items():
                if connector.scalar_number and could_be(connector, kind):
                    lines.append(_line(name, connector, kind, link, WORDS_JCS if jcs else WORDS, taken))
        if not taken:
            lines.append("# no candidate found")
    return "\n".join(lines) + "\n"


def _line(name: str, connector: Connector, kind: str, link: str, words: Words, taken: set[str]) -> str:
    """One entry; adds its target to `taken`, and is a comment where the target is there already."""
    axis = next((a for a, parts in words.items() if any(part in name.lower() for part in parts)), None)
    target = f"{axis or 'subtalar'}_{kind}"
    declared = connector.unit is not None and not connector.unit.dimensionless
    unit = "" if declared else f', unit = "{UNITS[kind]}"'
    line = f'{target} = {{ {link} = "{name}"{unit} }}'
    second = target in taken
    taken.add(target)
    if second:
        return f"# {line}   # review: a second candidate"
    return line if axis is not None and connector.unit is not None else f"{line}   # review"
