"""One part triangulated into one GeoParquet file, and what such a file says of itself."""

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from harness.errors import UsageError
from harness.export.export import Certified, Meshing, Report, add_chunks
from harness.export.geo import GeoParquetWriter
from harness.scaling.dataset import Kind
from harness.scaling.parts import AT_A_TIME, Done, Part, about, lasting, make_part
from harness.stored.atomic import Output
from scenes.files import read_chunks

FOOTER = "raster_harness_part"
"""Name under which a part's file holds what it says of itself, as JSON."""


@dataclass(frozen=True)
class Options:
    """What the triangles depend on, beside the polygons.

    extrude : a height, or the attribute that holds it
    """

    triangulator: str
    extrude: str | float | None = None
    layer: str | None = None
    where: str | None = None
    certify: bool = False


def read_done(file: Path) -> Done | None:
    """Return what a part's file says of itself; None where it is no such file, or is damaged."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        metadata = parquet.read_metadata(file).metadata or {}
        return Done(**json.loads(metadata[FOOTER.encode()]))
    except (OSError, KeyError, TypeError, ValueError, pa.ArrowException):
        return None


def do_part(part: Part, options: Options, out: str, code: str, threads: int | None = 1) -> Done:
    """Triangulate a part and put its file into the folder `out`, unless it is there.

    threads : one for each core if None. Raises as `make_part` does
    """
    place = Path(out) / f"{part.key}.parquet"
    return make_part(place, code, read_done, lambda: _write(part, options, place, code, threads))


def _write(part: Part, options: Options, place: Path, code: str, threads: int | None) -> Done:
    report = Report(certified=Certified.of(options.triangulator) if options.certify else None)
    with Output(place, forced=True) as output:
        how = Meshing(options.triangulator, {"threads": threads}, options.extrude)
        chunks = read_chunks(
            part.path, layer=options.layer, where=options.where, rows=part.rows, size=AT_A_TIME
        )
        make = partial(GeoParquetWriter, output)
        writer = add_chunks(chunks, make, how, report, empty=True)
        done = _done(part, options, code, report)
        told = {FOOTER: json.dumps(lasting(done), sort_keys=True)}
        if writer is None:
            raise UsageError(f"{part.label}: the file ends before these rows")
        assert isinstance(writer, GeoParquetWriter)
        writer.finish(told)
        output.publish()
    return done


def _done(part: Part, options: Options, code: str, report: Report) -> Done:
    certified = report.certified
    counts = [[kind, reason, count] for (kind, reason), count in sorted(report.counts.items())]
    if report.flat:
        counts.append(["left flat", f"no usable height in {options.extrude}", report.flat])
    return Done(
        polygons=report.polygons,
        vertices=report.vertices,
        triangles=report.triangles,
        proven=report.proven if certified is None else certified.proven,
        counts=counts,
        certified=None if certified is None else asdict(certified),
        about=about(part, asdict(options), code),
        notes=report.notes,
        left_out=report.told("dropped", "failed"),
    )


TRIANGLES = Kind("triangulating", ".parquet", do_part, read_done)
