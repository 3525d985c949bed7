"""Every triangulation of one polygon with its criteria."""

from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from shapely import Polygon

from triangulators import vertices
from triangulators.criteria import predict
from triangulators.methods.exhaustive import enumerate_triangulations

COLUMNS = ("overdraw", "shape", "complexity", "half_perimeter", "edge_length", "triangles")


def triangulation_table(polygon: Polygon, mode: Literal["conforming", "paper"]) -> pd.DataFrame:
    """Return one row per triangulation, least overdraw first: `COLUMNS`, conforming, diagonals.

    Diagonals are written as pairs of vertex numbers, "1-3 3-5".

    Raises
    ------
    triangulators.TriangulationError
        if the polygon has holes, or too many triangulations to list
    """
    points = vertices(polygon)
    rows = []
    for triangles in enumerate_triangulations(polygon, mode):
        row: dict[str, object] = {name: predict(points, triangles)[name] for name in COLUMNS}
        row["triangles"] = len(triangles)
        row["conforming"] = len(triangles) == len(points) - 2
        row["diagonals"] = " ".join(f"{a}-{b}" for a, b in _diagonals(triangles, len(points)))
        rows.append(row)
    table = pd.DataFrame(rows)
    return table.sort_values(["overdraw", "shape"], kind="stable").reset_index(drop=True)


def _diagonals(triangles: NDArray[np.int32], vertices_: int) -> list[tuple[int, int]]:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs = np.unique(edges, axis=0).tolist()
    return [(a, b) for a, b in pairs if b - a not in (1, vertices_ - 1)]
