"""Coverage and definitions of confidence intervals, on data with known parameters; ranks."""

import warnings

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import quantile_test

from harness.metrics import statistics
from scripts.studies.interval_coverage import Kind, list_kinds, simulate

TRIALS = 200
MIN_COVERAGE = 0.90
"""Minimum share of 200 trials; 95 % intervals miss it in 1 of 500 series, 80 % intervals always."""


@pytest.mark.parametrize(
    "kind",
    [kind for kind in list_kinds() if kind.number <= 12 and "city" not in kind.data],
    ids=lambda kind: f"{kind.interval}, {kind.data}, {kind.number}",
)
def test_interval_covers_95_percent(kind: Kind):
    row = simulate(kind, TRIALS)
    assert float(row["reported"]) > (0.8 if kind.interval == "ratio over tiles" else 0.99)
    assert float(row["covered"]) >= MIN_COVERAGE


def test_mean_interval_equals_the_studentised_bootstrap():
    """By definition: deviations of resampled means in units of each resample's standard error."""
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 15.0, 20.0])
    drawn = values[np.random.default_rng(0).integers(10, size=(statistics.RESAMPLES, 10))]
    error = [np.sqrt(np.square(row - row.mean()).sum() / 9) for row in (values, *drawn)]
    t = np.sort((drawn.mean(axis=1) - values.mean()) / error[1:])
    count, tail = len(t), statistics.TAIL
    low, high = (t[int(np.ceil(share * count)) - 1] for share in (tail, 1 - tail))
    expected = (values.mean() - high * error[0], values.mean() - low * error[0])
    assert statistics.compute_mean_interval(values) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("values", [[1.0] * 5, [0.0] * 24, [0.0] * 11 + [1.0], [1, 2, 3, 4, 5]])
def test_few_equal_or_dominated_values_have_no_interval(values):
    assert np.isnan(statistics.compute_mean_interval(np.array(values, float))).all()


def test_interval_of_the_median_of_few_samples_is_their_range():
    assert statistics.compute_median_interval([3.0, 1.0, 2.0]) == (1.0, 3.0)


def test_interval_includes_the_scatter_between_runs():
    exact = statistics.add_run_scatter(statistics.Ratio(0.9, 0.9, 0.9, 40))
    assert exact.value == 0.9
    ends = np.log([exact.low / 0.9, exact.high / 0.9]) / statistics.RUN_SCATTER
    assert ends == pytest.approx([-1.96, 1.96], rel=1e-4)
    wide = statistics.add_run_scatter(statistics.Ratio(0.9, 0.7, 1.2, 40))
    assert (wide.low, wide.high) == pytest.approx((0.7, 1.2), abs=2e-4)
    assert wide.low < 0.7 < 1.2 < wide.high


@given(st.lists(st.floats(0.1, 10.0), min_size=6, max_size=200))
def test_median_interval_equals_scipys_quantile_test(samples):
    low, high = statistics.compute_median_interval(samples)
    expected = quantile_test(samples, q=0, p=0.5).confidence_interval(0.95)
    assert (low, high) == (pytest.approx(expected.low), pytest.approx(expected.high))
    assert low <= np.median(samples) <= high


def test_processes_are_independent_values():
    """Twelve epochs of three different processes are three values."""
    level = np.repeat([0.01, 0.03, 0.02], 20)
    samples, base = np.exp(level), np.ones(60)
    over_epochs = statistics.compute_paired_ratio(samples, base, [5] * 12)
    over_processes = statistics.compute_paired_ratio(samples, base, [5] * 12, [20] * 3)
    assert over_processes.value == pytest.approx(np.exp(0.02)) == over_epochs.value
    reach = 4.302653 * 0.01 / np.sqrt(3)
    assert over_processes.high == pytest.approx(np.exp(0.02 + reach))
    assert over_epochs.high < over_processes.high
    # Lists with a different number of rounds are ignored.
    assert statistics.compute_paired_ratio(samples, base, [5] * 12, [20] * 2) == over_epochs
    assert statistics.compute_paired_ratio(samples, base, [5] * 12, [60]) == over_epochs


def test_four_epochs_are_independent_values():
    samples, base = np.exp(np.repeat([0.0, 0.01, 0.02, 0.04], 15)), np.ones(60)
    of_epochs = statistics.compute_paired_ratio(samples, base, [15] * 4)
    assert np.log(of_epochs.value) == pytest.approx(0.0175)
    of_rounds = statistics.compute_paired_ratio(samples, base)
    assert statistics.compute_paired_ratio(samples, base, [15, 15, 30]) == of_rounds != of_epochs
    # Processes have equal weight.
    samples = np.exp(np.repeat([0.0, 0.1], [8, 2]))
    ratio = statistics.compute_paired_ratio(samples, np.ones(10), [2] * 5, [8, 2])
    assert ratio.value == pytest.approx(np.exp(0.05))


@pytest.mark.parametrize(
    ("times", "sizes"),
    [
        ({"processes": [6, 6], "epochs": [3] * 4}, [6, 6]),
        ({"processes": [12], "epochs": [3] * 4}, [3] * 4),
        ({"processes": [6, 5], "epochs": [6, 6]}, [2] * 6),
        ({}, [2] * 6),
    ],
)
def test_rounds_are_split_into_processes_or_epochs(times, sizes):
    parts = statistics.split_rounds(times.get("processes", ()), times.get("epochs", ()), 12)
    assert [len(part) for part in parts] == sizes
    assert sorted(np.concatenate(parts).tolist()) == list(range(12))


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(0.8, 0.99, "faster"), (0.8, 1.0, "not significant")]
    + [(1.0, 1.2, "not significant"), (1.01, 1.2, "slower")],
)
def test_interval_that_ends_at_one_is_not_significant(low, high, verdict):
    assert statistics.Ratio((low + high) / 2, low, high, 40).verdict == verdict


@pytest.mark.parametrize(("samples", "base"), [([], []), ([1.0, 2.0], [1.0]), ([1.0], [])])
def test_unequal_numbers_of_rounds_have_no_ratio(samples, base):
    with pytest.raises(ValueError, match="not rounds of one group"):
        statistics.compute_paired_ratio(samples, base)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_ratio_interval_is_independent_of_the_unit(size):
    base = size * np.linspace(1.0, 2.0, 24)
    assert np.isnan(statistics.compute_ratio_interval(0.3 * base, base)).all()
    noise = np.random.default_rng(4).normal(1.0, 0.05, 24)
    interval = statistics.compute_ratio_interval(0.3 * base * noise, base)
    assert interval == pytest.approx((0.3, 0.3), rel=0.05)


def test_rank_correlation_needs_three_pairs():
    x, y = np.array([1.0, 2.0, 4.0]), np.array([9.0, 8.0, 3.0])
    assert statistics.compute_rank_correlation(x, y) == pytest.approx(-1)
    assert statistics.compute_rank_correlation(x[:2], y[:2]) is None
    assert statistics.compute_rank_correlation(x, np.array([1.0, np.nan, 2.0])) is None
    assert statistics.compute_rank_correlation(x, np.ones(3)) is None
    assert statistics.compute_rank_correlation(np.ones(3), y) is None


def test_rms_error_is_that_of_log_ratios():
    x = np.array([0.5, 1.0, 4.0, np.nan, 3.0, 0.0])
    y = np.array([1.0, 1.0, 2.0, 1.0, 0.0, 1.0])
    assert statistics.compute_rms_error(x, y) == pytest.approx(np.log(2) * np.sqrt(2 / 3))


@pytest.mark.parametrize(
    ("x", "y"), [([1, 2], [2, 3]), ([1, 1, 1], [1, 2, 3]), ([1, 2, 3], [5, 5, 5]), ([], [])]
)
def test_short_or_constant_columns_have_no_correlation(x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(statistics.compute_spearman(np.array(x, float), np.array(y, float)))


def test_ranks_and_spearman_equal_scipys_if_values_tie():
    x, y = np.array([3.0, 1, 1, 7, 2, 2, 2]), np.array([2.0, 2, 1, 9, 4, 3, 3])
    assert statistics.compute_ranks(x).tolist() == scipy.stats.rankdata(x).tolist()
    assert statistics.compute_spearman(x, y) == pytest.approx(scipy.stats.spearmanr(x, y).statistic)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-200, 1e200])
def test_sums_that_differ_in_the_last_bits_share_a_rank(factor):
    # The second pair lies on either side of the boundary at which 9 digits round up.
    boundary = 2.0000000050
    sums = np.array([0.1 + 0.2, 0.3, np.nextafter(boundary, 0), boundary, 2.00000002, 0.0])
    expected = [2.5, 2.5, 4.5, 4.5, 6, 1] if factor > 0 else [4.5, 4.5, 2.5, 2.5, 1, 6]
    assert statistics.compute_ranks(factor * sums).tolist() == expected
    assert np.isnan(statistics.compute_spearman(factor * sums[[0, 1, 1]], np.arange(3.0))), (
        "a constant column"
    )
