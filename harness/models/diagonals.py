"""Diagonals of flat faces: the optimum if the outline is a valid polygon, otherwise flips."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.models.flat_faces import MIN_HEIGHT, Faces, Ints
from triangulators import TriangulationError, criteria
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, compute_total_cost, cost_at, find_plain_cost
from triangulators.geometry.flips import flip_while_gaining, is_convex
from triangulators.geometry.half_edges import link_half_edges
from triangulators.many import triangulate_supported
from triangulators.polygon_arrays import PolygonArray, concatenate_ranges, offsets_of

_ROUNDING = 1e-6  # minimum relative gain; smaller ones may be caused by rounding of points
WORK_NS = (1.0, 10.0, 20.0, 45.0)  # measured per cubed vertex count, for 0, 1, 2 and 3 holes

MAX_WORK_NS = 1e9
"""Maximum work by `WORK_NS` in a part: estimated, so that all machines choose equal diagonals."""


@njit(nogil=True)
def _compute_min_height(points: np.ndarray, a: int, b: int, c: int) -> float:
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    longest = max(ux * ux + uy * uy, vx * vx + vy * vy, (ux - vx) ** 2 + (uy - vy) ** 2)
    return float(abs(ux * vy - uy * vx) / np.sqrt(longest))


@njit(nogil=True)
def _is_allowed_flip(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Return whether triangles a, b, d and a, d, c are counter-clockwise, and not thin."""
    if not is_convex(points, a, b, c, d):
        return False
    first = _compute_min_height(points, a, b, d)
    return first > MIN_HEIGHT and _compute_min_height(points, a, d, c) > MIN_HEIGHT


@njit(nogil=True)
def _reduces_cost(points: np.ndarray, a: int, b: int, c: int, d: int, cost: Cost) -> bool:
    """Return whether diagonal a-d costs less than b-c, by more than the rounding error."""
    old = cost_at(points, a, b, c, cost) + cost_at(points, d, c, b, cost)
    new = cost_at(points, a, b, d, cost) + cost_at(points, a, d, c, cost)
    return new < old - 1e-12 * (abs(old) + abs(new))


@njit(nogil=True)
def _flip_to_lower_cost(
    points: np.ndarray, corner: np.ndarray, twin: np.ndarray, cost: Cost
) -> int:
    """Flip diagonals while the cost decreases; corner and twin, (3 t,), are changed in place."""
    return flip_while_gaining(points, corner, twin, _reduces_cost, _is_allowed_flip, cost)


@dataclass
class FaceDiagonals:
    """New triangles (t, 3) of `Faces`, (f,) whether a face changed, and the number of optima."""

    triangles: Ints
    changed: NDArray[np.bool_]
    optimal: int


CHOOSE_CRITERION = "choose from edge-length, half-perimeter, overdraw"


def get_cost_function(criterion: str) -> Cost:
    """Return a criterion's cost function; raise UsageError unless it is a sum over triangles."""
    try:
        entry = criteria.find(criterion)
    except TriangulationError as error:
        raise UsageError(str(error)) from error
    cost = find_plain_cost(entry)
    if cost is None:
        raise UsageError(f"criterion {criterion}: unsupported for models ({CHOOSE_CRITERION})")
    return cost


def choose_diagonals(faces: Faces, criterion: str) -> FaceDiagonals:
    """Choose the diagonals of each face by a criterion; raises as `get_cost_function` does."""
    cost = get_cost_function(criterion)
    sizes = np.diff(faces.triangle_offsets)
    result, is_optimal = faces.triangles.copy(), np.zeros(len(sizes), dtype=np.bool_)
    outlines = _take_affordable(find_outlines(faces))
    optima = triangulate_supported(outlines.polygons, f"optimal:{criterion}", check=False)
    owner = np.repeat(np.arange(len(outlines.face)), np.diff(optima.triangle_offsets))
    is_initialised = optima.compiled[owner]  # the other rows of `optima` are uninitialised
    owner = owner[is_initialised]
    first = outlines.polygons.vertex_offsets[owner]
    rows = outlines.vertices[optima.triangles[is_initialised] + first[:, None]]
    solved = optima.compiled.copy()
    solved[owner[_find_thin(faces.points, rows)]] = False
    is_optimal[outlines.face[solved]] = True
    result[np.repeat(is_optimal, sizes)] = rows[solved[owner]]
    flipped = ~np.repeat(is_optimal, sizes)
    corner = result[flipped].astype(np.int32).reshape(-1)
    _flip_to_lower_cost(faces.points, corner, link_half_edges(corner), cost)
    result[flipped] = corner.reshape(-1, 3)
    changed = np.asarray(
        find_cheaper_faces(faces.points, faces.triangles, result, faces.triangle_offsets, cost)
    )
    same = ~np.repeat(changed, sizes)
    result[same] = faces.triangles[same]
    return FaceDiagonals(result, changed, int(is_optimal.sum()))


@njit(nogil=True)
def _find_thin(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the (m,) mask of the thin triangles of (m, 3)."""
    thin = np.empty(len(triangles), dtype=np.bool_)
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        thin[row] = _compute_min_height(points, a, b, c) <= MIN_HEIGHT
    return thin


@njit(nogil=True)
def find_cheaper_faces(
    points: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    triangle_offsets: np.ndarray,
    cost: Cost,
) -> np.ndarray:
    """Return (f,) whether faces cost less, beyond rounding, with triangles `after`, (t, 3)."""
    cheaper_faces = np.zeros(len(triangle_offsets) - 1, dtype=np.bool_)
    for face in range(len(cheaper_faces)):
        first, last = triangle_offsets[face], triangle_offsets[face + 1]
        old = compute_total_cost(points, before[first:last], cost)
        new = compute_total_cost(points, after[first:last], cost)
        cheaper_faces[face] = new < old - _ROUNDING * abs(old)
    return cheaper_faces


class Outlines(NamedTuple):
    """Faces whose outline is a valid polygon that visits each vertex of the face once."""

    face: Ints  # (c,) face numbers
    polygons: PolygonArray
    vertices: Ints  # (n,) index in `Faces.points` of each polygon vertex

    def take(self, flags: NDArray[np.bool_]) -> "Outlines":
        """Return the outlines flagged in (c,) `flags`."""
        vertices = self.vertices[np.repeat(flags, self.polygons.vertex_counts)]
        return Outlines(self.face[flags], self.polygons.take(flags), vertices)


def _take_affordable(outlines: Outlines) -> Outlines:
    sizes = outlines.polygons.vertex_counts
    factors = np.append(WORK_NS, 0.0)[np.minimum(outlines.polygons.ring_counts - 1, len(WORK_NS))]
    work = factors * sizes.astype(np.float64) ** 3
    quickest = np.argsort(work, kind="stable")
    affordable = np.zeros(len(work), np.bool_)
    affordable[quickest[np.cumsum(work[quickest]) <= MAX_WORK_NS]] = True
    return outlines.take(affordable)


def find_outlines(faces: Faces) -> Outlines:
    """Return the faces with valid outlines; the outer, counter-clockwise ring comes first."""
    corner = np.ascontiguousarray(faces.triangles, dtype=np.int32).reshape(-1)
    ahead = faces.triangles[:, [1, 2, 0]].reshape(-1)
    outer = np.flatnonzero(np.asarray(link_half_edges(corner)) < 0)
    # A face is sound if exactly one outline edge leaves each vertex. None leaves an interior
    # vertex; several leave a vertex at which outlines touch.
    outline_edges = np.bincount(corner[outer], minlength=len(faces.points))
    following = np.zeros(len(faces.points), dtype=np.int64)
    following[corner[outer]] = ahead[outer]
    owner = np.zeros(len(faces.points), dtype=np.int64)
    owner[corner] = np.repeat(np.arange(faces.face_count), 3 * np.diff(faces.triangle_offsets))
    sound = np.bincount(owner[outline_edges != 1], minlength=faces.face_count) == 0
    vertices, ring_offsets = _trace_rings(following, sound[owner])
    sizes = np.diff(ring_offsets)
    ring = np.repeat(np.arange(len(sizes)), sizes)
    a, b = faces.points[vertices], faces.points[following[vertices]]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    is_outer = np.bincount(ring, cross, minlength=len(sizes)) > 0.0  # counter-clockwise
    face = owner[vertices[ring_offsets[:-1]]]
    sound &= np.bincount(face[is_outer], minlength=faces.face_count) == 1
    order = np.lexsort((~is_outer, face))
    order = order[sound[face[order]]]
    vertices = vertices[concatenate_ranges(ring_offsets[order], sizes[order])]
    rings = np.bincount(face, minlength=faces.face_count)[sound]
    polygons = PolygonArray(faces.points[vertices], offsets_of(sizes[order]), offsets_of(rings))
    valid = shapely.is_valid(polygons.geometries)
    return Outlines(np.flatnonzero(sound), polygons, vertices).take(valid)


@njit(nogil=True)
def _trace_rings(following: np.ndarray, is_traced: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices ring by ring, and the offsets of the rings, in the order of first vertices.

    following : (p,) next vertex of the outline, a permutation, so that its cycles are the rings
    is_traced : (p,) whether a vertex belongs to a ring that is returned; the flags are cleared
    """
    vertices = np.empty(len(following), dtype=np.int64)
    ring_offsets = np.zeros(len(following) + 1, dtype=np.int64)
    size, rings = 0, 0
    for start in range(len(following)):
        if not is_traced[start]:
            continue
        at = start
        while is_traced[at]:
            is_traced[at] = False
            vertices[size] = at
            size += 1
            at = following[at]
        rings += 1
        ring_offsets[rings] = size
    return vertices[:size], ring_offsets[: rings + 1]
