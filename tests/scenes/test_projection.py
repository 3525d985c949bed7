import json
from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from scenes import load
from scenes.files import read_chunks
from scenes.projection import Projection, is_geographic
from tests.conftest import make_geojson
from tests.scenes.conftest import assert_valid_polygons, require_error, write_file

LATITUDES = st.floats(-80, 80).filter(lambda lat: lat == 0 or abs(lat) > 1e-8)
"""Closer to the equator, PROJ moves the centre to the equator, by up to 0.6 mm."""

FEW_EXAMPLES = settings(max_examples=30)  # PROJ takes a while to make each projection
GLOBE = pyproj.Geod(ellps="WGS84")
FINLAND = box(25, 60, 25.01, 60.01)


def write_geojson(folder: Path, *shapes, **collection) -> Path:
    return write_file(folder / "a.geojson", make_geojson(shapes, **collection))


def name_crs(name: str) -> dict:
    return {"type": "name", "properties": {"name": name}}


def area_on_globe(polygon) -> float:
    """Return the area within geodesics, in m2, for polygons with short edges."""
    return abs(GLOBE.geometry_area_perimeter(polygon)[0])


@FEW_EXAMPLES
@given(lon=st.floats(-180, 180), lat=LATITUDES)
def test_lengths_at_the_centre_are_lengths_on_the_ellipsoid(lon, lat):
    step = 1e-3
    points = np.array([[lon, lat], [lon + step, lat], [lon, lat + step]])
    centre, east, north = Projection("EPSG:4326", (lon, lat)).forward(points)
    assert np.abs(centre).max() < 1e-6
    for point, (to_lon, to_lat) in ((east, points[1]), (north, points[2])):
        length = GLOBE.inv(lon, lat, to_lon, to_lat)[2]
        assert np.hypot(*(point - centre)) == pytest.approx(length, rel=1e-5)
    assert east[0] > 0
    assert north[1] > 0


@FEW_EXAMPLES
@given(
    st.sampled_from(["EPSG:4326", "EPSG:7844", "EPSG:4979"]),
    st.tuples(st.floats(-180, 180), st.floats(-85, 85)),
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-4, 4)), min_size=1, max_size=6),
)
def test_inverse_restores_coordinates(crs, centre, offsets):
    coordinates = np.array(offsets) + centre
    for projection in (Projection(crs, centre), Projection(crs, None)):
        error = projection.inverse(projection.forward(coordinates)) - coordinates
        error[:, 0] -= np.round(error[:, 0] / 360) * 360
        assert np.abs(error).max() < 1e-10


@FEW_EXAMPLES
@given(st.lists(st.tuples(st.floats(-180, 180), st.floats(-90, 90)), min_size=1, max_size=9))
def test_forward_is_finite_on_the_globe(points):
    projection = Projection.fit("EPSG:4326", shapely.points(points))
    assert np.isfinite(projection.forward(np.array(points))).all()


@pytest.mark.parametrize(
    ("crs", "expected"),
    [
        *((crs, True) for crs in ("EPSG:4326", "OGC:CRS84", "EPSG:4326+5773")),
        ("EPSG:7844", True),  # GDA 2020
        ("EPSG:6318", True),  # NAD 83 (2011)
        ("EPSG:4979", True),  # WGS 84 with heights
        (pyproj.CRS("EPSG:4258").to_wkt(), True),
        (pyproj.CRS("EPSG:4258").to_json(), True),
        ("EPSG:4807", False),  # in grads, from Paris
        ("EPSG:4037", False),  # projected, among the numbers of geographic ones
        ("EPSG:4978", False),  # geocentric
        (pyproj.CRS("EPSG:32635").to_wkt(), False),
        *((crs, False) for crs in ("EPSG:3067", "EPSG:4899999", "GEOGCS", "no such system")),
        *(("", False), (None, False)),
    ],
)
def test_geographic_systems(crs, expected):
    assert is_geographic(crs) is expected


def test_coordinates_in_grads_are_not_projected(tmp_path):
    path = tmp_path / "paris.gpkg"
    square = shapely.to_wkb([box(0, 54, 0.01, 54.01)])
    pyogrio.raw.write(path, square, [], [], geometry_type="Polygon", crs="EPSG:4807")
    scene = load(path)
    assert scene.units == "units"
    assert "are not degrees as in NTF (Paris); used unchanged" in scene.notes[0]
    require_error("are not longitude and latitude in degrees", path, project=True)


def test_coordinates_are_planar_if_most_features_are_off_the_globe(tmp_path):
    town = [box(x, 6_672_000, x + 10, 6_672_010) for x in (386_000, 386_020)]
    scene = load(write_geojson(tmp_path, *town, FINLAND))
    assert scene.units == "units"
    assert scene.polygons[0].bounds == (386_000, 6_672_000, 386_010, 6_672_010)
    assert "are not degrees as in WGS 84; used unchanged" in scene.notes[0]
    assert scene.dropped == []


@pytest.mark.parametrize("bad", [[25, 91], [25, -90.1], [361, 60], [-7e5, 60]])
def test_feature_with_a_vertex_off_the_globe_is_named_and_dropped(tmp_path, bad):
    """A single invalid vertex must not turn the town into planar coordinates."""
    spoilt = shapely.Polygon([(25, 60), (25.01, 60), bad, (25, 60.01)])
    path = write_geojson(tmp_path, FINLAND, spoilt, box(25.1, 60, 25.11, 60.01))
    scene = load(path)
    assert scene.units == "m"
    ((name, reason),) = scene.dropped
    assert name == "feature 1"
    assert reason.startswith("has a vertex off the globe, beyond 90 degrees of latitude or 360")
    alone = load(write_geojson(tmp_path, FINLAND)).polygons[0]
    assert scene.polygons[0].area == pytest.approx(alone.area, rel=1e-6)


def test_feature_off_the_globe_in_a_later_chunk_is_dropped(tmp_path):
    path = write_geojson(tmp_path, FINLAND, FINLAND, box(0, 0, 999, 10))
    chunks = list(read_chunks(str(path), size=1))
    assert [len(chunk.cleaned.polygons) for chunk in chunks] == [1, 1, 0]
    assert [name for name, _ in chunks[2].cleaned.dropped] == ["feature 2"]


@pytest.mark.parametrize("crs", ["EPSG:7844", "EPSG:6318", "urn:ogc:def:crs:OGC:1.3:CRS84"])
def test_geographic_systems_are_projected_to_metres(tmp_path, crs):
    scene = load(write_geojson(tmp_path, FINLAND, crs=name_crs(crs)))
    assert scene.units == "m"
    assert scene.polygons[0].area == pytest.approx(area_on_globe(FINLAND), rel=1e-6)
    assert "projected to metres, Lambert azimuthal equal-area about 25.01, 60" in scene.notes[0]


@pytest.mark.parametrize(
    ("crs", "note"),
    [
        (name_crs("EPSG:999999"), "the reference system EPSG:999999 is unknown"),
        (name_crs("of our town"), "the reference system of our town is unknown"),
        ({"type": "link", "properties": {"href": "x.prj"}}, "system x.prj is unknown"),
        (None, None),
    ],
)
@pytest.mark.parametrize("last", [False, True])
def test_unknown_system_is_not_longitude_and_latitude(tmp_path, crs, note, last):
    """GDAL takes GeoJSON of an unknown system for WGS 84."""
    path = write_geojson(tmp_path, FINLAND, **({} if last else {"crs": crs}))
    if last:
        path.write_text(path.read_text()[:-1] + f', "crs": {json.dumps(crs)}}}')
    scene = load(path)
    assert scene.units == "units"
    assert scene.polygons[0].bounds == (25, 60, 25.01, 60.01)
    assert [note in line for line in scene.notes] == [True] if note else scene.notes == ()


def test_project_overrides_the_file(tmp_path):
    unprojected = load(write_geojson(tmp_path, FINLAND), project=False)
    assert unprojected.units == "degree"
    assert unprojected.polygons[0].bounds == (25, 60, 25.01, 60.01)
    path = write_file(tmp_path / "a.wkt", FINLAND.wkt)
    assert load(path).units == "units"
    forced = load(path, project=True)
    assert forced.units == "m"
    assert forced.polygons[0].area == pytest.approx(area_on_globe(FINLAND), rel=1e-6)
    assert "taken as WGS 84" in forced.notes[0]
    path_in_metres = write_geojson(tmp_path, FINLAND, crs=name_crs("EPSG:3067"))
    require_error("is in ETRS89 / TM35FIN", path_in_metres, project=True)
    write_file(path, box(0, 0, 1000, 1000).wkt)
    require_error("not longitude and latitude", path, project=True)


PARALLEL = [(lon, -70) for lon in range(-180, 181, 10)]
ANTARCTICA = shapely.Polygon([*PARALLEL, (180, -90), (-180, -90)])
"""As in world maps: around the pole, and back along the map's lower edge."""


def area_from_equator(lat: float) -> float:
    """Return the area between the equator and a parallel, in m2; negative in the south."""
    lon = np.linspace(-180, 180, 100_001)
    half, cap = (GLOBE.polygon_area_perimeter(lon, 0 * lon + beyond)[0] for beyond in (0, lat))
    return np.sign(lat) * (abs(half) - abs(cap))


DISC = (area_from_equator(90) - area_from_equator(70)) * np.sinc(1 / 18)
"""Area of the cap beyond 70 degrees within 36 chords, in m2."""


def test_ring_around_the_pole_is_a_disc(tmp_path):
    scene = load(write_geojson(tmp_path, ANTARCTICA))
    assert_valid_polygons(scene.polygons)
    (polygon,) = scene.polygons
    assert polygon.area == pytest.approx(DISC, rel=1e-6)
    assert len(polygon.exterior.coords) == 37
    west, south, east, north = polygon.bounds
    assert (east - west) == pytest.approx(north - south, rel=0.02)
    assert "-180.0 -70.0" in scene.repaired[0][1] or "-90.0" in scene.repaired[0][1]


def test_ring_around_the_pole_without_a_seam_is_the_same_disc(tmp_path):
    scene = load(write_geojson(tmp_path, shapely.Polygon(PARALLEL[:-1])))
    assert scene.repaired == scene.dropped == []
    assert scene.polygons[0].area == pytest.approx(DISC, rel=1e-6)


@pytest.mark.parametrize(
    "bounds",
    [(-180, -90, 180, -60), (-180, -85, 180, -60), (-180, 30, 180, 90), (-180, -90, 180, 90)],
)
def test_box_from_180_to_180_has_the_area_on_the_globe(tmp_path, bounds):
    """East and west corners coincide: on most maps the box would have no area."""
    scene = load(write_geojson(tmp_path, box(*bounds)))
    assert_valid_polygons(scene.polygons)
    south, north = (area_from_equator(lat) for lat in bounds[1::2])
    assert scene.polygons[0].area == pytest.approx(north - south, rel=1e-6)
    assert "Lambert cylindrical equal-area" in scene.notes[0]


def test_features_across_the_180th_meridian_are_named(tmp_path):
    fiji, finland = box(177, -20, -178, -15), FINLAND
    far = [box(lon, 0, lon + 1, 1) for lon in (-120, 0, 120)]
    scene = load(write_geojson(tmp_path, fiji, finland, *far))
    assert_valid_polygons(scene.polygons)
    assert "cylindrical" in scene.notes[0]
    reason = "crosses the 180th meridian, where a map of the globe ends: split it"
    assert scene.dropped == [("feature 0", reason)]
    assert len(scene.polygons) == 4
    assert scene.polygons[0].area == pytest.approx(area_on_globe(finland), rel=1e-6)


def test_a_shape_across_the_date_line_alone(tmp_path):
    fiji = box(177, -20, -178, -15)
    (polygon,) = load(write_geojson(tmp_path, fiji)).polygons
    assert polygon.area == pytest.approx(area_on_globe(fiji), rel=0.01)
    assert np.ptp(shapely.get_coordinates(polygon), axis=0).max() < 600_000


def test_repairs_are_located_in_source_coordinates(tmp_path):
    bow_tie = shapely.Polygon([(25, 60), (25.006, 60.008), (25.006, 60), (25, 60.008)])
    scene = load(write_geojson(tmp_path, bow_tie))
    ((_, reason),) = scene.repaired
    x, y = map(float, reason.split(" at ")[1].split(";")[0].split())
    assert (x, y) == pytest.approx((25.003, 60.004), abs=1e-6)


@pytest.mark.parametrize(("x", "hinted"), [(24.9, True), (386_000.0, False)])
def test_a_shapefile_without_a_reference_system_may_be_in_degrees(tmp_path, x, hinted):
    square = [box(x, 60.1, x + 0.001, 60.101)]
    path = tmp_path / "a.shp"
    pyogrio.raw.write(path, shapely.to_wkb(square), [], [], geometry_type="Polygon", crs=None)
    (note,) = load(path).notes
    assert note.startswith("no reference system; coordinates used unchanged")
    assert ("if they are longitude and latitude, add project=true" in note) == hinted
    if hinted:
        assert load(f"{path}:project=true").units == "m"
