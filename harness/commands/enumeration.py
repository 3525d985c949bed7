"""`harness enumerate`: every triangulation of a polygon, as the paper lists them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table

from harness.commands.options import PolygonNumber, SceneName
from harness.errors import UsageError
from harness.progress import Reporter


def enumerate_(
    scene: SceneName = "paper",
    polygon: PolygonNumber = 0,
    mode: Annotated[
        Literal["conforming", "paper"],
        typer.Option(
            help="conforming: without T-junctions; paper: as in the paper, which drops a vertex "
            "when its two edges have become one straight line."
        ),
    ] = "conforming",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the table and plot; results/enumerate-<scene>-<time> if absent."
        ),
    ] = None,
) -> None:
    """List every triangulation of a polygon with its criteria; draw shape against overdraw."""
    from harness.commands.results import default_folder
    from harness.measuring.loading import load_scene
    from harness.study import enumeration
    from triangulators import Skipped, TriangulationError

    loaded = load_scene(scene, 0, Reporter())
    if polygon >= len(loaded.polygons):
        raise UsageError(f"{scene} has polygons 0 to {len(loaded.polygons) - 1}, not {polygon}")
    folder = out or default_folder(loaded.name, before="enumerate-")
    try:
        table = enumeration.triangulation_table(loaded.polygons[polygon], mode)
        enumeration.write(table, loaded.polygons[polygon], folder)
    except (Skipped, TriangulationError) as reason:
        raise UsageError(f"polygon {polygon} of {scene}: {reason}") from reason
    except OSError as error:
        raise UsageError(f"cannot use {folder}: {error.strerror or error}") from error
    console = Console(highlight=False)
    shown = Table(box=None, pad_edge=False, header_style="bold")
    columns = ("overdraw", "shape", "half_perimeter", "edge_length", "triangles", "conforming")
    for name in columns:
        shown.add_column(name, justify="right")
    for row in table.head(10)[list(columns)].itertuples(index=False):
        shown.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row))
    console.print(shown)
    console.print(
        f"{len(table):,} triangulations; all in {folder}/triangulations.csv",
        markup=False,
        soft_wrap=True,
    )
