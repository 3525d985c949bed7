"""The mesh of a batch of triangulated polygons, and writers of OBJ, NumPy's .npz and glTF."""

import io
import json
from collections.abc import Container
from dataclasses import dataclass
from itertools import pairwise
from typing import IO, Any

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from harness.atomic import Output
from harness.models.gltf import write_glb
from scenes.projection import Projection
from scenes.readers.gltf import BIN, JSON, POLYGONS, RESTART, TRIANGLES
from triangulators.polygon_arrays import PolygonArray, Triangulations, offsets_of


@dataclass(frozen=True)
class ExportMesh:
    """Triangles of a batch of polygons.

    vertices : (n, 2) float64; triangles : (m, 3) int64 indices of vertices
    vertex_offsets, triangle_offsets : (p + 1,) offsets of the polygons
    rings : (n,) ring of each vertex, counted over all polygons
    attributes : one row per polygon
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    vertex_offsets: NDArray[np.int64]
    triangle_offsets: NDArray[np.int64]
    rings: NDArray[np.int64]
    attributes: pd.DataFrame

    @property
    def polygons(self) -> int:
        """Number of polygons."""
        return len(self.vertex_offsets) - 1

    @property
    def vertex_owners(self) -> NDArray[np.int64]:
        """Polygon of each vertex, (n,)."""
        return np.repeat(np.arange(self.polygons), np.diff(self.vertex_offsets))


def make_mesh(
    polygons: PolygonArray, triangulations: Triangulations, attributes: pd.DataFrame | None
) -> ExportMesh:
    """Return the mesh of a batch, without polygons that have no triangles."""
    counts = np.diff(triangulations.triangle_offsets)
    drawn = np.flatnonzero(counts)
    polygons, counts = polygons.take(drawn), counts[drawn]
    shift = np.repeat(polygons.vertex_offsets[:-1], counts)
    table = pd.DataFrame(index=drawn) if attributes is None else attributes.iloc[drawn]
    return ExportMesh(
        np.ascontiguousarray(polygons.coords, dtype=np.float64),
        triangulations.triangles.astype(np.int64) + shift[:, None],
        polygons.vertex_offsets,
        offsets_of(counts),
        np.repeat(np.arange(polygons.geom_offsets[-1]), np.diff(polygons.ring_offsets)),
        table.reset_index(drop=True),
    )


@dataclass(frozen=True)
class ExportMetadata:
    """Metadata of an export; crs : pyogrio's name of the source's coordinate reference system."""

    triangulator: str
    units: str
    credit: str = ""
    crs: str | None = None
    projection: Projection | None = None

    def to_source(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return vertices (n, 2) in the source's coordinates."""
        if self.projection is None:
            return vertices
        # Eleven decimals, a micrometre, reproduce the numbers of most sources exactly.
        degrees: NDArray[np.float64] = np.round(self.projection.inverse(vertices), 11)
        return degrees


def to_json_value(value: Any) -> Any:
    """Convert a value to JSON types; NaN becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, (list, tuple, np.ndarray)):
        return [to_json_value(item) for item in value]
    if isinstance(value, dict):
        return {str(k): to_json_value(v) for k, v in value.items()}
    return None if value is pd.NA or value is pd.NaT else str(value)


class ObjWriter:
    """Writes OBJ in the source's coordinates, a group per polygon, and attributes to a CSV file."""

    def __init__(self, output: Output, about: ExportMetadata) -> None:
        self._stream = output.open_published(mode="w")
        self._stream.write(f"# raster-harness, {about.triangulator}, units: {about.units}\n")
        if about.credit:
            self._stream.write(f"# {about.credit}\n")
        self._output = output
        self._table: IO[str] | None = None
        self._vertices = 0
        self._features = 0

    def add(self, mesh: ExportMesh) -> None:
        """Write a batch of triangulated polygons."""
        points = mesh.vertices.tolist()
        self._stream.write("".join([f"v {x!r} {y!r} 0.0\n" for x, y in points]))
        faces = (mesh.triangles + 1 + self._vertices).tolist()
        starts = mesh.triangle_offsets.tolist()
        lines = []
        for number, (start, end) in enumerate(pairwise(starts)):
            lines.append(f"g feature_{self._features + number}\n")
            lines += [f"f {a} {b} {c}\n" for a, b, c in faces[start:end]]
        self._stream.write("".join(lines))
        if mesh.attributes.shape[1]:
            numbers = pd.RangeIndex(self._features, self._features + mesh.polygons, name="feature")
            first = self._table is None
            self._table = self._table or self._output.open_published(".attributes.csv", "w")
            mesh.attributes.set_index(numbers).to_csv(self._table, header=first)
        self._vertices += len(points)
        self._features += mesh.polygons

    def finish(self) -> None:
        """Do nothing: the file is complete."""


def find_free_name(name: str, taken: Container[str]) -> str:
    """Return a name, followed by as many _ as it takes to differ from those that are taken."""
    while name in taken:
        name += "_"
    return name


class NpzWriter:
    """Writes arrays, for p polygons, n vertices and m triangles:

    vertices (n, 2) float64; triangles (m, 3) int64, indices of vertices; vertex_offsets and
    triangle_offsets (p + 1,) int64; attribute_NAME (p,) for each attribute, with _ for / and with
    further _ if another has the name, text except for numbers, dates and booleans; triangulator,
    units, credit.
    """

    def __init__(self, output: Output, about: ExportMetadata) -> None:
        self._output = output
        self._about = about
        self._spools: dict[str, tuple[IO[bytes], np.dtype[Any], tuple[int, ...]]] = {}
        self._lengths: dict[str, int] = {}
        self._tables: list[pd.DataFrame] = []
        self._totals = np.zeros(2, dtype=np.int64)

    def add(self, mesh: ExportMesh) -> None:
        """Write a batch of triangulated polygons."""
        vertices, triangles = self._totals.tolist()
        skip = int(bool(self._spools))  # the first offset is the last of the previous batch
        self._append_to_spool("vertices", mesh.vertices)
        self._append_to_spool("triangles", mesh.triangles + vertices)
        self._append_to_spool("vertex_offsets", mesh.vertex_offsets[skip:] + vertices)
        self._append_to_spool("triangle_offsets", mesh.triangle_offsets[skip:] + triangles)
        self._tables.append(mesh.attributes)
        self._totals += np.array([len(mesh.vertices), len(mesh.triangles)], dtype=np.int64)

    def finish(self) -> None:
        """Write the arrays, which are in temporary files, into the .npz file."""
        arrays: dict[str, Any] = {}
        for name, (spool, kind, shape) in self._spools.items():
            spool.flush()
            arrays[name] = np.memmap(spool, kind, "r", shape=(self._lengths[name], *shape))
        table = pd.concat(self._tables, ignore_index=True)
        for label, column in table.items():
            values: NDArray[Any] = column.to_numpy()
            if values.dtype.kind not in "biufM":
                texts = [
                    "" if is_missing else str(v)
                    for v, is_missing in zip(column, column.isna(), strict=True)
                ]
                values = np.array(texts, dtype=np.str_)
            arrays[find_free_name(f"attribute_{label}".replace("/", "_"), arrays)] = values
        for fact in ("triangulator", "units", "credit"):
            arrays[fact] = np.array(getattr(self._about, fact))
        np.savez(self._output.open_published(), **arrays)

    def _append_to_spool(self, name: str, array: NDArray[Any]) -> None:
        if name not in self._spools:
            self._spools[name] = (self._output.open_unpublished(name), array.dtype, array.shape[1:])
        self._spools[name][0].write(np.ascontiguousarray(array).tobytes())
        self._lengths[name] = self._lengths.get(name, 0) + len(array)


_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_STEPS = 2**24  # grid steps from a mesh's centre to its edge, integers that single precision holds

# Column-major rotation of the z axis (up) to glTF's y axis.
_UPRIGHT = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


def make_polygon_loops(
    mesh: ExportMesh,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return rings of polygons with conforming triangulations, as EXT_mesh_polygon stores them.

    loops : indices of vertices, exterior rings counter-clockwise, holes clockwise, RESTART between
    offsets : (p,) first index of each polygon in `loops`
    triangles : (m, 3) indices of the same vertices

    The first of coincident vertices of a polygon represents all: a triangulation need not use the
    others, and a loop's vertices must belong to triangles.
    """
    keys = np.column_stack((mesh.vertex_owners, mesh.vertices))
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    site = first[inverse.reshape(-1)]
    _, start, ring = np.unique(mesh.rings, return_index=True, return_inverse=True)
    end = np.append(start[1:], len(ring))
    is_exterior = np.isin(start, mesh.vertex_offsets[:-1])
    ccw = shapely.is_ccw(shapely.linearrings(mesh.vertices, indices=ring))
    index = np.arange(len(ring))
    loops = site[np.where((ccw == is_exterior)[ring], index, (start + end - 1)[ring] - index)]
    following = np.append(loops[1:], -1)
    following[end - 1] = loops[start]
    is_distinct = loops != following
    loops, ring = loops[is_distinct], ring[is_distinct]
    starts = np.flatnonzero(np.diff(ring, prepend=-1))
    return (
        np.insert(loops, starts[1:], RESTART),
        (starts + np.arange(len(starts)))[is_exterior],
        site[mesh.triangles],
    )


class GltfWriter:
    """Writes each batch as a mesh, with the attributes in `extras`, one list per column.

    glTF has single precision only, so positions are integers on a fine grid around the centre of
    each batch. The node's matrix, which readers use in double precision, restores coordinates.
    `_FEATURE_ID_0` is the polygon of each vertex within the mesh, as in EXT_mesh_features.
    """

    def __init__(
        self, output: Output, about: ExportMetadata, *, binary: bool, polygons: bool = False
    ) -> None:
        self._output = output
        self._about = about
        self._binary = binary
        self._polygons = polygons
        self._data = output.open_unpublished("data") if binary else output.open_published(".bin")
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._nodes: list[dict[str, Any]] = []
        self._meshes = output.open_unpublished("meshes", "w+")
        self._origin: NDArray[np.float64] | None = None

    def add(self, mesh: ExportMesh) -> None:
        """Write a batch of triangulated polygons."""
        if len(mesh.triangles) == 0:
            return
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        middle = np.round((low + high) / 2)
        if self._origin is None:
            # Nodes are relative to the first centre: viewers jitter at large map coordinates.
            self._origin = middle
        # One step for both axes, which preserves angles, and for z, which keeps the matrix
        # invertible in single precision.
        step = max(np.abs(mesh.vertices - middle).max(), 1e-30) / _STEPS
        grid = np.zeros((len(mesh.vertices), 3))
        grid[:, :2] = np.rint((mesh.vertices - middle) / step)
        feature = mesh.vertex_owners.astype("<f4")
        attributes = {
            "POSITION": self._add_accessor(grid.astype("<f4")),
            "_FEATURE_ID_0": self._add_accessor(feature),
        }
        triangles = mesh.triangles
        if self._polygons:
            loops, loop_offsets, triangles = make_polygon_loops(mesh)
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._add_accessor(triangles.astype("<u4").ravel()),
        }
        if self._polygons:
            extension = {
                "count": mesh.polygons,
                "indicesOffsets": self._add_accessor(
                    (3 * mesh.triangle_offsets[:-1]).astype("<u4")
                ),
                "loopIndices": self._add_accessor(loops.astype("<u4")),
                "loopIndicesOffsets": self._add_accessor(loop_offsets.astype("<u4")),
            }
            primitive |= {"mode": TRIANGLES, "extensions": {POLYGONS: extension}}
        matrix = np.diag([step, step, step, 1.0])
        matrix[:2, 3] = middle - self._origin
        self._nodes.append({"mesh": len(self._nodes), "matrix": matrix.T.ravel().tolist()})
        document: dict[str, Any] = {"primitives": [primitive]}
        if mesh.attributes.shape[1]:
            columns = {str(c): to_json_value(mesh.attributes[c].tolist()) for c in mesh.attributes}
            document["extras"] = {"attributes": columns}
        self._meshes.write(("," if len(self._nodes) > 1 else "") + json.dumps(document))

    def finish(self) -> None:
        """Write the JSON and, for .glb, the binary data."""
        assert self._origin is not None  # exports without triangles are not finished
        buffer: dict[str, Any] = {"byteLength": self._data.tell()}
        if not self._binary:
            buffer["uri"] = self._output.target.name + ".bin"
        children = list(range(1, len(self._nodes) + 1))
        # Node 0 rotates the map upright; the nodes of the batches are its children.
        document: dict[str, Any] = {
            "asset": {
                "version": "2.0",
                "generator": "raster-harness",
                "copyright": self._about.credit,
                "extras": {
                    "origin": self._origin.tolist(),
                    "units": self._about.units,
                    "crs": self._about.crs if self._about.projection is None else None,
                    "triangulator": self._about.triangulator,
                },
            },
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"matrix": _UPRIGHT, "children": children}, *self._nodes],
            "buffers": [buffer],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }
        if not self._about.credit:
            del document["asset"]["copyright"]
        if self._polygons:
            document["extensionsUsed"] = [POLYGONS]
        self._meshes.seek(0)
        start = json.dumps(document, separators=(",", ":"))[:-1]
        payload = f'{start},"meshes":[{self._meshes.read()}]}}'.encode()
        stream = self._output.open_published()
        if self._binary:
            chunks: list[tuple[bytes, IO[bytes]]]
            chunks = [(JSON, io.BytesIO(payload)), (BIN, self._data)]
            write_glb(stream, chunks, self._output.target)
        else:
            stream.write(payload)

    def _add_accessor(self, values: NDArray[Any]) -> int:
        """Add an accessor of indices (u4), or of scalars or positions (f4); return its index."""
        is_index, is_position = values.dtype.kind == "u", values.ndim == 2
        view = {"buffer": 0, "byteOffset": self._data.tell(), "byteLength": values.nbytes}
        self._data.write(values.tobytes())
        self._views.append(view | {"target": _INDICES if is_index else _VERTICES})
        accessor: dict[str, Any] = {
            "bufferView": len(self._views) - 1,
            "componentType": _UNSIGNED if is_index else _FLOAT,
            "count": len(values),
            "type": "VEC3" if is_position else "SCALAR",
        }
        if is_position:  # glTF requires the bounds of positions
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1
