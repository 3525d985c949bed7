"""Pipeline of `raster-harness triangulate FILE -o OUT`: read, triangulate, write."""

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from harness.atomic import Output
from harness.errors import InputError, StorageError, UsageError
from harness.export.geo import GeoJsonWriter, GeoParquetWriter
from harness.export.writers import (
    ExportMesh,
    ExportMetadata,
    GltfWriter,
    NpzWriter,
    ObjWriter,
    make_mesh,
)
from harness.machine.process import allow_user_module
from harness.triangulating.triangulate import describe_large_polygon, triangulate_many
from scenes import load
from scenes.files import Chunk, read, read_chunks
from scenes.readers.reader import is_model
from scenes.registry import split_parameters
from scenes.repair import Cleaned
from scenes.scene import NoteCounter
from scenes.spec import convert_arguments
from triangulators import TriangulationError, certify, full_name, parse
from triangulators.checking.evidence import make_claim
from triangulators.gpu import CPU
from triangulators.methods.optimal import LIMIT
from triangulators.polygon_arrays import PolygonArray, Triangulations

CHUNK_POLYGONS = 20_000  # in memory at a time

# `add` writes the mesh of a batch, `finish` completes the file.
Writer = GltfWriter | ObjWriter | NpzWriter | GeoJsonWriter | GeoParquetWriter

# Writers by suffix of the output.
FORMATS: dict[str, Callable[..., Writer]] = {
    ".glb": partial(GltfWriter, binary=True),
    ".gltf": partial(GltfWriter, binary=False),
    ".obj": ObjWriter,
    ".npz": NpzWriter,
    ".geojson": GeoJsonWriter,
    ".json": GeoJsonWriter,
    ".parquet": GeoParquetWriter,
    ".geoparquet": GeoParquetWriter,
}

GLTF_SUFFIXES = (".glb", ".gltf")

MODEL_SUFFIXES = (*GLTF_SUFFIXES, ".obj")  # 3D models

# Default order of a polygon's triangles, in which a GPU transforms few vertices twice.
ORDER = "walk"

DEFAULT_CRITERION = "half-perimeter"  # to certify if a triangulator has none, or a flip test


@dataclass
class Certified:
    """Certificates of a file's triangulations, summed over the polygons, in the source's units.

    largest_gap : maximum of (cost - lower_bound) / cost over the polygons
    refused : number of polygons whose triangulation is invalid or has T-junctions
    """

    criterion: str
    polygons: int = 0
    proven: int = 0
    cost: float = 0.0
    lower_bound: float = 0.0
    largest_gap: float = 0.0
    refused: int = 0

    @classmethod
    def create(cls, name: str) -> "Certified":
        """Return empty sums for the triangulator `name`."""
        entry, criterion = parse(name)
        if criterion is None or criterion in entry.tests:
            criterion = DEFAULT_CRITERION
        return cls(criterion)

    @classmethod
    def sum_parts(cls, parts: Sequence[Mapping[str, Any]]) -> "Certified":
        """Return the sums of one or more parts, which have the fields of a `Certified`."""
        result = cls(parts[0]["criterion"])
        for part in parts:
            for name in ("polygons", "proven", "cost", "lower_bound", "refused"):
                setattr(result, name, getattr(result, name) + part[name])
            result.largest_gap = max(result.largest_gap, part["largest_gap"])
        return result

    def certify_batch(
        self,
        polygons: NDArray[Any],
        triangulations: Triangulations,
        evidence: IO[str] | None = None,
    ) -> None:
        """Certify triangulations; write a proof of each, one per line, to `evidence`."""
        for number, (polygon, triangles) in enumerate(zip(polygons, triangulations, strict=True)):
            if number in triangulations.failed:
                continue
            try:
                certificate = certify(
                    polygon, triangles, self.criterion, evidence=evidence is not None
                )
            except TriangulationError:
                self.refused += 1
                continue
            if evidence is not None:
                claim = make_claim(polygon, triangles, self.criterion, certificate)
                evidence.write(json.dumps(claim) + "\n")
            self.polygons += 1
            self.proven += certificate.proven
            self.cost += certificate.cost
            self.lower_bound += certificate.lower_bound
            self.largest_gap = max(self.largest_gap, certificate.gap)

    def __str__(self) -> str:
        gap = (self.cost - self.lower_bound) / self.cost if self.cost > 0.0 else 0.0
        text = (
            f"{self.criterion} {self.cost:.6g}, at least {self.lower_bound:.6g}, gap {gap:.2%} "
            f"(largest of a polygon {self.largest_gap:.2%}), "
            f"{self.proven:,} of {self.polygons:,} proven optimal"
        )
        return text + (f", {self.refused:,} with T-junctions not certified" if self.refused else "")


@dataclass
class Report(NoteCounter):
    """Statistics of an export; "failed" are polygons that the triangulator could not triangulate.

    files : written files, the target first
    read, polygons : numbers of polygons that were read, and of those that were triangulated
    proven : number of polygons whose optimum was computed exactly
    evidence : open file of the proofs
    notes : lines about reading and projection of the file
    """

    files: list[Path] = field(default_factory=list)
    read: int = 0
    polygons: int = 0
    triangles: int = 0
    proven: int = 0
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
    triangulate_s: float = 0.0
    certified: Certified | None = None
    evidence: IO[str] | None = field(default=None, repr=False, compare=False)


def export_file(
    source: str | Path,
    out: str | Path,
    triangulator: str = "optimal:half-perimeter",
    *,
    progress: Callable[[int], None] | None = None,
    say: Callable[[str], None] | None = None,
    certify: bool | Path = False,
    device: str = CPU,
    chunk: int = CHUNK_POLYGONS,
    order: str = ORDER,
    polygons: bool = False,
    collection: bool = False,
    **parameters: Any,
) -> Report:
    """Triangulate a scene or a file of polygons and write the triangles to `out`.

    Polygons are read, triangulated and written `chunk` at a time, so memory does not grow with the
    file. `out` appears when complete; after an error it is unchanged.

    source : scene or file, with parameters as for `scenes.load`, e.g. "town.gpkg:limit=9"
    progress : called with the number of triangulated polygons
    say : called with a line before a polygon that may take minutes or hours
    certify : whether to bound each triangulation's distance from the optimum; or a file for the
        proofs
    polygons : write the rings to glTF as well (EXT_mesh_polygon); T-junctions are failures
    collection : write GeometryCollections, which are valid, in place of MultiPolygons
    device, order, parameters : as for `triangulators.triangulate_many`

    Raises SceneError if the source cannot be read, UsageError for an unknown format or
    triangulator, InputError if no polygon could be triangulated, StorageError if `out` cannot be
    written.
    """
    start = time.perf_counter()
    target = Path(out)
    make = _find_writer(target, polygons=polygons, collection=collection)
    name = resolve_triangulator_name(triangulator)
    report = Report(certified=Certified.create(name) if certify else None)
    evidence = certify if isinstance(certify, Path) else None
    chunks = _read_chunks(str(source), chunk, solid=target.suffix.lower() in MODEL_SUFFIXES)
    try:
        with ExitStack() as stack:
            output = stack.enter_context(Output(target))
            proofs = None if evidence is None else stack.enter_context(Output(evidence))
            if proofs is not None:
                report.evidence = proofs.open_published(mode="w")
            parameters |= {"order": order}
            options = TriangulationOptions(name, parameters, device, say, conforming=polygons)
            writer = export_chunks(chunks, partial(make, output), options, report, progress)
            if writer is None or report.triangles == 0:
                raise InputError(_format_empty_export(str(source), report))
            writer.finish()
            report.files = output.publish() + ([] if proofs is None else proofs.publish())
    except OSError as error:
        reason = error.strerror or error
        raise StorageError(f"{target}: cannot be written ({reason}); no file changed") from error
    report.seconds = time.perf_counter() - start
    return report


@dataclass(frozen=True)
class TriangulationOptions:
    """Options of a triangulation; conforming : True if triangulations with T-junctions fail."""

    name: str
    parameters: Mapping[str, Any]
    device: str = CPU
    say: Callable[[str], None] | None = None
    conforming: bool = False


def _read_chunks(source: str, size: int, *, solid: bool) -> Iterator[Chunk]:
    """Yield the polygons of a scene or a file, `size` at a time.

    solid : True if the output is a 3D model; then a 3D model as source raises UsageError
    """
    name, parameters, is_file = split_parameters(source)
    if not is_file:
        yield from _split_scene(source, size)
        return
    if solid and is_model(Path(name)):
        raise UsageError(
            f"{name}: a 3D model, whose faces would be laid out next to each other; measure the "
            f"model with `run --scene {name}`, or write .geojson, .parquet or .npz"
        )
    parameters = convert_arguments(name, read, parameters)  # refuses parameters of map tiles
    limit = parameters.pop("limit", None)
    if limit is not None and limit < 1:
        raise UsageError(f"limit={limit}: out of range; give 1 or more")
    remaining = math.inf if limit is None else limit
    for chunk in read_chunks(name, size=size, **parameters):
        polygons = chunk.cleaned.polygons
        if len(polygons) >= remaining:
            cleaned = replace(chunk.cleaned, polygons=polygons[: int(remaining)])
            table = None if chunk.attributes is None else chunk.attributes.iloc[: int(remaining)]
            yield replace(chunk, cleaned=cleaned, attributes=table)
            return
        remaining -= len(polygons)
        yield chunk


def _split_scene(source: str, size: int) -> Iterator[Chunk]:
    allow_user_module(source)
    scene = load(source)
    polygons = np.asarray(scene.polygons)
    for start in range(0, len(polygons), size):
        rows = slice(start, start + size)
        table = None if scene.attributes is None else scene.attributes.iloc[rows]
        notes: Any = ([], [], ()) if start else (scene.dropped, scene.repaired, scene.notes)
        cleaned = Cleaned(polygons[rows], np.arange(len(polygons))[rows], *notes[:2])
        yield Chunk(cleaned, table, scene.units, notes=notes[2], credit=scene.credit)


def export_chunks(
    chunks: Iterable[Chunk],
    make: Callable[[ExportMetadata], Writer],
    options: TriangulationOptions,
    report: Report,
    progress: Callable[[int], None] | None = None,
    *,
    empty: bool = False,
) -> Writer | None:
    """Triangulate chunks of a source, write them, and count them in `report`.

    make : called with the metadata of the first chunk; returns the writer
    empty : True to also write chunks without polygons

    Returns the unfinished writer, or None if no chunk was written.
    """
    writer: Writer | None = None
    for chunk in chunks:
        report.note("dropped", chunk.cleaned.dropped)
        report.note("repaired", chunk.cleaned.repaired)
        report.notes += chunk.notes
        if len(chunk.cleaned.polygons) == 0 and not empty:
            continue
        if writer is None:
            writer = make(
                ExportMetadata(options.name, chunk.units, chunk.credit, chunk.crs, chunk.projection)
            )
        mesh = _triangulate_chunk(chunk, options, report)
        writer.add(mesh)
        report.polygons += mesh.polygons
        report.triangles += len(mesh.triangles)
        if progress is not None:
            progress(report.polygons)
    return writer


def _find_writer(target: Path, *, polygons: bool, collection: bool) -> Callable[..., Writer]:
    """Return the writer for the suffix of `target`; raise UsageError if options do not fit."""
    suffix = target.suffix.lower()
    make = FORMATS.get(suffix)
    if make is None:
        raise UsageError(f"{target}: unknown suffix (choose from {', '.join(FORMATS)})")
    if target.is_dir():
        raise UsageError(f"{target}: is a folder; give the name of a file")
    if collection:
        if make not in (GeoJsonWriter, GeoParquetWriter):
            raise UsageError(
                f"{target}: --collection is for maps; give a .geojson or .parquet file"
            )
        return partial(make, collection=True)
    if polygons and suffix not in GLTF_SUFFIXES:
        raise UsageError(f"{target}: --polygons is for glTF; give a .glb or .gltf file")
    return partial(make, polygons=True) if polygons else make


def resolve_triangulator_name(triangulator: str | None, criterion: str | None = None) -> str:
    """Return the full name for the two options of a command; raise UsageError if invalid.

    The default is `optimal:half-perimeter`; a criterion without triangulator means `optimal`.
    """
    if triangulator is None:
        triangulator = "optimal" if criterion else "optimal:half-perimeter"
    if criterion and ":" in triangulator:
        raise UsageError(
            f"triangulator {triangulator!r} and criterion {criterion!r} are mutually exclusive: "
            "the triangulator's name has a criterion"
        )
    try:
        return full_name(f"{triangulator}:{criterion}" if criterion else triangulator)
    except TriangulationError as error:
        raise UsageError(str(error)) from error


def _triangulate_chunk(chunk: Chunk, options: TriangulationOptions, report: Report) -> ExportMesh:
    """Return the mesh of a chunk without failed polygons; count these and proofs in `report`."""
    if options.say and (line := describe_large_polygon(chunk.cleaned.polygons)):
        options.say(line)
    start = time.perf_counter()
    polygons = PolygonArray.from_shapely(chunk.cleaned.polygons)
    result = triangulate_many(
        polygons,
        options.name,
        conforming=options.conforming,
        device=options.device,
        **options.parameters,
    )
    report.triangulate_s += time.perf_counter() - start
    failed = [(f"polygon {report.read + k}", why) for k, why in sorted(result.failed.items())]
    report.note("failed", failed)
    report.read += len(polygons)
    if parse(options.name).entry.name == "optimal":
        # Optima of compiled code, and of the dynamic program over one ring, are exact.
        is_single_ring = polygons.ring_counts == 1
        exact = result.compiled | (is_single_ring & (polygons.vertex_counts <= LIMIT))
        exact[list(result.failed)] = False
        report.proven += int(exact.sum())
    if report.certified is not None:
        report.certified.certify_batch(chunk.cleaned.polygons, result, report.evidence)
    return make_mesh(polygons, result, chunk.attributes)


def _format_empty_export(source: str, report: Report) -> str:
    if notes := report.list_examples("failed", "dropped"):
        _, polygon, reason = notes[0]
        return f"{source}: no polygon could be triangulated ({polygon}: {reason}); no file written"
    return f"{source}: no polygon; no file written"
