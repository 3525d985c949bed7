"""Reader of SVG drawings: the visible areas of filled paths and basic shapes."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import shapely
from fontTools.misc.transform import Identity, Transform  # type: ignore[import-untyped]

from scenes.fill import fill_contours
from scenes.readers.guard import note_errors
from scenes.readers.reader import RawChunk, Source
from scenes.readers.svg_shapes import (
    FLIP,
    SHAPES,
    Viewport,
    flatten_outline,
    format_outline,
    get_tag,
    parse_length,
    parse_transform,
    transform_about,
)
from scenes.scene import Note, SceneError

_NAMESPACE = "http://www.w3.org/2000/svg"
_CONTAINERS = ("svg", "g", "a", "switch")
_OMITTED = {
    "use": "is a reference to another element, which is unsupported: convert it to paths",
    "text": "is text, which is unsupported: convert it to paths",
    "flowRoot": "is text, which is unsupported: convert it to paths",
    "image": "is an image, which is unsupported",
    "foreignObject": "is not SVG",
    "line": "is a line, which has no area",
}
_STYLED = "<style> is ignored: shapes that it hides or leaves unfilled are taken as filled"
_MASKED = "masks are ignored: masked shapes are read completely"
_EMPTY, _CLIPPED = "has no area", "lies outside the clip path, or has no area"
_FLIPPED = "y points up: the drawing's y is negated"
_INHERITED = {
    "fill": "black",
    "fill-rule": "nonzero",
    "clip-rule": "nonzero",
    "fill-opacity": "1",
    "color": "black",
    "visibility": "visible",
}
_LOCAL = ("display", "opacity", "clip-path", "mask", "overflow", "transform", "transform-origin")
"""CSS properties that children do not inherit."""


@dataclass(frozen=True)
class _State:
    """State in which the content of an element is drawn.

    matrix : transform from the element's user space to the drawing's
    viewport : size to which percentages refer, or None if unknown
    clip : area of the clip path, y up, or None without a clip path
    hidden : why the content is not drawn, or ""
    """

    matrix: Transform
    properties: dict[str, str]
    viewport: Viewport
    clip: Any = None
    hidden: str = ""


def read(source: Source, size: int) -> Iterator[RawChunk]:  # noqa: ARG001 - a drawing is one chunk
    """Yield every filled shape of the drawing, y up, in the drawing's user units."""
    root = ElementTree.parse(source.path).getroot()
    if get_tag(root) != "svg":
        raise SceneError(f"{source.path} is XML, but not SVG: its root is {get_tag(root)}")
    yield _Drawing(root).read()


class _Drawing:
    """An SVG document, with notes on the shapes that `read` drops."""

    def __init__(self, root: ElementTree.Element) -> None:
        self._root = root
        self._by_id = {e.get("id"): e for e in reversed(list(root.iter())) if e.get("id")}
        self._has_masks = False
        self.dropped: list[Note] = []

    def read(self) -> RawChunk:
        """Return all filled shapes, in the order of the file."""
        geometries: list[Any] = []
        labels: list[str] = []
        identifiers: list[str] = []
        stack = [(self._root, _State(Identity, _INHERITED, None))]
        number = 0
        while stack:
            element, state = stack.pop()
            kind = get_tag(element)
            if not self._is_drawn(element):
                continue
            label = f"{kind} {element.get('id') or number}"
            number += kind not in _CONTAINERS
            with note_errors(self.dropped, label, "cannot be read as SVG"):
                state, style = self._enter_element(element, state)
                if kind in _CONTAINERS:
                    children = list(element)
                    if kind == "switch":
                        children = [child for child in children if self._is_drawn(child)][:1]
                    stack += [(child, state) for child in reversed(children)]
                elif (
                    reason := _OMITTED.get(kind) or state.hidden or _check_fill(state, self._by_id)
                ):
                    self.dropped.append((label, reason))
                elif (region := self._find_region(element, state, style, "fill-rule")) is None:
                    self.dropped.append((label, _EMPTY if state.clip is None else _CLIPPED))
                else:
                    geometries.append(region)
                    labels.append(label)
                    identifiers.append(element.get("id") or "")
        table = pd.DataFrame({"id": identifiers}, dtype=object)
        is_styled = any(get_tag(element) == "style" for element in self._root.iter())
        notes = (_FLIPPED,) + (_STYLED,) * is_styled + (_MASKED,) * self._has_masks
        return RawChunk(geometries, labels, table, None, "px", self.dropped, notes=notes)

    def _is_drawn(self, element: ElementTree.Element) -> bool:
        """Whether an element is an SVG container, shape, text or image whose conditions are met."""
        namespace = str(element.tag).rpartition("}")[0].lstrip("{")
        is_svg = namespace == _NAMESPACE or (not namespace and "}" not in str(self._root.tag))
        is_known = get_tag(element) in (*_CONTAINERS, *SHAPES, *_OMITTED)
        languages = element.get("systemLanguage", "en").lower().split(",")
        is_english = any(name.strip().partition("-")[0] == "en" for name in languages)
        return is_svg and is_known and is_english and not element.get("requiredExtensions")

    def _enter_element(
        self, element: ElementTree.Element, parent: _State
    ) -> tuple[_State, dict[str, str]]:
        """Return the state for an element's content, and the CSS properties of its `style`."""
        items = (item.partition(":") for item in element.get("style", "").split(";"))
        style = {key.strip(): value.removesuffix("!important").strip() for key, _, value in items}
        names = (*_INHERITED, *_LOCAL)
        values = {name: style.get(name) or element.get(name) or "inherit" for name in names}
        local = {name: values.pop(name) for name in _LOCAL}
        inherited = {name: value for name, value in values.items() if value != "inherit"}
        state = replace(parent, properties=parent.properties | inherited)
        if local["display"] == "none":
            state = replace(state, hidden=state.hidden or "is not displayed")
        if _is_zero(local["opacity"]):
            state = replace(state, hidden=state.hidden or "is transparent")
        self._has_masks |= local["mask"] not in ("inherit", "none")
        if local["transform"] != "inherit":
            matrix = parse_transform(local["transform"], is_css="transform" in style)
            if local["transform-origin"] != "inherit":
                if (box := style.get("transform-box", "view-box")) != "view-box":
                    raise ValueError(
                        f"transform-box: {box} is unsupported; use transform-box: view-box"
                    )
                matrix = transform_about(matrix, local["transform-origin"], state.viewport)
            state = replace(state, matrix=state.matrix.transform(matrix))
        if get_tag(element) == "svg":
            state = self._enter_viewport(element, state, local["overflow"])
        if (reference := re.search(r"url\(\s*['\"]?#([^'\")]+)", local["clip-path"])) is not None:
            clip = self._by_id.get(reference[1].strip())
            if clip is not None and get_tag(clip) == "clipPath":
                state = _intersect_clip(state, self._find_clip_area(clip, element, state, style))
        elif local["clip-path"] not in ("inherit", "none"):
            raise ValueError(f"clip-path {local['clip-path']!r} is unsupported: use url(#ID)")
        return state, style

    def _enter_viewport(self, element: ElementTree.Element, state: _State, overflow: str) -> _State:
        """Return the state for the content of an `svg` element, by its viewport and viewBox."""
        box = [float(x) for x in re.split(r"[\s,]+", element.get("viewBox", "").strip()) if x]
        if element is self._root:
            viewport: Viewport = (box[2], box[3]) if len(box) == 4 else None
            if viewport is None and element.get("width") and element.get("height"):
                lengths = (element.get("width", ""), element.get("height", ""))
                is_known = not any("%" in text for text in lengths)
                viewport = tuple(parse_length(t, None) for t in lengths) if is_known else None  # type: ignore[assignment]
            return replace(state, viewport=viewport)
        fields = (("x", "0"), ("y", "0"), ("width", "100%"), ("height", "100%"))
        x, y, w, h = (
            parse_length(element.get(key, default), state.viewport, i % 2)
            for i, (key, default) in enumerate(fields)
        )
        if overflow not in ("visible", "auto"):
            frame = flatten_outline(f"M {x} {y} h {w} v {h} h {-w} Z", FLIP.transform(state.matrix))
            state = _intersect_clip(state, shapely.union_all(fill_contours(frame)))
        matrix, viewport = Identity.translate(x, y), (w, h)
        if len(box) == 4 and box[2] > 0 and box[3] > 0:
            matrix = matrix.transform(
                _fit_viewbox(box, w, h, element.get("preserveAspectRatio", ""))
            )
            viewport = (box[2], box[3])
        return replace(state, matrix=state.matrix.transform(matrix), viewport=viewport)

    def _find_region(
        self, element: ElementTree.Element, state: _State, style: dict[str, str], rule: str
    ) -> Any:
        """Return the visible region of a shape, or None; rule : "fill-rule" or "clip-rule"."""
        outline = format_outline(element, style, state.viewport)
        contours = flatten_outline(outline, FLIP.transform(state.matrix))
        name = state.properties[rule]
        areas = fill_contours(contours, "evenodd" if name == "evenodd" else "nonzero")
        if not areas or state.clip is None:
            return areas[0] if areas else None
        parts = shapely.get_parts(shapely.intersection(areas[0], state.clip))
        parts = parts[shapely.area(parts) > 0]
        return shapely.multipolygons(parts) if len(parts) else None

    def _find_clip_area(
        self,
        clip: ElementTree.Element,
        element: ElementTree.Element,
        state: _State,
        style: dict[str, str],
    ) -> Any:
        """Return the area of the clip path `clip` for an element that is drawn in `state`."""
        if clip.get("clipPathUnits") == "objectBoundingBox":
            if get_tag(element) not in SHAPES:
                raise ValueError(
                    "clipPathUnits='objectBoundingBox' is supported for shapes only, not for "
                    f"<{get_tag(element)}>; use userSpaceOnUse"
                )
            outline = format_outline(element, style, state.viewport)
            contours = flatten_outline(outline, Identity)
            if not contours:
                return shapely.MultiPolygon()
            points = np.concatenate(contours)
            (x, y), (w, h) = points.min(axis=0).tolist(), np.ptp(points, axis=0).tolist()
            state = replace(state, matrix=state.matrix.translate(x, y).scale(w, h))
        clip_state, _ = self._enter_element(
            clip, replace(state, clip=None, properties=_INHERITED, hidden="")
        )
        clip_state = replace(clip_state, hidden="")  # `display` does not apply to clip paths
        areas = []
        for child in clip:
            if get_tag(child) in ("use", "text"):
                raise ValueError(f"the clip path has a {get_tag(child)}: convert it to a path")
            if get_tag(child) in SHAPES:
                child_state, style = self._enter_element(child, clip_state)
                is_hidden = child_state.hidden == "is not displayed"
                if not is_hidden and child_state.properties["visibility"] == "visible":
                    areas.append(self._find_region(child, child_state, style, "clip-rule"))
        return shapely.union_all([area for area in areas if area is not None])


def _intersect_clip(state: _State, area: Any) -> _State:
    clip = area if state.clip is None else shapely.intersection(state.clip, area)
    return replace(state, clip=clip)


def _fit_viewbox(box: list[float], width: float, height: float, alignment: str) -> Transform:
    """Return the matrix from a viewBox (x, y, width, height) to a viewport at (0, 0)."""
    sx, sy = width / box[2], height / box[3]
    fields = alignment.split() or ["xMidYMid"]
    if fields[0] == "none":
        return Identity.scale(sx, sy).translate(-box[0], -box[1])
    scale = max(sx, sy) if "slice" in fields else min(sx, sy)
    shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    ax, ay = shares.get(fields[0][1:4], 0.5), shares.get(fields[0][5:8], 0.5)
    x, y = ax * (width - scale * box[2]), ay * (height - scale * box[3])
    return Identity.translate(x, y).scale(scale).translate(-box[0], -box[1])


def _check_fill(state: _State, by_id: dict[str | None, ElementTree.Element]) -> str:
    """Return why a shape in a state is not filled, or ""."""
    properties = state.properties
    if properties["visibility"] in ("hidden", "collapse"):
        return "is not visible"
    fill = properties["fill"].lower().strip()
    if (match := re.match(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)\s*(.*)", properties["fill"])) and (
        match[1].strip() not in by_id
    ):
        fill = match[2] or "none"
    if fill == "currentcolor":
        fill = properties["color"].lower().strip()
    if fill == "none":
        return "has no fill"
    alpha = re.fullmatch(r"#[0-9a-f]{3}([0-9a-f])|#[0-9a-f]{6}([0-9a-f]{2})", fill)
    if alpha is not None:
        is_clear = int(alpha[1] or alpha[2], 16) == 0
    else:
        colour = re.fullmatch(r"(?:rgb|hsl)a?\((?:[^,/]+,[^,/]+,[^,/]+,|[^,/]+/)([^,/]+)\)", fill)
        is_clear = fill == "transparent" or (colour is not None and _is_zero(colour[1]))
    is_clear = is_clear or _is_zero(properties["fill-opacity"])
    return "has a transparent fill" if is_clear else ""


def _is_zero(text: str) -> bool:
    """Whether an opacity such as 0, .0 or 0% is zero or negative."""
    try:
        return float(text.strip().removesuffix("%")) <= 0.0
    except ValueError:
        return False
