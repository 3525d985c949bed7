"""`harness inspect`: heatmaps of a polygon's triangulations; savings for a file by size."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.commands import options
from harness.errors import InputError, UsageError
from harness.progress import Reporter, Screen
from harness.settings import RESOLUTIONS

if TYPE_CHECKING:
    from harness.frame import View
    from harness.triangulating.recipes import Recipe
    from scenes import Scene

PICTURE_TRIANGULATORS = ("ear-clipping", "optimal:half-perimeter")
SIZES_TRIANGULATORS = ("ear-clipping", "earcut-refine", "flips:l1", "optimal:half-perimeter")

SHAPE_OPTIMUM = "optimal:expected-quads"
"""Added to the defaults of --sizes with a profile: few of its triangles cover a pixel, which is
cheap on devices whose slowest stage handles these triangles."""


def _parse_sizes(text: str) -> options.ValueList:
    """Parse 16-1024 as 16, 32, ... 1024: doubling sizes, and the last size."""
    size = options.make_number_parser(int, *RESOLUTIONS, " pixels")
    low, _, high = text.partition("-")
    first, last = size(low), size(high or low)
    if first > last:
        raise typer.BadParameter(f"{text!r}: the first size exceeds the last; give e.g. 16-1024")
    sizes = [first]
    while 2 * sizes[-1] < last:
        sizes.append(2 * sizes[-1])
    return options.ValueList(dict.fromkeys([*sizes, last]))


def inspect(
    context: typer.Context,
    scene: Annotated[
        str, typer.Argument(metavar="FILE", help="A file of polygons, or a scene's name.")
    ],
    polygon: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Index, from 0, among the file's valid polygons; by default 0, with --sizes all.",
        ),
    ] = None,
    layer: options.Layer = None,
    condition: options.Condition = None,
    triangulator: Annotated[
        options.ValueList | None,
        typer.Option(
            parser=options.make_list_parser(),
            metavar="NAME,...",
            help="Triangulators, see: raster-harness list triangulators. With --sizes the first is "
            "the base of the comparison.",
        ),
    ] = None,
    resolution: options.Resolution = 64,
    rotation: options.Rotation = 0.0,
    seed: options.Seed = 0,
    sizes: Annotated[
        options.ValueList | None,
        typer.Option(
            parser=_parse_sizes,
            metavar="PX-PX",
            help="Instead of a picture, report whether the triangulator matters for the file, by "
            "counts at doubling viewport sizes, for example 16-1024.",
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            help="With --sizes: a device's profile, which converts counts to milliseconds. A "
            "file, or the name of a contributed profile, for example opengl-llvmpipe.",
        ),
    ] = None,
    as_json: options.Json = False,
    every: Annotated[
        Literal["conforming", "paper"] | None,
        typer.Option(
            help="Instead of a picture, list all triangulations of the polygon and their criteria. "
            "conforming: only those without T-junctions; paper: those that the paper's program "
            "finds; that program drops vertices that a cut has made collinear."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="PNG file for the picture; by default, FILE's name with the polygon's index. With "
            "--sizes: PNG or SVG file for a chart; by default, no chart is drawn. With --every: "
            "folder for the list of triangulations."
        ),
    ] = None,
) -> None:
    """Draw the costs of a polygon's triangulations, or report which triangulator suits a file.

    The picture shows overdraw and helper lanes of one polygon for several triangulators. With
    --sizes, all polygons are counted without drawing, and the result is one sentence.
    """
    from harness.frame import View
    from harness.measuring.plan import load_scene
    from harness.triangulating.recipes import parse_all
    from scenes.spec import join_name

    if every is not None and sizes is not None:
        raise UsageError("--every and --sizes are mutually exclusive")
    for name in ("profile", "as_json") if sizes is None else ("resolution",):
        if options.is_given(context, name):
            reason = "requires" if sizes is None else "cannot be combined with"
            raise UsageError(f"--{name.removeprefix('as_')} {reason} --sizes")
    for name in ("resolution", "rotation", "triangulator"):
        if every is not None and options.is_given(context, name):
            raise UsageError(f"--{name} cannot be combined with --every")
    default = PICTURE_TRIANGULATORS if sizes is None else SIZES_TRIANGULATORS
    if profile is not None:
        default = (*default, SHAPE_OPTIMUM)
    recipes = parse_all(triangulator or default, seed=seed)
    options.refuse_overwriting_input(scene, out)
    scene = join_name(scene, layer=layer, where=condition)
    loaded = load_scene(scene, seed, Reporter(quiet=as_json))
    if polygon is not None and polygon >= len(loaded.polygons):
        raise UsageError(f"{scene} has polygons 0 to {len(loaded.polygons) - 1}, not {polygon}")
    if polygon is not None and loaded.dropped:
        typer.echo(
            f"polygon {polygon}: counted from 0, among the {len(loaded.polygons):,} valid polygons",
            err=as_json,
        )
    if every is not None:
        _list_all_triangulations(loaded, polygon or 0, every, out)
    elif sizes is None:
        _draw_picture(loaded, polygon or 0, recipes, View(resolution, rotation), out)
    else:
        if polygon is not None:
            loaded = replace(loaded, polygons=loaded.polygons[polygon : polygon + 1])
        views = [View(size, rotation) for size in sizes]
        _compare_sizes(loaded, scene, recipes, views, profile, out, as_json=as_json)


def _draw_picture(
    scene: Scene, polygon: int, recipes: tuple[Recipe, ...], view: View, out: Path | None
) -> None:
    from harness import atomic
    from harness.frame import make_frame
    from harness.heatmaps import draw_heatmaps
    from harness.results.run_folder import make_file_stem
    from harness.triangulating.triangulate import triangulate_polygons

    frame = make_frame([scene.polygons[polygon]], view)
    if not frame.polygons:
        raise InputError(f"polygon {polygon} of {scene.name}: {frame.dropped[0][1]}")
    frame = replace(frame, source=frame.source + polygon)  # the number in the scene, for the title
    file = _prepare_file(out or Path(f"{make_file_stem(scene.name)}-{polygon}.png"), ".png")
    drawn = {}
    for recipe in recipes:
        recipe.load()
        with Reporter().say_if_long(f"a first run compiles {recipe.base} ..."):
            result = triangulate_polygons(recipe, frame.polygons)
        if result.drawn.all():  # all pieces into which the grid cuts the polygon
            drawn[str(recipe)] = frame.join_triangles(result.parts)
        else:
            typer.echo(f"{recipe}: {[*result.skipped, *result.failed][0][1]}")
    if not drawn:
        raise InputError(
            f"polygon {polygon} of {scene.name}: no triangulator succeeded; see the reasons above"
        )
    atomic.write(file, draw_heatmaps(frame, drawn))
    typer.echo(f"picture: {file}")


def _compare_sizes(
    scene: Scene,
    source: str,
    recipes: tuple[Recipe, ...],
    views: list[View],
    profile: str | None,
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    from harness import viewport_sizes
    from harness.profile.device_costs import find_profile, read_costs

    costs = read_costs(find_profile(profile, options.PROFILES)) if profile else None
    if len(recipes) < 2:
        raise UsageError(f"{recipes[0]}: nothing to compare with; give two or more triangulators")
    file = _prepare_file(out, ".png", ".svg") if out else None
    reporter = Reporter(quiet=as_json)
    if costs and not costs.is_here:
        reporter.warn(
            f"profile {profile}: measured on another machine ({costs.origin}), so times here may "
            "differ; make a profile here: raster-harness profile"
        )
    for recipe in recipes:
        recipe.load()
    counted = []
    with reporter.stage("counting", len(views)) as stage:
        for view in views:
            counted.append(viewport_sizes.count_size(scene, recipes, view, costs))
            stage.complete(len(counted))
    worst = max(counted, key=lambda size: size.skipped)
    if worst.skipped:
        reporter.warn(
            f"polygons counted at {worst.resolution} px: {worst.polygons:,}; skipped, as they "
            f"vanish on the grid or a triangulator fails: {worst.skipped:,}"
        )
    sizes = viewport_sizes.Sizes(scene.name, costs, tuple(counted), source)
    if file:
        viewport_sizes.draw_chart(sizes, file)
    if as_json:
        typer.echo(json.dumps(sizes.to_json(), indent=2, allow_nan=False))
        return
    Screen(highlight=False).print(*viewport_sizes.make_tables(sizes), sep="\n\n")
    for line in (viewport_sizes.summarise(sizes), *viewport_sizes.list_stages(sizes)):
        typer.echo(line)
    typer.echo(viewport_sizes.format_next_step(sizes))
    if file:
        typer.echo(f"chart: {file}")


def _prepare_file(out: Path, *endings: str) -> Path:
    if out.suffix.lower() not in endings:
        raise UsageError(
            f"cannot write {out}: give --out a name that ends in {' or '.join(endings)}"
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    return out


def _list_all_triangulations(
    scene: Scene, polygon: int, mode: Literal["conforming", "paper"], out: Path | None
) -> None:
    from harness import atomic
    from harness.commands.runs import choose_folder
    from harness.study.pareto import make_triangulation_table
    from harness.style import make_plain_table
    from triangulators import TriangulationError

    folder = choose_folder(scene.name, out, before="every-")
    try:
        table = make_triangulation_table(scene.polygons[polygon], mode)
    except TriangulationError as reason:
        raise InputError(f"polygon {polygon} of {scene.name}: {reason}") from reason
    with atomic.create_folder(folder, merge=True) as output:
        table.to_csv(output / "triangulations.csv", index=False)
    columns = ("overdraw", "shape", "half_perimeter", "edge_length", "triangles", "conforming")
    screen_table = make_plain_table(None, *(f">{name}" for name in columns))
    for row in table.head(10)[list(columns)].itertuples(index=False):
        screen_table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row))
    Screen(highlight=False).print(screen_table)
    typer.echo(f"{len(table):,} triangulations; written to {folder}/triangulations.csv")
