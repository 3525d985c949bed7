"""A 3D model as a scene: flat faces, in the views of `harness.models.views`.

A face is drawn if its front points to the camera, decided once for all triangulations, because
snapping to 1/256 px may invert triangles of a face that is seen at an angle.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.frame import ModelScene, Rows, Viewing
from harness.grid import SUBPIXEL
from harness.models.diagonals import find_outlines
from harness.models.flat_faces import Floats, Ints, ModelPart, find_flat_faces
from harness.models.in_place import open_model
from harness.models.views import (
    DISTANCE,
    VIEWS,
    BoundingSphere,
    find_bounding_sphere,
    list_directions,
    list_integer_directions,
    project_points,
    transform_points,
)
from harness.rasterisers.spans import DEEPEST
from harness.settings import RESOLUTIONS
from scenes.scene import Scene, SceneError
from scenes.spec import convert_arguments, parse_name
from triangulators.polygon_arrays import PolygonArray, offsets_of


@dataclass(frozen=True)
class PartFaces:
    """The flat faces of a part that have several triangulations, and the remaining triangles.

    faces : outlines in the plane of each face, integers; invalid faces, which touch themselves or
        have interior vertices, come last, with a single ring of all vertices
    """

    faces: PolygonArray
    count: int  # number of faces that are valid polygons
    vertices: Ints  # (n,) index in the part of each vertex of `faces`
    triangles: list[Rows]  # of each face in the model, (m, 3) indices of the face's vertices
    slots: Ints  # (t,) indices of these triangles in the part, face after face
    loose: Ints  # (u,) indices of the triangles outside faces


def find_part_faces(part: ModelPart) -> PartFaces:
    """Return the faces of a part, and the triangles outside faces."""
    size = len(part.mesh.triangles)
    empty = np.empty(0, np.int64)
    if part.reason_unchanged:
        no_faces = PolygonArray.from_shapely([])
        return PartFaces(no_faces, 0, empty, [], empty, np.arange(size))
    faces, _ = find_flat_faces(part.mesh)
    outlines = find_outlines(faces)
    invalid = np.setdiff1d(np.arange(faces.face_count), outlines.face)
    order = np.append(outlines.face, invalid).tolist()
    spans = [slice(*faces.triangle_offsets[k : k + 2]) for k in order]
    invalid_vertices = [np.unique(faces.triangles[span]) for span in spans[len(outlines.face) :]]
    vertices = np.concatenate([outlines.vertices, *invalid_vertices]).astype(np.int64)
    points = faces.points[vertices[len(outlines.vertices) :]]
    offsets = offsets_of([len(indices) for indices in invalid_vertices])
    rings = PolygonArray(points, offsets, np.arange(len(offsets)))
    polygons = PolygonArray.concatenate([outlines.polygons, rings])
    position = np.zeros(len(faces.points), np.int64)  # of a vertex within its face
    first = np.repeat(polygons.vertex_offsets[:-1], polygons.vertex_counts)
    position[vertices] = np.arange(len(vertices)) - first
    slots = np.concatenate([empty, *(faces.slots[span] for span in spans)])
    is_loose = np.ones(size, np.bool_)
    is_loose[slots] = False
    return PartFaces(
        faces=polygons,
        count=len(outlines.face),
        vertices=faces.vertices[vertices],
        triangles=[position[faces.triangles[span]].astype(np.int32) for span in spans],
        slots=slots,
        loose=np.flatnonzero(is_loose),
    )


DEPTHS = ("none", "file", "front")  # no depth test; in the file's order; front to back
MIN_DISTANCE, MAX_DISTANCE = 1.1, 1000.0  # of the camera from the centre, in radii
MIN_REPORTED_SHARE = 0.005  # of a model's area outside flat faces
MAX_VERTICES, MAX_PIECES = 20_000_000, 500_000  # of all views; criteria take 50 us per face
_DEPTH_RADIUS = 1.05  # half of the depth range around the centre, in radii


def load(text: str) -> Scene:
    """Load "model.glb:views=24,pixels=512,distance=3,depth=file"; raises SceneError."""
    name, arguments = parse_name(text)
    return read(name, **convert_arguments(name, read, dict(arguments)))


@np.errstate(all="ignore")
def read(
    path: str,
    *,
    views: int = VIEWS,
    pixels: int = 1024,
    distance: float = DISTANCE,
    depth: str = DEPTHS[0],
) -> Scene:
    """Read a model as a scene of perspective views from the first `views` of 24 directions.

    pixels : side of each image; distance : of the camera from the model's centre, in radii
    """
    _check_parameters(views, pixels, distance, depth)
    try:
        _, groups = open_model(Path(path))
    except HarnessError as error:
        raise SceneError(str(error)) from error
    polygons: list[shapely.Polygon] = []
    polygon_triangles: list[Rows] = []
    invalid_faces: list[tuple[Floats, Rows]] = []
    instances = []
    for part in (part for parts in groups for part in parts):
        flat = find_part_faces(part)
        numbers = (len(polygons), len(invalid_faces))
        instances += [_make_instance(part, flat, numbers, matrix) for matrix in part.placements]
        valid, invalid = flat.faces[: flat.count], range(flat.count, len(flat.faces))
        polygons += replace(valid, coords=valid.coords / SUBPIXEL)
        polygon_triangles += flat.triangles[: flat.count]
        invalid_faces += [(flat.faces.rings_of(k)[0], flat.triangles[k]) for k in invalid]
    sphere = find_bounding_sphere([instance.corners.reshape(-1, 3) for instance in instances])
    if sphere is None:
        raise SceneError(f"{path}: no visible triangle (all triangles are degenerate)")
    visible: list[_ViewPieces] = []
    other_triangles: dict[int, Rows] = {}
    piece_offsets = [0]
    vertices = 0
    for direction in list_directions()[:views]:
        end = piece_offsets[-1]
        for pieces in _list_pieces(instances, sphere, direction, distance, pixels, len(polygons)):
            end += len(pieces.outlines)
            first_other = end - len(pieces.other_triangles)
            other_triangles |= enumerate(pieces.other_triangles, first_other)
            vertices += len(pieces.depths)
            visible.append(pieces)
        piece_offsets.append(end)
        if vertices > MAX_VERTICES or end > MAX_PIECES:
            limits = f"{MAX_VERTICES:,} vertices or {MAX_PIECES:,} faces"
            raise SceneError(f"{path}: more than {limits} in all views; reduce views=")
    axes = list_integer_directions()[:views].tolist()
    depths = np.concatenate([pieces.depths for pieces in visible])
    return ModelScene(
        name=Path(path).stem,
        polygons=polygons,
        units="units",
        description=str(path),
        licence="as the file's",
        parameters={"views": views, "pixels": pixels, "distance": distance, "depth": depth},
        notes=(_describe_coverage(instances, len(polygons), views),),
        viewing=Viewing(
            pixels=pixels,
            names=tuple(" ".join(map(str, axis)) for axis in axes),
            pieces=PolygonArray.concatenate([pieces.outlines for pieces in visible]),
            depths=None if depth == "none" else depths,
            source=np.concatenate([pieces.sources for pieces in visible]),
            piece_offsets=np.array(piece_offsets, np.int64),
            polygon_triangles=tuple(polygon_triangles),
            other_triangles=other_triangles,
            invalid_faces=tuple(invalid_faces),
            ranks=np.concatenate([pieces.ranks for pieces in visible]),
            front_to_back=depth == "front",
        ),
    )


def _check_parameters(views: int, pixels: int, distance: float, depth: str) -> None:
    if not 1 <= views <= VIEWS:
        raise SceneError(f"views={views}: out of range (1 to {VIEWS})")
    if pixels % 2 or not RESOLUTIONS[0] <= pixels <= RESOLUTIONS[1]:
        raise SceneError(f"pixels={pixels}: not an even number from 8 to {RESOLUTIONS[1]}")
    if not MIN_DISTANCE <= distance <= MAX_DISTANCE:
        raise SceneError(
            f"distance={distance:g}: out of range ({MIN_DISTANCE:g} to {MAX_DISTANCE:g} radii)"
        )
    if depth not in DEPTHS:
        raise SceneError(f"unknown depth={depth} (choose from {', '.join(DEPTHS)})")


class _Instance(NamedTuple):
    """A part at one of its placements in the model."""

    part: ModelPart
    flat: PartFaces
    first: tuple[int, int]  # indices of the first polygon and the first invalid face
    points: Floats  # (n, 3)
    corners: Floats  # (m, 3, 3) vertices of the triangles
    triangle_fronts: Floats  # normals, not of unit length
    face_fronts: Floats  # normals, not of unit length


def _make_instance(
    part: ModelPart, flat: PartFaces, first: tuple[int, int], matrix: Floats
) -> _Instance:
    points = transform_points(part.mesh.positions, matrix)
    corners = points[part.mesh.triangles]
    fronts = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored: the orientation of triangles is reversed
        fronts = -fronts
    first_slots = offsets_of([len(rows) for rows in flat.triangles])[:-1]
    face_fronts = np.empty((0, 3))
    if len(first_slots):
        face_fronts = np.add.reduceat(fronts[flat.slots], first_slots)
    return _Instance(part, flat, first, points, corners, fronts, face_fronts)


def _describe_coverage(instances: list[_Instance], faces: int, views: int) -> str:
    valid = invalid = total = 0.0
    for instance in instances:
        area = np.nan_to_num(np.linalg.norm(instance.triangle_fronts, axis=1))
        count = sum(len(rows) for rows in instance.flat.triangles[: instance.flat.count])
        valid += float(area[instance.flat.slots[:count]].sum())
        invalid += float(area[instance.flat.slots[count:]].sum())
        total += float(area.sum())
    total = total or 1.0
    note = f"{faces} flat faces with a choice of diagonals, {valid / total:.0%} of the area"
    if invalid:
        note += (
            f"; {invalid / total:.0%} of the area in faces that are not polygons (the outline "
            "touches itself, or a vertex is inside): optimal and flips flip diagonals there, as "
            "triangulate does; other triangulators do not change these faces"
        )
    outside = 1.0 - (valid + invalid) / total
    if outside >= MIN_REPORTED_SHARE:
        note += f"; {outside:.0%} of the area outside flat faces, not changed"
    return f"{note}; {views} views"


class _ViewPieces(NamedTuple):
    """Pieces of a view; sources and ranks as in `Viewing`."""

    outlines: PolygonArray  # projected pieces, in 1/256 px
    depths: NDArray[np.int32]  # (n,) of the vertices
    sources: Ints
    ranks: Ints
    other_triangles: list[Rows]  # of the last pieces, which are not polygons


def _list_pieces(
    instances: list[_Instance],
    sphere: BoundingSphere,
    direction: Floats,
    distance: float,
    pixels: int,
    polygon_count: int,
) -> Iterator[_ViewPieces]:
    """Yield the pieces of a view part by part, then the loose triangles, if any."""
    eye = sphere.middle + sphere.radius * distance * direction
    near, far = distance - _DEPTH_RADIUS, distance + _DEPTH_RADIUS
    # Loose triangles of all parts, with consecutive vertex numbers.
    points, depths, triangles, ranks = [], [], [], []
    count = base = 0
    for instance in instances:
        flat = instance.flat
        local = (instance.points - sphere.middle) / sphere.radius
        position, distances = project_points(local, direction, distance)
        grid = np.nan_to_num(np.rint(position * (pixels * SUBPIXEL))).astype(np.int32)
        deep = far * (distances - near) / (distances * (far - near)) * DEEPEST
        deep = np.nan_to_num(np.rint(deep)).astype(np.int32)
        to_eye = eye - instance.corners[:, 0]
        front_triangles = (to_eye * instance.triangle_fronts).sum(axis=1) > 0.0
        first = instance.points[flat.vertices[flat.faces.vertex_offsets[:-1]]]
        front = ((eye - first) * instance.face_fronts).sum(axis=1) > 0.0
        valid, invalid = np.flatnonzero(front[: flat.count]), np.flatnonzero(front[flat.count :])
        yield _ViewPieces(
            outlines=replace(flat.faces, coords=grid[flat.vertices]).take(front),
            depths=deep[flat.vertices[np.repeat(front, flat.faces.vertex_counts)]],
            sources=np.r_[
                instance.first[0] + valid, polygon_count + 1 + instance.first[1] + invalid
            ],
            ranks=base + flat.slots[np.repeat(front, [len(rows) for rows in flat.triangles])],
            other_triangles=[flat.triangles[flat.count + face] for face in invalid.tolist()],
        )
        loose = flat.loose[front_triangles[flat.loose]]
        used, corner = np.unique(instance.part.mesh.triangles[loose], return_inverse=True)
        points.append(grid[used])
        depths.append(deep[used])
        triangles.append((corner.reshape(-1, 3) + count).astype(np.int32))
        ranks.append(base + loose)
        count, base = count + len(used), base + len(instance.corners)
    if count:
        yield _ViewPieces(
            outlines=PolygonArray.of_single_rings(np.concatenate(points), count),
            depths=np.concatenate(depths),
            sources=np.array([polygon_count]),
            ranks=np.concatenate(ranks),
            other_triangles=[np.concatenate(triangles)],
        )
