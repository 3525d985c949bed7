"""Groups of records that differ in the triangulator; ratios of times of the same rounds."""

from dataclasses import replace
from itertools import product

import pytest

from harness.metrics.groups import (
    IDENTIFYING_CRITERIA,
    compute_time_ratio,
    drop_equal_triangulations,
    group_records,
)
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
