"""Heat maps of a triangulation's cost: colours for lanes shaded in each pixel, and the edges."""

import io
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import spans

Map = NDArray[np.int64]

PADDING_PX = 2  # shown around the polygon
PANEL_PX = 600  # approximate longer edge of a panel; pixels are enlarged by an integer factor
GAP_PX, FONT_PX = 12, 16
LEGEND_PX = 900  # minimum width of the picture: a legend of ten squares and a label
MAX_LEVELS = 9  # numbers of lanes with a separate colour; higher numbers have the last colour
ROWS = (  # label of each row of panels, and the colours from one lane to many
    ("lanes shaded in a pixel (1 = no overdraw)", ("#fed976", "#fd8d3c", "#b10026")),
    ("helper lanes in a pixel (shaded, nothing covered)", ("#bdc9e1", "#74a9cf", "#034e7b")),
)


def make_lane_maps(frame: Frame, triangles: NDArray[np.int32]) -> tuple[Map, Map]:
    """Return the covering and the helper lanes of each pixel, (height, width), bottom row first."""
    # With an odd side, quads at the edge extend a pixel beyond the viewport, so maps are larger.
    shape = (frame.height + frame.height % 2, frame.width + frame.width % 2)
    covered, helpers = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    rows = np.ascontiguousarray(triangles, np.int32)
    spans.count_lanes_per_pixel(frame.points, rows, covered, helpers, frame.window)
    return covered[: frame.height, : frame.width], helpers[: frame.height, : frame.width]


def draw_heatmaps(frame: Frame, triangulations: Mapping[str, NDArray[np.int32]]) -> bytes:
    """Return a PNG of the lanes of a polygon's triangulations, (m, 3) by name, side by side."""
    corners = frame.points / SUBPIXEL
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - PADDING_PX, 0)
    high = np.ceil(corners.max(axis=0)).astype(int) + PADDING_PX
    high = np.minimum(high, (frame.width, frame.height))
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    panels, captions = [], []
    for name, triangles in triangulations.items():
        covered, helpers = make_lane_maps(frame, triangles)
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
    caption_lines = [part for text in captions for part in text.split("\n")]
    across = GAP_PX + max(width, *(round(font.getlength(text)) for text in caption_lines))
    tops = (5 * line, 7 * line + height)  # below title and captions; below the first row's legend
    total_width = max(across * len(panels), round(font.getlength(title)), LEGEND_PX) + GAP_PX
    picture = Image.new("RGB", (total_width, tops[1] + height + 2 * line), "white")
    pen = ImageDraw.Draw(picture)
    pen.font = font
    pen.text((GAP_PX, GAP_PX), title, "black")
    for row, ((label, palette), top) in enumerate(zip(ROWS, tops, strict=True)):
        max_lanes = max(1, *(int(maps[row].max()) for maps in panels))
        colours = _make_level_colours(palette, min(max_lanes, MAX_LEVELS))
        for column, (maps, triangles) in enumerate(
            zip(panels, triangulations.values(), strict=True)
        ):
            left_px = GAP_PX + column * across
            # The first row of an image is on top, row 0 of a map at the bottom.
            pixels = Image.fromarray(colours[np.minimum(maps[row], len(colours) - 1)][::-1])
            squares = pixels.resize((width, height), Image.Resampling.NEAREST)
            picture.paste(squares, (left_px, top))
            positions = (corners - (low[0], high[1])) * (zoom, -zoom) + (left_px, top)
            # A white line with a dark core is visible on any colour.
            for colour, line_px in (("white", 3), ("#202020", 1)):
                for outline in positions[triangles[:, [0, 1, 2, 0]]]:
                    pen.line([(x, y) for x, y in outline.tolist()], colour, line_px)
            if row == 0:
                pen.text((left_px, top - 5 * line // 2), captions[column], "black")
        x, y = GAP_PX, top + height + GAP_PX // 2
        for number, shade in enumerate(colours.tolist()):
            more = "+" if number == len(colours) - 1 < max_lanes else ""
            pen.rectangle((x, y, x + FONT_PX, y + FONT_PX), tuple(shade), "#999999")
            pen.text((x + FONT_PX + 4, y), f"{number}{more}", "black")
            x += 3 * FONT_PX
        pen.text((x, y), label, "black")
    content = io.BytesIO()
    picture.save(content, format="PNG")
    return content.getvalue()


def _make_level_colours(palette: tuple[str, ...], count: int) -> NDArray[np.uint8]:
    """Return (count + 1, 3) RGB colours: white for 0 lanes, then `count` colours of the palette."""
    anchors = np.array([ImageColor.getrgb(colour) for colour in palette], np.float64)
    positions = np.linspace(0, len(anchors) - 1, count)
    shades = [np.interp(positions, np.arange(len(anchors)), channel) for channel in anchors.T]
    return np.vstack([[255, 255, 255], np.stack(shades, axis=1).round()]).astype(np.uint8)
