"""The plan of one building: its basic form, then the bays, steps and bevels of its walls.

A footprint is drawn in the frame of its lot: x from 0 to the width along the street, y from 0 (the
street) to the depth, both in metres. Rings have the building on their left.
"""

from collections.abc import Sequence
from math import cos, hypot, pi, sin

Ring = list[tuple[float, float]]

WING = 5.0
"""Narrowest wing, in metres; bays cut at most a quarter into it from either side."""


def footprint(
    width: float, depth: float, vertices: int, courtyards: int, u: Sequence[float]
) -> list[Ring]:
    """Return the rings of a building of about `vertices` vertices, exterior first.

    `u` are at least 8 numbers in [0, 1) that decide everything else. A building too small for
    what is asked gets a simpler form.
    """
    if courtyards and min(width, depth) >= 3 * WING:
        rings = _courtyard(width, depth, courtyards, u)
    elif 12 <= vertices <= 40 and u[0] < 0.035:
        return [_ellipse(width, depth, vertices)]
    elif vertices >= 9 and u[0] < 0.08 and depth > width / 2 + WING:
        return [_apse(width, depth, vertices)]
    else:
        rings = [_winged(width, depth, vertices, u)]
    extra = vertices - sum(map(len, rings))
    if len(rings) > 1:
        # walls towards the street are plainer than those of the yard are irregular
        inner = int(extra * (0.2 + 0.4 * u[5]))
        rings = [_articulated(rings[0], extra - inner, u)] + [
            _articulated(ring, inner // courtyards, u) for ring in rings[1:]
        ]
    else:
        rings = [_articulated(rings[0], extra, u)]
    return rings


def _winged(w: float, d: float, vertices: int, u: Sequence[float]) -> Ring:
    """A rectangle, or a front building with one wing (L), a middle wing (T), two (U) or three."""
    front = max(WING, d * (0.4 + 0.25 * u[1]))
    wing = max(WING, w * (0.28 + 0.15 * u[2]))
    if vertices < 6 or d - front < 2.0 or w < 2 * WING:
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
    if vertices >= 12 and u[3] > 0.85 and w > 3 * WING + 8.0:
        a, b = (w - WING) / 2, (w + WING) / 2
        middle = [(w - WING, front), (b, front), (b, low), (a, low), (a, front), (WING, front)]
        return [(0, 0), (w, 0), (w, d), (w - WING, d), *middle, (WING, d), (0, d)]
    yard = [(w - wing, front), (wing, front), (wing, low), (0, low)]
    return [(0, 0), (w, 0), (w, d), (w - wing, d), *yard]


def _courtyard(w: float, d: float, courtyards: int, u: Sequence[float]) -> list[Ring]:
    """A rectangle around one or more rectangular yards, side by side."""
    wall = max(WING, min(w, d) * (0.22 + 0.1 * u[1]))
    count = max(1, min(courtyards, int((w - wall) / (2 * wall))))
    pitch = (w - wall) / count
    rings: list[Ring] = [[(0, 0), (w, 0), (w, d), (0, d)]]
    for k in range(count):
        left, right = wall + k * pitch, (k + 1) * pitch
        rings.append([(left, wall), (left, d - wall), (right, d - wall), (right, wall)])
    return rings


def _ellipse(w: float, d: float, vertices: int) -> Ring:
    # round buildings are round, but for those in a narrow lot
    a, b = (min(w, d), min(w, d)) if max(w, d) < 1.6 * min(w, d) else (w, d)
    step = 2 * pi / vertices
    return [(w / 2 + a / 2 * cos(k * step), d / 2 + b / 2 * sin(k * step)) for k in range(vertices)]


def _apse(w: float, d: float, vertices: int) -> Ring:
    """A rectangle whose rear is a half circle."""
    arc = vertices - 2
    r = w / 2
    turn = pi / (arc - 1)
    rear = [(r + r * cos(k * turn), d - r + r * sin(k * turn)) for k in range(arc)]
    return [(0, 0), (w, 0), *rear]


def _articulated(ring: Ring, extra: int, u: Sequence[float]) -> Ring:
    """Add about `extra` vertices: bays into long walls (4 each), corner steps (2), bevels (1)."""
    if extra < 1:
        return ring
    walls = [_Wall(ring[i], ring[(i + 1) % len(ring)]) for i in range(len(ring))]
    bays, corners = divmod(extra, 4)
    cut = min(2.0, 0.2 * min(wall.length for wall in walls))
    margin = cut + 1.4
    pitch = 2.2 + 2.5 * u[6]
    free = [int((wall.length - 2 * margin) / pitch) for wall in walls]
    # longest walls first: a facade takes all its bays, or its share
    order = sorted(range(len(walls)), key=lambda i: -free[i])
    taken = [0] * len(walls)
    for i in order:
        share = free[i] if u[7] < 0.5 else (free[i] + 1) // 2
        taken[i] = max(0, min(share, bays))
        bays -= taken[i]
    corners += 4 * max(0, bays)
    out: Ring = []
    first = int(u[5] * len(ring))
    gains = [0] * len(ring)  # vertices that each corner gets: 2 for a step, 1 for a bevel
    for k in range(min(len(ring), (corners + 1) // 2)):
        gains[(first + k) % len(ring)] = min(2, corners - 2 * k)
    inset = 0.5 + 0.7 * u[4]
    for i, wall in enumerate(walls):
        out.extend(_corner(walls[i - 1], wall, cut, gains[i]))
        out.extend(_bays(wall, taken[i], margin, inset))
    return out


class _Wall:
    """A directed wall with the building on its left."""

    __slots__ = ("dx", "dy", "length", "x", "y")

    def __init__(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.x, self.y = start
        self.length = hypot(end[0] - self.x, end[1] - self.y)
        self.dx, self.dy = (end[0] - self.x) / self.length, (end[1] - self.y) / self.length

    def at(self, along: float, into: float) -> tuple[float, float]:
        """The point `along` metres from the start and `into` metres into the building."""
        return (
            self.x + along * self.dx - into * self.dy,
            self.y + along * self.dy + into * self.dx,
        )


def _corner(before: _Wall, after: _Wall, cut: float, gain: int) -> Ring:
    start, end = before.at(before.length - cut, 0.0), after.at(cut, 0.0)
    if gain == 0:
        return [(after.x, after.y)]
    if gain == 1:
        return [start, end]
    # the fourth corner of the square that start, the old corner and end span
    x, y = start[0] + end[0] - after.x, start[1] + end[1] - after.y
    return [start, (x, y), end]


def _bays(wall: _Wall, count: int, margin: float, inset: float) -> Ring:
    out: Ring = []
    if count < 1:
        return out
    slot = (wall.length - 2 * margin) / count
    for k in range(count):
        a, b = margin + (k + 0.25) * slot, margin + (k + 0.75) * slot
        out += [wall.at(a, 0.0), wall.at(a, inset), wall.at(b, inset), wall.at(b, 0.0)]
    return out
