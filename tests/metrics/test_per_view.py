import numpy as np
import pytest

from harness import summary
from harness.metrics import decision, groups
from harness.metrics.statistics import (
    MIN_VALUES,
    RESAMPLES,
    TAIL,
    compute_mean_interval,
    compute_ratio_interval,
)
from tests.records import make_group, make_record

VIEWS = "views"


def compare_views(*records: dict) -> groups.ViewStatistics | None:
    return groups.compare_views(*(make_record(**fields) for fields in records))


def describe(records: list[dict]) -> list[str]:
    return groups.describe_views(make_group(records))


def make_row(record: dict, base: dict) -> dict:
    group = make_group([base, record])
    return summary.make_row(group.records[1], decision.decide_group(group))


def record(name: str, lanes: list[int], **more: object) -> dict:
    counted = {"helper_lanes": lanes, "quads": [count // 2 for count in lanes]}
    return {
        "triangulator": name, "status": "ok", "polygons": 9, "fit": "tile", VIEWS: counted,
        "counters": {key: sum(values) for key, values in counted.items()}, **more,
    }  # fmt: skip


BASE = record("ear-clipping", [90, 40, 160, 20, 75, 130, 55, 88])
OTHER = record("flips:l1", [70, 33, 120, 20, 60, 99, 44, 60])


def test_ratio_interval_equals_the_studentised_bootstrap():
    """By definition: jackknife errors, and deviations of resamples in units of these errors."""
    base, values = (np.array(fields[VIEWS]["helper_lanes"], float) for fields in (BASE, OTHER))

    def ratio_and_error(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
        n = len(x)
        without = np.array([np.delete(x, k).sum() / np.delete(y, k).sum() for k in range(n)])
        ratio = x.sum() / y.sum()
        return ratio, np.sqrt((n - 1) / n * np.square(without - ratio).sum())

    ratio, error = ratio_and_error(values, base)
    indices = np.random.default_rng(0).integers(8, size=(RESAMPLES, 8))
    pairs = [ratio_and_error(values[row], base[row]) for row in indices]
    t = np.sort([(ratio_drawn - ratio) / wide for ratio_drawn, wide in pairs if wide > 0])
    t = np.sort(np.append(t, np.zeros(RESAMPLES - len(t))))
    low, high = (t[int(np.ceil(tail * RESAMPLES)) - 1] for tail in (TAIL, 1 - TAIL))
    expected = (ratio - high * error, ratio - low * error)
    assert compute_ratio_interval(values, base) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("values", "base"),
    [
        ([1.0] * 5, [2.0] * 5),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 7.0], [0.0] * 6),
        # Lanes of a plate from six sides: three pairs, each of two that are nearly alike.
        ([498.2, 561.3, 555.1, 497.3, 486.6, 425.9], [498.2, 469.9, 472.6, 497.2, 440.3, 425.8]),
    ],
)
def test_too_few_or_equal_tiles_have_no_interval(values, base):
    assert np.isnan(compute_ratio_interval(np.array(values), np.array(base))).all()


def test_tile_without_lanes_is_included():
    values, base = np.array([0.0, 7, 9, 4, 8, 3, 6]), np.array([0.0, 9, 12, 6, 9, 4, 9])
    low, high = compute_ratio_interval(values, base)
    assert low < values.sum() / base.sum() < high


def test_statistics_are_sums_with_intervals_over_views():
    over = compare_views(OTHER, BASE)
    lanes = np.array(OTHER[VIEWS]["helper_lanes"], float)
    usual = np.array(BASE[VIEWS]["helper_lanes"], float)
    assert (over.measure, over.views) == ("helper_lanes", 8)
    assert over.ratio == pytest.approx(506 / 658)
    assert (over.ratio_low, over.ratio_high) == compute_ratio_interval(lanes, usual)
    means = (lanes.mean(), *compute_mean_interval(lanes))
    assert (over.mean, over.mean_low, over.mean_high) == means
    row = make_row(OTHER, BASE)
    assert row["views"] == 8
    assert row["view_ratio_low"] == over.ratio_low
    assert row["view_mean_high"] == over.mean_high
    line, quads = describe([BASE, OTHER])
    assert quads.startswith("quads relative to ear-clipping (95 % CI over 8 tiles): ")
    interval = f"flips:l1 0.769 ({over.ratio_low:.3f}-{over.ratio_high:.3f})"
    assert line == f"helper lanes relative to ear-clipping (95 % CI over 8 tiles): {interval}"
    records = [record(name, [*range(9, 9 + MIN_VALUES)]) for name in "ab"]
    assert f"(95 % CI over {MIN_VALUES} tiles)" in describe(records)[0]
    tests = [{**fields, VIEWS: {"bbox_tests": fields[VIEWS]["quads"]}} for fields in (BASE, OTHER)]
    assert describe(tests)[0].startswith("bounding-box tests relative to")


@pytest.mark.parametrize("tiles", [1, MIN_VALUES - 1])
def test_few_tiles_have_no_interval(tiles):
    note = "1 tile," if tiles == 1 else f"{tiles} tiles,"
    lanes = {case["triangulator"]: case[VIEWS]["helper_lanes"] for case in (BASE, OTHER)}
    base, other = (record(name, values[:tiles]) for name, values in lanes.items())
    line = describe([base, other])[0]
    assert f"({note} too few for intervals): flips:l1 0." in line
    assert line.count("(") == 1
    row = make_row(other, base)
    assert row["view_ratio_low"] is row["view_mean_low"] is None


def test_views_of_other_polygons_are_not_compared():
    assert describe([{**BASE, VIEWS: None}, OTHER]) == []
    assert compare_views({**OTHER, "polygons": 8}, BASE) is None
    assert describe([BASE]) == []
    short = record("flips:l1", [1, 2])
    assert compare_views(short, BASE) is None
