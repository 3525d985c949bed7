"""A model in space as a scene: its flat faces are the polygons, its views what is drawn."""

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.readers.reader import is_model
from scenes.scene import Scene
from scenes.spec import is_path, parse_name
from triangulators.polygon_arrays import PolygonArray, offsets_of

Rows = NDArray[np.int32]

VIEW_OPTIONS = ("views", "pixels", "distance", "depth")
"""Parameters of a model that is seen from several sides."""


@dataclass(frozen=True, eq=False)
class Viewing:
    """Views of a model; a scene's polygons are its flat faces, each in its own plane.

    A view is a picture of the faces whose front is turned to the camera, each a piece of it. Flat
    faces that are no polygons are pieces, too. The last piece of a view is the rest: triangles that
    are in no face, where there is nothing to choose.

    pixels : side of a picture
    names : of the v views, the way to the camera, for example "1 2 3"
    pieces : the p pieces as they are seen, int32 coordinates in 1/256 px, y up; the rest of a view
        has one ring for all its vertices
    depths : (n,) int32, of the vertices, 0 to 2**24 from near to far; None without a depth test
    source : (p,) int64, the polygon of the scene that each piece is; the rest has the number after
        the last, and the faces that are no polygons those that follow
    first : (v + 1,) int64; view k has the pieces first[k]:first[k + 1]
    given : for each polygon its triangles in the model, (m, 3) int32 rows of its vertices
    rest : for each piece that is the rest of a view or no polygon, its triangles in the model
    ranks : position of each given triangle of each piece in the order of the model, piece by piece
    near_first : whether triangles are drawn front to back, and not in the model's order
    bound : of each face that is no polygon, (n, 2) integer points in its plane and (m, 3) triangles
    """

    pixels: int
    names: tuple[str, ...]
    pieces: PolygonArray
    depths: NDArray[np.int32] | None
    source: NDArray[np.int64]
    first: NDArray[np.int64]
    given: tuple[Rows, ...]
    rest: dict[int, Rows]
    ranks: NDArray[np.int64]
    near_first: bool = False
    bound: tuple[tuple[NDArray[np.float64], Rows], ...] = ()

    @cached_property
    def rank_offsets(self) -> NDArray[np.int64]:
        """(p + 1,) where in `ranks` those of each piece begin, and the end."""
        of_bound = [len(rows) for _, rows in self.bound]
        sizes = np.array([*(len(rows) for rows in self.given), 0, *of_bound])[self.source]
        for piece, rows in self.rest.items():
            sizes[piece] = len(rows)
        return offsets_of(sizes)


@dataclass(frozen=True, eq=False, repr=False)
class ModelScene(Scene):
    """A scene whose polygons are the flat faces of a model; `viewing` says how they are seen."""

    viewing: Viewing | None = None

    def _update_hash(self, digest: Any) -> None:
        super()._update_hash(digest)
        if self.polygons and self.viewing is not None:
            digest.update(self.viewing.pieces.coords.astype("<i4").tobytes())
            digest.update(self.viewing.source.astype("<i8").tobytes())


def viewing_of(scene: Scene) -> Viewing | None:
    """Return how a model is seen, or None if the scene is not a model."""
    return scene.viewing if isinstance(scene, ModelScene) else None


def is_model_with_views(text: str) -> bool:
    """Return whether "name:key=value" names views of a model, for example "part.glb:views=24".

    Misspelt view options count: the error message then lists the valid ones.
    """
    name, given = parse_name(text)
    model = is_model(Path(name)) and any(get_close_matches(key, VIEW_OPTIONS) for key in given)
    return is_path(name) and ("views" in given or model)
