"""`harness triangulate` and `harness cache`: meshes from polygons, and what is kept of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.commands.options import Quiet
from harness.errors import UsageError
from harness.progress import Reporter
from harness.triangulating.database import Cache


def triangulate(
    file: Annotated[str, typer.Argument(help="A file of polygons, or a scene's name.")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="glb, gltf, obj, ply, stl, npz, geojson or parquet."),
    ],
    triangulator: Annotated[str, typer.Option(help="See: harness list triangulators.")] = "optimal",
    criterion: Annotated[
        str | None,
        typer.Option(
            help="For optimal, half-perimeter by default, and worst, e.g. mixed=1/0.5/0; "
            "see: list criteria."
        ),
    ] = None,
    extrude: Annotated[
        str | None, typer.Option(help="A height, or the attribute that holds it.")
    ] = None,
    layer: Annotated[str | None, typer.Option(help="Layer of the file.")] = None,
    where: Annotated[str | None, typer.Option(help="Filter, as in SQL: height > 10.")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Polygons to read at most.")] = None,
    cached: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Use the model database.")
    ] = True,
    quiet: Quiet = False,
) -> None:
    """Triangulate a file of polygons and write the triangles."""
    from harness.export.export import export_file

    reporter = Reporter(quiet=quiet)
    if criterion is None and triangulator == "optimal":
        criterion = "half-perimeter"
    height: str | float | None = extrude
    if extrude is not None:
        try:
            height = float(extrude)
        except ValueError:
            height = extrude
    cache = Cache(say=reporter.warn) if cached else None
    try:
        with reporter.counting(f"triangulating {file}") as counting:
            report = export_file(
                file,
                out,
                triangulator,
                criterion,
                extrude=height,
                layer=layer,
                where=where,
                limit=limit,
                cache=cache,
                progress=counting,
            )
    finally:
        if cache is not None:
            cache.close()
    if report.notes:
        reporter.say(f"{file}: {'; '.join(report.notes)}")
    for (kind, reason), count in sorted(report.counts.items()):
        reporter.warn(f"{kind} {count:,}: {reason}")
    Console().print(
        f"{out}: {report.polygons:,} polygons, {report.triangles:,} triangles "
        f"in {report.seconds:.1f} s",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )


def cache(
    action: Annotated[str, typer.Argument(help="info or clear")],
) -> None:
    """Show or empty the model database of triangulations."""
    if action not in ("info", "clear"):
        raise UsageError(f"cache {action}: say info or clear")
    console = Console(highlight=False)
    with Cache(say=Reporter().warn) as database:
        if action == "clear":
            count = database.clear()
            console.print(f"forgot {count:,} triangulations in {database.path}", markup=False)
            return
        info = database.info()
    console.print(
        f"{info.path}: {info.entries:,} triangulations, {info.file_bytes:,} bytes",
        markup=False,
        soft_wrap=True,
    )
    for name, (count, size) in info.by_triangulator.items():
        console.print(f"  {name}: {count:,}, {size:,} bytes", markup=False)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(triangulate)
    app.command()(cache)
