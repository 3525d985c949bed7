"""Census: counters of the reference, gains per footprint, sums over parts, output files."""

import csv

import numpy as np
import pandas as pd
import pytest
import shapely

from harness.grid import SUBPIXEL, to_grid
from harness.progress import Reporter
from harness.rasterisers.reference import count_per_triangle
from harness.scaling.census import Census, make_gain_rows
from harness.scaling.counts import GAINED, CensusCounts, compute_gains, scale_to_pixels
from harness.scaling.dataset import Dataset
from harness.scaling.executors import Executor
from tests.conftest import IN_METRES, assert_refused, make_geojson, require_ok
from tests.scaling.conftest import EVERY
from tests.scenes.test_files import write
from triangulators import triangulate

NAMES = ("ear-clipping", "optimal:half-perimeter", "optimal:overdraw")
COUNTED = ("quads", "helper_lanes", "partial_quads")
WORK = Census(NAMES, units_per_pixel=0.25, cell=100.0)


def count_all(pattern, out):
    dataset = Dataset(str(pattern), out, WORK)
    summary = dataset.complete(Executor(), Reporter(quiet=True))
    return summary, CensusCounts.read(out / f"{key}.npz" for key in dataset.keys_done)


def snap(xy):
    return np.rint((xy + 4000.0) * 4 * SUBPIXEL) / SUBPIXEL


def count_footprints(footprints, name):
    """Return the counters `COUNTED` (p, 3) of footprints drawn at their position on the map.

    The map is moved by 4 km, a multiple of 4 px, since a viewport has no negative pixels.
    """
    rows = []
    for footprint in footprints:
        rounded = shapely.transform(footprint, snap)
        counts = count_per_triangle(to_grid([rounded]).coords, triangulate(rounded, name))
        rows.append([counts[measure].sum() for measure in COUNTED])
    return np.array(rows)


def test_counters_equal_those_of_footprints_on_the_map(parts, tmp_path, footprints):
    summary, counted = count_all(parts, tmp_path / "out")
    sums = counted.sum_groups()
    assert sums.get_count("polygons") == summary.polygons == EVERY
    for measure in ("fragments", "triangles"):  # every triangulation has the same
        assert len(set(sums.get_total(measure))) == 1
    table = make_gain_rows(sums, NAMES).set_index(["triangulator", "measure"])
    base = count_footprints(footprints, NAMES[0])
    for number, name in enumerate(NAMES):
        expected = count_footprints(footprints, name)
        for column, measure in enumerate(COUNTED):
            assert sums.get_total(measure)[number] == expected[:, column].sum()
            gained = compute_gains(base[:, column].astype(float), expected[:, column].astype(float))
            assert sums.bins[number, GAINED.index(measure)].sum() == EVERY
            row = table.loc[name, measure]
            assert row["total"] == expected[:, column].sum()
            assert row["total_of_base"] == sums.get_total(measure)[0]
            for share in (0.01, 0.1, 0.3):
                reached = gained >= share - 1e-12  # one of ten less is 0.1, which 1 - 0.9 is not
                assert row[f"share_gaining_{share:.0%}"] == pytest.approx(reached.mean())
            assert row["share_losing_1%"] == pytest.approx((gained < -0.01).mean())
            assert abs(row["gain_p50"] - np.median(gained)) <= 0.01


def test_parts_and_cells_sum_to_the_total(parts, tmp_path):
    _, total = count_all(parts, tmp_path / "both")
    _, first = count_all(parts / "0.parquet", tmp_path / "first")
    _, second = count_all(parts / "1.parquet", tmp_path / "second")
    for group, sums in second.groups.items():
        first.add(group, sums)
    for name, values in total.sum_groups()._asdict().items():
        assert getattr(first.sum_groups(), name) == pytest.approx(values), name
    (cells,) = total.cells
    halves = pd.concat([*first.cells, *second.cells]).groupby(["x", "y"], as_index=False).sum()
    pd.testing.assert_frame_equal(cells, halves)
    lanes = total.sum_groups().get_total("helper_lanes")
    assert cells.iloc[:, 2:].sum().tolist() == [EVERY, *lanes]
    assert not cells.duplicated(["x", "y"]).any()


def test_footprints_without_area_on_the_grid_are_dropped():
    thin = shapely.Polygon([(0, 0), (10, 0), (10, 1e-7)])
    bow = shapely.Polygon([(0, 0), (3, 0), (3, 3), (1.5, 1e-7)])
    pieces, owners = scale_to_pixels(np.array([thin, shapely.box(0, 0, 1, 1), bow]), 1.0)
    assert set(owners.tolist()) == {1, 2}
    assert shapely.is_valid(pieces).all()


@pytest.mark.parametrize("count", [1, 2])
def test_footprints_beyond_32_bits_are_dropped(harness, tmp_path, no_plots, count):
    """In steps of 1/256 px, coordinates up to 2^31 are counted, and larger ones would wrap."""
    wide = [[0, 0], [3e6, 0], [3e6, 1], [1, 1], [0, 0]]
    shapes = [{"type": "Polygon", "coordinates": [ring]} for ring in (wide, SQUARE)[:count]]
    (tmp_path / "a.geojson").write_text(make_geojson(shapes, crs=IN_METRES))
    code, _, error = harness("census", "a.geojson", "-o", "out", "--triangulators", "fan,strip")
    assert code == (0 if count == 2 else 4)
    assert "dropped 1: wider or higher than 8,000,000 px (feature 0)" in error


def test_default_cell_is_in_the_units_of_the_layer(harness, tmp_path, no_plots):
    """Also with two names of a triangulator, which are counted once."""
    metres, degrees = shapely.box(2500, 0, 2600, 50), shapely.box(25.001, 60, 25.002, 60.001)
    write(tmp_path / "two.gpkg", [metres], "metres")
    write(tmp_path / "two.gpkg", [degrees], "degrees", crs="EPSG:4326", append=True)
    for layer, x in (("metres", 2000.0), ("degrees", 25.0)):
        names = ("--triangulators", "earcut,ear-clipping,delaunay", "-o", layer)
        require_ok(harness("census", "two.gpkg", "--layer", layer, *names))
        with (tmp_path / layer / "cells.csv").open() as file:
            (row,) = csv.DictReader(file)
        assert float(row["x"]) == x


def test_gains_are_relative_to_the_base():
    values = compute_gains(np.array([4.0, 4.0, 0.0, 0.0]), np.array([3.0, 5.0, 0.0, 2.0]))
    assert values.tolist() == [0.25, -0.25, 0.0, -np.inf]


def test_the_command_writes_a_table_cells_and_pictures(harness, parts, tmp_path):
    asked = ("--triangulators", ",".join(NAMES), "--cell", "100")
    out, _ = require_ok(harness("census", f"{parts}/*.parquet", "-o", "out", *asked))
    assert "240 footprints: helper lanes, compared with ear-clipping" in out
    with (tmp_path / "out" / "census.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(NAMES) * len(GAINED)
    best = {row["measure"]: row for row in table if row["triangulator"] == NAMES[1]}
    assert float(best["half_perimeter"]["share_losing_1%"]) == 0.0
    assert 0 < float(best["helper_lanes"]["gain_of_total"]) < 1
    with (tmp_path / "out" / "cells.csv").open() as file:
        assert sum(int(row["footprints"]) for row in csv.DictReader(file)) == EVERY
    for name in ("gains", "map"):
        for suffix in ("png", "svg"):
            assert (tmp_path / "out" / "plots" / f"{name}.{suffix}").stat().st_size > 5000
    result = harness("census", f"{parts}", "-o", "other", "--triangulators", "fan")
    assert_refused(result, "give two or more")


def test_census_needs_a_footprint_of_all_triangulators(harness, parts, no_plots):
    names = "fan,tests.broken:raise_error"
    code, _, error = harness("census", f"{parts}", "-o", "out", "--triangulators", names)
    assert code == 4
    assert "error: out: no footprint was completed by all triangulators" in error


SQUARE = [[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]]
POINT = {"type": "Point", "coordinates": [5, 5]}


def test_skipped_footprints_are_listed_with_reasons(harness, tmp_path, no_plots):
    bent = [[0, 0], [9, 0], [9, 3], [3, 3], [3, 9], [9, 9], [9, 12], [0, 12], [0, 0]]
    shapes = [{"type": "Polygon", "coordinates": [ring]} for ring in (SQUARE, bent)]
    (tmp_path / "a.geojson").write_text(make_geojson([shapes[0], POINT, shapes[1]]))
    command = ("census", "a.geojson", "--triangulators", "fan,strip", "-o", "out")
    _, error = require_ok(harness(*command))
    assert "dropped 1: is a Point, not a polygon (feature 1)" in error
    assert "failed 1: fan: no vertex sees the whole polygon (feature 2)" in error
    with (tmp_path / "out" / "parts" / "left_out.csv").open() as file:
        rows = [tuple(row.values()) for row in csv.DictReader(file)]
    assert rows[:2] == [
        ("a.geojson", "dropped", "feature 1", "is a Point, not a polygon"),
        ("a.geojson", "failed", "feature 2", "fan: no vertex sees the whole polygon"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (make_geojson([POINT, POINT]), "a.geojson holds no usable polygon"),
        (make_geojson([POINT])[:60], "a.geojson cannot be read as a file of geometries"),
        (make_geojson([]), "a.geojson holds no usable polygon"),
        (make_geojson([{"type": "Polygon", "coordinates": [SQUARE]}]), "for --where id > 7: widen"),
    ],
    ids=["points", "cut", "empty", "filtered"],
)
def test_a_file_without_a_polygon_is_bad_input(harness, tmp_path, no_plots, text, message):
    (tmp_path / "a.geojson").write_text(text)
    options = ["--where", "id > 7"] if "widen" in message else []
    assert_refused(harness("census", "a.geojson", "-o", "out", *options), message)
