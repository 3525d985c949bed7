"""The figures of docs/flips.md and of what other pages say of flips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from docs.held import Held, Sentence, Table, tables
from docs.held.lookups import (
    Row,
    grid,
    matched,
    one,
    percent,
    some,
    table_row,
    three,
    two,
    whole,
)

LANES = "flips-lanes.csv"
"""What `scripts/flips_lanes.py` printed."""

LABELS = {
    "city": "city",
    "glyphs": "letters",
    "helsinki": "Helsinki",
    "counties:level=state": "U.S. states",
    "counties": "counties",
    "cad": "cad",
}
L1, EUCLIDEAN, REFINED, BEST_FOR_H = (
    *("flips:l1", "flips:euclidean"),
    *("refined:half-perimeter", "optimal:half-perimeter"),
)
SHOWN = ("earcut-refine", "flips:beauty", L1, EUCLIDEAN, REFINED)
COUNTED = (*SHOWN, BEST_FOR_H)


def _counted(scene: str, px: int, name: str, measure: str = "helper_lanes") -> float:
    """Return what a triangulator leaves in ratio to ear clipping."""
    return float(one(LANES, scene=scene, px=px, triangulator=name)[measure])


def _counts(measure: str, names: Sequence[str]) -> Callable[[], list[str]]:
    """Return what makes the table of a counter in ratio to ear clipping's, L1 flips' in bold."""
    views = {of: LABELS[of[0]] for of in product(LABELS, SIZES)}

    def cell(of: tuple[str, int], name: str) -> str:
        if name == "px":
            return str(of[1])
        if name == "polygons":
            return whole(one(LANES, scene=of[0], px=of[1], triangulator=L1)["polygons"])
        shown = three(_counted(*of, name, measure))
        return f"**{shown}**" if name == L1 else shown

    return lambda: grid(views, ("px", "polygons", *names), cell)


def at_512() -> list[str]:
    """Return the rows of docs/upstream.md: lanes at 512 px of `refine` and of L1 flips."""
    scenes = ("city", "helsinki", "glyphs", "counties:level=state", "counties", "cad")
    return [
        table_row(label, *(three(_counted(scene, 512, name)) for scene in scenes))
        for label, name in (("`refine`", "earcut-refine"), ("L1 flips", L1))
    ]


def _beyond_l1(name: str) -> list[str]:
    """Return by how many per cent a triangulator has more lanes than L1 flips: ends over rows."""
    shares = [
        _counted(scene, px, name) / _counted(scene, px, L1) - 1.0
        for scene, px in product(LABELS, SIZES)
    ]
    return [percent(min(shares)), percent(max(shares))]


def _partial_beside_lanes() -> list[str]:
    """Return how far L1 flips' ratio of partial quads is from that of lanes, at most."""
    apart = [
        _counted(scene, px, L1, "partial_quads") - _counted(scene, px, L1)
        for scene, px in product(LABELS, SIZES)
    ]
    return [two(max(map(abs, apart)))]


MEASURED = ("city", "helsinki", "glyphs", "counties:level=state", "counties")
"""Scenes that flips were timed on."""

SIZES = (64, 512, 1024)


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
    return grid(VIEWS, COUNTED, _of_view, "row")


def _of_view(of: tuple[str, int], name: str) -> str:
    return two(_ratio(of[0], name, of[1]))


def paid() -> list[str]:
    """Return the table of milliseconds to triangulate, and after how many draws they pay."""

    def spent(scene: str, name: str) -> str:
        value = _timed(scene, name)["triangulate_ms"]
        return two(value) if float(value) < 10.0 else whole(value)

    def pays(scene: str) -> list[str]:
        names = ("earcut-refine", "flips:l1", BEST_FOR_H)
        return [_timed(scene, name)["break_even"].removeprefix("after ") for name in names]

    labels = {scene: LABELS[scene] for scene in MEASURED}
    return grid(labels, ("ear-clipping", *COUNTED), spent, more=pays)


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


def walked() -> list[str]:
    """Return L1 flips' time in ratio to ear clipping's, both walked, at 64 px: ends over scenes."""
    return _ends([_ratio(scene, "flips:l1", 64, "-walk") for scene in MEASURED])


def in_short() -> list[str]:
    """Return the README's rows: what L1 flips save and cost on three scenes, with two digits."""
    scenes = ("city", "glyphs", "counties:level=state")
    cells = [two(_counted(scene, 512, L1)) for scene in scenes]
    ratios = []
    for scene in scenes:
        rows = {row["candidate"]: row for row in some(TIMES, scene=scene, language="JavaScript")}
        ratios.append(two(1.0 + float(rows["l1"]["ms"]) / float(rows["earcut"]["ms"])))
    return [
        table_row("helper lanes in ratio to earcut's, 512 px a polygon", *cells),
        table_row("time to triangulate in ratio to earcut's, JavaScript", *ratios),
    ]


PAID = Table(
    "| scene | ear clipping | `earcut-refine` | `flips:beauty` | `flips:l1` | `flips:euclidean` |"
    " `refined` | best for H | `earcut-refine` pays | `flips:l1` pays | best for H pays |",
    paid,
)
PARTIAL = Table(
    "| scene | px | polygons | partial quads: `earcut-refine` | `flips:beauty` | L1 flips"
    " | Euclidean flips | `refined` | best for H |",
    _counts("partial_quads", COUNTED),
)
BLENDER = "blender-beauty.csv"
"""What `scripts/studies/blender.py` printed."""


def _blenders() -> list[str]:
    """Return how many polygons Blender had, and how near each of its operators comes."""
    beautify, triangulate = (some(BLENDER, operator=name) for name in ("beautify", "triangulate"))
    by_scene = {row["scene"]: row for row in triangulate}
    counties = by_scene.pop("counties")
    farthest = max(abs(float(row[end])) for row in beautify for end in ("least", "most"))
    return [
        str(sum(int(row["polygons"]) for row in beautify)),
        str(sum(int(row["same"]) for row in beautify)),
        f"{farthest * 1e9:.1f}",
        str(sum(int(row["same"]) for row in triangulate)),
        percent(-float(counties["mean"]), 2),
        percent(-float(counties["least"])),
        f"{-100.0 * min(float(row['least']) for row in by_scene.values()):.2g}",
    ]


REFINE, EQUAL = "flips-refine.csv", "flips-refine.txt"
"""What `scripts/flips_times.py` printed of C++, and tests/endurance of its results."""


def _refine_ratios() -> list[str]:
    """Return L1 flips' time in ratio to that of earcut.hpp's refine, by scene."""
    scenes = dict.fromkeys(row["scene"] for row in some(REFINE))
    pairs = [[one(REFINE, scene=s, candidate=c)["ms"] for c in ("l1", "refine")] for s in scenes]
    return [two(float(ours) / float(theirs)) for ours, theirs in pairs]


def _trusted() -> list[str]:
    """Return what trusting E and H costs at 1024 px in the city and on counties, in per cent."""
    pairs = product(("city", "counties"), ("E", "H"))
    return [tables.worst(scene, who) for scene, who in pairs]


HELD: list[Held] = [
    Sentence("the two ratios of L1 flips differ by at most {} in any row", _partial_beside_lanes),
    Sentence(
        "was run on {} polygons without holes (`scripts/studies/blender.py`). It has the rule in"
        " two places. *Beautify Faces*, which began at ear clipping's triangles, made those of"
        " `flips:beauty` for {} of them, and sums differ by up to {} in a billion."
        " *Triangulate Faces*, which cuts a polygon by itself, made them for {}. On counties"
        " its sum is {} % smaller as a mean, {} % in the worst one, and on the others up to {} %.",
        _blenders,
    ),
    Sentence(
        "Over the rows of the first table, Euclidean flips have {} to {} % more helper lanes than"
        " L1 flips, Delaunay's {} to {} % more.",
        lambda: [*_beyond_l1(EUCLIDEAN), *_beyond_l1("delaunay")],
    ),
    Sentence(
        "Trusting E costs a mean of {} % more helper lanes than the fewest on 96 city polygons at"
        " 1024 px, and H {} %; on eight counties {} % and {} %.",
        _trusted,
    ),
    Sentence(
        "for each of {} polygons, by {} flips; `By::delaunay` of the port differs in {} of them",
        lambda: matched(EQUAL, r"([\d,]+) polygons\n +([\d,]+) flips\n +([\d,]+) By::delaunay"),
    ),
    Sentence("L1 flips take {}, {}, {} and {} of its time on the four scenes", _refine_ratios),
    Table(
        "| scene | px | polygons | `earcut-refine` | `flips:beauty` | `flips:l1` |"
        " `flips:euclidean` | `refined` | best for H |",
        _counts("helper_lanes", COUNTED),
    ),
    Table(
        "| scene, px | `earcut-refine` | `flips:beauty` | `flips:l1` | `flips:euclidean` |"
        " `refined` | best for H |",
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
    # Computed by tests/triangulators/test_slivers.py.
    r"(?s)## Slivers.*?(?=\*\*Blender's Beauty)",
    r"mapbox_earcut 2\.1\.0|Blender 5\.0\.1|on 96 city polygons at\s+1024 px",
    r"(?s)^.*?## What it is worth",
    r"\b[Aa]t (64|1024) px",
    r"(?s)## What a pass must do.*$",
)
"""The derivation, sizes, and what a pass is."""

UPSTREAM: list[Held] = [
    Table("| | city | Helsinki | letters | U.S. states | counties | cad |", at_512),
]
TOLD = (
    r"some 65|it is \d+ bytes more when minified[^.]*",  # tests/ports/test_equal.py
    r"(?s)^.*?Helper lanes in ratio",
    r"4\nsqrt\(3\)|4 sqrt\(3\)|512 px",
    r"(?s)## MapLibre GL JS.*$",  # docs/studies/map-tiles.md, at the commit that it names
)
"""What tests compute, and a study that is done."""
