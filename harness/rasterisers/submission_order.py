"""The order in which triangles are submitted, the same for every rasteriser.

Caches and early tests of a rasteriser depend on it, so it is a recorded factor of a case.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from harness.frame import Frame
    from scenes.scene import Viewing

Triangles = NDArray[np.int32]

Order = Literal["native", "walk", "vertex-cache", "morton", "shuffled"]
"""In which triangles are submitted; `base.Options` says what each means."""
ORDERS: tuple[Order, ...] = get_args(Order)

_SPREAD = (
    (16, 0x0000FFFF0000FFFF),
    (8, 0x00FF00FF00FF00FF),
    (4, 0x0F0F0F0F0F0F0F0F),
    (2, 0x3333333333333333),
    (1, 0x5555555555555555),
)


class Ordering(Protocol):
    """The part of a case's options that decides on the order."""

    @property
    def order(self) -> Order:
        """One of `ORDERS`."""

    @property
    def seed(self) -> int:
        """Seed of the shuffle."""


def submission(frame: Frame, triangles: Triangles, options: Ordering) -> Triangles:
    """Check `triangles` (m, 3) and return them, contiguous, in the order of submission.

    Tiles and views stay one after another; within each, triangles are ordered. Of a model's views
    the native order is the model's, or front to back.

    Raises
    ------
    ValueError
        if `triangles` is not an integer (m, 3) array of vertices of the frame
    """
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"triangles must be an integer (m, 3) array, not {array.shape}")
    if len(array) and not (array.min() >= 0 and array.max() < len(frame.points)):
        raise ValueError(f"a triangle names a vertex outside 0..{len(frame.points) - 1}")
    if frame.viewing is not None and options.order == "native":
        view = np.searchsorted(frame.viewing.first, frame.owner(array), side="right")
        array = array[np.lexsort((_places(frame, frame.viewing, array), view))]
    elif frame.tiles is None:
        array = _ordered(frame, array, options)
    else:
        tiles = [_ordered(frame, array[rows], options) for rows in frame.draws(array)]
        array = np.concatenate(tiles)
    return np.ascontiguousarray(array, np.int32)


def _places(frame: Frame, viewing: Viewing, array: Triangles) -> NDArray[np.int64]:
    """(m,) where each triangle, piece by piece in `array`, is in the order of its view.

    The k-th triangle of a face takes the place of the k-th that the model has there.
    """
    if viewing.near_first and viewing.depths is not None:
        return np.asarray(viewing.depths[array].astype(np.int64).sum(axis=1))
    owner = frame.owner(array)
    ordered = np.argsort(owner, kind="stable")
    number = np.empty(len(array), np.int64)
    number[ordered] = np.arange(len(array)) - np.searchsorted(owner[ordered], owner[ordered])
    starts = viewing.rank_starts
    last = np.diff(starts)[owner] - 1
    return np.asarray(viewing.ranks[starts[owner] + np.minimum(number, last)])


def _ordered(frame: Frame, array: Triangles, options: Ordering) -> Triangles:
    if options.order == "walk":
        from triangulators.geometry.order import walk

        return walk(array, len(frame.points))
    if options.order == "vertex-cache":
        from triangulators.geometry.vertex_cache import vertex_cache_order

        return vertex_cache_order(array, len(frame.points))
    if options.order == "morton":
        return array[np.argsort(_morton(frame, array), kind="stable")]
    if options.order == "shuffled":
        return np.random.default_rng(options.seed).permutation(array)
    return array


def _morton(frame: Frame, triangles: Triangles) -> NDArray[np.uint64]:
    """Interleave the bits of each triangle's centre: (m,) positions along a Z-order curve."""
    centre = frame.points[triangles].astype(np.int64).sum(axis=1) // 3
    x, y = np.maximum(centre, 0).astype(np.uint64).T
    return _spread(x) | (_spread(y) << np.uint64(1))


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put a zero bit between any two of the low 32 bits."""
    for shift, mask in _SPREAD:
        value = (value | (value << np.uint64(shift))) & np.uint64(mask)
    return value
