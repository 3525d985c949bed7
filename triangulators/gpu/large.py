"""Rings of up to 2,048 corners on a device: tiles of a table in a buffer, diagonal by diagonal."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from triangulators.gpu.device_context import MAX_GROUPS, Compute, DeviceFailed, Storage
from triangulators.gpu.rings import LARGE, MOST, Rings
from triangulators.optimum.edge_table import most_squares
from triangulators.optimum.small_ring import SMALL

TILE = 32
"""Rows and columns of a tile: three of them are 13 KB of the 32 that every device shares."""

TABLES = 1 << 26
"""Pairs whose costs are on the device at a time: 256 MiB."""


class LargeRings:
    """Batches of large rings: uploaded, looked over, filled, traced."""

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self.corners, self.jobs, self.bases, self.table, self.seen = self._buffers = [
            Storage(compute, binding) for binding in range(5)
        ]

    def run(self, rings: Rings, which: np.ndarray, worst: bool, bases: np.ndarray) -> None:
        """Do the rings `which`; fill their part of bases (n,) uint32, see `found_triangles`."""
        for batch in batches(rings, which, min(TABLES, self._compute.storage // 4)):
            jobs = self.upload(rings, batch)
            columns = int(jobs[:, 4].max())
            wide = bool((rings.kind[batch] % 2).any())
            self.look(columns, len(batch), wide=wide, worst=worst)
            self.fill(columns, len(batch))
            self.trace(len(batch))
            found = np.empty(int(jobs[-1, :2].sum()), dtype=np.uint32)
            self.bases.read_into(found)
            self._compute.check("computing large rings")
            for index, (first, size) in zip(batch.tolist(), jobs[:, :2].tolist(), strict=True):
                begin = rings.begins[index]
                bases[begin : begin + size] = found[first : first + size]

    def upload(self, rings: Rings, which: np.ndarray) -> np.ndarray:
        """Bring rings to the device and make room for their tables; return their jobs (k, 8)."""
        begin, end = rings.begins[which], rings.begins[which + 1]
        jobs, pairs = jobs_of(rings, which)
        corners = [rings.corners[b:e] for b, e in zip(begin, end, strict=True)]
        count = int((end - begin).sum())
        self.corners.write(np.concatenate(corners))
        self.jobs.write(jobs)
        self.seen.write(np.zeros(count, dtype=np.uint32))
        self.bases.reserve(4 * count)
        self.table.reserve(4 * pairs)
        self.bind()
        return jobs

    def bind(self) -> None:
        """Let shaders see the buffers."""
        for buffer in self._buffers:
            buffer.bind()

    def look(self, rows: int, count: int, *, wide: bool, worst: bool) -> None:
        """Find who sees whom in the first `rows` rows of `count` tables, and what it costs."""
        how = {"WIDE": 1} if wide else {}
        program = self._program("visible.glsl", MOST=MOST, LANES=256, BLOCK=32, **how)
        program["worst"] = int(worst)
        self._compute.run(program, rows, count)

    def fill(self, columns: int, count: int) -> None:
        """Fill `count` tables of up to so many columns, a diagonal of tiles at a time."""
        program = self._program("tiles.glsl", TILE=TILE, LANES=TILE * TILE // 4)
        tiles = columns // TILE
        for away in range(tiles):
            program["away"] = away
            self._compute.run(program, tiles - away, count)

    def trace(self, count: int) -> None:
        """Find the triangles behind `count` tables."""
        self._compute.run(self._program("trace.glsl", MOST=MOST, LANES=256, CREW=64), count)

    def _program(self, name: str, **constants: int) -> Any:
        return self._compute.program("exact.glsl", "rings.glsl", name, **constants)


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
