"""CityJSON: roof and ground surfaces of city models, seen from above."""

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from scenes.readers.guard import clear_errors, noted, refuse_unended
from scenes.readers.reader import Raw, Source
from scenes.scene import Note, SceneError

_WANTED = ("RoofSurface", "GroundSurface")
_PLAN = "surfaces seen from above, with their height as an attribute"


def read(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - a model is one chunk
    """Surfaces of all city objects, as polygons in plan.

    `layer` is RoofSurface or GroundSurface; both are read by default. Where a model has no
    semantics, a surface that faces up is a roof and one that faces down is ground. Of an object
    with several levels of detail the highest is taken. The table has the object's identifier and
    type, the kind of surface, and its height.
    """
    model = _model(str(source.path), source.path.read_bytes)
    found = _Surfaces(source)
    found.add(dict(model["CityObjects"]), _vertices(model, model))
    yield found.raw(_crs(model))


def read_sequence(source: Source, size: int) -> Iterator[Raw]:
    """A text sequence: a CityJSON object for all, then a line for each CityJSONFeature.

    As `read`, `size` features at a time.
    """
    refuse_unended(source.path, json.loads)
    found = _Surfaces(source)
    with source.path.open("rb") as lines:
        head = _model(f"{source.path}, line 1", lambda: next(lines, b""))
        crs = _crs(head)
        for number, line in enumerate(lines, start=2):
            if not line.strip():
                continue
            with noted(found.dropped, f"line {number}", "is not sound"):
                feature = json.loads(line)
                if feature["type"] != "CityJSONFeature":
                    raise ValueError(f"its type is {feature['type']}, not CityJSONFeature")
                found.add(dict(feature["CityObjects"]), _vertices(feature, head))
            if number % size == 0:
                yield found.raw(crs)
                found = _Surfaces(source)
    yield found.raw(crs)


class _Surfaces:
    """The wanted surfaces of city objects, gathered."""

    def __init__(self, source: Source) -> None:
        if source.layer not in (None, *_WANTED):
            raise SceneError(
                f"{source.path} has no layer {source.layer!r}; give {' or '.join(_WANTED)}"
            )
        self._wanted = _WANTED if source.layer is None else (source.layer,)
        self.dropped: list[Note] = []
        self._geometries: list[Any] = []
        self._labels: list[str] = []
        self._rows: list[dict[str, Any]] = []

    def add(self, objects: dict[str, Any], vertices: NDArray[np.float64]) -> None:
        """Take in the surfaces of objects that share vertices."""
        for identifier, thing in objects.items():
            with noted(self.dropped, str(identifier), "is not a sound city object"):
                for number, (kind, polygon, height) in enumerate(_surfaces(thing, vertices)):
                    if kind in self._wanted:
                        self._geometries.append(polygon)
                        self._labels.append(f"{identifier} surface {number}")
                        kinds = {"id": identifier, "type": thing.get("type"), "surface": kind}
                        self._rows.append({**kinds, "height": height})

    def raw(self, crs: str | None) -> Raw:
        """What was gathered, as a reader yields it."""
        table = pd.DataFrame(self._rows, columns=["id", "type", "surface", "height"])
        return Raw(self._geometries, self._labels, table, crs, "m", self.dropped, notes=(_PLAN,))


def _model(name: str, content: Callable[[], bytes]) -> dict[str, Any]:
    with clear_errors(name, "JSON"):
        model = json.loads(content())
    if not isinstance(model, dict) or model.get("type") != "CityJSON":
        raise SceneError(f"{name} is JSON, but its type is not CityJSON")
    return model


def _crs(model: dict[str, Any]) -> str | None:
    metadata = model.get("metadata")
    name = metadata.get("referenceSystem") if isinstance(metadata, dict) else None
    code = str(name).replace("::", ":").replace("/", ":").rpartition(":")[2]
    return f"EPSG:{code}" if code.isdigit() else None


def _vertices(model: dict[str, Any], about: dict[str, Any]) -> NDArray[np.float64]:
    """(n, 3), as `about`, the model or the head of its sequence, scales and moves them."""
    vertices = np.array(model["vertices"], dtype=float).reshape(-1, 3)
    if "transform" in about:
        transform = about["transform"]
        vertices = vertices * np.array(transform["scale"], dtype=float) + transform["translate"]
    return vertices


def _surfaces(
    thing: dict[str, Any], vertices: NDArray[np.float64]
) -> Iterator[tuple[str | None, shapely.Polygon, float]]:
    """Kind, plan and mean height of each surface of a city object's most detailed geometry."""
    shapes = [g for g in thing.get("geometry", []) if "boundaries" in g]
    if not shapes:
        return
    shape = max(shapes, key=lambda g: str(g.get("lod", "")))
    depth = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1}.get(shape["type"])
    depth = 2 if depth is None and "Solid" in shape["type"] else depth
    if depth is None:
        return
    semantics = shape.get("semantics") or {}
    kinds = [s.get("type") for s in semantics.get("surfaces", [])]
    values = _flat(semantics.get("values"), depth)
    for number, rings in enumerate(_flat(shape["boundaries"], depth)):
        points = [vertices[_indices(ring, len(vertices))] for ring in rings]
        known = number < len(values) and values[number] is not None
        kind = kinds[values[number]] if known else None
        if not kinds:
            kind = _by_slope(points[0])
        plan = shapely.Polygon(points[0][:, :2], [hole[:, :2] for hole in points[1:]])
        yield kind, plan, float(points[0][:, 2].mean())


def _indices(ring: Any, count: int) -> NDArray[np.int64]:
    indices = np.array(ring, dtype=np.int64)
    if len(indices) < 3 or indices.min() < 0 or indices.max() >= count:
        raise ValueError("a ring has fewer than 3 vertices, or one that does not exist")
    return indices


def _flat(nested: Any, depth: int) -> list[Any]:
    """The surfaces of shells (depth 1) of solids (depth 2), in one list."""
    for _ in range(depth):
        nested = [inner for outer in nested or [] for inner in outer or []]
    return list(nested or [])


def _by_slope(ring: NDArray[np.float64]) -> str:
    """Roof or ground by the direction of the normal's vertical part, by Newell's method."""
    after = np.roll(ring, -1, axis=0)
    up = np.sum((ring[:, 0] - after[:, 0]) * (ring[:, 1] + after[:, 1]))
    return "RoofSurface" if up > 0 else "GroundSurface"
