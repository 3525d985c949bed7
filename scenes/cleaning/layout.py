"""Layout of polygons in rows."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import affinity


def arrange_in_rows(
    polygons: Sequence[shapely.Polygon], gap: float = 0.1, aspect: float = 1.0
) -> list[shapely.Polygon]:
    """Return the polygons, translated into rows: from the top, in order, without touching.

    `gap` is the space between polygons as a share of the mean width; `aspect` is the target ratio
    of width to height of all rows together.

    >>> row = arrange_in_rows([shapely.box(9, 9, 10, 10), shapely.box(5, 5, 6, 6)], 0.5, 9)
    >>> [polygon.bounds for polygon in row]
    [(0.0, -1.0, 1.0, 0.0), (1.5, -1.0, 2.5, 0.0)]
    """
    if not polygons:
        return []
    bounds = shapely.bounds(np.asarray(polygons))
    sizes = bounds[:, 2:] - bounds[:, :2]
    space = gap * sizes.mean()
    width = max(np.sqrt(aspect * (sizes + space).prod(axis=1).sum()), sizes[:, 0].max())
    arranged, x, y, row_height = [], 0.0, 0.0, 0.0
    for polygon, (min_x, _, _, max_y), (w, h) in zip(polygons, bounds, sizes, strict=True):
        if x > 0 and x + w > width:
            x, y, row_height = 0.0, y - row_height - space, 0.0
        arranged.append(affinity.translate(polygon, x - min_x, y - max_y))
        x, row_height = x + w + space, max(row_height, h)
    return arranged
