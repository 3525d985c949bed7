"""Runs on views of a model and on map tiles: separate views, and metrics as sums over views."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
import trimesh

from harness.errors import InputError, UsageError
from harness.frame import (
    FIXED_VIEW_MESSAGE,
    View,
    get_scene_view,
    is_model_with_views,
    make_scene_frame,
)
from harness.measuring.plan import Plan
from harness.measuring.tasks import compute_min_quads, compute_outline_bounds
from harness.metrics.groups import compare_views, describe_views, group_run
from harness.models.seen import read
from harness.page.page_data import make_page_content
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference, count_outline_quads, count_quads
from harness.rasterisers.vertex_batches import sum_batches_of_draws
from harness.results.run_folder import read_arrays, read_run
from harness.settings import MODEL_TRIANGULATORS
from harness.triangulating.carrying import make_original_triangulation
from harness.triangulating.recipes import parse, parse_all
from harness.triangulating.triangulate import triangulate_polygons
from scenes import Scene, load
from tests.conftest import assert_refused, require_ok
from tests.measuring.test_run import FAST, measure
from tests.models.various import make_solid
from tests.records import get_rows, make_group, make_record

TILES = "helsinki-tiles:zoom=16,tiles=3,layers=building"
CUTS = parse_all(["ear-clipping", "delaunay"])
OF_TILES = Plan(TILES, triangulators=CUTS, rasterisers=("reference",), timing=FAST)


@pytest.fixture
def model(tmp_path) -> str:
    make_solid().export(tmp_path / "plate.glb")
    return str(tmp_path / "plate.glb")


def plan(model: str, **changes: object) -> Plan:
    scene, names = f"{model}:views=4,pixels=128", parse_all(["delaunay", "optimal:edge-length"])
    default_plan = Plan(scene, triangulators=names, rasterisers=("reference",), timing=FAST)
    return replace(default_plan, **changes)  # type: ignore[arg-type]


def test_the_original_triangles_are_the_base_and_views_add_up(model, tmp_path):
    out = tmp_path / "out"
    records = {record["triangulator"]: record for record in get_rows(measure(plan(model), out))}
    assert list(records) == ["original", "delaunay", "optimal:edge-length"]
    stored = read_run(out)
    assert stored.facts["base"] == "original"
    base, best = records["original"], records["optimal:edge-length"]
    assert base["triangulate_s"] == 0.0 < best["triangulate_s"]
    for record in records.values():
        assert (record["fit"], record["resolution"], record["status"]) == ("view", 128, "ok")
        assert record["coverage_error"] == 0
        assert record["views"]["names"] == ["1 2 3", "1 -2 -3", "-1 2 -3", "-1 -2 3"]
        for name in ("fragments", "quads", "helper_lanes"):
            assert sum(record["views"][name]) == record["counters"][name]
        columns = read_arrays(stored, record["key"])
        assert columns["quads"].sum() == record["counters"]["quads"]
        assert record["outline_quads"] < record["counters"]["quads"]
        assert "least" not in record or record["least"]["polygons"] == 0
        assert "index" not in record
    assert best["proven"] == best["polygons"] == base["polygons"]
    typed = {record.name: record for record in stored.records}
    ratio = compare_views(typed["optimal:edge-length"], typed["original"], "helper_lanes")
    lanes = [record["counters"]["helper_lanes"] for record in (best, base)]
    assert ratio.ratio == pytest.approx(lanes[0] / lanes[1])
    assert 0.5 < ratio.ratio < 1.0
    (group,) = group_run(stored)
    lines = describe_views(group)
    expected = "helper lanes relative to original (4 views, too few for intervals): "
    assert lines[0].startswith(f"{expected}optimal:edge-length {ratio.text}, delaunay ")


def test_with_a_depth_test_the_outline_is_no_bound(model, tmp_path):
    with_depth = plan(model, scene=f"{model}:views=4,pixels=128,depth=front")
    records = get_rows(measure(with_depth, tmp_path / "out"))
    for record in records:
        assert record["outline_quads"] is None
        assert record["counters"]["depth_ties"] == 0
        assert sum(record["views"]["quads"]) == record["counters"]["quads"]
    lanes = {record["triangulator"]: record["counters"]["helper_lanes"] for record in records}
    assert lanes["optimal:edge-length"] < lanes["original"]


def test_loose_triangles_count_their_own_quads_as_outline(tmp_path):
    trimesh.creation.icosphere(1).export(tmp_path / "ball.glb")
    scene = read(str(tmp_path / "ball.glb"), views=3, pixels=64)
    frame = make_scene_frame(scene, get_scene_view(scene))
    parts = make_original_triangulation(frame).parts
    assert [piece in scene.viewing.other_triangles for piece in range(len(parts))] == [True] * 3
    assert np.array_equal(compute_outline_bounds(frame, parts), count_quads(frame, parts))
    assert (count_quads(frame, parts) > count_outline_quads(frame, parts)).all()


def test_faces_are_triangulated_once_for_all_views(model, tmp_path, monkeypatch):
    timed = []

    def in_rounds(recipes, polygons, rounds, seed):
        timed.append(len(polygons))
        return [[0.1] * rounds for _ in recipes]

    monkeypatch.setattr("harness.measuring.pool.time_in_rounds", in_rounds)
    slow = replace(FAST, budget_s=0.5)
    measure(plan(model, rasterisers=("binning",), timing=slow), tmp_path / "out")
    assert timed == [70]


def test_depth_ties_are_reported():
    views = {"names": ["a", "b"], "helper_lanes": [4, 5], "quads": [2, 3]}

    def last_line(**ties: int) -> str:
        counters = {"helper_lanes": 9, "quads": 5}
        records = [
            make_record(name, counters={**counters, "depth_ties": count}, views=views)
            for name, count in ties.items()
        ]
        return describe_views(make_group(records, base="original"))[-1]

    tied = "1,234 depth tests of original are ties: rounding decides them"
    assert last_line(original=1234, delaunay=1) == tied
    assert "ties" not in last_line(original=0, delaunay=1)


def test_a_view_of_another_kind_is_refused(model, tmp_path, harness):
    with pytest.raises(UsageError, match="unsupported for a model's views; set the resolution"):
        measure(plan(model, views=(View(512),)), tmp_path / "other")
    for scene, noun in ((f"{model}:views=4", "a model's views"), (TILES, "map tiles")):
        for option in ("--resolution=512", "--rotation=30", "--fit=box"):
            answer = harness("run", "--scene", scene, option, "--quick")
            assert_refused(answer, f"error: {FIXED_VIEW_MESSAGE.format(noun)}")


def test_original_requires_views(model, tmp_path):
    names = parse_all(["original", "delaunay"])
    with pytest.raises(UsageError, match="original: requires a model with views"):
        measure(plan(model, scene=model, triangulators=names), tmp_path / "out")


def test_unknown_view_options_are_reported_in_one_line(model, harness):
    for text, reason in (
        ("view=4", "no parameter 'view'; did you mean views?"),
        ("views=x", "parameter views='x' is not int"),
        ("views=0", "views=0: out of range (1 to 24)"),
        ("views=4,limit=3", "has no parameter 'limit'"),
    ):
        assert_refused(harness("run", "--scene", f"{model}:{text}", "--quick"), reason)
    answer = harness("inspect", f"{model}:views=4", "--sizes", "64-128", "--out", "a.png")
    assert_refused(answer, "unsupported for a model's views; set the resolution by pixels=")
    out, _ = require_ok(harness("inspect", f"{model}:views=4", "--out", "a.png"))
    assert "picture: a.png" in out


def test_models_have_default_triangulators(model, harness, tmp_path):
    options = ("--rasterisers", "reference", "--quick", "--budget", "0.01", "--out", "out")
    output, err = require_ok(harness("run", "--scene", f"{model}:views=4,pixels=64", *options))
    names = [record["triangulator"] for record in get_rows(read_run(tmp_path / "out"))]
    assert names == list(MODEL_TRIANGULATORS)
    assert "helper lanes relative to original (4 views, too few" in output
    assert "flat faces with a choice of diagonals, 100% of the area; 4 views" in err


@pytest.mark.parametrize(
    ("view", "base", "noun"),
    [
        (View(128, 0.0, "view"), "original", "a model's views"),
        (View(512, 0.0, "tile"), "ear-clipping", "map tiles"),
    ],
)
def test_runs_with_views_can_be_resumed_but_not_exported(model, tmp_path, view, base, noun):
    out = tmp_path / "out"
    first = measure(plan(model) if view.fit == "view" else OF_TILES, out)
    stored = Plan.from_json(read_run(out).facts["plan"])
    assert stored.views == (view,)
    assert str(stored.triangulators[0]) == base
    resumed = measure(stored, out, resume=True)
    assert [r["key"] for r in get_rows(resumed)] == [r["key"] for r in get_rows(first)]
    with pytest.raises(InputError, match=f"pages do not support {noun}"):
        make_page_content(read_run(out))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load(TILES)


def test_counters_are_sums_over_separately_drawn_tiles(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(Reference, "draws_indexed", True)
    out = tmp_path / "out"
    (record, _) = get_rows(measure(OF_TILES, out))
    assert (record["fit"], record["resolution"], record["status"]) == ("tile", 512, "ok")
    assert record["coverage_error"] == 0
    polygons = read_arrays(read_run(out), record["key"])
    tile_sums = []
    for name, (start, stop) in zip(scene.tiling.names, pairwise(scene.tiling.first), strict=True):
        tiling = replace(scene.tiling, names=(name,), first=np.array([0, stop - start]))
        one = replace(scene, polygons=scene.polygons[start:stop], tiling=tiling)
        frame = make_scene_frame(one, get_scene_view(one))
        parts = triangulate_polygons(parse(record["triangulator"]), frame.polygons).parts
        rows = frame.join_triangles(parts)
        counted = Reference().draw_and_count(frame, rows, Options())
        assert counted["quads"].tolist() == polygons["quads"][start:stop].tolist()
        tile_sums.append({name: int(counted[name].sum()) for name in counted})
        tile_sums[-1] |= sum_batches_of_draws(frame, rows)
    assert len(tile_sums) == 3
    for name in tile_sums[0]:
        assert record["counters"][name] == sum(sums[name] for sums in tile_sums)


def test_minimum_quads_exclude_polygons_cut_by_a_tiles_edge(scene):
    frame = make_scene_frame(scene, get_scene_view(scene))
    quads = compute_min_quads(frame, None)
    tile = shapely.box(64, 64, 64 + 512, 64 + 512)
    inside = shapely.covers(tile, np.asarray(frame.polygons))
    assert 0 < inside.sum() < len(inside)
    assert (quads[~inside] == -1).all()
    assert (quads[inside] > 0).sum() > 0.9 * inside.sum()


def test_a_tile_is_upright_and_of_even_pixels():
    problem = "fit tile: requires rotation 0 and an even resolution"
    for wrong in ((511, 0.0), (512, 30.0)):
        with pytest.raises(UsageError, match=problem):
            View(*wrong, fit="tile")


def test_view_options_name_the_views_of_a_model():
    names = ("part.glb", "part.glb:views=24", "part.glb:pixel=512", "town.pmtiles:zoom=14")
    assert [is_model_with_views(name) for name in names] == [False, True, True, False]
