"""Which sites of a polygon see each other: the edges that a triangulation may be made of."""

from typing import NamedTuple

import numpy as np

from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.visibility import visible_sites
from triangulators.polygon import Boundary


class Sight(NamedTuple):
    """Edges of a polygon: pairs of sites that see each other, or pieces of the boundary.

    points (n, 2). edges (e, 2): pairs a < b, in ascending order; side (e,): 1 where a-b is a
    boundary edge with the interior on its left, -1 where b-a is, 0 for a diagonal. rings (h, 4):
    sites of each hole (see `holds_ring` of `candidates`).
    """

    points: np.ndarray
    edges: np.ndarray
    side: np.ndarray
    rings: np.ndarray


def sight_of(outline: Boundary, triangles: np.ndarray) -> Sight:
    """Return the edges of a polygon.

    triangles: (m, 3), any triangulation of it, between sites; what each corner sees is found by
    walking it.
    """
    points = outline.points
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    pairs = visible_sites(points, triangles, twins_of(triangles))
    edges = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    side = _sides_of_boundary(edges, outline.edges, len(points))
    return Sight(points, edges, side, _ring_samples(outline))


def _sides_of_boundary(edges: np.ndarray, boundary: np.ndarray, count: int) -> np.ndarray:
    side = np.zeros(len(edges), dtype=np.int8)
    keys = edges[:, 0].astype(np.int64) * count + edges[:, 1]
    low, high = boundary.min(axis=1).astype(np.int64), boundary.max(axis=1)
    side[np.searchsorted(keys, low * count + high)] = np.where(
        boundary[:, 0] < boundary[:, 1], 1, -1
    )
    return side


def _ring_samples(outline: Boundary) -> np.ndarray:
    """Return up to four sites of each hole, (h, 4), the last one repeated.

    A hole meets a triangle of candidate edges at its corners only, so it lies inside as a whole
    or not at all; that one of four sites which is not a corner tells.
    """
    samples = np.zeros((outline.holes, 4), dtype=np.int32)
    for number, (begin, end) in enumerate(zip(outline.ends, outline.ends[1:], strict=False)):
        ring = list(dict.fromkeys(outline.site[begin:end].tolist()))[:4]
        samples[number] = ring + ring[-1:] * (4 - len(ring))
    return samples
