"""A model in space as a scene: its flat faces, and how they are seen from several sides.

The camera, its distance and the pictures are those of `harness.models.views`. A face is drawn where
its front is turned to the camera, which is decided for the face as a whole: so each triangulation
draws the same faces, whatever the grid of 1/256 px makes of a face that is seen aslant.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import SUBPIXEL
from harness.models.diagonals import outlines, shapes
from harness.models.flat_faces import Floats, Ints, Part, flat_faces
from harness.models.in_place import opened
from harness.models.views import DISTANCE, VIEWS, Ball, ball_of, directions, placed, projected, ways
from harness.rasterisers.spans import DEEPEST
from harness.settings import RESOLUTIONS
from scenes.scene import Scene, SceneError, Viewing
from scenes.spec import arguments_for, parsed


@dataclass(frozen=True)
class Flat:
    """Faces in which there is a choice, and what is left.

    Those whose outline is no polygon, for it touches itself or has vertices within, come last.

    polygons : of the others, in px of which 1/256 is a step of the face's coordinates
    bound : (k, 2) points of each that is none, as `Faces` has them
    given : for each face its triangles in the model, (m, 3) rows of its vertices
    slots : (t,) which triangles of the part these are, face after face
    vertices : (n,) which vertex of the part each vertex of a face is
    begins : (f + 1,) where in `vertices` each face begins
    rings : (r,) vertices of each ring; rings_of : (f,) rings of each face, 1 where it is no polygon
    loose : (u,) which triangles of the part are in none of the faces
    """

    polygons: list[shapely.Polygon]
    bound: list[Floats]
    given: list[NDArray[np.int32]]
    slots: Ints
    vertices: Ints
    begins: Ints
    rings: Ints
    rings_of: Ints
    loose: Ints


def flat_of(part: Part) -> Flat:
    """Return the faces of a part; polygons are those with a valid outline through all vertices."""
    count = len(part.mesh.triangles)
    if part.left:
        none = np.empty(0, np.int64)
        return Flat([], [], [], none, none, np.zeros(1, np.int64), none, none, np.arange(count))
    faces, _ = flat_faces(part.mesh)
    found = outlines(faces)
    coordinates, ring_ends, polygon_ends = found.polygons
    begins = np.r_[0, np.r_[0, ring_ends][polygon_ends]].astype(np.int64)
    others = np.setdiff1d(np.arange(len(faces.starts) - 1), found.face).tolist()
    spans = [slice(*faces.starts[face : face + 2]) for face in [*found.face.tolist(), *others]]
    within = [np.unique(faces.triangles[span]) for span in spans[len(found.face) :]]
    sizes = np.array([len(each) for each in within], np.int64)
    vertices = np.concatenate([found.vertices, *within]).astype(np.int64)
    begins = np.concatenate([begins, begins[-1] + np.cumsum(sizes)])
    place = np.zeros(len(faces.points), np.int64)
    place[vertices] = np.arange(len(vertices)) - np.repeat(begins[:-1], np.diff(begins))
    slots = np.concatenate([np.empty(0, np.int64), *(faces.slots[span] for span in spans)])
    alone = np.ones(count, np.bool_)
    alone[slots] = False
    return Flat(
        polygons=list(shapes(coordinates / SUBPIXEL, ring_ends, polygon_ends)),
        bound=[faces.points[each] for each in within],
        given=[place[faces.triangles[span]].astype(np.int32) for span in spans],
        slots=slots,
        vertices=faces.vertices[vertices],
        begins=begins,
        rings=np.concatenate([np.diff(ring_ends, prepend=0), sizes]).astype(np.int64),
        rings_of=np.concatenate([np.diff(polygon_ends, prepend=0), sizes > 0]).astype(np.int64),
        loose=np.flatnonzero(alone),
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
    name, given = parsed(text)
    return read(name, **arguments_for(name, read, dict(given)))


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
        _, groups = opened(Path(path))
    except UsageError as error:
        raise SceneError(str(error)) from error
    polygons: list[shapely.Polygon] = []
    given: list[NDArray[np.int32]] = []
    bound: list[tuple[Floats, NDArray[np.int32]]] = []
    things = []
    for part in (part for parts in groups for part in parts):
        flat = flat_of(part)
        numbers = (len(polygons), len(bound))
        things += [_thing(part, flat, numbers, matrix) for matrix in part.placements]
        count = len(flat.polygons)
        polygons += flat.polygons
        given += flat.given[:count]
        bound += zip(flat.bound, flat.given[count:], strict=True)
    ball = ball_of([thing.corners.reshape(-1, 3) for thing in things])
    if ball is None:
        raise SceneError(f"{path} shows nothing: no triangle of it has an extent")
    shown: list[_Pieces] = []
    rest: dict[int, NDArray[np.int32]] = {}
    first = [0]
    vertices = 0
    for direction in directions()[:views]:
        last = first[-1]
        for each in _pieces(things, ball, direction, distance, pixels, len(polygons)):
            last += len(each.sizes)
            rest |= zip(range(last - len(each.given), last), each.given, strict=True)
            vertices += len(each.points)
            shown.append(each)
        first.append(last)
        if vertices > MOST or last > MOST_PIECES:
            most = f"{MOST:,} vertices or {MOST_PIECES:,} faces"
            raise SceneError(f"more than {most} in all views: give fewer views=")
    sizes = np.concatenate([each.sizes for each in shown])
    return Scene(
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
            points=np.concatenate([each.points for each in shown]),
            depths=None if depth == "none" else np.concatenate([each.depths for each in shown]),
            offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            ring_ends=np.cumsum(np.concatenate([each.rings for each in shown])).astype(np.int64),
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

    part: Part
    flat: Flat
    first: tuple[int, int]
    points: Floats
    corners: Floats
    triangle_fronts: Floats
    face_fronts: Floats


def _thing(part: Part, flat: Flat, first: tuple[int, int], matrix: Floats) -> _Thing:
    points = placed(part.mesh.positions, matrix)
    corners = points[part.mesh.triangles]
    fronts = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(matrix[:3, :3]) < 0:  # a mirror image, whose triangles turn the other way
        fronts = -fronts
    begins = np.cumsum([0, *(len(rows) for rows in flat.given)])[:-1]
    of_faces = np.add.reduceat(fronts[flat.slots], begins) if len(begins) else np.empty((0, 3))
    return _Thing(part, flat, first, points, corners, fronts, of_faces)


def _note(things: list[_Thing], faces: int, views: int) -> str:
    flat = bound = whole = 0.0
    for each in things:
        area = np.nan_to_num(np.linalg.norm(each.triangle_fronts, axis=1))
        count = sum(len(rows) for rows in each.flat.given[: len(each.flat.polygons)])
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

    points, depths : (n, 2) and (n,) of their vertices
    sizes, sources : (p,) how many vertices each has, and its `Viewing.source`
    rings : how many each ring has; ranks : of the triangles, as `Viewing` has them
    given : triangles of the last of them, which are no polygons
    """

    points: NDArray[np.int32]
    depths: NDArray[np.int32]
    sizes: Ints
    rings: Ints
    sources: Ints
    ranks: Ints
    given: list[NDArray[np.int32]]


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
        first = thing.points[flat.vertices[flat.begins[:-1]]]
        front = ((eye - first) * thing.face_fronts).sum(axis=1) > 0.0
        own = flat.vertices[np.repeat(front, np.diff(flat.begins))]
        of_polygons = np.flatnonzero(front[: len(flat.polygons)])
        bound = np.flatnonzero(front[len(flat.polygons) :])
        yield _Pieces(
            points=grid[own],
            depths=deep[own],
            sizes=np.diff(flat.begins)[front],
            rings=flat.rings[np.repeat(front, flat.rings_of)],
            sources=np.r_[thing.first[0] + of_polygons, rest + 1 + thing.first[1] + bound],
            ranks=base + flat.slots[np.repeat(front, [len(rows) for rows in flat.given])],
            given=[flat.given[len(flat.polygons) + face] for face in bound.tolist()],
        )
        loose = flat.loose[turned[flat.loose]]
        used, corner = np.unique(thing.part.mesh.triangles[loose], return_inverse=True)
        points.append(grid[used])
        depths.append(deep[used])
        triangles.append((corner.reshape(-1, 3) + count).astype(np.int32))
        ranks.append(base + loose)
        count, base = count + len(used), base + len(thing.corners)
    if count:
        size, number = np.array([count]), np.array([rest])
        corners = np.concatenate(points), np.concatenate(depths)
        yield _Pieces(
            *corners, size, size, number, np.concatenate(ranks), [np.concatenate(triangles)]
        )
