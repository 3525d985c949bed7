"""`harness list` and `doctor`: the names that commands take, and what works on this machine."""

import json
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.text import Text

from harness.commands.options import Json
from harness.errors import NoRasteriser, unknown
from harness.progress import Screen

Row = dict[str, Any]
"""What is told of one name, by heading."""


def _scenes() -> Iterator[Row]:
    from scenes import registry

    for name in registry.names():
        entry = registry.entry(name)
        missing = entry.available()
        polygons, corners, holes = (None if missing else entry.size) or (None, None, None)
        yield {
            "scene": name,
            "polygons": polygons,
            "vertices": corners,
            "holes": holes,
            "licence of data": entry.licence,
            "description": missing or entry.description,
        }


def _triangulators() -> Iterator[Row]:
    from triangulators import registry

    for name in registry.names():
        entry = registry.find(name)
        told = entry.available() or entry.description
        yield {"triangulator": name, "holes": entry.handles_holes, "description": told}


def _rasterisers() -> Iterator[Row]:
    from harness import rasterisers

    for name in rasterisers.names():
        kind = rasterisers.get(name)
        devices = [device.name for device in kind.devices()]
        yield {"rasteriser": name, "devices": devices, "counters": list(kind.counters)}


def _criteria() -> Iterator[Row]:
    from triangulators import criteria

    for name in criteria.names():
        each = criteria.CRITERIA[name]
        told = {part: getattr(each, part) for part in ("symbol", "unit", "description")}
        yield {"criterion": name, **told}


def _metrics() -> Iterator[Row]:
    from harness.metrics.registry import figures

    for each in figures().values():
        parts = ("kind", "unit", "better", "best_case", "description")
        told = {part.replace("_", " "): getattr(each, part) for part in parts}
        yield {"figure": each.name, **told}


KINDS: dict[str, Callable[[], Iterator[Row]]] = {
    "scenes": _scenes,
    "triangulators": _triangulators,
    "rasterisers": _rasterisers,
    "criteria": _criteria,
    "metrics": _metrics,
}


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(value) or "none here"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:g}" if isinstance(value, float) else escape(str(value))


def catalogue(
    kind: Annotated[
        str | None, typer.Argument(help=f"One of: {', '.join(KINDS)}; all of them if absent.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List scenes, triangulators, rasterisers, criteria and metrics, or one kind of these."""
    from harness.style import plain_table

    if kind is not None and kind not in KINDS:
        raise unknown("kind of thing to list", kind, KINDS)
    found = {name: list(KINDS[name]()) for name in ([kind] if kind else KINDS)}
    if as_json:
        told = found[kind] if kind else found
        typer.echo(json.dumps(told, indent=2, ensure_ascii=False))
        return
    for name, rows in found.items():
        Screen().print(f"{name}\n" if kind is None else "", end="", style="bold")
        table = plain_table(None, *rows[0])
        for row in rows:
            table.add_row(*map(_cell, row.values()))
        Screen().print(table)
        Screen().print("\n" if kind is None else "", end="")


COLOURS = {"ok": "green", "warning": "yellow", "missing": "red"}


def doctor() -> None:
    """Check devices, drivers, extensions and timers; say how to repair what does not work."""
    from harness import rasterisers
    from harness.doctor import examine
    from harness.rasterisers import devices

    devices.forget()
    console = Screen(highlight=False)
    findings = examine()
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        line = Text(f"{finding.status:<8}", style=COLOURS[finding.status])
        line.append(f"{finding.name:<{width}}  {finding.detail}", style="default")
        console.print(line, soft_wrap=True)
        if finding.fix:
            console.print(f"{'':<8}{'':<{width}}  -> {finding.fix}", markup=False, soft_wrap=True)
    if not any(rasterisers.get(name).devices() for name in ("opengl", "webgpu")):
        raise NoRasteriser("no OpenGL or WebGPU device works here; see what to install, above")
