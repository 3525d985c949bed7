import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import SceneError, load
from tests.scenes.conftest import assert_sound, shared_polygons


def vertex_counts(polygons: list[shapely.Polygon]) -> np.ndarray:
    array = np.asarray(polygons)
    return shapely.get_num_coordinates(array) - 1 - shapely.get_num_interior_rings(array)


def share_with_holes(polygons: list[shapely.Polygon]) -> float:
    return float((shapely.get_num_interior_rings(np.asarray(polygons)) > 0).mean())


@pytest.fixture(scope="module")
def city():
    return load("city", buildings=3000, seed=1)


def test_is_sound_and_in_metres(city):
    assert_sound(city.polygons)
    assert len(city.polygons) == 3000
    assert city.units == "m"
    assert city.dropped == []
    assert city.repaired == []


def test_default_is_500_buildings():
    assert len(load("city").polygons) == 500


def test_same_seed_same_city_other_seed_another():
    a, b, other = (load("city", buildings=60, seed=s) for s in (3, 3, 4))
    assert a.content_hash == b.content_hash
    assert a.content_hash != other.content_hash


def test_content_is_the_same_on_every_machine():
    """A change of this hash is a change of the scene: old runs no longer compare with new ones."""
    assert load("city", buildings=100).content_hash.startswith("fe27dc3a45bf31f6")


def test_footprints_share_walls_but_not_area(city):
    array = np.asarray(city.polygons)
    tree = shapely.STRtree(array)
    a, b = tree.query(array, predicate="intersects")
    a, b = a[a < b], b[a < b]
    shared = shapely.area(shapely.intersection(array[a], array[b]))
    # coordinates are rounded to a millimetre, so a wall of 60 m may overlap by 0.06 square metres
    assert shared.max() < 0.06
    assert len(a) > 300  # party walls


def test_vertex_counts_and_courtyards_are_as_asked(city):
    n = vertex_counts(city.polygons)
    assert 9 <= np.median(n) <= 11
    assert 31 <= np.percentile(n, 95) <= 39
    assert 0.065 <= share_with_holes(city.polygons) <= 0.1


def test_distribution_is_that_of_helsinki(city):
    real = shared_polygons("helsinki.json")
    n, wanted = vertex_counts(city.polygons), vertex_counts(real)
    for percent in (25, 50, 75, 90, 95):
        assert np.percentile(n, percent) == pytest.approx(np.percentile(wanted, percent), rel=0.15)
    assert share_with_holes(city.polygons) == pytest.approx(share_with_holes(real), abs=0.025)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**9), buildings=st.integers(1, 120))
def test_every_seed_gives_a_sound_city_of_the_size_asked(seed, buildings):
    scene = load("city", seed=seed, buildings=buildings)
    assert len(scene.polygons) == buildings
    assert_sound(scene.polygons)


@pytest.mark.parametrize("buildings", [0, -5, 100_001])
def test_size_out_of_range_is_refused(buildings):
    with pytest.raises(SceneError, match="give 1 to 100000"):
        load("city", buildings=buildings)
