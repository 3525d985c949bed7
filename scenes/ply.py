"""PLY (Stanford polygon format), text and binary: vertices and n-gon faces."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.scene import SceneError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One kind of item: how many there are, and name, type and type of count of each property."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


def parse(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.int64]]]:
    """(n, 3) vertices and, for each face, the indices of its vertices from 0.

    Raises SceneError for a file that is not PLY, is cut short, or holds no faces.
    """
    try:
        with path.open("rb") as stream:
            order, elements = _header(stream)
            data = _Text(stream.read()) if order == "" else _Binary(stream.read(), order)
        found = {element.name: _items(data, element) for element in elements}
        vertices = np.array([[item[k] for k in "xyz"] for item in found["vertex"]], dtype=float)
        faces = [_indices(item) for item in found["face"]]
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise SceneError(f"{path} is not a readable PLY file: {reason}") from error
    if not faces:
        raise SceneError(f"{path} holds no face: give a model with faces")
    return vertices.reshape(-1, 3), faces


def _header(stream: BufferedReader) -> tuple[str, list[_Element]]:
    if stream.readline(80).strip() != b"ply":
        raise ValueError("it does not begin with 'ply'")
    order = ""
    elements: list[_Element] = []
    for _ in range(1000):
        words = stream.readline(1000).decode("ascii").split()
        match words:
            case ["end_header"]:
                return order, elements
            case ["format", name, *_]:
                order = _ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append((name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name]:
                elements[-1].properties.append((name, _TYPES[kind], None))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"header line {' '.join(words)[:60]!r} is not known")
    raise ValueError("its header has no end")


def _items(data: _Text | _Binary, element: _Element) -> list[dict[str, Any]]:
    items = []
    for _ in range(element.count):
        item: dict[str, Any] = {}
        for name, kind, counter in element.properties:
            if counter is None:
                item[name] = data.take(kind, 1)[0]
            else:
                item[name] = data.take(kind, int(data.take(counter, 1)[0]))
        items.append(item)
        if not element.properties:
            raise ValueError(f"element {element.name} has no property")
    return items


def _indices(item: dict[str, Any]) -> NDArray[np.int64]:
    values = item["vertex_indices"] if "vertex_indices" in item else item["vertex_index"]
    return np.asarray(values, dtype=np.int64)


class _Text:
    """Numbers of a text file, one after another."""

    def __init__(self, data: bytes) -> None:
        self.words = data.split()
        self.at = 0

    def take(self, kind: str, count: int) -> list[float]:
        words = self.words[self.at : self.at + count]
        if count < 0 or len(words) < count:
            raise ValueError("it is cut short")
        self.at += count
        return [float(w) if kind[0] == "f" else int(w) for w in words]


class _Binary:
    """Numbers of a binary file, one after another."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order
        self.at = 0

    def take(self, kind: str, count: int) -> NDArray[Any]:
        size = int(kind[1])
        if count < 0 or self.at + count * size > len(self.data):
            raise ValueError("it is cut short")
        values = np.frombuffer(self.data, self.order + kind, count, self.at)
        self.at += count * size
        return values
