"""Flat faces of a mesh: connected triangles in a plane with affine vertex attributes.

The diagonals of a flat face do not change the picture: position, texture coordinates and the
remaining interpolated attributes are affine functions on the face.

Two adjacent triangles a, b, c and d, c, b are joined if the four vertices are coplanar and the
attributes agree. Four points of a plane have an affine dependency: weights w_a, ..., w_d of sum 0
with w_a a + w_b b + w_c c + w_d d = 0. With weights scaled to absolute values of sum 2, the same
combination of an attribute is the largest difference between the two diagonals, at the intersection
(Radon's partition; in a non-convex quadrilateral, at the vertex inside the triangle of the
remaining vertices). It must be small. A face is then tested against a plane and an affine map by
least squares, so that small bends do not add up to a curved face.
"""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from triangulators.geometry.half_edges import link_half_edges
from triangulators.polygon_arrays import offsets_of

TOLERANCE_ULPS = 4.0  # rounding steps of single precision at the largest coordinate
INDEX_BITS = 32  # of a vertex index in the number of an edge


@dataclass(frozen=True)
class ModelMesh:
    """Triangles of a draw, with vertices.

    uses : (n,) number of triangles from which each vertex's normal is computed; 0 if the file has
        the normal; None if the file has all normals
    """

    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3) indices of vertices
    affine: NDArray[np.float64]  # (n, k) interpolated, each column in units of its tolerance
    fixed: NDArray[np.float64]  # (n, j) attributes that are constant on a face: joints, identifiers
    tolerance: float  # of flatness, in the units of positions
    uses: NDArray[np.int64] | None = None

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Normals (m, 3) of the triangles; the length is twice the area."""
        sides = np.diff(self.positions[self.triangles], axis=1)
        return np.asarray(np.cross(sides[:, 0], sides[:, 1]))


@dataclass(frozen=True)
class ModelPart:
    """Triangles that a model draws together; they may share edges with other parts."""

    mesh: ModelMesh
    source: Any  # the model's reference to the triangles
    reason_unchanged: str = ""  # why the triangles cannot be changed
    placements: tuple[NDArray[np.float64], ...] = (np.eye(4),)  # a (4, 4) matrix for each instance


def compute_float32_tolerance(values: NDArray[np.float64]) -> float:
    """Return `TOLERANCE_ULPS` rounding errors of single precision at the largest of the values."""
    finite = np.abs(values[np.isfinite(values)])
    return TOLERANCE_ULPS * float(np.spacing(np.float32(finite.max(initial=0.0))))


def number_edges(ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number (d,) for each edge (d, 2), the same for both orders of its two vertices."""
    a, b = ends.T
    return np.asarray((np.minimum(a, b) << INDEX_BITS) + np.maximum(a, b))


def number_sides(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers (3 m,) by `number_edges` of the sides of triangles (m, 3)."""
    return number_edges(np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2))


GRID_STEP = 0.25  # of a face's integer coordinates in the plane, in tolerances
MIN_HEIGHT = 16.0  # of a triangle, in grid steps, so that the orientation is defined
BATCH_EDGES = 1 << 17  # edges tested at a time, to limit memory

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Faces(NamedTuple):
    """Flat faces of two or more triangles; vertices are numbered face by face."""

    points: Floats  # (p, 2) integers, steps of `GRID_STEP` tolerances in the face's plane
    vertices: Ints  # (p,) index of each point's vertex in the mesh
    triangles: Ints  # (t, 3) indices into points, counter-clockwise, face after face
    slots: Ints  # (t,) index of each triangle in the mesh
    triangle_offsets: Ints  # (f + 1,) offsets of the faces in `triangles`

    @property
    def face_count(self) -> int:
        """Number of faces."""
        return len(self.triangle_offsets) - 1


def find_flat_faces(mesh: ModelMesh) -> tuple[Faces, Counter[str]]:
    """Return the flat faces, and the numbers of skipped triangles, edges and faces by reason."""
    from scipy.sparse import coo_array  # slow to import, and exports need no faces
    from scipy.sparse.csgraph import connected_components

    pairs, skipped = _find_neighbours(mesh)
    count = len(mesh.triangles)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
    _, group = connected_components(graph, directed=False)
    size = np.bincount(group, minlength=1)
    slots = np.flatnonzero(size[group] > 1)
    slots = slots[np.argsort(group[slots], kind="stable")]
    face = np.unique(group[slots], return_inverse=True)[1]
    faces, rejected = _check_faces(mesh, slots, face)
    return faces, skipped + rejected


def _has_height(mesh: ModelMesh) -> NDArray[np.bool_]:
    """Return (m,) whether a triangle is not thin, and its vertices are finite."""
    corners = mesh.positions[mesh.triangles]
    sides = corners[:, [1, 2, 0]] - corners
    longest = np.sqrt((sides**2).sum(axis=2).max(axis=1, initial=0.0))
    high = np.linalg.norm(mesh.normals, axis=1) > MIN_HEIGHT * GRID_STEP * mesh.tolerance * longest
    return np.asarray(high & np.isfinite(corners).all(axis=(1, 2)))


def _find_neighbours(mesh: ModelMesh) -> tuple[Ints, Counter[str]]:
    """Return pairs (e, 2) of adjacent triangles in one flat face, and counts of skips by reason."""
    a, b, c = mesh.triangles.T
    proper = np.flatnonzero((a != b) & (b != c) & (c != a))  # degenerate triangles join strips
    if len(proper) < len(mesh.triangles):
        pairs, skipped = _find_neighbours(replace(mesh, triangles=mesh.triangles[proper]))
        return proper[pairs], skipped
    thick = _has_height(mesh)
    corner = np.ascontiguousarray(mesh.triangles, dtype=np.int32).reshape(-1)
    twin = np.asarray(link_half_edges(corner), dtype=np.int64)
    edges = np.flatnonzero(twin > np.arange(len(twin)))
    edges = edges[thick[edges // 3] & thick[twin[edges] // 3]]
    sides = number_sides(mesh.triangles)
    ordered = np.sort(sides)
    crowded = np.unique(ordered[2:][ordered[2:] == ordered[:-2]])
    edges = edges[~np.isin(sides[edges], crowded)]
    inner = [
        part[_is_same_face(mesh, part, twin[part])]
        for part in np.split(edges, range(BATCH_EDGES, len(edges), BATCH_EDGES))
    ]
    inner_edges = np.concatenate(inner)
    skipped = Counter(
        {
            "triangles too thin, or with invalid coordinates": int((~thick).sum()),
            "edges with more than two triangles": len(crowded),
        }
    )
    return np.stack([inner_edges // 3, twin[inner_edges] // 3], axis=1), +skipped


def _is_same_face(mesh: ModelMesh, edge: Ints, twin: Ints) -> NDArray[np.bool_]:
    """Return (e,) whether half-edges `edge` and `twin`, (e,) each, join triangles of one face."""
    corner = mesh.triangles.reshape(-1)
    before, after = edge - edge % 3 + (edge + 2) % 3, edge - edge % 3 + (edge + 1) % 3
    quads = corner[np.stack([before, edge, after, twin - twin % 3 + (twin + 2) % 3], axis=1)]
    normals = mesh.normals[edge // 3], mesh.normals[twin // 3]
    normal = normals[0] + normals[1]
    aligned = np.logical_and(*((n * normal).sum(axis=1) > 0.0 for n in normals))
    points = mesh.positions[quads]
    points = points - points[:, :1]

    def area(i: int, j: int, k: int) -> Floats:
        sides = np.cross(points[:, j] - points[:, i], points[:, k] - points[:, i])
        return np.asarray((sides * normal).sum(axis=1))

    weights = np.stack([area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)], axis=1)
    weights *= 2.0 / np.abs(weights).sum(axis=1, keepdims=True)
    bend = np.linalg.norm((weights[:, :, None] * points).sum(axis=1), axis=1)
    attributes = mesh.affine[quads]
    off = np.abs((weights[:, :, None] * attributes).sum(axis=1)).max(axis=1, initial=0.0)
    fixed = mesh.fixed[quads]
    same = (fixed == fixed[:, :1]).all(axis=(1, 2))
    return np.asarray(aligned & (bend <= mesh.tolerance) & (off <= 1.0) & same)


def _check_faces(mesh: ModelMesh, slots: Ints, face: Ints) -> tuple[Faces, Counter[str]]:
    """Return the flat faces, and rejections by reason, of triangles `slots` sorted by `face`."""
    count = int(face[-1]) + 1 if len(face) else 0
    keys, triangles = np.unique(
        face[:, None] * len(mesh.positions) + mesh.triangles[slots], return_inverse=True
    )
    owner, vertices = np.divmod(keys, max(len(mesh.positions), 1))
    triangles = triangles.reshape(-1, 3)
    normal = _sum_groups(mesh.normals[slots], face, count)
    points, bend = _project_to_planes(mesh.positions[vertices], owner, normal)
    rounded = np.rint(points / (GRID_STEP * mesh.tolerance))
    a, b, c = np.moveaxis(rounded[triangles], 1, 0)
    oriented = (b - a)[:, 0] * (c - a)[:, 1] > (b - a)[:, 1] * (c - a)[:, 0]
    off = _compute_affine_residuals(mesh.affine[vertices], points, owner, count)
    sides = (triangles * len(keys) + triangles[:, [1, 2, 0]]).reshape(-1)  # directed
    _, number, times = np.unique(sides, return_inverse=True, return_counts=True)
    repeated = np.asarray((times[number] > 1).reshape(-1, 3).any(axis=1))
    uses_in_face = np.bincount(triangles.reshape(-1), minlength=len(keys))
    shaded = (mesh.uses[vertices] if mesh.uses is not None else 0) > uses_in_face
    reasons = {
        "bent beyond the tolerance": _flag_groups(bend > mesh.tolerance, owner, count)
        | _flag_groups(~oriented, face, count),
        "texture coordinates, normals or the like differ": _flag_groups(off > 1.0, owner, count),
        "triangles on the same side of an edge": _flag_groups(repeated, face, count),
        "smooth, without normals in the file": _flag_groups(shaded, owner, count),
    }
    bad = np.zeros(count, dtype=np.bool_)
    rejected: Counter[str] = Counter()
    for reason, flags in reasons.items():
        rejected[reason] = int((flags & ~bad).sum())
        bad |= flags
    good_triangle, good_vertex = ~bad[face], ~bad[owner]
    renumbered = np.cumsum(good_vertex) - 1
    faces = Faces(
        rounded[good_vertex],
        vertices[good_vertex],
        renumbered[triangles[good_triangle]],
        slots[good_triangle],
        offsets_of(np.bincount(face, minlength=count)[~bad]),
    )
    return faces, +rejected


def _project_to_planes(positions: Floats, owner: Ints, normal: Floats) -> tuple[Floats, Floats]:
    """Return coordinates (p, 2) in the faces' planes, and distances (p,) from these planes.

    owner : (p,) face of each position; normal : (f, 3), of any length. The origin is the mean of a
    face's positions; the axes are right-handed, and the first is horizontal if z is up.
    """
    count = len(normal)
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    level = np.stack([-unit[:, 1], unit[:, 0], np.zeros(count)], axis=1)
    length = np.linalg.norm(level, axis=1, keepdims=True)
    level = np.where(length > 1e-9, level / np.maximum(length, 1e-300), [1.0, 0.0, 0.0])
    upward = np.cross(unit, level)
    local = positions - _average_groups(positions, owner, count)[owner]
    flat = [(local * axis[owner]).sum(axis=1) for axis in (level, upward)]
    return np.stack(flat, axis=1), np.abs((local * unit[owner]).sum(axis=1))


def _compute_affine_residuals(values: Floats, points: Floats, owner: Ints, count: int) -> Floats:
    """Return each point's largest residual (p,), of values (p, k), from an affine fit per face."""
    if values.shape[1] == 0:
        return np.zeros(len(values))
    x, y = points.T
    centred = values - _average_groups(values, owner, count)[owner]
    xx, xy, yy = (_sum_groups((u * v)[:, None], owner, count) for u, v in ((x, x), (x, y), (y, y)))
    xa, ya = (_sum_groups(u[:, None] * centred, owner, count) for u in (x, y))
    across, up = (yy * xa - xy * ya, xx * ya - xy * xa) / (xx * yy - xy * xy)
    fitted = across[owner] * x[:, None] + up[owner] * y[:, None]
    off = np.abs(centred - fitted).max(axis=1)
    return np.where(np.isnan(off), np.inf, off)


def _sum_groups(values: Floats, owner: Ints, count: int) -> Floats:
    """Return the sums (count, k) of the values (p, k) of each group; owner : (p,) groups."""
    sums = [np.bincount(owner, weights=column, minlength=count) for column in values.T]
    return np.stack(sums, axis=1)


def _average_groups(values: Floats, owner: Ints, count: int) -> Floats:
    return _sum_groups(values, owner, count) / np.bincount(owner, minlength=count)[:, None]


def _flag_groups(flags: NDArray[np.bool_], owner: Ints, count: int) -> NDArray[np.bool_]:
    return np.bincount(owner[flags], minlength=count) > 0
