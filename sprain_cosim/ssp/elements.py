"""The elements of SSP documents: which are read, which mean nothing for a run, which are refused. A document is plain
XML, fits the standard's schema and holds nothing that would be left out in silence."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lxml import etree

from ..errors import InputError, problems_to_error

SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SSC, SSD, SSV, SSM = (f"{SPACE}{name}" for name in ("Common", "Description", "ParameterValues", "ParameterMapping"))
OWN = "urn:sprain-cosim:ssp:1"  # of our annotations
SCHEMAS = {
    f"{{{SSD}}}SystemStructureDescription": "SystemStructureDescription.xsd",
    f"{{{SSV}}}ParameterSet": "SystemStructureParameterValues.xsd",
    f"{{{SSM}}}ParameterMapping": "SystemStructureParameterMapping.xsd",
}
LARGEST = 64 * 2**20  # B of one document
DEEPEST = 64

READ, SKIPPED = "read", "skipped"
SUPPORT: dict[str, tuple[str, str]] = {  # element: (treatment, why; empty where it is read)
    **dict.fromkeys(
        (
            *("SystemStructureDescription", "System", "Elements", "Component", "Connectors", "Connector"),
            *("Connections", "Connection", "LinearTransformation", "Units", "Unit", "BaseUnit"),
            *("Enumerations", "Enumeration", "Item", "DefaultExperiment", "Annotations", "Annotation"),
            *("ParameterBindings", "ParameterBinding", "ParameterValues", "ParameterMapping", "ParameterSet"),
            *("Parameters", "Parameter", "MappingEntry", "MapEntry"),
            *("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation"),
            *("Real", "Integer", "Boolean", "String", "Binary", "Float64", "Float32"),
            *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
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
        raise InputError(
            f"{place}: is {_plain(tree.tag)}, expected {_plain(root)} of SSP ({root[1:].partition('}')[0]})"
        )
    return fitting(tree, place)


def fitting(tree: Any, place: str) -> Any:
    """The element, of which the whole fits; also one that stands inline in another document. Raises InputError."""
    version = tree.get("version", "")
    if version.partition(".")[0] not in ("1", "2"):
        raise InputError(f"{place}: version {version!r} of SSP; 1.0 and 2.0 are read")
    problems = _refused(tree)
    schema = _schema(SCHEMAS[tree.tag])
    if not problems and version.startswith("1") and not schema.validate(tree):
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


def own_annotation(element: Any, name: str) -> dict[str, str]:
    """The attributes of our annotation {OWN}name of an element; empty where there is none."""
    found = children(element, "Annotations", "Annotation", name)
    return dict(found[0].attrib) if found and found[0].tag == f"{{{OWN}}}{name}" else {}


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
        elif treatment == READ and name != "Annotations":
            waiting += [(child, depth + 1) for child in reversed(element) if isinstance(child.tag, str)]
    return list(found.values())


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
