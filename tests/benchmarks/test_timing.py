"""False and missed differences of the timing on llvmpipe: `make bench` on a quiet machine."""

import numpy as np
import pytest

from harness import rasterisers
from harness.frame import View, make_bare_frame, make_frame
from harness.measuring import tasks
from harness.measuring.timing import TimingSettings
from harness.metrics.statistics import compute_paired_ratio
from harness.rasterisers.base import Options
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from harness.worker import Worker
from scenes import load

COMPARISONS_SAME = 200
COMPARISONS_SLOWER = 100

DEFAULT = TimingSettings()
SHORT = TimingSettings(budget_s=0.25)
"""Error rates do not depend on the budget; with the default, 200 comparisons take half an hour."""


@pytest.fixture(scope="module")
def llvmpipe():
    device = rasterisers.find_device("opengl", "llvmpipe")
    with Worker("llvmpipe", device.environment) as worker:
        yield device, worker


@pytest.fixture(scope="module")
def city():
    frame = make_frame(load("city:buildings=100").polygons, View(512))
    result = triangulate_polygons(parse("delaunay"), frame.polygons)
    return frame, frame.join_triangles(result.parts)


def compare(llvmpipe, frame, first, second, options, seed, settings=DEFAULT):
    device, worker = llvmpipe
    test = worker.call(tasks.open_device, "opengl", device).timer
    pair = {"first": (frame, first, options), "second": (frame, second, options)}
    group = worker.call(tasks.time_group, "opengl", device, pair, settings, test, seed)
    return compute_paired_ratio(group["first"].samples_s, group["second"].samples_s)


def test_equal_triangulations_rarely_differ_significantly(llvmpipe, city):
    frame, triangles = city
    pair, seeds = (triangles, triangles), range(COMPARISONS_SAME)
    ratios = [compare(llvmpipe, frame, *pair, Options(), seed, SHORT) for seed in seeds]
    flagged = [ratio for ratio in ratios if ratio.verdict != "not significant"]
    rounds = np.median([ratio.rounds for ratio in ratios])
    print(f"\nA/A: {len(flagged)} of {COMPARISONS_SAME} flagged, median {rounds:.0f} rounds")
    assert len(flagged) <= 0.08 * COMPARISONS_SAME


def test_three_percent_more_fragment_work_is_detected(llvmpipe):
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0.119], [1, 0.119]]) * 480 * 256 + 4096
    frame = make_bare_frame(512, square.astype(np.int32))
    base = np.array([[0, 1, 2], [0, 2, 3]] * 4, np.int32)
    extended = np.vstack([base, np.array([[0, 1, 5], [0, 5, 4]], np.int32)])
    device, worker = llvmpipe
    options = Options(work=8)
    counts = [
        worker.call(tasks.draw_and_count, "opengl", device, frame, part, options)["fragments"].sum()
        for part in (base, extended)
    ]
    extra = counts[1] / counts[0] - 1
    assert extra <= 0.0301
    seeds = range(COMPARISONS_SLOWER)
    ratios = [compare(llvmpipe, frame, extended, base, options, seed) for seed in seeds]
    detected = sum(ratio.verdict == "slower" for ratio in ratios)
    typical = np.median([ratio.value for ratio in ratios])
    print(f"\n{extra:.1%} more fragments: {detected} of {COMPARISONS_SLOWER} found, {typical:.3f}")
    assert detected >= 0.9 * COMPARISONS_SLOWER
