"""The Mapbox Vector Tile format, version 2.1: layers, and the polygons in them, as they are.

Libraries that read tiles mend rings or drop them, clip them at the tile or project them. A
measurement must count what is lost, and needs whole coordinates: so this reads the format itself.

Source: the Mapbox Vector Tile Specification 2.1. Which ring is a hole is decided as its readers do
it (`classifyRings` of npm's @mapbox/vector-tile): a ring is outer if it winds as the first one with
area of its feature does, so that tiles of version 1 are read, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.damage import noted
from scenes.scene import Note
from scenes.tiles.wire import BYTES, FIXED32, FIXED64, VARINT, fields, unzigzag, varints

POINT, LINE, POLYGON = 1, 2, 3
"""Geometry types; 0 is unknown."""

_MOVE, _TO, _CLOSE = 1, 2, 7
_FURTHEST = 2**24
"""Largest coordinate: areas are exact in 64 bits then."""

_LAYERS = 3
_NAME, _FEATURES, _KEYS, _VALUES, _EXTENT, _VERSION = 1, 2, 3, 4, 5, 15
_TAGS, _TYPE, _GEOMETRY = 2, 3, 4
_OF_LAYER = {
    **dict.fromkeys((_NAME, _FEATURES, _KEYS, _VALUES), BYTES),
    **dict.fromkeys((_EXTENT, _VERSION), VARINT),
}
_OF_VALUE = {1: BYTES, 2: FIXED32, 3: FIXED64, 4: VARINT, 5: VARINT, 6: VARINT, 7: VARINT}


@dataclass(frozen=True)
class Layer:
    """A layer's polygons in whole units, y down, the tile from 0 to `extent`.

    polygons : (p,) shapely polygons, valid or not
    feature : (p,) which of the layer's features, from 0, each is of
    dropped : (feature, why) of what could not be read
    """

    name: str
    extent: int
    polygons: NDArray[np.object_]
    feature: NDArray[np.int64]
    dropped: list[Note]


def layers_of(tile: bytes) -> dict[str, list[memoryview]]:
    """The layers of a tile that is not compressed, unread, by name; "" for any without.

    Each name should have one. Raises ValueError, in one line, where the tile is not as the format
    says.
    """
    found: dict[str, list[memoryview]] = {}
    for _, value in _known(fields(memoryview(tile)), {_LAYERS: BYTES}):
        found.setdefault(_name(value), []).append(value)
    return found


def _name(layer: memoryview) -> str:
    with suppress(ValueError):
        for number, kind, value in fields(layer):
            if (number, kind) == (_NAME, BYTES):
                return bytes(value).decode()
    return ""


def layer_of(name: str, found: list[memoryview]) -> Layer:
    """Read a layer that `layers_of` found.

    Raises ValueError, in one line, where it is not as the format says. What is wrong with one
    feature alone is noted, and that feature left out.
    """
    if not name:
        raise ValueError("a layer has no name")
    if len(found) > 1:
        raise ValueError(f"it has layer {name} twice")
    return _layer(name, found[0])


def decode(tile: bytes) -> list[Layer]:
    """Read all layers of a tile; raises as the two above."""
    return [layer_of(*each) for each in layers_of(tile).items()]


def _known(
    found: Iterable[tuple[int, int, Any]], kinds: dict[int, int]
) -> Iterable[tuple[int, Any]]:
    """The fields that are in `kinds`; ValueError if one has another wire type than there."""
    for number, kind, value in found:
        if number in kinds:
            if kind != kinds[number]:
                raise ValueError(f"field {number} has wire type {kind}, not {kinds[number]}")
            yield number, value


def _layer(name: str, data: memoryview) -> Layer:
    single: dict[int, Any] = {_EXTENT: 4096}
    features: list[memoryview] = []
    counts = {_KEYS: 0, _VALUES: 0}
    for number, value in _known(fields(data), _OF_LAYER):
        if number in (_EXTENT, _VERSION):
            single[number] = value
        elif number == _FEATURES:
            features.append(value)
        elif number in counts:
            counts[number] += 1
            if number == _VALUES and len(list(_known(fields(value), _OF_VALUE))) != 1:
                raise ValueError("a value is of no known type, or of several")
    if single.get(_VERSION) not in (1, 2):
        raise ValueError(f"layer {name} is of version {single.get(_VERSION)}, not 1 or 2")
    extent = single[_EXTENT]
    if not 0 < extent < 2**31:
        raise ValueError(f"layer {name} has an extent of {extent}")
    dropped: list[Note] = []
    numbers, blobs = [], []
    for number, feature in enumerate(features):
        with noted(dropped, f"feature {number}", "cannot be read"):
            kind, geometry = _feature(feature, counts[_KEYS], counts[_VALUES])
            if kind == POLYGON:
                numbers.append(number)
                blobs.append(geometry)
            else:
                _strokes(varints(geometry).tolist(), kind)
    return Layer(name, extent, *_polygons(numbers, blobs, dropped), dropped)


def _feature(data: memoryview, keys: int, values: int) -> tuple[int, bytes]:
    """A feature's type and its geometry's bytes; ValueError where it is not as the format says."""
    kind, geometry, tags = None, None, b""
    for number, value in _known(fields(data), {_TAGS: BYTES, _TYPE: VARINT, _GEOMETRY: BYTES}):
        if number == _TYPE:
            kind = value
        elif number == _TAGS:
            tags = bytes(value)
        elif geometry is not None:
            raise ValueError("it has two geometries")
        else:
            geometry = bytes(value)
    if kind is None or geometry is None:
        raise ValueError(f"it has no {'type' if kind is None else 'geometry'}")
    if kind > POLYGON:
        raise ValueError(f"its type is {kind}, not 0 to 3")
    named = varints(tags).tolist()
    most = max(named[::2], default=-1), max(named[1::2], default=-1)
    if len(named) % 2 or most[0] >= keys or most[1] >= values:
        raise ValueError("its tags name a key or a value that the layer has not")
    return kind, geometry


def _strokes(geometry: Sequence[int], kind: int) -> None:
    """Raise ValueError if the commands of points or lines are not as the format says."""
    place = 0
    while kind and place < len(geometry):
        command, count = geometry[place] & 7, geometry[place] >> 3
        allowed = (_MOVE,) if kind == POINT or not place else (_MOVE, _TO)
        if command not in allowed or not 0 < count <= (len(geometry) - place - 1) // 2:
            raise ValueError(f"command {command}, {count} times, does not fit in")
        place += 1 + 2 * count


def _polygons(
    numbers: list[int], blobs: list[bytes], dropped: list[Note]
) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """The polygons of a layer's features, and the feature of each."""
    points, sizes, owners = [np.empty((0, 2), np.int64)], [], []
    for number, blob in zip(numbers, blobs, strict=True):
        with noted(dropped, f"feature {number}", "cannot be read"):
            own, rings = _rings(varints(blob))
            points.append(own)
            sizes += rings
            owners += [number] * len(rings)
    return _grouped(
        np.concatenate(points), np.array(sizes, np.int64), np.array(owners, np.int64), dropped
    )


def _rings(geometry: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[int]]:
    """The (n, 2) points of a feature's rings, not closed, and how many each ring has."""
    commands = geometry.tolist()
    kept, sizes, place = [np.empty(0, np.int64)], [], 0
    while place < len(commands):
        if commands[place] != (1 << 3 | _MOVE):
            raise ValueError("a ring does not begin with one MoveTo")
        line = place + 3
        count = commands[line] >> 3 if line < len(commands) else 0
        end = line + 1 + 2 * count
        if not count or commands[line] & 7 != _TO or end >= len(commands):
            raise ValueError("a ring has no LineTo, or not as many points as it says")
        if commands[end] != (1 << 3 | _CLOSE):
            raise ValueError("a ring does not end with one ClosePath")
        kept += [geometry[place + 1 : line], geometry[line + 1 : end]]
        sizes.append(count + 1)
        place = end + 1
    steps = np.concatenate(kept).reshape(-1, 2)
    points = unzigzag(steps).cumsum(axis=0)
    if np.abs(points).max(initial=0) > _FURTHEST:
        raise ValueError(f"it has a coordinate beyond {_FURTHEST}")
    return points, sizes


def _grouped(
    points: NDArray[np.int64],
    sizes: NDArray[np.int64],
    owners: NDArray[np.int64],
    dropped: list[Note],
) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Polygons of rings: `points` of all, how many each has, and the feature that each is of."""
    if not len(sizes):
        return np.empty(0, object), owners
    starts = np.cumsum(sizes) - sizes
    following = np.arange(1, len(points) + 1)
    following[starts + sizes - 1] = starts
    x, y = points.T
    sign = np.sign(np.add.reduceat(x * y[following] - x[following] * y, starts))
    dropped += [(f"feature {owner}", "has a ring without area") for owner in owners[sign == 0]]
    solid = np.flatnonzero(sign)
    owners, sign = owners[solid], sign[solid]
    first = np.searchsorted(owners, owners)  # of its feature
    outer = np.flatnonzero(sign == sign[first])
    rings = [points[starts[k] : starts[k] + sizes[k]] for k in solid]
    closed = [part for ring in rings for part in (ring, ring[:1])]
    ends = np.concatenate([[0], np.cumsum(sizes[solid] + 1)])
    polygons = shapely.from_ragged_array(
        shapely.GeometryType.POLYGON,
        np.concatenate([np.empty((0, 2), np.int64), *closed]).astype(float),
        (ends, np.append(outer, len(solid))),
    )
    return polygons, owners[outer]
