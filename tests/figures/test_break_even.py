"""After how many draws a longer triangulating has paid: made-up records, known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness.figures.groups import time_ratio
from harness.figures.intervals import RUN_SCATTER
from harness.figures.verdict import BreakEven, break_even
from tests.harness.test_summary import printed, record

ROUNDS = 12


def triangulated(name, seconds, factor=1.0, scatter=0.0, seed=0):
    """A record whose draws take `factor` of 0.1 s, triangulated in rounds of about `seconds`."""
    noise = np.random.default_rng(seed).normal(0, scatter, ROUNDS)
    samples = (seconds * (1 + noise - noise.mean())).tolist()
    return record(name, factor, triangulate_s=seconds, triangulate_samples_s=samples)


BASE = triangulated("ear-clipping", 0.5)


def test_it_is_what_triangulating_took_longer_over_what_a_draw_saves():
    even = break_even(triangulated("optimal", 1.49, 0.8), BASE)  # 0.02 s of 0.1 s less
    # Drawing was timed without any scatter: the interval is what runs scatter.
    saved = 0.1 * (1 - 0.8 * np.exp([RUN_SCATTER * 1.96, -RUN_SCATTER * 1.96]))
    low, high = sorted(0.99 / saved)
    assert (even.draws, even.low, even.high) == pytest.approx((49.5, low, high), rel=1e-4)
    assert even.written == "after 50 draws (48 to 51)"
    assert even.short == "50 (48-51)"


def test_either_uncertainty_widens_the_interval():
    exact = triangulated("optimal", 1.5, 0.8)
    rough = triangulated("optimal", 1.5, 0.8, scatter=0.1)
    even = break_even(rough, BASE)
    assert even.draws == pytest.approx(50)
    student = 2.2009851600916384  # 11 degrees of freedom
    reach = student * np.std(rough["triangulate_samples_s"], ddof=1) / math.sqrt(ROUNDS) / 0.02
    drawing = 50 * 0.8 * RUN_SCATTER * 1.96 / 0.2
    both = math.hypot(reach, drawing)
    assert (even.low, even.high) == pytest.approx((50 - both, 50 + both), rel=3e-3)
    rng = np.random.default_rng(1)
    draws = {"samples_s": (0.08 * rng.lognormal(0, 0.02, 8)).tolist()}
    noisy = {**exact, "time": {**exact["time"], **draws}}
    steady = {**BASE, "time": {**BASE["time"], "samples_s": [0.1] * 8, "ci95_s": [0.1, 0.1]}}
    alone = break_even(noisy, steady)
    assert alone.low < 50 < alone.high
    unsure = {**steady, "time": {**steady["time"], "ci95_s": [0.09, 0.11]}}
    wider = break_even(noisy, unsure)
    assert wider.low < alone.low < alone.high < wider.high
    both = break_even({**noisy, "triangulate_samples_s": rough["triangulate_samples_s"]}, steady)
    assert both.low < alone.low < alone.high < both.high


@pytest.mark.parametrize(
    ("factor", "seconds", "written"),
    [
        (0.8, 1.49, "after 50 draws (48 to 51)"),
        (0.8, 0.4, "at once"),
        (0.8, 0.5, "at once"),
        (1.0, 1.5, "not shown"),
        (1.0, 0.4, "not shown"),
        (1.25, 1.5, "never (shown to be slower)"),
        (1.25, 0.5, "never (shown to be slower)"),
        (1.25, 0.24, "up to 10 draws (10 to 11)"),
    ],
)
def test_every_combination_has_its_words(factor, seconds, written):
    assert break_even(triangulated("other", seconds, factor), BASE).written == written


def test_triangulating_once_tells_no_interval():
    base = record("ear-clipping", triangulate_s=0.5)
    even = break_even(record("optimal", 0.8, triangulate_s=1.49), base)
    assert even.written == "after about 50 draws (triangulated once)"
    assert even.short == "50 (?)"
    assert (even.low, even.high) == (None, None)


def test_where_triangulating_may_take_no_longer_the_least_is_no_draw():
    even = break_even(triangulated("other", 0.51, 0.8, scatter=0.1), BASE)
    assert even.low == 0
    assert 0 < even.draws < even.high
    assert even.written.startswith("after 1 draw (0 to ")


def test_where_it_is_not_defined():
    base = record("ear-clipping", triangulate_s=0.5)
    assert break_even(record("not timed", triangulate_s=0.1, time=None), base) is None
    assert break_even(record("of an older version"), base) is None
    assert break_even(base, base) is None
    assert break_even(base, None) is None
    pair = [triangulated(name, 0.5) for name in ("one", "other")]
    for each in pair:
        each["time"] |= {"cycles": 1000}
    assert time_ratio(*pair).exact
    assert break_even(*pair) is None


def test_an_interval_is_never_one_number_and_may_have_no_end():
    assert BreakEven("after", 4.0, 4.0, 4.0).written == "after 4 draws (3 to 4)"
    assert BreakEven("after", 3.6, 3.4, 3.9).written == "after 4 draws (3 to 4)"
    assert BreakEven("after", 10.2, 4.0, math.inf).written == "after 11 draws (3 or more)"
    assert BreakEven("after", 0.3, 0.2, 0.4).written == "after 1 draw (0 to 1)"
    assert BreakEven("after", -0.2, -2.0, 2.4).written == "at once (0 to 3 draws)"
    assert BreakEven("after", 0.0, 0.0, math.inf).written == "at once (0 or more draws)"


def test_the_table_has_it_beside_each_row():
    records = [
        BASE,
        triangulated("optimal:half-perimeter", 1.49, 0.8),
        triangulated("worst:half-perimeter", 1.5, 1.5),
        triangulated("delaunay", 0.1, 0.9),
        triangulated("greedy", 0.9, 1.0),
    ]
    lines = {line.split()[0]: line.rstrip() for line in printed(records).splitlines() if line}
    assert "pays after" in lines["triangulator"]
    assert lines["optimal:half-perimeter"].endswith("0.800 (0.795-0.805) 50 (48-51)")
    assert lines["delaunay"].endswith("at once")
    assert lines["greedy"].endswith("not shown")
    assert lines["worst:half-perimeter"].endswith("never")
