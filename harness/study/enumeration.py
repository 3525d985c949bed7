"""Every triangulation of one polygon with its criteria, and the paper's picture of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from shapely import Polygon

from harness.style import COLOURS, draw, grid
from triangulators import vertices
from triangulators.criteria import predict
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.methods.pareto import pareto_front

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("overdraw", "shape", "complexity", "half_perimeter", "edge_length", "triangles")


def triangulation_table(polygon: Polygon, mode: Literal["conforming", "paper"]) -> pd.DataFrame:
    """Return one row per triangulation, least overdraw first: `COLUMNS`, conforming, diagonals.

    Diagonals are written as pairs of vertex numbers, "1-3 3-5".

    Raises
    ------
    triangulators.Skipped, triangulators.TriangulationError
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


def write(table: pd.DataFrame, polygon: Polygon, folder: Path) -> None:
    """Write triangulations.csv and plots/difference-vs-overdraw.png (and .svg)."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "triangulations.csv", index=False)
    front = pareto_front(polygon, "overdraw", "shape").costs
    draw(folder / "plots", "difference-vs-overdraw", _figure, table, front)


def _figure(table: pd.DataFrame, front: NDArray[np.float64]) -> Figure:
    figure, (axes,) = grid((3.5, 3.2))
    kinds = {"conforming": table["conforming"], "T-junctions": ~table["conforming"]}
    for (label, rows), colour, marker in zip(kinds.items(), COLOURS, "ox", strict=False):
        style: Any = {"color": colour, "marker": marker, "label": f"{label} ({rows.sum()})"}
        axes.scatter(table["overdraw"][rows], table["shape"][rows], s=14, **style)
    style = {"color": COLOURS[2], "marker": "o", "label": f"Pareto front ({len(front)})"}
    axes.step(*front.T, where="post", markersize=8, fillstyle="none", **style)
    axes.set_xlabel("A, bounding-box overdraw (square units)")
    axes.set_ylabel("D, shape deviation (degrees)")
    axes.legend()
    return figure
