"""Reader of the Mapbox Vector Tile format, version 2.1: the polygons of layers, unchanged.

Libraries that read tiles repair or drop rings, clip them at the tile or project them. But a
measurement must count dropped polygons and needs integer coordinates: so protobuf decodes the
messages, and this module builds polygons from them.

Source: the Mapbox Vector Tile Specification 2.1. Which ring is a hole is decided as its readers do
it (`classifyRings` of npm's @mapbox/vector-tile): a ring is outer if it winds as the first one with
area of its feature does, so that tiles of version 1 are read, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.guard import note_errors
from scenes.scene import Note
from scenes.tiles.archives import import_optional

POINT, LINE, POLYGON = 1, 2, 3
"""Geometry types; 0 is unknown."""

_MOVE, _TO, _CLOSE = 1, 2, 7
_FURTHEST = 2**24
"""Largest coordinate: areas are exact in 64 bits then."""


class _Messages(NamedTuple):
    tile: Any
    layer: Any
    feature: Any
    unknown: Any


@cache
def _messages() -> _Messages:
    """Return the classes of protobuf's messages.

    Nested messages are bytes here and decoded separately: an invalid layer or feature then affects
    no other. A name is bytes, too, because it may be invalid UTF-8.
    """
    descriptor = import_optional("google.protobuf.descriptor_pb2")
    file = descriptor.FileDescriptorProto(name="vector_tile.proto", package="raster_harness")
    kinds = descriptor.FieldDescriptorProto
    bytes_, number = kinds.TYPE_BYTES, kinds.TYPE_UINT32
    one, many = kinds.LABEL_OPTIONAL, kinds.LABEL_REPEATED
    for name, fields in {
        "Tile": (("layers", 3, many, bytes_),),
        "Layer": (
            ("name", 1, one, bytes_),
            ("features", 2, many, bytes_),
            ("keys", 3, many, bytes_),
            ("values", 4, many, bytes_),
            ("extent", 5, one, number),
            ("version", 15, one, number),
        ),
        "Feature": (
            ("tags", 2, many, number),
            ("type", 3, one, number),
            ("geometry", 4, many, number),
        ),
    }.items():
        message = file.message_type.add(name=name)
        for field, place, label, kind in fields:
            message.field.add(name=field, number=place, label=label, type=kind)
    pool = import_optional("google.protobuf.descriptor_pool").DescriptorPool()
    pool.Add(file)
    made = import_optional("google.protobuf.message_factory").GetMessageClass
    kinds_of = (pool.FindMessageTypeByName(f"raster_harness.{m.name}") for m in file.message_type)
    unknown = import_optional("google.protobuf.unknown_fields").UnknownFieldSet
    tile, layer, feature = map(made, kinds_of)
    return _Messages(tile, layer, feature, unknown)


def _decoded(kind: Any, data: bytes) -> Any:
    """Return a message; raises ValueError if it is invalid, or a known field has another wire type.

    Protobuf silently skips such a field, which may contain polygons.
    """
    try:
        message = kind.FromString(data)
    except Exception as error:  # protobuf's exceptions differ between versions
        raise ValueError("it is not a vector tile, or truncated") from error
    known = kind.DESCRIPTOR.fields_by_number
    for field in _messages().unknown(message):
        if field.field_number in known:
            raise ValueError(f"field {field.field_number} has wire type {field.wire_type}")
    return message


@dataclass(frozen=True)
class Layer:
    """A layer's polygons in integer units, y down, the tile from 0 to `extent`.

    polygons : (p,) shapely polygons, valid or not
    feature : (p,) index of the feature of each polygon
    dropped : (feature, reason) of features that could not be read
    """

    name: str
    extent: int
    polygons: NDArray[np.object_]
    feature: NDArray[np.int64]
    dropped: list[Note]


def decode_layers(tile: bytes) -> dict[str, list[Any]]:
    """Return the layers of an uncompressed tile, as messages, by name; "" if it has none.

    Each name should have one message. A layer that cannot be decoded is a ValueError under "".
    Raises ValueError, in one line, if the tile violates the format.
    """
    messages = _messages()
    found: dict[str, list[Any]] = {}
    for data in _decoded(messages.tile, tile).layers:
        try:
            layer = _decoded(messages.layer, data)
            name = layer.name.decode()
        except ValueError as error:
            layer, name = error, ""
        found.setdefault(name, []).append(layer)
    return found


def build_layer(name: str, found: list[Any]) -> Layer:
    """Return a layer, given the messages of its name by `decode_layers`.

    Raises ValueError, in one line, if it violates the format. Invalid features are noted and
    skipped.
    """
    if isinstance(found[0], ValueError):
        raise found[0]
    if not name:
        raise ValueError("a layer has no name")
    if len(found) > 1:
        raise ValueError(f"it has layer {name} twice")
    return _layer(name, found[0])


def _layer(name: str, layer: Any) -> Layer:
    version = layer.version if layer.HasField("version") else None
    if version not in (1, 2):
        raise ValueError(f"layer {name} is of version {version}, not 1 or 2")
    extent = layer.extent if layer.HasField("extent") else 4096
    if not 0 < extent < 2**31:
        raise ValueError(f"layer {name} has an extent of {extent}")
    dropped: list[Note] = []
    steps: list[int] = []
    sizes: list[int] = []
    owners: list[int] = []
    for number, feature in enumerate(layer.features):
        with note_errors(dropped, f"feature {number}", "cannot be read"):
            kind, geometry = _feature(feature, len(layer.keys), len(layer.values))
            if kind != POLYGON:
                _check_strokes(geometry, kind)
                continue
            own, rings = _rings(geometry)
            steps += own
            sizes += rings
            owners += [number] * len(rings)
    found = np.array(steps, np.int64), np.array(sizes, np.int64), np.array(owners, np.int64)
    return Layer(name, extent, *_grouped(*found, dropped), dropped)


def _feature(data: bytes, keys: int, values: int) -> tuple[int, list[int]]:
    """Return a feature's type and the numbers of its geometry; ValueError if it is invalid."""
    feature = _decoded(_messages().feature, data)
    if not feature.HasField("type") or not feature.geometry:
        raise ValueError(f"it has no {'geometry' if feature.HasField('type') else 'type'}")
    if feature.type > POLYGON:
        raise ValueError(f"its type is {feature.type}, not 0 to 3")
    tags = list(feature.tags)
    most = max(tags[::2], default=-1), max(tags[1::2], default=-1)
    if len(tags) % 2 or most[0] >= keys or most[1] >= values:
        raise ValueError("its tags name a key or a value that the layer has not")
    return feature.type, list(feature.geometry)


def _check_strokes(geometry: Sequence[int], kind: int) -> None:
    """Raise ValueError if the commands of points or lines violate the format."""
    place = 0
    while kind and place < len(geometry):
        command, count = geometry[place] & 7, geometry[place] >> 3
        allowed = (_MOVE,) if kind == POINT or not place else (_MOVE, _TO)
        if command not in allowed or not 0 < count <= (len(geometry) - place - 1) // 2:
            raise ValueError(f"command {command}, {count} times, does not fit in")
        place += 1 + 2 * count


def _rings(commands: list[int]) -> tuple[list[int], list[int]]:
    """Return the steps from point to point of a feature's rings, and the size of each ring."""
    kept: list[int] = []
    sizes, place = [], 0
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
        kept += commands[place + 1 : line] + commands[line + 1 : end]
        sizes.append(count + 1)
        place = end + 1
    return kept, sizes


def _grouped(
    steps: NDArray[np.int64],
    sizes: NDArray[np.int64],
    owners: NDArray[np.int64],
    dropped: list[Note],
) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Return polygons and their features, given the steps, sizes and features of all rings.

    A feature's steps begin at (0, 0) and continue from ring to ring.
    """
    if not len(sizes):
        return np.empty(0, object), owners
    starts = np.cumsum(sizes) - sizes
    zigzag = steps.reshape(-1, 2)  # 0, -1, 1, -2 as 0, 1, 2, 3
    points = ((zigzag >> 1) ^ -(zigzag & 1)).cumsum(axis=0)
    begins = starts[np.searchsorted(owners, owners)]  # of each ring's feature
    points -= np.repeat(np.vstack([[[0, 0]], points])[begins], sizes, axis=0)
    beyond = np.maximum.reduceat(np.abs(points).max(axis=1), starts) > _FURTHEST
    if beyond.any():
        far = np.isin(owners, owners[beyond])
        why = f"cannot be read: it has a coordinate beyond {_FURTHEST}"
        dropped += [(f"feature {owner}", why) for owner in np.unique(owners[far])]
        kept = np.repeat(~far, sizes)
        return _grouped(steps.reshape(-1, 2)[kept].ravel(), sizes[~far], owners[~far], dropped)
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
