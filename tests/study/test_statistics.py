"""The statistics of a study, on data whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.study.statistics import (
    kendall,
    log_slope,
    median_estimate,
    partial_spearman,
    pooled,
    spearman,
    within,
)

RANDOM = np.random.default_rng(3)


def polygons(number: int, noise: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Columns of polygons of very different size; y follows x within each, with noise."""
    columns = []
    for size in 2.0 ** np.arange(number):
        x = size * RANDOM.uniform(1, 2, 40)
        columns.append((x, 3 * x**2 * np.exp(noise * RANDOM.standard_normal(40))))
    return columns


def test_a_perfect_prediction_is_found_perfect():
    found = {e.statistic: e for e in within(polygons(10, 0.0))}
    assert found["spearman_within"].value == pytest.approx(1)
    assert found["kendall_within"].value == pytest.approx(1)
    assert found["slope_within"].value == pytest.approx(2)
    assert found["spearman_within"].polygons == 10


def test_pooling_makes_a_useless_criterion_look_good():
    columns = [(x, RANDOM.permutation(y)) for x, y in polygons(12, 0.0)]
    inside = {e.statistic: e.value for e in within(columns)}
    together = {e.statistic: e.value for e in pooled(columns, [x for x, _ in columns])}
    assert abs(inside["spearman_within"]) < 0.2
    assert together["spearman_pooled"] > 0.95


def test_partialling_out_what_drives_both_leaves_nothing():
    size = RANDOM.uniform(0, 1, 4000)
    x, y = size + 0.1 * RANDOM.standard_normal((2, 4000))
    assert spearman(x, y) > 0.8
    assert abs(partial_spearman(x, y, size)) < 0.06
    assert partial_spearman(x, y, np.ones(4000)) == pytest.approx(spearman(x, y))


def test_a_constant_criterion_has_no_correlation():
    x, y = np.ones(9), np.arange(9.0) + 1
    for function in (spearman, kendall, log_slope):
        assert np.isnan(function(x, y))
    estimate = within([(x, y)] * 4)[0]
    assert estimate.polygons == 0
    assert np.isnan(estimate.value)


def test_polygons_with_too_few_triangulations_are_left_out():
    few = (np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    assert within([few, *polygons(3, 0.0)])[0].polygons == 3


def test_the_interval_of_a_median_covers_it():
    covered = 0
    for seed in range(60):
        values = np.random.default_rng(seed).normal(0.5, 0.1, 25)
        estimate = median_estimate("x", values, seed)
        covered += estimate.low <= 0.5 <= estimate.high
        assert estimate.low <= estimate.value <= estimate.high
    assert covered >= 50
