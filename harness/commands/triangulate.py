"""`harness triangulate`: write the triangles of a file of polygons, or of a model."""

import math
from pathlib import Path
from typing import Annotated

import typer

from harness.commands.many_files import lines_of_notes, triangulate_many_files
from harness.commands.options import (
    Dask,
    Layer,
    Limit,
    Quiet,
    Where,
    refuse_given,
    refuse_own_source,
)
from harness.errors import NothingMeasured, UsageError, refuse_failed
from harness.progress import Reporter

SAID_AFTER_S = 3.0
COMPILING = "still busy at the first; a first run also compiles what it needs ..."


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
            help="File to write: .glb, .gltf, .obj, .npz, .geojson or .parquet; of many "
            "files, and with --dask, a folder for GeoParquet parts.",
        ),
    ] = None,
    triangulator: Annotated[
        str | None,
        typer.Option(
            help="name or name:criterion, by default optimal:half-perimeter; "
            "optimal alone is optimal:overdraw. See: raster-harness list triangulators."
        ),
    ] = None,
    criterion: Annotated[
        str | None,
        typer.Option(
            help="The criterion, if it is not in the triangulator's name; alone it means optimal. "
            "E.g. mixed=1/0.5/0; see: raster-harness list criteria."
        ),
    ] = None,
    extrude: Annotated[
        str | None, typer.Option(help="Height of the blocks, or the attribute that holds it.")
    ] = None,
    layer: Layer = None,
    where: Where = None,
    limit: Limit = None,
    certify: Annotated[
        bool,
        typer.Option(
            "--certify", help="Say how far the triangulations are from the optimum, with proof."
        ),
    ] = False,
    evidence: Annotated[
        Path | None,
        typer.Option(
            help="With --certify: a file for the proofs, a line of JSON for each polygon, which "
            "check-evidence checks."
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help="Compute the optimum for the half-perimeter on gpu0, gpu1, ... or llvmpipe, for "
            "polygons of up to 64 vertices."
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Of a 3D model: only say what would change; write nothing."),
    ] = False,
    dask: Dask = None,
    quiet: Quiet = False,
) -> None:
    """Triangulate a file of polygons and write the triangles.

    Of many files, and with --dask, each part becomes a GeoParquet file in the folder -o. The same
    command, given again, does what is missing. Polygons that fail are named and left out, and the
    exit code is 5.

    The flat faces of a 3D model (.glb, .gltf, .obj) are triangulated again in place,
    for the shortest edges: the file keeps its format, every vertex, and what is seen.
    """
    source = Path(file)
    refuse_own_source(file, out)
    of_one: dict[str, object] = {"--limit": limit, "--device": device, "--evidence": evidence}
    if _stays_model(source, out, check):
        of_polygons: dict[str, object] = {
            "--triangulator": triangulator,
            "--extrude": extrude,
            "--layer": layer,
            "--where": where,
            "--certify": certify,
            "--dask": dask,
        }
        why = "is for polygons; for a 3D model choose --criterion only"
        refuse_given(of_one | of_polygons, why)
        _in_place(source, out, criterion, Reporter(quiet=quiet))
        return
    assert out is not None
    if evidence is not None and not certify:
        raise UsageError("--evidence is what --certify finds: give both")
    from harness.export.export import chosen, export_file
    from scenes.spec import joined
    from triangulators.devices import CPU

    reporter = Reporter(quiet=quiet)
    height = None if extrude is None else _height(extrude)
    name = chosen(triangulator, criterion)
    if dask or _many(file, out):
        refuse_given(of_one, "is for one file, without --dask")
        from harness.export.geo import parquet_module
        from harness.scaling.triangulated import Triangulating

        parquet_module()
        work = Triangulating(name, height, layer, where, certify)
        triangulate_many_files(file, out, work, dask, reporter)
        return

    def counted(polygons: int) -> None:
        needless()
        stage.complete(polygons)

    with (
        reporter.stage(f"triangulating {file}") as stage,
        reporter.if_long(COMPILING, SAID_AFTER_S) as needless,
    ):
        report = export_file(
            joined(file, layer=layer, where=where, limit=limit),
            out,
            name,
            extrude=height,
            progress=counted,
            certify=evidence or certify,
            device=device or CPU,
        )
    if report.notes:
        reporter.say(f"{file}: {'; '.join(report.notes)}")
    for line in lines_of_notes(report.counts, report.list_examples(*report.examples)):
        reporter.warn(line)
    if report.flat:
        reporter.warn(f"left flat {report.flat:,}: no usable height in {extrude}")
    typer.echo(
        f"{out}: {report.polygons:,} polygons, {report.triangles:,} triangles "
        f"in {report.seconds:.1f} s"
    )
    if report.certified is not None:
        typer.echo(f"{file}: {report.certified}")
    refuse_failed(report.counts, out)


def _stays_model(source: Path, out: Path | None, check: bool) -> bool:
    """Whether a 3D model is to be written as one, or only looked at."""
    from scenes.readers.reader import is_model

    if check and out is not None:
        raise UsageError("--check writes nothing: give -o or --check, not both")
    if not check and out is None:
        raise UsageError("say where to write: -o FILE")
    if out is None or not is_model(source):
        return out is None
    from harness.models.in_place import FORMATS

    return out.suffix.lower() in FORMATS


def _in_place(
    source: Path,
    out: Path | None,
    criterion: str | None,
    reporter: Reporter,
) -> None:
    """Triangulate a model's flat faces again, and say what came of it.

    out : None to say only what would
    """
    from harness.models.in_place import CRITERION, retriangulate
    from harness.models.views import VIEWS

    with (
        reporter.stage(f"looking at {source}") as stage,
        reporter.if_long(COMPILING, SAID_AFTER_S),
    ):
        done = retriangulate(source, out, criterion or CRITERION, tick=stage.complete)
    for reason, count in sorted(done.left.items()):
        typer.echo(f"{source}: {count:,} left as they are: {reason}", err=True)
    share = done.flat_area / done.area if done.area else 0.0
    typer.echo(
        f"{source}: {done.triangles:,} triangles, {done.flat:,} of them in {done.faces:,} "
        f"flat faces of two or more ({share:.0%} of the area)"
    )
    if not done.triangles:
        raise NothingMeasured(f"{source}: there is no triangle in it")
    if not done.changed:
        typer.echo(f"{out or source}: nothing to gain: no flat face has cheaper diagonals")
        return
    typer.echo(
        f"{out or source}: {done.changed:,} faces {'get' if out else 'would get'} other diagonals; "
        f"their triangles' sides are {1.0 - done.after / done.before:.1%} shorter in all. "
        "No vertex changes"
    )
    for seen in done.seen:
        lanes, quads = (
            f"{after / before - 1.0:+.1%}" if before else "none"
            for before, after in zip(seen.before, seen.after, strict=True)
        )
        typer.echo(
            f"seen from {VIEWS} sides at {seen.pixels} px, without depth: helper lanes {lanes}, "
            f"shaded quads {quads}"
        )


def _many(file: str, out: Path) -> bool:
    """Whether a name stands for many files: a pattern, or a folder; a file may be called [1]."""
    pattern = any(sign in file for sign in "*?[") and not Path(file).exists()
    return pattern or (Path(file).is_dir() and not out.suffix)


def _height(text: str) -> str | float:
    """Return a height in metres, or the name of the attribute that holds it."""
    try:
        height = float(text)
    except ValueError:
        return text
    return height if math.isfinite(height) else text
