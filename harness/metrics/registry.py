"""Registry of metrics: name, unit, direction, and the function that computes it from a record.

A record holds raw samples and counters only. Tables, plots, comparisons, studies and reports
compute through this registry, so that a name means the same everywhere. Metrics are

- counters, declared in `harness.rasterisers.counters` or by a third party's rasteriser; a counter
  that nobody declared is a metric, too;
- predictions of `triangulators.criteria`;
- what is derived from both, and from times: `METRICS` below.
"""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

from harness.rasterisers import counters
from harness.rasterisers.counters import ESTIMATES
from harness.results.record import Record
from harness.settings import COST_COUNTERS
from triangulators import criteria

Kind = Literal["counter", "ratio", "prediction", "time", "count"]
Better = Literal["lower", "higher", "none"]
Read = Callable[[Record], float | None]

PREDICTED = "predicted_"
"""Prefix of a prediction's column where counters stand beside it."""

LANES_PER_QUAD = 4

OUTLINE = "outline_quads"
"""Field of a record, and column, of the quads that the polygons' outlines cover."""

LEAST = "least"
"""Column of each polygon's minimum number of quads; their sums are `Record.least`."""


@dataclass(frozen=True)
class Metric:
    """A metric of a record.

    name : its key and its column in files
    label, symbol, unit : how tables and plots show it; a ratio's unit is "x"
    function : record -> value, or None if the record lacks it
    kind : "counter", "ratio" of exact metrics, "prediction", "time", or "count" of something else
    better : "lower" or "higher" is better, or "none" where neither is
    best_case : the value no triangulation can beat, None where it depends on the scene
    heading : its heading in the terminal's table; "" leaves it out
    form : how the table writes it
    instead_of : the metric that it replaces in that table, which has no room for both
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
        """Return the value of `record`."""
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


def _read_counter(name: str) -> Read:
    return lambda record: record.counters.get(name)


def _read_prediction(column: str) -> Read:
    return lambda record: record.predicted.get(column)


def _median_s(record: Record) -> float | None:
    return None if record.time is None else record.time.median_s


_quads, _fragments = _read_counter("quads"), _read_counter("fragments")


def _over(value: float | None, base: float | None, times: int = 1) -> float | None:
    return None if value is None or not base else times * value / base


def _in_ms(seconds: float | None) -> float | None:
    return None if seconds is None else seconds * 1e3


def limit_of(record: Record) -> Record | None:
    """Return a record of the same polygons, each drawn in one piece: the lower bound of counters.

    It has nothing but counters; None if they are unknown.
    """
    fragments, outline = record.counters.get("fragments"), record.outline_quads
    if fragments is None or outline is None:
        return None
    helpers = LANES_PER_QUAD * outline - fragments
    counters = {"fragments": fragments, "quads": outline, "helper_lanes": helpers}
    return Record(record.id, "ok", counters=counters)


METRICS: dict[str, Metric] = {}
"""Metrics derived from records; one added here is in every plot, comparison and report, and in the
terminal's table if it has a `heading`."""


def _metric(label: str, unit: str, kind: Kind, **more: Any) -> Callable[[Read], Read]:
    """Put a function among `METRICS`, by its name; its docstring says what it is."""

    def put(function: Read) -> Read:
        name, words = function.__name__, " ".join((function.__doc__ or "").split())
        more["description"] = words[:1].lower() + words[1:].rstrip(".")
        METRICS[name] = Metric(name, label, unit, function, kind, **more)
        return function

    return put


@_metric("lanes shaded per pixel", "x", "ratio", best_case=1.0, heading="lanes/px", form="{:.3f}")
def overshading(record: Record) -> float | None:
    """Lanes shaded for each pixel covered."""
    return _over(_quads(record), _fragments(record), LANES_PER_QUAD)


_SHOWN = {"heading": "regret", "form": "{:.1%}", "instead_of": "overshading"}


@_metric("helper lanes above the fewest there are", "x", "ratio", best_case=0.0, **_SHOWN)
def regret(record: Record) -> float | None:
    """Helper lanes more than those of the triangulation that shades the fewest quads, in ratio to
    these, over the polygons of which that is known.
    """
    least = record.least
    if least is None or LANES_PER_QUAD * least.quads <= least.fragments:
        return None
    minimum = LANES_PER_QUAD * least.quads - least.fragments
    return (LANES_PER_QUAD * least.shaded - least.fragments) / minimum - 1.0


@_metric("lanes per pixel above the limit", "x", "ratio", best_case=0.0)
def above_limit(record: Record) -> float | None:
    """Lanes shaded for each pixel covered beyond those of the outline drawn in one piece: what
    diagonals cost.
    """
    quads, outline = _quads(record), record.outline_quads
    if quads is None or outline is None:
        return None
    return _over(quads - outline, _fragments(record), LANES_PER_QUAD)


@_metric("quads of the outline", "quads", "count", better="none")
def outline_quads(record: Record) -> float | None:
    """2x2 quads that the outlines cover: no triangulation shades fewer."""
    return record.outline_quads


@_metric("tests per pixel", "x", "ratio", best_case=1.0)
def bbox_overdraw(record: Record) -> float | None:
    """Pixel centres tested for each pixel covered."""
    return _over(record.counters.get("bbox_tests"), _fragments(record))


@_metric("draw time", "ms", "time", best_case=0.0, heading="draw ms", form="{:.3f}")
def draw_ms(record: Record) -> float | None:
    """Median time of one draw."""
    return _in_ms(_median_s(record))


@_metric("draw time, ratio to the reference", "x", "time", best_case=0.0)
def draw_of_reference(record: Record) -> float | None:
    """Median draw over the same run's reference triangle."""
    reference = record.time.reference_s if record.time else ()
    return _over(_median_s(record), statistics.median(reference) if reference else None)


@_metric("time to triangulate", "ms", "time", best_case=0.0)
def triangulate_ms(record: Record) -> float | None:
    """Time to triangulate the scene."""
    return _in_ms(record.triangulate_s)


@_metric("triangles", "triangles", "count")
def triangles(record: Record) -> float | None:
    """Triangles drawn."""
    return record.triangles


@_metric("coverage error", "pixels", "count", best_case=0.0)
def coverage_error(record: Record) -> float | None:
    """Pixels covered too often or not at all: a defect of the triangulation."""
    return record.coverage_error


@_metric("proven optimal", "polygons", "count", better="higher")
def proven(record: Record) -> float | None:
    """Polygons of which no triangulation has less of the criterion, with proof."""
    return record.proven


@_metric("T-junctions", "vertices", "count", best_case=0.0)
def t_junctions(record: Record) -> float | None:
    """Vertices inside a triangle's edge, where cracks can show."""
    return record.t_junctions


@cache
def _of_counter(counter: counters.Counter) -> Metric:
    return Metric(
        counter.name,
        counter.label,
        counter.unit,
        _read_counter(counter.name),
        kind="counter",
        better=counter.better,
        best_case=counter.best_case,
        description=counter.description or counter.label,
        heading=counter.heading,
    )


@cache
def _of_criterion(criterion: criteria.Criterion) -> Metric:
    return Metric(
        criterion.column,
        criterion.label or criterion.name,
        criterion.unit,
        _read_prediction(criterion.column),
        kind="prediction",
        symbol=criterion.symbol,
        description=f"predicted: {criterion.description}",
    )


@cache
def _of_estimate(name: str) -> Metric:
    each = ESTIMATES[name]
    counted = _of_counter(counters.describe(each.measure))
    read = _read_prediction(name)
    label = f"{counted.label} by {each.formula}"
    return replace(counted, name=name, label=label, kind="prediction", function=read, heading="")


@cache
def _of_feature(column: str) -> Metric:
    """Return a prediction that is no criterion: a term of fits, or of a criterion since removed."""
    read = _read_prediction(column)
    label = column.replace("_", " ")
    return Metric(PREDICTED + column, label, "1", read, kind="prediction", better="none")


def predictions() -> dict[str, Metric]:
    """Return the metric of each criterion by its column, in the order of display."""
    return {each.column: _of_criterion(each) for each in criteria.list_predicted()}


def find_metric(name: str) -> Metric:
    """Return the metric called `name`; an unknown name is taken for a counter.

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


def list_metrics() -> dict[str, Metric]:
    """Return the metrics that are known before anything is measured, by name."""
    counted = {name: _of_counter(each) for name, each in counters.COUNTERS.items()}
    return counted | METRICS | predictions()


def metrics_of(records: Iterable[Record]) -> dict[str, Metric]:
    """Return the metrics that at least one record has: counters, derived ones, predictions."""
    records = list(records)
    counted = {name for record in records for name in record.counters}
    metrics = {name: _of_counter(counters.describe(name)) for name in in_order(counted)}
    others = {**METRICS, **predictions()}
    return metrics | {
        name: metric
        for name, metric in others.items()
        if name not in metrics and any(metric(record) is not None for record in records)
    }


def in_order(names: Iterable[str]) -> list[str]:
    """Return names of counters in the order in which they are shown."""
    return sorted(names, key=counters.sort_key)


def measures(names: Iterable[str]) -> list[str]:
    """Return those of `names` that are counters a triangulation can change, the main one first."""
    candidates = [name for name in names if not name.startswith(PREDICTED) and name != LEAST]
    first = [name for name in COST_COUNTERS if name in candidates]
    return [
        name
        for name in dict.fromkeys([*first, *in_order(candidates)])
        if (metric := find_metric(name)).kind == "counter" and metric.better == "lower"
    ]


def value_of(record: Record, names: Sequence[str]) -> float | None:
    """Return the value of the first of the named metrics that `record` has, or None."""
    return next((v for name in names if (v := find_metric(name)(record)) is not None), None)
