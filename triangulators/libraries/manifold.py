"""The triangulator of manifold3d: ear clipping that tolerates imprecise input."""

import numpy as np

from triangulators.errors import TriangulationError
from triangulators.polygon import Boundary, signed_area


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3)."""
    import manifold3d

    rings, indices = [], []
    start = 0
    for number, end in enumerate(outline.ends.tolist()):
        ring = np.arange(start, end)
        if (signed_area(outline.points[start:end]) > 0.0) != (number == 0):
            ring = ring[::-1]  # exterior counter-clockwise, holes clockwise
        rings.append(np.ascontiguousarray(outline.points[ring]))
        indices.append(ring)
        start = end
    try:
        triangles = manifold3d.triangulate(rings)
    except RuntimeError as error:
        raise TriangulationError(f"manifold: {error}") from error
    return np.concatenate(indices)[np.asarray(triangles, dtype=np.int64)].reshape(-1, 3)
