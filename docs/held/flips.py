"""The figures of docs/flips.md and of what other pages say of flips."""

from __future__ import annotations

from docs.held import Held, Sentence, Table
from docs.held.lookups import Row, bold, one, percent, some, table_row, text, two, whole

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


MEASURED = {
    "city": "city",
    "helsinki": "Helsinki",
    "glyphs": "letters",
    "state": "U.S. states",
    "counties": "counties",
}
"""Scenes that flips were timed on, by the ends of their runs' names."""

SHOWN = ("earcut-refine", "flips:l1", "flips:euclidean", "refined:half-perimeter")
BEST_FOR_H = "optimal:half-perimeter"


def _timed(scene: str, name: str, px: int = 1024) -> Row:
    return one(f"llvmpipe/flips-{scene}/summary.csv", triangulator=name, resolution=px)


def drawn() -> list[str]:
    """Return the table of draw times in ratio to ear clipping's."""
    lines = []
    for scene, label in MEASURED.items():
        for px in (64, 512, 1024):
            rows = [_timed(scene, name, px) for name in (*SHOWN, BEST_FOR_H)]
            cells = [two(row["time_ratio"]) for row in rows]
            least = {place for place, cell in enumerate(cells) if cell == min(cells)}
            lines.append(table_row(f"{label}, {px}", *bold(cells, least)))
    return lines


def bought() -> list[str]:
    """Return the table of helper lanes and of draw times, both in ratio to ear clipping's."""
    named = {LABELS.get(row[0], row[0]): row[0] for row in _rows()}
    lines = []
    for scene, label in MEASURED.items():
        for px in (64, 512, 1024):
            (row,) = [r for r in _rows() if r[0] == named[label] and r[1] == str(px)]
            times = [two(_timed(scene, n, px)["time_ratio"]) for n in (*SHOWN, BEST_FOR_H)]
            least = {place for place, cell in enumerate(times) if cell == min(times)}
            lanes_of = bold([row[3], row[L1], row[L1 + 1], row[L1 + 2]], {1})
            lines.append(table_row(f"{label}, {px}", *lanes_of, *bold(times, least)))
    return lines


def paid() -> list[str]:
    """Return the table of milliseconds to triangulate, and after how many draws they pay."""
    lines = []
    for scene, label in MEASURED.items():
        rows = [_timed(scene, name) for name in ("ear-clipping", *SHOWN, BEST_FOR_H)]
        cells = [_milliseconds(row["triangulate_ms"]) for row in rows]
        cells += [_draws(_timed(scene, name)) for name in ("earcut-refine", "flips:l1", BEST_FOR_H)]
        lines.append(table_row(label, *cells))
    return lines


def _milliseconds(value: str) -> str:
    return two(value) if float(value) < 10.0 else whole(value)


def _draws(row: Row) -> str:
    return row["break_even"].removeprefix("after ")


TIMES = "flips-times.csv"
"""What `scripts/flips_times.py` printed."""


def times() -> list[str]:
    """Return the table of milliseconds by language; in brackets, in ratio to what comes before."""
    lines = []
    for scene in dict.fromkeys(row["scene"] for row in some(TIMES)):

        def ms(language: str, candidate: str, scene: str = scene) -> float:
            return float(one(TIMES, scene=scene, language=language, candidate=candidate)["ms"])

        refine, flips = ms("JavaScript", "refine"), ms("JavaScript", "l1")
        ears, after = ms("C++", "earcut"), ms("C++", "l1")
        called, drop_in = ms("Python", "earcut"), ms("Python", "with flips")
        cells = [two(ms("JavaScript", "earcut")), two(refine), _beside(flips, refine), two(ears)]
        cells += [_beside(after, ears), two(called), _beside(drop_in, called)]
        cells.append(_beside(ms("Python", "batch with flips"), called))
        lines.append(table_row(LABELS[scene], *cells))
    return lines


def _beside(ms: float, base: float) -> str:
    return f"{two(ms)} ({two(ms / base)})"


def unordered() -> list[str]:
    """Return by how many per cent L1 flips are drawn slower than `refined`: ends over scenes."""
    found = []
    for px in (64, 1024):
        rows = [(_timed(scene, "flips:l1", px), _timed(scene, SHOWN[-1], px)) for scene in MEASURED]
        shares = [float(a["time_ratio"]) / float(b["time_ratio"]) - 1.0 for a, b in rows]
        found += [percent(min(shares), 1), percent(max(shares), 1)]
    return found


def small() -> list[str]:
    """Return the ends over scenes of times at 64 px: of flips as they come, and of `refined`."""
    found = []
    for names in (SHOWN[:3], SHOWN[3:]):
        ratios = [float(_timed(s, name, 64)["time_ratio"]) for s in MEASURED for name in names]
        found += [two(min(ratios)), two(max(ratios))]
    return found


def walked() -> list[str]:
    """Return L1 flips' time in ratio to ear clipping's, both walked, at 64 px: ends over scenes."""
    found = [
        float(
            one(f"llvmpipe/flips-{scene}-walk/summary.csv", triangulator="flips:l1", resolution=64)[
                "time_ratio"
            ]
        )
        for scene in MEASURED
    ]
    return [two(min(found)), two(max(found))]


def in_short() -> list[str]:
    """Return the README's rows: what L1 flips save and cost on three scenes, with two digits."""
    scenes = ("city", "glyphs", "counties:level=state")
    cells = [
        f"{float(row[L1]):.2f}"
        for scene in scenes
        for row in _rows()
        if row[0] == scene and row[1] == "512"
    ]
    ratios = []
    for scene in scenes:
        rows = {row["candidate"]: row for row in some(TIMES, scene=scene, language="JavaScript")}
        ratios.append(two(1.0 + float(rows["l1"]["ms"]) / float(rows["earcut"]["ms"])))
    return [
        table_row("helper lanes in ratio to earcut's, 512 px a polygon", *cells),
        table_row("time to triangulate in ratio to earcut's, JavaScript", *ratios),
    ]


DRAWN = Table(
    "| scene, px | `earcut-refine` | `flips:l1` | `flips:euclidean` | `refined` | best for H |",
    drawn,
)
PAID = Table(
    "| scene | ear clipping | `earcut-refine` | `flips:l1` | `flips:euclidean` | `refined` |"
    " best for H | `earcut-refine` pays | `flips:l1` pays | best for H pays |",
    paid,
)
BOUGHT = Table(
    "| scene, px | lanes: `earcut-refine` | L1 flips | Euclidean flips | `refined` | time:"
    " `earcut-refine` | L1 flips | Euclidean flips | `refined` | best for H |",
    bought,
)
SMALL = Sentence(
    "At 64 px, flips as they come are drawn in {} to {} of ear clipping's time, `refined` in {} to"
    " {}.",
    small,
)
LANES_TABLE = Table(
    "| scene | px | polygons | `earcut-refine` | Delaunay | `flips:l1` | `flips:euclidean` |"
    " `refined` |",
    lanes,
)

HELD: list[Held] = [
    LANES_TABLE,
    DRAWN,
    Sentence(
        "drawn {} to {} % slower than `refined` at 64 px, and {} to {} % at 1024 px", unordered
    ),
    Sentence(
        "Listed in a walk it takes {} to {} of ear clipping's time at 64 px, walked as well", walked
    ),
    Table(
        "| scene | npm earcut | `refine` | L1 flips | earcut.hpp | L1 flips | mapbox_earcut |"
        " with L1 flips | all at once |",
        times,
    ),
]

DEFINITIONS = (
    r"(?s)^.*?## What it is worth",
    r"\b[Aa]t (64|1024) px",
    r"(?s)## What a pass must do.*$",
)
"""The derivation, sizes, and what a pass is."""
