"""Ear clipping by mapbox_earcut. It drops collinear vertices, so it may leave T-junctions."""

import mapbox_earcut
import numpy as np

from triangulators.polygon import Boundary


def triangulate(outline: Boundary) -> np.ndarray:
    """Return earcut's triangles, (m, 3)."""
    return mapbox_earcut.triangulate_float64(outline.points, outline.ends).reshape(-1, 3)
