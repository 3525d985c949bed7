"""Parts of pages that are made from code and results; `make documents` and each build write them.

MkDocs calls the `on_*` functions as hooks; see its documentation on `hooks`.
"""

from __future__ import annotations

import csv
import importlib
import inspect
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT))


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in what a page asks for between `<!-- generated: name -->` and `<!-- end -->`."""
    return filled(markdown)


def on_post_build(config: Any) -> None:
    """Let try.html, which leads nowhere where there is no site, lead to the site's pages."""
    page = Path(config.site_dir) / "try.html"
    text = page.read_text(encoding="utf-8")
    link = r'<a href="\1.html">\2</a>'
    text = re.sub(r'<span data-page="([a-z/-]+)"(?: hidden)?>(.*?)</span>', link, text)
    page.write_text(text, encoding="utf-8")


def filled(markdown: str) -> str:
    """Return a page with all its generated parts written anew."""
    for name, make in PARTS.items():
        mark = f"<!-- generated: {name} -->\n"
        if mark in markdown:
            before, _, rest = markdown.partition(mark)
            _, end, after = rest.partition("<!-- end -->")
            assert end, f"{name} has no end"
            markdown = f"{before}{mark}\n{make().strip()}\n\n{end}{after}"
    return markdown


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
    from harness.page.device_summaries import plain_cell
    from harness.profile.words import devices_table

    return _table(*devices_table(ROOT / "results" / "reference" / "profiles"), plain_cell)


def python() -> str:
    """Return a section for each public name: its signature and its docstring."""
    parts = []
    for title, names in PUBLIC.items():
        parts.append(f"## {title}\n")
        for name in names:
            module, _, last = name.rpartition(".")
            found = getattr(importlib.import_module(module), last, None)
            if found is None or inspect.ismodule(found):
                found = importlib.import_module(name)
                own = (each for each in vars(found).values() if inspect.isclass(each))
                shown = [
                    (f"{name}.{each.__name__}", each) for each in own if each.__module__ == name
                ]
            else:
                shown = [(name, found)]
            for path, each in shown:
                told = _signature(each)
                parts.append(f"### {path}\n\n```text\n{told}{inspect.getdoc(each) or ''}\n```\n")
    return "\n".join(parts)


def _signature(each: Any) -> str:
    try:
        return f"{each.__name__}{inspect.signature(each)}\n\n"
    except ValueError:  # an enumeration, an exception
        return ""


PUBLIC = {
    "Triangulate": [
        "triangulators.triangulate",
        "triangulators.vertices",
        "triangulators.triangulate_many",
        "triangulators.flip",
        "triangulators.verify.verify",
        "triangulators.criteria.predict",
        "triangulators.criteria.Criterion",
        "triangulators.errors",
    ],
    "Scenes": ["scenes.registry.load", "scenes.scene.Scene"],
    "Measure": [
        "harness.frame.View",
        "harness.frame.Frame",
        "harness.frame.make_frame",
        "harness.measuring.plan.Plan",
        "harness.measuring.run.run",
        "harness.rasterisers.base",
    ],
    "Read runs": [
        "harness.stored.folder.read_run",
        "harness.stored.folder.read_arrays",
        "harness.stored.drawings.read",
        "harness.figures.registry.Figure",
        "harness.figures.intervals.paired_ratio",
        "harness.report.page.write_report",
    ],
    "Errors": ["harness.errors"],
}


def leaderboard() -> str:
    """Return a row for each triangulator, scene and device that results hold, at up to 1024 px."""
    from harness.page.device_summaries import plain_cell

    rows = []
    for file in sorted((ROOT / "results" / "reference").glob("*/*/summary.csv")):
        with file.open(encoding="utf-8", newline="") as stream:
            view = [row for row in csv.DictReader(stream) if _usual(row)]
        if len({(row["rasteriser"], row["triangulator"]) for row in view}) < len(view):
            continue  # several settings, of work or samples, that its rows do not tell apart
        bases = {row["rasteriser"]: row for row in view if row["triangulator"] == "ear-clipping"}
        for row in view:
            if (base := bases.get(row["rasteriser"])) and row["polygons"] == base["polygons"]:
                cells = [_over(row, base, name) for name in ("helper_lanes", "partial_quads")]
                time = [row.get(f"time_ratio{end}", "") for end in ("", "_low", "_high")]
                where = f"{row['device']} ({row['rasteriser']})"
                run = f"`{file.parent.relative_to(ROOT / 'results' / 'reference')}`"
                spent = f"{float(row['triangulate_ms']):.1f}" if row["triangulate_ms"] else ""
                rows.append(
                    (row["scene"], where, row["triangulator"], *cells, _time(time), spent, run)
                )
    for file in sorted((ROOT / "results" / "devices").glob("*.json")):
        told = json.loads(file.read_text(encoding="utf-8"))
        most = max((v["resolution"] for v in told["views"] if v["resolution"] <= 1024), default=0)
        for seen in (view for view in told["views"] if view["resolution"] == most):
            scene = seen["scene"] if most == 1024 else f"{seen['scene']}, {most} px"
            for name, found in seen["triangulators"].items():
                time = [str(value) for value in found["time"] or ("", "", "")]
                where = f"{told['device']} ({told['rasteriser']}), {told['cpu']}".rstrip(", ")
                rows.append((scene, where, name, "", "", _time(time), "", f"`{file.name}`"))
    rows.sort(key=lambda row: (row[0], row[1], row[5] or "9", row[3] or "9"))
    headings = ("scene", "device", "triangulator", "helper lanes", "partial quads", "draw time")
    return _table((*headings, "triangulating, ms", "run"), rows, plain_cell)


def _usual(row: dict[str, str]) -> bool:
    plain = {"resolution": "1024", "rotation": "0.0", "status": "ok", "order": "native"}
    rest = {"work": "0", "samples": "1"}
    return all(row.get(name, value) in (value, "") for name, value in (plain | rest).items())


def _over(row: dict[str, str], base: dict[str, str], name: str) -> str:
    values = [each.get(name) for each in (row, base)]
    return f"{float(values[0]) / float(values[1]):.3f}" if all(values) else ""


def _time(ends: list[str]) -> str:
    if not ends[0]:
        return ""
    low, high = (f"{float(end):.3f}" if end else "" for end in ends[1:])
    return f"{float(ends[0]):.3f} ({low} to {high})" if low else f"{float(ends[0]):.3f}"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _table(
    headings: tuple[str, ...],
    rows: list[tuple[str, ...]],
    cell: Callable[[str], str] = _cell,
) -> str:
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    return "\n".join(lines + ["| " + " | ".join(map(cell, row)) + " |" for row in rows])


PARTS = {
    "commands": commands,
    "triangulators": triangulators,
    "criteria": criteria,
    "scenes": scenes,
    "rasterisers": rasterisers,
    "metrics": metrics,
    "devices": devices,
    "profiles": profiles,
    "python": python,
    "leaderboard": leaderboard,
}
