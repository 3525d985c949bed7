"""One map tile: its layers, what of each can be drawn exactly, in px, and a note on all else."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.clean import clean
from scenes.readers import guard
from scenes.scene import Note, SceneError
from scenes.tiles.archives import Archive
from scenes.tiles.vector_tile import Layer, layer_of, layers_of

PIXELS = 512
"""Side of a tile on the screen; 256 on old maps, 1024 where a screen is dense."""

_SIDES = (8, 4096)
_GRID = 256


def check_pixels(pixels: int) -> None:
    """Raise SceneError for what is no side of a tile."""
    if pixels % 2 or not _SIDES[0] <= pixels <= _SIDES[1]:
        raise SceneError(
            f"pixels={pixels} is no even number from {_SIDES[0]} to {_SIDES[1]}: give 256, 512 "
            "or 1024"
        )


def rounding(extents: Iterable[int], pixels: int) -> list[str]:
    """A note on each extent whose units are not on the grid of pixels.

    >>> rounding({4096}, 512), len(rounding({4096, 5000}, 512))
    ([], 1)
    """
    return [
        f"a unit is 1/{extent} of {pixels} px, which is not on the grid of 1/{_GRID} px: rounded"
        for extent in sorted(extents)
        if _GRID * pixels % extent
    ]


class Usable(NamedTuple):
    """Polygons of a layer.

    polygons : (p,) valid ones in px of their tile, y up
    dropped, repaired : (feature, why) of the others, and of those that were not valid before
    """

    polygons: NDArray[np.object_]
    dropped: list[Note]
    repaired: list[Note]


def usable(layer: Layer, pixels: int) -> Usable:
    """What can be drawn of a layer, on a tile of so many pixels.

    Coordinates stay exact: an invalid polygon is repaired only where no vertex is added between
    whole units, else dropped; one that reaches further than a tile's side is dropped, too.
    """
    dropped, repaired = list(layer.dropped), []

    def flipped(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        turned: NDArray[np.float64] = xy * [1, -1] + [0, layer.extent]
        return turned

    up = shapely.transform(layer.polygons, flipped)
    labels = [f"feature {k}" for k in layer.feature.tolist()]
    cleaned = clean(up, [f"{label} #{k}" for k, label in enumerate(labels)], flipped)
    crossing = _between_units(cleaned.polygons, cleaned.source)
    far = _reaching(cleaned.polygons, cleaned.source, layer.extent)
    for which, why in cleaned.dropped:
        dropped.append((which.partition(" #")[0], why))
    for which, why in cleaned.repaired:
        label, _, number = which.rpartition(" #")
        if int(number) in crossing:
            drawn = _drawn_by_earcut(up[int(number)])
            dropped.append((label, f"{why.partition(';')[0]}; {drawn}"))
        else:
            repaired.append((label, why))
    for index in sorted(far - crossing):
        dropped.append((labels[index], "reaches further than a tile over its tile's edge"))
    gone = list(crossing | far)
    kept = cleaned.polygons[~np.isin(cleaned.source, gone)]
    scale = pixels / layer.extent
    return Usable(shapely.transform(kept, lambda xy: xy * scale), dropped, repaired)


def _between_units(polygons: NDArray[Any], source: NDArray[np.int64]) -> set[int]:
    """Which sources have a polygon with a vertex that a repair put between whole units."""
    points, owner = shapely.get_coordinates(polygons, return_index=True)
    return set(source[owner[(points != np.rint(points)).any(axis=1)]].tolist())


def _reaching(polygons: NDArray[Any], source: NDArray[np.int64], extent: int) -> set[int]:
    """Which sources have a polygon that reaches further than a tile's side over the edge."""
    bounds = shapely.bounds(polygons).reshape(-1, 4)
    out = (bounds[:, :2] < -extent).any(axis=1) | (bounds[:, 2:] > 2 * extent).any(axis=1)
    return set(source[out].tolist())


def _drawn_by_earcut(polygon: shapely.Polygon) -> str:
    """What a map client makes of an invalid polygon: the share of its area that earcut draws."""
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    rows = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
    a, b, c = (points[rows[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    share = np.abs(ux * vy - uy * vx).sum() / 2 / shapely.make_valid(polygon).area
    return f"left out (earcut's triangles have {share:.1%} of its area)"


class Read(NamedTuple):
    """A layer that was asked for: its name, its extent, and its polygons."""

    name: str
    extent: int
    usable: Usable


@dataclass
class Parts:
    """What was read of a tile.

    layers : of those that were asked for
    known : names of all layers
    damage : why the tile cannot be read, or ""
    damaged : (layer, why) of layers that cannot be read
    absent : whether the archive has no such tile
    """

    layers: list[Read] = field(default_factory=list)
    known: list[str] = field(default_factory=list)
    damage: str = ""
    damaged: list[Note] = field(default_factory=list)
    absent: bool = False


def parts_of(archive: Archive, name: Any, wanted: Collection[str] | None, pixels: int) -> Parts:
    """Read a tile of an archive; of a layer that is damaged, nothing is kept.

    wanted : names of layers, beside those without one; None for all
    pixels : a tile's side on the screen
    """
    parts, notes = Parts(), list[Note]()
    with guard.noted(notes, "", "cannot be read"):
        there = archive.read(name)
        parts.absent = there is None
        found = layers_of(there or b"")
        parts.known = [each for each in found if each]
        for each, pieces in found.items():
            if wanted is None or each in ("", *wanted):
                with guard.noted(parts.damaged, each, "cannot be read"):
                    layer = layer_of(each, pieces)
                    parts.layers.append(Read(each, layer.extent, usable(layer, pixels)))
    parts.damage = notes[0][1] if notes else ""
    return parts
