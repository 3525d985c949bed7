"""`harness inspect`: a picture of where a polygon's triangulations cost."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from harness.commands import options
from harness.errors import UsageError
from harness.progress import Reporter


def inspect(
    scene: options.SceneName,
    polygon: options.PolygonNumber = 0,
    triangulator: options.Triangulators = options.Several(
        ("ear-clipping", "optimal:half-perimeter")
    ),
    resolution: options.Resolution = 64,
    rotation: options.Rotation = 0.0,
    seed: options.Seed = 0,
    every: Annotated[
        Literal["conforming", "paper"] | None,
        typer.Option(
            help="Instead, list every triangulation with its criteria: conforming, without "
            "T-junctions, or paper, as in the paper."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="PNG to write, named after the polygon if absent; with --every, the folder."
        ),
    ] = None,
) -> None:
    """Draw overdraw and helper lanes of one polygon, side by side for several triangulators."""
    import numpy as np

    from harness.frame import View, make_frame
    from harness.measuring.loading import load_scene
    from harness.pictures.heatmaps import draw_heatmaps
    from harness.triangulating.frames import triangulate_polygons
    from harness.triangulating.recipes import parse_all

    if every is not None:
        _list_every(scene, polygon, every, out)
        return
    recipes = parse_all(triangulator, seed=seed)
    if out is not None:
        _require_writable(out)
    reporter = Reporter()
    loaded = load_scene(scene, seed, reporter)
    if polygon >= len(loaded.polygons):
        raise UsageError(f"{scene} has polygons 0 to {len(loaded.polygons) - 1}, not {polygon}")
    frame = make_frame([loaded.polygons[polygon]], View(resolution, rotation))
    if not frame.polygons:
        raise UsageError(f"polygon {polygon} of {scene}: {frame.dropped[0][1]}")
    frame = replace(frame, source=np.array([polygon]))  # its number in the scene, as a title
    file = out or Path(f"{Path(loaded.name).stem}-{polygon}.png")
    _require_writable(file)
    drawn = {}
    for recipe in recipes:
        recipe.load()
        with reporter.if_long(f"a first run compiles {recipe.base} ..."):
            result = triangulate_polygons(recipe, frame.polygons[:1])
        part = result.parts[0]
        if part is None:
            typer.echo(f"{recipe}: {[*result.skipped, *result.failed][0][1]}")
        else:
            drawn[str(recipe)] = part
    if not drawn:
        raise UsageError(f"no triangulator given can do polygon {polygon} of {scene}")
    try:
        draw_heatmaps(frame, 0, drawn, file)
    except OSError as error:
        raise UsageError(f"cannot write {file}: {error.strerror or error}") from error
    typer.echo(f"picture: {file}")


def _require_writable(file: Path) -> None:
    """Refuse a place that cannot be written, before any work is done."""
    folder = file.parent
    if file.suffix.lower() != ".png":
        raise UsageError(f"cannot write {file}: it is a PNG; give --out a name that ends in .png")
    if not folder.is_dir():
        raise UsageError(f"cannot write {file}: there is no folder {folder}")
    if not os.access(file if file.exists() else folder, os.W_OK):
        raise UsageError(f"cannot write {file}: Permission denied; give another --out")


def _list_every(
    scene: str, polygon: int, mode: Literal["conforming", "paper"], out: Path | None
) -> None:
    """List every triangulation of a polygon with its criteria; draw shape against overdraw."""
    from harness.commands.running import default_folder
    from harness.measuring.loading import load_scene
    from harness.pictures.style import plain_table
    from harness.stored import atomic
    from harness.study import enumeration
    from triangulators import Skipped, TriangulationError

    loaded = load_scene(scene, 0, Reporter())
    if polygon >= len(loaded.polygons):
        raise UsageError(f"{scene} has polygons 0 to {len(loaded.polygons) - 1}, not {polygon}")
    folder = out or default_folder(loaded.name, before="every-")
    try:
        table = enumeration.triangulation_table(loaded.polygons[polygon], mode)
        with atomic.folder(folder, added=True) as made:
            enumeration.write(table, loaded.polygons[polygon], made)
    except (Skipped, TriangulationError) as reason:
        raise UsageError(f"polygon {polygon} of {scene}: {reason}") from reason
    except OSError as error:
        raise UsageError(f"cannot use {folder}: {error.strerror or error}") from error
    columns = ("overdraw", "shape", "half_perimeter", "edge_length", "triangles", "conforming")
    shown = plain_table(None, *(f">{name}" for name in columns))
    for row in table.head(10)[list(columns)].itertuples(index=False):
        shown.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row))
    Console(highlight=False).print(shown)
    typer.echo(f"{len(table):,} triangulations; all in {folder}/triangulations.csv")
