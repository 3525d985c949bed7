"""The recursion of the paper (Kryvda and Sulema) that finds all triangulations by cutting ears.

From each starting vector of the remaining polygon three cuts are tried: the triangle of the start
and the next vector (the paper's firstPart), that of the previous vector and the one before
(secondPart), and both (thirdPart). A cut is allowed if its triangle lies inside; what is left is
treated in the same way until one triangle remains. The set of distinct results is kept.
"""

from collections.abc import Sequence

import numpy as np

from triangulators.geometry.predicates import orient

Triangle = tuple[int, int, int]
Triangulation = frozenset[Triangle]
Corners = tuple[int, ...]


class Recursion:
    """All triangulations of the polygons over one set of points.

    points: (n, 2). drop_straight: drop a vertex that a cut has made straight, as the paper's
    program did; triangulations that passed it by are then not conforming.
    """

    def __init__(self, points: np.ndarray, *, drop_straight: bool) -> None:
        self._points = points.tolist()
        self._drop_straight = drop_straight
        self._known: dict[Corners, set[Triangulation]] = {}
        self._turns: dict[Triangle, float] = {}

    def all(self, cycle: Sequence[int]) -> set[Triangulation]:
        """Return the distinct triangulations of a counter-clockwise cycle of points."""
        return self._of(_least_first(list(cycle)))

    def _of(self, corners: Corners) -> set[Triangulation]:
        if corners in self._known:
            return self._known[corners]
        found: set[Triangulation] = set()
        if len(corners) == 3:
            if self._turn(*corners) > 0.0:
                a, b, c = corners
                found.add(frozenset({(a, b, c)}))
        else:
            n = len(corners)
            for start in range(n):
                first, second = corners[(start + 1) % n], corners[start - 1]
                for ears in ((first,), (second,), (first, second)):
                    found |= self._after(corners, ears)
        self._known[corners] = found
        return found

    def _after(self, corners: Corners, ears: tuple[int, ...]) -> set[Triangulation]:
        """Return the triangulations that begin by cutting these vertices off, in turn."""
        cut: set[Triangle] = set()
        for vertex in ears:
            if len(corners) == 3 or vertex not in corners:
                return set()
            at = corners.index(vertex)
            ear = (corners[at - 1], vertex, corners[(at + 1) % len(corners)])
            if not self._is_inside(ear, corners):
                return set()
            a, b, c = _least_first(list(ear))
            cut.add((a, b, c))
            corners = self._without(corners, at)
        return {frozenset(others | cut) for others in self._of(corners)}

    def _turn(self, a: int, b: int, c: int) -> float:
        """Return `orient` of three points, which is asked for in many of the remaining polygons."""
        found = self._turns.get((a, b, c))
        if found is None:
            found = orient(*self._points[a], *self._points[b], *self._points[c])
            self._turns[a, b, c] = found
        return found

    def _is_inside(self, ear: Triangle, corners: Corners) -> bool:
        """Whether a triangle turns left and no other corner lies in it or on its edges."""
        a, b, c = ear
        return self._turn(a, b, c) > 0.0 and all(
            min(self._turn(a, b, v), self._turn(b, c, v), self._turn(c, a, v)) < 0.0
            for v in corners
            if v not in ear
        )

    def _without(self, corners: Corners, at: int) -> Corners:
        rest = [*corners[at + 1 :], *corners[:at]]
        if self._drop_straight:
            # Only the neighbours of what was cut off can have become straight: the ends of `rest`.
            while len(rest) > 3 and self._turn(rest[-1], rest[0], rest[1]) == 0.0:
                rest.pop(0)
            while len(rest) > 3 and self._turn(rest[-2], rest[-1], rest[0]) == 0.0:
                rest.pop()
        return _least_first(rest)


def _least_first(corners: list[int]) -> Corners:
    """Turn a cycle so that it starts with its least index."""
    least = corners.index(min(corners))
    return (*corners[least:], *corners[:least])
