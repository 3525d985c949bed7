"""Pages of the reference that are made from the code each time the documents are built.

MkDocs calls the `on_*` functions as hooks; see its documentation on `hooks`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT))


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in what a page asks for by a line `<!-- generated: name -->`."""
    for name, make in PARTS.items():
        mark = f"<!-- generated: {name} -->"
        if mark in markdown:
            markdown = markdown.replace(mark, make())
    return markdown


def on_post_build(config: Any) -> None:
    """Let try.html, which opens from docs/ as well, lead to the site's pages."""
    page = Path(config.site_dir) / "try.html"
    text = re.sub(r'href="([a-z/-]+)\.md"', r'href="\1.html"', page.read_text(encoding="utf-8"))
    if (page.parent / "profile.html").exists():  # which `make docs` writes
        text = text.replace('id="profile" href="how-to/profile.html"', 'href="profile.html"')
    page.write_text(text, encoding="utf-8")


def commands() -> str:
    """Return a section for each command, from its `--help`."""
    from harness.commands.index import COMMANDS, load

    parts = []
    for name in COMMANDS:
        command = load(name)
        context = command.make_context(name, [], resilient_parsing=True)
        rows = []
        for parameter in command.params:
            record = parameter.get_help_record(context)
            if record is None:
                names, text = parameter.make_metavar(context), getattr(parameter, "help", "") or ""
            else:
                names, text = record
            rows.append(f"| `{_cell(names)}` | {_cell(text)} |")
        text = "\n".join(line.strip() for line in (command.help or "").splitlines())
        examples = [line for line in (command.epilog or "").split("\n\n") if line][1:]
        shown = "\n".join(["```console", *(f"$ {line}" for line in examples), "```"])
        table = "\n".join(["| option | meaning |", "|---|---|", *rows])
        parts.append(f"## {name}\n\n{text}\n\n{table}\n\n{shown if examples else ''}\n")
    return "\n".join(parts)


def triangulators() -> str:
    """Return a table of the built-in triangulators."""
    from triangulators import registry

    rows = [
        (f"`{name}`", "yes" if entry.handles_holes else "no", entry.description)
        for name, entry in registry.BUILTIN.items()
    ]
    return _table(("triangulator", "holes", "what it does"), rows)


def criteria() -> str:
    """Return a table of the criteria."""
    from triangulators import criteria

    rows = [
        (f"`{name}`", each.symbol, each.unit, each.description)
        for name, each in criteria.CRITERIA.items()
    ]
    return _table(("criterion", "symbol", "unit", "what it sums over triangles"), rows)


def scenes() -> str:
    """Return a table of the scenes."""
    from scenes import registry

    rows = [
        (f"`{name}`", entry.description, entry.licence) for name, entry in registry.ENTRIES.items()
    ]
    return _table(("scene", "what it holds", "licence of its data"), rows)


def rasterisers() -> str:
    """Return a table of the rasterisers and what they count."""
    from harness import rasterisers

    rows = []
    for name in rasterisers.BUILT_IN:
        kind = rasterisers.get(name)
        counters = ", ".join(f"`{counter}`" for counter in kind.counters) or "nothing"
        rows.append((f"`{name}`", ", ".join(kind.known), counters))
    return _table(("rasteriser", "devices it knows", "counters"), rows)


def metrics() -> str:
    """Return a table of the metrics."""
    from harness.figures.registry import figures

    rows = [
        (f"`{each.name}`", each.kind, each.unit, each.better, each.description)
        for each in figures().values()
    ]
    return _table(("figure", "kind", "unit", "better", "what it is"), rows)


def devices() -> str:
    """Return a table of the devices whose summaries people brought."""
    from harness.page.device_summaries import table

    return table(ROOT / "results" / "devices")


def profiles() -> str:
    """Return a table of the devices' laws."""
    from harness.profile.words import devices_table

    return _table(*devices_table(ROOT / "results" / "reference" / "profiles"))


def _table(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    return "\n".join(lines + ["| " + " | ".join(map(_cell, row)) + " |" for row in rows])


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


PARTS = {
    "commands": commands,
    "triangulators": triangulators,
    "criteria": criteria,
    "scenes": scenes,
    "rasterisers": rasterisers,
    "metrics": metrics,
    "devices": devices,
    "profiles": profiles,
}
