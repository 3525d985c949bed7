"""Draw the pictures of docs/theory.md: `python scripts/theory_pictures.py`."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from shapely.affinity import translate

from triangulators.criteria import predict

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
CORNERS = np.array([[1.0, 1.0], [8.0, 2.5], [3.5, 6.0]])
BLUE, ORANGE, GREY = "#3b6ea8", "#d98032", "#888888"


def main() -> None:
    """Write the four pictures."""
    mpl.rcParams["svg.hashsalt"] = "theory"  # so that a picture drawn again is the same file
    for name, draw in (("h", _h), ("rotation", _rotation), ("q", _q), ("dual", _dual)):
        figure = Figure(figsize=(5.2, 3.0), layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        path = IMAGES / f"theory-{name}.svg"
        figure.savefig(path, metadata={"Date": None})
        text = path.read_text()
        path.write_text("\n".join(line.rstrip() for line in text.splitlines()) + "\n")


def _bare(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_axis_off()


def _h(axes: Axes) -> None:
    (left, bottom), (right, top) = CORNERS.min(axis=0), CORNERS.max(axis=0)
    axes.fill(*CORNERS.T, color=BLUE, alpha=0.35)
    axes.plot([left, right, right, left, left], [bottom, bottom, top, top, bottom], color=GREY)
    for k, (a, b) in enumerate(zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)):
        level = bottom - 0.4 * (k + 1)
        axes.plot([a[0], b[0]], [level, level], color=ORANGE, linewidth=3)
        beside = right + 0.4 * (k + 1)
        axes.plot([beside, beside], [a[1], b[1]], color=ORANGE, linewidth=3)
    axes.text((left + right) / 2, bottom - 2.0, "the three edges cover w twice", ha="center")
    axes.text(right + 1.5, (bottom + top) / 2, "and h twice", va="center")
    _bare(axes)


def _rotation(axes: Axes) -> None:
    turns = np.linspace(0, np.pi, 361)
    x = np.cos(turns) * CORNERS[:, :1] - np.sin(turns) * CORNERS[:, 1:]
    y = np.sin(turns) * CORNERS[:, :1] + np.cos(turns) * CORNERS[:, 1:]
    length = predict(CORNERS, np.array([[0, 1, 2]]))["edge_length"]
    axes.plot(np.degrees(turns), np.ptp(x, axis=0) + np.ptp(y, axis=0), color=BLUE, label="H")
    axes.axhline(2 * length / np.pi, color=ORANGE, label="2 E / pi")
    axes.set_xlabel("rotation, degrees")
    axes.set_ylabel("px")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)


def _q(axes: Axes) -> None:
    triangle = shapely.Polygon(CORNERS)
    moves = [(x, y) for x in (0, -1) for y in (0, -1)]
    copies = [translate(triangle, x, y) for x, y in moves]
    axes.fill(*shapely.get_coordinates(shapely.union_all(copies)).T, color=ORANGE, alpha=0.35)
    for copy in copies:
        axes.plot(*shapely.get_coordinates(copy).T, color=BLUE, linewidth=1)
    _bare(axes)


def _dual(axes: Axes) -> None:
    a, b, c, d = np.array([[0.0, 0.0], [6.0, 0.6], [3.4, 3.6], [2.6, -3.0]])
    axes.fill(*np.array([a, b, c]).T, color=BLUE, alpha=0.25)
    axes.fill(*np.array([a, d, b]).T, color=ORANGE, alpha=0.25)
    for name, point, shift in (("a", a, -0.4), ("b", b, 0.2), ("c", c, 0.0), ("d", d, 0.0)):
        axes.text(point[0] + shift, point[1], name, fontsize=13)
    middle = (a + b) / 2
    axes.text(middle[0], middle[1] + 0.35, "y(ab)", ha="center")
    axes.text(middle[0], middle[1] - 0.75, "-y(ab)", ha="center")
    _bare(axes)


if __name__ == "__main__":
    main()
