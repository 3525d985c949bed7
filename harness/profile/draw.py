"""A draw of the design of a profile."""

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, make_bare_frame
from harness.grid import SUBPIXEL
from harness.profile.placing import SIDE


@dataclass(frozen=True)
class Draw:
    """One draw of the design.

    kind : see the tables of `design` and `stage_draws`; name : description of the draw
    group : name of the draws that differ only in the terms that their kind isolates
    frame, triangles : the geometry, (m, 3) indices of the frame's points
    work : rounds of arithmetic of a fragment
    aspect, area : base / height, and area in px^2, of draws of the kind aspect; else 0
    """

    kind: str
    name: str
    group: str
    frame: Frame
    triangles: NDArray[np.int32]
    work: int = 0
    aspect: int = 0
    area: int = 0

    @property
    def checksum(self) -> int:
        """CRC-32 of the points, then the triangles, as little-endian 32-bit integers."""
        parts = (self.frame.points, self.triangles)
        return zlib.crc32(b"".join(np.ascontiguousarray(part, "<i4").tobytes() for part in parts))


def make_unshared_triangles(corners: NDArray[np.int32]) -> tuple[Frame, NDArray[np.int32]]:
    """Return (m, 3, 2) triangles with three separate vertices each."""
    rows = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return make_bare_frame(SIDE, corners.reshape(-1, 2)), rows


def make_jittered_mesh(
    across: int, along: int, side: int, numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return vertices (n, 2) and triangles (2 * across * along, 3) of a mesh of squares.

    The mesh starts at (4, 4) px. Each square of `side`/256 px is two triangles; triangles of a row
    follow each other in a strip.

    numbers : (across + 1) * (along + 1) hashes, which move each vertex by less than half a side
    """
    line = across + 1
    row, column = np.divmod(np.arange(line * (along + 1)), line)
    room = side // 2
    jitter = np.stack([numbers % room, numbers // SUBPIXEL % room], axis=-1)
    points = 4 * SUBPIXEL + np.stack([column, row], axis=-1) * side + jitter
    row, column = np.divmod(np.arange(across * along), across)
    corner = row * line + column
    up = corner + line
    halves = [np.stack([corner, corner + 1, up], -1), np.stack([corner + 1, up + 1, up], -1)]
    triangles = np.stack(halves, 1).reshape(-1, 3)
    return points.astype(np.int32), triangles.astype(np.int32)
