"""The optimum of a small polygon over all its triangulations, in integers.

No code or method is shared with the product: separating lines decide whether triangles
overlap, and the boundary is tested only by vertices, crossings and centroids.
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
"""A name, or a function from the vertices of a triangle to its cost."""


def scale_to_integers(rings: list[list[list[float]]]) -> tuple[list[list[Point]], Fraction]:
    """Return the rings as integer multiples of a step, and the step."""
    numbers = [Fraction(x) for ring in rings for point in ring for x in point]
    steps = math.lcm(*(x.denominator for x in numbers))
    scaled = [[(int(Fraction(x) * steps), int(Fraction(y) * steps)) for x, y in r] for r in rings]
    return scaled, Fraction(1, steps)


def find_side(p: Point, q: Point, v: Point) -> int:
    """Return 1 if v is left of the line from p to q, 0 on it and -1 right of it."""
    cross = (q[0] - p[0]) * (v[1] - p[1]) - (q[1] - p[1]) * (v[0] - p[0])
    return (cross > 0) - (cross < 0)


class SmallPolygon:
    """A valid polygon of few vertices, as rings of [x, y]; coincident vertices are merged."""

    def __init__(self, rings: list[list[list[float]]]) -> None:
        self.rings, self.step = scale_to_integers(rings)
        self.points = list(dict.fromkeys(point for ring in self.rings for point in ring))
        index_of = {point: index for index, point in enumerate(self.points)}
        self.vertex_of = [index_of[point] for ring in self.rings for point in ring]
        self.boundary = [wall for ring in self.rings for wall in pairwise([*ring, ring[0]])]
        indices = range(len(self.points))
        oriented = (t if self._turn(t) > 0 else t[::-1] for t in combinations(indices, 3))
        self.triangles = [t for t in oriented if self._empty(t)]
        self.area2 = abs(_area2(self.rings[0])) - sum(abs(_area2(r)) for r in self.rings[1:])

    def _turn(self, t: Iterable[int]) -> int:
        return find_side(*(self.points[v] for v in t))

    def _empty(self, t: Triangle) -> bool:
        a, b, c = corners = [self.points[v] for v in t]
        if find_side(a, b, c) <= 0:
            return False
        sides = ((a, b), (b, c), (c, a))
        other_vertices = (v for v in self.points if v not in corners)
        if any(all(find_side(*side, v) >= 0 for side in sides) for v in other_vertices):
            return False
        if any(_cross(*side, *wall) for side in sides for wall in self.boundary):
            return False
        x, y = a[0] + b[0] + c[0], a[1] + b[1] + c[1]  # three times the centroid
        inside = False
        for (px, py), (qx, qy) in self.boundary:
            if (3 * py > y) != (3 * qy > y):
                inside ^= (find_side((3 * px, 3 * py), (3 * qx, 3 * qy), (x, y)) > 0) == (qy > py)
        return inside

    def cost(self, t: Triangle, criterion: Criterion) -> Fraction:
        """Return the cost of a triangle: H and A exactly, E to 2^-60 steps."""
        a, b, c = (self.points[v] for v in t)
        if callable(criterion):
            return Fraction(
                criterion([(float(x * self.step), float(y * self.step)) for x, y in (a, b, c)])
            )
        if criterion == "edge-length":
            squares = ((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 for p, q in ((a, b), (b, c), (c, a)))
            return self.step * Fraction(sum(math.isqrt(s << 120) for s in squares), 2**60)
        width = max(a[0], b[0], c[0]) - min(a[0], b[0], c[0])
        height = max(a[1], b[1], c[1]) - min(a[1], b[1], c[1])
        if criterion == "half-perimeter":
            return self.step * (width + height)
        return self.step**2 * (width * height - Fraction(abs(_area2([a, b, c])), 2))

    def covers(self, triangles: list[Triangle]) -> bool:
        """Return whether counter-clockwise triangles are a triangulation of the polygon."""
        allowed = {frozenset(t) for t in self.triangles}
        area = sum(_area2([self.points[v] for v in t]) for t in triangles)
        return (
            area == self.area2
            and all(frozenset(t) in allowed and self._turn(t) > 0 for t in triangles)
            and not any(self._overlap(*pair) for pair in combinations(triangles, 2))
        )

    def _overlap(self, first: Triangle, second: Triangle) -> bool:
        """Return whether no side of either triangle separates them."""
        for t, other in ((first, second), (second, first)):
            for side in list_sides(t):
                p, q = (self.points[v] for v in side)
                if all(find_side(p, q, self.points[v]) <= 0 for v in other):
                    return False
        return True

    def optimum(
        self, criterion: Criterion, without: Collection[frozenset[int]] = ()
    ) -> tuple[Fraction, list[Triangle]] | None:
        """Return the minimum cost and an optimal triangulation without some edges, or None."""
        allowed = [t for t in self.triangles if not any(edge <= set(t) for edge in without)]
        costs = [self.cost(t, criterion) for t in allowed]
        behind: dict[Side, list[int]] = defaultdict(list)
        for number, t in enumerate(allowed):
            for side in list_sides(t):
                behind[side].append(number)

        @cache
        def overlapping(number: int) -> int:
            return sum(1 << k for k, t in enumerate(allowed) if self._overlap(allowed[number], t))

        solved: dict[frozenset[Side], tuple[Fraction, int] | None] = {frozenset(): (Fraction(0), 0)}

        def fill(front: frozenset[Side], covered: int) -> tuple[Fraction, int] | None:
            if front in solved:  # the unfilled area depends only on the front
                return solved[front]
            side = min(front)
            best = None
            for number in behind[side]:
                if covered >> number & 1:
                    continue
                after = set(front)
                for p, q in list_sides(allowed[number]):
                    if (p, q) in after:
                        after.discard((p, q))
                    else:
                        after.add((q, p))
                remainder = fill(frozenset(after), covered | overlapping(number))
                if remainder is not None:
                    solution = costs[number] + remainder[0], remainder[1] | 1 << number
                    best = min(best or solution, solution, key=lambda pair: pair[0])
            solved[front] = best
            return best

        solution = fill(frozenset(self._front()), 0)
        if solution is None:
            return None
        return solution[0], [t for k, t in enumerate(allowed) if solution[1] >> k & 1]

    def _front(self) -> list[Side]:
        """Return the boundary as sides between vertices, with the interior on the left."""
        index_of = {point: index for index, point in enumerate(self.points)}
        pieces = []
        for index, ring in enumerate(self.rings):
            interior_left = (_area2(ring) > 0) == (index == 0)
            ring = ring if interior_left else ring[::-1]
            for p, q in pairwise([*ring, ring[0]]):
                on = [v for v in self.points if find_side(p, q, v) == 0 and _within(v, p, q)]
                on.sort(key=lambda v: abs(v[0] - p[0]) + abs(v[1] - p[1]))
                pieces += [(index_of[a], index_of[b]) for a, b in pairwise(on) if a != b]
        return pieces


def list_sides(t: Triangle) -> tuple[Side, Side, Side]:
    return (t[0], t[1]), (t[1], t[2]), (t[2], t[0])


def _area2(ring: list[Point]) -> int:
    return sum(p[0] * q[1] - q[0] * p[1] for p, q in pairwise([*ring, ring[0]]))


def _within(v: Point, p: Point, q: Point) -> bool:
    return all(min(p[i], q[i]) <= v[i] <= max(p[i], q[i]) for i in (0, 1))


def _cross(p: Point, q: Point, r: Point, s: Point) -> bool:
    return (
        find_side(p, q, r) * find_side(p, q, s) < 0 and find_side(r, s, p) * find_side(r, s, q) < 0
    )
