"""The optimum of a small polygon, of all triangulations there are, in whole numbers.

It shares no code and no idea with the product: triangles are kept apart by separating lines, and
the boundary is only looked at through vertices, crossings and centroids.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable
from fractions import Fraction
from functools import cache
from itertools import combinations, pairwise

Point = tuple[int, int]
Triangle = tuple[int, int, int]
Side = tuple[int, int]
Criterion = str | Callable[[list[tuple[float, float]]], float]
"""A name, or the cost of a triangle by its corners."""


def on_a_grid(rings: list[list[list[float]]]) -> tuple[list[list[Point]], Fraction]:
    """Return the rings in whole steps, and how long a step is."""
    numbers = [Fraction(x) for ring in rings for point in ring for x in point]
    steps = math.lcm(*(x.denominator for x in numbers))
    whole = [[(int(Fraction(x) * steps), int(Fraction(y) * steps)) for x, y in r] for r in rings]
    return whole, Fraction(1, steps)


def side_of(p: Point, q: Point, v: Point) -> int:
    """Return 1 if v is left of the line from p to q, 0 on it and -1 right of it."""
    cross = (q[0] - p[0]) * (v[1] - p[1]) - (q[1] - p[1]) * (v[0] - p[0])
    return (cross > 0) - (cross < 0)


class Small:
    """A valid polygon of few vertices, given as rings of [x, y]; vertices in one place are one."""

    def __init__(self, rings: list[list[list[float]]]) -> None:
        self.rings, self.step = on_a_grid(rings)
        self.at = list(dict.fromkeys(point for ring in self.rings for point in ring))
        number = {point: place for place, point in enumerate(self.at)}
        self.vertex = [number[point] for ring in self.rings for point in ring]
        self.walls = [wall for ring in self.rings for wall in pairwise([*ring, ring[0]])]
        corners = range(len(self.at))
        turned = (t if self._turn(t) > 0 else t[::-1] for t in combinations(corners, 3))
        self.triangles = [t for t in turned if self._empty(t)]
        self.area2 = abs(_area2(self.rings[0])) - sum(abs(_area2(r)) for r in self.rings[1:])

    def _turn(self, t: Iterable[int]) -> int:
        return side_of(*(self.at[v] for v in t))

    def _empty(self, t: Triangle) -> bool:
        a, b, c = corners = [self.at[v] for v in t]
        if side_of(a, b, c) <= 0:
            return False
        sides = ((a, b), (b, c), (c, a))
        others = (v for v in self.at if v not in corners)
        if any(all(side_of(*side, v) >= 0 for side in sides) for v in others):
            return False
        if any(_cross(*side, *wall) for side in sides for wall in self.walls):
            return False
        x, y = a[0] + b[0] + c[0], a[1] + b[1] + c[1]  # three times the centroid
        inside = False
        for (px, py), (qx, qy) in self.walls:
            if (3 * py > y) != (3 * qy > y):
                inside ^= (side_of((3 * px, 3 * py), (3 * qx, 3 * qy), (x, y)) > 0) == (qy > py)
        return inside

    def cost(self, t: Triangle, criterion: Criterion) -> Fraction:
        """Return what a triangle costs: H and A exactly, E to 2^-60 of a step."""
        a, b, c = (self.at[v] for v in t)
        if callable(criterion):
            return Fraction(
                criterion([(float(x * self.step), float(y * self.step)) for x, y in (a, b, c)])
            )
        if criterion == "edge-length":
            squares = ((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 for p, q in ((a, b), (b, c), (c, a)))
            return self.step * Fraction(sum(math.isqrt(s << 120) for s in squares), 2**60)
        wide = max(a[0], b[0], c[0]) - min(a[0], b[0], c[0])
        high = max(a[1], b[1], c[1]) - min(a[1], b[1], c[1])
        if criterion == "half-perimeter":
            return self.step * (wide + high)
        return self.step**2 * (wide * high - Fraction(abs(_area2([a, b, c])), 2))

    def covers(self, triangles: list[Triangle]) -> bool:
        """Whether triangles, each turning left, are a triangulation of the polygon."""
        places = {frozenset(t) for t in self.triangles}
        area = sum(_area2([self.at[v] for v in t]) for t in triangles)
        return (
            area == self.area2
            and all(frozenset(t) in places and self._turn(t) > 0 for t in triangles)
            and not any(self._overlap(*pair) for pair in combinations(triangles, 2))
        )

    def _overlap(self, one: Triangle, two: Triangle) -> bool:
        """Whether no side of either has the other beyond it."""
        for t, other in ((one, two), (two, one)):
            for p, q in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0])):
                if all(side_of(self.at[p], self.at[q], self.at[v]) <= 0 for v in other):
                    return False
        return True

    def optimum(
        self, criterion: Criterion, without: Collection[frozenset[int]] = ()
    ) -> tuple[Fraction, list[Triangle]] | None:
        """Return the least cost and a triangulation that has it, of those without some edges."""
        use = [t for t in self.triangles if not any(edge <= set(t) for edge in without)]
        prices = [self.cost(t, criterion) for t in use]
        behind: dict[Side, list[int]] = defaultdict(list)
        for number, t in enumerate(use):
            for side in sides_of(t):
                behind[side].append(number)

        @cache
        def overlapping(number: int) -> int:
            return sum(1 << k for k, t in enumerate(use) if self._overlap(use[number], t))

        known: dict[frozenset[Side], tuple[Fraction, int] | None] = {frozenset(): (Fraction(0), 0)}

        def rest(front: frozenset[Side], taken: int) -> tuple[Fraction, int] | None:
            if front in known:  # what is left to fill is on its left, whatever has been taken
                return known[front]
            side = min(front)
            best = None
            for number in behind[side]:
                if taken >> number & 1:
                    continue
                after = set(front)
                for p, q in sides_of(use[number]):
                    if (p, q) in after:
                        after.discard((p, q))
                    else:
                        after.add((q, p))
                more = rest(frozenset(after), taken | overlapping(number))
                if more is not None and (best is None or prices[number] + more[0] < best[0]):
                    best = prices[number] + more[0], more[1] | 1 << number
            known[front] = best
            return best

        found = rest(frozenset(self._front()), 0)
        if found is None:
            return None
        return found[0], [t for k, t in enumerate(use) if found[1] >> k & 1]

    def _front(self) -> list[Side]:
        """Return the boundary's pieces between vertices, the interior on their left."""
        number = {point: place for place, point in enumerate(self.at)}
        pieces = []
        for place, ring in enumerate(self.rings):
            left = (_area2(ring) > 0) == (place == 0)
            ring = ring if left else ring[::-1]
            for p, q in pairwise([*ring, ring[0]]):
                on = [v for v in self.at if side_of(p, q, v) == 0 and _within(v, p, q)]
                on.sort(key=lambda v: abs(v[0] - p[0]) + abs(v[1] - p[1]))
                pieces += [(number[a], number[b]) for a, b in pairwise(on) if a != b]
        return pieces


def sides_of(t: Triangle) -> tuple[Side, Side, Side]:
    """Return a triangle's sides, in the way in which they are run."""
    return (t[0], t[1]), (t[1], t[2]), (t[2], t[0])


def _area2(ring: list[Point]) -> int:
    return sum(p[0] * q[1] - q[0] * p[1] for p, q in pairwise([*ring, ring[0]]))


def _within(v: Point, p: Point, q: Point) -> bool:
    return all(min(p[i], q[i]) <= v[i] <= max(p[i], q[i]) for i in (0, 1))


def _cross(p: Point, q: Point, r: Point, s: Point) -> bool:
    return side_of(p, q, r) * side_of(p, q, s) < 0 and side_of(r, s, p) * side_of(r, s, q) < 0
