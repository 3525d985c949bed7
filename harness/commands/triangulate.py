"""`harness triangulate`: write the triangles of polygons, or a model with other diagonals."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.commands.many_files import format_notes, triangulate_many_files
from harness.commands.options import (
    Condition,
    Dask,
    Layer,
    Limit,
    Quiet,
    Verbose,
    refuse_given,
    refuse_overwriting_input,
)
from harness.errors import (
    NothingMeasuredError,
    UsageError,
    raise_if_failed,
)
from harness.progress import Reporter

NOTE_AFTER_S = 3.0
COMPILING = "still busy with the first polygons; a first run also compiles the triangulator ..."


def triangulate(
    file: Annotated[
        str,
        typer.Argument(
            help="A file of polygons, a scene's name, or many files: 'parts/*.parquet', a folder."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write: .glb, .gltf, .obj, .npz, .geojson or .parquet. For many "
            "files, or with --dask: a folder for GeoParquet parts.",
        ),
    ] = None,
    triangulator: Annotated[
        str | None,
        typer.Option(
            help="name or name:criterion, by default optimal:half-perimeter; "
            "optimal means optimal:overdraw. See: raster-harness list triangulators."
        ),
    ] = None,
    criterion: Annotated[
        str | None,
        typer.Option(
            help="Criterion to minimise, if the triangulator's name has none; the default "
            "triangulator is then optimal. E.g. mixed=1/0.5/0; see: raster-harness list criteria."
        ),
    ] = None,
    layer: Layer = None,
    condition: Condition = None,
    limit: Limit = None,
    certify: Annotated[
        bool,
        typer.Option("--certify", help="Print a proven bound on the distance from the optimum."),
    ] = False,
    evidence: Annotated[
        Path | None,
        typer.Option(
            help="With --certify: file for the proofs, a line of JSON for each polygon; see the "
            "command check-evidence."
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help="Compute the optimum for half-perimeter or expected-quads on gpu0, gpu1, ... or "
            "llvmpipe, for polygons of up to 64 vertices."
        ),
    ] = None,
    order: Annotated[
        Literal["walk", "native"] | None,
        typer.Option(
            help="Order of each polygon's triangles: walk, from neighbour to neighbour (default), "
            "or native, the triangulator's. A 3D model keeps its own order."
        ),
    ] = None,
    polygons: Annotated[
        bool,
        typer.Option(
            "--polygons",
            help="Write the polygons' rings to .glb or .gltf as well, in the draft extension "
            "EXT_mesh_polygon; a polygon whose triangulation has T-junctions fails.",
        ),
    ] = False,
    collection: Annotated[
        bool,
        typer.Option(
            "--collection",
            help="For .geojson and .parquet: write a GeometryCollection per polygon, which PostGIS "
            "and shapely accept as valid, in place of a MultiPolygon.",
        ),
    ] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="For a 3D model: only print the changes; write no file."),
    ] = False,
    dask: Dask = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Triangulate a file of polygons and write the triangles.

    With many files, or --dask, each part becomes a GeoParquet file in the folder -o. The same
    command, run again, processes the missing parts. Polygons that fail are named and skipped, and
    the exit code is 5.

    The flat faces of a 3D model (.glb, .gltf, .obj) are triangulated again in place, for the
    shortest edges; the file's format, vertices and appearance stay the same.
    """
    source = Path(file)
    refuse_overwriting_input(file, out)
    refuse_overwriting_input(file, evidence, "--evidence")
    single_file_options: dict[str, object] = {
        "--limit": limit,
        "--device": device,
        "--evidence": evidence,
        "--polygons": polygons,
        "--collection": collection,
    }
    if _is_model_output(source, out, check):
        polygon_options: dict[str, object] = {
            "--triangulator": triangulator,
            "--layer": layer,
            "--where": condition,
            "--certify": certify,
            "--dask": dask,
            "--order": order,
        }
        refuse_given(
            single_file_options | polygon_options,
            "is for polygons; for a 3D model give only --criterion",
        )
        _retriangulate_model(source, out, criterion, Reporter(quiet=quiet, verbose=verbose))
        return
    assert out is not None
    if evidence is not None and not certify:
        raise UsageError("--evidence requires --certify: give both")
    if evidence is not None and evidence.resolve() == out.resolve():
        raise UsageError(f"--evidence {evidence}: also the name of -o; give another name")
    from harness.export.export import ORDER, export_file, resolve_triangulator_name
    from scenes.spec import join_name
    from triangulators.gpu import CPU

    reporter = Reporter(quiet=quiet, verbose=verbose)
    name = resolve_triangulator_name(triangulator, criterion)
    if dask or _is_many_files(file, out):
        refuse_given(single_file_options, "is for one file, without --dask")
        from harness.export.geo import import_parquet
        from harness.scaling.triangulated import Triangulating

        import_parquet()
        work = Triangulating(name, layer, condition, certify, order or ORDER)
        triangulate_many_files(file, out, work, dask, reporter)
        return

    def report_progress(polygons: int) -> None:
        cancel_note()
        stage.complete(polygons)

    with (
        reporter.stage(f"triangulating {file}") as stage,
        reporter.say_if_long(COMPILING, NOTE_AFTER_S) as cancel_note,
    ):
        report = export_file(
            join_name(file, layer=layer, where=condition, limit=limit),
            out,
            name,
            progress=report_progress,
            say=reporter.say,
            certify=evidence or certify,
            device=device or CPU,
            order=order or ORDER,
            polygons=polygons,
            collection=collection,
        )
    if report.notes:
        reporter.say(f"{file}: {'; '.join(report.notes)}")
    for line in format_notes(report.counts, report.list_examples(*report.examples)):
        reporter.warn(line)
    typer.echo(
        f"{out}: {report.polygons:,} polygons, {report.triangles:,} triangles "
        f"in {report.seconds:.1f} s"
    )
    if report.certified is not None:
        typer.echo(f"{file}: {report.certified}")
    raise_if_failed(report.counts, out)


def _is_model_output(source: Path, out: Path | None, check: bool) -> bool:
    """Return whether a model is written as a model, or only checked; require -o or --check."""
    from scenes.readers.reader import is_model

    if check and out is not None:
        raise UsageError("--check and -o are mutually exclusive: --check writes no file")
    if not check and out is None:
        raise UsageError("-o FILE is missing: give the file to write")
    if out is None or not is_model(source):
        return out is None
    from harness.models.in_place import FORMATS

    return out.suffix.lower() in FORMATS


def _retriangulate_model(
    source: Path,
    out: Path | None,
    criterion: str | None,
    reporter: Reporter,
) -> None:
    """Triangulate a model's flat faces again into `out`, if given, and print the changes."""
    from harness.models.in_place import CRITERION, retriangulate
    from harness.models.views import VIEWS

    with (
        reporter.stage(f"analysing {source}") as stage,
        reporter.say_if_long(COMPILING, NOTE_AFTER_S),
    ):
        result = retriangulate(source, out, criterion or CRITERION, tick=stage.complete)
    for reason, count in sorted(result.unchanged.items()):
        typer.echo(f"{source}: {count:,} unchanged: {reason}", err=True)
    share = result.flat_area / result.area if result.area else 0.0
    typer.echo(
        f"{source}: {result.triangles:,} triangles, {result.flat:,} of them in {result.faces:,} "
        f"flat faces of two or more triangles ({share:.0%} of the area)"
    )
    if not result.triangles:
        raise NothingMeasuredError(f"{source} has no triangles; export the model with its faces")
    if not result.changed:
        typer.echo(f"{out or source}: no change: no flat face has cheaper diagonals")
        return
    typer.echo(
        f"{out or source}: {result.changed:,} faces "
        f"{'get' if out else 'would get'} other diagonals; "
        f"the sum of their triangles' edges is {1.0 - result.after / result.before:.1%} shorter. "
        "No vertex changes"
    )
    for view in result.views:
        lanes, quads = (
            f"{after / before - 1.0:+.1%}" if before else "none"
            for before, after in zip(view.before, view.after, strict=True)
        )
        typer.echo(
            f"from {VIEWS} directions at {view.pixels} px, without depth test: "
            f"helper lanes {lanes}, shaded quads {quads}"
        )


def _is_many_files(file: str, out: Path) -> bool:
    """Return whether `file` means many files: a pattern, or a folder if `out` has no suffix."""
    from scenes.spec import parse_name

    name, _ = parse_name(file)  # a condition may contain *
    pattern = any(sign in name for sign in "*?[") and not Path(name).exists()
    return pattern or (Path(name).is_dir() and not out.suffix)
