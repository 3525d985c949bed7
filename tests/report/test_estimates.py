"""Predictions in a counter's own unit: their formulas, and that marks lie near the line."""

from __future__ import annotations

import numpy as np
import pytest

from harness.figures.counters import ESTIMATES, estimated, of_measure
from harness.figures.polygons import columns_of, error_of, error_of_ratios
from harness.figures.registry import PREDICTED, find
from harness.stored.folder import read_run

TOLD = {"expected_quads": 30.0, "half_perimeter": 40.0, "overdraw": 25.0, "area": 60.0}


def test_the_formulas():
    found = estimated({**TOLD, "triangles": 7.0})
    assert found == {
        "helper_lanes_by_quads": 4 * 30 - 60,
        "helper_lanes_by_half_perimeter": 40 + 7,
        "bbox_tests_by_overdraw": 25 + 60,
    }
    assert "helper_lanes_by_half_perimeter" not in estimated(TOLD)
    prefixed = estimated({PREDICTED + name: value for name, value in TOLD.items()}, PREDICTED)
    assert prefixed[f"{PREDICTED}bbox_tests_by_overdraw"] == 85


def test_each_has_the_unit_of_what_it_predicts():
    for name, each in ESTIMATES.items():
        figure = find(PREDICTED + name)
        assert figure.unit == find(each.measure).unit
        assert figure.title == f"{find(each.measure).label} by {each.formula}"
        assert name in of_measure(each.measure)
    assert of_measure(None) == []


def test_the_error_is_a_share():
    measured = np.array([1.0, 2.0, 4.0, np.nan])
    assert error_of(measured * 1.05, measured) == pytest.approx(np.log(1.05))
    assert error_of(measured * [1.05, 1 / 1.05, 1.05, 1.0], measured) == pytest.approx(np.log(1.05))
    assert error_of(np.array([np.nan]), np.array([1.0])) is None


def test_an_estimate_is_nearer_than_its_criterion(folder):
    """Quads against helper lanes are in two units; 4Q - S against them in one."""
    run = read_run(folder)
    records = [record for record in run.records if record["resolution"] == 256]
    columns = {record["triangulator"]: columns_of(run, record) for record in records}
    error = {
        name: error_of_ratios(columns, "ear-clipping", name, "helper_lanes")
        for name in ("helper_lanes_by_quads", "expected_quads", "overdraw")
    }
    assert error["helper_lanes_by_quads"] < error["expected_quads"] < error["overdraw"]
    for record, own in zip(records, columns.values(), strict=True):
        if record["triangulator"] == "fan":
            continue
        predicted = own[f"{PREDICTED}helper_lanes_by_quads"].sum()
        assert predicted == pytest.approx(record["counters"]["helper_lanes"], rel=0.05)
