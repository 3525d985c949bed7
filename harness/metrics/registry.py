"""Registry of metrics: name, unit, direction, and the function that computes a record's value.

Metrics are counters, declared by a rasteriser or not; predictions of `triangulators.criteria`; and
`METRICS`, which are derived from both and from times. All outputs use this registry, so that a name
means the same everywhere.
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

MetricKind = Literal["counter", "ratio", "prediction", "time", "count"]
Better = Literal["lower", "higher", "none"]
Read = Callable[[Record], float | None]

PREDICTED = "predicted_"  # prefix of a prediction's column in tables that also have counters

LANES_PER_QUAD = 4

OUTLINE = "outline_quads"  # field of a record: quads that the polygons' outlines cover

MIN_QUADS = "least"  # column of each polygon's minimum quads, with sums in `Record.least`


@dataclass(frozen=True)
class Metric:
    """A metric of a record.

    Parameters
    ----------
    name : str
        Key, and column in files.
    label, unit, symbol, description : str
        Texts of tables and plots; a ratio's unit is "x".
    function : callable
        Record -> value, or None for a record without the value.
    kind : {"counter", "ratio", "prediction", "time", "count"}
        "ratio" is a ratio of exact metrics, "count" an exact number that is not a counter.
    better : {"lower", "higher", "none"}
        Better direction.
    best_case : float, optional
        Bound for all triangulations; by default the bound depends on the scene.
    heading, form : str
        Heading and format string in the terminal's table; "" omits the metric.
    gated : bool
        Whether `compare` fails if the metric increases; False for a driver's inexact statistics.
    """

    name: str
    label: str
    unit: str
    function: Read
    kind: MetricKind
    better: Better = "lower"
    best_case: float | None = None
    symbol: str = ""
    description: str = ""
    heading: str = ""
    form: str = "{:,.0f}"
    gated: bool = True

    def __call__(self, record: Record) -> float | None:
        """Return the value of `record`."""
        return self.function(record)

    @property
    def title(self) -> str:
        """Label and symbol, e.g. half-perimeter H."""
        return f"{self.label} {self.symbol}".strip()

    @property
    def exact(self) -> bool:
        """Whether the value is the same in every run, unlike times."""
        return self.kind != "time"

    @property
    def is_shared(self) -> bool:
        """Whether the value is the same in all triangulations, so that a change is a defect."""
        return self.gated and self.kind == "counter" and self.better == "none"

    @property
    def can_regress(self) -> bool:
        """Whether a change beyond a threshold can be a regression."""
        return self.better != "none" or self.is_shared

    @property
    def is_cost(self) -> bool:
        """Whether an increase is a regression by default; not of ratios and predictions."""
        return self.kind in ("counter", "count") and self.can_regress


def _read_counter(name: str) -> Read:
    return lambda record: record.counters.get(name)


def _read_prediction(column: str) -> Read:
    return lambda record: record.predicted.get(column)


def _get_median_s(record: Record) -> float | None:
    return None if record.time is None else record.time.median_s


_quads, _fragments = _read_counter("quads"), _read_counter("fragments")


def _divide(value: float | None, base: float | None, factor: float = 1) -> float | None:
    return None if value is None or not base else factor * value / base


def compute_lower_bound(record: Record) -> Record | None:
    """Return a record with the counters of polygons drawn without diagonals, or None if unknown."""
    fragments, outline = record.counters.get("fragments"), record.outline_quads
    if fragments is None or outline is None:
        return None
    helpers = LANES_PER_QUAD * outline - fragments
    counters = {"fragments": fragments, "quads": outline, "helper_lanes": helpers}
    return Record(record.id, "ok", counters=counters)


METRICS: dict[str, Metric] = {}  # derived from records; a `heading` adds a column to the table


def _register(label: str, unit: str, kind: MetricKind, **properties: Any) -> Callable[[Read], Read]:
    """Register a function in `METRICS` by name, with the docstring as description."""

    def register(function: Read) -> Read:
        name, text = function.__name__, " ".join((function.__doc__ or "").split())
        properties["description"] = text[:1].lower() + text[1:].rstrip(".")
        METRICS[name] = Metric(name, label, unit, function, kind, **properties)
        return function

    return register


@_register("lanes shaded per pixel", "x", "ratio", best_case=1.0)
def overshading(record: Record) -> float | None:
    """Lanes shaded per covered pixel."""
    return _divide(_quads(record), _fragments(record), LANES_PER_QUAD)


@_register(
    "helper lanes above the minimum", "x", "ratio", best_case=0.0, heading="regret", form="{:.1%}"
)
def regret(record: Record) -> float | None:
    """Extra helper lanes relative to the triangulation with the minimum number of quads, over the
    polygons whose minimum is known.
    """
    sums = record.least
    if sums is None or LANES_PER_QUAD * sums.quads <= sums.fragments:
        return None
    min_lanes = LANES_PER_QUAD * sums.quads - sums.fragments
    return (LANES_PER_QUAD * sums.shaded - sums.fragments) / min_lanes - 1.0


@_register("lanes per pixel above the lower bound", "x", "ratio", best_case=0.0)
def above_limit(record: Record) -> float | None:
    """Lanes shaded per covered pixel beyond those of the outline drawn in one piece: the cost of
    diagonals.
    """
    quads, outline = _quads(record), record.outline_quads
    if quads is None or outline is None:
        return None
    return _divide(quads - outline, _fragments(record), LANES_PER_QUAD)


@_register("quads of the outline", "quads", "count", better="none")
def outline_quads(record: Record) -> float | None:
    """2x2 quads that the outlines cover: a lower bound for every triangulation."""
    return record.outline_quads


@_register("tests per pixel", "x", "ratio", best_case=1.0)
def bbox_overdraw(record: Record) -> float | None:
    """Pixel centres tested per covered pixel."""
    return _divide(record.counters.get("bbox_tests"), _fragments(record))


@_register("draw time", "ms", "time", best_case=0.0, heading="draw ms", form="{:.3f}")
def draw_ms(record: Record) -> float | None:
    """Median time of one draw."""
    return _divide(_get_median_s(record), 1, 1e3)


@_register("draw time relative to the reference", "x", "time", best_case=0.0)
def draw_of_reference(record: Record) -> float | None:
    """Median draw time divided by that of the reference triangle of the same run."""
    reference = record.time.reference_s if record.time else ()
    return _divide(_get_median_s(record), statistics.median(reference) if reference else None)


@_register("time to triangulate", "ms", "time", best_case=0.0)
def triangulate_ms(record: Record) -> float | None:
    """Time to triangulate the scene."""
    return _divide(record.triangulate_s, 1, 1e3)


@_register("triangles", "triangles", "count")
def triangles(record: Record) -> float | None:
    """Triangles drawn."""
    return record.triangles


@_register("coverage error", "pixels", "count", best_case=0.0)
def coverage_error(record: Record) -> float | None:
    """Pixels covered more than once or not at all: a defect of the triangulation."""
    return record.coverage_error


@_register("proven optimal", "polygons", "count", better="higher")
def proven(record: Record) -> float | None:
    """Polygons whose triangulation is proven optimal for its criterion."""
    return record.proven


@_register("T-junctions", "vertices", "count", best_case=0.0)
def t_junctions(record: Record) -> float | None:
    """Vertices inside a triangle's edge, where cracks can show."""
    return record.t_junctions


@cache
def _make_counter_metric(counter: counters.Counter) -> Metric:
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
        gated=counter.gated,
    )


@cache
def _make_criterion_metric(criterion: criteria.Criterion) -> Metric:
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
def _make_estimate_metric(name: str) -> Metric:
    estimate = ESTIMATES[name]
    counter = _make_counter_metric(counters.get_counter(estimate.measure))
    read = _read_prediction(name)
    label = f"{counter.label} by {estimate.formula}"
    return replace(counter, name=name, label=label, kind="prediction", function=read, heading="")


@cache
def _make_feature_metric(column: str) -> Metric:
    """Return the metric of a predicted column that is not a criterion, e.g. a cost model's term."""
    read = _read_prediction(column)
    label = column.replace("_", " ")
    return Metric(PREDICTED + column, label, "1", read, kind="prediction", better="none")


def list_predictions() -> dict[str, Metric]:
    """Return the metric of each criterion by its column, in the order of display."""
    predicted = criteria.list_predicted()
    return {criterion.column: _make_criterion_metric(criterion) for criterion in predicted}


def find_metric(name: str) -> Metric:
    """Return the metric called `name`; an unknown name is a counter.

    Criteria are found by name (half-perimeter), or by column with or without `PREDICTED`.
    """
    if name in METRICS:
        return METRICS[name]
    column = name.removeprefix(PREDICTED).replace("-", "_")
    if column in ESTIMATES:
        return _make_estimate_metric(column)
    if (metric := list_predictions().get(column)) is not None:
        return metric
    if name.startswith(PREDICTED):
        return _make_feature_metric(column)
    return _make_counter_metric(counters.get_counter(name))


def list_metrics() -> dict[str, Metric]:
    """Return all metrics of built-in rasterisers and criteria, by name."""
    builtin = {name: _make_counter_metric(counter) for name, counter in counters.COUNTERS.items()}
    return builtin | METRICS | list_predictions()


def find_metrics(records: Iterable[Record]) -> dict[str, Metric]:
    """Return the metrics that some record has: counters, derived metrics, predictions."""
    records = list(records)
    names = {name for record in records for name in record.counters}
    counted = {
        name: _make_counter_metric(counters.get_counter(name)) for name in sort_counters(names)
    }
    return counted | {
        name: metric
        for name, metric in (METRICS | list_predictions()).items()
        if name not in counted and any(metric(record) is not None for record in records)
    }


def sort_counters(names: Iterable[str]) -> list[str]:
    """Return the given names of counters in display order."""
    return sorted(names, key=counters.get_sort_key)


def list_costs(names: Iterable[str], *, of_order: bool = False) -> list[str]:
    """Return the counters in `names` that a triangulation can change, the main counter first.

    of_order : include counters that also depend on the order of triangles
    """
    candidates = [name for name in names if not name.startswith(PREDICTED) and name != MIN_QUADS]
    first = [name for name in COST_COUNTERS if name in candidates]
    return [
        name
        for name in dict.fromkeys([*first, *sort_counters(candidates)])
        if (metric := find_metric(name)).kind == "counter"
        and metric.better == "lower"
        and (of_order or not counters.get_counter(name).of_order)
    ]


def get_first_value(record: Record, names: Sequence[str]) -> float | None:
    """Return the value of the first of the named metrics that `record` has, or None."""
    return next((v for name in names if (v := find_metric(name)(record)) is not None), None)
