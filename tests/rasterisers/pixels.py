"""Coverage once more, pixel by pixel in Python integers: what counters are tested against."""

from __future__ import annotations

import numpy as np

SIZE = 16


def covered(corners) -> np.ndarray:
    """Evaluate the edge functions of one triangle at every pixel centre, (SIZE, SIZE) bool."""
    a, b, c = [(int(x), int(y)) for x, y in corners]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0:
        return np.zeros((SIZE, SIZE), bool)
    ring = [a, b, c] if area > 0 else [a, c, b]

    def inside(x, y):
        for k in range(3):
            (x0, y0), (x1, y1) = ring[k], ring[(k + 1) % 3]
            dx, dy = x1 - x0, y1 - y0
            side = dx * (256 * y + 128 - y0) - dy * (256 * x + 128 - x0)
            if side < 0 or (side == 0 and not (dy < 0 or (dy == 0 and dx > 0))):
                return False
        return True

    return np.array([[inside(x, y) for x in range(SIZE)] for y in range(SIZE)])


def blocks_touched(mask: np.ndarray, side: int) -> int:
    return int(mask.reshape(SIZE // side, side, SIZE // side, side).any(axis=(1, 3)).sum())
