"""Hooks of the documentation site (mkdocs.yml): the command reference is written from the program's own options, the
reference of files from the tables of keys, that of parameters and responses from the FMUs and the code; equations
become MathML when the site is built, so that a page needs no script and no network. Examples in docstrings become
blocks of code; long names in tables may break at their underscores."""

from __future__ import annotations

import html
import re
from itertools import groupby
from typing import Any

import click
from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.preprocessors import Preprocessor
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from sprain_cosim import mapping
from sprain_cosim.catalogue import catalogue, parameters_of
from sprain_cosim.cli import cli
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.scenario import file as scenario
from sprain_cosim.scenario.settable import Settable
from sprain_cosim.study import file as study
from sprain_cosim.validation.checks import user_files
from tools import notebooks

COMMANDS = "<!-- commands -->"
FILES = "<!-- files -->"
NAMES = "<!-- names -->"
NOTEBOOK = re.compile(r"\]\(([\w./-]+)\.ipynb\)(?!\{)")  # a link to one, but to load it down
EXAMPLE = re.compile(r"^>>> .*(?:\n(?!\s*$).*)*", re.MULTILINE)  # a prompt and all up to the next empty line
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
CELL = re.compile(r"<t[hd][^>]*>(.*?)</t[hd]>", re.DOTALL)
TAG = re.compile(r"<[^>]+>")
WORDS = 30  # letters of a cell, from which it is a sentence
ROOM = 51  # digits side by side on a phone, a blank between columns counted as one and a half
SCREEN = 59  # letters of fixed width side by side on a phone
PIECE = re.compile(r"<code>[^<]+</code>|<[^>]+>|[^<]+")
NAME = re.compile(r"\b[a-z]\w+(?:[_.][a-z]\w*)+")  # plant.drop_height
BREAK = re.compile(r"(?<=[\w)\]])([_/=|]|\.(?!\d)|(?<=[a-z])(?=[A-Z][a-z]))(?=\w)")  # where long names may part
UNIT = re.compile(
    r"(?<=\d) (?=(?:%|[kMG]?B|[num\u00b5]?s|min|h|k?N|N[\u00b7.]m|[km]?m|kg|deg|MPa)(?:/(?:mm?|s|rad))?(?![\w\u00b7/]))"
)
CHAIN = re.compile(r'([)\]]</span>)(?=<span class="o">\.</span>)')  # of calls in a program
FRAME = re.compile(r'<table [^>]*class="dataframe">.*?</table>', re.DOTALL)
TITLE = re.compile(r'(?<=<span class="doc doc-object-name )([\w -]+">)([^<]+)')  # of an object in the Python reference
LONG = re.compile(r"(?<![\w`-])--[a-z][\w-]*(?!`)")  # an option in a sentence of the help
CODED = r"`\g<0>`"
CODE = re.compile(r"<code>.*?</code>", re.DOTALL)
OPTION = re.compile(  # also "0.35 m" and 1e-4: what no line may part
    r"(?<![\w#-])--?[A-Za-z][\w-]*|(?P<quote>\"|&quot;)[\d.]+ [\w./]+(?P=quote)|\b\d+e-\d+\b"
)
BLOCK = re.compile(
    r'(<div class="language-(?:text|python|pycon)) highlight"(><pre><span></span><code[^>]*>)(.*?)(?=</code>)',
    re.DOTALL,
)
COLUMNS = 86  # letters of a line that a block shows in the usual size on a screen of 1280 pixels
WIDEST = 140  # letters of a line that can still be a row of a table
WHOLE = r'<span class="option">\g<0></span>'
OUTPUT = re.compile(r'(<div class="language-text) (highlight"><pre><span></span><code)>(.*?)\n?</code>', re.DOTALL)
MESSAGE = re.compile("(?:note|problem|warning): ")
GAP = re.compile(r"(?<=[^\s:\u00b7]) {2,}(?=[^\s\u00b7])")  # between the columns of a line
TAIL = re.compile(r" {2}(?=[^ ]+ [^ ]+ [^ ])(?=.*[a-z]{3})(?:[^ ]| (?! ))+$")  # words at the end of columns
LETTERS = 33  # of a formula, from which a phone shows it smaller
FORMULA = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', re.DOTALL)
POINTED = re.compile(r'[(\[]*<math [^>]*display="inline".*?</math>[,.;:?)\]]*', re.DOTALL)  # and the signs at its sides
FIGURE = re.compile(r'<img [^>]*src="((?:\.\./)*figures/[^"]+)"[^>]*>')


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The notebooks as pages, with what they show."""
    for name, content in notebooks.pages():
        files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    markdown = NOTEBOOK.sub(r"](\1.md)", markdown)
    if COMMANDS in markdown:
        return markdown.replace(COMMANDS, "\n".join(_section(cli, "sprain-cosim", None)))
    if FILES in markdown:
        tables = (scenario.FILE, study.FILE, mapping.FILE, user_files.FILE)
        return markdown.replace(FILES, "\n".join(file.reference() for file in tables))
    if NAMES in markdown:
        return markdown.replace(NAMES, "\n".join(_names()))
    return markdown


def on_config(config: Any) -> None:
    config.markdown_extensions.append(Examples())


def on_page_content(content: str, **_: Any) -> str:
    """Equations, as arithmatex leaves them, as MathML; tables and output for phones; options that stay whole;
    long names that do not; longer lines in smaller letters; figures that open in their own size."""
    content = FORMULA.sub(lambda m: _formula(html.unescape(m[3].strip()), m[2] == "["), content)
    content = POINTED.sub(WHOLE, content)  # a browser may part a formula and its comma
    content = TABLE.sub(lambda table: _table(table[0]), content)  # behind the formulas, whose TeX has names too
    content = FRAME.sub(lambda frame: _with_breaks(frame[0]), content)
    content = OUTPUT.sub(lambda found: _output(found[1], found[2], html.unescape(found[3])), content)
    content = CODE.sub(lambda code: OPTION.sub(WHOLE, code[0]), content)
    content = TITLE.sub(lambda title: title[1] + BREAK.sub(r"\1<wbr>", title[2]), content)
    content = BLOCK.sub(_block, CHAIN.sub(r"\1<wbr>", content))
    return FIGURE.sub(r'<a href="\1" title="in its own size">\g<0></a>', content)


def _table(table: str) -> str:
    """Long names with places to break; how a phone shows it, and the head of its column beside each cell."""
    table = table.replace("&#95;", "_")
    rows = ROW.findall(table)
    heads, *cells = [[html.unescape(TAG.sub("", cell)).strip() for cell in CELL.findall(row)] for row in rows]
    table = _with_breaks(table)
    shape = _shape([max(map(len, column)) for column in zip(*cells, strict=False)])
    if shape:
        table = table.replace("<table>", f'<table data-shape="{shape}">', 1)
    return ROW.sub(lambda row: _headed(row[0], heads), table) if shape == "rows" else table


def _with_breaks(table: str) -> str:
    return CELL.sub(lambda cell: PIECE.sub(lambda piece: _breakable(piece[0]), cell[0]), table)


def _shape(longest: list[int]) -> str:
    """Of a table with such cells on a phone: rows, read one by one; numbers, in columns beside each other; '' as it
    is."""
    first, *others = longest or [0]
    if len(others) == 2:
        return "rows" if sorted(longest)[1] >= WORDS else ""
    if len(others) < 2 or (len(others) == 3 and max(others) < WORDS):
        return ""
    narrow = min(first, 14) + sum(others) + 1.5 * len(others) <= ROOM
    return "numbers" if max(others) < WORDS and (narrow or max(others) < 10) else "rows"


def _output(start: str, middle: str, text: str) -> str:
    """What a program printed: a phone wraps its sentences, and shows its columns nearer to each other, in letters of
    which a line holds as many as there are."""
    figures = any(letter.isdigit() for letter in text)
    columns, groups = 0, []
    for group in text.split("\n\n"):
        lines = group.split("\n")
        kept = [line for line in lines if GAP.search(line)]
        blank = [all(line[k : k + 1] in ("", " ") for line in kept) for k in range(max(map(len, lines)))]
        spare = {k for k in range(2, len(blank)) if all(blank[k - 2 : k + 1])}
        shown = []
        for line in lines:
            far = {k for k in spare if k < len(line)} if line in kept else set()
            narrow = len(line) - len(far)
            sentence = narrow > SCREEN and (line not in kept or not figures or TAIL.search(line) is not None)
            if sentence and not figures:  # columns of words: each line by itself
                far = {k for gap in GAP.finditer(line) for k in range(gap.start() + 2, gap.end())}
            columns = columns if sentence else max(columns, narrow)
            letters = "".join(
                f'<span class="spare">{part}</span>' if hidden else html.escape(part, quote=False)
                for hidden, part in _runs(line, far)
            )
            shown.append(f'<span class="sentence">{letters}</span>' if sentence else letters)
        groups.append("\n".join(shown))
    if MESSAGE.match(text) or (not columns and (figures or not GAP.search(text))):
        return f"{start} line {middle}>" + "\n\n".join(groups) + "\n</code>"
    shown_whole = OPTION.sub(WHOLE, "\n\n".join(groups))
    return f'{start} {middle} style="--narrow: {max(columns, 1)}">{shown_whole}\n</code>'


def _runs(line: str, spare: set[int]) -> list[tuple[bool, str]]:
    return [
        (far, "".join(letter for _, letter in run))
        for far, run in groupby(enumerate(line), key=lambda placed: placed[0] in spare)
    ]


def _breakable(piece: str) -> str:
    if piece.startswith("<"):
        return BREAK.sub(r"\1<wbr>", piece) if piece.startswith("<code>") else piece
    piece = UNIT.sub("\u00a0", piece)
    return NAME.sub(lambda name: BREAK.sub(r"\1<wbr>", name[0]), piece)


def _headed(row: str, heads: list[str]) -> str:
    left = (re.sub(r"([_.])(?=\w)", "\\1\u200b", head) for head in heads)
    return re.sub("<td", lambda _: f'<td data-head="{html.escape(next(left))}"', row)


def _block(block: re.Match[str]) -> str:
    """Says how wide a block is that would not fit: its letters become smaller. A sentence among its lines wraps."""
    lengths = [len(line) for line in html.unescape(TAG.sub("", block[3])).split("\n")]
    columns = max(length for length in lengths if length <= WIDEST)
    wraps = "line " if max(lengths) > WIDEST else ""
    mark = f' style="--columns: {columns}"' if columns > COLUMNS else ""
    return f'{block[1]} {wraps}highlight"{mark}{block[2]}{block[3]}'


def _formula(tex: str, display: bool) -> str:
    """Formulas with a wide blank between them may stand below each other."""
    parts = tex.split(r"\qquad") if display else [tex]
    shown = [convert(part.strip(), display="block" if display else "inline") for part in parts]
    shown = [
        formula.replace("<math ", '<math class="long" ', 1)
        if display and len(html.unescape(TAG.sub("", formula))) > LETTERS
        else formula
        for formula in shown
    ]
    return shown[0] if len(shown) == 1 else f'<div class="formulas">{"".join(shown)}</div>'


class _Fence(Preprocessor):
    def run(self, lines: list[str]) -> list[str]:
        return EXAMPLE.sub(lambda m: f"```pycon\n{m[0]}\n```", "\n".join(lines)).split("\n")


class Examples(Extension):
    """`>>>` begins a block of code, before anything reads its brackets as links."""

    def extendMarkdown(self, md: Markdown) -> None:
        md.preprocessors.register(_Fence(md), "examples", 35)


def _names() -> list[str]:
    """Parameters of plant, person, controller and every brace that ships; responses."""
    bare = load_scenario("incline30")
    lines = [
        *_parameters("The plant", "Every landing has it.", bare, "plant"),
        *_parameters(
            "A person",
            "Of a scenario with a subject (`--subject`, `[subject]`). What is not stated is estimated: here of a woman"
            " of 1.63 m and 62 kg ([your subject](../your-subject.md)). A measure outside its range is no adult's, and"
            " refused.",
            bare.with_subject("female, 1.63 m, 62 kg"),
            "subject",
        ),
        *_parameters("The controller", "Of the muscles that cross the ankle.", bare, "controller"),
    ]
    for brace in catalogue("braces"):
        chosen = bare.replace_fmu("brace", brace["name"])
        lines += _parameters(f"brace = {brace['name']}", f"{brace['description']}.", chosen, "brace")
    lines += ["## Responses", "", "| Response | Unit | Meaning |", "|---|---|---|"]
    for record in catalogue("responses"):
        needs = " (with a brace)" if record["needs_brace"] else ""
        lines.append(f"| `{record['name']}` | {record['unit']} | {_prose(record['meaning'] + needs)} |")
    return lines


def _parameters(title: str, text: str, chosen: Scenario, component: str) -> list[str]:
    found = [p for p in parameters_of(chosen) if p.name.startswith(f"{component}.")]
    rows = [_parameter_row(parameter) for parameter in found]
    return [
        f"## {title}",
        "",
        text,
        "",
        "| Parameter | Meaning | Unit | Default | Range |",
        "|---|---|---|---|---|",
        *rows,
        "",
    ]


def _parameter_row(parameter: Settable) -> str:
    name, unit, span, default, value, meaning = parameter.row()
    default = str(value or default) if parameter.name.startswith("subject.") else default
    return f"| `{name}` | {_prose(meaning)} | {unit} | {_prose(default)} | {_prose(span)} |"


def _section(command: click.Command, path: str, parent: click.Context | None) -> list[str]:
    """Heading, help, usage and options of a command, then of the commands under it."""
    context = click.Context(command, parent, info_name=path.rpartition(" ")[2])
    lines = [
        f"## {path}",
        "",
        _prose(command.help),
        "",
        "```text",
        f"{path} {' '.join(command.collect_usage_pieces(context))}",
        "```",
        "",
    ]
    options = [record for p in command.params if isinstance(p, click.Option) and (record := p.get_help_record(context))]
    if options:
        lines += [
            "| Option | Meaning |",
            "|---|---|",
            *(f"| `{names}` | {LONG.sub(CODED, _prose(text))} |" for names, text in options),
            "",
        ]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            lines += _section(command.commands[name], f"{path} {name}", context)
    return lines


def _prose(text: str | None) -> str:
    return (
        html.escape(" ".join((text or "").split()), quote=False)
        .replace("|", "&#124;")
        .replace("*", "&#42;")
        .replace("_", "&#95;")
    )
