"""Counters of rasterisers: how each is displayed, and estimates of counters from criteria."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Counter:
    """An exact integer that a rasteriser counts.

    name : key in records and column name in files
    label, unit : in tables and plots
    better : "lower" if a lower value is less work; "none" if all triangulations of a polygon have
        the same value
    best_case : lower bound over all triangulations, or None if the bound depends on the scene
    of_order : whether the counter depends on the order of triangles, which no criterion predicts
    heading : shorter label for the terminal's table; with "" the table omits the counter, unless
        the rasteriser has no other counter
    gated : whether `compare` fails if the counter increases; False for inexact driver statistics
    """

    name: str
    label: str
    unit: str = "count"
    better: Literal["lower", "none"] = "lower"
    best_case: float | None = None
    of_order: bool = False
    heading: str = ""
    description: str = ""
    gated: bool = True


# Names, labels and units of a driver's pipeline statistics.
_STATISTICS = (
    ("vertex_shader_invocations", "vertex shader invocations", "invocations"),
    ("clipping_input_primitives", "primitives before clipping", "triangles"),
    ("clipping_output_primitives", "primitives after clipping", "triangles"),
)

_TABLE = (  # name, label, unit and description of the built-in rasterisers' counters
    ("helper_lanes", "helper lanes", "lanes", "uncovered lanes of shaded 2x2 quads"),
    ("bbox_tests", "bounding-box tests", "tests", "pixel centres tested in bounding boxes"),
    ("rows", "rows", "rows", "pixel rows in bounding boxes of triangles"),
    *(
        (f"tiles_{px}{suffix}", f"tiles of {px} px{mode}", "tiles", f"{px}x{px} px {tiles}")
        for suffix, mode, tiles in (
            ("", "", "tiles that overlap bounding boxes"),
            ("_exact", ", exact", "tiles that overlap triangles"),
        )
        for px in (16, 32, 64)
    ),
    ("quads", "quads", "quads", "shaded 2x2 quads"),
    ("partial_quads", "partial quads", "quads", "shaded 2x2 quads with helper lanes"),
    ("covering_triangles", "covering triangles", "triangles", "triangles that cover a sample"),
    ("blocks", "4x4 blocks", "blocks", "4x4 pixel blocks with a covered pixel"),
    ("fragments", "fragments", "pixels", "covered pixels"),
    ("hits", "hits", "pixels", "covered pixels, found by tests of pixel centres"),
    ("depth_ties", "depth ties", "pixels", "depth tests that depend on a device's rounding"),
    (
        "vertex_batches",
        "vertex batches",
        "batches",
        "index batches of at most 32 vertices and 32 triangles",
    ),
    (
        "transformed_vertices",
        "transformed vertices",
        "vertices",
        "distinct vertices of each batch, summed",
    ),
    ("samples_passed", "samples passed", "samples", "covered samples, by the driver's query"),
    *(
        (name, f"{label}, driver", unit, f"{label}, by the driver's query")
        for name, label, unit in _STATISTICS
    ),
)

_PROPERTIES: dict[str, dict[str, Any]] = {
    "helper_lanes": {"heading": "helpers", "best_case": 0.0},
    "bbox_tests": {"heading": "tests"},
    "partial_quads": {"best_case": 0.0},
    **{name: {"of_order": True} for name in ("vertex_batches", "transformed_vertices")},
    "covering_triangles": {"heading": "covering"},
    **{name: {"better": "none"} for name in ("fragments", "hits", "depth_ties", "samples_passed")},
    **{name: {"better": "none", "gated": False} for name, *_ in _STATISTICS},
}

COUNTERS = {  # of the built-in rasterisers, in display order
    name: Counter(name, label, unit, description=description, **_PROPERTIES.get(name, {}))
    for name, label, unit, description in _TABLE
}

_registered = dict(COUNTERS)  # and counters registered by third-party rasterisers


def get_counter(name: str) -> Counter:
    """Return the counter called `name`; for an unregistered name, lower is better."""
    return _registered.get(name) or Counter(name, name.replace("_", " "))


def register_counters(counters: Iterable[Counter]) -> None:
    """Register third-party counters; built-in counters cannot be replaced."""
    _registered.update({counter.name: counter for counter in counters} | COUNTERS)


def get_sort_key(name: str) -> tuple[int, str]:
    """Return a key that sorts counters by name: built-in, then third-party, then unknown ones."""
    return list(_registered).index(name) if name in _registered else len(_registered), name


@dataclass(frozen=True)
class Estimate:
    """An estimate of a counter, `measure`, from criteria, in the counter's unit.

    A criterion only ranks triangulations; an estimate predicts the count, so the error is a
    percentage. `terms` are the coefficients of criteria in the sum; `formula` is for display.
    """

    measure: str
    formula: str
    terms: Mapping[str, int]


ESTIMATES = {
    # Q shaded quads have 4 Q lanes, and a polygon of area S covers S of them on average.
    "helper_lanes_by_quads": Estimate("helper_lanes", "4Q - S", {"expected_quads": 4, "area": -1}),
    # To first order, helper lanes are H + T: sum of half-perimeters (px) plus number of triangles.
    "helper_lanes_by_half_perimeter": Estimate(
        "helper_lanes", "H + T", {"half_perimeter": 1, "triangles": 1}
    ),
    # Every pixel centre in a bounding box is tested. The boxes' area is the area S of the triangles
    # plus A, the area of the boxes outside their triangles (the criterion "overdraw").
    "bbox_tests_by_overdraw": Estimate("bbox_tests", "A + S", {"overdraw": 1, "area": 1}),
}
"""Estimates by column name; if a counter has several, the first is exact on average."""


def compute_estimates(columns: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return by name the `ESTIMATES` whose terms are all in `columns`; `prefix` precedes names."""
    estimates = {}
    for name, estimate in ESTIMATES.items():
        values: dict[str, Any] = {term: columns.get(prefix + term) for term in estimate.terms}
        if all(value is not None for value in values.values()):
            estimates[prefix + name] = sum(estimate.terms[term] * values[term] for term in values)
    return estimates
