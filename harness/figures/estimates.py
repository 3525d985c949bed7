"""Costs in their own unit, as criteria predict them: helper lanes, bounding-box tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

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
