"""Pictures of a polygon with two triangulations, over the shader lanes of each pixel, as SVG.

    PYTHONPATH=. python scripts/pictures.py

chooses the polygons and writes results/reference/gallery.csv; `make documents` draws them.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from docs.results import (
    PICTURE_PX,
    REFERENCE,
    count_helper_lanes,
    picture_frame,
    triangulate_frame,
)
from harness.frame import Frame, View, make_frame
from harness.grid import SUBPIXEL
from harness.heatmaps import make_lane_maps
from scenes import load

PICTURES = {
    "typical": ("city", 0.5),
    "extreme": ("city", 1.0),
    **{
        f"gallery-{scene.partition(':')[0]}-{round(100 * quantile)}": (scene, quantile)
        for scene in ("city", "helsinki-tiles:zoom=15", "glyphs", "cad")
        for quantile in (0.5, 0.9)
    },
}
"""Scene and quantile of the polygons' savings, by file name (without parameters of the scene)."""

PANELS = {"ear-clipping": "ear clipping", "optimal:half-perimeter": "optimum for H"}

COLOURS = ("#fed976", "#fd8d3c", "#e31a1c", "#800026")
"""Colours of pixels with one, two, three, and four or more shaded lanes."""

PANEL_PX, GAP_PX, TEXT_PX, FONT_PX = 300, 20, 24, 14

STYLE = (
    f"text{{font:{FONT_PX}px system-ui,sans-serif;fill:#24292f}}"
    "@media (prefers-color-scheme:dark){text{fill:#e6edf3}}"
)


def draw_picture(scene: str, quantile: float) -> str:
    """Return an SVG of the polygon with that quantile of the scene's savings, before and after."""
    frame = picture_frame(scene, quantile)
    transform, panel_height = fit_panel(frame)
    parts = []
    for column, (triangulator, title) in enumerate(PANELS.items()):
        triangles = triangulate_frame(frame, triangulator)
        covered, helpers = make_lane_maps(frame, triangles)
        x = column * (PANEL_PX + GAP_PX)
        caption = f"{title}: {int(helpers.sum()):,} helper lanes"
        parts += [
            f'<text x="{x}" y="{FONT_PX}">{caption}</text>',
            f'<g transform="translate({x} {TEXT_PX}) {transform}">',
            *draw_levels(covered + helpers),
            draw_edges(frame, triangles),
            "</g>",
        ]
    width, height = 2 * PANEL_PX + GAP_PX, panel_height + 2 * TEXT_PX
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}">',
        f"<style>{STYLE}</style>",
        *parts,
        *draw_legend(height - FONT_PX),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def fit_panel(frame: Frame) -> tuple[str, int]:
    """Return the transform from the frame's pixels, with y up, to a panel, and its height."""
    corners = frame.points / SUBPIXEL
    low = np.floor(corners.min(axis=0)) - 1
    high = np.ceil(corners.max(axis=0)) + 1
    width, height = high - low
    zoom = PANEL_PX / max(width, height)
    move = f"translate({-low[0]:g} {-high[1]:g})"
    return f"scale({zoom:.3f} {-zoom:.3f}) {move}", round(zoom * height)


def draw_levels(lanes: NDArray[np.int64]) -> list[str]:
    """Return a path for each colour: the runs of pixels in rows with that number of lanes."""
    levels = np.minimum(lanes, len(COLOURS))
    paths = []
    for level, colour in enumerate(COLOURS, start=1):
        steps = np.diff((levels == level).astype(int), axis=1, prepend=0, append=0)
        starts, ends = np.argwhere(steps == 1), np.argwhere(steps == -1)
        runs = zip(starts.tolist(), (ends - starts)[:, 1].tolist(), strict=True)
        path = "".join(f"M{x} {y}h{length}v1h-{length}z" for (y, x), length in runs)
        paths.append(f'<path fill="{colour}" d="{path}"/>')
    return paths


def draw_edges(frame: Frame, triangles: NDArray[np.int32]) -> str:
    """Return a path of the edges, each once."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends = frame.points[np.unique(edges, axis=0)] / SUBPIXEL
    path = "".join(f"M{a:.2f} {b:.2f}L{c:.2f} {d:.2f}" for (a, b), (c, d) in ends.tolist())
    line = 'fill="none" stroke="#202020" vector-effect="non-scaling-stroke"'
    return f'<path {line} stroke-width="0.8" stroke-linecap="round" d="{path}"/>'


def draw_legend(y: int) -> list[str]:
    """Return the colours and their numbers of lanes, in a row whose text ends at height y."""
    lines, x = [f'<text x="0" y="{y + FONT_PX - 3}">lanes shaded in a pixel:</text>'], 175
    for level, colour in enumerate(COLOURS, start=1):
        more = " or more" if level == len(COLOURS) else ""
        lines += [
            f'<rect x="{x}" y="{y}" width="{FONT_PX}" height="{FONT_PX}" fill="{colour}"/>',
            f'<text x="{x + FONT_PX + 5}" y="{y + FONT_PX - 3}">{level}{more}</text>',
        ]
        x += 3 * FONT_PX
    return lines


def choose_polygon(scene: str, quantile: float) -> int:
    """Return the index of the polygon at a quantile of its scene's savings; 1 is the largest.

    A saving is the helper lanes of the optimum relative to ear clipping, of the polygon alone.
    """
    savings = []
    for index, polygon in enumerate(load(scene).polygons):
        frame = make_frame([polygon], View(PICTURE_PX))
        base, best = (count_helper_lanes(frame, triangulator) for triangulator in PANELS)
        if base:
            savings.append((best / base, index))
    return sorted(savings)[round((1 - quantile) * (len(savings) - 1))][1]


if __name__ == "__main__":
    rows = [(*key, choose_polygon(*key)) for key in dict.fromkeys(PICTURES.values())]
    table = pd.DataFrame(rows, columns=["scene", "quantile", "polygon"])
    table.to_csv(REFERENCE / "gallery.csv", index=False)
