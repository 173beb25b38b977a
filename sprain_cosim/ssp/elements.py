"""The elements of SSP documents: which are read, which mean nothing for a run, which are refused. A document is plain
XML, fits the standard's schema and holds nothing that would be left out in silence."""

from __future__ import annotations

import re
from copy import deepcopy
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lxml import etree

from ..errors import InputError, problems_to_error

SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SSC, SSD, SSV, SSM = (f"{SPACE}{name}" for name in ("Common", "Description", "ParameterValues", "ParameterMapping"))
VERSIONS = ("1.0", "2.0")
OWN = "urn:sprain-cosim:ssp:1"  # of our annotations
ANNOTATIONS: dict[str, tuple[bool, tuple[str, ...], tuple[str, ...] | None]] = {
    # of our own, in the outermost system: whether there may be several, attributes that it must have, and may
    "Master": (False, ("communicationStep", "scheme", "identify", "adaptive"), ()),
    "HandOver": (True, ("source", "target"), ("factor", "offset")),
    "Device": (True, ("component",), None),  # its reader judges them
}
SCHEMAS = {
    f"{{{SSD}}}SystemStructureDescription": "SystemStructureDescription.xsd",
    f"{{{SSV}}}ParameterSet": "SystemStructureParameterValues.xsd",
    f"{{{SSM}}}ParameterMapping": "SystemStructureParameterMapping.xsd",
}
LATER_KINDS = ("structuralParameter", "constant", "local", "unspecified")  # of connectors, since 2.0
LARGEST = 64 * 2**20  # B of one document
DEEPEST = 64

READ, SKIPPED = "read", "skipped"
REALS = ("Real", "Float64", "Float32")
NUMERALS = ("Integer", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))
SUPPORT: dict[str, tuple[str, str]] = {  # element: (treatment, why; empty where it is read)
    **dict.fromkeys(
        (
            *("SystemStructureDescription", "System", "Elements", "Component", "Connectors", "Connector"),
            *("Connections", "Connection", "LinearTransformation", "Units", "Unit", "BaseUnit"),
            *("Enumerations", "Enumeration", "Item", "DefaultExperiment", "Annotations", "Annotation"),
            *("ParameterBindings", "ParameterBinding", "ParameterValues", "ParameterMapping", "ParameterSet"),
            *("Parameters", "Parameter", "MappingEntry", "MapEntry"),
            *("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation"),
            *(*REALS, *NUMERALS, "Boolean", "String", "Binary"),
        ),
        (READ, ""),
    ),
    **dict.fromkeys(
        ("ElementGeometry", "ConnectorGeometry", "ConnectionGeometry", "SystemGeometry", "GraphicalElements", "Note"),
        (SKIPPED, "a drawing"),
    ),
    "MetaData": (SKIPPED, "for people and other tools"),
    **dict.fromkeys(
        ("SignalDictionaries", "SignalDictionary", "SignalDictionaryReference", "DictionaryEntry"),
        ("refused", "signals of a dictionary; connect the components with each other"),
    ),
    "Value": ("refused", "an array of texts"),
    "Dimension": ("refused", "an array connector; export scalars"),
    "Clock": ("refused", "a clock connector; our clocks tick by the FMU's own description"),
    "Signature": ("refused", "a signature, which is not verified here; remove it if you trust the file"),
}


def document(data: bytes, place: str, root: str) -> Any:
    """The root element, an lxml element, of a document whose root is `{namespace}root`. Raises InputError in one line:
    no plain XML, of another kind, against the schema, an element that is refused."""
    if len(data) > LARGEST:
        raise InputError(f"{place}: {len(data) / 2**20:.0f} MB; at most {LARGEST // 2**20} MB are accepted")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{place}: is not UTF-8, which SSP wants") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text or "\0" in text:
        raise InputError(f"{place}: has a DOCTYPE or entities, which SSP does not use; refused")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        tree = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as problem:
        raise InputError(f"{place}: no readable XML ({' '.join(str(problem).split())[:200]})") from None
    if tree.tag != root:
        space = etree.QName(tree).namespace
        raise InputError(
            f"{place}: is {_plain(tree.tag)}{f' of {space}' if space else ''}, expected {_plain(root)} of SSP "
            f"({root[1:].partition('}')[0]})"
        )
    return fitting(tree, place)


def fitting(tree: Any, place: str) -> Any:
    """The element, of which the whole fits; also one that stands inline in another document. Raises InputError."""
    version = tree.get("version", "")
    if version not in VERSIONS:
        raise InputError(f"{place}: version {version!r} of SSP; {' and '.join(VERSIONS)} are read")
    problems = _refused(tree)
    schema = _schema(SCHEMAS[tree.tag])
    if not problems and not schema.validate(tree if version == "1.0" else _in_older_words(tree)):
        problems = [f"line {error.line}: {_words(error.message)}" for error in list(schema.error_log)[:3]]
    problems_to_error(place, problems)
    return tree


def children(element: Any, *path: str) -> list[Any]:
    """The elements of SSP below `element` by their local names: children(ssd, "Connections", "Connection")."""
    found = [element]
    for name in path:
        found = [child for parent in found for child in parent if isinstance(child.tag, str) and local(child) == name]
    return found


def local(element: Any) -> str:
    """The name of an element without its namespace."""
    return _plain(element.tag)


def own_annotations(tree: Any, name: str) -> list[dict[str, str]]:
    """The attributes of our annotations {OWN}name in the outermost system of a structure."""
    found = children(tree, "System", "Annotations", "Annotation", name)
    return [dict(element.attrib) for element in found if element.tag == f"{{{OWN}}}{name}"]


def _refused(tree: Any) -> list[str]:
    """One line a kind of element that is refused or unknown, with the line of the first."""
    found: dict[str, str] = {}
    waiting = [(tree, 0)]
    while waiting:
        element, depth = waiting.pop()
        name = local(element)
        treatment, why = SUPPORT.get(name, ("unknown", "no element of SSP that is known here"))
        if depth > DEEPEST:
            return [f"line {element.sourceline}: nested deeper than {DEEPEST} elements"]
        if not element.tag.startswith(f"{{{SPACE}"):
            found.setdefault(name, f"line {element.sourceline}: {name}: of another namespace than SSP's; not supported")
        elif treatment not in (READ, SKIPPED):
            found.setdefault(name, f"line {element.sourceline}: {name}: {why}; not supported")
        elif name == "Annotations":
            for problem in _wrong_annotations(element):
                found.setdefault(problem, problem)
        elif treatment == READ:
            waiting += [(child, depth + 1) for child in reversed(element) if isinstance(child.tag, str)]
    return list(found.values())


def _wrong_annotations(element: Any) -> list[str]:
    """What is wrong with those of our own in an element Annotations, one line each: else a name with a slip in it
    would stand for nothing."""
    problems, met = list[str](), set[str]()
    outermost = local(element.getparent()) == "System" and element.getparent().getparent().getparent() is None
    for own in (a for annotation in element for a in annotation if str(a.tag).startswith(f"{{{OWN}}}")):
        name, line = local(own), f"line {own.sourceline}: annotation {local(own)}"
        several, needed, more = ANNOTATIONS.get(name, (False, (), None))
        if name not in ANNOTATIONS:
            problems.append(f"{line}: none of ours; they are {', '.join(ANNOTATIONS)}")
        elif not outermost:
            problems.append(f"{line}: belongs to the outermost System")
        elif name in met and not several:
            problems.append(f"{line}: there are two; keep one")
        elif len(own):
            problems.append(f"{line}: {local(own[0])}: it holds no elements")
        strange = [key for key in own.attrib if more is not None and key not in (*needed, *more)]
        problems += [f"{line}: {key}: its attributes are {', '.join((*needed, *(more or ())))}" for key in strange]
        problems += [f"{line}: has no {key}" for key in needed if own.get(key) is None]
        met.add(name)
    return problems


def _in_older_words(tree: Any) -> Any:
    """A document of version 2.0 as one of 1.0, of which the standard's schema is at hand: all that is read of 2.0 has
    its like there. Source: the changes of the schemas from 1.0 to 2.0."""
    older = deepcopy(tree)
    older.set("version", "1.0")
    for element in list(older.iter(*(f"{{{space}}}*" for space in (SSC, SSD, SSV, SSM)))):
        name, space = local(element), element.tag.rpartition("}")[0]
        if name == "MetaData":
            element.getparent().remove(element)
        elif name in (*REALS, *NUMERALS):
            element.tag = f"{space}}}{'Real' if name in REALS else 'Integer'}"
        elif name == "Connector" and element.get("kind") in LATER_KINDS:
            element.set("kind", "parameter")
        elif name == "Annotation":
            element.text = None
        elif name == "ConnectorGeometry":
            for side in ("systemInnerX", "systemInnerY"):
                element.attrib.pop(side, None)
        for key in ("value", "source", "target") if name in (*NUMERALS, "Item", "MapEntry") else ():
            if _is_long(element.get(key, "")):
                element.set(key, "0")
        if name in (*REALS, *NUMERALS) and len(element.get("value", "").split()) > 1:
            element.set("value", "0")  # several: their reader refuses them
    return older


def _is_long(text: str) -> bool:
    return re.fullmatch(r"\s*[-+]?\d{1,20}\s*", text) is not None and -(2**63) <= int(text) < 2**64


@lru_cache(maxsize=4)
def _schema(name: str) -> Any:
    """The standard's own schema, as FMPy ships it."""
    spec = find_spec("fmpy")
    assert spec is not None and spec.origin is not None
    return etree.XMLSchema(etree.parse(str(Path(spec.origin).parent / "ssp" / "schema" / name)))


def _plain(tag: str) -> str:
    return tag.rpartition("}")[2]


def _words(message: str) -> str:
    """A message of the schema's processor with its namespaces left out."""
    for space in (SSC, SSD, SSV, SSM):
        message = message.replace(f"{{{space}}}", "")
    return " ".join(message.split())[:200]
