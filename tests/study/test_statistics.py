"""The statistics of a study, on data whose answer is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.figures.intervals import mean_interval
from harness.study.analysis import difference
from harness.study.statistics import (
    FEWEST,
    by_polygon,
    kendall,
    log_slope,
    median_estimate,
    partial_spearman,
    pooled,
    regret_ends,
    regret_interval,
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


@pytest.mark.filterwarnings("error")  # of a fit to a count that is the same for all
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
        estimate = median_estimate("x", values)
        covered += estimate.low <= 0.5 <= estimate.high
        assert estimate.low <= estimate.value <= estimate.high
    assert covered >= 54


def test_a_polygon_in_several_views_counts_once():
    """Two views of four polygons are no eight polygons: there are too few for an interval."""
    views = polygons(4, 0.1)
    estimate = within([*views, *views], [*"abcd", *"abcd"])[0]
    assert estimate.polygons == 4
    assert np.isnan(estimate.low)
    assert estimate.verdict == "too few"
    assert not np.isnan(within([*views, *views])[0].low)


def test_paired_differences_tell_more_than_two_intervals():
    level = np.random.default_rng(2).uniform(0.2, 0.9, 24)
    one, two = pd.Series(level + 0.02), pd.Series(level)
    apart = median_estimate("x", one.to_numpy()).low > median_estimate("x", two.to_numpy()).high
    assert not apart
    assert difference(one, two).verdict == "better"
    assert difference(two, one).verdict == "worse"
    assert difference(one, one).verdict == "no difference shown"
    assert difference(one[:5], two[:5]).verdict == "too few"


def test_regret_of_the_best_lies_between_its_ends():
    values = np.array([[1.0, 1.2, 1.1], [1.1, 1.0, 1.2], [2.0, 2.0, 2.0]])
    low, high = regret_ends(values, 0)
    assert low < 0 <= high
    assert regret_ends(values, 2)[0] == pytest.approx(2 / 1.2 - 1, rel=0.1)
    assert regret_ends(np.array([[1.0, 1.0], [2.0, 2.0]]), 1) == pytest.approx((1.0, 1.0))


def test_the_interval_of_regret_takes_the_outer_ends():
    rng = np.random.default_rng(4)
    low, high = rng.exponential(0.01, (2, 24)) + np.array([[0.0], [0.02]])
    found = regret_interval(low, high)
    assert found == (mean_interval(low)[0], mean_interval(high)[1])
    assert regret_interval(low - 0.05, high)[0] == 0.0, "nothing is better than the best"
    assert np.isnan(regret_interval(low, np.zeros(24))).all()


def test_three_triangulations_are_enough_and_two_are_not():
    x, y = np.array([1.0, 2.0, 4.0]), np.array([3.0, 2.0, 1.0])
    assert spearman(x, y) == kendall(x, y) == pytest.approx(-1)
    assert np.isnan(spearman(x[:2], y[:2]))


def test_a_slope_leaves_out_what_has_no_logarithm():
    """The first pairs have a value of 0, of which there is no logarithm."""
    x = np.array([0.0, 5.0, 1.0, 2.0, 4.0])
    y = np.array([7.0, 0.0, 0.3, 1.2, 4.8])
    assert log_slope(x, y) == pytest.approx(2)


def test_what_the_triangle_count_tells_alone_is_not_known_beside_it():
    size = np.arange(20.0)
    assert np.isnan(partial_spearman(size**2, RANDOM.permutation(size), size))
    assert np.isnan(partial_spearman(RANDOM.permutation(size), size**2, size))


def test_pooled_columns_are_prediction_measure_and_triangle_count():
    """All at once: y falls as x grows, and the number of triangles tells neither."""
    columns = [(np.arange(8.0) + 8 * k, -np.arange(8.0) - 8 * k) for k in range(3)]
    counts = [RANDOM.permutation(np.arange(8.0)) for _ in columns]
    found = pooled(columns, counts)
    assert [each.value for each in found] == pytest.approx([-1, -1], abs=0.05)
    assert [each.polygons for each in found] == [3, 3]
    assert pooled([], []) == []


def test_as_many_triangulations_as_are_asked_for_are_enough():
    x = np.arange(float(FEWEST))
    assert by_polygon("spearman_within", [(x, x), (x[1:], x[1:])])[0] == pytest.approx(1)
    assert np.isnan(by_polygon("spearman_within", [(x, x), (x[1:], x[1:])])[1])


def test_what_does_not_vary_has_no_slope():
    x = np.array([1.0, 2.0, 4.0])
    assert np.isnan(log_slope(x, np.ones(3)))
    assert np.isnan(log_slope(np.ones(3), x))


def test_small_differences_are_differences_and_two_triangulations_are_too_few():
    x, y = np.array([0.1, 0.2, 0.4]), np.array([0.4, 0.2, 0.1])
    assert kendall(x, y) == pytest.approx(-1)
    assert log_slope(x, y) == pytest.approx(-1)
    assert np.isnan(kendall(x[:2], y[:2]))
    assert np.isnan(log_slope(x[:2], y[:2]))


def test_a_tie_of_the_triangle_count_leaves_what_differs_there():
    ranks = np.arange(4.0)
    assert partial_spearman(ranks, ranks, np.array([1.0, 1.0, 3.0, 4.0])) == pytest.approx(1)


def test_what_does_not_rise_with_the_triangle_count_is_left():
    """Both fall and rise again as it grows: no line tells that."""
    rng = np.random.default_rng(9)
    size = np.linspace(-1.0, 1.0, 400)
    x, y = np.abs(size) + 0.1 * rng.standard_normal((2, 400))
    assert partial_spearman(x, y, size) > 0.8


@pytest.mark.parametrize("blocks", [2, 4])
def test_the_ends_of_regret_are_those_of_other_blocks_and_of_all(blocks):
    """Beside the best of the other blocks, of each block; and beside the best of all."""
    logs = np.array([[0.0, 1.0, 2.0, 3.0], [2.0, 0.5, 1.0, 1.5], [1.0, 4.0, 0.0, 3.5]])
    logs = logs[:, :blocks]
    for chosen in range(3):
        crossed = []
        for block in range(blocks):
            sums = np.delete(logs, block, axis=1).sum(axis=1)
            crossed.append(logs[chosen, block] - logs[int(np.argmin(sums)), block])
        means = logs.mean(axis=1)
        ends = np.expm1([np.mean(crossed), means[chosen] - means.min()])
        assert regret_ends(np.exp(logs), chosen) == pytest.approx(tuple(ends))
