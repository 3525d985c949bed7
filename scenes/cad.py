"""Parts cut from sheet metal: plates, flanges, brackets, gears, name plates."""

from collections.abc import Callable

import numpy as np
import shapely
from numpy.random import Generator
from shapely import affinity

from scenes.readers.meshes import join_facets
from scenes.real import find_font, open_font, read_glyph
from scenes.repair import arrange_in_rows, clean
from scenes.scene import Scene, SceneError

Part = Callable[[Generator, int], shapely.Geometry]


def build(*, seed: int = 0, parts: int = 60, segments: int = 32) -> Scene:
    """Return `parts` parts of random sizes, in millimetres, with `segments` chords in a circle."""
    if not 1 <= parts <= 100_000 or not 8 <= segments <= 1000:
        raise SceneError(
            f"cad: parts={parts}, segments={segments} is out of range: "
            "give 1 to 100000 parts and 8 to 1000 segments"
        )
    rng = np.random.default_rng([seed, 0xCAD])
    kinds: list[Part] = [_build_plate, _build_flange, _build_bracket, _build_gear, _build_sign]
    outlines = [kinds[i % len(kinds)](rng, segments) for i in range(parts)]
    rounded = shapely.transform(np.array(outlines), lambda xy: np.round(xy, 4) + 0.0)
    cleaned = clean(rounded, [f"part {i}" for i in range(parts)])
    return Scene(
        name="cad",
        polygons=_arrange_by_part(cleaned.polygons, cleaned.source),
        units="mm",
        description="sheet metal parts: plates, flanges, brackets, gears, name plates",
        licence="generated, no rights reserved",
        parameters={"parts": parts, "segments": segments, "seed": seed},
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )


def _arrange_by_part(polygons: np.ndarray, source: np.ndarray) -> list[shapely.Polygon]:
    """Return the polygons in rows of parts; source : (p,) part of each polygon."""
    boxes = [shapely.box(*shapely.total_bounds(polygons[source == i])) for i in np.unique(source)]
    arranged = arrange_in_rows(boxes, gap=0.15)
    polygons_in_rows = []
    for i, before, after in zip(np.unique(source), boxes, arranged, strict=True):
        dx, dy = np.subtract(after.bounds[:2], before.bounds[:2])
        polygons_in_rows += [affinity.translate(p, dx, dy) for p in polygons[source == i]]
    return polygons_in_rows


def _build_arc(
    centre: tuple[float, float], radius: float, start: float, end: float, segments: int
) -> np.ndarray:
    """Return the points (k, 2) of an arc between two angles in radians; segments : per circle."""
    steps = max(2, round(segments * abs(end - start) / (2 * np.pi)) + 1)
    t = np.linspace(start, end, steps)
    return np.column_stack([centre[0] + radius * np.cos(t), centre[1] + radius * np.sin(t)])


def _build_circle(x: float, y: float, radius: float, segments: int) -> shapely.Polygon:
    return shapely.Polygon(_build_arc((x, y), radius, 0.0, 2 * np.pi, segments)[:-1])


def _build_slot(x: float, y: float, length: float, radius: float, segments: int) -> shapely.Polygon:
    """Return a slot about (x, y), along x, with round ends whose centres are `length` apart."""
    right_arc = _build_arc((x + length / 2, y), radius, -np.pi / 2, np.pi / 2, segments)
    left_arc = _build_arc((x - length / 2, y), radius, np.pi / 2, 3 * np.pi / 2, segments)
    return shapely.Polygon(np.concatenate([right_arc, left_arc]))


def _build_rounded_rectangle(w: float, h: float, radius: float, segments: int) -> np.ndarray:
    """Return the ring (k, 2) of a rectangle from (0, 0) to (w, h) with rounded corners."""
    corners = [(w - radius, radius), (w - radius, h - radius), (radius, h - radius)]
    corners.append((radius, radius))
    arcs = [
        _build_arc(c, radius, (k - 1) * np.pi / 2, k * np.pi / 2, segments)
        for k, c in enumerate(corners)
    ]
    return np.concatenate(arcs)


def _cut_holes(
    outline: np.ndarray | shapely.Polygon, holes: list[shapely.Polygon]
) -> shapely.Geometry:
    return shapely.Polygon(shapely.Polygon(outline).exterior, [hole.exterior for hole in holes])


def _build_plate(rng: Generator, segments: int) -> shapely.Geometry:
    """Return a plate with rounded corners, a bolt hole at each corner, and a column of slots."""
    w, h = rng.uniform(80, 160), rng.uniform(60, 110)
    inset, bolt = rng.uniform(9, 12), rng.uniform(2.5, 4.5)
    centres = [(x, y) for x in (inset, w - inset) for y in (inset, h - inset)]
    holes = [_build_circle(x, y, bolt, segments) for x, y in centres]
    rows = int(rng.integers(1, 1 + int((h - 4 * inset) / 12)) if h > 4 * inset + 12 else 1)
    length = w - 4 * inset - 2
    for k in range(rows):
        y = h / 2 + (k - (rows - 1) / 2) * 12
        holes.append(_build_slot(w / 2, y, length - 2 * bolt, rng.uniform(2, 4), segments))
    return _cut_holes(_build_rounded_rectangle(w, h, inset - 1, segments), holes)


def _build_flange(rng: Generator, segments: int) -> shapely.Geometry:
    """Return a disc with a bore and a circle of bolt holes."""
    radius, bolts = rng.uniform(35, 60), int(rng.integers(4, 13))
    bolt = min(4.5, 0.5 * np.pi * 0.8 * radius / bolts)
    bore = _build_circle(0, 0, rng.uniform(0.3, 0.5) * radius, 2 * segments)
    angle = 2 * np.pi / bolts
    ring = [
        _build_circle(
            0.8 * radius * np.cos(k * angle), 0.8 * radius * np.sin(k * angle), bolt, segments
        )
        for k in range(bolts)
    ]
    return _cut_holes(_build_circle(0, 0, radius, 3 * segments), [bore, *ring])


def _build_bracket(rng: Generator, segments: int) -> shapely.Geometry:
    """Return an L with a rounded inner corner, a slot along x and bolt holes along y."""
    a, b, t = rng.uniform(70, 130), rng.uniform(70, 130), rng.uniform(18, 28)
    fillet = rng.uniform(6, 14)
    inner = _build_arc((t + fillet, t + fillet), fillet, 1.5 * np.pi, np.pi, segments)
    ring = np.concatenate([[[0, 0], [a, 0], [a, t]], inner, [[t, b], [0, b]]])
    holes = [_build_slot(0.7 * a, t / 2, 0.25 * a, t / 6, segments)]
    holes += [_build_circle(t / 2, y * b, t / 5, segments) for y in (0.45, 0.65, 0.85)]
    return _cut_holes(ring, holes)


def _build_gear(rng: Generator, segments: int) -> shapely.Geometry:
    """Return a gear with involute teeth, a bore with a keyway, and holes that save weight.

    The pressure angle is 20 degrees. Below the base circle, a tooth's flank is a straight line.
    """
    teeth, module = int(rng.integers(14, 40)), rng.uniform(2.0, 3.5)
    pitch = teeth * module / 2
    base, root, tip = pitch * np.cos(np.radians(20)), pitch - 1.25 * module, pitch + module
    alpha = np.arccos(base / np.linspace(max(base, root), tip, 5))
    involute = np.tan(alpha) - alpha
    at_pitch = np.tan(np.radians(20)) - np.radians(20)
    # Half of a tooth's angle at each radius: pi / (2 teeth) on the pitch circle.
    half = np.pi / (2 * teeth) + at_pitch - involute
    radii = base / np.cos(alpha)
    if root < base:
        radii, half = np.concatenate([[root], radii]), np.concatenate([half[:1], half])
    middle = 2 * np.pi / teeth * np.arange(teeth)[:, None]
    angle = np.hstack([middle - half, middle + half[::-1]]).ravel()
    reach = np.tile(np.concatenate([radii, radii[::-1]]), teeth)
    ring = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    bore, key = 0.22 * pitch, 0.07 * pitch
    start = np.arcsin(key / bore)
    arc = _build_arc((0, 0), bore, np.pi / 2 + start, 2.5 * np.pi - start, segments)
    keyway = np.concatenate([arc, [[key, 1.3 * bore], [-key, 1.3 * bore]]])
    webs = int(rng.integers(4, 7))
    angle = 2 * np.pi * np.arange(webs) / webs + np.pi / webs
    light = [
        _build_circle(0.6 * pitch * np.cos(t), 0.6 * pitch * np.sin(t), 0.17 * pitch, segments)
        for t in angle
    ]
    return _cut_holes(ring, [shapely.Polygon(keyway), *light])


def _build_sign(rng: Generator, segments: int) -> shapely.Geometry:
    """Return a plate with a random part number, such as "AB-123", cut out."""
    face = open_font(find_font())
    letters, x = [], 0.0
    name = f"{chr(rng.integers(65, 91))}{chr(rng.integers(65, 91))}-{rng.integers(100, 999)}"
    for character in name:
        cleaned, advance = read_glyph(face, character, max(2, segments // 8))
        letters += [affinity.translate(p, x, 0.0) for p in cleaned.polygons]
        x += 1.08 * advance
    scale = 28.0 / face.units_per_EM
    text = shapely.transform(shapely.MultiPolygon(letters), lambda xy: xy * scale + [12.0, 12.0])
    plate = shapely.Polygon(_build_rounded_rectangle(x * scale + 22.0, 46.0, 8.0, segments))
    return shapely.difference(plate, text)


def build_faces(*, seed: int = 0) -> Scene:
    """Return the faces of ten generated sheet metal parts, 20 mm thick, laid out in rows."""
    import trimesh

    polygons = []
    for part in build(seed=seed, parts=10, segments=16).polygons:
        solid = trimesh.creation.extrude_polygon(part, 20.0, engine="earcut")
        polygons += join_facets(np.asarray(solid.vertices), np.asarray(solid.faces, np.int64))[0]
    cleaned = clean(arrange_in_rows(polygons), [f"facet {i}" for i in range(len(polygons))])
    return Scene(
        name="meshes",
        polygons=list(cleaned.polygons),
        units="mm",
        description="faces of sheet metal parts, each in its plane",
        licence="generated, no rights reserved",
        parameters={"seed": seed},
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )
