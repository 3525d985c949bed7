import warnings

import numpy as np
import pytest
import scipy.stats

from harness.metrics.per_polygon import (
    compute_rank_correlation,
    compute_ranks,
    compute_ratios,
    compute_rms_error,
    compute_spearman,
    pair_ratios,
    read_columns,
)
from harness.results.run_folder import Run
from harness.results.run_writer import RunFolder
from tests.records import make_record


def make_columns(cost: list[float], quads: list[float], triangles: list[int] | None = None):
    drawn = triangles or [4] * len(cost)
    values = {"predicted_half_perimeter": cost, "quads": quads, "predicted_triangles": drawn}
    return {name: np.asarray(column, np.float64) for name, column in values.items()}


BASE = make_columns([2, 2, 2, 4], [10, 10, 10, 10])
OTHER = make_columns([1, 2, 3, 8], [5, 10, 15, 20])


def test_rank_correlation_needs_three_pairs():
    x, y = np.array([1.0, 2.0, 4.0]), np.array([9.0, 8.0, 3.0])
    assert compute_rank_correlation(x, y) == pytest.approx(-1)
    assert compute_rank_correlation(x[:2], y[:2]) is None
    assert compute_rank_correlation(x, np.array([1.0, np.nan, 2.0])) is None
    assert compute_rank_correlation(x, np.ones(3)) is None
    assert compute_rank_correlation(np.ones(3), y) is None


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
    others = [{"other": OTHER, "bare": bare}, {"other": OTHER}, {"other": OTHER}, {}]
    for base, drawn in zip((BASE, no_quads, no_cost, BASE), others, strict=True):
        pairs = pair_ratios({"base": base, **drawn}, "base", "half_perimeter", "quads")
        assert [len(column) for column in pairs] == [0, 0]
        assert compute_rank_correlation(*pairs) is None


def test_rms_error_is_that_of_log_ratios():
    x = np.array([0.5, 1.0, 4.0, np.nan, 3.0, 0.0])
    y = np.array([1.0, 1.0, 2.0, 1.0, 0.0, 1.0])
    assert compute_rms_error(x, y) == pytest.approx(np.log(2) * np.sqrt(2 / 3))


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


@pytest.mark.parametrize(
    ("x", "y"), [([1, 2], [2, 3]), ([1, 1, 1], [1, 2, 3]), ([1, 2, 3], [5, 5, 5]), ([], [])]
)
def test_short_or_constant_columns_have_no_correlation(x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(compute_spearman(np.array(x, float), np.array(y, float)))


def test_ranks_and_spearman_equal_scipys_if_values_tie():
    x, y = np.array([3.0, 1, 1, 7, 2, 2, 2]), np.array([2.0, 2, 1, 9, 4, 3, 3])
    assert compute_ranks(x).tolist() == scipy.stats.rankdata(x).tolist()
    assert compute_spearman(x, y) == pytest.approx(scipy.stats.spearmanr(x, y).statistic)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-200, 1e200])
def test_sums_that_differ_in_the_last_bits_share_a_rank(factor):
    # The second pair lies on either side of the boundary at which 9 digits round up.
    boundary = 2.0000000050
    sums = np.array([0.1 + 0.2, 0.3, np.nextafter(boundary, 0), boundary, 2.00000002, 0.0])
    expected = [2.5, 2.5, 4.5, 4.5, 6, 1] if factor > 0 else [4.5, 4.5, 2.5, 2.5, 1, 6]
    assert compute_ranks(factor * sums).tolist() == expected
    assert np.isnan(compute_spearman(factor * sums[[0, 1, 1]], np.arange(3.0))), "a constant column"
