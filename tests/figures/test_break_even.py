"""After how many draws a longer triangulating has paid: made-up records, known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness.figures.break_even import BreakEven, break_even
from tests.harness.test_summary import printed, record


def test_it_is_what_triangulating_took_longer_over_what_a_draw_saves():
    base = record("ear-clipping", triangulate_s=0.5)  # 0.1 s a draw
    longer = record("optimal", 0.8, triangulate_s=1.49)  # 0.02 s less
    even = break_even(longer, base)
    assert (even.draws, even.low, even.high) == pytest.approx((49.5, 49.5, 49.5))
    assert even.written == "50 draws (50 to 50)"


def test_the_interval_is_that_of_the_ratio():
    rng = np.random.default_rng(1)
    base = record("ear-clipping", triangulate_s=0.0)
    longer = record("optimal", triangulate_s=1.0)
    for each, factor in ((base, 0.1), (longer, 0.08)):
        each["time"]["samples_s"] = (factor * rng.lognormal(0, 0.02, 50)).tolist()
        each["time"]["reference_s"] = [1.0] * 50
    even = break_even(longer, base)
    assert even.low < even.draws < even.high
    assert even.low < 50 < even.high


@pytest.mark.parametrize(
    ("factor", "seconds", "written"),
    [(1.0, 1.5, "never"), (1.2, 1.5, "never"), (0.8, 0.4, "at once"), (1.0, 0.5, "at once")],
)
def test_never_and_at_once(factor, seconds, written):
    base = record("ear-clipping", triangulate_s=0.5)
    assert break_even(record("other", factor, triangulate_s=seconds), base).written == written


def test_where_it_is_not_defined():
    base = record("ear-clipping", triangulate_s=0.5)
    assert break_even(record("slower to draw", 1.2, triangulate_s=0.1), base) is None
    assert break_even(record("not timed", triangulate_s=0.1, time=None), base) is None
    assert break_even(record("of an older version"), base) is None
    assert break_even(base, None) is None


def test_what_may_never_pay_says_so():
    assert BreakEven(10.2, 4.0, math.inf).written == "11 draws (4 to never)"


def test_the_table_says_it_below():
    records = [
        record("ear-clipping", triangulate_s=0.5),
        record("optimal:half-perimeter", 0.8, triangulate_s=1.49),
        record("worst:half-perimeter", 1.5, triangulate_s=1.5),
        record("delaunay", 0.9, triangulate_s=0.1),
    ]
    text = " ".join(printed(records).split())
    assert "pays against ear-clipping after: optimal:half-perimeter 50 draws (50 to 50)" in text
    assert "worst:half-perimeter never" in text
    assert "delaunay at once" not in text
