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
class Scene:
    """A named source of polygons in its own units.

    `polygons` are valid, two-dimensional and oriented (exterior counter-clockwise with y up,
    interiors clockwise); holes are allowed. `dropped` names every geometry of the source that is
    not among them and `repaired` every one that was changed to make it valid. `attributes`, where
    the source has any, is a table with one row per polygon. `notes` say what was done to the
    source as a whole: the layer chosen, the projection, heights dropped. `tiling` says which of map
    tiles each polygon is of.
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

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {len(self.polygons)} polygons, {self.units})"

    @cached_property
    def content_hash(self) -> str:
        """SHA-256, in hexadecimal, of all coordinates and ring boundaries, in order."""
        digest = hashlib.sha256()
        self._update_hash(digest)
        return digest.hexdigest()

    def _update_hash(self, digest: Any) -> None:
        if not self.polygons:
            return
        _, coordinates, (rings, polygons) = shapely.to_ragged_array(np.asarray(self.polygons))
        # + 0.0 turns -0.0 into 0.0: equal coordinates must give equal bytes
        digest.update((coordinates + 0.0).astype("<f8").tobytes())
        digest.update(np.asarray(rings).astype("<i8").tobytes())
        digest.update(np.asarray(polygons).astype("<i8").tobytes())

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
