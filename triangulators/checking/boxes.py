"""Boxes of sites, and whether one edge hides all of a box, for `visibility`.

Sites that are near each other are kept in boxes, and these in a tree of boxes. From a site a, a box
is passed over where all of it is behind one edge c-d of the boundary,

    turn(a, c, x) > 0,  turn(a, d, x) < 0,  turn(c, d, x) < 0   with a on the left of c-d.

These are half-planes, which are convex, so it is enough to ask the box's corners; orientations are
exact. The edges asked are those that hid something from a before: what is near hides much.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import orient

_BUCKET = 8  # sites in a box


def near_each_other(points: np.ndarray, sites: np.ndarray) -> np.ndarray:
    """Order sites along a Z-shaped curve, by the bits of x and y in turns (Morton order)."""
    low = points.min(axis=0)
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cells = np.floor((points[sites] - low) / size * 65535.0).astype(np.int64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << shift)) & mask
    return sites[np.argsort(cells[:, 0] | (cells[:, 1] << 1), kind="stable")]


@njit
def boxes_of(points: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return a binary tree of boxes (2 k, 2, 2), low and high corner: node i has 2 i and 2 i + 1.

    Node k + l holds the sites `order[8 l:8 l + 8]`; boxes of nothing have low > high.
    """
    leaves = 1
    while leaves * _BUCKET < len(order):
        leaves *= 2
    boxes = np.empty((2 * leaves, 2, 2))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for place in range(len(order)):
        node = leaves + place // _BUCKET
        while node > 0:
            for axis in range(2):
                x = points[order[place], axis]
                boxes[node, 0, axis] = min(boxes[node, 0, axis], x)
                boxes[node, 1, axis] = max(boxes[node, 1, axis], x)
            node //= 2
    return boxes


@njit
def places_of(node: int, leaves: int, count: int) -> tuple[int, int]:
    """Return the first place of a node's sites, and the one after the last."""
    span = _BUCKET
    while node < leaves:
        node *= 2
        span *= 2
    begin = (node - leaves) * _BUCKET
    return begin, min(begin + span, count)


@njit
def distance(points: np.ndarray, a: int, box: np.ndarray) -> float:
    """Return the squared distance of a site from a box."""
    x = max(box[0, 0] - points[a, 0], points[a, 0] - box[1, 0], 0.0)
    y = max(box[0, 1] - points[a, 1], points[a, 1] - box[1, 1], 0.0)
    return x * x + y * y


@njit
def is_hidden(points: np.ndarray, a: int, hiding: np.ndarray, count: int, box: np.ndarray) -> bool:
    """Whether all of a box is behind one of the first `count` edges of `hiding`; it goes first."""
    for place in range(count):
        c, d = hiding[place, 0], hiding[place, 1]
        if (
            _behind(points, a, c, d, box[0, 0], box[0, 1])
            and _behind(points, a, c, d, box[1, 0], box[1, 1])
            and _behind(points, a, c, d, box[0, 0], box[1, 1])
            and _behind(points, a, c, d, box[1, 0], box[0, 1])
        ):
            to_front(hiding, place)
            return True
    return False


@njit
def is_behind_one(points: np.ndarray, a: int, hiding: np.ndarray, count: int, b: int) -> bool:
    """Whether the site b is behind one of the first `count` edges of `hiding`; it goes first."""
    for place in range(count):
        c, d = hiding[place, 0], hiding[place, 1]
        if _behind(points, a, c, d, points[b, 0], points[b, 1]):
            to_front(hiding, place)
            return True
    return False


@njit
def _behind(points: np.ndarray, a: int, c: int, d: int, x: float, y: float) -> bool:
    """Whether the segment from a to (x, y) crosses the edge c-d, which has a on its left."""
    ax, ay, cx, cy = points[a, 0], points[a, 1], points[c, 0], points[c, 1]
    dx, dy = points[d, 0], points[d, 1]
    return (
        orient(cx, cy, dx, dy, x, y) < 0.0
        and orient(ax, ay, cx, cy, x, y) > 0.0
        and orient(ax, ay, dx, dy, x, y) < 0.0
    )


@njit
def to_front(hiding: np.ndarray, place: int) -> None:
    """Move an edge of `hiding` to the first place; those before it go one further."""
    c, d = hiding[place, 0], hiding[place, 1]
    for at in range(place, 0, -1):
        hiding[at] = hiding[at - 1]
    hiding[0, 0], hiding[0, 1] = c, d
