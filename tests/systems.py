"""Documents of SSP, written from parts."""

from __future__ import annotations

SPACES = "".join(
    f' xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for short, name in (
        ("ssc", "Common"),
        ("ssd", "Description"),
        ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
        ("ssb", "SignalDictionary"),
    )
)
UNITS = """<ssd:Units>
    <ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>
    <ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit>
    <ssc:Unit name="N.m"><ssc:BaseUnit kg="1" m="2" s="-2"/></ssc:Unit>
    <ssc:Unit name="N.mm"><ssc:BaseUnit kg="1" m="2" s="-2" factor="0.001"/></ssc:Unit>
    <ssc:Unit name="N.m/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1"/></ssc:Unit>
    <ssc:Unit name="kN.m/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1" factor="1000"/></ssc:Unit>
</ssd:Units>"""


def real(name: str, kind: str, unit: str = "") -> str:
    stated = f' unit="{unit}"' if unit else ""
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{stated}/></ssd:Connector>'


def wire(start: str, end: str, inside: str = "", more: str = "") -> str:
    (one, a), (other, b) = (x.rpartition(".")[::2] for x in (start, end))
    ends = f'{f"startElement={chr(34)}{one}{chr(34)}" if one else ""} startConnector="{a}" '
    ends += f'{f"endElement={chr(34)}{other}{chr(34)}" if other else ""} endConnector="{b}"'
    return f"<ssd:Connection {ends} {more}>{inside}</ssd:Connection>"


def component(name: str, connectors: str, inside: str = "", source: str = "", more: str = "") -> str:
    return (
        f'<ssd:Component name="{name}" source="{source or f"resources/{name}.fmu"}" {more}>'
        f"<ssd:Connectors>{connectors}</ssd:Connectors>{inside}</ssd:Component>"
    )


def system(elements: str, connections: str = "", connectors: str = "", inside: str = "", name: str = "device") -> str:
    shown = f"<ssd:Connectors>{connectors}</ssd:Connectors>" if connectors else ""
    joined = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
    return f'<ssd:System name="{name}">{shown}{inside}<ssd:Elements>{elements}</ssd:Elements>{joined}</ssd:System>'


def structure(content: str, units: str = UNITS, more: str = "", version: str = "1.0") -> str:
    head = f'<ssd:SystemStructureDescription{SPACES} version="{version}" name="test">'
    return f"{head}{content}{units}{more}</ssd:SystemStructureDescription>"


def parameters(values: str, units: str = "") -> str:
    return (
        f'<ssv:ParameterSet{SPACES} version="1.0" name="p"><ssv:Parameters>{values}</ssv:Parameters>{units}'
        "</ssv:ParameterSet>"
    )


def value(name: str, inside: str) -> str:
    return f'<ssv:Parameter name="{name}">{inside}</ssv:Parameter>'


STIFF = value("stiffness", '<ssv:Real value="30"/>')


def binding(inside: str = "", mapping: str = "", more: str = "") -> str:
    values = f"<ssd:ParameterValues>{inside}</ssd:ParameterValues>" if inside else ""
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {more}>{values}{mapping}</ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )


def inline_mapping(entries: str) -> str:
    content = f'<ssm:ParameterMapping{SPACES} version="1.0">{entries}</ssm:ParameterMapping>'
    return f"<ssd:ParameterMapping>{content}</ssd:ParameterMapping>"


PLAIN = component("brace", real("subtalar_angle", "input", "rad") + real("subtalar_torque", "output", "N.m"))
OUTSIDE = real("subtalar_angle", "input") + real("subtalar_torque", "output")
THROUGH = wire("subtalar_angle", "brace.subtalar_angle") + wire("brace.subtalar_torque", "subtalar_torque")
DEVICE = structure(system(PLAIN, THROUGH, OUTSIDE))
LINEAR = '<ssc:LinearTransformation factor="{}" offset="{}"/>'
TO_DEG = LINEAR.format(57.29577951308232, 0.0)


def annotated(content: str, element: str, annotation: str) -> str:
    """The document with an annotation of ours at the end of the first such element."""
    end = content.index(f"</ssd:{element}>")
    note = f'<ssc:Annotation type="x"><own:{annotation} xmlns:own="urn:sprain-cosim:ssp:1"/></ssc:Annotation>'
    return f"{content[:end]}<ssd:Annotations>{note}</ssd:Annotations>{content[end:]}"
