"""Rank correlation: of what it can be told, and what it is not."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.stats

from harness.figures.polygons import ranks, spearman


@pytest.mark.parametrize(
    ("x", "y"), [([1, 2], [2, 3]), ([1, 1, 1], [1, 2, 3]), ([1, 2, 3], [5, 5, 5]), ([], [])]
)
def test_what_is_short_or_constant_has_none(x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(spearman(np.array(x, float), np.array(y, float)))


def test_it_is_that_of_scipy_with_equal_values():
    x, y = np.array([3.0, 1, 1, 7, 2, 2, 2]), np.array([2.0, 2, 1, 9, 4, 3, 3])
    assert ranks(x).tolist() == scipy.stats.rankdata(x).tolist()
    assert spearman(x, y) == pytest.approx(scipy.stats.spearmanr(x, y).statistic)
