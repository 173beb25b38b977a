"""Fuzzes what reads files and typed texts: whatever comes, it gives an object or one error of ours in one line, within
2 s and 500 MB.

    python tools/fuzz.py [--target NAME]... [--seconds 60] [--seed 0] [--found FOLDER] [--keep]

With atheris installed (`pip install atheris`) inputs are chosen by the code that they reach, else by a generator that
edits seeds at random. Seeds are the texts below, the folders that a short run leaves, and what earlier sessions kept in
tools/fuzz_seeds.json; `--keep` adds to it inputs of this session that reach further. Each kind of finding is printed
once, and its input kept in the folder `--found`; the exit code is 1 when there is one."""

from __future__ import annotations

import argparse
import base64
import copy
import json
import os
import random
import re
import resource
import shutil
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).with_name("fuzz_seeds.json")
MOST_TIME = 2.0  # s of processor time for one input
MOST_MEMORY = 500 << 20  # B more than before
LONGEST = 16384  # B of an input
MOST_KEPT, LARGEST_KEPT = 24, 700  # inputs of a target, B of each
SCENARIO = """
base = "incline30"
title = "A brace"
[components.brace]
fmu = "brace_bushing"
[parameters]
"brace.angle_scale" = 2.4
"plant.drop_height" = "0.30 m"
"plant.initial_pose" = "touching"
[connections]
"brace.rotation_x_angle" = "plant.rotation_x_angle"
[master]
communication_step = "0.5 ms"
scheme = "auto"
stop = "150 ms"
"""
STUDY = """
scenario = "incline30_mixed"
title = "A study"
[parameters]
"plant.initial_pose" = "published"
[marginals]
"plant.drop_height" = { lognormal = { mean = "0.30 m", sd = "0.05 m" }, low = "0.1 m" }
"controller.coactivation" = { uniform = { low = 0.1, high = 0.3 } }
"plant.talocrural_angle_at_contact" = { normal = { mean = "-34 deg", sd = "5 deg" } }
[grid]
"controller.reflex_gain" = [0, 5, 10]
[correlation]
"plant.drop_height, controller.coactivation" = 0.3
[study]
method = "monte-carlo"
trials = 16
seed = 20211208
responses = ["peak_subtalar_angle_deg"]
levels = [0.05, 0.5]
threshold = "35 deg"
replicates = 8
space = "x"
step = 0.1
difference = "forward"
[published]
source = "here"
"""
MAPPING = """
active = true
step = "1 ms"
reset = true
[inputs]
subtalar_angle = { to = "In1_InvAngle", unit = "deg", offset = 2.0 }
subtalar_velocity = "In2_InvVel"
[outputs]
subtalar_torque = { from = "M_out", factor = -1, unit = "N.mm" }
"""
TABLE = """angle [deg],subtalar_resistance_loading [N.m],subtalar_resistance_unloading [N.m],talocrural_torque [lbf.in]
-30,-8,-7.5,70
-10,-2,-1.5,
0,0,0,0
10,2,1.5,-12
30,8,7.5,-80
"""
INPUTS = """trial,plant.drop_height [m],controller.coactivation,plant.talocrural_angle_at_contact [deg],status
0,0.30,0.2,-34,completed
1,0.25,0.21,-30,failed
7,0.35,0.19,-31,
"""
CHECKS = """
[[check]]
id = "hold-01"
title = "Brace A holds the ankle"
scenario = "incline30_brace"
set = { "plant.drop_height" = "0.35 m" }
fmu = { brace = "vendor.fmu" }
step = "1 ms"
metric = "peak_subtalar_angle_deg"
expected = 29.0
tolerance = 0.5
why = "repeatability of the rig"
source = "bench test of 12 May"
[[check]]
id = "two"
title = "Of a study"
study = "study6"
trials = 20
statistic = "p95"
metric = "peak_subtalar_angle_deg"
between = [20, 40.5]
why = "so"
source = "here"
"""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="v" guid="{v}" numberOfEventIndicators="0" generationTool="x">
  <CoSimulation modelIdentifier="v" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="false"/>
  <UnitDefinitions><Unit name="rad"><BaseUnit rad="1"/></Unit>
  <Unit name="deg"><BaseUnit rad="1" factor="0.01745"/></Unit>
  <Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit></UnitDefinitions>
  <TypeDefinitions><SimpleType name="K"><Enumeration><Item name="a" value="1"/></Enumeration></SimpleType>
  </TypeDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>
  <ModelVariables>
    <ScalarVariable name="subtalar_angle" valueReference="0" causality="input">
      <Real unit="rad" start="0"/>
    </ScalarVariable>
    <ScalarVariable name="subtalar_torque" valueReference="1" causality="output">
      <Real unit="N.m"/>
    </ScalarVariable>
    <ScalarVariable name="k" valueReference="2" causality="parameter" variability="fixed">
      <Real start="2" min="0" max="9"/>
    </ScalarVariable>
    <ScalarVariable name="kind" valueReference="3" causality="parameter" variability="fixed">
      <Enumeration declaredType="K" start="1"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2" dependencies="1"/></Outputs></ModelStructure>
</fmiModelDescription>
"""
DESCRIPTION_3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="v" instantiationToken="{v}">
  <CoSimulation modelIdentifier="v" hasEventMode="true" fixedInternalStepSize="0.001"/>
  <ModelVariables>
    <Float64 name="subtalar_angle" valueReference="0" causality="input" start="0"/>
    <Float64 name="subtalar_torque" valueReference="1" causality="output"/>
    <Float64 name="a" valueReference="2" causality="parameter" variability="fixed" start="1 2">
      <Dimension start="2"/>
    </Float64>
  </ModelVariables>
  <ModelStructure><Output valueReference="1" dependencies="0"/></ModelStructure>
</fmiModelDescription>
"""
TOKENS = [
    *("", "0", "-1", "1e400", "1e-400", "nan", "inf", "-inf", "true", "false", "99999999999999999999999"),
    *("0x7fffffffffffffff", "9223372036854775808", '""', '"', "'", "'''", '"""', "[", "]", "[[", "{", "}", "{}", "[]"),
    *("=", ",", ".", "\n", "\r", "\t", "#", "\\", "\\u0000", "\0", "\ufeff", "\u202e", "é", "𝔘", "1979-05-27"),
    *("07:32:00", '"0.3"', '"0.3 furlong"', '"1 m"', '"nan m"', '"1e999 m"', '"deg"', '" "', "[1, [2, [3]]]"),
    *("{ a = { b = { c = 1 } } }", '"../../../etc/passwd"', '"/dev/null"', '"."', '"m"', '"N.m"', '"rad^9999999999"'),
    *(
        '"m/m/m"',
        '"1/0"',
        "subtalar_angle",
        "%s",
        "{0}",
        "a" * 300,
        "brace",
        "plant",
        "component",
        "low",
        "mean",
        "unit",
    ),
    *(
        "factor",
        "to",
        "from",
        "fmu",
        "map",
        "base",
        "scheme",
        "subtalar_torque",
        "constants",
        "arm",
        "allow",
        "choices",
    ),
    *("weibull", "beta", "triangular", "empirical", "truncated", "high", "sd", "grid", "sobol", "amv", "form", "lhs"),
]
VALUES: list[Any] = [  # what a value of a JSON file may become
    *(None, True, False, 0, 1, -1, 1e308, -1e308, 10**400, float("nan"), float("inf"), -float("inf"), 1.5, "", "x"),
    *("\x1b[31m\x07", "<script>x</script>", "../..", "/etc/passwd", "a" * 3000, "1", [], {}, [None], {"x": 1}, [[[]]]),
    *([1, 2], [1, "a"], {"value": "a"}, {"": {}}, "completed", "failed", "study", "scenario", "\u202e", "\ud800"),
]


class Wrong(Exception):
    """What an input must not cause."""


def judged(parse: Callable[[], object]) -> None:
    """Calls `parse`; raises Wrong for an error of ours with another exit code, of several lines or none, for control
    characters in a result that is text, and for time."""
    from sprain_cosim.errors import SprainError

    began = time.process_time()
    try:
        parse()
    except SprainError as problem:
        if problem.exit_code != 2 or not str(problem).strip() or "\n" in str(problem):
            raise Wrong(f"{type(problem).__name__} with exit code {problem.exit_code}: {str(problem)!r}") from problem
    if (took := time.process_time() - began) > MOST_TIME:
        raise Wrong(f"took {took:.1f} s")


@dataclass(frozen=True)
class Target:
    """What is fuzzed.

    run    takes one input; an exception is a finding
    seeds  inputs to begin with
    words  that are worth trying
    """

    run: Callable[[bytes], None]
    seeds: Sequence[bytes]
    words: Sequence[str] = field(default_factory=lambda: TOKENS)


# ---- parsers of files and of typed texts


def _file(place: Path, name: str, parse: Callable[[Path], object]) -> Callable[[bytes], None]:
    path = place / name

    def run(data: bytes) -> None:
        path.write_bytes(data)
        judged(lambda: parse(path))

    return run


def _texts(*texts: str) -> list[bytes]:
    return [text.encode() for text in texts]


def archive(path: Path, description: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", description)
        for folder in ("linux64", "x86_64-linux", "aarch64-linux"):
            file.writestr(f"binaries/{folder}/v.so", b"")
    return path


def vendor(folder: Path) -> Path:
    """An FMU to describe; it cannot be run."""
    return archive(folder / "vendor.fmu", DESCRIPTION.replace("subtalar_angle", "In1_InvAngle").encode())


def _device(path: Path, data: bytes) -> object:
    from sprain_cosim.mapping import read_component

    return read_component("brace", archive(path, data), None)


def _unit(text: str) -> object:
    from sprain_cosim.units import quantity, unit

    return unit(text), quantity(text, unit("N.m"), "x"), quantity(text, None, "y")


def _setting(text: str) -> object:
    """The first character says which option it is."""
    from sprain_cosim import cli
    from sprain_cosim.scenario import load_scenario
    from sprain_cosim.study.file import load_study
    from sprain_cosim.study.shards import shard
    from sprain_cosim.study.trajectories import first_trajectories

    kind, text = text[:1], text[1:]
    if kind == "s":
        return cli._changed(load_scenario("incline30_brace"), (), (), (text,), None).system()
    if kind == "t":
        return cli._changed(load_study("study6"), (), (), (text,), None).checked()
    if kind in ("1", "2", "3"):
        return load_scenario("incline30").with_master(*(text if kind == k else None for k in "123")).system()
    if kind == "m":
        return cli._share(text)
    return shard(text) if kind == "h" else first_trajectories(text)


def _decoded(use: Callable[[str], object]) -> Callable[[bytes], None]:
    def run(data: bytes) -> None:
        text = " ".join(data.decode("utf-8", "replace").split())  # an error quotes what was typed
        judged(lambda: use(text))

    return run


def parsers(place: Path) -> dict[str, Target]:
    """Of the files that people write, FMU descriptions and options; `place` is an empty folder."""
    from sprain_cosim.brace.from_csv import read_curves
    from sprain_cosim.mapping import load_mapping, read_component
    from sprain_cosim.scenario import load_scenario
    from sprain_cosim.shipped import scenario_folder
    from sprain_cosim.study.file import load_study
    from sprain_cosim.validation.checks.user_files import read_checks

    study = load_study("study4")
    (place / "checks").mkdir(exist_ok=True)
    shutil.copy(vendor(place), place / "checks")
    shutil.copy(scenario_folder() / "incline30.toml", place / "incline30.toml")
    shipped = [path.read_bytes() for path in sorted(scenario_folder().glob("*.toml"))]
    studies = [path.read_bytes() for path in sorted(scenario_folder().glob("studies/*.toml"))]
    file = partial(_file, place)
    return {
        "scenario": Target(file("s.toml", lambda p: load_scenario(p).system()), [SCENARIO.encode(), *shipped]),
        "study": Target(file("t.toml", lambda p: load_study(p).checked().sample()), [STUDY.encode(), *studies]),
        "mapping": Target(
            file("m.toml", lambda p: (load_mapping(p), read_component("brace", place / "vendor.fmu", p))),
            _texts(MAPPING, MAPPING.replace('subtalar_velocity = "In2_InvVel"\n', "")),
        ),
        "checks": Target(file("checks/c.toml", lambda p: read_checks(p.parent)), _texts(CHECKS)),
        "table": Target(file("a.csv", read_curves), _texts(TABLE)),
        "inputs": Target(file("b.csv", study.with_inputs), _texts(INPUTS)),
        "description": Target(
            file("d.xml", lambda p: _device(place / "d.fmu", p.read_bytes())), _texts(DESCRIPTION, DESCRIPTION_3)
        ),
        "unit": Target(
            _decoded(_unit), _texts("3 N.m", "0.3 kg.m2/s2", "1e3 lbf-in", "-34 deg", "2 m s⁻¹", "1 N·m/(rad.s)")
        ),
        "option": Target(
            _decoded(_setting),
            _texts(
                *("splant.drop_height=0.35 m", "sbrace.angle_scale=1.5", "splant.initial_pose=published", "1auto"),
                *("tplant.drop_height=0.3 m", "20.5 ms", "3150 ms", "m1%", "h1/4", "r100", "rall"),
            ),
        ),
    }


# ---- readers of the folders that runs, studies and comparisons leave


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterable[tuple[Any, ...]]:
    """The keys that lead to every value of a JSON document, itself included."""
    yield path
    for key, item in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from leaves(item, (*path, key))


def edited_json(text: str, orders: Sequence[int]) -> str:
    """Each order, a number of 32 bits, changes one value: another one in its place, or none."""
    content = json.loads(text)
    for order in orders:
        found = list(leaves(content))[1:]
        if not found:
            break
        *way, last = found[(order >> 12) % len(found)]
        holder = content
        for key in way:
            holder = holder[key]
        kind = order % (len(VALUES) + 3)
        if kind < len(VALUES):
            holder[last] = copy.deepcopy(VALUES[kind])
        elif kind == len(VALUES) or isinstance(holder, list):
            del holder[last]
        elif kind == len(VALUES) + 1:
            holder[f"{last}\x1b"] = holder.pop(last)
        else:
            holder[f"{last}_"] = copy.deepcopy(holder[last])
    return json.dumps(content)


def edited_bytes(data: bytes, orders: bytes) -> bytes:
    """A piece of the file replaced: where (2 B), how many (1 B), by what (the rest)."""
    at = int.from_bytes(orders[:2], "little") * (len(data) + 1) >> 16
    length = orders[2] if len(orders) > 2 else 0
    return data[:at] + orders[3:] + data[at + length :]


def make_folders(place: Path) -> list[Path]:
    """A run, a study, a search and a comparison of a few milliseconds each, and what version 0.1 left."""
    import sprain_cosim as sc
    from sprain_cosim.brace.compare import compare_braces
    from sprain_cosim.figures.landings import leave_run
    from sprain_cosim.folders.run import RunSummary

    stop = "10 ms"
    landing = sc.load_scenario("incline30_brace").with_master(stop=stop).recording("plant.*")
    result = landing.run()
    leave_run(place / "run", result, RunSummary.of(landing, result))
    sc.load_study("study6").with_master(stop=stop).run(trials=8, workers=1, out=place / "study", trajectories=1)
    sc.load_study("amv6").with_master(stop=stop).run(workers=1, out=place / "search", trajectories=1)
    compare_braces("incline30", {"soft": "brace_linear"}, stop=stop, out=place / "compared")
    before = ROOT / "tests" / "folders_0_1"
    if before.is_dir():
        shutil.copytree(before, place / "before")
    return [p for p in sorted(place.rglob("*")) if p.is_dir() and texts_in(p)]


def texts_in(folder: Path) -> list[Path]:
    found = [p for p in sorted(folder.rglob("*")) if p.suffix in (".json", ".csv", ".toml", ".sqlite")]
    return found if (folder / "summary.json").is_file() or (folder / "compare.json").is_file() else []


def read_back(folder: Path) -> object:
    """All that looks at a folder without drawing: what it holds, the page's text and numbers, tables for a terminal,
    the ledger with its study, one landing."""
    from sprain_cosim.brace.comparison import comparison_listing
    from sprain_cosim.figures.selection import named_folders, palette_of
    from sprain_cosim.folders.comparison import ComparisonFolder
    from sprain_cosim.folders.landing import load_landings
    from sprain_cosim.folders.read import read_folders
    from sprain_cosim.folders.study import StudyFolder
    from sprain_cosim.report import tables
    from sprain_cosim.report.charts import charts, script_data
    from sprain_cosim.report.verdict import verdicts
    from sprain_cosim.study.folder import recorded_plan, trial_tables
    from sprain_cosim.study.ledger import Ledger
    from sprain_cosim.study.listing import study_listing
    from sprain_cosim.study.manifest import whole_manifest
    from sprain_cosim.study.reproduce import _table

    held = read_folders([folder])
    items = named_folders(held)
    found: list[object] = [verdicts(held, items), script_data(charts(items, palette_of(held)))]
    found += [t(items) for t in (tables.sensitivities_tables, tables.metrics_tables, tables.inputs_tables)]
    found += [tables.numbers_tables(held, items), tables.provenance_tables(items)]
    if isinstance(held[0], ComparisonFolder):
        found.append(comparison_listing(held[0].summary))
    if isinstance(held[0], StudyFolder):
        found += [held[0].trajectory(number) for number in held[0].trajectories]
        found.append((whole_manifest(folder / "manifest.json"), _table(folder)))
        if (folder / "ledger.sqlite").is_file():
            with Ledger.read(folder) as ledger:
                plan = recorded_plan(folder, ledger)
                found += [trial_tables(plan, ledger, None), list(ledger.failed())]
            found.append(study_listing(plan, held[0].summary))
    else:
        found.append(load_landings(folder))
    return found


def folder_readers(place: Path) -> dict[str, Target]:
    """One target for each folder: an input names a file of it and how that is edited."""
    targets = {}
    for folder in make_folders(place):
        files = {path: path.read_bytes() for path in texts_in(folder)}
        listed = [path for path in files for _ in range(5 if path.suffix == ".json" else 1)]

        def run(
            data: bytes, folder: Path = folder, files: Mapping[Path, bytes] = files, listed: list[Path] = listed
        ) -> None:
            path = listed[data[0] % len(listed)] if data else listed[0]
            whole, orders = data[1:2] < b"\x40", data[2:]
            if path.suffix == ".json" and not whole:
                numbers = [int.from_bytes(orders[k : k + 4], "little") for k in range(0, min(len(orders), 16), 4)]
                path.write_text(edited_json(files[path].decode(), numbers))
            else:
                path.write_bytes(edited_bytes(files[path], orders))
            try:
                judged(lambda: read_back(folder))
            finally:
                path.write_bytes(files[path])

        seeds = [bytes([k, 255]) + bytes([7 * k % 256, k, 3 * k % 256, 0]) for k in range(len(listed))]
        name = "-".join(folder.relative_to(place).parts)
        targets[f"folder-{name}"] = Target(run, seeds, [str(v) for v in VALUES if isinstance(v, str)])
    return targets


# ---- engines


def one_of_all(targets: Mapping[str, Target]) -> Target:
    """The targets as one: the first byte says which."""
    listed = list(targets.values())

    def run(data: bytes) -> None:
        if data:
            listed[data[0] % len(listed)].run(data[1:])

    seeds = [bytes([k]) + seed for k, target in enumerate(listed) for seed in target.seeds]
    return Target(run, seeds, list(dict.fromkeys(word for target in listed for word in target.words)))


def by_target(name: str, targets: Mapping[str, Target], inputs: Iterable[bytes]) -> dict[str, list[bytes]]:
    """Inputs under the names of the targets that take them: of a group, the one that the first byte names."""
    groups = {"parsers": False, "folders": True}
    if name not in groups:
        return {name: list(inputs)}
    names = [n for n in targets if n not in groups and n.startswith("folder") == groups[name]]
    found: dict[str, list[bytes]] = {}
    for data in inputs:
        if data:
            found.setdefault(names[data[0] % len(names)], []).append(data[1:])
    return found


class Findings:
    """Every kind of misbehaviour once: its exception, and where in the package it came from."""

    def __init__(self, folder: Path | None) -> None:
        self.folder, self.kinds, self.inputs = folder, dict[str, bytes](), 0
        self.largest_memory, self.longest = 0, 0.0

    def try_one(self, name: str, target: Target, data: bytes) -> None:
        self.inputs += 1
        memory, began = _memory(), time.process_time()
        try:
            target.run(data)
            if (grew := _memory() - memory) > MOST_MEMORY:
                raise Wrong(f"took {grew >> 20} MB")
        except Exception as problem:  # all that is not ours is a finding
            self._note(name, data, problem)
        self.longest = max(self.longest, time.process_time() - began)
        self.largest_memory = max(self.largest_memory, _memory() - memory)

    def _note(self, name: str, data: bytes, problem: Exception) -> None:
        frames = [f for f in traceback.extract_tb(problem.__traceback__) if "sprain_cosim/" in f.filename]
        where = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "fuzz.py"
        text = re.sub(r"[0-9.]+", "#", str(problem)) if isinstance(problem, Wrong) else type(problem).__name__
        kind = f"{name}: {where}: {text[:60]}"
        if kind in self.kinds:
            return
        self.kinds[kind] = data
        print(f"FOUND {name}: {where}: {type(problem).__name__}: {str(problem)[:200]!r}", flush=True)
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / re.sub(r"[^\w.-]+", "_", kind)).write_bytes(data)


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def edited(data: bytes, words: Sequence[bytes], others: Sequence[bytes], chance: random.Random) -> bytes:
    """One to five random edits."""
    for _ in range(chance.randint(1, 5)):
        at, length = chance.randint(0, len(data)), chance.choice((0, 1, 1, 2, 4, 8, 30))
        kind = chance.randrange(5)
        piece = chance.choice(words) if kind < 2 else chance.randbytes(chance.randint(0, 4)) if kind < 4 else b""
        if kind == 4:
            other = chance.choice(others)
            start = chance.randint(0, len(other))
            piece = other[start : start + chance.randint(1, 60)]
        data = data[:at] + piece + data[at + length :]
    return data[:LONGEST]


def at_random(
    name: str,
    target: Target,
    seeds: Sequence[bytes],
    seconds: float,
    seed: int,
    findings: Findings,
    most: int = 1 << 60,
) -> None:
    """The seeds, then edited ones: `most` inputs at most."""
    chance, words = random.Random(f"{name} {seed}"), [word.encode("utf-8", "surrogatepass") for word in target.words]
    end = time.monotonic() + seconds
    for data in seeds[:most]:
        findings.try_one(name, target, data)
    while time.monotonic() < end and findings.inputs < most:
        findings.try_one(name, target, edited(chance.choice(seeds), words, seeds, chance))


def by_coverage(
    name: str, target: Target, seeds: Sequence[bytes], seconds: float, seed: int, findings: Findings, corpus: Path
) -> None:
    """With atheris in a child, since libFuzzer ends its process."""
    import atheris

    corpus.mkdir(parents=True, exist_ok=True)
    for k, data in enumerate(seeds):
        (corpus / f"seed-{k:04}").write_bytes(data)
    words = corpus.with_suffix(".dict")
    escaped = ("".join(f"\\x{byte:02x}" for byte in w.encode("utf-8", "surrogatepass")) for w in target.words if w)
    words.write_text("".join(f'"{word[: 4 * 120]}"\n' for word in escaped))
    options = [f"-max_total_time={round(seconds)}", f"-seed={seed + 1}", f"-max_len={LONGEST}", f"-dict={words}"]
    options += ["-timeout=30", "-rss_limit_mb=4000", "-print_final_stats=1", "-verbosity=0"]
    pid = os.fork()
    if not pid:
        atheris.Setup([sys.argv[0], *options, str(corpus)], lambda data: findings.try_one(name, target, data))
        atheris.Fuzz()  # never comes back
    os.waitpid(pid, 0)


@cache
def kept() -> dict[str, list[bytes]]:
    """{target: inputs}"""
    content = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    return {name: [base64.b85decode(text) for text in texts] for name, texts in content.items()}


def keep(found: Mapping[str, Iterable[bytes]]) -> None:
    """Adds inputs of a corpus, small and large ones alike, to those that are kept: MOST_KEPT for each target in all."""
    content = {name: list(inputs) for name, inputs in kept().items()}
    for name, inputs in found.items():
        before = content.get(name, [])
        fresh = sorted((data for data in {*inputs} - {*before} if len(data) <= LARGEST_KEPT), key=lambda d: (len(d), d))
        content[name] = [*before, *fresh[:: max(1, len(fresh) // MOST_KEPT)]][:MOST_KEPT]
    texts = {name: [base64.b85encode(data).decode() for data in inputs] for name, inputs in sorted(content.items())}
    KEPT.write_text(json.dumps(texts, indent=1) + "\n")


def main() -> int:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--target", action="append", default=[], help="several; `parsers`, `folders` are groups")
    arguments.add_argument("--seconds", type=float, default=60.0, help="for each target")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--found", type=Path, help="folder for inputs that are findings")
    arguments.add_argument("--corpus", type=Path, help="folder for what atheris finds worth keeping")
    arguments.add_argument("--engine", choices=("coverage", "random"))
    arguments.add_argument("--keep", action="store_true", help="add some of the corpus to the seeds")
    chosen = arguments.parse_args()
    sys.path.insert(0, str(ROOT))
    engine = chosen.engine or ("coverage" if find_spec("atheris") else "random")
    if engine == "coverage":
        import pkgutil

        import atheris

        with atheris.instrument_imports(include=["sprain_cosim", "tomllib"]):
            import sprain_cosim

            for module in pkgutil.walk_packages(sprain_cosim.__path__, "sprain_cosim."):
                if not module.name.endswith("__main__"):
                    __import__(module.name)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        targets: dict[str, Target] = {}
        if not chosen.target or any(not name.startswith("folder") for name in chosen.target):
            (place / "parsers").mkdir()
            targets |= parsers(place / "parsers")
        if not chosen.target or any(name.startswith("folder") for name in chosen.target):
            (place / "folders").mkdir()
            targets |= folder_readers(place / "folders")
        findings = Findings(chosen.found)
        picked = [n for n in targets if not chosen.target or n in chosen.target]
        if "parsers" in chosen.target:
            targets["parsers"] = one_of_all({n: t for n, t in targets.items() if not n.startswith("folder")})
            picked.append("parsers")
        if "folders" in chosen.target:
            targets["folders"] = one_of_all({n: t for n, t in targets.items() if n.startswith("folder")})
            picked.append("folders")
        for name in picked:
            target = targets[name]
            seeds = [*target.seeds, *kept().get(name, [])]
            if engine == "coverage":
                corpus = (chosen.corpus or place / "corpus") / name
                by_coverage(name, target, seeds, chosen.seconds, chosen.seed, findings, corpus)
                if chosen.keep:
                    keep(by_target(name, targets, (path.read_bytes() for path in corpus.iterdir())))
            else:
                at_random(name, target, seeds, chosen.seconds, chosen.seed, findings)
                print(
                    f"{name}: {findings.inputs} inputs so far, {len(findings.kinds)} kinds of findings, longest "
                    f"{findings.longest:.2f} s, +{findings.largest_memory >> 20} MB"
                )
    return 1 if findings.kinds else 0


if __name__ == "__main__":
    sys.exit(main())
