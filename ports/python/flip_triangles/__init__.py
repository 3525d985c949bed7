"""Flips of the diagonals of a triangulated polygon, so that it is cheaper to draw.

The functions return the same triangles as `triangulators.flip`, and need only numpy.
"""

from typing import Any

import numpy as np

from flip_triangles import _flip

TESTS, ORDERS = ("l1", "euclidean", "delaunay", "expected-quads"), ("walk", "native")


def flip(
    points: Any, triangles: Any, by: str = "l1", order: str = "walk", scale: float = 1.0
) -> np.ndarray:
    """Flip the diagonals of existing triangles while a flip gains.

    Parameters
    ----------
    points
        (n, 2) float64, or integers up to 2^53.
    triangles
        (m, 3) or (3 m,) indices, all of the same orientation.
    by
        "l1" flips to diagonals with less abs(dx) + abs(dy), "euclidean" to shorter ones,
        "delaunay" to empty circumcircles, "expected-quads" to fewer quads of 2x2 pixels.
    order
        "walk" puts the result in an order from neighbour to neighbour, in which a GPU transforms
        few vertices twice; "native" leaves a flip's two triangles at the positions of the old two.
    scale
        For "expected-quads", pixels per unit of the points.

    Returns
    -------
    ndarray
        (m, 3) int32.

    Raises
    ------
    ValueError
        If a shape, an index, a name or the scale is invalid.

    Examples
    --------
    >>> kite = np.array([(0, 0), (2, -1), (9, 0), (2, 1)])
    >>> flip(kite, np.array([(0, 1, 2), (0, 2, 3)])).tolist()
    [[0, 1, 3], [3, 1, 2]]
    """
    coordinates = np.ascontiguousarray(points, dtype=np.float64)
    if coordinates.ndim != 2 or coordinates.shape[1] != 2:
        raise ValueError(f"flip: points have shape {coordinates.shape}, expected (n, 2)")
    for name, names in ((by, TESTS), (order, ORDERS)):
        if name not in names:
            raise ValueError(f"flip: unknown name {name!r} (choose from {', '.join(names)})")
    if not 0.0 < scale < np.inf:
        raise ValueError(f"flip: scale must be a positive number, not {scale}")
    rows = _copy_rows(triangles)
    _flip.flip(rows, coordinates, TESTS.index(by), order == "walk", scale)
    return rows


def reorder(triangles: Any, points: int) -> np.ndarray:
    """Return triangles, (m, 3) int32, in a walk from neighbour to neighbour.

    Parameters
    ----------
    triangles
        (m, 3) or (3 m,) indices below `points`, all of the same orientation.
    points
        Number of points.

    Examples
    --------
    >>> reorder([(0, 1, 2), (2, 3, 4), (0, 2, 3)], 5).tolist()
    [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    """
    rows = _copy_rows(triangles)
    _flip.reorder(rows, points)
    return rows


def _copy_rows(triangles: Any) -> np.ndarray:
    """Return a copy of triangles as (m, 3) int32; raises ValueError for other shapes and types."""
    indices = np.asarray(triangles)
    if indices.ndim == 1 and indices.size % 3 == 0:
        indices = indices.reshape(-1, 3)
    if indices.ndim != 2 or indices.shape[1] != 3:
        raise ValueError(f"triangles have shape {indices.shape}, expected (m, 3)")
    if indices.size and indices.dtype.kind not in "iu":
        raise ValueError(f"triangles are {indices.dtype}, expected integer indices")
    rows = indices.astype(np.int32)
    if not np.array_equal(rows, indices):
        raise ValueError("triangles have an index out of range")
    return rows
