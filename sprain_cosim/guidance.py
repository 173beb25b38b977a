"""What helps somebody who types: commands grouped by subject, examples, names that the shell completes. Light: help
loads none of the heavy libraries."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import click
from click.shell_completion import CompletionItem

from .shipped import shipped_fmus, shipped_scenarios, shipped_studies
from .signals import nobody_reads

LISTED = ("scenarios", "studies", "braces", "parameters", "responses")
SECTIONS = {  # {group: {subject: {command: what it does, in one line of help}}}
    "sprain-cosim": {
        "One landing": {
            "run": "Run one landing.",
            "motion": "Start a landing as a measured motion.",
            "subject": "What a person makes of the model.",
            "anatomy": "Take the passive ankle from measurements.",
            "ssp": "Read and write systems of other tools.",
        },
        "Many landings": {
            "study": "Run many landings, and say how sure the answer is.",
            "design": "Find the value for which a goal holds.",
            "merge": "Join the shards of a study.",
            "trial": "Run one trial of a study again.",
            "reproduce": "Run a whole study again, to the bit.",
        },
        "Braces": {
            "check": "Does a brace FMU fit the contract?",
            "compare": "The same landings with each brace.",
            "brace": "Make, build and calibrate a brace FMU.",
        },
        "Looking": {
            "list": "Scenarios, studies, braces, parameters, responses.",
            "plot": "Figures of finished folders.",
            "report": "One HTML page about them.",
            "animate": "The landings in slow motion.",
            "export": "A landing or a sample for other programs.",
        },
        "This machine": {
            "doctor": "Is this installation sound?",
            "paper": "The paper's studies and figures again.",
            "validate": "Is it right, and is it the paper's model?",
            "build": "Build the FMUs of a clone.",
        },
    }
}
EXAMPLES = {  # at most 56 letters each, so that no terminal breaks them
    "sprain-cosim": (
        "sprain-cosim list",
        "sprain-cosim run incline30_brace",
        "sprain-cosim check my_brace.fmu",
    ),
    "brace": (
        "sprain-cosim brace new my_brace --lang python",
        "sprain-cosim brace build my_brace",
        "sprain-cosim brace from-csv bench.csv -o my_brace.fmu",
    ),
    "anatomy": (
        "sprain-cosim anatomy from-csv ankle.csv -o mine.toml",
        "sprain-cosim run mine.toml",
    ),
    "ssp": (
        "sprain-cosim ssp export incline30_brace -o mine.ssp",
        "sprain-cosim ssp export level --container -o level.fmu",
        "sprain-cosim ssp check mine.ssp",
    ),
}
OTHERS = "Commands"


class Guided(click.Group):
    """A group whose help names its commands by subject and ends with examples; typed alone it shows that help."""

    def make_context(self, *arguments: Any, **more: Any) -> click.Context:
        with nobody_reads():
            return super().make_context(*arguments, **more)

    def invoke(self, context: click.Context) -> Any:
        with nobody_reads():
            return super().invoke(context)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Every command that is not hidden: those of SECTIONS, then all others."""
        shown = {n: c for n in self.list_commands(context) if not (c := self.commands[n]).hidden}
        sections = SECTIONS.get(str(self.name if context.parent else "sprain-cosim"), {})
        for subject, commands in sections.items():
            self._section(formatter, subject, [(n, text) for n, text in commands.items() if n in shown])
        known = {name for commands in sections.values() for name in commands}
        rest = [(n, c.get_short_help_str(200)) for n, c in shown.items() if n not in known]
        self._section(formatter, OTHERS, rest)

    @staticmethod
    def _section(formatter: click.HelpFormatter, title: str, rows: list[tuple[str, str]]) -> None:
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)

    def format_epilog(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        examples = EXAMPLES.get(str(self.name if context.parent else "sprain-cosim"), ())
        if examples:
            with formatter.section("Examples"):
                formatter.write_text("\b\n" + "\n".join(examples))


# ---- what the shell completes


def _names(known: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Names, and files besides."""
    found = [CompletionItem(name) for name in known if name.startswith(incomplete)]
    return found or [CompletionItem(incomplete, type="file")]


def scenarios(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return _names(shipped_scenarios(), incomplete)


def studies(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return _names(shipped_studies(), incomplete)


def scenarios_and_studies(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return _names([*shipped_scenarios(), *shipped_studies()], incomplete)


def schemes(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from .cosim.coupling import SCHEMES

    return [CompletionItem(name) for name in ("auto", *SCHEMES) if name.startswith(incomplete)]


def methods(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from .study.methods import METHODS

    return [CompletionItem(name) for name in METHODS if name.startswith(incomplete) and name != "design"]


def devices(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """NAME=FMU: the FMU's name once NAME stands there, else brace= and controller=."""
    name, equals, begun = incomplete.partition("=")
    if not equals:
        return [CompletionItem(f"{role}=") for role in ("brace", "controller") if role.startswith(name)]
    return [CompletionItem(f"{name}={fmu}") for fmu in shipped_fmus() if fmu.startswith(begun)] or [
        CompletionItem(begun, type="file")
    ]
