"""Pictures of where a triangulation costs: lanes shaded in each pixel, triangles drawn over it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, Frame
from harness.rasterisers import spans

Map = NDArray[np.int64]

PADDING_PX = 2
DPI = 150
PANEL_INCHES = 4.2
MOST_LEVELS = 9
"""Numbers of lanes that get a colour of their own; more than that share the last one."""

NOTHING = "#ffffff"
ROWS = (
    ("lanes shaded in a pixel\n(1 = no overdraw)", "YlOrRd"),
    ("helper lanes in a pixel\n(shaded, nothing covered)", "PuBu"),
)


def lane_maps(frame: Frame, triangles: NDArray[np.int32]) -> tuple[Map, Map]:
    """Return lanes that cover and helper lanes for each pixel: two (height, width), row 0 below.

    Their sum, a pixel, is how often its shader runs.
    """
    # A quad at the edge of a viewport with an odd side reaches one pixel over it.
    shape = (frame.height + frame.height % 2, frame.width + frame.width % 2)
    covered, helpers = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    rows = np.ascontiguousarray(triangles, np.int32)
    spans.shade(frame.points, rows, covered, helpers, frame.window)
    return covered[: frame.height, : frame.width], helpers[: frame.height, : frame.width]


def draw_heatmaps(
    frame: Frame, polygon: int, triangulations: Mapping[str, NDArray[np.int32]], path: Path
) -> None:
    """Draw one polygon's overdraw and helper lanes for several triangulations, side by side.

    Parameters
    ----------
    polygon : number of the polygon in the frame
    triangulations : name -> (m, 3) triangles over that polygon's own vertices
    path : PNG file to write
    """
    start, stop = int(frame.offsets[polygon]), int(frame.offsets[polygon + 1])
    corners = frame.points[start:stop] / SUBPIXEL
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - PADDING_PX, 0)
    high = np.ceil(corners.max(axis=0)).astype(int) + PADDING_PX
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    panels = {}
    for name, triangles in triangulations.items():
        covered, helpers = lane_maps(frame, np.asarray(triangles, np.int32) + np.int32(start))
        panels[name] = ((covered + helpers)[window], helpers[window])

    width, height = high - low
    columns = len(panels)
    tall = PANEL_INCHES * float(np.clip(height / width, 0.4, 1.6)) + 0.5
    figure = Figure(
        figsize=(PANEL_INCHES * columns + 1.6, 2 * tall + 0.9), dpi=DPI, layout="constrained"
    )
    axes = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=True)
    figure.suptitle(
        f"Polygon {frame.source[polygon]}, {stop - start} vertices, in a viewport of "
        f"{frame.width} x {frame.height} px",
        fontsize=11,
    )
    for row, (label, palette) in enumerate(ROWS):
        most = max(1, *(int(maps[row].max()) for maps in panels.values()))
        colours, norm = _levels(palette, min(most, MOST_LEVELS))
        for column, (name, maps) in enumerate(panels.items()):
            axis = axes[row, column]
            _panel(axis, maps[row], colours, norm, (low[0], high[0], low[1], high[1]))
            _outline(axis, corners[triangulations[name]])
            axis.set_title(_caption(name, maps) if row == 0 else "", fontsize=9)
        bar = figure.colorbar(
            ScalarMappable(norm, colours), ax=list(axes[row]), fraction=0.05, pad=0.01
        )
        shown = [*range(min(most, MOST_LEVELS) + 1)]
        more = "+" if most > shown[-1] else ""
        bar.set_ticks(shown)
        bar.set_ticklabels([*map(str, shown[:-1]), f"{shown[-1]}{more}"])
        bar.set_label(label, fontsize=9)
    figure.savefig(path)


def _levels(palette: str, most: int) -> tuple[Colormap, BoundaryNorm]:
    """One colour for each integer 0..most; white for 0, and never so pale that 1 looks like 0."""
    from matplotlib import colormaps

    shades = colormaps[palette](np.linspace(0.3, 1.0, most))
    colours = ListedColormap([NOTHING, *shades])
    return colours, BoundaryNorm(np.arange(most + 2) - 0.5, most + 1)


def _panel(
    axis: Axes, values: Map, colours: Colormap, norm: BoundaryNorm, extent: tuple[int, ...]
) -> None:
    axis.imshow(
        np.minimum(values, norm.N - 1),
        cmap=colours,
        norm=norm,
        origin="lower",
        extent=(extent[0], extent[1], extent[2], extent[3]),
        interpolation="nearest",
    )
    axis.tick_params(labelsize=7)
    axis.set_xlabel("")


def _outline(axis: Axes, triangles: NDArray[np.float64]) -> None:
    """Draw triangles (m, 3, 2) as a white line with a dark core, visible on any colour."""
    for colour, line in (("white", 1.8), ("#202020", 0.7)):
        axis.add_collection(
            PolyCollection(list(triangles), facecolors="none", edgecolors=colour, linewidths=line)
        )


def _caption(name: str, maps: tuple[Map, Map]) -> str:
    shaded, helpers = (int(values.sum()) for values in maps)
    covered = shaded - helpers
    share = helpers / covered if covered else 0.0
    return f"{name}\n{covered:,} fragments + {helpers:,} helper lanes ({share:+.0%})"
