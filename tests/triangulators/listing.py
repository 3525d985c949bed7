"""Every triangulation of a small polygon with holes, written apart from the product.

The region that is left is known by its edges, which have it on their left. The lowest of them gets
each triangle in turn that fits; what follows for a region is remembered.
"""

from collections import defaultdict
from collections.abc import Callable
from functools import cache
from itertools import combinations, pairwise

import numpy as np
import shapely

from tests.triangulators.cases import twice_area

Edge = tuple[int, int]


def least_of_all(polygon: shapely.Polygon, cost: Callable[[np.ndarray], float]) -> float:
    """The least total of `cost`, of corners (3, 2), over all triangulations; integer vertices."""
    oriented = polygon.normalize().reverse()  # the exterior counter-clockwise, holes clockwise
    points = np.unique(shapely.get_coordinates(oriented), axis=0)
    apexes: dict[Edge, list[tuple[int, float]]] = defaultdict(list)
    for a, b, c in empty_triangles(polygon, points):
        price = cost(points[[a, b, c]])
        for tail, head, apex in ((a, b, c), (b, c, a), (c, a, b)):
            apexes[tail, head].append((apex, price))
    xy = points.tolist()

    @cache
    def rest(region: frozenset[Edge]) -> float:
        if not region:
            return 0.0
        a, b = min(region)
        best = np.inf
        for c, price in apexes[a, b]:
            after = without(xy, region, a, b, c)
            if after is not None:
                best = min(best, price + rest(after))
        return best

    return rest(frozenset(boundary_edges(oriented, points)))


def without(xy: list, region: frozenset[Edge], a: int, b: int, c: int) -> frozenset[Edge] | None:
    """The region without a triangle on its edge a-b; None if the triangle is not all in it."""
    after = set(region) - {(a, b)}
    for tail, head in ((b, c), (c, a)):
        if (tail, head) in region:
            after.discard((tail, head))
        elif (head, tail) in region or any(crosses(xy, tail, head, *edge) for edge in region):
            return None
        else:
            after.add((head, tail))
    return frozenset(after)


def crosses(xy: list, a: int, b: int, c: int, d: int) -> bool:
    apart = twice_area(xy[a], xy[b], xy[c]) * twice_area(xy[a], xy[b], xy[d]) < 0
    return apart and twice_area(xy[c], xy[d], xy[a]) * twice_area(xy[c], xy[d], xy[b]) < 0


def boundary_edges(oriented: shapely.Polygon, points: np.ndarray) -> list[Edge]:
    """Pieces of the rings, split where another ring touches them."""
    found = []
    for ring in (oriented.exterior, *oriented.interiors):
        for a, b in pairwise(shapely.get_coordinates(ring)):
            on = [k for k, point in enumerate(points) if between(a, b, point)]
            on.sort(key=lambda k: float(np.dot(points[k] - a, b - a)))
            found += list(pairwise(on))
    return found


def between(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> bool:
    """Whether a point lies on the closed segment a-b."""
    inside = (np.minimum(a, b) <= point).all() and (point <= np.maximum(a, b)).all()
    return bool(inside) and twice_area(a, b, point) == 0


def empty_triangles(polygon: shapely.Polygon, points: np.ndarray) -> list[tuple[int, int, int]]:
    """Triples, counter-clockwise, that lie in the polygon and hold none of its other points."""
    n = len(points)
    i, j = np.triu_indices(n, 1)
    inside = shapely.covers(polygon, shapely.linestrings(np.stack((points[i], points[j]), axis=1)))
    sees = set(zip(i[inside].tolist(), j[inside].tolist(), strict=True))
    xy = points.tolist()
    found = []
    for a, b, c in combinations(range(n), 3):
        turn = twice_area(xy[a], xy[b], xy[c])
        if turn == 0 or not {(a, b), (b, c), (a, c)} <= sees:
            continue
        p, q, r = (a, b, c) if turn > 0 else (a, c, b)
        others = (xy[k] for k in range(n) if k not in (a, b, c))
        holds = any(
            all(twice_area(xy[s], xy[t], other) >= 0 for s, t in ((p, q), (q, r), (r, p)))
            for other in others
        )
        if not holds and polygon.contains(shapely.Point(points[[a, b, c]].mean(axis=0))):
            found.append((p, q, r))
    return found
