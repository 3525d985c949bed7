"""Rings of up to 64 corners on a device: chunk after chunk, a workgroup a ring."""

import numpy as np

from triangulators.gpu.device_context import MAX_GROUPS, Compute, Storage
from triangulators.gpu.rings import LARGE, SIZES, Rings

LANES = 32
"""Of a workgroup; twice as many for rings of more than 32 corners."""

CHUNK = 1 << 18
"""Corners that are on the device at a time: 2 MiB go there and 1 MiB comes back."""


class SmallRings:
    """Buffers for two chunks: while one is computed, the other one is taken down or brought up."""

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self._sets = [[Storage(compute, binding) for binding in range(3)] for _ in range(2)]

    def start(self, turn: int, rings: Rings, first: int, last: int, worst: bool) -> bool:
        """Upload the rings of polygons first..last - 1 and start them; False if none is small.

        turn: 0, 1, 0, 1, ...; what `turn` held is overwritten.
        """
        jobs = [jobs_of(rings, first, last, kind) for kind in range(LARGE)]
        if not any(map(len, jobs)):
            return False
        corners, job_list, bases = self._sets[turn % 2]
        own = rings.corners[rings.begins[first] : rings.begins[last]]
        corners.write(own)
        bases.reserve(4 * len(own))
        for kind, each in enumerate(jobs):
            if len(each):
                job_list.write(each)
                for buffer in (corners, job_list, bases):
                    buffer.bind()
                self._run(kind, len(each), worst)
        self._compute.check("computing small rings")
        return True

    def read(self, turn: int, bases: np.ndarray) -> None:
        """Wait for what `turn` started; fill bases (n,) uint32, as many as it has corners."""
        self._sets[turn % 2][2].read_into(bases)
        self._compute.check("reading small rings")

    def _run(self, kind: int, number: int, worst: bool) -> None:
        most = SIZES[kind // 2]
        constants = {"MOST": most, "LANES": max(LANES, most)} | ({"WIDE": 1} if kind % 2 else {})
        program = self._compute.program("exact.glsl", "small.glsl", **constants)
        program["number"], program["worst"] = number, int(worst)
        columns = min(number, MAX_GROUPS)
        self._compute.run(program, columns, -(-number // columns))


def jobs_of(rings: Rings, first: int, last: int, kind: int) -> np.ndarray:
    """Return (k, 4) int32: first corner in the chunk, corners, w + h and 0 of rings of a kind."""
    which = first + np.flatnonzero(rings.kind[first:last] == kind)
    begin = rings.begins[which]
    jobs = np.zeros((len(which), 4), dtype=np.int32)
    jobs[:, 0] = begin - rings.begins[first]
    jobs[:, 1] = rings.begins[which + 1] - begin
    jobs[:, 2] = rings.longest[which]
    return jobs
