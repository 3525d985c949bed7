import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import load
from scenes.stress import FAMILIES
from tests.scenes.conftest import assert_valid_polygons, require_error, write_file
from tests.triangulators.cases import read_shared

BUILT_IN = ("city", "glyphs", "cad", "paper", "stress", "meshes")


def are_disjoint(polygons) -> bool:
    """Return whether polygons overlap by rounding to a millimetre only: 0.06 m2 for 60 m."""
    array = np.asarray(polygons)
    a, b = shapely.STRtree(array).query(array, predicate="intersects")
    a, b = a[a < b], b[a < b]
    return bool((shapely.area(shapely.intersection(array[a], array[b])) < 0.06).all())


@pytest.mark.parametrize("name", BUILT_IN)
def test_scene_is_valid_deterministic_and_disjoint(name):
    scene = load(name)
    assert_valid_polygons(scene.polygons)
    assert scene.name == name
    assert scene.dropped == scene.repaired == []
    assert scene.content_hash == load(name).content_hash
    assert are_disjoint(scene.polygons)
    assert all((scene.units, scene.description, scene.licence))


@pytest.mark.parametrize("name", ["city", "cad", "stress", "meshes"])
def test_seed_changes_generated_scenes(name):
    assert load(name, seed=1).content_hash != load(name, seed=2).content_hash


def test_city_with_a_plan_that_geos_cannot_intersect():
    assert len(load("city:seed=816711,buildings=1").polygons) == 1


def test_paper_polygon():
    (polygon,) = load("paper").polygons
    expected = {(3, 7), (0, 8), (1, 11), (7, 11), (7, 6), (6, 3), (3, 0), (1, 3), (3, 2)}
    assert set(polygon.exterior.coords) == expected
    assert list(polygon.exterior.coords)[:-3:-1] == [(3, 7), (0, 8)]


class TestGlyphs:
    def test_text_is_set_in_a_line(self):
        single = load("glyphs", text="H").polygons[0]
        second = load("glyphs", text="HH").polygons[1]
        assert second.area == single.area
        assert second.bounds[0] > single.bounds[2]
        assert second.bounds[1] == single.bounds[1]

    def test_steps_refine_curves(self):
        coarse, fine = (load("glyphs", text="O", steps=s).polygons[0] for s in (2, 16))
        assert len(fine.exterior.coords) > 4 * len(coarse.exterior.coords)
        assert fine.area == pytest.approx(coarse.area, rel=0.03)

    def test_font_file(self, tmp_path):
        from matplotlib import font_manager

        serif = font_manager.findfont("DejaVu Serif")
        scene = load("glyphs", font=serif, text="I")
        assert scene.polygons[0].exterior.length > load("glyphs", text="I").polygons[0].length
        bad = write_file(tmp_path / "bad.ttf", "not a font at all")
        require_error("not a font", "glyphs", font=str(bad))
        require_error("not found: check the path", "glyphs", font="none.ttf")

    def test_characters_without_a_glyph_are_named(self):
        scene = load("glyphs", text="A\U000f0000")
        assert len(scene.polygons) == 1
        assert "has no glyph" in scene.dropped[0][1]
        require_error("no outline", "glyphs", text=" ")


class TestStress:
    @pytest.mark.parametrize("family", FAMILIES)
    @pytest.mark.parametrize("vertices", [12, 37, 1000])
    def test_family_has_about_the_requested_vertices(self, family, vertices):
        scene = load("stress", family=family, vertices=vertices)
        (polygon,) = scene.polygons
        count = shapely.get_num_coordinates(polygon) - 1 - len(polygon.interiors)
        limit = 4 * vertices if family == "koch" else 1.35 * vertices + 4
        assert vertices / 4 <= count <= limit
        assert scene.repaired == []

    @pytest.mark.parametrize("family", ["random-maze", "random-monotone", "comb"])
    def test_a_hundred_thousand_vertices(self, family):
        scene = load("stress", family=family, vertices=100_000)
        assert len(scene.polygons) == 1
        assert shapely.get_num_coordinates(scene.polygons[0]) > 99_000

    def test_polygon_does_not_depend_on_other_families(self):
        single = load("stress", family="random-maze").polygons[0]
        combined = load("stress").polygons[list(FAMILIES).index("random-maze")]
        assert combined.area == pytest.approx(single.area)

    @settings(max_examples=40, deadline=None)
    @given(
        family=st.sampled_from([f for f in FAMILIES if f.startswith(("random", "needle"))]),
        vertices=st.integers(12, 300),
        seed=st.integers(0, 2**40),
    )
    def test_random_polygons_are_simple(self, family, vertices, seed):
        scene = load("stress", family=family, vertices=vertices, seed=seed)
        assert_valid_polygons(scene.polygons)
        assert scene.repaired == scene.dropped == []


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**40), segments=st.integers(8, 60))
def test_parts_of_cad_are_valid_for_every_seed(seed, segments):
    scene = load("cad", seed=seed, segments=segments, parts=10)
    assert_valid_polygons(scene.polygons)
    assert scene.repaired == scene.dropped == []
    assert are_disjoint(scene.polygons)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        *((f"stress:{value}", None) for value in ("vertices=3", "vertices=100001", "family=no")),
        *(("cad:parts=0", "out of range"), ("city:buildings=0", "give 1 to 100000")),
        *(("city:buildings=-5", "give 1 to"), ("city:buildings=100001", "give 1 to 100000")),
    ],
)
def test_parameters_out_of_range_are_refused(scene, message):
    require_error(message, scene)


@pytest.fixture(scope="module")
def city():
    return load("city", buildings=3000, seed=1)


def test_city_has_the_recorded_content():
    """If this hash changes, runs of the scene are not comparable with earlier runs."""
    assert load("city", buildings=100).content_hash.startswith("fe27dc3a45bf31f6")


def test_footprints_share_walls_but_not_area(city):
    assert city.units == "m"
    assert are_disjoint(city.polygons)
    array = np.asarray(city.polygons)
    a, b = shapely.STRtree(array).query(array, predicate="intersects")
    assert (a < b).sum() > 300  # party walls


def test_distribution_of_vertices_agrees_with_helsinki(city):
    quantiles, shares_with_holes = [], []
    for polygons in (city.polygons, [polygon for _, polygon in read_shared("helsinki.json")]):
        holes = shapely.get_num_interior_rings(polygons)
        vertices = shapely.get_num_coordinates(polygons) - 1 - holes
        quantiles.append(np.percentile(vertices, (25, 50, 75, 90, 95)))
        shares_with_holes.append((holes > 0).mean())
    assert quantiles[0] == pytest.approx(quantiles[1], rel=0.15)
    assert shares_with_holes[0] == pytest.approx(shares_with_holes[1], abs=0.025)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**9), buildings=st.integers(1, 120))
def test_city_is_valid_for_every_seed(seed, buildings):
    scene = load("city", seed=seed, buildings=buildings)
    assert len(scene.polygons) == buildings
    assert_valid_polygons(scene.polygons)
