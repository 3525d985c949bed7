"""A 3D model as a scene: its flat faces, seen from several sides.

The camera, its distance and the images are those of `harness.models.views`. A face is drawn if its
front points to the camera, decided once for the face: so each triangulation draws the same faces,
whatever snapping to 1/256 px does to a face that is seen at an angle.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.grid import SUBPIXEL
from harness.models.diagonals import outlines
from harness.models.flat_faces import Floats, Ints, ModelPart, flat_faces
from harness.models.in_place import open_model
from harness.models.views import DISTANCE, VIEWS, Ball, ball_of, directions, placed, projected, ways
from harness.rasterisers.spans import DEEPEST
from harness.settings import RESOLUTIONS
from harness.viewing import ModelScene, Rows, Viewing
from scenes.scene import Scene, SceneError
from scenes.spec import convert_arguments, parse_name
from triangulators.polygon_arrays import PolygonArray, offsets_of


@dataclass(frozen=True)
class Flat:
    """The flat faces of a part that have several triangulations, and the other triangles.

    faces : (f) outlines in the plane of each face, integers; faces that are not valid polygons,
        because they touch themselves or have interior vertices, come last, with one ring of all
        their vertices
    count : number of faces that are polygons
    vertices : (n,) index in the part of each vertex of `faces`
    given : for each face its triangles in the model, (m, 3) indices of its vertices
    slots : (t,) indices of these triangles in the part, face after face
    loose : (u,) indices of the triangles that belong to no face
    """

    faces: PolygonArray
    count: int
    vertices: Ints
    given: list[Rows]
    slots: Ints
    loose: Ints

    @property
    def polygons(self) -> list[shapely.Polygon]:
        """The faces that are polygons, in px: integer coordinates divided by 256."""
        polygons = self.faces[: self.count]
        return list(replace(polygons, coords=polygons.coords / SUBPIXEL))

    @property
    def bound(self) -> list[tuple[Floats, Rows]]:
        """Points (k, 2) and triangles of each face that is not a valid polygon."""
        numbers = range(self.count, len(self.faces))
        return [(self.faces.rings_of(k)[0], self.given[k]) for k in numbers]


def find_flat_faces(part: ModelPart) -> Flat:
    """Return the faces of a part; polygons are those with a valid outline through all vertices."""
    size = len(part.mesh.triangles)
    none = np.empty(0, np.int64)
    if part.left:
        no_faces = PolygonArray.from_shapely([])
        return Flat(no_faces, 0, none, [], none, np.arange(size))
    faces, _ = flat_faces(part.mesh)
    clean = outlines(faces)
    invalid = np.setdiff1d(np.arange(faces.face_count), clean.face)
    spans = [
        slice(*faces.triangle_offsets[k : k + 2]) for k in np.append(clean.face, invalid).tolist()
    ]
    within = [np.unique(faces.triangles[span]) for span in spans[len(clean.face) :]]
    vertices = np.concatenate([clean.vertices, *within]).astype(np.int64)
    bound_offsets = offsets_of([len(indices) for indices in within])
    bound = PolygonArray(
        faces.points[np.concatenate([none, *within])], bound_offsets, np.arange(len(bound_offsets))
    )
    outlined = PolygonArray.concatenate([clean.polygons, bound])
    position = np.zeros(len(faces.points), np.int64)  # of a vertex of `faces` in its face
    first = np.repeat(outlined.vertex_offsets[:-1], outlined.vertex_counts)
    position[vertices] = np.arange(len(vertices)) - first
    slots = np.concatenate([none, *(faces.slots[span] for span in spans)])
    loose = np.ones(size, np.bool_)
    loose[slots] = False
    return Flat(
        faces=outlined,
        count=len(clean.face),
        vertices=faces.vertices[vertices],
        given=[position[faces.triangles[span]].astype(np.int32) for span in spans],
        slots=slots,
        loose=np.flatnonzero(loose),
    )


DEPTHS = ("none", "file", "front")
"""No depth test; depth test with triangles in file order; depth test, front to back."""

MIN_DISTANCE, MAX_DISTANCE = 1.1, 1000.0
"""Range of the camera's distance from the centre, in radii."""

MIN_REPORTED_SHARE = 0.005
"""Minimum share of a model's area, outside flat faces, that is reported."""

MAX_VERTICES, MAX_PIECES = 20_000_000, 500_000
"""Limits of vertices and faces of all views together; criteria take about 50 us per face."""

_DEPTH_RADIUS = 1.05
"""Half of the depth range around the centre, in radii."""


def load(text: str) -> Scene:
    """Load "model.glb:views=24,pixels=512,distance=3,depth=file"; raises as `read` does."""
    name, given = parse_name(text)
    return read(name, **convert_arguments(name, read, dict(given)))


@np.errstate(all="ignore")
def read(
    path: str,
    *,
    views: int = VIEWS,
    pixels: int = 1024,
    distance: float = DISTANCE,
    depth: str = DEPTHS[0],
) -> Scene:
    """Read a model as a scene of perspective views from the first `views` of 24 sides.

    pixels : side of each image, which contains the model's bounding sphere
    distance : distance of the camera from the centre of the sphere, in radii
    depth : one of `DEPTHS`

    Raises SceneError if the file is missing, damaged or compressed, if nothing of the model is
    visible, or if a parameter is invalid.
    """
    _check_parameters(views, pixels, distance, depth)
    try:
        _, groups = open_model(Path(path))
    except HarnessError as error:
        raise SceneError(str(error)) from error
    polygons: list[shapely.Polygon] = []
    given: list[Rows] = []
    bound: list[tuple[Floats, Rows]] = []
    placed_parts = []
    for part in (part for parts in groups for part in parts):
        flat = find_flat_faces(part)
        numbers = (len(polygons), len(bound))
        placed_parts += [_place_part(part, flat, numbers, matrix) for matrix in part.placements]
        polygons += flat.polygons
        given += flat.given[: flat.count]
        bound += flat.bound
    ball = ball_of([placed_part.corners.reshape(-1, 3) for placed_part in placed_parts])
    if ball is None:
        raise SceneError(f"{path}: nothing is visible, as all triangles are degenerate")
    visible: list[_Pieces] = []
    rest: dict[int, Rows] = {}
    first = [0]
    vertices = 0
    for direction in directions()[:views]:
        last = first[-1]
        for pieces in _pieces(placed_parts, ball, direction, distance, pixels, len(polygons)):
            last += len(pieces.outlines)
            rest |= zip(range(last - len(pieces.given), last), pieces.given, strict=True)
            vertices += len(pieces.depths)
            visible.append(pieces)
        first.append(last)
        if vertices > MAX_VERTICES or last > MAX_PIECES:
            limits = f"{MAX_VERTICES:,} vertices or {MAX_PIECES:,} faces"
            raise SceneError(f"{path}: more than {limits} in all views; reduce views=")
    return ModelScene(
        name=Path(path).stem,
        polygons=polygons,
        units="units",
        description=str(path),
        licence="as the file's",
        parameters={"views": views, "pixels": pixels, "distance": distance, "depth": depth},
        notes=(_format_note(placed_parts, len(polygons), views),),
        viewing=Viewing(
            pixels=pixels,
            names=tuple(" ".join(map(str, way)) for way in ways()[:views].tolist()),
            pieces=PolygonArray.concatenate([pieces.outlines for pieces in visible]),
            depths=None
            if depth == "none"
            else np.concatenate([pieces.depths for pieces in visible]),
            source=np.concatenate([pieces.sources for pieces in visible]),
            first=np.array(first, np.int64),
            given=tuple(given),
            rest=rest,
            bound=tuple(bound),
            ranks=np.concatenate([pieces.ranks for pieces in visible]),
            near_first=depth == "front",
        ),
    )


def _check_parameters(views: int, pixels: int, distance: float, depth: str) -> None:
    if not 1 <= views <= VIEWS:
        raise SceneError(f"views={views} is outside 1..{VIEWS}")
    if pixels % 2 or not RESOLUTIONS[0] <= pixels <= RESOLUTIONS[1]:
        raise SceneError(f"pixels={pixels} is not an even number from 8 to {RESOLUTIONS[1]}")
    if not MIN_DISTANCE <= distance <= MAX_DISTANCE:
        raise SceneError(
            f"distance={distance:g} is outside {MIN_DISTANCE:g}..{MAX_DISTANCE:g} radii"
        )
    if depth not in DEPTHS:
        raise SceneError(f"unknown depth={depth} (choose from {', '.join(DEPTHS)})")


class _PlacedPart(NamedTuple):
    """A part with one of its placements.

    first : indices in the scene of its first polygon and of its first face that is not one
    points : (n, 3) its vertices; corners : (m, 3, 3) those of its triangles
    triangle_fronts, face_fronts : normals of triangles and faces, not of unit length
    """

    part: ModelPart
    flat: Flat
    first: tuple[int, int]
    points: Floats
    corners: Floats
    triangle_fronts: Floats
    face_fronts: Floats


def _place_part(part: ModelPart, flat: Flat, first: tuple[int, int], matrix: Floats) -> _PlacedPart:
    points = placed(part.mesh.positions, matrix)
    corners = points[part.mesh.triangles]
    fronts = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored: the orientation of triangles is reversed
        fronts = -fronts
    first_slots = offsets_of([len(rows) for rows in flat.given])[:-1]
    of_faces = np.empty((0, 3))
    if len(first_slots):
        of_faces = np.add.reduceat(fronts[flat.slots], first_slots)
    return _PlacedPart(part, flat, first, points, corners, fronts, of_faces)


def _format_note(placed_parts: list[_PlacedPart], faces: int, views: int) -> str:
    flat = bound = total = 0.0
    for placed_part in placed_parts:
        area = np.nan_to_num(np.linalg.norm(placed_part.triangle_fronts, axis=1))
        count = sum(len(rows) for rows in placed_part.flat.given[: placed_part.flat.count])
        flat += float(area[placed_part.flat.slots[:count]].sum())
        bound += float(area[placed_part.flat.slots[count:]].sum())
        total += float(area.sum())
    total = total or 1.0
    note = f"{faces} flat faces with a choice of diagonals, {flat / total:.0%} of the area"
    if bound:
        note += (
            f"; in {bound / total:.0%} of it faces are not polygons (their outline touches itself, "
            "or they have interior vertices): optimal and flips flip diagonals there, as "
            "triangulate does, other triangulators do not change them"
        )
    outside = 1.0 - (flat + bound) / total
    if outside >= MIN_REPORTED_SHARE:
        note += f"; {outside:.0%} of it is outside flat faces and not changed"
    return f"{note}; {views} views"


class _Pieces(NamedTuple):
    """Pieces of a view.

    outlines : of the p pieces as they are seen, in 1/256 px; depths : (n,) of their vertices
    sources : (p,) as in `Viewing`; ranks : of the triangles, as in `Viewing`
    given : triangles of the last pieces, which are not polygons
    """

    outlines: PolygonArray
    depths: NDArray[np.int32]
    sources: Ints
    ranks: Ints
    given: list[Rows]


def _pieces(
    placed_parts: list[_PlacedPart],
    ball: Ball,
    direction: Floats,
    distance: float,
    pixels: int,
    rest: int,
) -> Iterator[_Pieces]:
    """Yield the pieces of a view part by part, then the loose triangles, if any.

    direction, distance : of the camera, as `projected` takes them
    rest : the number that the rest has, as if it were a polygon
    """
    eye = ball.middle + ball.radius * distance * direction
    near, far = distance - _DEPTH_RADIUS, distance + _DEPTH_RADIUS
    # Triangles outside faces, of all parts, with consecutive vertex numbers.
    points, depths, triangles, ranks = [], [], [], []
    count = base = 0
    for placed_part in placed_parts:
        flat = placed_part.flat
        local = (placed_part.points - ball.middle) / ball.radius
        position, away = projected(local, direction, distance)
        grid = np.nan_to_num(np.rint(position * (pixels * SUBPIXEL))).astype(np.int32)
        deep = far * (away - near) / (away * (far - near)) * DEEPEST
        deep = np.nan_to_num(np.rint(deep)).astype(np.int32)
        turned = ((eye - placed_part.corners[:, 0]) * placed_part.triangle_fronts).sum(axis=1) > 0.0
        first = placed_part.points[flat.vertices[flat.faces.vertex_offsets[:-1]]]
        front = ((eye - first) * placed_part.face_fronts).sum(axis=1) > 0.0
        of_polygons = np.flatnonzero(front[: flat.count])
        bound = np.flatnonzero(front[flat.count :])
        yield _Pieces(
            outlines=replace(flat.faces, coords=grid[flat.vertices]).take(front),
            depths=deep[flat.vertices[np.repeat(front, flat.faces.vertex_counts)]],
            sources=np.r_[
                placed_part.first[0] + of_polygons, rest + 1 + placed_part.first[1] + bound
            ],
            ranks=base + flat.slots[np.repeat(front, [len(rows) for rows in flat.given])],
            given=[flat.given[flat.count + face] for face in bound.tolist()],
        )
        loose = flat.loose[turned[flat.loose]]
        used, corner = np.unique(placed_part.part.mesh.triangles[loose], return_inverse=True)
        points.append(grid[used])
        depths.append(deep[used])
        triangles.append((corner.reshape(-1, 3) + count).astype(np.int32))
        ranks.append(base + loose)
        count, base = count + len(used), base + len(placed_part.corners)
    if count:
        yield _Pieces(
            outlines=PolygonArray.of_single_rings(np.concatenate(points), count),
            depths=np.concatenate(depths),
            sources=np.array([rest]),
            ranks=np.concatenate(ranks),
            given=[np.concatenate(triangles)],
        )
