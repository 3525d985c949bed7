"""Criteria: what a triangle is predicted to cost, from its coordinates alone.

A criterion sums a per-triangle cost over a triangulation. Every built-in one is a weighted sum of
the features below, so one definition of each serves the optimiser, the predictions and the
tests. A feature is a Numba function of three points given as six numbers; a user's own criterion
is a function of the same form.

Units are those of the coordinates: pixels for a frame.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit

from triangulators.errors import UnknownName
from triangulators.weights import MARK, read_weights, write_weights

BYTES_PER_TRIANGLE = 24.0  # three vertices of two 4-byte coordinates: the paper's M
WORST_SHAPE = 240.0  # degrees; a triangle flattened to angles 180, 0, 0


@njit(cache=True)
def count(_ax: float, _ay: float, _bx: float, _by: float, _cx: float, _cy: float) -> float:
    """One: summed, the number of triangles T."""
    return 1.0


@njit(cache=True)
def area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Area S."""
    return 0.5 * abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


@njit(cache=True)
def half_perimeter(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Width plus height of the bounding box (H)."""
    return (max(ax, bx, cx) - min(ax, bx, cx)) + (max(ay, by, cy) - min(ay, by, cy))


@njit(cache=True)
def bbox_area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Width times height of the bounding box."""
    return (max(ax, bx, cx) - min(ax, bx, cx)) * (max(ay, by, cy) - min(ay, by, cy))


@njit(cache=True)
def edge_length(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Perimeter (E): summed, boundary edges count once and diagonals twice."""
    ab = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    bc = math.sqrt((cx - bx) ** 2 + (cy - by) ** 2)
    ca = math.sqrt((ax - cx) ** 2 + (ay - cy) ** 2)
    return ab + bc + ca


@njit(cache=True)
def shape(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Deviation from equilateral (D): |60-q| + |60-r| + |60-n| over the angles, in degrees."""
    cross = abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    q = math.atan2(cross, (bx - ax) * (cx - ax) + (by - ay) * (cy - ay))
    r = math.atan2(cross, (ax - bx) * (cx - bx) + (ay - by) * (cy - by))
    third = math.pi / 3.0
    total = abs(third - q) + abs(third - r) + abs(third - (math.pi - q - r))
    return total * 180.0 / math.pi


@njit(cache=True)
def rotated_bbox_area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Mean over all rotations of the bounding box's area, in closed form.

    Width in direction u is half the sum of |e.u| over the edges e, so the mean of width times
    height is a sum over pairs of edges of the mean of |cos t cos(t - d)|, which is
    (sin d + (pi/2 - d) cos d) / pi for 0 <= d <= pi/2.
    """
    ux, uy = bx - ax, by - ay
    vx, vy = cx - bx, cy - by
    wx, wy = ax - cx, ay - cy
    cross = abs(ux * vy - uy * vx)
    uv, vw, wu = ux * vx + uy * vy, vx * wx + vy * wy, wx * ux + wy * uy
    squares = (ux * ux + uy * uy) + (vx * vx + vy * vy) + (wx * wx + wy * wy)
    # The acute angles between the edges' lines add up to pi, or to twice the
    # supplement of an obtuse angle; edges meet head to tail, so obtuse means dot > 0.
    angles = math.pi
    obtuse = max(uv, vw, wu)
    if obtuse > 0.0:
        angles = 2.0 * math.atan2(cross, obtuse)
    dots = abs(uv) + abs(vw) + abs(wu)
    return (squares + 2.0 * dots + 2.0 * cross * angles) / (4.0 * math.pi)


@njit(cache=True)
def _left(lost: float, doubled_area: float) -> float:
    """Area, as a share, of what is common to a triangle and its moved copies."""
    side = 1.0 - lost / doubled_area
    return side * side if side > 0.0 else 0.0


@njit(cache=True)
def _expected(
    size: float, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Mean number of size x size blocks with a covered pixel centre, over all positions.

    A block at an unknown place on the grid has covered centres where one of `size`^2 copies of
    the triangle, moved by whole pixels, covers its corner: the mean is the area of the copies'
    union over size^2. Inclusion and exclusion over the neighbours among the copies (pairs, triples
    and fours of each unit square) gives that area. What copies have in common is the triangle
    itself made smaller, by the edges' normals' least products with the moves, so each term is a
    square. For size 2 this is exact; for more it counts an 8-connected group of centres once, so
    only slivers with gaps inside a block count too much.
    """
    ux, uy, vx, vy, wx, wy = bx - ax, by - ay, cx - bx, cy - by, ax - cx, ay - cy
    cross = ux * vy - uy * vx
    if cross == 0.0:
        return 0.0
    if cross < 0.0:
        ux, uy, vx, vy, wx, wy = -ux, -uy, -vx, -vy, -wx, -wy
        cross = -cross
    width = max(ax, bx, cx) - min(ax, bx, cx)
    height = max(ay, by, cy) - min(ay, by, cy)
    falling = max(ax - ay, bx - by, cx - cy) - min(ax - ay, bx - by, cx - cy)
    rising = max(ax + ay, bx + by, cx + cy) - min(ax + ay, bx + by, cx + cy)
    beside = _left(width, cross) + _left(height, cross)
    across = _left(falling, cross) + _left(rising, cross)
    triples = 0.0
    for right in (-1.0, 1.0):
        for up in (-1.0, 1.0):
            lost = min(0.0, right * uy, up * ux) + min(0.0, right * vy, up * vx)
            triples += _left(-lost - min(0.0, right * wy, up * wx), cross)
    inner = size - 1.0
    squares = triples - across - _left(width + height, cross)
    share = size * size - size * inner * beside + inner * inner * squares
    return 0.5 * cross * share / (size * size)


@njit(cache=True)
def expected_quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """2x2 pixel quads with a covered pixel centre (Q), the mean over positions on the grid."""
    return _expected(2.0, ax, ay, bx, by, cx, cy)


@njit(cache=True)
def expected_blocks(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """4x4 pixel blocks with a covered pixel centre (P), the mean over positions on the grid."""
    return _expected(4.0, ax, ay, bx, by, cx, cy)


@njit(cache=True)
def expected_setups(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Chance that the bounding box holds a pixel centre (R), the mean over positions on the grid.

    What a rasteriser has to set up: a triangle whose box holds none is dropped before that.
    """
    width = max(ax, bx, cx) - min(ax, bx, cx)
    height = max(ay, by, cy) - min(ay, by, cy)
    return min(width, 1.0) * min(height, 1.0)


FEATURES = (
    "triangles",
    "area",
    "half_perimeter",
    "bbox_area",
    "edge_length",
    "shape",
    "rotated_bbox_area",
    "expected_quads",
    "expected_blocks",
    "expected_setups",
)


@njit(cache=True)
def weighted(
    weights: np.ndarray, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Weighted sum of the features of one triangle; `weights` in the order of `FEATURES`."""
    total = weights[0]
    if weights[1] != 0.0:
        total += weights[1] * area(ax, ay, bx, by, cx, cy)
    if weights[2] != 0.0:
        total += weights[2] * half_perimeter(ax, ay, bx, by, cx, cy)
    if weights[3] != 0.0:
        total += weights[3] * bbox_area(ax, ay, bx, by, cx, cy)
    if weights[4] != 0.0:
        total += weights[4] * edge_length(ax, ay, bx, by, cx, cy)
    if weights[5] != 0.0:
        total += weights[5] * shape(ax, ay, bx, by, cx, cy)
    if weights[6] != 0.0:
        total += weights[6] * rotated_bbox_area(ax, ay, bx, by, cx, cy)
    if weights[7] != 0.0:
        total += weights[7] * expected_quads(ax, ay, bx, by, cx, cy)
    if weights[8] != 0.0:
        total += weights[8] * expected_blocks(ax, ay, bx, by, cx, cy)
    if weights[9] != 0.0:
        total += weights[9] * expected_setups(ax, ay, bx, by, cx, cy)
    return total


@njit(cache=True)
def _feature_sums(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    sums = np.zeros(10)
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        ax, ay = points[a, 0], points[a, 1]
        bx, by = points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        sums[0] += 1.0
        sums[1] += area(ax, ay, bx, by, cx, cy)
        sums[2] += half_perimeter(ax, ay, bx, by, cx, cy)
        sums[3] += bbox_area(ax, ay, bx, by, cx, cy)
        sums[4] += edge_length(ax, ay, bx, by, cx, cy)
        sums[5] += shape(ax, ay, bx, by, cx, cy)
        sums[6] += rotated_bbox_area(ax, ay, bx, by, cx, cy)
        sums[7] += expected_quads(ax, ay, bx, by, cx, cy)
        sums[8] += expected_blocks(ax, ay, bx, by, cx, cy)
        sums[9] += expected_setups(ax, ay, bx, by, cx, cy)
    return sums


def predict(points: np.ndarray, triangles: np.ndarray) -> dict[str, float]:
    """Sum every criterion over a triangulation.

    points: (n, 2) float64; triangles: (m, 3) indices into them. Keys: triangles, area,
    half_perimeter, bbox_area, edge_length, shape (degrees), expected_quads, expected_blocks,
    expected_setups, overdraw, rotation_averaged_overdraw and complexity (bytes).
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    triangles = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3)
    sums = dict(zip(FEATURES, _feature_sums(points, triangles).tolist(), strict=True))
    rotated = sums.pop("rotated_bbox_area")
    sums["overdraw"] = sums["bbox_area"] - sums["area"]
    sums["rotation_averaged_overdraw"] = rotated - sums["area"]
    sums["complexity"] = BYTES_PER_TRIANGLE * sums["triangles"]
    return sums


@dataclass(frozen=True)
class Criterion:
    """A cost per triangle, to be summed over a triangulation (or its maximum taken).

    `weights` are coefficients of `FEATURES`; `function`, if given, is a Numba function of three
    points (six numbers) and takes their place. `maximum` compares triangulations by their worst
    triangle. `normalise` turns weights into others once the polygon's area and number of
    triangles are known.
    """

    name: str
    description: str
    weights: tuple[float, ...] = (0.0,) * len(FEATURES)
    function: Callable[..., float] | None = None
    maximum: bool = False
    normalise: Callable[[np.ndarray, float, int], np.ndarray] | None = None

    def weights_for(self, polygon_area: float, triangles: int) -> np.ndarray:
        """Return the (k,) weights of `FEATURES` for a polygon of this area and triangle count."""
        weights = np.array(self.weights, dtype=np.float64)
        if self.normalise is None:
            return weights
        return self.normalise(weights, polygon_area, max(triangles, 1))

    def total(self, points: np.ndarray, triangles: np.ndarray) -> float:
        """Return the criterion of one triangulation."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        if len(triangles) == 0:
            return 0.0
        if self.function is not None:
            costs = [self.function(*points[row].ravel().tolist()) for row in triangles]
            return float(max(costs) if self.maximum else math.fsum(costs))
        rows = [triangles[[index]] for index in range(len(triangles))] if self.maximum else ()
        sums = _feature_sums(points, np.ascontiguousarray(triangles, dtype=np.int32))
        weights = self.weights_for(float(sums[1]), len(triangles))
        if not self.maximum:
            return float(np.dot(weights, sums))
        return max(float(np.dot(weights, _feature_sums(points, row))) for row in rows)


CALIBRATED = (
    "triangles",
    "area",
    "half_perimeter",
    "bbox_area",
    "expected_quads",
    "expected_blocks",
    "expected_setups",
)
"""Features that a device's time may be made of."""


def _linear(name: str, description: str, **coefficients: float) -> Criterion:
    weights = tuple(float(coefficients.get(feature, 0.0)) for feature in FEATURES)
    return Criterion(name, description, weights)


def _per_polygon(weights: np.ndarray, polygon_area: float, triangles: int) -> np.ndarray:
    result = weights / triangles
    result[1] = weights[1] / polygon_area
    result[3] = weights[3] / polygon_area
    return result


def mixed(alpha: float = 1.0, beta: float = 1.0, gamma: float = 1.0) -> Criterion:
    """F = alpha A / S + beta D / (240 T) + gamma C / (24 T), the paper's mixture.

    Each term is made comparable by its scale: A by the polygon's area S, D by the 240 degrees a
    triangle can deviate at most, C by 24 bytes a triangle. So C adds the constant gamma.
    It is called `mixed=alpha/beta/gamma`, and `mixed` where all three are 1.
    """
    weights = (alpha, beta, gamma)
    linear = _linear(
        "mixed" if weights == (1, 1, 1) else f"mixed{MARK}{write_weights(weights)}",
        "alpha*A/S + beta*D/(240 T) + gamma*C/(24 T); mixed=1/0.5/0 gives the weights",
        triangles=gamma,
        area=-alpha,
        bbox_area=alpha,
        shape=beta / WORST_SHAPE,
    )
    return replace(linear, normalise=_per_polygon)


def calibrated(coefficients: Mapping[str, float]) -> Criterion:
    """A device's fitted cost: coefficients of some of `CALIBRATED`. Raises `ValueError`."""
    known = CALIBRATED
    unknown = set(coefficients) - set(known)
    if unknown:
        raise ValueError(
            f"calibrated: unknown coefficients {sorted(unknown)}; expected some of {list(known)}"
        )
    return _linear(
        "calibrated", "coefficients of T, S, H, w*h, Q, P and R fitted on a device", **coefficients
    )


CRITERIA: dict[str, Criterion] = {
    criterion.name: criterion
    for criterion in (
        _linear("overdraw", "bounding-box area minus triangle area (A)", bbox_area=1, area=-1),
        _linear("half-perimeter", "bounding-box width plus height (H)", half_perimeter=1),
        _linear(
            "expected-quads", "2x2 pixel quads to shade, over all positions (Q)", expected_quads=1
        ),
        _linear("expected-blocks", "4x4 pixel blocks touched, likewise (P)", expected_blocks=1),
        _linear("edge-length", "perimeter (E)", edge_length=1),
        _linear("shape", "deviation of the angles from 60 degrees (D)", shape=1),
        _linear("complexity", "24 bytes a triangle (C)", triangles=BYTES_PER_TRIANGLE),
        _linear(
            "rotation-averaged-overdraw",
            "overdraw averaged over all rotations",
            rotated_bbox_area=1,
            area=-1,
        ),
        mixed(),
        calibrated({"triangles": 1.0, "area": 1.0, "half_perimeter": 1.0}),
    )
}
MINMAX = "minmax-"


def names() -> list[str]:
    """Return the names of the criteria; each may also be written with `minmax-` before it."""
    return list(CRITERIA)


def find(name: str | Criterion | Callable[..., float], **parameters: Any) -> Criterion:
    """Return a criterion by name, or made of a user's Numba function of three points.

    The name of `mixed` may hold its weights, `mixed=1/0.5/0` (see `weights`). parameters: alpha,
    beta, gamma for `mixed`; coefficients for `calibrated`. The criterion's own name is the one way
    to write it. Raises `UnknownName`, also for weights that cannot be used.
    """
    if isinstance(name, Criterion):
        return name
    if callable(name):
        return Criterion(getattr(name, "__name__", "custom"), "user's function", function=name)
    plain, mark, weights = name.removeprefix(MINMAX).partition(MARK)
    if plain not in CRITERIA:
        near = difflib.get_close_matches(plain, CRITERIA, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise UnknownName(f"unknown criterion {name!r}{hint} (known: {', '.join(CRITERIA)})")
    criterion = CRITERIA[plain]
    if mark:
        if plain != "mixed":
            raise UnknownName(f"criterion {plain!r} takes no weights, got {weights!r}; mixed does")
        if parameters:
            raise TypeError(f"criterion {name!r} has its weights already, got {sorted(parameters)}")
        criterion = mixed(**read_weights(plain, weights, ("alpha", "beta", "gamma")))
    elif plain == "mixed":
        criterion = mixed(**parameters)
    elif plain == "calibrated" and parameters:
        criterion = calibrated(**parameters)
    elif parameters:
        raise TypeError(f"criterion {plain!r} takes no parameters, got {sorted(parameters)}")
    if name.startswith(MINMAX):
        criterion = replace(criterion, name=MINMAX + criterion.name, maximum=True)
    return criterion
