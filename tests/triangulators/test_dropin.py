import mapbox_earcut
import numpy as np
import pytest
import shapely

from tests.ports.polygons import earcut_rings, flatten_rings
from tests.triangulators.cases import random_simple, read_rings, star, with_hole
from triangulators import dropin, flip, triangulate, triangulate_many, vertices
from triangulators.criteria import predict
from triangulators.geometry.ear_clipping import find_far_offsets
from triangulators.verify import verify

METHODS = ("flips", "refined", "optimal:half-perimeter")


def outlines():
    rng = np.random.default_rng(2)
    return [random_simple(rng, int(n), 40) for n in range(3, 40)] + [star(100), star(200)]


def test_default_method_flips_earcut_triangles():
    for polygon in outlines():
        points, ends = earcut_rings(polygon)
        indices = dropin.triangulate_float64(points, ends)
        assert indices.dtype == np.uint32
        raw = mapbox_earcut.triangulate_float64(points, ends)
        assert np.array_equal(indices.reshape(-1, 3), flip(points, raw))
        assert np.array_equal(indices.reshape(-1, 3), triangulate(polygon, "flips:l1"))
        assert np.array_equal(indices, dropin.triangulate_float64(points, ends, method="flips"))


def test_unknown_method_raises_error():
    """Also "optimal", which elsewhere means the optimum for overdraw."""
    for name in ("best", "optimal"):
        with pytest.raises(ValueError, match=f"unknown method '{name}'; known: flips:l1, refined:"):
            dropin.triangulate_float64(*earcut_rings(star(9)), method=name)


@pytest.mark.parametrize("method", METHODS)
def test_optimum_with_holes_is_never_worse_than_earcut(method):
    rng = np.random.default_rng(4)
    better = 0
    for _ in range(30):
        polygon = with_hole(rng, 14, 6)
        points, ends = earcut_rings(polygon)
        improved = dropin.triangulate_float64(points, ends, method=method).reshape(-1, 3)
        raw = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
        costs = [predict(points, triangles)["half_perimeter"] for triangles in (improved, raw)]
        assert verify(polygon, improved).ok
        assert costs[0] <= costs[1] * (1 + 1e-12)
        better += costs[0] < costs[1] * (1 - 1e-9)
    assert better > 15


@pytest.mark.parametrize("method", METHODS)
def test_hostile_input_gives_valid_or_earcut_triangles(method):
    for name, rings in read_rings("earcut_fixtures.json"):
        points, ends = flatten_rings(rings)
        # With holes the optimum is proven, which takes seconds for many vertices: not here.
        if len(points) > (3000 if len(rings) == 1 else 300):
            continue
        raw = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
        improved = dropin.triangulate_float64(points, ends, method=method).reshape(-1, 3)
        areas = [predict(points, triangles)["area"] for triangles in (raw, improved)]
        assert areas[0] == pytest.approx(areas[1], rel=1e-9), name


def test_bad_arguments_raise_earcut_errors():
    points = vertices(star(10))
    cases = [
        (points, np.array([7], dtype=np.uint32)),
        (points[:, :1], np.array([10], dtype=np.uint32)),
        (points, np.array([5, 3, 10], dtype=np.uint32)),
    ]
    for arguments in cases:
        with pytest.raises((ValueError, TypeError)) as theirs:
            mapbox_earcut.triangulate_float64(*arguments)
        with pytest.raises(theirs.type):
            dropin.triangulate_float64(*arguments)
    empty = np.empty((0, 2)), np.empty(0, dtype=np.uint32)
    assert len(dropin.triangulate_float64(*empty)) == len(mapbox_earcut.triangulate_float64(*empty))


@pytest.mark.parametrize("kind", [np.float32, np.int32, np.int64])
def test_functions_of_other_types_equal_float64(kind):
    triangulate_numbers = getattr(dropin, f"triangulate_{kind.__name__}")
    raw = getattr(mapbox_earcut, f"triangulate_{kind.__name__}")
    better = 0
    for polygon in (star(50), with_hole(np.random.default_rng(4), 14, 6)):
        points, ends = earcut_rings(polygon)
        doubles = np.round(points * 1000)
        points = doubles.astype(kind)
        indices, theirs = triangulate_numbers(points, ends), raw(points, ends)
        assert indices.dtype == np.uint32
        assert np.array_equal(indices, dropin.triangulate_float64(doubles, ends))
        ours, raw_cost = (
            predict(doubles, flat.reshape(-1, 3))["half_perimeter"] for flat in (indices, theirs)
        )
        assert ours <= raw_cost * (1 + 1e-12)
        better += ours < raw_cost
        # Earcut casts what is not of its kind; so does the drop-in.
        between = doubles + 0.25
        cast = triangulate_numbers(between.astype(kind), ends)
        assert np.array_equal(triangulate_numbers(between, ends), cast)
    assert better


def test_large_integers_are_exact_up_to_2_53():
    points, ends = earcut_rings(star(50))
    near = np.round(points * 1000).astype(np.int64)
    far = near + 2**60
    assert np.array_equal(dropin.triangulate_int64(far, ends), dropin.triangulate_int64(near, ends))
    wide = near * (2**53 // 100)
    raw = mapbox_earcut.triangulate_int64(wide, ends)
    assert np.array_equal(dropin.triangulate_int64(wide, ends), raw)
    empty = np.empty((0, 2), np.int64), np.empty(0, dtype=np.uint32)
    assert len(dropin.triangulate_int64(*empty)) == 0


FAR = shapely.from_wkt(
    "POLYGON ((2470085.945658393 -545049.1844690691, 2468794.3964099884 -546188.0119655617,"
    "2468007.8630562713 -545819.8038462689, 2469375.2953990833 -548388.9345264949,"
    "2470085.945658393 -545049.1844690691), (2469806.5849805516 -546226.1982538516,"
    "2469376.326797096 -546259.7668055852, 2469276.4409924787 -546221.1014790101,"
    "2469806.5849805516 -546226.1982538516), (2469142.4238512083 -546350.937706712,"
    "2468947.840187953 -546259.8452128543, 2469160.760442423 -546234.740813974,"
    "2469142.4238512083 -546350.937706712))"
)
"""A polygon of 3 km, far from the origin, for which mapbox_earcut's triangles overlap."""


@pytest.mark.parametrize("name", ["ear-clipping", "earcut-refine", "flips:l1", "refined"])
def test_polygons_far_from_the_origin_are_covered_once(name):
    points, ends = earcut_rings(FAR)
    raw = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
    assert not verify(FAR, raw).ok  # if it is, earcut needs no local origin any more
    batch = [star(20), FAR, shapely.Polygon(), FAR]
    for triangles in (triangulate(FAR, name), *list(triangulate_many(batch, name))[1::2]):
        assert verify(FAR, triangles).ok
        assert len(triangles) == 12
    for method in METHODS:
        assert verify(FAR, dropin.triangulate_float64(points, ends, method).reshape(-1, 3)).ok


@pytest.mark.parametrize("kind", [np.float64, np.int32, np.int64])
@pytest.mark.parametrize("sign", [1, -1])
def test_local_origin_preserves_relative_positions(kind, sign):
    rng = np.random.default_rng(4)
    points = (sign * (10**6 + rng.integers(0, 10**5, (50, 2)))).astype(kind)
    starts = np.array([0, 20])
    local = points - np.repeat(find_far_offsets(points, starts), [20, 30], axis=0)
    assert local.dtype == kind
    for part in (slice(0, 20), slice(20, 50)):
        assert (np.diff(local[part], axis=0) == np.diff(points[part], axis=0)).all()
        assert (np.abs(local[part]).min(axis=0) == 0).all()
    near = rng.random((9, 2)) - 0.5
    assert not find_far_offsets(near, np.zeros(1, int)).any()
