"""A model in space as a scene: its flat faces are triangulated, and its views are drawn."""

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

Rows = NDArray[np.int32]  # (m, 3), rows of three vertex indices
VIEW_OPTIONS = ("views", "pixels", "distance", "depth")  # parameters of a scene that request views


@dataclass(frozen=True, eq=False)
class Viewing:
    """Views of a model; the scene's polygons are the valid flat faces, each in its plane.

    A view consists of pieces, in this order: the valid faces whose front points to the camera; such
    invalid faces (the outline touches itself, or a vertex is inside); and one piece for all loose
    triangles, those outside of faces. Triangulators change valid faces, flips also invalid faces.

    pixels : side of the image of a view
    names : (v) direction to the camera of each view, for example "1 2 3"
    pieces : p projected pieces, int32 coordinates in 1/256 px, y up; one ring for loose triangles
    depths : (n,) depth of each vertex, from 0, near, to 2**24; None without a depth test
    source : (p,) number in the scene of the face of each piece; q, the number of polygons, stands
        for loose triangles, and q + 1 + k for invalid face k
    piece_offsets : (v + 1,); view k has the pieces piece_offsets[k]:piece_offsets[k + 1]
    polygon_triangles : for each polygon its triangles in the model's file
    other_triangles : the file's triangles of other pieces, by number of the piece
    ranks : position in the model's file of each triangle of each piece, piece by piece
    front_to_back : True to draw triangles front to back instead of in the model's order
    invalid_faces : for each invalid face (n, 2) integer points in its plane, and its triangles
    """

    pixels: int
    names: tuple[str, ...]
    pieces: PolygonArray
    depths: NDArray[np.int32] | None
    source: NDArray[np.int64]
    piece_offsets: NDArray[np.int64]
    polygon_triangles: tuple[Rows, ...]
    other_triangles: dict[int, Rows]
    ranks: NDArray[np.int64]
    front_to_back: bool = False
    invalid_faces: tuple[tuple[NDArray[np.float64], Rows], ...] = ()

    @cached_property
    def rank_offsets(self) -> NDArray[np.int64]:
        """Offsets (p + 1,) of the pieces in `ranks`."""
        polygon_sizes = [len(rows) for rows in self.polygon_triangles]
        face_sizes = [len(rows) for _, rows in self.invalid_faces]
        sizes = np.array([*polygon_sizes, 0, *face_sizes])[self.source]
        for piece, rows in self.other_triangles.items():
            sizes[piece] = len(rows)
        return offsets_of(sizes)


@dataclass(frozen=True, eq=False, repr=False)
class ModelScene(Scene):
    """A scene whose polygons are a model's flat faces; the model's views are drawn instead."""

    viewing: Viewing | None = None

    def _update_hash(self, digest: Any) -> None:
        super()._update_hash(digest)
        if self.polygons and self.viewing is not None:
            digest.update(self.viewing.pieces.coords.astype("<i4").tobytes())
            digest.update(self.viewing.source.astype("<i8").tobytes())


def get_viewing(scene: Scene) -> Viewing | None:
    """Return the views of a scene, or None if the scene is not a model."""
    return scene.viewing if isinstance(scene, ModelScene) else None


def is_model_with_views(text: str) -> bool:
    """Return whether a name such as "part.glb:views=24" requests views, even if misspelt."""
    name, arguments = parse_name(text)
    model = is_model(Path(name)) and any(get_close_matches(key, VIEW_OPTIONS) for key in arguments)
    return is_path(name) and ("views" in arguments or model)
