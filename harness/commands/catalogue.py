"""`harness list`: the names that other commands take."""

from __future__ import annotations

from collections.abc import Callable

import typer
from rich.console import Console
from rich.table import Table

from harness.errors import unknown


def _scenes() -> Table:
    from scenes import registry

    table = _table("scene", "polygons", "vertices", "holes", "licence of data", "description")
    for name in registry.names():
        entry = registry.entry(name)
        missing = entry.available()
        sizes = ("", "", "") if missing else tuple(f"{size:,}" for size in entry.size())
        table.add_row(name, *sizes, entry.licence, missing or entry.description)
    return table


def _triangulators() -> Table:
    from triangulators import registry

    table = _table("triangulator", "holes", "description")
    for name in registry.names():
        entry = registry.find(name)
        missing = entry.available()
        table.add_row(name, "yes" if entry.handles_holes else "no", missing or entry.description)
    return table


def _rasterisers() -> Table:
    from harness import rasterisers

    table = _table("rasteriser", "devices", "counters")
    for name in rasterisers.names():
        kind = rasterisers.get(name)
        devices = ", ".join(device.name for device in kind.devices()) or "none here"
        table.add_row(name, devices, ", ".join(kind.counters))
    return table


def _criteria() -> Table:
    from triangulators import criteria

    table = _table("criterion", "symbol", "unit", "description")
    for name in criteria.names():
        each = criteria.CRITERIA[name]
        table.add_row(name, each.symbol, each.unit, each.description)
    return table


def _metrics() -> Table:
    from harness.figures.registry import figures

    table = _table("figure", "kind", "unit", "better", "best case", "description")
    for each in figures().values():
        best = "" if each.best_case is None else f"{each.best_case:g}"
        table.add_row(each.name, each.kind, each.unit, each.better, best, each.description)
    return table


KINDS: dict[str, Callable[[], Table]] = {
    "scenes": _scenes,
    "triangulators": _triangulators,
    "rasterisers": _rasterisers,
    "criteria": _criteria,
    "metrics": _metrics,
}


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def catalogue(
    kind: str = typer.Argument(help=f"One of: {', '.join(KINDS)}."),
) -> None:
    """List scenes, triangulators, rasterisers, criteria or metrics."""
    if kind not in KINDS:
        raise unknown("kind of thing to list", kind, KINDS)
    Console().print(KINDS[kind]())


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("list")(catalogue)
