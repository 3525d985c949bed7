"""`optimal:calibrated` for devices of several stages, with hand-made costs."""

from dataclasses import replace

import numpy as np
import pytest

from harness.frame import View, make_scene_frame
from harness.profile.cost_terms import TERMS, count_cost_terms
from harness.profile.device_costs import (
    EXPECTED,
    DeviceCosts,
    compute_stage_weights,
    minimise_slowest_stage,
    order_for_slowest_stage,
)
from harness.profile.law import VERTICES
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load
from triangulators.criteria import predict
from triangulators.geometry.order import put_in_walk_order

CALIBRATED = parse("optimal:calibrated", calibration={"half_perimeter": 1.0})
THREE = "maximum of three stages"


@pytest.fixture(scope="module")
def frame():
    return make_scene_frame(load("glyphs:text=aegs"), View(96))


def make_device(form=THREE, **costs):
    return DeviceCosts("GPU", np.array([costs.get(name, 0.0) for name in TERMS]), form)


def minimise(frame, device):
    recipes = []

    def triangulate(recipe):
        recipes.append(recipe)
        return triangulate_polygons(recipe, frame.polygons)

    return *minimise_slowest_stage(device, frame, CALIBRATED, triangulate), recipes


def sum_weights(result, weights):
    return sum(factor * result.predicted[name].sum() for name, factor in weights.items())


def compute_time(frame, result, device):
    return max(order_for_slowest_stage(device, frame, result)[1].values())


@pytest.mark.parametrize("name", list(EXPECTED))
def test_expected_counters_are_means_over_positions(frame, name):
    """Four shapes of triangles, none thin, at 400 positions."""
    shapes = np.array([[[0, 0], [9, 2], [4, 7]], [[0, 0], [60, 5], [30, 44]]]) * 64
    shapes = np.concatenate([shapes, shapes[:, :, ::-1] // 3])
    triangles = np.arange(12, dtype=np.int32).reshape(4, 3)
    rng = np.random.default_rng(3)
    counts = []
    for _ in range(400):
        shifts = rng.integers(1024, 1024 + 16 * 256, (4, 1, 2))
        points = (shapes + shifts).reshape(-1, 2).astype(np.int32)
        moved = replace(frame, grid=replace(frame.grid, coords=points))
        counts.append(count(moved, triangles)[name])
    sums = predict(shapes.reshape(-1, 2) / 256, triangles)
    expected = sum(factor * sums[feature] for feature, factor in EXPECTED[name].items())
    if name == "tile_pairs":
        expected += sums["area"] / 256  # constant for a polygon
    assert np.mean(counts) == pytest.approx(expected, rel=0.03)


def count(frame, triangles):
    return count_cost_terms(replace(frame, tiles=None), triangles)


def test_pixels_are_minimised_where_they_bind(frame):
    device = make_device(helper_lanes=1e-9, covering=1e-15, vertex_batches=1e-15)
    recipe, result, recipes = minimise(frame, device)
    assert dict(recipe.calibration) == {"area": -1e-9, "expected_quads": 4e-9}
    best = triangulate_polygons(parse("optimal:expected-quads"), frame.polygons)
    quads = [each.predicted["expected_quads"].sum() for each in (result, best)]
    assert quads[0] == pytest.approx(quads[1], rel=1e-12)
    assert [each.base for each in recipes] == ["ear-clipping", "optimal:calibrated"]
    assert result.notes == []


def test_triangles_are_minimised_where_they_bind(frame):
    device = make_device(helper_lanes=1e-15, covering=1e-6, tile_pairs=1e-7)
    recipe, result, _ = minimise(frame, device)
    weights = compute_stage_weights(device, "triangles")
    assert dict(recipe.calibration) == weights
    others = ("ear-clipping", "optimal:half-perimeter", "optimal:expected-quads")
    for name in others:
        other = triangulate_polygons(parse(name), frame.polygons)
        assert sum_weights(result, weights) < sum_weights(other, weights)
        if name == "ear-clipping":
            assert compute_time(frame, result, device) < compute_time(frame, other, device)


def test_vertices_are_ordered_where_they_bind(frame):
    device = make_device(transformed_vertices=1e-3, helper_lanes=1e-9, covering=1e-15)
    recipe, result, _ = minimise(frame, device)
    assert set(dict(recipe.calibration)) == {"area", "expected_quads"}
    (note,) = result.notes
    assert "at 96 px: the slowest stage on GPU is vertices, which no triangulation" in note
    rng = np.random.default_rng(1)
    shuffled = replace(result, parts=[rng.permutation(part) for part in result.parts])
    ordered, times = order_for_slowest_stage(device, frame, shuffled)
    for part, walked in zip(shuffled.parts, ordered.parts, strict=True):
        assert (walked == put_in_walk_order(part, int(part.max()) + 1)).all()
    before, after = (
        count(frame, frame.join_triangles(each.parts))[VERTICES[0]] for each in (shuffled, ordered)
    )
    assert after < before
    assert times["vertices"] == pytest.approx(1e-3 * after)


def test_the_next_stage_is_minimised_if_it_binds_the_result(frame):
    """Fewer covering triangles make pixels the slowest stage; the faster optimum is chosen."""
    base = triangulate_polygons(parse("ear-clipping"), frame.polygons)
    counts = count(frame, frame.join_triangles(base.parts))
    covering = 1e-9 * counts["helper_lanes"] / counts["covering"]
    device = make_device(helper_lanes=1e-9, covering=1.001 * covering)
    recipe, result, recipes = minimise(frame, device)
    calibrations = [dict(each.calibration) for each in recipes[1:]]
    assert calibrations == [compute_stage_weights(device, name) for name in ("triangles", "pixels")]
    times = [
        compute_time(frame, triangulate_polygons(each, frame.polygons), device)
        for each in recipes[1:]
    ]
    assert recipe == recipes[1 + int(np.argmin(times))]
    assert compute_time(frame, result, device) == min(times) < 1e-9 * counts["helper_lanes"]


def test_costs_that_no_triangulation_changes_leave_the_calibration(frame):
    recipe, _, recipes = minimise(frame, make_device(draw=1e-3, transformed_vertices=1e-3))
    assert recipe == CALIBRATED
    assert recipes == [CALIBRATED]
