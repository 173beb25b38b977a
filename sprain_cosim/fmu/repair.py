"""A modelDescription.xml that breaks the rules of FMI where nothing here looks: annotations, attributes that FMI does
not know, variables that no run uses. It is read without them, and what was left out is said.

What is used stays as strict as the schema of FMI: inputs, outputs, parameters, the interfaces, the structure. An output
that breaks a rule is left out as long as the contract does not name it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..contract import OUTPUTS, plain
from ..errors import InputError

UNKNOWN_ATTRIBUTE = "SCHEMAV_CVC_COMPLEX_TYPE_3_2_1"  # libxml2: an attribute that the schema does not have
NOTES = ("Annotations", "VendorAnnotations")
INTERFACES = ("CoSimulation", "ModelExchange", "ScheduledExecution")
NO_NUMBERS = ("String", "Binary", "Clock")  # types of variables that no run sets or reads
USED = ("input", "output", "parameter", "structuralParameter", "independent")
MEANT = ("causality", "variability", "unit", "start", "min", "max", "declaredType", "valueReference", "stepSize")
MAX_ROUNDS = 50  # libxml2 stops at the first element that it does not expect
SAID = 3  # complaints of one kind that are said in full


def read_leniently(description: bytes, read: Callable[[bytes], Any]) -> tuple[Any, list[str]]:
    """fmpy's ModelDescription of what is used, and what is wrong elsewhere, one line each.

    `read` makes one of bytes, without validation. Raises InputError when what is used breaks the rules."""
    from lxml import etree

    root = etree.fromstring(description, etree.XMLParser(resolve_entities=False, no_network=True))
    wrong: list[str] = []
    schema = _schema(str(root.get("fmiVersion", ""))[:1])
    for _ in range(MAX_ROUNDS):
        if schema.validate(root):
            break
        errors = list(schema.error_log)
        for error in errors:
            _repair(root, error, wrong)
    else:
        raise InputError("it breaks the schema in too many places")
    return _consistent(root, read, wrong), _few(wrong)


@lru_cache(maxsize=3)
def _schema(version: str) -> Any:
    """Of a major version of FMI."""
    import fmpy
    from lxml import etree

    prefix = "" if version == "1" else f"fmi{version}"
    name = "fmiModelDescription.xsd" if version == "1" else f"{prefix}ModelDescription.xsd"
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema" / f"fmi{version}" / name))


def _repair(root: Any, error: Any, wrong: list[str]) -> None:
    """Takes what an error of the schema is about out of the tree. Raises InputError when it is used."""
    found = root.getroottree().xpath(error.path) if error.path else []
    if not found:  # gone with its parent
        return
    element = found[0]
    chain = [element, *element.iterancestors()]
    tags = [str(e.tag) for e in chain]
    note = next((e for e in chain if e.tag in NOTES), None)
    variable = next((e for e, above in zip(chain, tags[1:], strict=False) if above == "ModelVariables"), None)
    says = _says(error.message)
    if note is not None and note is not root:
        wrong.append(f"{_where(note)}: {says}")
        note.getparent().remove(note)
    elif error.type_name == UNKNOWN_ATTRIBUTE and not set(tags) & set(INTERFACES):
        attribute = re.search(r"attribute '(?:\{[^}]*\})?([^']*)'", error.message)
        name = next((n for n in element.attrib if attribute and n.rpartition("}")[2] == attribute[1]), None)
        if name is None or _may_be_meant(root, name, chain, variable):
            raise InputError(says)
        wrong.append(f"{_where(element)}: {says}")
        del element.attrib[name]
    elif variable is not None and not _is_used(variable):
        wrong.append(f"variable {variable.get('name') or 'without a name'} cannot be used: {says}")
        _blank(variable)
    elif "UnitDefinitions" in tags[1:] and not _is_referred_to(
        root, element := chain[tags.index("UnitDefinitions") - 1]
    ):
        wrong.append(f"unit {element.get('name') or 'without a name'}, which no variable in use has: {says}")
        element.getparent().remove(element)
    else:
        raise InputError(says)


def _may_be_meant(root: Any, attribute: str, chain: list[Any], variable: Any) -> bool:
    """Whether an unknown attribute may be one that FMI has, in other letters, of something that is used; what follows
    from it would be lost in silence."""
    if chain[0].tag == "BaseUnit":
        return _is_referred_to(root, chain[1] if chain[1].tag == "Unit" else chain[0])
    misspelt = attribute not in MEANT and attribute.lower() in {name.lower() for name in MEANT}
    return misspelt and (variable is None or _is_used(variable))


def _says(message: str) -> str:
    return re.sub(r"\s+", " ", message).strip()[:200]


def _where(element: Any) -> str:
    """Such as variable u, or ModelStructure."""
    for e in (element, *element.iterancestors()):
        above = e.getparent()
        if above is not None and above.tag == "ModelVariables":
            return f"variable {e.get('name')}"
    return str(element.tag)


def _value(variable: Any) -> Any:
    """The element that has type, unit and start: the variable itself in FMI 3."""
    return (
        next((c for c in variable if isinstance(c.tag, str) and c.tag not in NOTES), variable)
        if (variable.tag == "ScalarVariable")
        else variable
    )


def _is_used(variable: Any) -> bool:
    """Whether a run may read or set it. What has no proper name or causality may be anything."""
    name, causality = variable.get("name"), variable.get("causality")
    if not name or (
        causality is not None and causality not in (*USED, "local", "calculatedParameter", "internal", "none")
    ):
        return True
    if variable.get("variability") == "parameter":  # FMI 1
        return True
    if causality not in USED or _value(variable).tag in NO_NUMBERS:
        return False
    return causality != "output" or plain(name) in {plain(output) for output in OUTPUTS}


def _blank(variable: Any) -> None:
    """Makes of it a text that nobody reads, in its place: indices of the structure count places."""
    from lxml import etree

    name, reference = variable.get("name") or "unnamed", variable.get("valueReference") or ""
    kept = reference if reference.isdigit() and int(reference) < 1 << 32 else "0"
    old = variable.tag == "ScalarVariable"
    blank = etree.Element("ScalarVariable" if old else "String", name=name, valueReference=kept)
    if old:
        etree.SubElement(blank, "String")
    variable.getparent().replace(variable, blank)


def _is_referred_to(root: Any, definition: Any) -> bool:
    name = definition.get("name") or definition.get("unit")
    used = [_value(v) for v in root.iterfind("ModelVariables/*") if isinstance(v.tag, str) and _is_used(v)]
    types = {v.get("declaredType") for v in used}
    of_types = [t for t in root.iterfind("TypeDefinitions/*") if t.get("name") in types]
    holders = [*used, *of_types, *(child for t in of_types for child in t)]
    return name is None or any(holder.get("unit") == name for holder in holders)


def _consistent(root: Any, read: Callable[[bytes], Any], wrong: list[str]) -> Any:
    """The description, valid by the schema, as fmpy reads it; what fmpy finds inconsistent goes to `wrong`. Raises
    InputError when it cannot be read."""
    from fmpy.validation import validate_model_description
    from lxml import etree

    variables = {v.get("name"): v for v in root.iterfind("ModelVariables/*")}  # a name of many: the last one
    for _ in range(len(variables) + 1):
        try:
            model = read(etree.tostring(root))
            break
        except MemoryError:
            raise
        except Exception as problem:
            says = _says(str(problem))
            named = re.match(r'Variable "(.*?)" \(line', says)
            culprit = variables.pop(named[1], None) if named else None
            if culprit is None:
                raise InputError(says) from None
            wrong.append(says)
            if "illegal combination" in says:  # neither is used here
                culprit.attrib.pop("initial", None)
                culprit.attrib.pop("variability", None)
                if str(culprit.get("causality")).lower().endswith("parameter"):
                    culprit.set("variability", "fixed")
            elif _is_used(culprit):
                raise InputError(says) from None
            else:
                _blank(culprit)
    count = Counter(variable.name for variable in model.modelVariables)
    twice = next((v.name for v in model.modelVariables if v.causality in USED and count[v.name] > 1), None)
    if twice is not None:
        raise InputError(f"two variables are named {twice}")
    try:
        wrong += [_says(problem) for problem in validate_model_description(model)]
    except Exception as problem:  # of a display unit whose unit is not defined
        wrong.append(f"inconsistent: {type(problem).__name__} {_says(str(problem))}")
    return model


def _few(wrong: Iterable[str]) -> list[str]:
    found = list(dict.fromkeys(wrong))
    return found if len(found) <= SAID else [*found[:SAID], f"and {len(found) - SAID} more of the kind"]
