"""SVG drawings: paths and basic shapes, with their transforms and fill rules."""

import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from fontTools.misc.transform import Identity, Transform  # type: ignore[import-untyped]
from fontTools.pens.basePen import BasePen  # type: ignore[import-untyped]
from fontTools.pens.transformPen import TransformPen  # type: ignore[import-untyped]
from fontTools.svgLib.path import parse_path  # type: ignore[import-untyped]

from scenes.cleaning.fill import fill_contours
from scenes.readers.guard import noted
from scenes.readers.reader import Raw, Source
from scenes.scene import Note, SceneError

_SHAPES = ("path", "rect", "circle", "ellipse", "polygon", "polyline")
_HIDDEN = ("defs", "clipPath", "mask", "symbol", "pattern", "marker")
_UNREAD = {
    "use": "is a copy of another element, which is not followed: convert it to paths",
    "text": "is text, which is not read: convert it to paths",
    "image": "is an image, which is not read",
    "foreignObject": "is not SVG, and not read",
    "line": "is a line, which has no area",
}
_STYLED = (
    "rules of <style> are not read: shapes that they hide or leave unfilled are taken as filled"
)
_STEPS = 8
"""Chords that replace a curve."""


def read(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - a drawing is one chunk
    """Every filled shape of the drawing, y turned up, in the drawing's user units."""
    root = ElementTree.parse(source.path).getroot()
    if _tag(root) != "svg":
        raise SceneError(f"{source.path} is XML, but not SVG: its root is {_tag(root)}")
    geometries: list[Any] = []
    labels: list[str] = []
    identifiers: list[str] = []
    dropped: list[Note] = []
    for number, (element, transform, rule, unread) in enumerate(_shapes(root)):
        identifier = element.get("id") or ""
        label = f"{_tag(element)} {identifier or number}"
        if unread:
            dropped.append((label, unread))
            continue
        with noted(dropped, label, "cannot be read as SVG"):
            contours = _contours(element, transform)
            if not all(np.isfinite(contour).all() for contour in contours):
                raise ValueError("it has a NaN or infinite coordinate")
            area = fill_contours(contours, "evenodd" if rule == "evenodd" else "nonzero")
            geometries.append(area[0] if area else None)
            labels.append(label)
            identifiers.append(identifier)
    table = pd.DataFrame({"id": identifiers}, dtype=object)
    styled = any(_tag(element) == "style" for element in root.iter())
    yield Raw(geometries, labels, table, None, "px", dropped, notes=(_STYLED,) * styled)


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _shapes(
    root: ElementTree.Element,
) -> Iterator[tuple[ElementTree.Element, Transform, str, str | None]]:
    """What is drawn: each shape, the transform and the fill rule that reach it; why it is not read.

    Properties are those of attributes and `style`; fill, its rule and visibility are inherited.
    """
    inherited = {"fill-rule": "nonzero", "fill": "black", "visibility": "visible"}
    stack: list[tuple[ElementTree.Element, Transform, dict[str, str]]] = [
        (root, Identity, inherited)
    ]
    while stack:
        element, transform, inherited = stack.pop()
        kind = _tag(element)
        if kind in _HIDDEN:
            continue
        if own := element.get("transform"):
            transform = transform.transform(_transform(own))
        items = (item.partition(":") for item in element.get("style", "").split(";"))
        style = {key.strip(): value.removesuffix("!important").strip() for key, _, value in items}
        names = (*inherited, "display")
        given = {name: style.get(name) or element.get(name) or "inherit" for name in names}
        if inherited.get("display") == "none":
            del given["display"]  # nothing below it is displayed
        properties = inherited | {k: v for k, v in given.items() if v != "inherit"}
        if kind in _SHAPES:
            yield element, transform, properties["fill-rule"], _unfilled(properties)
        elif kind in _UNREAD:
            yield element, transform, "", _UNREAD[kind]
            continue
        # reversed, so that shapes come in the order of the file
        stack += [(child, transform, properties) for child in reversed(element)]


def _unfilled(properties: dict[str, str]) -> str | None:
    """Why a shape with these properties has no filled area; None where it has."""
    if properties.get("display") == "none":
        return "is not displayed"
    if properties["visibility"] in ("hidden", "collapse"):
        return "is not visible"
    return "has no fill" if properties["fill"] in ("none", "transparent") else None


class _Flattener(BasePen):  # type: ignore[misc]
    """Collects contours as points, curves cut into chords."""

    def __init__(self) -> None:
        super().__init__(None)
        self.contours: list[list[tuple[float, float]]] = []

    def _moveTo(self, pt: tuple[float, float]) -> None:  # noqa: N802 - the pen's protocol
        self.contours.append([pt])

    def _lineTo(self, pt: tuple[float, float]) -> None:  # noqa: N802
        self.contours[-1].append(pt)

    def _curveToOne(self, pt1: Any, pt2: Any, pt3: Any) -> None:  # noqa: N802
        t = np.linspace(0, 1, _STEPS + 1)[1:, None]
        a, b, c, d = map(np.array, (self.contours[-1][-1], pt1, pt2, pt3))
        points = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
        self.contours[-1].extend(map(tuple, points))


def _contours(element: ElementTree.Element, transform: Transform) -> list[Any]:
    pen = _Flattener()
    # SVG's y points down
    turned = TransformPen(pen, Transform(1, 0, 0, -1, 0, 0).transform(transform))
    if outline := _outline(element):
        parse_path(outline, turned)
    rings = [np.array(contour, dtype=float) for contour in pen.contours]
    rings = [r[:-1] if len(r) > 1 and (r[0] == r[-1]).all() else r for r in rings]
    return [ring for ring in rings if len(ring) >= 3]


def _outline(element: ElementTree.Element) -> str:
    """The shape as SVG path data."""
    kind = _tag(element)
    if kind == "path":
        return element.get("d", "")
    if kind in ("polygon", "polyline"):
        points = element.get("points", "").strip()
        return f"M {points} Z" if points else ""
    if kind == "rect":
        return _rectangle(element)
    cx, cy = _length(element, "cx"), _length(element, "cy")
    rx = _length(element, "r" if kind == "circle" else "rx")
    ry = rx if kind == "circle" else _length(element, "ry")
    half = f"a {rx!r} {ry!r} 0 1 1"
    return f"M {cx - rx!r} {cy!r} {half} {2 * rx!r} 0 {half} {-2 * rx!r} 0 Z" if rx * ry else ""


def _rectangle(element: ElementTree.Element) -> str:
    x, y, w, h = (_length(element, key) for key in ("x", "y", "width", "height"))
    rx, ry = _length(element, "rx"), _length(element, "ry")
    rx, ry = min(rx or ry, w / 2), min(ry or rx, h / 2)
    if not rx * ry:
        return f"M {x!r} {y!r} h {w!r} v {h!r} h {-w!r} Z"
    across, along, arc = w - 2 * rx, h - 2 * ry, f"a {rx!r} {ry!r} 0 0 1"
    return (
        f"M {x + rx!r} {y!r} h {across!r} {arc} {rx!r} {ry!r} v {along!r} {arc} {-rx!r} {ry!r} "
        f"h {-across!r} {arc} {-rx!r} {-ry!r} v {-along!r} {arc} {rx!r} {-ry!r} Z"
    )


def _length(element: ElementTree.Element, key: str) -> float:
    text = element.get(key, "0").strip()
    try:
        return float(text.removesuffix("px"))
    except ValueError:
        raise ValueError(f"{key}={text!r} is not a number or pixels") from None


def _transform(text: str) -> Transform:
    """The value of a transform attribute: a list of functions, the last applied first."""
    result = Identity
    for name, inner in re.findall(r"([A-Za-z]+)\s*\(([^)]*)\)", text):
        v = [float(number) for number in re.split(r"[\s,]+", inner.strip()) if number]
        if name == "matrix" and len(v) == 6:
            result = result.transform(v)
        elif name == "translate" and v:
            result = result.translate(*v[:2])
        elif name == "scale" and v:
            result = result.scale(v[0], v[-1])
        elif name == "rotate" and len(v) in (1, 3):
            cx, cy = v[1:] or (0.0, 0.0)
            result = result.translate(cx, cy).rotate(math.radians(v[0])).translate(-cx, -cy)
        elif name in ("skewX", "skewY") and len(v) == 1:
            angle = math.radians(v[0])
            result = result.skew(angle if name == "skewX" else 0.0, angle * (name == "skewY"))
        else:
            raise ValueError(f"transform {name}({inner}) is not known")
    return result
