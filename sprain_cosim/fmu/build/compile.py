"""Devices compiled ahead of time: Python functions -> numba's types and LLVM IR -> one object file for each target.

Runs in processes of its own (`sprain_cosim.fmu.build`), so that a device's code, numba's settings and
its memory stay out of the caller's, and hashes are the same in every build. numba and llvmlite are imported here alone;
what is used of them that is no API is pinned by the build's requirements and watched by tests/fmi/test_compile.py.

Order: the subset is checked; every function is typed and lowered without being compiled for this process; the modules
are linked into one; everything but the entries becomes internal. Per target: dead code and numba's reference counts go
first, because counting blocks the vectoriser, then LLVM's O3. Two gates: no address of the building process is left in
the code, and every symbol that is left open is on the list of what the C library or the shim gives."""

from __future__ import annotations

import gc
import json
import os
import pickle
import re
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from ...errors import EnvironmentProblem, InputError, SprainError
from ...files import read_json
from ...process import python_command, run_program
from . import subset
from .device import Device, Reason, arguments, read_device
from .experiment import experiment
from .packing import digest

ENVIRONMENT = {
    "NUMBA_OPT": "0",  # optimised once, by `emit`, for each target
    "NUMBA_DISABLE_INTEL_SVML": "1",
    "NUMBA_DISABLE_JIT": "0",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "PYTHONHASHSEED": "0",
    "PYTHONDONTWRITEBYTECODE": "1",
}
NEEDED = 'the extra [build]: pip install "sprain-cosim[build]"; in a clone: pip install -e ".[build]"'
COMPILING = ("numba", "llvmlite", "mujoco")
MATH = {
    *("acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil", "copysign", "cos", "cosh", "exp"),
    *("exp2", "expm1", "fabs", "floor", "fmod", "hypot", "ldexp", "log", "log10", "log1p", "log2", "pow", "round"),
    *("sin", "sinh", "sqrt", "tan", "tanh", "trunc", "sincos", "fma", "remainder", "nearbyint", "rint"),
    *("expf", "sqrtf", "sinf", "cosf", "logf", "powf"),
}
ALLOWED = MATH | {"memcpy", "memmove", "memset"}
LARGE = 1_000_000  # characters of IR
OUTCOME, CODE, OBJECT = "outcome.json", "code.pickle", "object.o"


@dataclass(frozen=True)
class Target:
    """`levels`: processors for which code is made, by rising level; the library chooses among them when it is
    loaded."""

    triple: str
    levels: tuple[str, ...]


TARGETS = {
    "linux64": Target("x86_64-unknown-linux-gnu", ("x86-64-v2", "x86-64-v3")),
    "win64": Target("x86_64-w64-windows-gnu", ("x86-64-v2", "x86-64-v3")),
    "darwin64": Target("x86_64-apple-macosx11.0.0", ("x86-64-v2", "x86-64-v3")),
    "aarch64-linux": Target("aarch64-unknown-linux-gnu", ("generic",)),
    "aarch64-darwin": Target("arm64-apple-macosx11.0.0", ("apple-m1",)),
}


@dataclass(frozen=True)
class Compiled:
    """A device ready for the linker.

    - `objects`: {(platform, level): object file}
    - `symbol`: {function of FUNCTIONS: the name under which it stands in the objects}
    - `takes`, `returns`: of each symbol, its arguments and whether it returns a position in `reasons`
    - `sources`: digest of all modules of its package and of what compiles them
    - `files`: {path in the FMU: content} that the device adds; `experiment`: of its reference experiment
    - `native`, `include`: source of its own functions in C and the folder of their headers; empty without
    """

    name: str
    objects: Mapping[tuple[str, str], bytes]
    symbol: Mapping[str, str]
    takes: Mapping[str, tuple[str, ...]]
    returns: Mapping[str, bool]
    first_state: bytes
    saved: int
    constants: bytes
    constants_in_resources: bool
    reasons: tuple[Reason, ...]
    sources: str
    files: Mapping[str, bytes]
    experiment: Mapping[str, bytes]
    native: str
    include: str

    @property
    def slices(self) -> frozenset[str]:
        """Of platforms, those that there is code for."""
        return frozenset(part for part, _ in self.objects)


def prefix(level: str) -> str:
    """Of the C names of the functions compiled for a level of the processor."""
    return "device_" + level.replace("-", "_")


def compile_devices(folders: Sequence[Path], platforms: Sequence[str]) -> list[Compiled]:
    """Compiles the devices one after the other in a process of their own. Raises InputError where a device is at fault,
    EnvironmentProblem where the compiler is not installed."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        found = _apart("devices", work, ",".join(platforms), *map(str, folders))
        return [_read(work / str(k), entry) for k, entry in enumerate(found)]


def _apart(task: str, work: Path, *arguments: str) -> Any:
    """What a task of TASKS returns, run in a process of its own. Raises what it raises."""
    ended = run_program([*python_command(__package__), task, str(work), *arguments], environment=ENVIRONMENT)
    outcome = work / OUTCOME
    if not outcome.is_file():
        last = (ended.stderr.strip().splitlines() or [f"exit code {ended.returncode}"])[-1]
        raise EnvironmentProblem(f"the compiler of devices ended without a result: {last}")
    found = read_json(outcome)
    if "error" in found:
        raise {"InputError": InputError}.get(found["kind"], EnvironmentProblem)(found["error"])
    return found["result"]


def _read(folder: Path, entry: dict[str, Any]) -> Compiled:
    return Compiled(
        entry["name"],
        {(platform, level): (folder / file).read_bytes() for platform, level, file in entry["objects"]},
        entry["symbol"],
        {name: tuple(takes) for name, takes in entry["takes"].items()},
        entry["returns"],
        (folder / "state.bin").read_bytes(),
        entry["saved"],
        (folder / "constants.bin").read_bytes(),
        entry["constants_in_resources"],
        tuple(Reason(*reason) for reason in entry["reasons"]),
        entry["sources"],
        {name: (folder / file).read_bytes() for name, file in entry["files"].items()},
        {name: (folder / file).read_bytes() for name, file in entry["experiment"].items()},
        entry["native"],
        entry["include"],
    )


# ---- the processes that compile


def run_task(task: str, work: Path, *arguments: str) -> None:
    """Writes OUTCOME and what belongs to it into `work`."""
    gc.disable()  # a process that ends with its task; looking for cycles takes a seventh of numba's time
    outcome: dict[str, Any]
    try:
        outcome = {"result": TASKS[task](work, *arguments)}
    except SprainError as problem:
        outcome = {"kind": type(problem).__name__, "error": str(problem)}
    (work / OUTCOME).write_text(json.dumps(outcome), "utf-8")


def _devices(work: Path, platforms: str, *folders: str) -> list[dict[str, Any]]:
    """A folder in `work` for each device, named by its position."""
    return [_write(work / str(k), Path(folder), platforms.split(",")) for k, folder in enumerate(folders)]


def _object(work: Path, triple: str, level: str) -> None:
    """The object file of the code in `work`, beside it."""
    code: Code = pickle.loads((work / CODE).read_bytes())
    (work / OBJECT).write_bytes(emit(code, triple, level))


TASKS: Mapping[str, Callable[..., Any]] = {"devices": _devices, "object": _object}


def _write(target: Path, folder: Path, platforms: Sequence[str]) -> dict[str, Any]:
    try:
        device = read_device(folder)
    except SprainError:
        raise
    except ModuleNotFoundError as problem:
        if problem.name in COMPILING:
            raise _missing(problem) from None
        raise InputError(_in_one_line(problem, folder)) from None
    except Exception as problem:  # both files are run
        raise InputError(_in_one_line(problem, folder)) from None
    code, returns = lower(device)
    target.mkdir()
    able = [p for p in platforms if not device.platforms or p in device.platforms]
    wanted = [(p, TARGETS[p].triple, level) for p in able for level in TARGETS[p].levels]
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        # LLVM does one thing at a time in a process; to start another one pays for much code only
        emitted: Iterable[bytes]
        if len(code.ir) > LARGE:
            emitted = threads.map(lambda goal: _emitted_apart(code, *goal[1:]), wanted)
        else:
            emitted = (emit(code, triple, level) for _, triple, level in wanted)
        files = _kept(target / "files", device.files)
        played = _kept(target / "experiment", _experiment(folder))
        objects = []
        for (platform, _, level), content in zip(wanted, emitted, strict=True):
            objects.append((platform, level, f"{platform}-{level}.o"))
            (target / objects[-1][-1]).write_bytes(content)
    (target / "state.bin").write_bytes(device.first_state.tobytes())
    (target / "constants.bin").write_bytes(b"" if device.constants is None else device.constants.tobytes())
    return {
        "name": device.name,
        "objects": objects,
        "symbol": symbols(device),
        "takes": {name: arguments(device.functions[name]) for name in set(symbols(device).values())},
        "returns": returns,
        "saved": device.saved,
        "constants_in_resources": device.constants_in_resources,
        "reasons": [(r.format, r.offset) for r in device.reasons],
        "sources": _sources(device),
        "files": files,
        "experiment": played,
        "native": (folder / "native.c").read_text("utf-8") if device.native else "",
        "include": str(device.include or ""),
    }


def _missing(problem: ImportError) -> EnvironmentProblem:
    return EnvironmentProblem(f"{problem.name} is not installed; to compile devices, {NEEDED}")


def _kept(folder: Path, files: Mapping[str, bytes]) -> dict[str, str]:
    """{name: path beside `folder`} of files that are written there."""
    folder.mkdir()
    for k, content in enumerate(files.values()):
        (folder / str(k)).write_bytes(content)
    return {name: f"{folder.name}/{k}" for k, name in enumerate(files)}


def _experiment(folder: Path) -> dict[str, bytes]:
    """Of the device read once more, with functions that numba leaves alone."""
    from numba import config

    settings: Any = config
    settings.DISABLE_JIT = True
    try:
        return experiment(read_device(folder))
    finally:
        settings.DISABLE_JIT = False


def symbols(device: Device) -> dict[str, str]:
    """{function of FUNCTIONS: name of its code}; `initialise = step = refresh` is one, under its own name."""
    own = {f: f.__name__ for f in device.functions.values() if device.functions.get(f.__name__) is f}
    first: dict[Any, str] = {}
    return {name: own.get(f) or first.setdefault(f, name) for name, f in sorted(device.functions.items())}


def _sources(device: Device) -> str:
    import llvmlite
    import numba

    files = {m.__name__: Path(str(m.__file__)).read_bytes() for m in device.modules if getattr(m, "__file__", None)}
    return digest(files | {"numba": numba.__version__.encode(), "llvmlite": llvmlite.__version__.encode()})


def _in_one_line(problem: Exception, folder: Path) -> str:
    """Which line of the device's files raised it."""
    if isinstance(problem, SyntaxError):
        return f"{folder / Path(problem.filename or 'device.py').name}: {problem.msg} in line {problem.lineno}"
    import traceback

    places = [f for f in traceback.extract_tb(problem.__traceback__) if Path(f.filename).parent == folder.resolve()]
    where = f"{folder / Path(places[-1].filename).name}, line {places[-1].lineno}" if places else str(folder)
    return f"{where}: {type(problem).__name__}: {problem}"


@dataclass(frozen=True)
class Code:
    """Lowered code of the device in `folder`, the same for all targets: `ir` defines device_NAME for each NAME in
    `entries`; `native` are the functions that the linker adds."""

    folder: Path
    ir: str
    entries: tuple[str, ...]
    native: tuple[str, ...]


def lower(device: Device) -> tuple[Code, dict[str, bool]]:
    """All functions in one module, and whether each returns a number.
    Raises InputError naming the line and what cannot be compiled."""
    records = {"values": device.values, "seed": device.values, "result": device.values, "state": device.state}
    fields = {name: record.names or () for name, record in records.items()}
    refused = subset.problems(device.functions.values(), fields)
    if refused:
        raise InputError(f"{device.folder}: {'; '.join(refused)}; {subset.WAY_OUT}")
    try:
        import llvmlite.binding as llvm
        from numba import types
        from numba.np.numpy_support import from_dtype
    except ImportError as problem:
        raise _missing(problem) from None
    compilable = Compilable(device)
    for module in device.modules:
        for name, value in list(vars(module).items()):
            replaced = compilable.form(value)
            if replaced is not None:
                setattr(module, name, replaced)
    for name in device.native:
        llvm.add_symbol(name, 1)  # the linker's; numba wants to find it in this process, where nothing calls it
    nothing = np.dtype([("none", "f8")])
    kinds = {
        **dict.fromkeys(("values", "seed", "result"), from_dtype(device.values)),
        "state": from_dtype(device.state if device.state.names else nothing),
        "constants": from_dtype(nothing if device.constants is None else device.constants.dtype),
        "time": types.float64,
        "step": types.float64,
    }
    returns: dict[str, bool] = {}
    entries: dict[str, str] = {}
    for name in sorted(set(symbols(device).values())):
        function = device.functions[name]
        result = _typed(device, name, compilable.form(function), tuple(kinds[a] for a in arguments(function)))
        returns[name] = result.signature.return_type == types.int64
        entries[result.fndesc.llvm_func_name] = f"device_{name}"
    whole = llvm.parse_assembly("")
    for text in compilable.modules():
        whole.link_in(llvm.parse_assembly(text))
    for mangled, name in entries.items():
        whole.get_function(mangled).name = name
    _hide(whole, set(entries.values()))
    return Code(device.folder, _with_plain_texts(str(whole)), tuple(returns), device.native), returns


def _typed(device: Device, name: str, dispatcher: Any, signature: tuple[Any, ...]) -> Any:
    """numba's result for one function of the device."""
    from numba import types
    from numba.core.errors import NumbaError

    try:
        dispatcher.compile(signature)
    except NumbaError as problem:
        raise InputError(_refusal(device, name, str(problem))) from None
    except Exception as problem:  # what numba did not foresee
        raise InputError(_refusal(device, name, f"{type(problem).__name__}: {problem}")) from None
    result = dispatcher.overloads[signature]
    returned = result.signature.return_type
    if returned not in (types.none, types.int64):
        raise InputError(
            f"{device.folder / 'device.py'}: {name} returns {returned}; it may return nothing, or on every way a "
            "whole number, a position in REASONS"
        )
    return result


def _hide(module: Any, entries: Collection[str]) -> None:
    """Nothing but the entries can be seen by the linker."""
    for symbol in module.functions:
        if not symbol.is_declaration:
            symbol.linkage = "external" if symbol.name in entries else "internal"
            if symbol.name in entries:
                symbol.visibility = "hidden"
    for symbol in module.global_variables:
        if not symbol.is_declaration:
            symbol.linkage = "internal"
    module.verify()


def _with_plain_texts(ir: str) -> str:
    """The errors that compiled functions raise stand in the IR as pickles with the path of the source; what the shim
    shows to the host is a line of text in their place."""
    sizes: dict[str, int] = {}

    def plain(found: re.Match[str]) -> str:
        data = re.sub(rb"\\([0-9A-F]{2})", lambda m: bytes([int(m[1], 16)]), found[3].encode("latin-1"))
        try:
            kind, said_with, place = pickle.loads(data)
            text = f"{kind.__name__}: {', '.join(map(str, said_with or ()))}".removesuffix(": ")
            text += f" ({Path(place[1]).name}, line {place[2]})" if place else ""
        except Exception:  # an error class of the device's own
            text = "an error"
        message = text.encode()
        sizes[found[1]] = len(message)
        body = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\' else f"\\{b:02X}" for b in message)
        return f'{found[1]}{found[2]}[{len(message)} x i8] c"{body}"'

    ir = re.sub(
        r'^(@\.const\.pickledata\.[0-9a-f]+(?:\.\d+)*)( = .*?constant )\[\d+ x i8\] c"([^"]*)"',
        plain,
        ir,
        flags=re.MULTILINE,
    )
    return re.sub(r"(\{ ptr (@\.const\.pickledata[\w.]+), i32 )\d+", lambda m: f"{m[1]}{sizes[m[2]]}", ir)


def _ahead_of_time(libraries: list[Any], apart: bool) -> Any:
    """numba's compiler without the machine code for this process, which nobody would call; every function's code goes
    into `libraries`, for one link at the end instead of one at every caller. `apart`: no two arguments share memory."""
    from numba.core.compiler import Compiler

    class AheadOfTime(Compiler):
        def __init__(self, typing_context, target_context, library, args, return_type, flags, variables):  # type: ignore[no-untyped-def]
            flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
            flags.noalias = apart
            super().__init__(  # type: ignore[no-untyped-call]
                typing_context, target_context, library, args, return_type, flags, variables
            )

        def compile_extra(self, function):  # type: ignore[no-untyped-def]
            compiled = super().compile_extra(function)  # type: ignore[no-untyped-call]
            key: Any = [].append  # the dispatcher wants a built-in function of its own as the key of this overload
            self.state.targetctx.insert_user_function(key, compiled.fndesc, [])
            libraries.append(compiled.library)
            return compiled._replace(entry_point=key)

    return AheadOfTime


class Compilable:
    """The functions of one device in the form that is compiled ahead of time, each made once."""

    def __init__(self, device: Device) -> None:
        self._own = {m.__name__ for m in device.modules}
        self._libraries: list[Any] = []
        self._compilers = {apart: _ahead_of_time(self._libraries, apart) for apart in (False, True)}
        self._made: dict[Any, Any] = {}

    def modules(self) -> list[str]:
        """IR of every function that was compiled, and of what numba itself wrote for it."""
        from numba.core.compiler_lock import global_compiler_lock

        with global_compiler_lock:
            for library in self._libraries:
                library._ensure_finalized()
        return [library.get_llvm_str() for library in self._libraries]

    def form(self, value: Any) -> Any:
        """Of a plain function of the device's package, or of one that is decorated for numba already; else None."""
        from numba.core.registry import CPUDispatcher

        if isinstance(value, CPUDispatcher) and value.py_func.__module__ in self._own:
            options = {k: v for k, v in value.targetoptions.items() if k in ("error_model", "fastmath", "inline")}
            return self._once(value.py_func, options)
        if (
            isinstance(value, FunctionType)
            and value.__module__ in self._own
            and value.__name__ not in ("constants", "files")
        ):
            return self._once(value, {"error_model": "python"})
        return None

    def _once(self, function: Any, options: dict[str, Any]) -> Any:
        from numba import njit

        if function not in self._made:
            compiler = self._compilers[getattr(function, "apart", False)]
            self._made[function] = njit(pipeline_class=compiler, **options)(function)
        return self._made[function]


def _refusal(device: Device, name: str, text: str) -> str:
    """numba's explanation in one line: its innermost reason and place in the device's own files."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    own = {path.name for path in device.folder.glob("*.py")}
    found = re.findall(r'(?:File "|at )([^"\n]+?\.py)(?:", line |:? \()(\d+)', text)
    places = [(Path(f).name, n) for f, n in found if Path(f).name in own and Path(f).parent.name == device.folder.name]
    lines = [line.strip(" -*>\t") for line in text.splitlines()]
    reasons = re.findall(r"(?:NumbaTypeError|NumbaValueError|TypingError|NameError): (.+)", text)[-1:]
    reasons += [line for line in lines if line and not line.startswith(("Failed in", "During:", "File ", "def "))]
    where = f"{places[0][0]}, line {places[0][1]}" if places else "device.py"
    return f"{device.folder}: {name} cannot be compiled: {where}: {reasons[0]}; {subset.WAY_OUT}"


def _emitted_apart(code: Code, triple: str, level: str) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / CODE).write_bytes(pickle.dumps(code))
        _apart("object", work, triple, level)
        return (work / OBJECT).read_bytes()


def emit(code: Code, triple: str, level: str) -> bytes:
    """The object file for a processor. Raises InputError where a gate refuses."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = llvm.parse_assembly(re.sub(r"^target (triple|datalayout).*$", "", code.ir, flags=re.MULTILINE))
    for name in code.entries:
        module.get_function(f"device_{name}").name = f"{prefix(level)}_{name}"
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=level, features="", opt=3, reloc="pic", codemodel="default"
    )
    module.triple, module.data_layout = triple, str(machine.target_data)

    def passes(vectorise: bool) -> Any:
        tuning = llvm.create_pipeline_tuning_options(speed_level=3)
        tuning.loop_vectorization, tuning.slp_vectorization = vectorise, vectorise
        return llvm.create_pass_builder(machine, tuning)

    clean = llvm.create_new_module_pass_manager()
    clean.add_global_dead_code_eliminate_pass()
    builder = passes(False)
    clean.run(module, builder)
    functions = builder.getFunctionPassManager()
    functions.add_refprune_pass()
    for function in module.functions:
        if not function.is_declaration:
            functions.run(function, builder)
    cheap = builder.getModulePassManager()
    for add in ("loop_rotate", "instruction_combine", "jump_threading", "refprune"):
        getattr(cheap, f"add_{add}_pass")()
    cheap.run(module, builder)
    builder = passes(True)
    builder.getModulePassManager().run(module, builder)
    clean.run(module, builder)
    _gates(code, str(module))
    _anonymise(module)
    return bytes(machine.emit_object(module))


def _anonymise(module: Any) -> None:
    """Names that only the device's source knows go: not every linker strips them."""
    for kind, symbols_of in (("function", module.functions), ("data", module.global_variables)):
        inside = [s for s in symbols_of if not s.is_declaration and s.linkage.name in ("internal", "private")]
        for k, symbol in enumerate(inside):
            symbol.name = f"{kind}_{k}"


def _gates(code: Code, ir: str) -> None:
    """Nothing of this process may be left in `ir`, emitted from `code`, and nothing that the host's C library does not
    have."""
    if re.search(r"inttoptr \(i64 -?\d{5,}", ir):
        raise InputError(
            f"{code.folder / 'device.py'}: the compiled code would hold an address of the building process; a "
            "global object that is neither a number, a tuple nor an array stands in it"
        )
    opened = {m.strip('"') for m in re.findall(r'^declare .*?@([\w.$]+|"[^"]+")', ir, re.MULTILINE)}
    unknown = sorted(n for n in opened if n not in ALLOWED and n not in code.native and not n.startswith("llvm."))
    if unknown:
        raise InputError(
            f"{code.folder / 'device.py'}: {', '.join(unknown)}: no function that every host has; {subset.WAY_OUT}"
        )
