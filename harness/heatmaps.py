"""Heat maps of a triangulation's cost: shaded lanes per pixel, with the triangles on top."""

from collections.abc import Mapping
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import spans

Map = NDArray[np.int64]

PADDING_PX = 2
"""Pixels shown around the polygon."""

PANEL_PX = 600
"""Approximate length of a panel's longer edge; each frame pixel is a square of equal size."""

GAP_PX, FONT_PX = 12, 16

LEGEND_PX = 900
"""Width of nine squares and a label."""

MAX_LEVELS = 9
"""Numbers of lanes with a separate colour; higher numbers share the last one."""

ROWS = (
    ("lanes shaded in a pixel (1 = no overdraw)", ("#fed976", "#fd8d3c", "#b10026")),
    ("helper lanes in a pixel (shaded, nothing covered)", ("#bdc9e1", "#74a9cf", "#034e7b")),
)
"""Label of each row of panels, and its colours from one lane to many."""


def lane_maps(frame: Frame, triangles: NDArray[np.int32]) -> tuple[Map, Map]:
    """Return covering lanes and helper lanes per pixel: two (height, width), row 0 at the bottom.

    Their sum is the number of shader invocations of a pixel.
    """
    # In a viewport with an odd side, quads at the edge extend one pixel beyond it.
    shape = (frame.height + frame.height % 2, frame.width + frame.width % 2)
    covered, helpers = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    rows = np.ascontiguousarray(triangles, np.int32)
    spans.shade(frame.points, rows, covered, helpers, frame.window)
    return covered[: frame.height, : frame.width], helpers[: frame.height, : frame.width]


def draw_heatmaps(
    frame: Frame, triangulations: Mapping[str, NDArray[np.int32]], out: Path | IO[bytes]
) -> None:
    """Draw a polygon's overdraw and helper lanes for several triangulations, side by side.

    frame : of that polygon alone; triangulations : name -> (m, 3); out : PNG file to write
    """
    corners = frame.points / SUBPIXEL
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - PADDING_PX, 0)
    high = np.ceil(corners.max(axis=0)).astype(int) + PADDING_PX
    high = np.minimum(high, (frame.width, frame.height))
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    panels, captions = [], []
    for name, triangles in triangulations.items():
        covered, helpers = lane_maps(frame, triangles)
        panels.append(((covered + helpers)[window], helpers[window]))
        fragments, lanes = int(covered[window].sum()), int(helpers[window].sum())
        share = lanes / fragments if fragments else 0.0
        captions.append(f"{name}\n{fragments:,} fragments + {lanes:,} helper lanes ({share:+.0%})")
    title = (
        f"Polygon {frame.source[0]}, {len(corners)} vertices, in a viewport of "
        f"{frame.width} x {frame.height} px"
    )

    font = ImageFont.load_default(FONT_PX)
    line = FONT_PX + GAP_PX // 2
    zoom = max(1, round(PANEL_PX / max(panels[0][0].shape)))
    height, width = (zoom * size for size in panels[0][0].shape)
    words = [line for text in captions for line in text.split("\n")]
    across = GAP_PX + max(width, *(round(font.getlength(text)) for text in words))
    tops = (5 * line, 7 * line + height)  # below the title and captions; below a legend
    whole = max(across * len(panels), round(font.getlength(title)), LEGEND_PX) + GAP_PX
    picture = Image.new("RGB", (whole, tops[1] + height + 2 * line), "white")
    pen = ImageDraw.Draw(picture)
    pen.font = font
    pen.text((GAP_PX, GAP_PX), title, "black")
    for row, ((label, palette), top) in enumerate(zip(ROWS, tops, strict=True)):
        most = max(1, *(int(maps[row].max()) for maps in panels))
        colours = _levels(palette, min(most, MAX_LEVELS))
        for column, (maps, triangles) in enumerate(
            zip(panels, triangulations.values(), strict=True)
        ):
            left = GAP_PX + column * across
            # An image's first row is on top.
            pixels = Image.fromarray(colours[np.minimum(maps[row], len(colours) - 1)][::-1])
            squares = pixels.resize((width, height), Image.Resampling.NEAREST)
            picture.paste(squares, (left, top))
            places = (corners - (low[0], high[1])) * (zoom, -zoom) + (left, top)
            # A white line with a dark core is visible on any colour.
            for colour, thick in (("white", 3), ("#202020", 1)):
                for three in places[triangles[:, [0, 1, 2, 0]]]:
                    pen.line([(x, y) for x, y in three.tolist()], colour, thick)
            if row == 0:
                pen.text((left, top - 5 * line // 2), captions[column], "black")
        x, y = GAP_PX, top + height + GAP_PX // 2
        for number, shade in enumerate(colours.tolist()):
            more = "+" if number == len(colours) - 1 < most else ""
            pen.rectangle((x, y, x + FONT_PX, y + FONT_PX), tuple(shade), "#999999")
            pen.text((x + FONT_PX + 4, y), f"{number}{more}", "black")
            x += 3 * FONT_PX
        pen.text((x, y), label, "black")
    picture.save(out, format="PNG")


def _levels(palette: tuple[str, ...], most: int) -> NDArray[np.uint8]:
    """Return (most + 1, 3) colours: white for 0, and a clearly different one for 1."""
    anchors = np.array([ImageColor.getrgb(colour) for colour in palette], np.float64)
    places = np.linspace(0, len(anchors) - 1, most)
    shades = [np.interp(places, np.arange(len(anchors)), channel) for channel in anchors.T]
    return np.vstack([[255, 255, 255], np.stack(shades, axis=1).round()]).astype(np.uint8)
