"""Place polygons that have no common plane side by side, so that a scene can show them all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely


def in_rows(
    polygons: Sequence[shapely.Polygon], gap: float = 0.1, aspect: float = 1.0
) -> list[shapely.Polygon]:
    """The polygons, moved into rows from the top, in order, none touching another.

    `gap` is the space between them as a share of their mean width; `aspect` the wanted width to
    height of the whole.

    >>> row = in_rows([shapely.box(9, 9, 10, 10), shapely.box(5, 5, 6, 6)], gap=0.5, aspect=9)
    >>> [polygon.bounds for polygon in row]
    [(0.0, -1.0, 1.0, 0.0), (1.5, -1.0, 2.5, 0.0)]
    """
    if not polygons:
        return []
    bounds = shapely.bounds(np.asarray(polygons))
    sizes = bounds[:, 2:] - bounds[:, :2]
    space = gap * sizes.mean()
    width = max(np.sqrt(aspect * (sizes + space).prod(axis=1).sum()), sizes[:, 0].max())
    out, x, y, tallest = [], 0.0, 0.0, 0.0
    for polygon, (left, _, _, top), (w, h) in zip(polygons, bounds, sizes, strict=True):
        if x > 0 and x + w > width:
            x, y, tallest = 0.0, y - tallest - space, 0.0
        out.append(moved(polygon, x - left, y - top))
        x, tallest = x + w + space, max(tallest, h)
    return out


def moved(geometry: shapely.Polygon, dx: float, dy: float) -> shapely.Polygon:
    """The polygon, translated.

    >>> moved(shapely.box(0, 0, 1, 1), 2.0, 3.0).bounds
    (2.0, 3.0, 3.0, 4.0)
    """
    shifted: shapely.Polygon = shapely.transform(geometry, lambda xy: xy + np.array([dx, dy]))
    return shifted
