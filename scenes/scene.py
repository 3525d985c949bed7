"""Scenes, errors of loading a scene, and notes on geometries that were dropped or changed."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

Note = tuple[str, str]
"""(name, reason): name of a geometry of the source, and why it was dropped or how repaired."""


class SceneError(Exception):
    """A scene that cannot be loaded; the message is one line: object, problem, remedy."""

    def __str__(self) -> str:
        # Escaped, because a file's name may contain line ends and control codes.
        text = super().__str__()
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class UnknownSceneError(SceneError):
    """An unregistered name; the message suggests the nearest name."""


@dataclass(frozen=True, eq=False)
class Tiling:
    """Map tiles of a scene's polygons, in px of the tile, y up; each tile is a separate view.

    pixels : side of a tile on the screen, even
    names : names of the t tiles with polygons, for example "14/9326/4741"
    first : (t + 1,) int64; tile k has the polygons first[k]:first[k + 1]
    """

    pixels: int
    names: tuple[str, ...]
    first: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Scene:
    """Polygons with a name and a unit.

    Attributes
    ----------
    polygons
        Valid, two-dimensional, oriented polygons: exterior counter-clockwise with y up, interiors
        clockwise.
    dropped, repaired
        Notes on geometries of the source without a polygon here, and on changed geometries.
    attributes
        Table with one row per polygon, or None.
    notes
        Steps that apply to the complete source: choice of a layer, projection, dropped heights.
    tiling
        The map tile of each polygon, or None.
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
        """The SHA-256, in hexadecimal, of all coordinates and of the offsets of all rings."""
        digest = hashlib.sha256()
        self._update_hash(digest)
        return digest.hexdigest()

    def _update_hash(self, digest: Any) -> None:
        if not self.polygons:
            return
        _, coordinates, (rings, polygons) = shapely.to_ragged_array(np.asarray(self.polygons))
        # + 0.0 turns -0.0 into 0.0: equal coordinates must give equal bytes.
        digest.update((coordinates + 0.0).astype("<f8").tobytes())
        digest.update(np.asarray(rings).astype("<i8").tobytes())
        digest.update(np.asarray(polygons).astype("<i8").tobytes())

    def head(self, limit: int) -> Scene:
        """Return the scene with its first `limit` polygons, or all if it has fewer."""
        if limit < 1:
            raise SceneError(f"limit={limit} is out of range for {self.name}: give 1 or more")
        limit = min(limit, len(self.polygons))
        attributes = None if self.attributes is None else self.attributes.iloc[:limit]
        tiling = self.tiling
        if tiling is not None:
            first = np.unique(np.minimum(tiling.first, limit))
            tiling = replace(tiling, names=tiling.names[: len(first) - 1], first=first)
        return replace(self, polygons=self.polygons[:limit], attributes=attributes, tiling=tiling)


MAX_EXAMPLES = 1000  # stored notes of each kind; further notes are only counted


def remove_location(reason: str) -> str:
    """Return the reason of a note without location and repair, for counting equal reasons.

    >>> remove_location("self-intersects at 3.0 4.0; repaired into 2 polygons")
    'self-intersects'
    """
    return reason.split(" at ")[0].split(";")[0]


@dataclass
class NoteCounter:
    """Counts of notes by kind ("dropped", "repaired", "failed") and reason, with examples."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    examples: dict[str, list[Note]] = field(default_factory=dict)

    def note(self, kind: str, notes: Sequence[Note], times: int = 1) -> None:
        """Count notes of a kind, each as `times` polygons; store up to `MAX_EXAMPLES` of them."""
        for _, reason in notes:
            self.counts[kind, remove_location(reason)] += times
        examples = self.examples.setdefault(kind, [])
        examples += notes[: MAX_EXAMPLES - len(examples)]

    def list_examples(self, *kinds: str) -> list[tuple[str, str, str]]:
        """Return (kind, name, reason) of the stored notes of these kinds."""
        return [(kind, *note) for kind in kinds for note in self.examples.get(kind, ())]
