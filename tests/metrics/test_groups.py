"""Groups of records that differ in the triangulator; ratios of times of the same rounds."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from harness.metrics.groups import (
    IDENTIFYING_CRITERIA,
    compute_ratios,
    compute_time_ratio,
    drop_equal_triangulations,
    group_records,
    pair_ratios,
    read_columns,
)
from harness.metrics.statistics import compute_rank_correlation, compute_rms_error
from harness.results.run_folder import Run
from harness.results.run_writer import RunFolder
from tests.records import make_record

SAMPLES = [1e-3 + 1e-6 * k for k in range(20)]
TIME = {"samples_s": SAMPLES, "reference_s": [1e-3] * 20}


def test_groups_are_sorted_and_keep_the_order_of_records():
    cases = product(("zink", "llvmpipe"), (1024, 64), ("fan", "delaunay"))
    records = [make_record(name, resolution=size, device=device) for device, size, name in cases]
    groups = group_records(records)
    conditions = [(group.id.device, group.id.view.resolution) for group in groups]
    assert conditions == [("llvmpipe", 64), ("llvmpipe", 1024), ("zink", 64), ("zink", 1024)]
    assert all([record.name for record in group.records] == ["fan", "delaunay"] for group in groups)


def test_two_records_of_the_same_rounds_have_a_ratio():
    base = make_record(polygons=3, time=TIME)
    slower = make_record("fan", polygons=3, time=TIME | {"samples_s": [2 * s for s in SAMPLES]})
    assert compute_time_ratio(slower, base).value == pytest.approx(2.0)
    assert compute_time_ratio(slower, replace(base, polygons=2)) is None
    assert compute_time_ratio(slower, replace(base, time=None)) is None
    for lacking in ({"reference_s": []}, {"reference_s": [1.0] * 20}, {"samples_s": [1.0]}):
        other = make_record(polygons=3, time=TIME | lacking)
        assert compute_time_ratio(slower, other) is None
        assert compute_time_ratio(other, slower) is None


def test_round_group_overrides_equal_reference_draws():
    times = (TIME | {"round_group": group} for group in "aab")
    one, same, other = (make_record(polygons=3, time=time) for time in times)
    assert compute_time_ratio(one, same) is not None
    assert compute_time_ratio(one, other) is None


def test_equal_triangulations_and_damaged_records_are_dropped():
    record = make_record(predicted=dict.fromkeys(IDENTIFYING_CRITERIA, 1.0))
    twin = make_record(predicted=dict.fromkeys(IDENTIFYING_CRITERIA, 1.0 + 1e-9))
    other = make_record(predicted={**dict.fromkeys(IDENTIFYING_CRITERIA, 1.0), "shape": 1.1})
    damaged = make_record(predicted={"shape": 1.0})
    assert drop_equal_triangulations([record, damaged, twin, other]) == [record, other]


def make_columns(cost: list[float], quads: list[float], triangles: list[int] | None = None):
    drawn = triangles or [4] * len(cost)
    values = {"predicted_half_perimeter": cost, "quads": quads, "predicted_triangles": drawn}
    return {name: np.asarray(column, np.float64) for name, column in values.items()}


BASE = make_columns([2, 2, 2, 4], [10, 10, 10, 10])
OTHER = make_columns([1, 2, 3, 8], [5, 10, 15, 20])


def test_ratios_of_polygons_that_both_drew():
    base = make_columns([2] * 5, [10] * 5, [4, 4, 4, 4, 0])
    other = make_columns([1] * 5, [5, 0, 15, 20, 30], [4, 4, 0, 4, 4])
    ratios = compute_ratios(other, base, "quads").tolist()
    assert ratios == pytest.approx([0.5, np.nan, np.nan, 2, np.nan], nan_ok=True)


def test_predictions_are_paired_with_counters_relative_to_the_base():
    tables = {"base": BASE, "other": OTHER}
    pairs = pair_ratios(tables, "base", "half_perimeter", "quads")
    assert compute_rank_correlation(*pairs) == pytest.approx(1)
    assert compute_rms_error(*pairs) == pytest.approx(0)
    double = {"base": BASE, "other": OTHER | {"quads": 2 * OTHER["quads"]}}
    error = compute_rms_error(*pair_ratios(double, "base", "half_perimeter", "quads"))
    assert error == pytest.approx(np.log(2))
    assert compute_rms_error(np.array([np.nan, 0.0]), np.ones(2)) is None


def test_missing_columns_are_not_compared():
    bare = {name: OTHER[name] for name in ("quads", "predicted_triangles")}
    no_quads = {name: column for name, column in BASE.items() if name != "quads"}
    no_cost = {name: BASE[name] for name in bare}
    others = [{"other": OTHER, "bare": bare}, *[{"other": OTHER}] * 2, {}, {"other": no_quads}]
    for base, drawn in zip((BASE, no_quads, no_cost, BASE, BASE), others, strict=True):
        pairs = pair_ratios({"base": base, **drawn}, "base", "half_perimeter", "quads")
        assert [len(column) for column in pairs] == [0, 0]
        assert compute_rank_correlation(*pairs) is None


def test_columns_without_triangles_are_none(tmp_path):
    """Columns may be missing, or from an older version."""
    with RunFolder.create(tmp_path / "run") as store:
        store.write_arrays("0" * 16, {"quads": np.arange(3)})
        store.write_arrays("1" * 16, {"quads": np.arange(3), "predicted_triangles": np.ones(3)})
    run = Run(tmp_path / "run", {}, [])
    tables = [read_columns(run, make_record(key=str(key) * 16)) for key in range(3)]
    assert tables[0] is None
    assert tables[2] is None
    assert tables[1]["quads"].tolist() == [0, 1, 2]
