"""The figures of docs/flips.md and of what other pages say of flips."""

from __future__ import annotations

from docs.held import Held, Table
from docs.held.lookups import bold, table_row, text

LANES = "flips-lanes.md"
"""What `scripts/flips_lanes.py` printed."""

LABELS = {
    "city": "city",
    "glyphs": "letters",
    "helsinki": "Helsinki",
    "counties:level=state": "U.S. states",
    "counties": "counties",
    "cad": "cad",
}
L1 = 5  # its column


def _rows() -> list[list[str]]:
    lines = text(LANES).splitlines()[2:]
    return [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]


def lanes() -> list[str]:
    """Return the table of helper lanes in ratio to ear clipping's."""
    found = [row for scene in LABELS for row in _rows() if row[0] == scene]
    return [table_row(LABELS[row[0]], *bold(row, {L1})[1:]) for row in found]


def in_short() -> list[str]:
    """Return the README's row: L1 flips on three scenes at 512 px, with two digits."""
    scenes = ("city", "glyphs", "counties:level=state")
    cells = [
        f"{float(row[L1]):.2f}"
        for scene in scenes
        for row in _rows()
        if row[0] == scene and row[1] == "512"
    ]
    return [table_row("helper lanes in ratio to earcut's, 512 px a polygon", *cells)]


HELD: list[Held] = [
    Table(
        "| scene | px | polygons | `earcut-refine` | Delaunay | `flips:l1` | `flips:euclidean` |"
        " `refined` |",
        lanes,
    ),
]

DEFINITIONS = (r"(?s)^.*?## What it is worth", r"(?s)## What it costs.*$")
"""The derivation; and times, which no file has yet."""
