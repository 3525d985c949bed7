"""Parts of pages that are generated from code and results, by `make documents` and by each build.

MkDocs calls the `on_*` functions as hooks; see MkDocs's documentation of `hooks`.
"""

import html
import importlib
import inspect
import io
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from typer.cli import get_docs_for_click

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from docs.figures import ROOT, render, without_comments
from harness import rasterisers
from harness.commands.index import COMMANDS, load_command
from harness.metrics.registry import list_metrics
from harness.page.device_summaries import format_plain_cell
from harness.page.device_summaries import format_table as summaries
from harness.profile.report import make_devices_table
from scenes.registry import ENTRIES
from triangulators.criteria import CRITERIA
from triangulators.registry import BUILTIN


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Render a page's figures and generated parts, and remove the comments behind figures."""
    return typeset(without_comments(filled(markdown)))


def typeset(markdown: str) -> str:
    """Replace the `math` blocks of a page, a formula in TeX's notation each, by pictures."""

    def picture(match: re.Match[str]) -> str:
        return f"{match[1]}{_draw_formula(match[2].strip())}"

    return re.sub(r"^( *)```math\n(.*?)^ *```$", picture, markdown, flags=re.MULTILINE | re.DOTALL)


_PLACEHOLDER = "#010203"  # matplotlib has no colour of the text around


def _draw_formula(formula: str) -> str:
    """Return a formula as inline SVG in the colour of the text around it."""
    stream = io.StringIO()
    with rc_context({"mathtext.fontset": "stix"}):
        figure = Figure()
        figure.text(0, 0, f"${formula}$", fontsize=13, color=_PLACEHOLDER)
        figure.savefig(stream, format="svg", transparent=True, bbox_inches="tight", pad_inches=0.05)
    svg = stream.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    # Formulas of one page would have equal identifiers.
    svg = re.sub(r'<g id="[^"]*"', "<g", svg).replace(_PLACEHOLDER, "currentColor")
    label = html.escape(formula, quote=True)
    attributes = f'class="formula" role="img" aria-label="{label}"'
    return " ".join(svg.replace("<svg", f"<svg {attributes}", 1).split()) + "\n"


def on_post_build(config: Any) -> None:
    """Add links to the site's pages to try.html, which has none outside the site."""
    page = Path(config.site_dir) / "try.html"
    text = page.read_text(encoding="utf-8")
    link = r'<a href="\1.html">\2</a>'
    text = re.sub(r'<span data-page="([a-z/-]+)"(?: hidden)?>(.*?)</span>', link, text)
    page.write_text(text, encoding="utf-8")


def pages() -> list[Path]:
    """Return the Markdown pages that have figures or generated parts."""
    pages = [
        ROOT / "README.md",
        ROOT / "paper" / "paper.md",
        *sorted((ROOT / "docs").rglob("*.md")),
    ]
    return [page for page in pages if "<!-- " in page.read_text(encoding="utf-8")]


def filled(markdown: str) -> str:
    """Return a page with newly computed figures, tables and generated parts.

    `<!-- generated: NAME ARGUMENTS -->` and `<!-- end -->` enclose a part of `PARTS`.
    """

    def part(match: re.Match[str]) -> str:
        return f"{match[1]}\n\n{PARTS[match[2]](*match[3].split()).strip()}\n\n<!-- end -->"

    starts = re.findall(r"^<!-- (?:generated: |table$)", markdown, flags=re.MULTILINE)
    if len(starts) != markdown.count("<!-- end -->"):
        raise ValueError("generated part or table: end not found; add <!-- end -->")
    parts = r"(<!-- generated: (\w+)(.*?) -->)\n.*?<!-- end -->"
    return render(re.sub(parts, part, markdown, flags=re.DOTALL))


def output(file: str) -> str:
    """Return the recorded output of a command."""
    text = (ROOT / "results" / "reference" / file).read_text(encoding="utf-8")
    return f"```text\n{text.strip()}\n```"


def commands() -> str:
    """Return a section for each command, from `--help`."""
    parts = []
    for name in COMMANDS:
        command = load_command(name)
        context = command.make_context(name, [], resilient_parsing=True)
        parts.append(get_docs_for_click(obj=command, ctx=context, name=f"raster-harness {name}"))
    text = re.sub(r"^# `raster-harness (.*)`", r"## \1", "".join(parts), flags=re.MULTILINE)
    return re.sub(r"^raster-harness .*$", r"`\g<0>`", text, flags=re.MULTILINE)  # examples


def devices(*columns: str) -> str:
    """Return a table of the contributed summaries of devices, or some columns."""
    return _columns(summaries(ROOT / "results" / "devices"), columns)


def profiles(*columns: str) -> str:
    """Return a table of the devices' laws, or some columns."""
    headings, rows = make_devices_table(ROOT / "results" / "reference" / "profiles")
    return _columns(_table(" | ".join(headings), rows, format_plain_cell), columns)


def _columns(table: str, columns: Sequence[str]) -> str:
    """Return some columns of a table, by number from 0; all without numbers."""
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in table.splitlines()]
    selected = [int(column) for column in columns] or range(len(rows[0]))
    return "\n".join(f"|{'|'.join(row[column] for column in selected)}|" for row in rows)


def python(*names: str) -> str:
    """Return a section with signature and docstring for each name, or each class of a module."""
    parts = []
    for name in names:
        module, _, last = name.rpartition(".")
        item = getattr(importlib.import_module(module), last, None)
        items = {name: item}
        if item is None or inspect.ismodule(item):
            item = importlib.import_module(name)
            classes = (member for member in vars(item).values() if inspect.isclass(member))
            items = {f"{name}.{e.__name__}": e for e in classes if e.__module__ == name}
        for path, entry in items.items():
            try:
                signature = re.sub(r"\b[a-z_][\w.]*\.(?=\w)", "", str(inspect.signature(entry)))
                signature = re.sub(
                    r"ndarray\[tuple\[.*?\], dtype\[(\w+)\]\]", r"NDArray[\1]", signature
                )
                heading = f"{entry.__name__}{signature}\n\n"
            except ValueError:  # an enumeration, an exception
                heading = ""
            parts.append(f"### {path}\n\n```text\n{heading}{inspect.getdoc(entry) or ''}\n```\n")
    return "\n".join(parts)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _table(headings: str, rows: Iterable[Iterable[str]], cell: Callable[[str], str] = _cell) -> str:
    lines = [f"| {headings} |", "|" + "---|" * len(headings.split(" | "))]
    return "\n".join(lines + ["| " + " | ".join(map(cell, row)) + " |" for row in rows])


PARTS: dict[str, Callable[..., str]] = {
    "commands": commands,
    "triangulators": lambda: _table(
        "triangulator | holes | algorithm",
        (
            (f"`{name}`", "yes" if entry.handles_holes else "no", entry.description)
            for name, entry in BUILTIN.items()
        ),
    ),
    "criteria": lambda: _table(
        "criterion | symbol | unit | sum over triangles of",
        (
            (f"`{name}`", entry.symbol, entry.unit, entry.description)
            for name, entry in CRITERIA.items()
        ),
    ),
    "scenes": lambda: _table(
        "scene | content | licence of the data",
        ((f"`{name}`", entry.description, entry.licence) for name, entry in ENTRIES.items()),
    ),
    "rasterisers": lambda: _table(
        "rasteriser | supported devices | counters",
        (
            (
                f"`{name}`",
                ", ".join(kind.device_names),
                ", ".join(map("`{}`".format, kind.counters)) or "nothing",
            )
            for name, kind in ((name, rasterisers.get(name)) for name in rasterisers.BUILT_IN)
        ),
    ),
    "metrics": lambda: _table(
        "metric | kind | unit | better | description",
        (
            (f"`{entry.name}`", entry.kind, entry.unit, entry.better, entry.description)
            for entry in list_metrics().values()
        ),
    ),
    "devices": devices,
    "output": output,
    "profiles": profiles,
    "python": python,
}
