"""A generated city plan: districts, streets, blocks, lots, and a footprint on each lot.

Districts are the Voronoi cells of points that are denser towards the centre, cut by ring boulevards
and two avenues. Each footprint is inside its lot, so footprints share walls but do not overlap.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from scenes.footprints import build_footprint
from scenes.scene import Scene, SceneError

MAX_BUILDINGS = 100_000
_AREA_PER_BUILDING_M2 = 900.0  # square metres of city per building, streets included
_COORDINATE_DECIMALS = 3  # of metres; rounded, so that all platforms give equal numbers

# Shares of buildings, and for each share the number of vertices that these buildings do not exceed:
# quantiles of the OpenStreetMap footprints of European cities.
_VERTEX_QUANTILES = (
    (0.0, 0.16, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 1.0),
    (4.0, 4.0, 6.0, 9.8, 17.0, 27.5, 36.0, 78.0, 160.0),
)
_COURTYARD_SHARE = 0.1  # of buildings; 0.08 have courtyards after footprints are cut to lots
_COURTYARD_VERTICES = 8  # vertices added to a building with courtyards


class _Lots(NamedTuple):
    """The lots of a district, in coordinates whose x axis is along the district's streets.

    boxes : (n, 4) x0, y0, x1, y1 of the building on each lot
    facing : (n,) True if the street is at y0, False if at y1
    """

    polygons: NDArray[Any]
    boxes: NDArray[np.float64]
    facing: NDArray[np.bool_]


def build(*, seed: int = 0, buildings: int = 500) -> Scene:
    """Return a city of exactly `buildings` footprints, in metres, from the centre outwards."""
    if not 1 <= buildings <= MAX_BUILDINGS:
        raise SceneError(f"city: buildings={buildings} is out of range: give 1 to {MAX_BUILDINGS}")
    rng = np.random.default_rng([seed, 0xC17])
    target = buildings * 1.25 + 40
    radius = max(250.0, np.sqrt(target * _AREA_PER_BUILDING_M2 / np.pi))
    polygons: NDArray[Any] = np.empty(0, dtype=object)
    while len(polygons) < buildings:
        districts = _build_districts(rng, radius)
        polygons = np.concatenate([_build_district(rng, d, radius) for d in districts])
        radius *= 1.2
    # Select buildings from the centre outwards; random distances make the city's edge ragged.
    distance = np.hypot(*shapely.get_coordinates(shapely.centroid(polygons)).T)
    ragged = distance + rng.normal(0.0, 12.0, len(polygons))
    innermost = np.argsort(ragged, kind="stable")
    return Scene(
        name="city",
        polygons=list(polygons[innermost[:buildings]]),
        units="m",
        description="generated city plan: blocks, streets, footprints",
        licence="generated, no rights reserved",
        parameters={"buildings": buildings, "seed": seed},
    )


def _build_districts(rng: Generator, radius: float) -> NDArray[Any]:
    """Return the districts of a city: Voronoi cells without boulevards and avenues."""
    count = max(7, int(np.pi * radius**2 / 55_000))
    # Each point is turned by the golden angle, 2.4 radians, so that points spread evenly.
    angle = np.arange(count) * 2.399963 + rng.normal(0.0, 0.35, count)
    reach = radius * ((np.arange(count) + 0.5) / count) ** 0.62
    seeds = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    disc = shapely.buffer(shapely.Point(0, 0), radius, quad_segs=32)
    cells = shapely.get_parts(
        shapely.voronoi_polygons(shapely.MultiPoint(seeds), extend_to=shapely.envelope(disc))
    )
    # An avenue across the city, a second avenue on one side, and a slightly oval ring.
    turn = rng.uniform(0.0, np.pi)
    length = 2.0 * radius
    across = np.array([np.cos(turn), np.sin(turn)])
    branch = np.array([np.cos(turn + 1.1), np.sin(turn + 1.1)])
    streets = [
        shapely.buffer(shapely.LineString([-length * across, length * across]), 13.0),
        shapely.buffer(shapely.LineString([[0.0, 0.0], length * branch]), 10.0),
    ]
    for ring_radius in np.arange(0.42 * min(radius, 900.0), 0.9 * radius, 900.0):
        t = np.linspace(0.0, 2 * np.pi, 97)[:-1]
        r = ring_radius * (1 + 0.08 * np.cos(2 * t + turn))
        ring = shapely.LinearRing(np.column_stack([r * np.cos(t), r * np.sin(t)]))
        streets.append(shapely.buffer(ring, 12.0))
    land = shapely.difference(shapely.intersection(cells, disc), shapely.union_all(streets))
    # Shrink by half of the width of the streets between districts.
    pieces = shapely.get_parts(shapely.buffer(shapely.get_parts(land), -7.0, join_style="mitre"))
    return np.asarray(pieces[shapely.area(pieces) > 900.0])


def _build_district(rng: Generator, district: shapely.Polygon, radius: float) -> NDArray[Any]:
    """Return the footprints of a district of a city of this radius."""
    middle = district.centroid
    central = np.hypot(middle.x, middle.y) < 0.45 * radius
    # Streets run nearly along the longest side.
    sides = np.diff(shapely.get_coordinates(district.simplify(5.0).exterior), axis=0)
    longest = sides[np.argmax(np.hypot(*sides.T))]
    angle = float(np.arctan2(longest[1], longest[0]) + rng.normal(0.0, 0.03))
    blocks = _cut_blocks(rng, _rotate_geometry(district, -angle), central)
    lots = [_cut_lots(rng, block, central) for block in blocks]
    lots = [lots_of_block for lots_of_block in lots if len(lots_of_block.polygons)]
    if not lots:
        return np.empty(0, dtype=object)
    all_lots = map(np.concatenate, zip(*lots, strict=True))
    rotated = _rotate_geometry(_build_footprints(rng, _Lots(*all_lots)), angle)
    rounded = shapely.transform(rotated, lambda xy: np.round(xy, _COORDINATE_DECIMALS) + 0.0)
    usable = rounded[shapely.is_valid(rounded) & (shapely.area(rounded) > 15.0)]
    return np.asarray(shapely.orient_polygons(usable))


def _rotate_geometry(geometry: Any, angle: float) -> Any:
    c, s = np.cos(angle), np.sin(angle)
    return shapely.transform(geometry, lambda xy: xy @ np.array([[c, s], [-s, c]]))


def _choose_cuts(
    rng: Generator, low: float, high: float, shortest: float, longest: float
) -> NDArray[Any]:
    """Return positions that cut [low, high] into random lengths, about `shortest` to `longest`."""
    count = max(1, round((high - low) / ((shortest + longest) / 2)))
    lengths = rng.uniform(shortest, longest, count)
    return low + (high - low) * np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])


def _cut_blocks(rng: Generator, district: shapely.Polygon, central: bool) -> list[shapely.Polygon]:
    """Return the blocks of a district that is rotated so that streets run along the axes."""
    x0, y0, x1, y1 = district.bounds
    rows = _choose_cuts(rng, y0, y1, *((36.0, 58.0) if central else (52.0, 74.0)))
    length = (45.0, 95.0) if central else (80.0, 150.0)
    street = 3.5 if central else 6.0
    staggered = rng.random() < 0.4
    columns = _choose_cuts(rng, x0, x1, *length)
    boxes = []
    for bottom, top in pairwise(rows):
        if staggered:
            columns = _choose_cuts(rng, x0, x1, *length)
        boxes.append(
            shapely.box(columns[:-1] + street, bottom + street, columns[1:] - street, top - street)
        )
    pieces = shapely.get_parts(shapely.intersection(district, np.concatenate(boxes)))
    # 5 % of the blocks are parks or squares, without buildings.
    open_space = rng.random(len(pieces)) < 0.05
    polygonal = shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON
    return list(pieces[polygonal & ~open_space & (shapely.area(pieces) > 250.0)])


def _cut_lots(rng: Generator, block: shapely.Polygon, central: bool) -> _Lots:
    """Cut a block into one or two rows of lots; return the lots, with a box for each building."""
    x0, y0, x1, y1 = block.bounds
    kind = rng.random()
    is_single = kind < 0.08
    slabs = not central and kind > 0.8
    detached = not central and 0.4 < kind <= 0.8
    if is_single or slabs or y1 - y0 < 26.0:
        rows = np.array([y0, y1])
    else:
        rows = np.array([y0, y0 + (y1 - y0) * rng.uniform(0.42, 0.58), y1])
    width = (24.0, 34.0) if slabs else (17.0, 24.0) if detached else (13.0, 30.0)
    if is_single:
        width = (x1 - x0, x1 - x0)
    lots, buildings, facing = [], [], []
    for k, (bottom, top) in enumerate(pairwise(rows)):
        columns = _choose_cuts(rng, x0, x1, *width)
        n = len(columns) - 1
        lots.append(np.column_stack([columns[:-1], np.full(n, bottom), columns[1:], [top] * n]))
        buildings.append(_place_buildings(rng, lots[-1], k == 0, detached, slabs))
        facing.append(np.full(n, k == 0))
    boxes = np.concatenate(lots)
    pieces = shapely.intersection(block, shapely.box(*boxes.T))
    # A lot that a slanting street cuts may be too small for a building, and is omitted.
    is_large_enough = (shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON) & (
        shapely.area(pieces) > 60.0
    )
    return _Lots(
        pieces[is_large_enough],
        np.concatenate(buildings)[is_large_enough],
        np.concatenate(facing)[is_large_enough],
    )


def _place_buildings(
    rng: Generator, lots: NDArray[np.float64], low_street: bool, detached: bool, slabs: bool
) -> NDArray[np.float64]:
    """Return (n, 4) boxes of buildings, one on each lot of a row; most are as wide as the lot."""
    n = len(lots)
    x0, y0, x1, y1 = lots.T
    depth = y1 - y0
    if slabs:
        side = (x1 - x0 - rng.uniform(11.0, 14.0, n)) / 2
        front, used = np.full(n, 2.0), depth - rng.uniform(4.0, 12.0, n)
    elif detached:
        side = rng.uniform(1.5, 4.5, n)
        front = np.full(n, rng.uniform(2.0, 6.0))
        used = np.minimum(depth - front - 2.0, rng.uniform(9.0, 19.0, n))
    else:
        side = np.where(rng.random(n) < 0.1, 1.5, 0.0)
        front, used = np.zeros(n), depth * rng.uniform(0.55, 1.0, n)
    used = np.maximum(used, 6.0)
    if low_street:
        return np.column_stack([x0 + side, y0 + front, x1 - side, y0 + front + used])
    return np.column_stack([x0 + side, y1 - front - used, x1 - side, y1 - front])


def _build_footprints(rng: Generator, lots: _Lots) -> NDArray[Any]:
    """Return a footprint per lot; large lots tend to get more vertices and courtyards."""
    x0, y0, x1, y1 = lots.boxes.T
    n = len(lots.boxes)
    size = np.log(np.maximum((x1 - x0) * (y1 - y0), 1.0))
    # Random numbers in an order that is rank-correlated with the size.
    uniform = np.sort(rng.random(n))
    score = 0.55 * (size - size.mean()) / (size.std() + 1e-9) + rng.normal(0.0, 1.0, n)
    vertices = np.empty(n)
    vertices[np.argsort(score, kind="stable")] = uniform
    vertices = np.rint(np.interp(vertices, *_VERTEX_QUANTILES)).astype(int)
    roomy = np.minimum(x1 - x0, y1 - y0) >= 15.0
    chance = _COURTYARD_SHARE * n / max(1, roomy.sum())
    courtyards = (roomy & (rng.random(n) < chance)).astype(int)
    courtyards[(courtyards > 0) & (x1 - x0 > 45.0)] += 1
    vertices[courtyards > 0] += _COURTYARD_VERTICES
    u = rng.random((n, 8)).tolist()
    rings, counts = [], []
    for i in range(n):
        building = build_footprint(
            x1[i] - x0[i], y1[i] - y0[i], int(vertices[i]), int(courtyards[i]), u[i]
        )
        rings.extend(building)
        counts.append(len(building))
    plans = _build_polygons(rings, counts, lots)
    # Intersect only plans that may leave their lot: most lots are rectangles around the plan.
    bounds = shapely.bounds(lots.polygons)
    area = (bounds[:, 2] - bounds[:, 0]) * (bounds[:, 3] - bounds[:, 1])
    low, high = lots.boxes[:, :2] >= bounds[:, :2] - 1e-9, lots.boxes[:, 2:] <= bounds[:, 2:] + 1e-9
    is_inside = (shapely.area(lots.polygons) > area * (1 - 1e-9)) & (low & high).all(axis=1)
    beyond, lot_areas = plans[~is_inside], lots.polygons[~is_inside]
    try:
        clipped = shapely.intersection(beyond, lot_areas)
    except shapely.GEOSException:  # rarely, GEOS cannot intersect an invalid plan: omit such plans
        is_valid = shapely.is_valid(beyond)
        clipped = shapely.intersection(beyond[is_valid], lot_areas[is_valid])
    return np.concatenate([plans[is_inside], _select_largest_parts(clipped)])


def _build_polygons(rings: list[Any], counts: list[int], lots: _Lots) -> NDArray[Any]:
    """Return the buildings as polygons in the coordinates of `_Lots`; counts : rings of each."""
    coordinates = np.concatenate([[*ring, ring[0]] for ring in rings])
    ends = np.concatenate([[0], np.cumsum([len(ring) + 1 for ring in rings])])
    owners = np.concatenate([[0], np.cumsum(counts)])
    lot = np.repeat(np.repeat(np.arange(len(counts)), counts), np.diff(ends))
    x0, y0, _, y1 = lots.boxes[lot].T
    up = lots.facing[lot]
    coordinates[:, 0] += x0
    coordinates[:, 1] = np.where(up, y0 + coordinates[:, 1], y1 - coordinates[:, 1])
    layout = coordinates, (ends, owners)
    return np.asarray(shapely.from_ragged_array(shapely.GeometryType.POLYGON, *layout))


def _select_largest_parts(geometries: NDArray[Any]) -> NDArray[Any]:
    """Return the polygon of largest area of each geometry; omit geometries without polygons."""
    parts, owner = shapely.get_parts(geometries, return_index=True)
    polygonal = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    parts, owner = parts[polygonal], owner[polygonal]
    order = np.lexsort((-shapely.area(parts), owner))
    _, first = np.unique(owner[order], return_index=True)
    return np.asarray(parts[order][first])
