"""Positions that single precision holds exactly, so that every viewer sees the same mesh.

Nearly all viewers keep 32-bit floats and round the numbers of a text file. If the file holds
rounded numbers, viewers that keep doubles read the same. Rounding moves every vertex by up to half
a step, which would change the area by some 1e-8 of it. So a few vertices are rounded the other way,
by less than a step, to keep the area.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.export.indexed_mesh import Mesh, plan_area

STEPS = 2**18
"""Fewest steps of single precision across a mesh: four millimetres in a kilometre, finer than
surveys of footprints. Coordinates far from the origin, as in a national grid, have fewer."""

Points = NDArray[np.float64]


def fits(vertices: Points) -> bool:
    """Whether single precision is fine enough for these (n, 2 or 3) coordinates."""
    if len(vertices) == 0:
        return True
    plan = vertices[:, :2]
    extent = float(np.ptp(plan, axis=0).max())
    return float(np.spacing(np.float32(np.abs(plan).max()))) * STEPS <= extent


def in_single(mesh: Mesh) -> Mesh:
    """The mesh with coordinates that are 32-bit floats; a flat one keeps its area."""
    rounded = mesh.vertices.astype(np.float32).astype(np.float64)
    if mesh.vertices.shape[1] == 2 or not mesh.vertices[:, 2].any():
        rounded[:, :2] = _level(mesh.vertices[:, :2], rounded[:, :2], mesh.triangles)
    return replace(mesh, vertices=rounded)


def _level(exact: Points, rounded: Points, triangles: NDArray[np.int64]) -> Points:
    """Round some coordinates the other way, so that the area is that of `exact`."""
    missing = plan_area(exact, triangles) - plan_area(rounded, triangles)
    away = np.where(exact > rounded, np.inf, -np.inf).astype(np.float32)
    other = np.nextafter(rounded.astype(np.float32), away).astype(np.float64)
    gains = np.where(exact == rounded, 0.0, (other - rounded) * _slope(rounded, triangles)).ravel()
    result = rounded.copy()
    # the largest first, each only if it is no more than what is still missing
    useful = np.flatnonzero(gains * missing > 0.0)
    for place in useful[np.argsort(-np.abs(gains[useful]))].tolist():
        if abs(gains[place]) <= abs(missing) and gains[place] * missing > 0.0:
            result.ravel()[place] = other.ravel()[place]
            missing -= gains[place]
    return result


def _slope(points: Points, triangles: NDArray[np.int64]) -> Points:
    """(n, 2), how much the area of counter-clockwise triangles grows with each coordinate."""
    slope = np.zeros_like(points)
    for corner in range(3):
        before, after = points[triangles[:, corner - 1]], points[triangles[:, corner - 2]]
        across = (after - before)[:, ::-1] * [0.5, -0.5]
        np.add.at(slope, triangles[:, corner], across)
    return slope
