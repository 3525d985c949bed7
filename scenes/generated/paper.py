"""The test polygon of Kryvda and Sulema's Table 1, reconstructed from its printed rows."""

from __future__ import annotations

import shapely

from scenes.scene import Scene

# clockwise, as the paper numbers them
VERTICES = ((3, 7), (0, 8), (1, 11), (7, 11), (7, 6), (6, 3), (3, 0), (1, 3), (3, 2))


def build(*, seed: int = 0) -> Scene:  # noqa: ARG001 - every scene takes a seed
    """One polygon of 9 vertices and area 46."""
    return Scene(
        name="paper",
        polygons=[shapely.orient_polygons(shapely.Polygon(VERTICES))],
        units="units",
        description="test polygon of the paper's Table 1",
        licence="facts",
        credit="reconstructed from Table 1 of Kryvda and Sulema",
    )
