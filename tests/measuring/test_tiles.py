"""Runs on map tiles: each tile a view of its own, figures sums over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from harness.errors import UsageError
from harness.frame import ITS_OWN_VIEW, View, frame_of, view_of
from harness.measuring.lower_limits import fewest
from harness.measuring.plan import Plan
from harness.page.page_data import content_of
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference
from harness.stored.folder import read_arrays, read_run
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse, parse_all
from scenes import Scene, load
from tests.measuring.test_run import FAST, measure

TILES = "helsinki-tiles:zoom=16,tiles=3,layers=building"


def plan(**changes: object) -> Plan:
    names = parse_all(["ear-clipping", "delaunay"])
    known = Plan(TILES, triangulators=names, rasterisers=("reference",), timing=FAST)
    return replace(known, **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load(TILES)


def test_counters_are_sums_over_tiles_that_are_drawn_alone(scene, tmp_path):
    out = tmp_path / "out"
    (record, _) = measure(plan(), out).records
    assert (record["fit"], record["resolution"], record["status"]) == ("tile", 512, "ok")
    assert record["coverage_error"] == 0
    polygons = read_arrays(read_run(out), record["key"])
    alone = []
    for name, start, stop in zip(
        scene.tiling.names, scene.tiling.first, scene.tiling.first[1:], strict=False
    ):
        one = replace(
            scene,
            polygons=scene.polygons[start:stop],
            tiling=replace(scene.tiling, names=(name,), first=np.array([0, stop - start])),
        )
        frame = frame_of(one, view_of(one))
        parts = triangulate_polygons(parse(record["triangulator"]), frame.polygons).parts
        counted = Reference().count(frame, frame.join(parts), Options())
        assert counted["quads"].tolist() == polygons["quads"][start:stop].tolist()
        alone.append({each: int(counted[each].sum()) for each in counted})
    assert len(alone) == 3
    for name in ("fragments", "quads", "helper_lanes", "bbox_tests"):
        assert record["counters"][name] == sum(each[name] for each in alone)


def test_the_view_is_the_tiles_own_and_a_run_is_resumed(tmp_path):
    out = tmp_path / "out"
    first = measure(plan(), out)
    stored = Plan.from_json(read_run(out).facts["plan"])
    assert stored.views == (View(512, 0.0, "tile"),)
    again = measure(stored, out, resume=True)
    assert [each["key"] for each in again.records] == [each["key"] for each in first.records]
    with pytest.raises(UsageError, match="pixels= is the resolution of map tiles: leave"):
        measure(plan(views=(View(512),)), tmp_path / "other")
    with pytest.raises(UsageError, match="is of map tiles, which a page cannot cut"):
        content_of(read_run(out))


def test_fewest_quads_are_told_of_polygons_that_no_edge_cuts(scene):
    frame = frame_of(scene, view_of(scene))
    found = fewest(frame, None)
    tile = shapely.box(64, 64, 64 + 512, 64 + 512)
    inside = shapely.covers(tile, np.asarray(frame.polygons))
    assert 0 < inside.sum() < len(inside)
    assert (found[~inside] == -1).all()
    assert (found[inside] > 0).sum() > 0.9 * inside.sum()


@pytest.mark.parametrize("option", ["--resolution=512", "--resolution=1024", "--fit=box"])
def test_a_view_beside_pixels_is_refused(harness, option):
    code, _, told = harness("run", "--scene", TILES, option, "--quick")
    assert code == 2
    assert told.strip() == f"error: {ITS_OWN_VIEW.format('map tiles')}"


def test_a_tile_is_upright_and_of_even_pixels():
    for wrong in ((511, 0.0), (512, 30.0)):
        with pytest.raises(UsageError, match="a tile is drawn upright, and its side is an even"):
            View(*wrong, fit="tile")
