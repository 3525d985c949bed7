"""The figures of docs/flips.md and of what other pages say of flips."""

from __future__ import annotations

from itertools import product

from docs.held import Held, Sentence, Table
from docs.held.lookups import Row, bold, grid, one, percent, some, table_row, text, two, whole

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


MEASURED = ("city", "helsinki", "glyphs", "counties:level=state", "counties")
"""Scenes that flips were timed on."""

SIZES = (64, 512, 1024)
SHOWN = ("earcut-refine", "flips:l1", "flips:euclidean", "refined:half-perimeter")
BEST_FOR_H = "optimal:half-perimeter"


def _timed(scene: str, name: str, px: int = 1024, order: str = "") -> Row:
    file = f"llvmpipe/flips-{scene.removeprefix('counties:level=')}{order}/summary.csv"
    return one(file, triangulator=name, resolution=px)


def _ratio(*which: object) -> float:
    return float(_timed(*which)["time_ratio"])  # type: ignore[arg-type]


def _ends(found: list[float]) -> list[str]:
    return [two(min(found)), two(max(found))]


VIEWS = {of: f"{LABELS[of[0]]}, {of[1]}" for of in product(MEASURED, SIZES)}


def drawn() -> list[str]:
    """Return the table of draw times in ratio to ear clipping's."""
    return grid(VIEWS, (*SHOWN, BEST_FOR_H), _of_view, "row")


def _of_view(of: tuple[str, int], name: str) -> str:
    return two(_ratio(of[0], name, of[1]))


def bought() -> list[str]:
    """Return the table of helper lanes and of draw times, both in ratio to ear clipping's."""
    lanes_of = {(row[0], int(row[1])): bold([row[3], *row[L1:]], {1}) for row in _rows()}
    times_of = [line.strip("| ").split(" | ")[1:] for line in drawn()]
    return [
        table_row(VIEWS[of], *lanes_of[of], *cells)
        for of, cells in zip(VIEWS, times_of, strict=True)
    ]


def paid() -> list[str]:
    """Return the table of milliseconds to triangulate, and after how many draws they pay."""

    def spent(scene: str, name: str) -> str:
        value = _timed(scene, name)["triangulate_ms"]
        return two(value) if float(value) < 10.0 else whole(value)

    def pays(scene: str) -> list[str]:
        names = ("earcut-refine", "flips:l1", BEST_FOR_H)
        return [_timed(scene, name)["break_even"].removeprefix("after ") for name in names]

    labels = {scene: LABELS[scene] for scene in MEASURED}
    return grid(labels, ("ear-clipping", *SHOWN, BEST_FOR_H), spent, more=pays)


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
        shares = [_ratio(s, "flips:l1", px) / _ratio(s, SHOWN[-1], px) - 1.0 for s in MEASURED]
        found += [percent(min(shares), 1), percent(max(shares), 1)]
    return found


def small() -> list[str]:
    """Return the ends over scenes of times at 64 px: of flips as they come, and of `refined`."""
    as_they_come, refined = (
        _ends([_ratio(scene, name, 64) for scene in MEASURED for name in names])
        for names in (SHOWN[:3], SHOWN[3:])
    )
    return as_they_come + refined


def walked() -> list[str]:
    """Return L1 flips' time in ratio to ear clipping's, both walked, at 64 px: ends over scenes."""
    return _ends([_ratio(scene, "flips:l1", 64, "-walk") for scene in MEASURED])


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

HELD: list[Held] = [
    Table(
        "| scene | px | polygons | `earcut-refine` | Delaunay | `flips:l1` | `flips:euclidean` |"
        " `refined` |",
        lanes,
    ),
    Table(
        "| scene, px | `earcut-refine` | `flips:l1` | `flips:euclidean` | `refined` | best for H |",
        drawn,
    ),
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
    r"(?s)## Slivers.*?(?=## What a pass)",  # computed by tests/triangulators/test_slivers.py
    r"(?s)^.*?## What it is worth",
    r"\b[Aa]t (64|1024) px",
    r"(?s)## What a pass must do.*$",
)
"""The derivation, sizes, and what a pass is."""
