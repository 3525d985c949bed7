"""Which of many triangulations have to be verified one by one."""

from collections.abc import Mapping

import numpy as np

from triangulators.batch.ragged import Ragged


def doubtful(arrays: Ragged, known: Mapping[int, np.ndarray]) -> list[int]:
    """Return the polygons whose (m, 3) triangles are not seen at once to be sound and conforming.

    known : triangles by the number of their polygon in `arrays`

    Seen at once: as many as there have to be, all counter-clockwise, and each side of one is either
    an edge of the polygon or the side of another, the other way round. All polygons are looked at
    together, at a few microseconds each; orientations are exact
    on a grid. Others may be right, too, such as those with T-junctions.
    """
    if not known:
        return []
    kept = np.array(list(known))
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    begins = rings[np.r_[0, arrays.polygon_ends].astype(np.int64)]
    holes = np.diff(np.r_[0, arrays.polygon_ends].astype(np.int64)) - 1
    sizes = np.diff(begins)
    owner = np.repeat(kept, [len(piece) for piece in known.values()])
    triangles = np.concatenate(list(known.values())).astype(np.int64)
    doubted = np.zeros(len(sizes), dtype=bool)
    counts = np.bincount(owner, minlength=len(sizes))
    doubted[kept] = (counts != sizes + 2 * holes - 2)[kept]
    inside = ((triangles >= 0) & (triangles < sizes[owner, None])).all(axis=1)
    doubted[owner[~inside]] = True
    corners = np.where(inside[:, None], triangles, 0) + begins[owner, None]
    a, b, c = arrays.coordinates[corners].transpose(1, 0, 2)
    u, v = b - a, c - a
    doubted[owner[~(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0)]] = True
    total = len(arrays.coordinates)
    after = np.arange(1, total + 1)
    after[rings[1:] - 1] = rings[:-1]
    outline = np.r_[np.arange(total) * total + after, after * total + np.arange(total)]
    sides = (corners * total + np.roll(corners, -1, axis=1)).ravel()
    turned = (np.roll(corners, -1, axis=1) * total + corners).ravel()
    found, first, times = np.unique(sides, return_index=True, return_counts=True)
    matched = _are_in(np.sort(outline), sides) | _are_in(found, turned)
    doubted[np.repeat(owner, 3)[~matched]] = True
    doubted[np.repeat(owner, 3)[first[times > 1]]] = True
    return np.flatnonzero(doubted).tolist()


def _are_in(ordered: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return which values are among (n,) ordered ones, n > 0.

    `np.isin` hashes, and these numbers, multiples with little added, collide: 20 times as slow.
    """
    places = np.searchsorted(ordered, values)
    found: np.ndarray = ordered[np.minimum(places, len(ordered) - 1)] == values
    return found
