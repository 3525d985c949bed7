"""Outlines of SVG's basic shapes and paths, and its lengths and transforms."""

import math
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
from fontTools.misc.transform import Identity, Transform  # type: ignore[import-untyped]
from fontTools.pens.basePen import BasePen  # type: ignore[import-untyped]
from fontTools.pens.transformPen import TransformPen  # type: ignore[import-untyped]
from fontTools.svgLib.path import parse_path  # type: ignore[import-untyped]
from numpy.typing import NDArray

SHAPES = ("path", "rect", "circle", "ellipse", "polygon", "polyline")
FLIP = Transform(1, 0, 0, -1, 0, 0)  # from SVG's axes, with y down, to those of scenes
_CHORDS = 8  # chords that replace a cubic curve
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FUNCTION = re.compile(r"\s*,?\s*([A-Za-z0-9]+)\s*\(([^()]*)\)")
_ARGUMENT = re.compile(rf"\s*,?\s*({_NUMBER})(px|deg|rad|grad|turn)?")
_PIXELS = {"px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "pt": 96 / 72, "pc": 16.0}
_DEGREES = {"rad": 180 / math.pi, "grad": 0.9, "turn": 360.0}
_ORIGINS = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}

Viewport = tuple[float, float] | None  # size for percentages; None if unknown


def get_tag(element: ElementTree.Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def parse_length(text: str, viewport: Viewport, axis: int | None = None) -> float:
    """Return a length in user units; raises ValueError for an unsupported or unknown unit.

    axis : 0 for a percentage of the viewport's width, 1 of the height, None of the diagonal

    >>> parse_length("1in", None), parse_length("50%", (10, 20), 1)
    (96.0, 10.0)
    """
    match = re.fullmatch(rf"\s*({_NUMBER})\s*([a-z]+|%)?\s*", text)
    unit = match[2] if match else None
    if match and (unit is None or unit in _PIXELS):
        return float(match[1]) * _PIXELS.get(unit or "px", 1.0)
    if match is None or unit != "%" or viewport is None:
        raise ValueError(f"length {text.strip()!r} is not a number in an absolute unit: use px")
    extent = math.hypot(*viewport) / math.sqrt(2) if axis is None else viewport[axis]
    return float(match[1]) / 100 * extent


def parse_transform(text: str, *, is_css: bool = False) -> Transform:
    """Return the matrix of a list of transform functions, as of the SVG attribute or of CSS.

    >>> parse_transform("translate(2px, 0) scale(3)").transformPoint((1, 1))
    (5.0, 3.0)
    """
    result, end = Identity, 0
    if text.strip() == "none":
        return result
    while text[end:].strip(" \t\r\n,"):
        match = _FUNCTION.match(text, end)
        if match is None:
            raise ValueError(f"transform {text.strip()[:40]!r} is unknown")
        result, end = result.transform(_parse_matrix(match[1], match[2], is_css)), match.end()
    return result


_FUNCTIONS: dict[str, tuple[tuple[int, ...], Callable[..., Transform]]] = {
    "matrix": ((6,), Transform),
    "translate": ((1, 2), Identity.translate),
    "scale": ((1, 2), lambda x, y=None: Identity.scale(x, x if y is None else y)),
    "rotate": (
        (1, 3),
        lambda angle, x=0.0, y=0.0: (
            Identity.translate(x, y).rotate(math.radians(angle)).translate(-x, -y)
        ),
    ),
    "skewX": ((1,), lambda angle: Identity.skew(math.radians(angle), 0.0)),
    "skewY": ((1,), lambda angle: Identity.skew(0.0, math.radians(angle))),
}
_CSS_FUNCTIONS = _FUNCTIONS | {
    "translateX": ((1,), lambda x: Identity.translate(x, 0.0)),
    "translateY": ((1,), lambda y: Identity.translate(0.0, y)),
    "scaleX": ((1,), lambda x: Identity.scale(x, 1.0)),
    "scaleY": ((1,), lambda y: Identity.scale(1.0, y)),
}
"""Transform functions of CSS: permitted numbers of arguments, and the function of the matrix."""


def _parse_matrix(name: str, inner: str, is_css: bool) -> Transform:
    arguments = list(_ARGUMENT.finditer(inner))
    values = [float(match[1]) * _DEGREES.get(match[2], 1.0) for match in arguments]
    counts, function = (_CSS_FUNCTIONS if is_css else _FUNCTIONS).get(name, ((), Transform))
    is_complete = "".join(match[0] for match in arguments).strip() == inner.strip()
    if not is_complete or len(values) not in counts:
        raise ValueError(f"transform {name}({inner.strip()}) is unknown")
    return function(*values)


def transform_about(matrix: Transform, origin: str, viewport: Viewport) -> Transform:
    """Return a matrix that applies `matrix` about `origin`, such as "50% 20px" or "top left"."""
    words = [*origin.split(), "center"][:2]
    if words[0] in ("top", "bottom") or words[1] in ("left", "right"):
        words.reverse()
    x, y = (parse_length(_ORIGINS.get(w, w), viewport, axis) for axis, w in enumerate(words))
    return Identity.translate(x, y).transform(matrix).translate(-x, -y)


class _Flattener(BasePen):  # type: ignore[misc]
    """A pen of fontTools that stores contours as points, with curves replaced by chords."""

    def __init__(self) -> None:
        super().__init__(None)
        self.contours: list[list[tuple[float, float]]] = []

    def _moveTo(self, pt: tuple[float, float]) -> None:  # noqa: N802 - the pen's protocol
        self.contours.append([pt])

    def _lineTo(self, pt: tuple[float, float]) -> None:  # noqa: N802
        self.contours[-1].append(pt)

    def _curveToOne(self, pt1: Any, pt2: Any, pt3: Any) -> None:  # noqa: N802
        t = np.linspace(0, 1, _CHORDS + 1)[1:, None]
        a, b, c, d = map(np.array, (self.contours[-1][-1], pt1, pt2, pt3))
        points = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
        self.contours[-1].extend(map(tuple, points))


def flatten_outline(outline: str, matrix: Transform) -> list[NDArray[np.float64]]:
    """Return the contours (n, 2), without closing points, of SVG path data after `matrix`."""
    pen = _Flattener()
    if outline:
        parse_path(outline, TransformPen(pen, matrix))
    rings = [np.array(contour, dtype=float) for contour in pen.contours]
    rings = [r[:-1] if len(r) > 1 and (r[0] == r[-1]).all() else r for r in rings]
    rings = [ring for ring in rings if len(ring) >= 3]
    if not all(np.isfinite(ring).all() for ring in rings):
        raise ValueError("NaN or infinite coordinate")
    return rings


def format_outline(element: ElementTree.Element, style: dict[str, str], viewport: Viewport) -> str:
    """Return the outline of a shape as SVG path data; style : CSS properties of the element."""
    kind = get_tag(element)
    if kind == "path":
        return element.get("d", "")
    if kind in ("polygon", "polyline"):
        points = element.get("points", "").strip()
        numbers = [match.start() for match in re.finditer(_NUMBER, points)]
        if len(numbers) % 2:
            points = points[: numbers[-1]]  # an x without y is ignored
        return f"M {points} Z" if points else ""

    def length(key: str, axis: int | None) -> float | None:
        """Return the length of a property; None if absent or "auto", or if a radius is negative."""
        text = style.get(key) or element.get(key) or "auto"
        value = None if text.strip() == "auto" else parse_length(text, viewport, axis)
        return None if value is not None and value < 0 and key in ("r", "rx", "ry") else value

    if kind == "rect":
        return _make_rectangle(length)
    cx, cy = length("cx", 0) or 0.0, length("cy", 1) or 0.0
    if kind == "circle":
        rx = ry = length("r", None) or 0.0
    else:
        rx, ry = _read_radii(length)
    half = f"a {rx!r} {ry!r} 0 1 1"
    return f"M {cx - rx!r} {cy!r} {half} {2 * rx!r} 0 {half} {-2 * rx!r} 0 Z" if rx * ry else ""


def _read_radii(length: Callable[[str, int | None], float | None]) -> tuple[float, float]:
    """Return the radii along x and y of a shape; an absent radius equals the other."""
    rx, ry = length("rx", 0), length("ry", 1)
    return (rx if rx is not None else ry) or 0.0, (ry if ry is not None else rx) or 0.0


def _make_rectangle(length: Callable[[str, int | None], float | None]) -> str:
    """Return a rectangle, possibly with rounded corners, as SVG path data; "" if empty."""
    x, y, w, h = (length(k, i % 2) or 0.0 for i, k in enumerate(("x", "y", "width", "height")))
    if w <= 0 or h <= 0:
        return ""
    rx, ry = _read_radii(length)
    rx, ry = min(rx, w / 2), min(ry, h / 2)
    if not rx * ry:
        return f"M {x!r} {y!r} h {w!r} v {h!r} h {-w!r} Z"
    dx, dy, arc = w - 2 * rx, h - 2 * ry, f"a {rx!r} {ry!r} 0 0 1"
    return (
        f"M {x + rx!r} {y!r} h {dx!r} {arc} {rx!r} {ry!r} v {dy!r} {arc} {-rx!r} {ry!r} "
        f"h {-dx!r} {arc} {-rx!r} {-ry!r} v {-dy!r} {arc} {rx!r} {-ry!r} Z"
    )
