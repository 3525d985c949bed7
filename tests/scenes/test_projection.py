import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.projection import is_geographic, mean_direction, to_degrees, to_metres


@given(lon=st.floats(-180, 180), lat=st.floats(-80, 80))
def test_lengths_near_the_centre_are_those_of_the_ellipsoid(lon, lat):
    step = 1e-3
    points = np.array([[lon, lat], [lon + step, lat], [lon, lat + step]])
    at, east, north = to_metres(points, (lon, lat))
    phi = np.radians(lat)
    w = 1 - 0.00669437999014 * np.sin(phi) ** 2
    metres_east = np.radians(step) * 6378137 / np.sqrt(w) * np.cos(phi)
    metres_north = np.radians(step) * 6378137 * (1 - 0.00669437999014) / w**1.5
    assert np.hypot(*(east - at)) == pytest.approx(metres_east, rel=4e-3)
    assert np.hypot(*(north - at)) == pytest.approx(metres_north, rel=4e-3)
    # what is lost in one direction is won in the other: areas are right
    area = (east - at)[0] * (north - at)[1] - (east - at)[1] * (north - at)[0]
    assert area == pytest.approx(metres_east * metres_north, rel=1e-4)


def test_orientation_is_north_up():
    east, north = to_metres(np.array([[25.1, 60.0], [25.0, 60.1]]), (25.0, 60.0))
    assert east[0] > 0
    assert abs(east[1]) < 10
    assert north[1] > 0
    assert abs(north[0]) < 10


def test_across_the_date_line():
    points = np.array([[179.9, -17.0], [-179.9, -17.0]])
    lon, lat = mean_direction(points)
    assert abs(lon) == pytest.approx(180)
    assert lat == pytest.approx(-17, abs=1e-3)
    assert np.ptp(to_metres(points)[:, 0]) < 25_000


@given(st.lists(st.tuples(st.floats(-180, 180), st.floats(-90, 90)), min_size=1, max_size=9))
def test_whole_globe_stays_finite(points):
    assert np.isfinite(to_metres(np.array(points))).all()


@pytest.mark.parametrize(
    ("crs", "expected"),
    [
        ("EPSG:4326", True),
        ("OGC:CRS84", True),
        ('GEOGCS["x"', True),
        ("EPSG:3067", False),
        ("EPSG:32635", False),
        ('PROJCS["x"', False),
        (None, False),
    ],
)
def test_geographic_systems(crs, expected):
    assert is_geographic(crs, np.array([[25.0, 60.0]])) is expected


def test_coordinates_off_the_globe_are_planar():
    assert not is_geographic("EPSG:4326", np.array([[386_000.0, 6_672_000.0]]))


@given(
    centre=st.tuples(st.floats(-180, 180), st.floats(-85, 85)),
    offsets=st.lists(st.tuples(st.floats(-8, 8), st.floats(-4, 4)), min_size=1, max_size=6),
)
def test_there_and_back_again(centre, offsets):
    degrees = np.array(offsets) + centre
    back = to_degrees(to_metres(degrees, centre), centre)
    error = back - degrees
    error[:, 0] = (error[:, 0] + 180) % 360 - 180
    assert np.abs(error).max() < 1e-10
