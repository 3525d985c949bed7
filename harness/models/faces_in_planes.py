"""The flat faces of a part that are polygons, each in its own plane, and the triangles beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.frame import SUBPIXEL
from harness.models.diagonals import outlines, shapes
from harness.models.flat_faces import flat_faces
from harness.models.mesh import Part

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Flat:
    """Faces in which there is a choice, and what is left.

    polygons : in px of which 1/256 is a step of the face's coordinates
    given : for each its triangles in the model, (m, 3) rows of its vertices
    slots : (t,) which triangles of the part these are, face after face
    vertices : (n,) which vertex of the part each vertex of a polygon is
    begins : (f + 1,) where in `vertices` each polygon begins
    rings : (r,) vertices of each ring; rings_of : (f,) rings of each polygon
    loose : (u,) which triangles of the part are in none of the faces
    """

    polygons: list[shapely.Polygon]
    given: list[NDArray[np.int32]]
    slots: Ints
    vertices: Ints
    begins: Ints
    rings: Ints
    rings_of: Ints
    loose: Ints


def flat_of(part: Part) -> Flat:
    """Return the faces of a part whose outlines are valid polygons through all their vertices."""
    count = len(part.mesh.triangles)
    if part.left:
        none = np.empty(0, np.int64)
        return Flat([], [], none, none, np.zeros(1, np.int64), none, none, np.arange(count))
    faces, _ = flat_faces(part.mesh)
    found = outlines(faces)
    coordinates, ring_ends, polygon_ends = found.polygons
    begins = np.r_[0, np.r_[0, ring_ends][polygon_ends]].astype(np.int64)
    place = np.zeros(len(faces.points), np.int64)
    place[found.vertices] = np.arange(len(found.vertices)) - np.repeat(begins[:-1], np.diff(begins))
    spans = [slice(*faces.starts[face : face + 2]) for face in found.face.tolist()]
    slots = np.concatenate([np.empty(0, np.int64), *(faces.slots[span] for span in spans)])
    alone = np.ones(count, np.bool_)
    alone[slots] = False
    return Flat(
        polygons=list(shapes(coordinates / SUBPIXEL, ring_ends, polygon_ends)),
        given=[place[faces.triangles[span]].astype(np.int32) for span in spans],
        slots=slots,
        vertices=faces.vertices[found.vertices],
        begins=begins,
        rings=np.diff(ring_ends, prepend=0).astype(np.int64),
        rings_of=np.diff(polygon_ends, prepend=0).astype(np.int64),
        loose=np.flatnonzero(alone),
    )
