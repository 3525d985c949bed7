"""`harness list`: the names that commands accept."""

import json
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer
from rich.markup import escape

from harness.commands.options import Json
from harness.errors import make_unknown_name_error
from harness.progress import Screen

Row = dict[str, Any]  # values by column heading


def _list_scenes() -> Iterator[Row]:
    from scenes import registry

    for name in registry.names():
        entry = registry.find_entry(name)
        missing = entry.find_install_command()
        polygons, vertices, holes = (None if missing else entry.size) or (None, None, None)
        yield {
            "scene": name,
            "polygons": polygons,
            "vertices": vertices,
            "holes": holes,
            "licence of data": entry.licence,
            "description": missing or entry.description,
        }


def _list_triangulators() -> Iterator[Row]:
    from triangulators import registry

    for name in registry.names():
        entry = registry.find(name)
        description = entry.find_install_command() or entry.description
        yield {"triangulator": name, "holes": entry.handles_holes, "description": description}


def _list_rasterisers() -> Iterator[Row]:
    from harness import rasterisers

    for name in rasterisers.names():
        kind = rasterisers.get(name)
        devices = [device.name for device in kind.devices()]
        yield {"rasteriser": name, "devices": devices, "counters": list(kind.counters)}


def _list_criteria() -> Iterator[Row]:
    from triangulators import criteria

    for name in criteria.names():
        criterion = criteria.CRITERIA[name]
        fields = ("symbol", "unit", "description")
        yield {"criterion": name, **{field: getattr(criterion, field) for field in fields}}


def _list_metrics() -> Iterator[Row]:
    from harness.metrics.registry import list_metrics

    fields = ("kind", "unit", "better", "best_case", "description")
    for metric in list_metrics().values():
        row = {field.replace("_", " "): getattr(metric, field) for field in fields}
        yield {"figure": metric.name, **row}


KINDS: dict[str, Callable[[], Iterator[Row]]] = {
    "scenes": _list_scenes,
    "triangulators": _list_triangulators,
    "rasterisers": _list_rasterisers,
    "criteria": _list_criteria,
    "metrics": _list_metrics,
}


def _format_cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(value) or "none here"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:g}" if isinstance(value, float) else escape(str(value))


def list_(
    kind: Annotated[
        str | None, typer.Argument(help=f"One of: {', '.join(KINDS)}; all if absent.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List scenes, triangulators, rasterisers, criteria and metrics, or one kind."""
    from harness.style import make_plain_table

    if kind is not None and kind not in KINDS:
        raise make_unknown_name_error("list", kind, KINDS)
    rows_of = {name: list(KINDS[name]()) for name in ([kind] if kind else KINDS)}
    if as_json:
        content = rows_of[kind] if kind else rows_of
        typer.echo(json.dumps(content, indent=2, ensure_ascii=False))
        return
    for name, rows in rows_of.items():
        Screen().print(f"{name}\n" if kind is None else "", end="", style="bold")
        table = make_plain_table(None, *rows[0])
        for row in rows:
            table.add_row(*map(_format_cell, row.values()))
        Screen().print(table)
        Screen().print("\n" if kind is None else "", end="")
