"""A model in space as a scene: its flat faces, and how they are seen from several sides.

The camera, its distance and the pictures are those of `harness.models.views`. A face is drawn where
its front is turned to the camera, which is decided for the face as a whole: so each triangulation
draws the same faces, whatever the grid of 1/256 px makes of a face that is seen aslant.
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
    """The flat faces of a part in which there is a choice, and the triangles in none.

    faces : (f) outlines in the plane of each face, whole numbers; those that are no valid polygon,
        because they touch themselves or have vertices within, come last, with one ring of all their
        vertices
    count : how many faces are polygons
    vertices : (n,) the vertex of the part that each vertex of `faces` is
    given : for each face its triangles in the model, (m, 3) rows of its vertices
    slots : (t,) which triangles of the part these are, face after face
    loose : (u,) triangles of the part that are in no face
    """

    faces: PolygonArray
    count: int
    vertices: Ints
    given: list[Rows]
    slots: Ints
    loose: Ints

    @property
    def polygons(self) -> list[shapely.Polygon]:
        """The faces that are polygons, in px of which 1/256 is a step of their coordinates."""
        polygons = self.faces[: self.count]
        return list(replace(polygons, coords=polygons.coords / SUBPIXEL))

    @property
    def bound(self) -> list[tuple[Floats, Rows]]:
        """Points (k, 2) and triangles of each face that is no polygon."""
        numbers = range(self.count, len(self.faces))
        return [(self.faces.rings_of(k)[0], self.given[k]) for k in numbers]


def flat_of(part: ModelPart) -> Flat:
    """Return the faces of a part; polygons are those with a valid outline through all vertices."""
    size = len(part.mesh.triangles)
    none = np.empty(0, np.int64)
    if part.left:
        no_faces = PolygonArray.from_shapely([])
        return Flat(no_faces, 0, none, [], none, np.arange(size))
    faces, _ = flat_faces(part.mesh)
    clean = outlines(faces)
    others = np.setdiff1d(np.arange(faces.face_count), clean.face)
    spans = [
        slice(*faces.triangle_offsets[k : k + 2]) for k in np.append(clean.face, others).tolist()
    ]
    within = [np.unique(faces.triangles[span]) for span in spans[len(clean.face) :]]
    vertices = np.concatenate([clean.vertices, *within]).astype(np.int64)
    bound_offsets = offsets_of([len(each) for each in within])
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
"""No depth test; one, with triangles in the model's order; one, with triangles front to back."""

NEAREST, FARTHEST = 1.1, 1000.0
"""Radii from the middle at which a camera may stand."""

LEAST_TOLD = 0.005
"""Share of a model's area from which on it is told what is left as it is."""

MOST, MOST_PIECES = 20_000_000, 500_000
"""Vertices and faces of all views together; criteria take some 50 us a face."""

_AROUND = 1.05
"""Radii before and behind the middle at which what is seen begins and ends."""


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
    """A model, seen in perspective from the first so many of 24 sides.

    pixels : side of each picture, in which the ball round the model fits
    distance : of the camera from the middle of that ball, in its radii
    depth : one of `DEPTHS`

    Raises SceneError for a file that is not there, is damaged or holds its triangles packed, for a
    model of which nothing can be seen, and for parameters that cannot be.
    """
    _refuse(views, pixels, distance, depth)
    try:
        _, groups = open_model(Path(path))
    except HarnessError as error:
        raise SceneError(str(error)) from error
    polygons: list[shapely.Polygon] = []
    given: list[Rows] = []
    bound: list[tuple[Floats, Rows]] = []
    things = []
    for part in (part for parts in groups for part in parts):
        flat = flat_of(part)
        numbers = (len(polygons), len(bound))
        things += [_thing(part, flat, numbers, matrix) for matrix in part.placements]
        polygons += flat.polygons
        given += flat.given[: flat.count]
        bound += flat.bound
    ball = ball_of([thing.corners.reshape(-1, 3) for thing in things])
    if ball is None:
        raise SceneError(f"{path} shows nothing: no triangle of it has an extent")
    shown: list[_Pieces] = []
    rest: dict[int, Rows] = {}
    first = [0]
    vertices = 0
    for direction in directions()[:views]:
        last = first[-1]
        for each in _pieces(things, ball, direction, distance, pixels, len(polygons)):
            last += len(each.outlines)
            rest |= zip(range(last - len(each.given), last), each.given, strict=True)
            vertices += len(each.depths)
            shown.append(each)
        first.append(last)
        if vertices > MOST or last > MOST_PIECES:
            most = f"{MOST:,} vertices or {MOST_PIECES:,} faces"
            raise SceneError(f"more than {most} in all views: give fewer views=")
    return ModelScene(
        name=Path(path).stem,
        polygons=polygons,
        units="units",
        description=str(path),
        licence="as the file's",
        parameters={"views": views, "pixels": pixels, "distance": distance, "depth": depth},
        notes=(_note(things, len(polygons), views),),
        viewing=Viewing(
            pixels=pixels,
            names=tuple(" ".join(map(str, way)) for way in ways()[:views].tolist()),
            pieces=PolygonArray.concatenate([each.outlines for each in shown]),
            depths=None if depth == "none" else np.concatenate([each.depths for each in shown]),
            source=np.concatenate([each.sources for each in shown]),
            first=np.array(first, np.int64),
            given=tuple(given),
            rest=rest,
            bound=tuple(bound),
            ranks=np.concatenate([each.ranks for each in shown]),
            near_first=depth == "front",
        ),
    )


def _refuse(views: int, pixels: int, distance: float, depth: str) -> None:
    if not 1 <= views <= VIEWS:
        raise SceneError(f"views={views} is outside 1..{VIEWS}")
    if pixels % 2 or not RESOLUTIONS[0] <= pixels <= RESOLUTIONS[1]:
        raise SceneError(f"pixels={pixels} is no even number from 8 to {RESOLUTIONS[1]}")
    if not NEAREST <= distance <= FARTHEST:
        raise SceneError(f"distance={distance:g} is outside {NEAREST:g}..{FARTHEST:g} radii")
    if depth not in DEPTHS:
        raise SceneError(f"depth={depth} is none of {', '.join(DEPTHS)}")


class _Thing(NamedTuple):
    """A part at one of its places.

    first : in the scene, numbers of its first polygon and of its first face that is none
    points : (n, 3) its vertices; corners : (m, 3, 3) of its triangles
    triangle_fronts, face_fronts : where the fronts of triangles and faces point, not of unit length
    """

    part: ModelPart
    flat: Flat
    first: tuple[int, int]
    points: Floats
    corners: Floats
    triangle_fronts: Floats
    face_fronts: Floats


def _thing(part: ModelPart, flat: Flat, first: tuple[int, int], matrix: Floats) -> _Thing:
    points = placed(part.mesh.positions, matrix)
    corners = points[part.mesh.triangles]
    fronts = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(matrix[:3, :3]) < 0:  # a mirror image, whose triangles turn the other way
        fronts = -fronts
    first_slots = offsets_of([len(rows) for rows in flat.given])[:-1]
    of_faces = np.empty((0, 3))
    if len(first_slots):
        of_faces = np.add.reduceat(fronts[flat.slots], first_slots)
    return _Thing(part, flat, first, points, corners, fronts, of_faces)


def _note(things: list[_Thing], faces: int, views: int) -> str:
    flat = bound = whole = 0.0
    for each in things:
        area = np.nan_to_num(np.linalg.norm(each.triangle_fronts, axis=1))
        count = sum(len(rows) for rows in each.flat.given[: each.flat.count])
        flat += float(area[each.flat.slots[:count]].sum())
        bound += float(area[each.flat.slots[count:]].sum())
        whole += float(area.sum())
    whole = whole or 1.0
    note = f"{faces} flat faces with a choice of diagonals, {flat / whole:.0%} of the area"
    if bound:
        note += (
            f"; in {bound / whole:.0%} of it faces are no polygons (their outline touches itself, "
            "or vertices lie within): optimal and flips turn diagonals there, as triangulate does, "
            "other triangulators leave them"
        )
    left = 1.0 - (flat + bound) / whole
    if left >= LEAST_TOLD:
        note += f"; {left:.0%} of it is in no flat face and stays as it is"
    return f"{note}; {views} views"


class _Pieces(NamedTuple):
    """Pieces of a view.

    outlines : of the p pieces as they are seen, in 1/256 px; depths : (n,) of their vertices
    sources : (p,) as in `Viewing`; ranks : of the triangles, as in `Viewing`
    given : triangles of the last pieces, which are no polygons
    """

    outlines: PolygonArray
    depths: NDArray[np.int32]
    sources: Ints
    ranks: Ints
    given: list[Rows]


def _pieces(
    things: list[_Thing], ball: Ball, direction: Floats, distance: float, pixels: int, rest: int
) -> Iterator[_Pieces]:
    """Yield the pieces of a view thing by thing, then the rest, if there is any.

    direction, distance : of the camera, as `projected` takes them
    rest : the number that the rest has, as if it were a polygon
    """
    eye = ball.middle + ball.radius * distance * direction
    near, far = distance - _AROUND, distance + _AROUND
    # triangles that are in no face, of all things: their corners are numbered on
    points, depths, triangles, ranks = [], [], [], []
    count = base = 0
    for thing in things:
        flat = thing.flat
        local = (thing.points - ball.middle) / ball.radius
        at, away = projected(local, direction, distance)
        grid = np.nan_to_num(np.rint(at * (pixels * SUBPIXEL))).astype(np.int32)
        deep = far * (away - near) / (away * (far - near)) * DEEPEST
        deep = np.nan_to_num(np.rint(deep)).astype(np.int32)
        turned = ((eye - thing.corners[:, 0]) * thing.triangle_fronts).sum(axis=1) > 0.0
        first = thing.points[flat.vertices[flat.faces.vertex_offsets[:-1]]]
        front = ((eye - first) * thing.face_fronts).sum(axis=1) > 0.0
        of_polygons = np.flatnonzero(front[: flat.count])
        bound = np.flatnonzero(front[flat.count :])
        yield _Pieces(
            outlines=replace(flat.faces, coords=grid[flat.vertices]).take(front),
            depths=deep[flat.vertices[np.repeat(front, flat.faces.vertex_counts)]],
            sources=np.r_[thing.first[0] + of_polygons, rest + 1 + thing.first[1] + bound],
            ranks=base + flat.slots[np.repeat(front, [len(rows) for rows in flat.given])],
            given=[flat.given[flat.count + face] for face in bound.tolist()],
        )
        loose = flat.loose[turned[flat.loose]]
        used, corner = np.unique(thing.part.mesh.triangles[loose], return_inverse=True)
        points.append(grid[used])
        depths.append(deep[used])
        triangles.append((corner.reshape(-1, 3) + count).astype(np.int32))
        ranks.append(base + loose)
        count, base = count + len(used), base + len(thing.corners)
    if count:
        yield _Pieces(
            outlines=PolygonArray.of_single_rings(np.concatenate(points), count),
            depths=np.concatenate(depths),
            sources=np.array([rest]),
            ranks=np.concatenate(ranks),
            given=[np.concatenate(triangles)],
        )
