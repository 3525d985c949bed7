"""Faces of 3D models: n-gons of OBJ and PLY unchanged; of other models coplanar triangles, joined.

The library trimesh reads OFF and text STL, but cuts n-gons into triangles, and supports glTF and
binary STL only in part.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from scenes.readers.gltf import GltfFile, read_polygons, read_triangles
from scenes.readers.guard import MAX_LINE_CHARACTERS, number_lines
from scenes.readers.reader import RawChunk, Source
from scenes.repair import arrange_in_rows
from scenes.scene import Note, SceneError
from scenes.spec import import_optional

_FLAT = "each face in a plane, side by side"
_MAP = "the polygons of EXT_mesh_polygon"
_NO_PLANE = "has no area, or a NaN or infinite coordinate"
_MAX_DEVIATION = 1e-3  # of a vertex from the plane, relative to the face's size, without a note


def read(source: Source, size: int) -> Iterator[RawChunk]:  # noqa: ARG001 - a model is one chunk
    """Yield every face of a model as a polygon in the face's plane, laid out in rows.

    Horizontal faces are as seen from above, and vertical faces are upright. In a model of triangles
    only, coplanar neighbours are joined. Polygons of EXT_mesh_polygon that all lie in one
    horizontal plane are not moved.
    """
    suffix = source.path.suffix.lower()
    model = GltfFile(source.path) if suffix in (".glb", ".gltf") else None
    if model is not None and (rings := read_polygons(model)) is not None:
        if not rings:
            raise SceneError(f"{source.path} has no faces: give a model with faces")
        yield _flatten_polygons(rings)
        return
    dropped: list[Note] = []
    notes: tuple[str, ...] = (_FLAT,)
    if suffix in (".obj", ".ply"):
        vertices, faces = (parse_obj if suffix == ".obj" else parse_ply)(source.path)
        usable: dict[str, NDArray[np.int64]] = {}
        for number, face in enumerate(faces):
            if len(face) < 3:
                dropped.append((f"face {number}", "has fewer than 3 vertices"))
            elif face.min() < 0 or face.max() >= len(vertices):
                dropped.append((f"face {number}", "has a vertex not in the file"))
            else:
                usable[f"face {number}"] = face
        if not usable or any(len(face) > 3 for face in usable.values()):
            yield _flatten_faces([(label, [vertices[k]]) for label, k in usable.items()], dropped)
            return
        triangles = np.array(list(usable.values()))
    else:
        vertices, triangles, more_notes = _read_triangles(source, model)
        notes += more_notes
        if len(triangles) == 0:
            raise SceneError(f"{source.path} has no faces: give a model with faces")
    polygons, without_area = join_facets(*_merge_vertices(vertices, triangles))
    labels = [f"facet {i}" for i in range(len(polygons))]
    yield RawChunk(arrange_in_rows(polygons), labels, dropped=dropped + without_area, notes=notes)


def _flatten_polygons(polygons: list[list[NDArray[np.float64]]]) -> RawChunk:
    """Return polygons, each as rings (k, 3), unmoved if all are in one horizontal plane."""
    faces = [(f"polygon {number}", rings) for number, rings in enumerate(polygons)]
    heights = np.concatenate([ring[:, 2] for rings in polygons for ring in rings])
    if np.ptp(heights) != 0.0 or any(len(ring) < 3 for rings in polygons for ring in rings):
        return _flatten_faces(faces, [])
    shapes = [shapely.Polygon(rings[0][:, :2], [r[:, :2] for r in rings[1:]]) for rings in polygons]
    return RawChunk(shapes, [label for label, _ in faces], notes=(_MAP,))


def _flatten_faces(
    faces: list[tuple[str, list[NDArray[np.float64]]]], dropped: list[Note]
) -> RawChunk:
    """Return faces (label, rings (k, 3)) as polygons, laid out in rows; extend `dropped`."""
    polygons, labels, repaired = [], [], []
    for label, rings in faces:
        polygon, deviation = _flatten_face(rings)
        if polygon is None:
            dropped.append((label, _NO_PLANE))
            continue
        if deviation > _MAX_DEVIATION:
            repaired.append((label, f"is not planar by {deviation:.2g} of the size; projected"))
        polygons.append(polygon)
        labels.append(label)
    return RawChunk(
        arrange_in_rows(polygons), labels, dropped=dropped, repaired=repaired, notes=(_FLAT,)
    )


def _flatten_face(rings: list[NDArray[np.float64]]) -> tuple[shapely.Polygon | None, float]:
    """Return rings (k, 3) as a polygon in the plane of the first, and the polygon's deviation.

    The polygon is None if the ring has no area, or a NaN or infinite coordinate.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        centre = rings[0].mean(axis=0)
        local = rings[0] - centre
        following = np.roll(local, -1, axis=0)
        # Newell's method: the normal is correct for concave and for slightly bent faces.
        normal = np.cross(local, following).sum(axis=0)
        length = np.linalg.norm(normal)
    if not np.isfinite(length) or length == 0.0:
        return None, 0.0
    axes = compute_axes(normal / length)
    size = np.abs(local).max()
    exterior, *holes = [(ring - centre) @ axes.T for ring in rings]
    height = max(float(np.abs(ring[:, 2]).max()) for ring in (exterior, *holes))
    return shapely.Polygon(exterior[:, :2], [hole[:, :2] for hole in holes]), height / float(size)


def compute_axes(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes of a right-handed frame as rows x, y, normal (3,); x is horizontal, y up."""
    x = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(x) < 1e-9:
        x = np.array([1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(normal, x), normal])


def _read_triangles(
    source: Source, model: GltfFile | None
) -> tuple[NDArray[np.float64], NDArray[np.int64], tuple[str, ...]]:
    """Return vertices (n, 3), triangles (m, 3) and notes of a model in glTF, STL or OFF."""
    suffix = source.path.suffix.lower()
    if model is not None:
        vertices, triangles, skipped = read_triangles(model)
        notes = (f"{skipped} primitive(s) of points or lines skipped",) if skipped else ()
        return vertices, triangles, notes
    corners = _read_binary_stl(source.path) if suffix == ".stl" else None
    if corners is not None:
        return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), ()
    import trimesh  # slow to import

    mesh = trimesh.load_mesh(source.path, process=False)
    triangles = np.asarray(getattr(mesh, "faces", np.empty((0, 3), int)), dtype=np.int64)
    return np.asarray(getattr(mesh, "vertices", np.empty((0, 3))), float), triangles, ()


def _read_binary_stl(path: Path) -> NDArray[np.float64] | None:
    """Return the vertices (m, 3, 3) of binary STL, or None for text STL."""
    data = path.read_bytes()
    stated = int.from_bytes(data[80:84], "little")
    is_text = data[:100].lstrip().lower().startswith(b"solid") and b"facet" in data.lower()
    excess = len(data) - (84 + 50 * stated)
    if excess < 0 or (is_text and excess):
        return None
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners: NDArray[np.float64] = np.frombuffer(data, record, stated, 84)["corners"].astype(float)
    return corners


def _merge_vertices(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the distinct vertices (k, 3), and the triangles (m, 3) as indices of these.

    Coordinates are compared in steps of 2^-30 of the model's size, because the matrices of glTF
    round equal vertices differently.
    """
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if len(finite):
        low, high = finite.min(axis=0), finite.max(axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            step = max(float((high - low).max()) * 2.0**-30, float(np.finfo(float).tiny))
            cells = np.rint((vertices - low) / step)
    else:
        cells = vertices
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return vertices[first], index.reshape(-1)[triangles]


def join_facets(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[list[Any], list[Note]]:
    """Return coplanar neighbouring triangles as polygons, and notes on triangles without area."""
    import trimesh

    polygons: list[Any] = []
    dropped: list[Note] = []
    # The second side of a sheet is a layer of its own: its triangles have the same vertices.
    corners = pd.DataFrame(np.sort(triangles, axis=1))
    layer = corners.groupby([0, 1, 2]).cumcount().to_numpy()
    for number in range(layer.max(initial=-1) + 1):
        members = np.flatnonzero(layer == number)
        mesh = trimesh.Trimesh(vertices, triangles[members], process=False)
        groups = [members[group] for group in mesh.facets]
        single = np.setdiff1d(members, np.concatenate([*groups, np.empty(0, int)]))
        for group in [*groups, *single[:, None]]:
            facets = _join_facet(vertices[triangles[group]])
            polygons += facets
            if not facets:
                dropped += [(f"triangle {i}", _NO_PLANE) for i in group]
    return polygons, dropped


def _join_facet(corners: NDArray[np.float64]) -> list[Any]:
    """Return coplanar triangles (m, 3, 3) as a polygon for each side that has triangles.

    Triangles of both orientations are one side, with some reversed, unless they overlap.
    """
    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    largest = normals[np.argmax((normals**2).sum(axis=1))]
    is_front = normals @ largest >= 0.0
    normal = np.where(is_front[:, None], normals, -normals).sum(axis=0)
    length = np.linalg.norm(normal)
    if not np.isfinite(length) or length == 0.0:
        return []
    flat = shapely.polygons((corners - corners[0, 0]) @ compute_axes(normal / length)[:2].T)
    area = shapely.union_all(flat)
    if is_front.all() or area.area > (1.0 - 1e-9) * shapely.area(flat).sum():
        return [area]
    return [*_join_facet(corners[is_front]), *_join_facet(corners[~is_front])]


def parse_obj(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.int64]]]:
    """Return the vertices (n, 3) of an OBJ file, and the indices (k,), unchecked, of each face."""
    vertices: list[list[float]] = []
    faces: list[NDArray[np.int64]] = []
    for number, line in _join_continued_lines(path):
        fields = line.partition("#")[0].split()
        try:
            if fields[:1] == ["v"]:
                x, y, z = map(float, fields[1:4])
                vertices.append([x, y, z])
            elif fields[:1] == ["f"]:
                # "7/1/3" is the seventh vertex, and "-1" the last vertex before the face.
                stated = np.array([int(word.partition("/")[0]) for word in fields[1:]], np.int64)
                from_end = np.where(stated < 0, len(vertices) + stated, -1)
                faces.append(np.where(stated > 0, stated - 1, from_end))
        except ValueError as error:
            text = line.strip()[:60]
            raise SceneError(f"{path} line {number} is not OBJ: {text!r}") from error
    if not faces:
        raise SceneError(f"{path} has no faces: give a model with faces")
    return np.array(vertices, dtype=float).reshape(-1, 3), faces


def _join_continued_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (number, line) of a text file; a line that ends in a backslash continues."""
    parts: list[str] = []
    number = length = 0
    for number, line in number_lines(path):
        text = line.rstrip("\r\n")
        length += len(text)
        if text.endswith("\\") and length < MAX_LINE_CHARACTERS:
            parts.append(text[:-1])
            continue
        yield number, " ".join([*parts, text])
        parts, length = [], 0
    if parts:
        yield number, " ".join(parts)


_INDICES = ("vertex_indices", "vertex_index")  # names of the list of a face's vertices in PLY


def parse_ply(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.int64]]]:
    """Return the vertices (n, 3) of a PLY file, and the indices (k,), from 0, of each face."""
    data = import_optional("plyfile", path, "ply").PlyData.read(path, mmap=False)
    if "face" not in data or not len(data["face"].data):
        raise SceneError(f"{path} has no faces: give a model with faces")
    vertex, face = data["vertex"].data, data["face"].data
    name = next((name for name in _INDICES if name in face.dtype.names), None)
    if name is None:
        raise SceneError(f"{path} has faces without {_INDICES[0]}: give a model with polygons")
    vertices = np.column_stack([np.asarray(vertex[axis], dtype=float) for axis in "xyz"])
    return vertices, [np.atleast_1d(np.asarray(row, dtype=np.int64)) for row in face[name]]
