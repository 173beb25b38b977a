"""Nothing in a system of others passes in silence: what is written there has its meaning, is refused or is said."""

from __future__ import annotations

import random
import zipfile
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from sprain_cosim import load_scenario
from sprain_cosim.errors import InputError
from sprain_cosim.export.package import export_package
from sprain_cosim.fmu.element import Connector
from sprain_cosim.ssp.flat import Flat, flattened
from sprain_cosim.ssp.values import Assigned, Transformation
from tests.native import device
from tests.systems import (
    DEVICE,
    OUTSIDE,
    PLAIN,
    SPACES,
    STIFF,
    THROUGH,
    UNITS,
    annotated,
    binding,
    inline_mapping,
    parameters,
    real,
    structure,
    system,
    value,
    wire,
)

Pack = Callable[..., Path]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    folder = tmp_path_factory.mktemp("silence")
    brace = device(folder / "brace.fmu").read_bytes()

    def made(content: str, **files: str) -> Path:
        target = folder / f"{len(list(folder.iterdir()))}.ssp"
        with zipfile.ZipFile(target, "w") as archive:
            archive.writestr("SystemStructure.ssd", content)
            archive.writestr("resources/brace.fmu", brace)
            for name, text in files.items():
                archive.writestr(name.replace("__", "."), text)
        return target

    return made


def bound(binding_: str) -> str:
    return structure(system(PLAIN.replace("</ssd:Component>", f"{binding_}</ssd:Component>"), THROUGH, OUTSIDE))


def with_kind(kind: str, connections: str = THROUGH) -> str:
    return structure(system(PLAIN, connections, f'{OUTSIDE}<ssd:Connector name="k" kind="{kind}"/>'))


WRONG_UNIT = '<ssv:Units><ssc:Unit name="N.mm/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1"/></ssc:Unit></ssv:Units>'
ONE_MAPPING = f'<ssm:ParameterMapping{SPACES} version="1.0"/>'
THEIRS = '<ssc:Annotation type="org.openmodelica"><step xmlns="urn:x" stepSize="1"/></ssc:Annotation>'
MASTER = '<ssc:Annotation type="x"><own:Master xmlns:own="urn:sprain-cosim:ssp:1"/></ssc:Annotation>'
MAPPED = '<ssm:MappingEntry source="stiffness" target="stiffness">{}</ssm:MappingEntry>'
REFUSED = {  # of both versions of the standard
    "unknown attribute": (DEVICE.replace("<ssd:Connection ", '<ssd:Connection supressUnits="true" '), "supressUnits"),
    "element elsewhere": (DEVICE.replace("</ssd:Elements>", "<ssd:Connection/></ssd:Elements>"), "Connection"),
    "two connectors": (
        structure(system(PLAIN, THROUGH, OUTSIDE + real("subtalar_angle", "input", "deg"))),
        "two connectors are named subtalar_angle",
    ),
    "two units": (DEVICE.replace("</ssd:Units>", UNITS[11:]), "unit deg: is defined twice"),
    "empty unit": (DEVICE.replace('unit="rad"', 'unit=""'), "unit '' is not defined"),
    "forgotten factor": (
        bound(binding(parameters(value("stiffness", '<ssv:Real value="1" unit="N.mm/rad"/>'), WRONG_UNIT))),
        "unit N.mm/rad is defined as 1 kg.m2/(s2.rad), but N.mm/rad is 0.001 kg.m2/(s2.rad)",
    ),
    "another dimension": (
        DEVICE.replace('<ssc:BaseUnit rad="1"/>', '<ssc:BaseUnit m="1"/>'),
        "unit rad is defined as 1 m, but rad is 1 rad",
    ),
    "another type": (DEVICE.replace('<ssc:Real unit="rad"/>', "<ssc:Boolean/>", 1), "type Boolean in the document"),
    "two values": (bound(binding(parameters(STIFF * 2))), "stiffness: two values in one parameter set"),
    "two sets": (bound(binding(parameters(STIFF) * 2)), "needs a source, or one ParameterSet in it, and not both"),
    "set and source": (bound(binding(parameters(STIFF), more='source="a.ssv"')), "and not both"),
    "another mapping": (
        bound(binding(parameters(STIFF), '<ssd:ParameterMapping type="text/x" source="a.ssm"/>')),
        "mappings of type text/x are not supported",
    ),
    "two mappings": (
        bound(binding(parameters(STIFF), inline_mapping("").replace("</ssd:", f"{ONE_MAPPING}</ssd:"))),
        "ParameterMapping needs a source, or one mapping in it",
    ),
    "two entries": (
        bound(
            binding(
                parameters(value("stiffness", '<ssv:Integer value="3"/>')),
                inline_mapping(
                    MAPPED.format(
                        "<ssc:IntegerMappingTransformation>"
                        + '<ssc:MapEntry source="3" target="30"/><ssc:MapEntry source="3" target="40"/>'
                        + "</ssc:IntegerMappingTransformation>"
                    )
                ),
            )
        ),
        "has two entries for 3",
    ),
    "local variable": (DEVICE.replace('kind="input"', 'kind="local"'), "local"),
    "parameter fed": (
        structure(system(PLAIN, THROUGH + wire("brace.subtalar_torque", "brace.stiffness"), OUTSIDE)),
        "a parameter can be fed by a parameter of the system around it only",
    ),
    "unknown annotation": (annotated(DEVICE, "System", "Mastr"), "annotation Mastr: none of ours"),
    "annotation elsewhere": (annotated(DEVICE, "Component", "Master"), "Master: belongs to the outermost System"),
    "attribute of ours": (
        annotated(DEVICE, "System", 'Master communicatonStep="0.0001"'),
        "annotation Master: communicatonStep: its attributes are communicationStep, scheme",
    ),
    "two of ours": (
        annotated(DEVICE, "System", "Master").replace("</ssd:Ann", f"{MASTER}</ssd:Ann"),
        "annotation Master: there are two",
    ),
    "attribute of ours left out": (
        annotated(DEVICE, "System", 'Master scheme="auto"'),
        "annotation Master: has no communicationStep",
    ),
    "number of Python": (
        annotated(DEVICE, "System", 'HandOver source="a.b" target="c.d" factor="1_0"'),
        "'1_0' is no number",
    ),
    "hand-over of nothing": (
        annotated(DEVICE, "System", 'HandOver source="brace.k" target="plant.k"'),
        "annotation HandOver: brace.k: there is no such connector",
    ),
    "texts": (bound(binding(parameters(value("", '<ssv:String><ssv:Value value=""/></ssv:String>')))), "Value"),
}  # fmt: skip


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", REFUSED)
def test_what_would_stand_for_nothing_is_refused(name: str, version: str, pack: Pack) -> None:
    content, words = REFUSED[name]
    with pytest.raises(InputError) as problem:
        flattened(pack(content.replace('version="1.0"', f'version="{version}"')))
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)


NOTED = {
    "annotation of others": (
        DEVICE.replace("</ssd:System>", f"<ssd:Annotations>{THEIRS}</ssd:Annotations></ssd:System>"),
        "annotations of org.openmodelica are for other tools and left out",
    ),
    "a connector left out": (
        DEVICE.replace(real("subtalar_torque", "output", "N.m"), ""),
        "brace: subtalar_torque: connected and not stated among the connectors",
    ),
    "a connection left out": (
        structure(system(PLAIN, THROUGH.partition("</ssd:Connection>")[2], OUTSIDE)),
        "brace: subtalar_angle: stated as inputs and fed by nothing",
    ),
    "a set that nothing binds": (DEVICE, "resources/soft.ssv is in the package, and nothing in SystemStructure.ssd"),
    "a variant": (DEVICE, "VarA.ssd is another variant; SystemStructure.ssd is read"),
    "a slip in a name": (
        bound(binding(parameters(value("stifness", '<ssv:Real value="30"/>')))),
        "stifness: there is no such parameter (did you mean stiffness?)",
    ),
}


@pytest.mark.parametrize("name", NOTED)
def test_what_may_have_been_forgotten_is_said(name: str, pack: Pack) -> None:
    content, words = NOTED[name]
    package = pack(content, **{"resources/soft__ssv": parameters(STIFF), "VarA__ssd": DEVICE})
    assert any(words in note for note in flattened(package).notes)
    if name.endswith(("binds", "variant")):
        assert not flattened(pack(content)).notes


def test_a_parameter_of_the_system_is_set_and_not_fed(pack: Pack) -> None:
    """Also where it leads to an input: its value holds there for the whole run."""
    for kind in ("parameter", "structuralParameter"):
        content = with_kind(kind, THROUGH + wire("k", "brace.stiffness"))
        content = content.replace(
            "<ssd:Elements>", binding(parameters(value("k", '<ssv:Real value="30"/>'))) + "<ssd:Elements>"
        )
        version = "1.0" if kind == "parameter" else "2.0"
        found = flattened(pack(content.replace('version="1.0" name="test"', f'version="{version}" name="test"')))
        assert found.parameters == {"brace.stiffness": "30.0 N.m/rad"}
        assert list(found.inputs) == ["subtalar_angle"]


def test_words_of_the_second_version(pack: Pack) -> None:
    """Types of FMI 3, metadata, free text in annotations: as their like in the first; arrays are refused."""
    meta = '</ssd:Units><ssd:MetaData kind="general" type="text/plain"/>'
    content = DEVICE.replace("ssc:Real", "ssc:Float64").replace("</ssd:Units>", meta)
    content = annotated(content, "System", "Note").replace("<own:Note xmlns:own", "some text<Note xmlns")
    content = content.replace("urn:sprain-cosim:ssp:1", "urn:x").replace(' version="1.0"', ' version="2.0"')
    assert flattened(pack(content)).feeds == flattened(pack(DEVICE)).feeds
    for text, words in (("1 2", "arrays are not supported"), ("1e400", "must be finite")):
        changed = bound(binding(parameters(value("stiffness", f'<ssv:Float64 value="{text}"/>'))))
        with pytest.raises(InputError, match=words):
            flattened(pack(changed.replace('version="1.0"', 'version="2.0"')))


# ---- random slips of somebody who edits a package by hand


def mutated(tree: Any, chance: random.Random) -> str:
    """Changes one thing; returns what."""
    elements = [e for e in tree.iter() if isinstance(e.tag, str)]
    element = chance.choice([e for e in elements if e.attrib])
    key = chance.choice(sorted(element.attrib))
    kind = chance.choice(("drop", "misspell", "empty", "other's", "cut", "double", "move"))
    where = f"{kind} {etree.QName(element).localname}"
    if kind in ("cut", "double", "move") and element.getparent() is not None:
        if kind == "double":
            element.addnext(deepcopy(element))
        else:
            element.getparent().remove(element)
        if kind == "move":
            chance.choice([e for e in tree.iter() if isinstance(e.tag, str)]).append(element)
        return where
    text = element.attrib.pop(key)
    if kind == "misspell":
        element.set(chance.choice((f"{key}s", key.upper(), f"{{urn:x}}{etree.QName(key).localname}")), text)
    elif kind == "empty":
        element.set(key, "")
    elif kind == "other's":
        other = chance.choice([e for e in elements if e.attrib])
        element.set(key, other.get(chance.choice(sorted(other.attrib))))
    return f"{where}.{key}"


MEANT = {  # accepted with another meaning, as the standard has it: what may be left out, and another number
    *(f"cut {e}" for e in ("LinearTransformation", "Parameter", "ParameterBindings", "ParameterBinding")),
    *(f"cut {e}" for e in ("Annotations", "Annotation", "HandOver", "Device", "Master", "DefaultExperiment")),
    *(f"drop {e}" for e in ("LinearTransformation.factor", "LinearTransformation.offset", "HandOver.factor")),
    *(f"drop {e}" for e in ("HandOver.offset", "Connection.suppressUnitConversion", "DefaultExperiment.stopTime")),
    *(f"other's {e}" for e in ("Real.value", "LinearTransformation.factor", "LinearTransformation.offset")),
    *(f"other's {e}" for e in ("HandOver.offset", "HandOver.factor", "DefaultExperiment.stopTime")),
    *(f"other's {e}" for e in ("Connection.startConnector", "Connection.endConnector")),
}


def meaning(found: Flat) -> tuple[Any, ...]:
    """All that a run takes from it."""
    said = found.structure
    return (
        *(found.components, found.feeds, found.inputs, found.outputs, found.units, found.parameters),
        *(found.devices, found.hand_over, said.start, said.stop, said.master),
    )


def test_slips_are_refused_or_said(tmp_path: Path) -> None:
    """A landing with a mapped foreign brace, 120 slips: none is accepted without a word that changes what is run but
    those that the standard gives another meaning."""
    chance = random.Random(23)
    vendor = device(tmp_path / "vendor.fmu", sign=-1.0, angle="deg", torque="N.mm", names=("a", "b"), declared=False)
    (tmp_path / "map.toml").write_text(
        'active = true\n[inputs]\nsubtalar_angle = { to = "a", unit = "deg", offset = 1.5 }\n'
        '[outputs]\nsubtalar_torque = { from = "b", unit = "N.mm", factor = -1 }\n'
    )
    landing = load_scenario("incline30_brace").replace_fmu("brace", vendor, tmp_path / "map.toml")
    export_package(landing, tmp_path / "landing.ssp")
    with zipfile.ZipFile(tmp_path / "landing.ssp") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    before = flattened(tmp_path / "landing.ssp")
    texts = [name for name in files if not name.endswith(".fmu")]
    tally = {"refused": 0, "said": 0, "same": 0, "meant": 0}
    for _ in range(120):
        name = chance.choice(texts)
        tree = etree.fromstring(files[name])
        what = mutated(tree, chance)
        with zipfile.ZipFile(tmp_path / "slip.ssp", "w") as archive:
            for other, content in files.items():
                archive.writestr(other, etree.tostring(tree) if other == name else content)
        try:
            found = flattened(tmp_path / "slip.ssp")
        except InputError:
            tally["refused"] += 1
            continue
        if set(found.notes) - set(before.notes):
            tally["said"] += 1
        elif meaning(found) == meaning(before):
            tally["same"] += 1
        else:
            assert what in MEANT, f"{name}: {what}"
            tally["meant"] += 1
    assert tally["refused"] > 60
    assert tally["said"] > 0


# ---- mappings of values


@pytest.mark.parametrize(
    ("kind", "text", "change", "table", "expected"),
    [
        ("Boolean", "1", "Boolean", {"true": "false"}, False),
        ("Boolean", "false", "Boolean", {"true": "false"}, False),  # not in the table: it stays
        ("Integer", "3", "Integer", {"3": "30"}, 30),
        ("Integer", "4", "Integer", {"3": "30"}, 4),
        ("Enumeration", "hard", "Enumeration", {"hard": "stiff"}, "stiff"),
        ("Enumeration", "soft", "Enumeration", {"hard": "stiff"}, "soft"),
        ("Enumeration", "hard", "Enumeration", {}, "must be one of soft, stiff"),
        ("Int64", "7", "Integer", {"7": "2"}, "stiff"),
        ("Int64", "1", "Integer", {"7": "2"}, "soft"),
        ("Int64", "1", "Enumeration", {"1": "stiff"}, "EnumerationMappingTransformation does not belong"),
        ("Enumeration", "soft", "Integer", {"1": "2"}, "IntegerMappingTransformation does not belong"),
    ],
)
def test_a_mapped_value(kind: str, text: str, change: str, table: dict[str, str], expected: bool | int | str) -> None:
    """What a table does not have stays as it is, as the standard says; the type of the value is that of the table."""
    items = {"soft": 1, "stiff": 2} if kind in ("Enumeration", "Int64") else {}
    connector = Connector("x", 0, "parameter", {"Boolean": "boolean", "Integer": "integer"}.get(kind, "enumeration"))
    value = Assigned("x", kind, text, transformation=Transformation(f"{change}MappingTransformation", table=table))
    if isinstance(expected, str) and " " in expected:
        with pytest.raises(InputError, match=expected):
            value.value(replace(connector, items=items))
    else:
        assert value.value(replace(connector, items=items)) == expected
