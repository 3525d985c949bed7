"""What a scene is, and the errors that loading one may raise."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

Note = tuple[str, str]
"""(which, reason): one geometry of the source, and what was done to it and why."""


class SceneError(Exception):
    """A scene could not be loaded; the message is one line: what, where, what to do."""

    def __str__(self) -> str:
        # a file's name may hold ends of lines and control codes
        text = super().__str__()
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class UnknownScene(SceneError):  # noqa: N818 - the name other programs import
    """No scene has this name; the message suggests the nearest."""


@dataclass(frozen=True, eq=False)
class Tiling:
    """The map tiles that a scene's polygons are of; each is a view of its own.

    Polygons are in px, y up, with the tile's lower left corner at (0, 0); they may reach over the
    tile's edge, where they are cut when they are drawn.

    pixels : a tile's side on the screen, even
    names : of the t tiles that hold a polygon, for example "14/9326/4741"
    first : (t + 1,) int64; tile k has the polygons first[k]:first[k + 1]
    """

    pixels: int
    names: tuple[str, ...]
    first: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Viewing:
    """Views of a model in space; a scene's polygons are its flat faces, each in its own plane.

    A view is a picture of the faces whose front is turned to the camera, each a piece of it. Flat
    faces that are no polygons are pieces, too. Its last piece is the rest: triangles that are in no
    face, where there is nothing to choose.

    pixels : side of a picture
    names : of the v views, the way to the camera, for example "1 2 3"
    points : (n, 2) int32, the pieces' vertices one after another, in 1/256 px, y up
    depths : (n,) int32, of the vertices, 0 to 2**24 from near to far; None without a depth test
    offsets : (p + 1,) int64; piece k has points[offsets[k]:offsets[k + 1]]
    ring_ends : (r,) int64, where in `points` each ring ends; the rest has one for all
    source : (p,) int64, which polygon of the scene each is; the rest has the number after the last,
        and the faces that are no polygons those that follow
    first : (v + 1,) int64; view k has the pieces first[k]:first[k + 1]
    given : for each polygon its triangles in the model, (m, 3) int32 rows of its vertices
    rest : for each piece that is the rest of a view or no polygon, its triangles in the model
    ranks : the place of each given triangle of each piece in the order of the model, piece by piece
    near_first : whether triangles are drawn front to back, and not in the model's order
    bound : of each face that is no polygon, (n, 2) whole points in its plane and (m, 3) triangles
    """

    pixels: int
    names: tuple[str, ...]
    points: NDArray[np.int32]
    depths: NDArray[np.int32] | None
    offsets: NDArray[np.int64]
    ring_ends: NDArray[np.int64]
    source: NDArray[np.int64]
    first: NDArray[np.int64]
    given: tuple[NDArray[np.int32], ...]
    rest: dict[int, NDArray[np.int32]]
    ranks: NDArray[np.int64]
    near_first: bool = False
    bound: tuple[tuple[NDArray[np.float64], NDArray[np.int32]], ...] = ()

    @cached_property
    def rank_starts(self) -> NDArray[np.int64]:
        """(p + 1,) where in `ranks` those of each piece begin."""
        of_bound = [len(rows) for _, rows in self.bound]
        sizes = np.array([*(len(rows) for rows in self.given), 0, *of_bound])[self.source]
        for piece, rows in self.rest.items():
            sizes[piece] = len(rows)
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Scene:
    """A named source of polygons in its own units.

    `polygons` are valid, two-dimensional and oriented (exterior counter-clockwise with y up,
    interiors clockwise); holes are allowed. `dropped` names every geometry of the source that is
    not among them and `repaired` every one that was changed to make it valid. `attributes`, where
    the source has any, is a table with one row per polygon. `notes` say what was done to the
    source as a whole: the layer chosen, the projection, heights dropped. `tiling` says which of map
    tiles each polygon is of, `viewing` how a model is seen whose faces the polygons are.
    """

    name: str
    polygons: list[shapely.Polygon]
    units: str
    description: str = ""
    licence: str = ""
    credit: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    dropped: list[Note] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)
    attributes: pd.DataFrame | None = None
    notes: tuple[str, ...] = ()
    tiling: Tiling | None = None
    viewing: Viewing | None = None

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {len(self.polygons)} polygons, {self.units})"

    @cached_property
    def content_hash(self) -> str:
        """SHA-256, in hexadecimal, of all coordinates and ring boundaries, in order, and views."""
        if not self.polygons:
            return hashlib.sha256(b"").hexdigest()
        _, coordinates, (rings, polygons) = shapely.to_ragged_array(np.asarray(self.polygons))
        digest = hashlib.sha256()
        # + 0.0 turns -0.0 into 0.0: equal coordinates must give equal bytes
        digest.update((coordinates + 0.0).astype("<f8").tobytes())
        digest.update(np.asarray(rings).astype("<i8").tobytes())
        digest.update(np.asarray(polygons).astype("<i8").tobytes())
        if self.viewing is not None:
            digest.update(self.viewing.points.astype("<i4").tobytes())
            digest.update(self.viewing.source.astype("<i8").tobytes())
        return digest.hexdigest()

    def head(self, limit: int) -> Scene:
        """The scene cut down to its first `limit` polygons (all of them if it has fewer)."""
        if limit < 1:
            raise SceneError(f"limit={limit} leaves no polygon of {self.name}: give 1 or more")
        limit = min(limit, len(self.polygons))
        attributes = None if self.attributes is None else self.attributes.iloc[:limit]
        tiling = self.tiling
        if tiling is not None:
            first = np.unique(np.minimum(tiling.first, limit))
            tiling = replace(tiling, names=tiling.names[: len(first) - 1], first=first)
        return replace(self, polygons=self.polygons[:limit], attributes=attributes, tiling=tiling)
