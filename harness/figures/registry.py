"""Every figure there is, by name: what it is, its unit, which way is better, how to compute it.

A record holds raw samples and counters only. Tables, plots, comparisons, studies and reports
choose from this registry and compute through it, so that one name means one thing everywhere:

- what a rasteriser counts is a figure, declared in `harness.figures.counters` or by a third
  party's rasteriser; a counter that nobody declared is one too;
- what `triangulators.criteria` predicts is a figure;
- what is derived from both, and from times, is in `METRICS` below.
"""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

from harness.figures import counters
from harness.figures.counters import ESTIMATES
from harness.stored.folder import Record
from triangulators import criteria

Kind = Literal["counter", "ratio", "prediction", "time", "count"]
Better = Literal["lower", "higher", "none"]
Read = Callable[[Record], float | None]

PREDICTED = "predicted_"
"""Prefix of a prediction's column where counters stand beside it."""

LANES = 4
"""Of a quad."""

OUTLINE = "outline_quads"
"""Field of a record, and column, of the quads that the polygons' outlines cover."""

LEAST = "least"
"""Field of a record: of the polygons whose fewest quads are known, how many they are, their fewest
`quads`, and the `shaded` quads and `fragments` of the record's own triangles."""


@dataclass(frozen=True)
class Figure:
    """One figure of a record.

    name : its key and its column in files
    label, symbol, unit : how tables and plots show it; a ratio's unit is "x"
    function : record -> value, or None where the record has no such figure
    kind : "counter", "ratio" of exact figures, "prediction", "time", or "count" of something else
    better : "lower" or "higher" is better, or "none" where neither is
    best_case : the value no triangulation can beat, None where it depends on the scene
    heading : its heading in the terminal's table; "" leaves it out
    form : how the table writes it
    instead_of : the figure whose place it takes in that table, where there is no room for both
    """

    name: str
    label: str
    unit: str
    function: Read
    kind: Kind
    better: Better = "lower"
    best_case: float | None = None
    symbol: str = ""
    description: str = ""
    heading: str = ""
    form: str = "{:,.0f}"
    instead_of: str = ""

    def __call__(self, record: Record) -> float | None:
        """Return the figure for `record`."""
        return self.function(record)

    @property
    def title(self) -> str:
        """Label and symbol, e.g. half-perimeter H."""
        return f"{self.label} {self.symbol}".strip()

    @property
    def exact(self) -> bool:
        """Whether it is the same at every run: everything but times."""
        return self.kind != "time"

    @property
    def is_shared(self) -> bool:
        """Whether every triangulation of a polygon has the same, so that any change is a defect."""
        return self.kind == "counter" and self.better == "none"

    @property
    def has_direction(self) -> bool:
        """Whether growth beyond a threshold can be a regression."""
        return self.better != "none" or self.is_shared

    @property
    def is_cost(self) -> bool:
        """Whether a change for the worse is a regression without being asked for.

        Ratios of counters say nothing that the counters do not, and predictions are not
        measurements.
        """
        return self.kind in ("counter", "count") and self.has_direction


def _field(*path: str, scale: float = 1.0) -> Read:
    def read(record: Record) -> float | None:
        value: Any = record
        for name in path:
            value = value.get(name) if isinstance(value, dict) else None
        return None if value is None else value * scale

    return read


def _ratio(top: Read, bottom: Read, scale: int = 1) -> Read:
    def divide(record: Record) -> float | None:
        numerator, denominator = top(record), bottom(record)
        if numerator is None or not denominator:
            return None
        return scale * numerator / denominator

    return divide


def _counter(name: str) -> Read:
    return _field("counters", name)


def _quads_above_limit(record: Record) -> float | None:
    quads, outline = _quads(record), record.get(OUTLINE)
    return None if quads is None or outline is None else quads - outline


def _regret(record: Record) -> float | None:
    """Return how many more helper lanes there are than the fewest of any triangulation."""
    known = record.get(LEAST)
    if not known or 4 * known["quads"] <= known["fragments"]:
        return None
    fewest, own = (4 * known[name] - known["fragments"] for name in ("quads", "shaded"))
    return float(own / fewest - 1.0)


def limit_of(record: Record) -> Record | None:
    """Return a record of the same polygons, each drawn in one piece: what no triangles go below.

    It has counters only; None where they are not known.
    """
    fragments, outline = _counter("fragments")(record), record.get(OUTLINE)
    if fragments is None or outline is None:
        return None
    helpers = 4 * outline - fragments
    return {"counters": {"fragments": fragments, "quads": outline, "helper_lanes": helpers}}


def _reference_s(record: Record) -> float | None:
    reference = (record.get("time") or {}).get("reference_s")
    return statistics.median(reference) if reference else None


_fragments, _quads = _counter("fragments"), _counter("quads")

_METRICS = (
    Figure(
        "overshading",
        "lanes shaded per pixel",
        "x",
        _ratio(_quads, _fragments, LANES),
        kind="ratio",
        best_case=1.0,
        description="lanes shaded for each pixel covered",
        heading="lanes/px",
        form="{:.3f}",
    ),
    Figure(
        "regret",
        "helper lanes above the fewest there are",
        "x",
        _regret,
        kind="ratio",
        best_case=0.0,
        description=(
            "helper lanes more than those of the triangulation that shades the fewest quads, "
            "in ratio to these, over the polygons of which that is known"
        ),
        heading="regret",
        form="{:.1%}",
        instead_of="overshading",
    ),
    Figure(
        "above_limit",
        "lanes per pixel above the limit",
        "x",
        _ratio(_quads_above_limit, _fragments, LANES),
        kind="ratio",
        best_case=0.0,
        description=(
            "lanes shaded for each pixel covered beyond those of the outline drawn in one "
            "piece: what diagonals cost"
        ),
    ),
    Figure(
        OUTLINE,
        "quads of the outline",
        "quads",
        _field(OUTLINE),
        kind="count",
        better="none",
        description="2x2 quads that the outlines cover: no triangulation shades fewer",
    ),
    Figure(
        "bbox_overdraw",
        "tests per pixel",
        "x",
        _ratio(_counter("bbox_tests"), _fragments),
        kind="ratio",
        best_case=1.0,
        description="pixel centres tested for each pixel covered",
    ),
    Figure(
        "draw_ms",
        "draw time",
        "ms",
        _field("time", "median_s", scale=1e3),
        kind="time",
        best_case=0.0,
        description="median time of one draw",
        heading="draw ms",
        form="{:.3f}",
    ),
    Figure(
        "draw_of_reference",
        "draw time, ratio to the reference",
        "x",
        _ratio(_field("time", "median_s"), _reference_s),
        kind="time",
        best_case=0.0,
        description="median draw over the same run's reference triangle",
    ),
    Figure(
        "triangulate_ms",
        "time to triangulate",
        "ms",
        _field("triangulate_s", scale=1e3),
        kind="time",
        best_case=0.0,
        description="time to triangulate the scene",
    ),
    Figure(
        "triangles",
        "triangles",
        "triangles",
        _field("triangles"),
        kind="count",
        description="triangles drawn",
    ),
    Figure(
        "coverage_error",
        "coverage error",
        "pixels",
        _field("coverage_error"),
        kind="count",
        best_case=0.0,
        description="pixels covered too often or not at all: a defect of the triangulation",
    ),
    Figure(
        "proven",
        "proven optimal",
        "polygons",
        _field("proven"),
        kind="count",
        better="higher",
        description="polygons of which no triangulation has less of the criterion, with proof",
    ),
    Figure(
        "t_junctions",
        "T-junctions",
        "vertices",
        _field("t_junctions"),
        kind="count",
        best_case=0.0,
        description="vertices inside a triangle's edge, where cracks can show",
    ),
)

METRICS = {figure.name: figure for figure in _METRICS}
"""Figures derived from records; one added here is in every plot, comparison and report, and in the
terminal's table if it has a `heading`."""


@cache
def _of_counter(counter: counters.Counter) -> Figure:
    return Figure(
        counter.name,
        counter.label,
        counter.unit,
        _counter(counter.name),
        kind="counter",
        better=counter.better,
        best_case=counter.best_case,
        description=counter.description or counter.label,
        heading=counter.heading,
    )


@cache
def _of_criterion(criterion: criteria.Criterion) -> Figure:
    return Figure(
        criterion.column,
        criterion.label or criterion.name,
        criterion.unit,
        _field("predicted", criterion.column),
        kind="prediction",
        symbol=criterion.symbol,
        description=f"predicted: {criterion.description}",
    )


@cache
def _of_estimate(name: str) -> Figure:
    each = ESTIMATES[name]
    counted = _of_counter(counters.describe(each.measure))
    read = _field("predicted", name)
    label = f"{counted.label} by {each.formula}"
    return replace(counted, name=name, label=label, kind="prediction", function=read, heading="")


@cache
def _of_feature(column: str) -> Figure:
    """Return a prediction that is no criterion: a term of fits, or of a criterion since removed."""
    read = _field("predicted", column)
    label = column.replace("_", " ")
    return Figure(PREDICTED + column, label, "1", read, kind="prediction", better="none")


def predictions() -> dict[str, Figure]:
    """Return the figure of each criterion by its column, in the order in which they are shown."""
    return {each.column: _of_criterion(each) for each in criteria.predicted()}


def find(name: str) -> Figure:
    """Return the figure called `name`; a name that is nothing else is taken for a counter.

    Criteria may be written as on the command line (half-perimeter), as their column
    (half_perimeter) or as the column beside counters (predicted_half_perimeter).
    """
    if name in METRICS:
        return METRICS[name]
    column = name.removeprefix(PREDICTED).replace("-", "_")
    if column in ESTIMATES:
        return _of_estimate(column)
    known = predictions()
    if column in known:
        return known[column]
    if name.startswith(PREDICTED):
        return _of_feature(column)
    return _of_counter(counters.describe(name))


def figures() -> dict[str, Figure]:
    """Return all figures that are known before anything is measured, by name."""
    counted = {name: _of_counter(each) for name, each in counters.COUNTERS.items()}
    return counted | METRICS | predictions()


def figures_of(records: Iterable[Record]) -> dict[str, Figure]:
    """Return every figure that at least one record has: counters, metrics, predictions."""
    records = list(records)
    counted = {name for record in records for name in record.get("counters") or ()}
    found = {name: _of_counter(counters.describe(name)) for name in in_order(counted)}
    rest = {**METRICS, **predictions()}
    return found | {
        name: figure
        for name, figure in rest.items()
        if name not in found and any(figure(record) is not None for record in records)
    }


def in_order(names: Iterable[str]) -> list[str]:
    """Return names of counters in the order in which they are shown."""
    return sorted(names, key=counters.place)


def measures(names: Iterable[str]) -> list[str]:
    """Return those of `names` that are counters a triangulation can change, the main one first."""
    found = (name for name in names if not name.startswith(PREDICTED) and name != LEAST)
    return [
        name
        for name in in_order(found)
        if (figure := find(name)).kind == "counter" and figure.better == "lower"
    ]


def value_of(record: Record, names: Sequence[str]) -> float | None:
    """Return the first of the named figures that `record` has."""
    return next((v for name in names if (v := find(name)(record)) is not None), None)
