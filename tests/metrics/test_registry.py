import hashlib
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

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
from harness.results.parsing import record_to_json
from harness.results.run_folder import read_run
from harness.settings import DEFAULT_TRIANGULATORS, MODEL_TRIANGULATORS
from harness.study import correlations
from harness.style import choose_looks
from harness.summary import print_summary, write_csv
from tests.harness.test_summary import record
from tests.records import make_record, make_run
from triangulators import criteria

NAMES = ("ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter", "greedy", "fan")


def make_fields(name: str, number: int, counted: dict[str, int], **changes: Any) -> dict[str, Any]:
    """Return a complete record of a triangulator, with metrics that grow with `number`."""
    predicted = dict.fromkeys(
        [*list_predictions(), *criteria.AUXILIARY_FEATURES], 100.0 + 7 * number
    )
    return record(
        name,
        1 + 0.1 * number,
        key=hashlib.sha256(f"{name}-{changes.get('scene', '')}".encode()).hexdigest()[:16],
        scene_hash="x",
        options={"samples": 1, "work": 0, "order": "native", "seed": 0},
        fit="box",
        conforming=True,
        triangles=1000,
        predicted=predicted,
        counters=counted,
        **{**changes, "time": None} if "time" in changes else changes,
    )


def write_run_of(folder: Path, records: list[dict[str, Any]]) -> Path:
    folder.mkdir()
    facts = {"schema_version": 1, "plan": {"triangulators": [r["triangulator"] for r in records]}}
    (folder / "run.json").write_text(json.dumps(facts))
    lines = [json.dumps(record_to_json(make_record(**fields))) for fields in records]
    (folder / "cases.jsonl").write_text("".join(f"{line}\n" for line in lines))
    return folder


@pytest.fixture
def sparkle(monkeypatch: pytest.MonkeyPatch) -> criteria.Criterion:
    """A criterion added by a plugin."""
    half = criteria.CRITERIA["half-perimeter"]
    new = replace(half, name="sparkle-length", label="sparkle", symbol="K", unit="px")
    monkeypatch.setitem(criteria.CRITERIA, new.name, new)
    return new


@pytest.fixture
def glow(monkeypatch: pytest.MonkeyPatch) -> Metric:
    """A metric added by a plugin."""
    read = lambda record: record.counters.get("quads")  # noqa: E731
    new = Metric(
        "glow", "glow of quads", "lumens", read, kind="ratio", best_case=0.0, heading="glow"
    )
    monkeypatch.setitem(registry.METRICS, new.name, new)
    return new


def show(records: list[dict[str, Any]]) -> str:
    output = io.StringIO()
    print_summary(decide_run(make_run(records)), Console(file=output, width=110))
    return output.getvalue()


def test_a_new_criterion_is_predicted_correlated_and_shown(sparkle, tmp_path):
    import numpy as np

    vertices = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])
    assert criteria.predict(vertices, np.array([[0, 1, 2]]))["sparkle_length"] == 7.0
    records = [
        make_fields(
            name, number, {"helper_lanes": 50 + number, "quads": 90 + number}, scene="city#1"
        )
        for number, name in enumerate(NAMES)
    ]
    table = correlations.make_correlation_table(
        correlations.make_measure_table(make_run(records).records)
    )
    assert "sparkle-length" in set(table["criterion"])
    content = make_content(read_run(write_run_of(tmp_path / "run", records)))
    assert "sparkle_length" in content["criteria"]
    assert content["figures"]["sparkle_length"]["title"] == "sparkle K"
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    assert "sparkle_length" in pd.read_csv(tmp_path / "summary.csv").columns


def test_summary_states_the_options_of_each_case(tmp_path):
    options = [("walk", 1, 0), ("native", 4, 0), ("native", 1, 16)]
    records = [
        make_record(
            "delaunay",
            counters={"quads": 100},
            options={"order": order, "samples": samples, "work": work, "seed": 0},
        )
        for order, samples, work in options
    ]
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    table = pd.read_csv(tmp_path / "summary.csv")[["order", "samples", "work"]]
    assert sorted(table.itertuples(index=False, name=None)) == sorted(options)


def test_a_new_metric_is_in_table_csv_report_and_comparison(glow, tmp_path):
    records = [make_fields(name, k, {"quads": 100 + k}) for k, name in enumerate(NAMES[:3])]
    assert "glow" in show(records)
    write_csv(decide_run(make_run(records)), tmp_path / "summary.csv")
    assert pd.read_csv(tmp_path / "summary.csv")["glow"].tolist() == [100, 101, 102]
    base = read_run(write_run_of(tmp_path / "base", records))
    assert make_content(base)["figures"]["glow"]["unit"] == "lumens"
    comparison = compare_runs(base, base, Settings())
    assert "glow" in {change.metric for case in comparison.cases for change in case.counters}


def test_undeclared_counter_is_ranked_gated_and_named(tmp_path):
    records = [make_fields(name, k, {"wave_fronts": 100 + k}) for k, name in enumerate(NAMES[:3])]
    text = show(records)
    assert "wave fronts" in text
    assert "102" in text
    worse = [
        {**r, "counters": {"wave_fronts": r["counters"]["wave_fronts"] * 3 // 2}} for r in records
    ]
    base, head = (
        write_run_of(tmp_path / name, rows) for name, rows in (("b", records), ("h", worse))
    )
    comparison = compare_runs(read_run(base), read_run(head), Settings(gates=("counters",)))
    assert comparison.verdict == "regression"
    equal = compare_runs(read_run(base), read_run(base), Settings(gates=("counters",)))
    assert equal.verdict != "regression"


def test_counters_of_binning_are_printed():
    rows = [
        make_fields(name, k, {"tiles_16": 700 + k, "tiles_32": 300 + k}, time=None)
        for k, name in enumerate(NAMES[:3])
    ]
    text = show(rows)
    assert "tiles of 16 px" in text
    assert "702" in text


def test_rasteriser_declares_its_counters():
    counters.register_counters([counters.Counter("mirror_hits", "mirror hits", "mirrors", "none")])
    figure = find_metric("mirror_hits")
    assert (figure.unit, figure.better, figure.kind) == ("mirrors", "none", "counter")
    assert list_costs(["mirror_hits", "quads", MIN_QUADS]) == ["quads"], (
        "the minimum is not a counter of cost"
    )
    of_order = ["vertex_batches", "transformed_vertices"]
    assert list_costs([*of_order, "quads"]) == ["quads"]
    assert list_costs([*of_order, "quads"], of_order=True) == ["quads", *of_order]
    counters.register_counters([counters.Counter("quads", "stolen", "x")])
    assert find_metric("quads").label == "quads", "a built-in counter is not replaced"


def test_criterion_is_found_by_name_or_column():
    for name in ("half-perimeter", "half_perimeter", "predicted_half_perimeter"):
        assert find_metric(name) is find_metric("half_perimeter")
    assert find_metric("predicted_area").kind == "prediction", "a term of fits is a prediction"


def test_every_metric_has_a_label_and_a_unit():
    for figure in registry.list_metrics().values():
        assert figure.label
        assert figure.unit
        assert figure.description


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
    fixed = choose_looks(list(registry_names()))
    assert len({(look.colour, look.marker) for look in fixed.values()}) == len(fixed)


def registry_names() -> list[str]:
    from triangulators import registry as built_in

    return [*built_in.BUILTIN, *(f"optimal:{name}" for name in criteria.names())]


def test_shaded_lanes_are_four_a_quad():
    shaded = make_fields("fan", 0, {"quads": 300, "fragments": 900})
    assert find_metric("overshading")(make_record(**shaded)) == pytest.approx(4 * 300 / 900)
    assert find_metric("overshading")(make_record(counters={"fragments": 900})) is None
    assert find_metric("draw_ms")(make_record(time={"samples_s": [0.5]})) == 500.0
    names = ("quads", "fragments", "overshading", "draw_ms", "regret")
    assert [find_metric(name).unit != "x" for name in names] == [True, True, False, True, False]
    assert [find_metric(name).is_cost for name in names] == [True, True, False, False, False]


def test_regret_needs_a_triangulation_with_a_helper_lane():
    record = make_fields("fan", 0, {"quads": 9, "fragments": 20})
    minimum = {"polygons": 1, "quads": 6, "shaded": 9, "fragments": 20}
    assert (
        find_metric("regret")(make_record(**{**record, "least": minimum}))
        == (36 - 20) / (24 - 20) - 1
    )
    assert (
        find_metric("regret")(make_record(**{**record, "least": {**minimum, "quads": 5}})) is None
    )


def test_lower_bound_is_the_outline_drawn_in_one_piece():
    fields = {"counters": {"fragments": 30}, "outline_quads": 11}
    limit = compute_lower_bound(make_record(**fields))
    assert limit.counters == {"fragments": 30, "quads": 11, "helper_lanes": 14}
    assert compute_lower_bound(make_record(**{**fields, "counters": {}})) is None
    assert compute_lower_bound(make_record(counters={"fragments": 30})) is None


def test_counters_equal_for_all_triangulations_have_no_direction():
    metrics = {**{name: find_metric(name) for name in ("fragments", "helper_lanes")}, **METRICS}
    shared = {name for name, figure in metrics.items() if figure.is_shared}
    assert "fragments" in shared
    assert not shared & {"helper_lanes", "outline_quads"}


def test_metric_description_is_its_docstring():
    figure = METRICS["above_limit"]
    assert figure.description.startswith("lanes shaded per covered pixel beyond those of the")
    fields = {"counters": {"quads": 30, "fragments": 80}, "outline_quads": 25}
    assert figure(make_record(**fields)) == 4 * (30 - 25) / 80
    assert figure(make_record(**{**fields, "outline_quads": None})) is None


def test_a_counter_without_a_description_is_described_by_its_label():
    plain = counters.Counter("walked", "squares walked", "squares")
    assert registry._make_counter_metric(plain).description == "squares walked"
    described = replace(plain, description="squares that were looked at")
    assert registry._make_counter_metric(described).description == described.description
