from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.compare.comparison import compare_runs
from harness.compare.model import Settings
from harness.metrics import registry
from harness.metrics.decision import decide_run
from harness.metrics.registry import (
    METRICS,
    MIN_QUADS,
    Metric,
    compute_lower_bound,
    find_metric,
    find_metrics,
    list_costs,
    list_predictions,
)
from harness.rasterisers import counters
from harness.report.content import make_content
from harness.settings import DEFAULT_TRIANGULATORS, MODEL_TRIANGULATORS
from harness.study import correlations
from harness.style import choose_looks
from harness.summary import write_csv
from tests.harness.test_summary import record, show
from tests.records import make_record, make_run
from triangulators import criteria
from triangulators.registry import BUILTIN

NAMES = ("ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter", "greedy", "fan")


def make_fields(name: str, number: int, counted: dict[str, int], **changes: Any) -> dict[str, Any]:
    """Return a complete record of a triangulator, with metrics that grow with `number`."""
    features = [*list_predictions(), *criteria.AUXILIARY_FEATURES]
    predicted = dict.fromkeys(features, 100.0 + 7 * number)
    fields = {"scene_hash": "x", "conforming": True, "triangles": 1000, "predicted": predicted}
    return record(name, 1 + 0.1 * number, **fields, counters=counted, **changes)


def test_a_new_criterion_is_predicted_correlated_and_shown(monkeypatch, tmp_path):
    half = criteria.CRITERIA["half-perimeter"]
    new = replace(half, name="sparkle-length", label="sparkle", symbol="K", unit="px")
    monkeypatch.setitem(criteria.CRITERIA, new.name, new)
    vertices = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])
    assert criteria.predict(vertices, np.array([[0, 1, 2]]))["sparkle_length"] == 7.0
    records = [
        make_fields(name, k, {"helper_lanes": 50 + k, "quads": 90 + k}, scene="city#1")
        for k, name in enumerate(NAMES)
    ]
    measures = correlations.make_measure_table(make_run(records).records)
    table = correlations.make_correlation_table(measures)
    assert "sparkle-length" in set(table["criterion"])
    content = make_content(make_run(records))
    assert "sparkle_length" in content["criteria"]
    assert content["figures"]["sparkle_length"]["title"] == "sparkle K"
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    assert "sparkle_length" in pd.read_csv(tmp_path / "summary.csv").columns


def test_summary_states_the_options_of_each_case(tmp_path):
    names = ("order", "samples", "work")
    options = [("walk", 1, 0), ("native", 4, 0), ("native", 1, 16)]
    records = [
        make_record(counters={"quads": 100}, options=dict(zip(names, values, strict=True)))
        for values in options
    ]
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    table = pd.read_csv(tmp_path / "summary.csv")[[*names]]
    assert sorted(table.itertuples(index=False, name=None)) == sorted(options)


def test_a_new_metric_is_in_table_csv_report_and_comparison(monkeypatch, tmp_path):
    options = {"kind": "ratio", "best_case": 0.0, "heading": "glow"}
    new = Metric("glow", "glow of quads", "lumens", lambda r: r.counters.get("quads"), **options)
    monkeypatch.setitem(registry.METRICS, new.name, new)
    records = [make_fields(name, k, {"quads": 100 + k}) for k, name in enumerate(NAMES[:3])]
    assert "glow" in show(records, width=110)
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    assert pd.read_csv(tmp_path / "summary.csv")["glow"].tolist() == [100, 101, 102]
    base = make_run(records)
    assert make_content(base)["figures"]["glow"]["unit"] == "lumens"
    comparison = compare_runs(base, base, Settings())
    assert "glow" in {change.metric for case in comparison.cases for change in case.counters}


def test_undeclared_counter_is_ranked_gated_and_named(tmp_path):
    records = [make_fields(name, k, {"wave_fronts": 100 + k}) for k, name in enumerate(NAMES[:3])]
    text = show(records, width=110)
    assert "wave fronts" in text
    assert "102" in text
    worse = [{**fields, "counters": {"wave_fronts": 160}} for fields in records]
    base, head = make_run(records), make_run(worse)
    assert compare_runs(base, head, Settings(gates=("counters",))).verdict == "regression"
    assert compare_runs(base, base, Settings(gates=("counters",))).verdict != "regression"


def test_rasteriser_declares_its_counters():
    counters.register_counters([counters.Counter("mirror_hits", "mirror hits", "mirrors", "none")])
    figure = find_metric("mirror_hits")
    assert (figure.unit, figure.better, figure.kind) == ("mirrors", "none", "counter")
    assert figure.description == "mirror hits"
    assert list_costs(["mirror_hits", "quads", MIN_QUADS]) == ["quads"]
    of_order = ["vertex_batches", "transformed_vertices"]
    assert list_costs([*of_order, "quads"]) == ["quads"]
    assert list_costs([*of_order, "quads"], of_order=True) == ["quads", *of_order]
    counters.register_counters([counters.Counter("quads", "stolen", "x")])
    assert find_metric("quads").label == "quads", "a built-in counter is not replaced"


def test_criterion_is_found_by_name_or_column():
    for name in ("half-perimeter", "half_perimeter", "predicted_half_perimeter"):
        assert find_metric(name) is find_metric("half_perimeter")
    assert find_metric("predicted_area").kind == "prediction", "a term of fits is a prediction"


def test_every_metric_is_described():
    for metric in registry.list_metrics().values():
        assert all((metric.label, metric.unit, metric.description))


def test_find_metrics_lists_metrics_of_the_records():
    assert list(find_metrics([])) == []
    rows = [make_fields("fan", 0, {"quads": 5, "samples_passed": 2})]
    metrics = find_metrics(make_run(rows).records)
    assert next(iter(metrics)) == "quads"
    assert metrics["samples_passed"].better == "none"
    assert "bbox_overdraw" not in metrics
    assert "draw_ms" in metrics


def test_style_of_a_triangulator_is_independent_of_the_others():
    look_of_one = choose_looks(["delaunay"])["delaunay"]
    assert choose_looks(["mine:cut", "random#3", "delaunay"])["delaunay"] == look_of_one
    many = choose_looks([f"random#{k}" for k in range(30)] + ["a:b", "c:d"])
    assert len({(look.colour, look.marker) for look in many.values()}) == 3
    for defaults in (DEFAULT_TRIANGULATORS, MODEL_TRIANGULATORS):
        assert len({look.colour for look in choose_looks(defaults).values()}) == len(defaults)
    fixed = choose_looks([*BUILTIN, *(f"optimal:{name}" for name in criteria.names())])
    assert len({(look.colour, look.marker) for look in fixed.values()}) == len(fixed)


def test_shaded_lanes_are_four_a_quad():
    shaded = make_fields("fan", 0, {"quads": 300, "fragments": 900})
    assert find_metric("overshading")(make_record(**shaded)) == pytest.approx(4 * 300 / 900)
    assert find_metric("overshading")(make_record(counters={"fragments": 900})) is None
    assert find_metric("draw_ms")(make_record(time={"samples_s": [0.5]})) == 500.0
    names = ("quads", "fragments", "overshading", "draw_ms", "regret")
    assert [find_metric(name).unit != "x" for name in names] == [True, True, False, True, False]
    assert [find_metric(name).is_cost for name in names] == [True, True, False, False, False]


def test_lower_bound_is_the_outline_drawn_in_one_piece():
    fields = {"counters": {"fragments": 30}, "outline_quads": 11}
    limit = compute_lower_bound(make_record(**fields))
    assert limit.counters == {"fragments": 30, "quads": 11, "helper_lanes": 14}
    assert compute_lower_bound(make_record(**{**fields, "counters": {}})) is None
    assert compute_lower_bound(make_record(counters={"fragments": 30})) is None


def test_metric_description_is_its_docstring():
    figure = METRICS["above_limit"]
    assert figure.description.startswith("lanes shaded per covered pixel beyond those of the")
    fields = {"counters": {"quads": 30, "fragments": 80}, "outline_quads": 25}
    assert figure(make_record(**fields)) == 4 * (30 - 25) / 80
    assert figure(make_record(**{**fields, "outline_quads": None})) is None
