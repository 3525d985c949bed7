"""What rasterisers count: how each counter is shown; what criteria predict of it, in its unit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

CYCLES = "cycles"
"""The counter that is a device's time, where it has it."""


@dataclass(frozen=True)
class Counter:
    """An exact integer that a rasteriser counts.

    name : its key in records and its column in files
    label, unit : how tables and plots show it
    better : "lower" where less is less work; "none" where every triangulation of a polygon has
        the same
    best_case : the value no triangulation can beat, None where it depends on the scene
    heading : a shorter label for the terminal's table; "" leaves the counter out of it, unless
        the rasteriser has no other
    """

    name: str
    label: str
    unit: str = "count"
    better: Literal["lower", "none"] = "lower"
    best_case: float | None = None
    heading: str = ""
    description: str = ""


_TILES = (("", "", "bounding boxes"), ("_exact", ", exactly", "the triangles themselves"))

_COUNTERS = (
    Counter(
        CYCLES,
        "cycles",
        "cycles",
        heading="cycles",
        description="cycles that a simulated design takes, which are its time",
    ),
    Counter(
        "helper_lanes",
        "helper lanes",
        "lanes",
        best_case=0.0,
        heading="helpers",
        description="lanes of shaded 2x2 quads that cover nothing",
    ),
    Counter(
        "bbox_tests",
        "bounding-box tests",
        "tests",
        heading="tests",
        description="pixel centres tested in bounding boxes",
    ),
    Counter("rows", "rows walked", "rows", description="pixel rows that triangles reach"),
    *(
        Counter(
            f"tiles_{size}{suffix}",
            f"tiles of {size} px{note}",
            "tiles",
            description=f"tiles of {size} x {size} px that {what} touch",
        )
        for suffix, note, what in _TILES
        for size in (16, 32, 64)
    ),
    Counter("tiles", "tiles", "tiles", description="tiles that triangles are put into"),
    Counter("nodes", "squares tested", "squares", description="squares tested on the way down"),
    Counter("tested_blocks", "blocks tested", "blocks", description="blocks tested by pixels"),
    Counter("beats", "beats", "beats", description="cycles in which covered quads leave"),
    Counter(
        "traversal_cycles",
        "traversal",
        "cycles",
        description="cycles in which the rasteriser descends",
    ),
    Counter(
        "empty_quads",
        "empty quads",
        "quads",
        description="quads that the rasteriser tries and that cover nothing",
    ),
    Counter(
        "busiest_pipe_quads",
        "quads of the busiest pipe",
        "quads",
        description="quads of the pipe that writes most",
    ),
    Counter("colour_misses", "misses", "lines", description="lines the colour cache lacks"),
    Counter("colour_bytes", "colour bytes", "bytes", description="colour read and written"),
    Counter("shaded_vertices", "vertices shaded", "vertices", description="vertices shaded"),
    Counter("quads", "quads", "quads", description="2x2 quads shaded"),
    Counter(
        "partial_quads",
        "partial quads",
        "quads",
        best_case=0.0,
        description="2x2 quads shaded of which a lane covers nothing",
    ),
    Counter("blocks", "4x4 blocks", "blocks", description="4x4 pixel blocks touched"),
    Counter("fragments", "fragments", "pixels", better="none", description="covered pixels"),
    Counter(
        "hits", "hits", "pixels", better="none", description="covered pixels, found by testing"
    ),
    Counter(
        "depth_ties",
        "ties of depth",
        "pixels",
        better="none",
        description="depth tests that rounding decides, so that devices may differ",
    ),
    Counter(
        "samples_passed",
        "samples passed",
        "samples",
        better="none",
        description="covered samples, by the driver's own query",
    ),
)

COUNTERS = {counter.name: counter for counter in _COUNTERS}
"""Counters of the built-in rasterisers, in the order in which they are shown."""

_learned: dict[str, Counter] = {}


def describe(name: str) -> Counter:
    """Return what is known of the counter `name`; one never heard of is taken to be work."""
    known = COUNTERS.get(name) or _learned.get(name)
    if known is not None:
        return known
    return Counter(name, name.replace("_", " "))


def learn(counters: Iterable[Counter]) -> None:
    """Know how a third party's rasteriser wants its counters shown; built-in ones stay."""
    _learned.update({counter.name: counter for counter in counters})


def place(name: str) -> tuple[int, int, str]:
    """Return the sort key of a counter: built-in ones first, then learned ones, then others."""
    for rank, known in enumerate((COUNTERS, _learned)):
        if name in known:
            return rank, list(known).index(name), name
    return 2, 0, name


Columns = Mapping[str, Any]
"""Sums, or (p,) values of polygons, by name."""


@dataclass(frozen=True)
class InUnit:
    """What a criterion says of a counter, in the counter's unit.

    A criterion ranks; this says how many. Where both are drawn in one unit, marks lie on the line
    on which they are equal, and what they are off by is a percentage.

    measure : the counter
    formula : as it is written
    needs : columns of predictions that `compute` reads
    """

    measure: str
    formula: str
    needs: tuple[str, ...]
    compute: Callable[[Columns], Any]


ESTIMATES = {
    # A polygon of area S covers S pixels on average, and Q quads of four lanes are shaded.
    "helper_lanes_by_quads": InUnit(
        "helper_lanes",
        "4Q - S",
        ("expected_quads", "area"),
        lambda of: 4 * of["expected_quads"] - of["area"],
    ),
    # To first order Q is such that these are half-perimeters, and one for each triangle.
    "helper_lanes_by_half_perimeter": InUnit(
        "helper_lanes",
        "H + T",
        ("half_perimeter", "triangles"),
        lambda of: of["half_perimeter"] + of["triangles"],
    ),
    # Every pixel centre of a bounding box is tested.
    "bbox_tests_by_overdraw": InUnit(
        "bbox_tests", "A + S", ("overdraw", "area"), lambda of: of["overdraw"] + of["area"]
    ),
}
"""By their column; of a counter the exact one first."""


def of_measure(measure: str | None) -> list[str]:
    """Return the names of the estimates of a counter, the exact one first."""
    return [name for name, each in ESTIMATES.items() if each.measure == measure]


def estimated(columns: Columns, prefix: str = "") -> dict[str, Any]:
    """Return every estimate that the columns, or sums, allow; names of both begin with `prefix`."""
    found = {}
    for name, each in ESTIMATES.items():
        known = {need: columns.get(prefix + need) for need in each.needs}
        if all(value is not None for value in known.values()):
            found[prefix + name] = each.compute(known)
    return found
