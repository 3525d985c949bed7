"""Rings of up to 2,048 corners on a device: tiles of a table in a buffer, diagonal by diagonal."""

from collections.abc import Iterator

import numpy as np

from triangulators.edges import most_squares
from triangulators.gpu.context import MAX_GROUPS, Compute, DeviceFailed, Storage
from triangulators.gpu.rings import LARGE, MOST, Rings
from triangulators.small_ring import SMALL

TILE = 32
"""Rows and columns of a tile: three of them are 13 KB of the 32 that every device shares."""

TABLES = 1 << 26
"""Pairs whose costs are on the device at a time: 256 MiB."""


class LargeRings:
    """Batches of large rings."""

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self._corners, self._jobs, self._bases, self._table, self._seen = (
            Storage(compute, binding) for binding in range(5)
        )

    def run(self, rings: Rings, which: np.ndarray, worst: bool, bases: np.ndarray) -> None:
        """Do the rings `which`; fill their part of bases (n,) uint32, see `placing`."""
        for batch in batches(rings, which, min(TABLES, self._compute.storage // 4)):
            self._do(rings, batch, worst, bases)

    def _do(self, rings: Rings, which: np.ndarray, worst: bool, bases: np.ndarray) -> None:
        begin, end = rings.begins[which], rings.begins[which + 1]
        jobs, pairs = jobs_of(rings, which)
        corners = [rings.corners[b:e] for b, e in zip(begin, end, strict=True)]
        self._corners.write(np.concatenate(corners))
        self._jobs.write(jobs)
        count = int((end - begin).sum())
        self._seen.write(np.zeros(count, dtype=np.uint32))
        self._bases.reserve(4 * count)
        self._table.reserve(4 * pairs)
        for buffer in (self._corners, self._jobs, self._bases, self._table, self._seen):
            buffer.bind()
        self._dispatch(jobs, bool((rings.kind[which] % 2).any()), worst)
        found = np.empty(count, dtype=np.uint32)
        self._bases.read_into(found)
        self._compute.check("computing large rings")
        for job, b, e in zip(jobs[:, 0], begin, end, strict=True):
            bases[b:e] = found[job : job + e - b]

    def _dispatch(self, jobs: np.ndarray, wide: bool, worst: bool) -> None:
        compute, columns = self._compute, int(jobs[:, 4].max())
        how = {"WIDE": 1} if wide else {}
        names = ("exact.glsl", "rings.glsl")
        visible = compute.program(*names, "visible.glsl", MOST=MOST, LANES=64, BLOCK=32, **how)
        visible["worst"] = int(worst)
        compute.run(visible, columns, len(jobs))
        tiles = compute.program(*names, "tiles.glsl", TILE=TILE, LANES=TILE * TILE // 4)
        for away in range(columns // TILE):
            tiles["away"] = away
            compute.run(tiles, columns // TILE - away, len(jobs))
        trace = compute.program(*names, "trace.glsl", MOST=MOST, LANES=256, CREW=32)
        compute.run(trace, len(jobs))


def batches(rings: Rings, which: np.ndarray, pairs: int) -> Iterator[np.ndarray]:
    """Split rings, sorted by their size, so that no batch has more `pairs` in its tables.

    Raises `DeviceFailed` where a single ring has more.
    """
    sizes = np.diff(rings.begins)[which]
    order = np.argsort(sizes, kind="stable")
    which, area = which[order], _columns(sizes[order]) ** 2
    if len(area) and area[-1] > pairs:
        raise DeviceFailed(f"a table of {sizes.max():,} corners is more than its buffers hold")
    first = 0
    while first < len(which):
        sums = np.cumsum(area[first : first + MAX_GROUPS])
        last = first + int(np.searchsorted(sums, pairs, side="right"))
        yield which[first:last]
        first = last


def jobs_of(rings: Rings, which: np.ndarray) -> tuple[np.ndarray, int]:
    """Return what rings.glsl says of jobs, (k, 8) int32, and how many pairs their tables have."""
    size = np.diff(rings.begins)[which]
    columns = _columns(size)
    tables = np.r_[0, np.cumsum(columns**2)]
    jobs = np.zeros((len(which), 8), dtype=np.int32)
    jobs[:, 0] = np.cumsum(size) - size
    jobs[:, 1] = size
    jobs[:, 2] = rings.longest[which]
    jobs[:, 3] = tables[:-1]
    jobs[:, 4] = columns
    jobs[:, 5] = size > SMALL
    jobs[:, 6] = [int(most_squares(n)) for n in size.tolist()]
    return jobs, int(tables[-1])


def large(rings: Rings) -> np.ndarray:
    """Return the numbers of the rings that are done here."""
    return np.flatnonzero(rings.kind >= LARGE)


def _columns(size: np.ndarray) -> np.ndarray:
    return (size + TILE - 1) // TILE * TILE
