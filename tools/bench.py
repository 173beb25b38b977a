"""Speed, side by side in one run. Run: make bench, or python tools/bench.py [--repeat N].

Prints the time of one landing driven directly and co-simulated, here and with the same FMUs under libcosim and CoFmuPy
(each installed once into an environment of its own below build/peers, where that is possible; --no-peers leaves them
out); the parts of each; and how the cost grows with tolerance, communication step and number of facets. Best of N
repetitions on one core. Then what a population costs beside one person: pairs of studies in turn."""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np
from numba import njit

sys.path.insert(0, str(Path(__file__).parent.parent))

from fmus.plant import kernels
from fmus.plant.constants import sole
from fmus.plant.plant import Landing, Plant
from sprain_cosim.process import python_command
from sprain_cosim.scenario import load_scenario
from sprain_cosim.study.evaluation import summarise
from sprain_cosim.study.file import load_study
from sprain_cosim.study.folder import load_study_plan, trial_tables
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.study.worker import Worker

STOP, STEP = 0.150, 5e-4
OPENSIM = 6.3  # s per landing, median, OpenSim 4.6 on the same class of machine


def best(run: Callable[[], object], repeat: int) -> float:
    """Shortest wall time [s]."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def direct(plant: Plant, landing: Landing, step: float = STOP) -> None:
    plant.state["excitation"] = 0.0
    plant.start(landing)
    for k in range(round(STOP / step)):
        plant.advance((k + 1) * step)
        plant.observe()


@njit
def repeat_part(which, n, model, state, facets, blocks):  # type: ignore[no-untyped-def]
    m, s = model[0], state[0]
    out = np.empty(kernels.NQ)
    for _ in range(n):
        if which == 0:
            kernels.skeleton(m, s, 0, s.q, s.u)
        elif which == 1:
            kernels.paths(m, s, s.mtu[0], s.mtu_rate[0])
        elif which == 2:
            kernels.muscles(m, s, 0, s.a, s.l)
        elif which == 3:
            kernels.contact(m, s, facets, blocks, 0)
        elif which == 4:
            for k in range(kernels.NQ):
                s.right[k] = s.force[0, k]
            kernels.factorise(s.mass[0], s.damp, s.ankle_damp[0], 1e-4, s.rows, s.columns, s.pivot, s.inverse)
            kernels.solve(s, s.right, out)
        else:
            kernels.evaluate(m, s, facets, blocks, 0, s.q, s.u, s.a, s.l)


def parts(repeat: int) -> dict[str, float]:
    """Microseconds per call of the parts of one evaluation, in the middle of the contact."""
    plant = Plant()
    plant.start(Landing())
    plant.advance(0.06)
    names = ("skeleton", "paths", "muscles", "contact with damping", "factor and solve", "one evaluation")
    out = {}
    for which, name in enumerate(names):
        call = lambda: repeat_part(which, 1000, plant._model, plant._state, plant._facets, plant._blocks)  # noqa: B023, E731
        call()
        out[name] = 1e3 * best(call, repeat)
    return out


def traffic(name: str) -> tuple[float, dict[str, float], dict[str, float], float]:
    """Wall time of a run [s], microseconds per communication step spent in each member's calls, wall time [s] by
    communication step, cost of the default coupling over that of plain Gauss-Seidel at the same step."""
    spent: dict[str, float] = defaultdict(float)
    with load_scenario(name).open() as session:
        plain = best(lambda: session.run().metrics, 15)
        assert session._assembly is not None
        for member in session._assembly.members:
            for call in (
                "set_inputs",
                "get_outputs",
                "get_outputs_without_feedthrough",
                "get_feedthrough_outputs",
                "do_step",
            ):
                inner = getattr(member.instance, call)

                def timed(
                    *arguments: object, inner: Callable = inner, key: str = f"{member.name} {call.split('_')[0]}"
                ) -> None:
                    start = time.perf_counter()
                    inner(*arguments)
                    spent[key] += time.perf_counter() - start

                setattr(member.instance, call, timed)
        session.run()
    steps = round(STOP / STEP)
    with load_scenario(name).open() as default, load_scenario(name).with_master("gauss-seidel").open() as held:
        sides: list[list[float]] = [[], []]
        for _ in range(30):  # in turn, so that both meet the same machine
            for session, times in zip((default, held), sides, strict=True):
                times.append(best(session.run, 1))
    by_step = {}
    for step in ("0.1 ms", "0.25 ms", "0.5 ms", "1 ms", "2 ms"):
        with load_scenario(name).with_master(communication_step=step).open() as session:
            by_step[step] = best(session.run, 5)
    return plain, {key: 1e6 * value / steps for key, value in spent.items()}, by_step, min(sides[0]) / min(sides[1])


def peer(name: str, package: str) -> tuple[float, float] | str:
    """(wall time [s], peak [rad]) of incline30_brace under another master, or why there is none."""
    environment = Path(__file__).parent.parent / "build" / "peers" / name
    python = environment / "bin" / "python"
    if not (environment / "complete").is_file():
        for command in (
            [sys.executable, "-m", "venv", environment],
            [python, "-m", "pip", "install", "--quiet", package, "numpy"],
        ):
            outcome = subprocess.run(command, capture_output=True, text=True)
            if outcome.returncode:
                return f"cannot be installed: {(outcome.stderr.strip().splitlines() or ['?'])[-1]}"
        (environment / "complete").touch()
    system = load_scenario("incline30_brace").system()
    task = {
        "peer": name,
        "fmus": {c.name: str(c.fmu) for c in system.components},
        "connections": dict(system.connections),
        "parameters": dict(system.parameters),
        "integers": [p for p in system.parameters if system.find(p).kind != "real"],
        "references": {f"{c.name}.{v.name}": v.reference for c in system.components for v in c.connectors.values()},
        "step": STEP,
        "stop": STOP,
        "repeat": 5,
    }
    script = Path(__file__).with_name("bench_peers.py")
    outcome = subprocess.run([python, script], input=json.dumps(task), capture_output=True, text=True)
    found = next((line for line in outcome.stdout.splitlines() if line.startswith('{"seconds"')), None)
    if found is None:
        return f"failed: {(outcome.stderr.strip().splitlines() or [f'exit code {outcome.returncode}'])[-1]}"
    answer = json.loads(found)
    return answer["seconds"], answer["peak"]


def processor_time(run: Callable[[], object], repeat: int) -> float:
    """Least processor time [s] of the child processes that `run` starts and waits for."""
    times = []
    for _ in range(repeat):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times)


def worker() -> None:
    with Worker(load_scenario("incline30_brace"), ["plant.drop_height"]) as child:
        assert child.run([0.3]).status == "completed"


def landings_in_turn(trials: int = 100, repeat: int = 5) -> None:
    """Prints what a landing of a population costs beside one of `study6` and one of the population's own landings by
    one person: each trial of each in turn in one process, least of `repeat` each, so that a busy machine slows all."""
    many = load_study("population_mixed")
    kinds = {name: (study.scenario.open(), study) for name, study in (("study6", load_study("study6")), ("many", many))}
    of_persons = sum(name.startswith("subject.") for name in many.names)
    spent = {name: np.full((repeat, trials), np.inf) for name in (*kinds, "one")}
    rows = {name: study.sample()[:trials] for name, (_, study) in kinds.items()}
    with kinds["study6"][0], kinds["many"][0], many.scenario.open() as alone:
        kinds["one"], rows["one"] = (alone, many), rows["many"]
        for k, i in np.ndindex(repeat, trials):
            for name, (session, study) in kinds.items():
                first = of_persons if name == "one" else 0
                values = dict(zip(study.names[first:], rows[name][i][first:].tolist(), strict=True))
                began = time.process_time()
                session.run(values, judged=False)
                spent[name][k, i] = time.process_time() - began
    least = {name: float(times.min(axis=0).mean()) for name, times in spent.items()}
    row("a landing of study6, many in turn", least["study6"], "processor time in an open session")
    for name, label in (
        ("one", "  of the mean woman, the population's start"),
        ("many", "  of a population's persons"),
    ):
        ratios = f"{least[name] / least['study6']:.3f} of study6"
        row(label, least[name], ratios + (f", {least[name] / least['one']:.3f} of one" if name == "many" else ""))


def population(pairs: int = 5, trials: int = 300) -> None:
    """Prints what a study of a population costs beside that of one person, in processor time of pairs in turn, and what
    its summary costs of it."""
    names = ("study6", "population_mixed")
    with tempfile.TemporaryDirectory() as scratch:

        def spent(name: str, k: int) -> float:
            out = ["--out", f"{scratch}/{name}-{k}", "--progress", "none"]
            command = [*python_command("sprain_cosim"), "study", name, "--trials", str(trials), *out]
            return processor_time(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL), 1)

        found = [{name: spent(name, k) for name in (names if k % 2 else names[::-1])} for k in range(pairs)]
        ratios = sorted(pair[names[1]] / pair[names[0]] for pair in found)
        one, many = (min(pair[name] for pair in found) for name in names)
        row(f"a study of one person, {trials} trials", one, "processor time, start to end")
        spread = f"(median of {pairs} pairs, {ratios[0]:.3f} ... {ratios[-1]:.3f})"
        row("  of a population", many, f"{ratios[pairs // 2]:.3f} times as much {spread}")
        folder = Path(scratch) / f"{names[1]}-0"
        with Ledger.read(folder) as ledger:
            plan = load_study_plan(folder, ledger)
            table, _ = trial_tables(plan, ledger, None)
        began = time.process_time()
        summarise(plan, table, None)
        row("  of which its summary", time.process_time() - began)


def row(label: str, seconds: float, note: str = "") -> None:
    print(f"{label:46}{1e3 * seconds:9.2f} ms  {note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--traffic", metavar="SCENARIO", help=argparse.SUPPRESS)
    parser.add_argument("--no-peers", action="store_true", help="leave libcosim and CoFmuPy out")
    arguments = parser.parse_args()
    if arguments.traffic:
        print(json.dumps(traffic(arguments.traffic)))
        return
    repeat = arguments.repeat
    plant = Plant()
    direct(plant, Landing())
    print(
        f"{date.today()}  {platform.processor() or platform.machine()}, one core, best of {repeat}; 150 ms landing, "
        "30° slope, touching pose\n"
    )
    alone = best(lambda: direct(plant, Landing()), repeat)
    row(
        "plant driven directly",
        alone,
        f"{OPENSIM / alone:.0f} times faster than OpenSim 4.6 ({OPENSIM} s); {plant.state['evaluations']} evaluations",
    )
    row("the same, observed every 0.5 ms", best(lambda: direct(plant, Landing(), STEP), repeat))
    for name in ("incline30", "incline30_brace", "incline30_mixed"):
        # in a process of its own, so that nothing of the kernels above is in its caches
        child = subprocess.run(
            [sys.executable, __file__, "--traffic", name], capture_output=True, text=True, check=True
        )
        seconds, spent, by_step, ratio = json.loads(child.stdout)
        row(f"co-simulated, {name}", seconds, f"{OPENSIM / seconds:.0f} times faster than OpenSim 4.6")
        print(f"{'  default coupling over plain gauss-seidel':46}{ratio:9.3f}")
        if name == "incline30_brace":
            brace_traffic, brace_steps = spent, by_step
    for label, name, package in (
        () if arguments.no_peers else (("libcosim", "libcosim", "libcosimpy"), ("CoFmuPy", "cofmupy", "cofmupy"))
    ):
        found = peer(name, package)
        if isinstance(found, str):
            print(f"the same FMUs under {label}: {found}")
        else:
            seconds, peak = found
            row(
                f"the same FMUs under {label} (Jacobi)",
                seconds,
                f"peak {np.degrees(peak):.2f} deg; without reset and initialisation",
            )
    for label, arguments_of in (
        ("sprain-cosim --help", ["--help"]),
        ("sprain-cosim run incline30", ["run", "incline30"]),
    ):
        command = [*python_command("sprain_cosim"), *arguments_of]
        seconds = processor_time(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL), repeat)  # noqa: B023
        row(label, seconds, "processor time, start to end")
    row("a study's worker", processor_time(worker, repeat), "processor time: its start, the FMUs, one braced landing")
    population()
    landings_in_turn()
    print(
        "\nmicroseconds per communication step, incline30_brace (each call timed, so a little more than in the run "
        "above)"
    )
    for key, value in sorted(brace_traffic.items(), key=lambda item: -item[1]):
        print(f"  {key:24}{value:8.1f}")
    print("\nmicroseconds per call, 60 ms after contact")
    for key, value in parts(repeat).items():
        print(f"  {key:24}{value:8.2f}")
    print("\ntolerance      evaluations        ms")
    for tolerance in (1e-2, 5e-3, 2.5e-3, 1e-3, 1e-4):
        seconds = best(lambda: direct(plant, Landing(tolerance=tolerance)), 5)  # noqa: B023
        print(f"{tolerance:9g}{plant.state['evaluations']:17d}{1e3 * seconds:10.2f}")
    print("\ncommunication step [ms]   co-simulated incline30_brace [ms]")
    for step, seconds in brace_steps.items():
        print(f"{step:>14}{1e3 * seconds:22.2f}")
    print("\nfacets         ms, driven directly")
    full = sole()
    for share in (1, 2, 4):
        thin = full[:, ::share].copy()
        thin[3] *= full[3].sum() / thin[3].sum()
        coarse = Plant(thin)
        print(f"{thin.shape[1]:6d}{1e3 * best(lambda: direct(coarse, Landing()), 5):14.2f}")  # noqa: B023


if __name__ == "__main__":
    main()
