"""What rasterisers count: how each counter is shown; what criteria predict of it, in its unit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal


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


_TABLE = (
    ("helper_lanes", "helper lanes", "lanes", "lanes of shaded 2x2 quads that cover nothing"),
    ("bbox_tests", "bounding-box tests", "tests", "pixel centres tested in bounding boxes"),
    ("rows", "rows walked", "rows", "pixel rows that triangles reach"),
    *(
        (
            f"tiles_{px}{suffix}",
            f"tiles of {px} px{how}",
            "tiles",
            f"tiles of {px} x {px} px that {what} touch",
        )
        for suffix, how, what in (
            ("", "", "bounding boxes"),
            ("_exact", ", exactly", "the triangles themselves"),
        )
        for px in (16, 32, 64)
    ),
    ("quads", "quads", "quads", "2x2 quads shaded"),
    ("partial_quads", "partial quads", "quads", "2x2 quads shaded of which a lane covers nothing"),
    ("blocks", "4x4 blocks", "blocks", "4x4 pixel blocks touched"),
    ("fragments", "fragments", "pixels", "covered pixels"),
    ("hits", "hits", "pixels", "covered pixels, found by testing"),
    (
        "depth_ties",
        "ties of depth",
        "pixels",
        "depth tests that rounding decides, so that devices may differ",
    ),
    ("samples_passed", "samples passed", "samples", "covered samples, by the driver's own query"),
)
"""Names, labels, units and descriptions of the built-in rasterisers' counters."""

_MORE: dict[str, dict[str, Any]] = {
    "helper_lanes": {"heading": "helpers", "best_case": 0.0},
    "bbox_tests": {"heading": "tests"},
    "partial_quads": {"best_case": 0.0},
    **{same: {"better": "none"} for same in ("fragments", "hits", "depth_ties", "samples_passed")},
}
"""What else is known of some of them."""

COUNTERS = {
    name: Counter(name, label, unit, description=description, **_MORE.get(name, {}))
    for name, label, unit, description in _TABLE
}
"""Counters of the built-in rasterisers, in the order in which they are shown."""

_known = dict(COUNTERS)
"""These, and then those that third parties' rasterisers told."""


def describe(name: str) -> Counter:
    """Return what is known of the counter `name`; one never heard of is taken to be work."""
    return _known.get(name) or Counter(name, name.replace("_", " "))


def learn(counters: Iterable[Counter]) -> None:
    """Know how a third party's rasteriser wants its counters shown; built-in ones stay."""
    _known.update({counter.name: counter for counter in counters} | COUNTERS)


def place(name: str) -> tuple[int, str]:
    """Return the sort key of a counter: built-in ones first, then learned ones, then others."""
    return list(_known).index(name) if name in _known else len(_known), name


@dataclass(frozen=True)
class InUnit:
    """What a criterion says of a counter, in the counter's unit.

    A criterion ranks; this says how many. Where both are drawn in one unit, marks lie on the line
    on which they are equal, and what they are off by is a percentage.

    measure : the counter
    formula : as it is written
    terms : columns of predictions, and how often each counts in the sum
    """

    measure: str
    formula: str
    terms: Mapping[str, int]


ESTIMATES = {
    # A polygon of area S covers S pixels on average, and Q quads of four lanes are shaded.
    "helper_lanes_by_quads": InUnit("helper_lanes", "4Q - S", {"expected_quads": 4, "area": -1}),
    # To first order Q is such that these are half-perimeters, and one for each triangle.
    "helper_lanes_by_half_perimeter": InUnit(
        "helper_lanes", "H + T", {"half_perimeter": 1, "triangles": 1}
    ),
    # Every pixel centre of a bounding box is tested.
    "bbox_tests_by_overdraw": InUnit("bbox_tests", "A + S", {"overdraw": 1, "area": 1}),
}
"""By their column; of a counter the exact one first."""


def estimated(columns: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return every estimate that the columns, or sums, allow; names of both begin with `prefix`."""
    found = {}
    for name, each in ESTIMATES.items():
        known: dict[str, Any] = {term: columns.get(prefix + term) for term in each.terms}
        if all(value is not None for value in known.values()):
            found[prefix + name] = sum(each.terms[term] * known[term] for term in known)
    return found
