"""The plan of a building: a basic form, to which bays, corner steps and bevels are added.

Coordinates are those of the lot: x from 0 to the width along the street, y from 0 (the street) to
the depth, both in metres. Rings have the building on their left.
"""

from collections.abc import Sequence
from math import cos, hypot, pi, sin

Ring = list[tuple[float, float]]

WING_M = 5.0  # minimum width of a wing, so that bays, up to 1.2 m deep, do not meet


def build_footprint(
    width: float, depth: float, vertices: int, courtyards: int, u: Sequence[float]
) -> list[Ring]:
    """Return the rings of a building, exterior first; u : eight or more random numbers."""
    if courtyards and min(width, depth) >= 3 * WING_M:
        rings = _build_courtyards(width, depth, courtyards, u)
    elif 12 <= vertices <= 40 and u[0] < 0.035:
        return [_build_ellipse(width, depth, vertices)]
    elif vertices >= 9 and u[0] < 0.08 and depth > width / 2 + WING_M:
        return [_build_apse(width, depth, vertices)]
    else:
        rings = [_build_wings(width, depth, vertices, u)]
    extra = vertices - sum(map(len, rings))
    if len(rings) > 1:
        # The exterior gets fewer details than the walls of the courtyards.
        inner = int(extra * (0.2 + 0.4 * u[5]))
        rings = [_add_details(rings[0], extra - inner, u)] + [
            _add_details(ring, inner // courtyards, u) for ring in rings[1:]
        ]
    else:
        rings = [_add_details(rings[0], extra, u)]
    return rings


def _build_wings(w: float, d: float, vertices: int, u: Sequence[float]) -> Ring:
    """Return a rectangle, or a front building with wings in the form of an L, T, U or E."""
    front = max(WING_M, d * (0.4 + 0.25 * u[1]))
    wing = max(WING_M, w * (0.28 + 0.15 * u[2]))
    if vertices < 6 or d - front < 2.0 or w < 2 * WING_M:
        return [(0, 0), (w, 0), (w, d), (0, d)]
    if vertices < 8 or u[3] < 0.3 or w < 2 * wing + 3.0:
        if u[4] < 0.5:
            return [(0, 0), (w, 0), (w, front), (wing, front), (wing, d), (0, d)]
        return [(0, 0), (w, 0), (w, d), (w - wing, d), (w - wing, front), (0, front)]
    if u[3] < 0.6:
        x = (w - wing) * (0.25 + 0.5 * u[4])
        tail = [(x + wing, front), (x + wing, d), (x, d), (x, front)]
        return [(0, 0), (w, 0), (w, front), *tail, (0, front)]
    low = max(front + 1.0, d * (0.7 + 0.3 * u[4]))
    if vertices >= 12 and u[3] > 0.85 and w > 3 * WING_M + 8.0:
        a, b = (w - WING_M) / 2, (w + WING_M) / 2
        middle = [(w - WING_M, front), (b, front), (b, low), (a, low), (a, front), (WING_M, front)]
        return [(0, 0), (w, 0), (w, d), (w - WING_M, d), *middle, (WING_M, d), (0, d)]
    yard = [(w - wing, front), (wing, front), (wing, low), (0, low)]
    return [(0, 0), (w, 0), (w, d), (w - wing, d), *yard]


def _build_courtyards(w: float, d: float, courtyards: int, u: Sequence[float]) -> list[Ring]:
    """Return a rectangle around rectangular yards, side by side."""
    wall = max(WING_M, min(w, d) * (0.22 + 0.1 * u[1]))
    count = max(1, min(courtyards, int((w - wall) / (2 * wall))))
    pitch = (w - wall) / count
    rings: list[Ring] = [[(0, 0), (w, 0), (w, d), (0, d)]]
    for k in range(count):
        west, east = wall + k * pitch, (k + 1) * pitch
        rings.append([(west, wall), (west, d - wall), (east, d - wall), (east, wall)])
    return rings


def _build_ellipse(w: float, d: float, vertices: int) -> Ring:
    """Return an ellipse of the lot's size w x d, or a circle if the lot is not narrow."""
    a, b = (min(w, d), min(w, d)) if max(w, d) < 1.6 * min(w, d) else (w, d)
    step = 2 * pi / vertices
    return [(w / 2 + a / 2 * cos(k * step), d / 2 + b / 2 * sin(k * step)) for k in range(vertices)]


def _build_apse(w: float, d: float, vertices: int) -> Ring:
    """Return a rectangle with a half circle at the rear, like the apse of a church."""
    arc = vertices - 2
    r = w / 2
    turn = pi / (arc - 1)
    rear = [(r + r * cos(k * turn), d - r + r * sin(k * turn)) for k in range(arc)]
    return [(0, 0), (w, 0), *rear]


def _add_details(ring: Ring, extra: int, u: Sequence[float]) -> Ring:
    """Return a ring with `extra` more vertices: bays (4 each), corner steps (2), bevels (1)."""
    if extra < 1:
        return ring
    walls = [_Wall(ring[i], ring[(i + 1) % len(ring)]) for i in range(len(ring))]
    bays, corners = divmod(extra, 4)
    cut = min(2.0, 0.2 * min(wall.length for wall in walls))
    margin = cut + 1.4
    pitch = 2.2 + 2.5 * u[6]
    bay_limits = [int((wall.length - 2 * margin) / pitch) for wall in walls]
    # Bays are added to the longest walls first; each wall gets all bays that fit, or half of these.
    order = sorted(range(len(walls)), key=lambda i: -bay_limits[i])
    bay_counts = [0] * len(walls)
    for i in order:
        share = bay_limits[i] if u[7] < 0.5 else (bay_limits[i] + 1) // 2
        bay_counts[i] = max(0, min(share, bays))
        bays -= bay_counts[i]
    corners += 4 * max(0, bays)
    result: Ring = []
    first = int(u[5] * len(ring))
    corner_vertices = [0] * len(ring)  # vertices to add: 2 for a step, 1 for a bevel
    for k in range(min(len(ring), (corners + 1) // 2)):
        corner_vertices[(first + k) % len(ring)] = min(2, corners - 2 * k)
    inset = 0.5 + 0.7 * u[4]
    for i, wall in enumerate(walls):
        result.extend(_build_corner(walls[i - 1], wall, cut, corner_vertices[i]))
        result.extend(_build_bays(wall, bay_counts[i], margin, inset))
    return result


class _Wall:
    """A directed wall with the building on the left."""

    __slots__ = ("dx", "dy", "length", "x", "y")

    def __init__(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.x, self.y = start
        self.length = hypot(end[0] - self.x, end[1] - self.y)
        self.dx, self.dy = (end[0] - self.x) / self.length, (end[1] - self.y) / self.length

    def point(self, along: float, into: float) -> tuple[float, float]:
        """Return the point `along` metres from the start and `into` metres into the building."""
        return (
            self.x + along * self.dx - into * self.dy,
            self.y + along * self.dy + into * self.dx,
        )


def _build_corner(before: _Wall, after: _Wall, cut: float, vertices: int) -> Ring:
    """Return a corner between two walls, `cut` metres cut off each, with 0 to 2 vertices added."""
    start, end = before.point(before.length - cut, 0.0), after.point(cut, 0.0)
    if vertices == 0:
        return [(after.x, after.y)]
    if vertices == 1:
        return [start, end]
    # The step's inner vertex: the fourth corner of the parallelogram of start, old corner and end.
    x, y = start[0] + end[0] - after.x, start[1] + end[1] - after.y
    return [start, (x, y), end]


def _build_bays(wall: _Wall, count: int, margin: float, inset: float) -> Ring:
    """Return the points of `count` bays, `inset` deep, evenly spaced between margins of a wall."""
    bays: Ring = []
    if count < 1:
        return bays
    slot = (wall.length - 2 * margin) / count
    for k in range(count):
        a, b = margin + (k + 0.25) * slot, margin + (k + 0.75) * slot
        bays += [wall.point(a, 0.0), wall.point(a, inset), wall.point(b, inset), wall.point(b, 0.0)]
    return bays
