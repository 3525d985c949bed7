"""All of what tests/triangulators/test_everywhere.py samples, and 5,000 more polygons."""

from hypothesis import HealthCheck, given, settings

from scenes import load
from tests.triangulators.cases import glyphs, hard_polygons, shared
from tests.triangulators.test_everywhere import LETTERS, check


def test_every_fixture_building_and_letter():
    done = [check(polygon, letter) for letter, polygon in glyphs(LETTERS)]
    for name in ("earcut_fixtures.json", "poly2tri_testbed.json", "helsinki.json"):
        done += [check(polygon, label) for label, polygon in shared(name)]
    done += [check(polygon, index) for index, polygon in enumerate(load("city").polygons)]
    assert sum(count > 0 for count in done) > 2000


@settings(max_examples=5000, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons(max_vertices=40))
def test_five_thousand_polygons(polygon):
    assert check(polygon, polygon.wkt) > 0
