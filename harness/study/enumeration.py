"""Every triangulation of one polygon with its criteria, and the paper's picture of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

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


def _diagonals(triangles: np.ndarray, vertices_: int) -> list[tuple[int, int]]:
    edges = {
        (min(a, b), max(a, b))
        for triangle in triangles.tolist()
        for a, b in zip(triangle, [*triangle[1:], triangle[0]], strict=True)
    }
    return sorted((a, b) for a, b in edges if b - a not in (1, vertices_ - 1))


def write(table: pd.DataFrame, polygon: Polygon, folder: Path) -> None:
    """Write triangulations.csv and plots/difference-vs-overdraw.png (and .svg)."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "triangulations.csv", index=False)
    front = pareto_front(polygon, "overdraw", "shape").costs
    draw(folder / "plots", "difference-vs-overdraw", _figure, table, front)


def _figure(table: pd.DataFrame, front: NDArray[np.float64]) -> Figure:
    figure, (axes,) = grid((3.5, 3.2))
    for conforming, label, marker in ((True, "conforming", "o"), (False, "T-junctions", "x")):
        part = table[table["conforming"] == conforming]
        if len(part):
            axes.scatter(
                part["overdraw"],
                part["shape"],
                s=14,
                marker=marker,
                color=COLOURS[0 if conforming else 1],
                label=f"{label} ({len(part)})",
            )
    axes.step(
        front[:, 0],
        front[:, 1],
        where="post",
        color=COLOURS[2],
        marker="o",
        markersize=8,
        fillstyle="none",
        label=f"Pareto front ({len(front)})",
    )
    axes.set_xlabel("A, bounding-box overdraw (square units)")
    axes.set_ylabel("D, shape deviation (degrees)")
    axes.legend()
    return figure
