"""Triangulation of each part into a GeoParquet file, whose footer has the part's result."""

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from harness.atomic import Output
from harness.errors import InputError
from harness.export.export import ORDER, Certified, Report, TriangulationOptions, export_chunks
from harness.export.geo import GeoParquetWriter
from harness.scaling.dataset import CHUNK_ROWS, FilePart, PartResult, PartWork
from scenes.files import read_chunks
from scenes.slices import Slices, cut_file

FOOTER = "raster_harness_part"  # key of the part's result, as JSON, in the footer


@dataclass(frozen=True)
class Triangulating(PartWork):
    """Settings of the triangulation of many files; a part's key depends on all settings."""

    title: ClassVar[str] = "triangulating"
    suffix: ClassVar[str] = ".parquet"

    triangulator: str
    layer: str | None = None
    where: str | None = None
    certify: bool = False
    order: str = ORDER

    def list_slices(self, path: str) -> Slices:
        """Return the slices of a file, which are ranges of rows."""
        return cut_file(path, self.layer, self.where)

    @staticmethod
    def read_result(file: Path) -> PartResult | None:
        """Return the result in a file's footer, or None if the file is missing or invalid."""
        import pyarrow as pa
        from pyarrow import parquet

        try:
            metadata = parquet.read_metadata(file).metadata or {}
            return PartResult(**json.loads(metadata[FOOTER.encode()]))
        except (OSError, KeyError, TypeError, ValueError, pa.ArrowException):
            return None

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Triangulate a part's rows, and write the GeoParquet file with the result."""
        report = Report(certified=Certified.create(self.triangulator) if self.certify else None)
        with Output(path, forced=True) as output:
            parameters = {"threads": threads, "order": self.order}
            options = TriangulationOptions(self.triangulator, parameters)
            chunks = read_chunks(
                part.path, layer=self.layer, where=self.where, rows=part.rows, size=CHUNK_ROWS
            )
            make = partial(GeoParquetWriter, output)
            writer = export_chunks(chunks, make, options, report, empty=True)
            if writer is None:
                raise InputError(
                    f"{part.label}: the file ends before these rows, so it has changed; give "
                    "another folder with -o"
                )
            assert isinstance(writer, GeoParquetWriter)
            certified = report.certified
            counts = [[*which, count] for which, count in sorted(report.counts.items())]
            done = PartResult(
                polygons=report.polygons,
                triangles=report.triangles,
                proven=report.proven if certified is None else certified.proven,
                counts=counts,
                certified=None if certified is None else asdict(certified),
                about=part.about,
                notes=report.notes,
                left_out=report.list_examples("dropped", "failed"),
            )
            writer.finish({FOOTER: json.dumps(asdict(done), sort_keys=True)})
            output.publish()
        return done
