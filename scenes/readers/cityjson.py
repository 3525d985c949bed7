"""Reader of CityJSON: roof and ground surfaces of city models, seen from above."""

import json
import re
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from scenes.readers.guard import check_last_line, note_errors, raise_scene_errors
from scenes.readers.reader import RawChunk, Source
from scenes.scene import Note, SceneError

_KINDS = ("RoofSurface", "GroundSurface")
# Nesting depth of the surfaces in the `boundaries` of each type of geometry.
_DEPTHS = {
    **dict.fromkeys(("MultiSurface", "CompositeSurface"), 0),
    "Solid": 1,
    **dict.fromkeys(("MultiSolid", "CompositeSolid"), 2),
}
_INSTANCE = "has an instance of a template, which is unsupported: replace it by the geometry"
_PLAN = "surfaces seen from above, with the height as an attribute"


def read(source: Source, size: int) -> Iterator[RawChunk]:  # noqa: ARG001 - a model is one chunk
    """Yield the most detailed surfaces of all city objects, as polygons seen from above.

    `source.layer` is RoofSurface or GroundSurface; both are read by default.
    """
    model = _parse_model(str(source.path), source.path.read_bytes)
    surfaces = _Surfaces(source)
    surfaces.add(dict(model["CityObjects"]), _read_vertices(model, model))
    yield surfaces.make_raw(_find_crs(model))


def read_sequence(source: Source, size: int) -> Iterator[RawChunk]:
    """Yield the surfaces of a text sequence: a CityJSON object, then a CityJSONFeature per line."""
    check_last_line(source.path, json.loads)
    surfaces = _Surfaces(source)
    with source.path.open("rb") as lines:
        head = _parse_model(f"{source.path}, line 1", lambda: next(lines, b""))
        crs = _find_crs(head)
        for number, line in enumerate(lines, start=2):
            if not line.strip():
                continue
            with note_errors(surfaces.dropped, f"line {number}", "is invalid"):
                feature = json.loads(line)
                if feature["type"] != "CityJSONFeature":
                    raise ValueError(f"type {feature['type']} is not CityJSONFeature")
                surfaces.add(dict(feature["CityObjects"]), _read_vertices(feature, head))
            if number % size == 0:
                yield surfaces.make_raw(crs)
                surfaces = _Surfaces(source)
    yield surfaces.make_raw(crs)


class _Surfaces:
    """Surfaces of city objects, collected by `add` and returned by `make_raw`."""

    def __init__(self, source: Source) -> None:
        if source.layer not in (None, *_KINDS):
            raise SceneError(
                f"{source.path} has no layer {source.layer!r}; give {' or '.join(_KINDS)}"
            )
        self._kinds = _KINDS if source.layer is None else (source.layer,)
        self.dropped: list[Note] = []
        self._geometries: list[Any] = []
        self._labels: list[str] = []
        self._rows: list[tuple[Any, ...]] = []

    def add(self, objects: dict[str, Any], vertices: NDArray[np.float64]) -> None:
        """Collect the surfaces of city objects, by identifier, that share vertices (n, 3)."""
        for identifier, city_object in objects.items():
            with note_errors(self.dropped, str(identifier), "is an invalid city object"):
                geometry_types = [g["type"] for g in city_object.get("geometry", [])]
                if "GeometryInstance" in geometry_types:
                    self.dropped.append((str(identifier), _INSTANCE))
                for number, (kind, polygon, height) in enumerate(
                    _read_surfaces(city_object, vertices)
                ):
                    if kind in self._kinds:
                        self._geometries.append(polygon)
                        self._labels.append(f"{identifier} surface {number}")
                        self._rows.append((identifier, city_object.get("type"), kind, height))

    def make_raw(self, crs: str | None) -> RawChunk:
        """Return the collected surfaces as a chunk."""
        table = pd.DataFrame(self._rows, columns=["id", "type", "surface", "height"])
        return RawChunk(
            self._geometries, self._labels, table, crs, "m", self.dropped, notes=(_PLAN,)
        )


def _parse_model(name: str, content: Callable[[], bytes]) -> dict[str, Any]:
    """Return a CityJSON model; content : function that reads the text; name : for messages."""
    with raise_scene_errors(name, "JSON"):
        model = json.loads(content())
    if not isinstance(model, dict) or model.get("type") != "CityJSON":
        raise SceneError(f"{name} is JSON, but not of type CityJSON: give a CityJSON file")
    return model


def _find_crs(model: dict[str, Any]) -> str | None:
    metadata = model.get("metadata")
    name = metadata.get("referenceSystem") if isinstance(metadata, dict) else None
    # Of a compound system, the first code is that of the horizontal system.
    code = re.search(r"([A-Z]+)(?:[:/][^:/]*)?[:/](\d+)", str(name))
    return f"{code[1]}:{code[2]}" if code else None


def _read_vertices(model: dict[str, Any], source: dict[str, Any]) -> NDArray[np.float64]:
    """Return a model's vertices (n, 3), scaled and translated by the `transform` of `source`."""
    vertices = np.array(model["vertices"], dtype=float).reshape(-1, 3)
    if "transform" in source:
        transform = source["transform"]
        vertices = vertices * np.array(transform["scale"], dtype=float) + transform["translate"]
    return vertices


def _read_surfaces(
    city_object: dict[str, Any], vertices: NDArray[np.float64]
) -> Iterator[tuple[str | None, shapely.Polygon, float]]:
    """Yield kind, polygon seen from above and mean height of each surface of a city object."""
    shapes = [
        g for g in city_object.get("geometry", []) if "boundaries" in g and g["type"] in _DEPTHS
    ]
    if not shapes:
        return
    shape = max(shapes, key=lambda g: str(g.get("lod", "")))
    depth = _DEPTHS[shape["type"]]
    semantics = shape.get("semantics") or {}
    kinds = [s.get("type") for s in semantics.get("surfaces") or []]
    surfaces = list(shape["boundaries"])
    for _ in range(depth):  # from solids to shells, from shells to surfaces
        surfaces = list(chain.from_iterable(surfaces))
    values = _flatten_values(semantics.get("values"), shape["boundaries"], depth)
    for rings, value in zip(surfaces, values, strict=True):
        numbers = [np.array(ring, dtype=np.int64) for ring in rings]
        if any(len(n) < 3 or n.min() < 0 or n.max() >= len(vertices) for n in numbers):
            raise ValueError("a ring has fewer than 3 vertices, or a missing vertex")
        points = [vertices[ring] for ring in numbers]
        if value is None:  # by the sign of the normal's height, by Newell's method
            ring, following = points[0], np.roll(points[0], -1, axis=0)
            up = np.sum((ring[:, 0] - following[:, 0]) * (ring[:, 1] + following[:, 1]))
            kind = "RoofSurface" if up > 0 else "GroundSurface"
        else:
            kind = kinds[value]
        plan = shapely.Polygon(points[0][:, :2], [hole[:, :2] for hole in points[1:]])
        yield kind, plan, float(points[0][:, 2].mean())


def _flatten_values(values: Any, boundaries: Any, depth: int) -> list[int | None]:
    """Return, for each surface, the index of its semantics, or None.

    values, boundaries : nested lists, `depth` levels deep; null applies to all surfaces of a shell
    """
    padded = [*(values or []), *[None] * len(boundaries)][: len(boundaries)]
    if depth == 0:
        return padded
    parts = zip(padded, boundaries, strict=True)
    return [value for inner, outer in parts for value in _flatten_values(inner, outer, depth - 1)]
