"""Reader of the Mapbox Vector Tile format, version 2.1: the polygons of layers, unchanged.

Libraries for tiles repair or drop rings, and clip or project polygons. But a measurement needs
integer coordinates, and must count dropped polygons.

Holes are identified as in `classifyRings` of npm's @mapbox/vector-tile: a ring is outer if it has
the orientation of the feature's first ring with area, which also holds for tiles of version 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.guard import note_errors
from scenes.scene import Note
from scenes.spec import import_optional

POINT, LINE, POLYGON = 1, 2, 3  # types of features; 0 is unknown
_MOVE, _TO, _CLOSE = 1, 2, 7  # commands MoveTo, LineTo and ClosePath of a geometry
MAX_COORDINATE = 2**24  # for which areas are exact in 64 bits


@cache
def _import_protobuf(module: str) -> Any:
    return import_optional(f"google.protobuf.{module}", "vector tiles", "tiles")


@cache
def _make_message_classes() -> dict[str, Any]:
    """Return protobuf's classes of the messages of a tile: Tile, Layer and Feature.

    Nested messages are declared as bytes and decoded separately, so that an invalid layer or
    feature does not affect others. A layer's name is bytes, because it may be invalid UTF-8.
    """
    descriptor = _import_protobuf("descriptor_pb2")
    file = descriptor.FileDescriptorProto(name="vector_tile.proto", package="raster_harness")
    types = descriptor.FieldDescriptorProto
    bytes_, number = types.TYPE_BYTES, types.TYPE_UINT32
    optional, repeated = types.LABEL_OPTIONAL, types.LABEL_REPEATED
    for name, fields in {
        "Tile": (("layers", 3, repeated, bytes_),),
        "Layer": (
            ("name", 1, optional, bytes_),
            ("features", 2, repeated, bytes_),
            ("keys", 3, repeated, bytes_),
            ("values", 4, repeated, bytes_),
            ("extent", 5, optional, number),
            ("version", 15, optional, number),
        ),
        "Feature": (
            ("tags", 2, repeated, number),
            ("type", 3, optional, number),
            ("geometry", 4, repeated, number),
        ),
    }.items():
        message = file.message_type.add(name=name)
        for field, tag, label, kind in fields:
            message.field.add(name=field, number=tag, label=label, type=kind)
    pool = _import_protobuf("descriptor_pool").DescriptorPool()
    pool.Add(file)
    create_class = _import_protobuf("message_factory").GetMessageClass
    return {
        message.name: create_class(pool.FindMessageTypeByName(f"raster_harness.{message.name}"))
        for message in file.message_type
    }


def _decode_message(kind: str, data: bytes) -> Any:
    """Return the message of class `kind` in `data`; raises ValueError if the data are invalid.

    A known field with a wrong wire type is invalid, too: protobuf would silently skip its polygons.
    """
    message_class = _make_message_classes()[kind]
    try:
        message = message_class.FromString(data)
    except Exception as error:  # protobuf's exceptions differ between versions
        raise ValueError("not a vector tile, or truncated") from error
    fields = message_class.DESCRIPTOR.fields_by_number
    for field in _import_protobuf("unknown_fields").UnknownFieldSet(message):
        if field.field_number in fields:
            raise ValueError(f"field {field.field_number} has wire type {field.wire_type}")
    return message


@dataclass(frozen=True)
class Layer:
    """A layer's polygons in integer units, y down; in px, y up, after `read.select_drawable`.

    extent : number of units along the tile's side
    polygons : (p,) shapely polygons, valid or not
    feature : (p,) index of the feature of each polygon
    dropped, repaired : (feature, reason) of dropped features, and of repaired polygons
    """

    name: str
    extent: int
    polygons: NDArray[np.object_]
    feature: NDArray[np.int64]
    dropped: list[Note]
    repaired: list[Note]


def decode_layers(tile: bytes) -> dict[str, list[Any]]:
    """Return the messages of the layers of an uncompressed tile, by layer name.

    In a valid tile each name has one message. An invalid layer is a ValueError, under the name "".
    """
    layers: dict[str, list[Any]] = {}
    for data in _decode_message("Tile", tile).layers:
        try:
            layer = _decode_message("Layer", data)
            name = layer.name.decode()
        except ValueError as error:
            layer, name = error, ""
        layers.setdefault(name, []).append(layer)
    return layers


def build_layer(name: str, messages: list[Any]) -> Layer:
    """Return a layer, given the messages that `decode_layers` returned for its name."""
    if isinstance(messages[0], ValueError):
        raise messages[0]
    if not name:
        raise ValueError("a layer has no name")
    if len(messages) > 1:
        raise ValueError(f"layer {name} occurs twice")
    layer = messages[0]
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
            kind, geometry = _parse_feature(feature, len(layer.keys), len(layer.values))
            if kind != POLYGON:
                _check_points_or_lines(geometry, kind)
                continue
            ring_steps, rings = _parse_rings(geometry)
            steps += ring_steps
            sizes += rings
            owners += [number] * len(rings)
    arrays = np.array(steps, np.int64), np.array(sizes, np.int64), np.array(owners, np.int64)
    return Layer(name, extent, *_build_polygons(*arrays, dropped), dropped, [])


def _parse_feature(data: bytes, keys: int, values: int) -> tuple[int, list[int]]:
    """Return the geometry type of a feature of a layer with these numbers of keys and values."""
    feature = _decode_message("Feature", data)
    if not feature.HasField("type") or not feature.geometry:
        raise ValueError(f"no {'geometry' if feature.HasField('type') else 'type'}")
    if feature.type > POLYGON:
        raise ValueError(f"type {feature.type} is not 0 to 3")
    tags = list(feature.tags)
    max_tags = max(tags[::2], default=-1), max(tags[1::2], default=-1)
    if len(tags) % 2 or max_tags[0] >= keys or max_tags[1] >= values:
        raise ValueError("a tag names an undefined key or value")
    return feature.type, list(feature.geometry)


def _check_points_or_lines(geometry: Sequence[int], kind: int) -> None:
    """Raise ValueError if the commands of points or lines violate the format."""
    position = 0
    while kind and position < len(geometry):
        command, count = geometry[position] & 7, geometry[position] >> 3
        allowed = (_MOVE,) if kind == POINT or not position else (_MOVE, _TO)
        if command not in allowed or not 0 < count <= (len(geometry) - position - 1) // 2:
            raise ValueError(f"command {command} with count {count} is invalid")
        position += 1 + 2 * count


def _parse_rings(commands: list[int]) -> tuple[list[int], list[int]]:
    """Return the steps, x and y in zigzag encoding, and the size in points of each ring."""
    steps: list[int] = []
    sizes, position = [], 0
    while position < len(commands):
        if commands[position] != (1 << 3 | _MOVE):
            raise ValueError("a ring does not begin with one MoveTo")
        line_to = position + 3
        count = commands[line_to] >> 3 if line_to < len(commands) else 0
        end = line_to + 1 + 2 * count
        if not count or commands[line_to] & 7 != _TO or end >= len(commands):
            raise ValueError("a ring has no LineTo, or too few points")
        if commands[end] != (1 << 3 | _CLOSE):
            raise ValueError("a ring does not end with one ClosePath")
        steps += commands[position + 1 : line_to] + commands[line_to + 1 : end]
        sizes.append(count + 1)
        position = end + 1
    return steps, sizes


def _build_polygons(
    steps: NDArray[np.int64],
    sizes: NDArray[np.int64],
    owners: NDArray[np.int64],
    dropped: list[Note],
) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Return the polygons (p,) of a layer, and the index (p,) of the feature of each polygon.

    sizes (r,): number of points of each ring; owners (r,): index of each ring's feature. The first
    step of a feature is from (0, 0), of each further ring from the last point of the ring before.
    """
    if not len(sizes):
        return np.empty(0, object), owners
    starts = np.cumsum(sizes) - sizes
    zigzag = steps.reshape(-1, 2)  # zigzag encoding: 0, 1, 2, 3 stand for 0, -1, 1, -2
    points = ((zigzag >> 1) ^ -(zigzag & 1)).cumsum(axis=0)
    begins = starts[np.searchsorted(owners, owners)]  # first point of each ring's feature
    points -= np.repeat(np.vstack([[[0, 0]], points])[begins], sizes, axis=0)
    is_beyond = np.maximum.reduceat(np.abs(points).max(axis=1), starts) > MAX_COORDINATE
    if is_beyond.any():
        is_dropped = np.isin(owners, owners[is_beyond])
        reason = f"cannot be read: a coordinate exceeds {MAX_COORDINATE}"
        dropped += [(f"feature {owner}", reason) for owner in np.unique(owners[is_dropped])]
        is_kept = np.repeat(~is_dropped, sizes)
        steps = steps.reshape(-1, 2)[is_kept].ravel()
        return _build_polygons(steps, sizes[~is_dropped], owners[~is_dropped], dropped)
    following = np.arange(1, len(points) + 1)
    following[starts + sizes - 1] = starts
    x, y = points.T
    sign = np.sign(np.add.reduceat(x * y[following] - x[following] * y, starts))
    dropped += [(f"feature {owner}", "has a ring without area") for owner in owners[sign == 0]]
    with_area = np.flatnonzero(sign)
    owners, sign = owners[with_area], sign[with_area]
    first = np.searchsorted(owners, owners)  # index of the first ring of each ring's feature
    outer = np.flatnonzero(sign == sign[first])
    rings = [points[starts[k] : starts[k] + sizes[k]] for k in with_area]
    closed = [part for ring in rings for part in (ring, ring[:1])]
    ends = np.concatenate([[0], np.cumsum(sizes[with_area] + 1)])
    polygons = shapely.from_ragged_array(
        shapely.GeometryType.POLYGON,
        np.concatenate([np.empty((0, 2), np.int64), *closed]).astype(float),
        (ends, np.append(outer, len(with_area))),
    )
    return polygons, owners[outer]
