"""`inspect --sizes`: counts equal those of a run, and the sentence follows from them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon, box

from harness import viewport_sizes as sizes
from harness.frame import View, make_scene_frame
from harness.profile.cost_terms import TERMS, count_cost_terms
from harness.profile.device_costs import DeviceCosts
from harness.profile.law import VERTICES
from harness.rasterisers.reference import SHADED
from harness.results.run_folder import read_run
from harness.triangulating.recipes import parse_all
from scenes import load
from tests.conftest import assert_refused, require_ok, write_geojson
from tests.records import get_rows

NAMES = ("ear-clipping", "flips:l1", "optimal:half-perimeter")


@pytest.mark.usefixtures("no_plots", "in_process")
def test_counts_equal_those_of_runs(harness):
    options = ("--triangulators", ",".join(NAMES), "--rasterisers", "reference", "--quick")
    scene = "city:buildings=40"
    run = ("run", "--scene", scene, "--resolution", "32,64,128,256,512", *options, "-q")
    require_ok(harness(*run, "--budget", "0.01", "--out", "run"))
    inspect = ("inspect", scene, "--sizes", "32-512", "--triangulator", ",".join(NAMES))
    out, _ = require_ok(harness(*inspect, "--json"))
    document = json.loads(out)
    by_size = {size["resolution"]: size["costs"] for size in document["sizes"]}
    assert list(by_size) == [32, 64, 128, 256, 512]
    records = get_rows(read_run(Path("run")))
    assert len(records) == 15
    lanes = {}
    for record in records:
        costs = by_size[record["resolution"]][record["triangulator"]]
        for name in SHADED:
            assert costs[name] == record["counters"][name], (record["resolution"], name)
        lanes[record["resolution"], record["triangulator"]] = 4 * record["counters"]["quads"]
    savings = ((1 - lanes[size, name] / lanes[size, NAMES[0]], size, name) for size, name in lanes)
    saved, size, best = max(savings)
    assert saved > sizes.MIN_SAVED_SHARE
    assert f"at {size} px" in document["sentence"]
    assert f"{best} saves {saved:.1%} of ear-clipping's shaded lanes" in document["sentence"]


def test_laws_convert_counters_to_seconds():
    frame = make_scene_frame(load("city:buildings=12"), View(128))
    result = sizes.triangulate_polygons(parse_all(["ear-clipping"])[0], frame.polygons)
    triangles = frame.join_triangles(result.parts)
    counts = count_cost_terms(frame, triangles)
    counters = [counts | {f"{name}_walk": counts[name] // 2 for name in VERTICES}]

    def list_cost(form: str, **costs: float) -> sizes.Cost:
        seconds = np.array([costs.get(name, 0.0) for name in TERMS])
        return sizes._list_costs(counters, [0.0], DeviceCosts("scripted", seconds, form))[0]

    for name, number in (("triangles", len(triangles)), ("draw", 1)):
        cost = list_cost("sum", **{name: 2e-9})
        assert cost["draw"] == pytest.approx(2e-9 * number)
    cost = list_cost("sum", helper_lanes=1e-9)
    assert cost["draw"] == pytest.approx(1e-9 * cost["helper_lanes"])
    seconds = {"transformed_vertices": 6e-9, "covering_triangles": 9e-9, "fragments": 1e-10}
    stages = {name.removesuffix("_triangles"): cost for name, cost in seconds.items()}
    cost = list_cost("maximum of three stages", **stages)
    times = [seconds[name] * cost[name] for name in seconds]
    assert cost["draw"] == pytest.approx(max(times))
    assert cost["stage"] == ("vertices", "triangles", "pixels")[int(np.argmax(times))]
    assert cost["draw_walk"] == pytest.approx(max(times[0] / 2, *times[1:]))


def test_stages_say_what_shortens_a_draw():
    device = DeviceCosts("GPU", np.zeros(0), "maximum of three stages")

    def size(px: int, stage: str, draws: dict[str, float]) -> sizes.Size:
        facts = {"draw_walk": 0.94 * draws["a"], "stage": stage}
        costs = {name: {"draw": draw, **facts} for name, draw in draws.items()}
        return sizes.Size(px, 1, 0, px / 2, costs)

    counted = (
        size(256, "vertices", {"a": 1.0, "b": 1.3}),
        size(1024, "triangles", {"a": 1.0, "b": 0.75}),
        size(4096, "pixels", {"a": 1.0, "b": 1.1}),
    )
    assert list(sizes.list_stages(sizes.Sizes("s", device, counted))) == [
        "At 256 px a is bound by vertices: the order of triangles decides; use --order walk, which "
        "saves 6.0%.",
        "At 1024 px a is bound by triangles: fewer covering triangles; use b, the cheapest "
        "triangulator with most of the saving: 25.0%.",
        "At 4096 px a is bound by pixels: fewer quads; keep a.",
    ]
    of_a_sum = sizes.Sizes("s", DeviceCosts("CPU", np.zeros(0)), counted)
    assert list(sizes.list_stages(of_a_sum)) == []


def test_the_sentence_has_the_range_of_sizes_that_matter():
    """Sizes with savings of 0, 5, 20 and 0.5 %, and two triangulators with equal savings."""

    def cost(lanes: int, draw: float | None = None, cut: float = 0.0) -> sizes.Cost:
        counted = (sizes.MIN_PIXELS, lanes // 4, 1, 1, 1, 1, 3)
        counters = dict(zip(sizes.COST_TERMS, counted, strict=True))
        return {**counters, "triangulate_s": cut, "draw": draw}

    def size(px: int, lanes: int) -> sizes.Size:
        costs = {"a": cost(4000), "b": cost(lanes), "c": cost(lanes + 8)}
        return sizes.Size(px, 1, 0, px / 2, costs)

    shares = {16: 4000, 32: 3800, 64: 3200, 128: 3980}
    result = sizes.Sizes("s", None, tuple(size(*numbers) for numbers in shares.items()))
    assert sizes.summarise(result) == (
        "The triangulator matters at 32 to 64 px, most at 64 px (32 px per polygon): b saves 20.0% "
        "of a's shaded lanes."
    )
    more = sizes.Sizes("s", None, (*result.sizes, size(256, 3800)))
    assert sizes.summarise(more).startswith(
        "The triangulator matters at 32, 64, 256 px, most at 64"
    )
    few = size(8, 2000)
    for costs in few.costs.values():
        costs["fragments"] = sizes.MIN_PIXELS - 1
    same = sizes.Sizes("s", None, (few, size(16, 4000), size(32, 3980)))
    assert "does not matter: at 16 to 32 px none saves 1%" in sizes.summarise(same)
    assert (result.recommended_triangulator, result.size_of_largest_saving.resolution) == ("b", 64)
    for entry in result.sizes:  # c saves nearly as much, and b takes longer
        entry.costs["b"]["triangulate_s"] = 1.0
    assert "Next: use c, the cheapest triangulator with most" in sizes.format_next_step(result)
    assert "triangulate FILE -o OUT.glb --triangulator c" in sizes.format_next_step(result)
    timed = {"a": cost(4000, 4e-3, 1e-3), "b": cost(4000, 3e-3, 6.5e-3)}
    phone = DeviceCosts("phone", np.zeros(0))
    result = sizes.Sizes("s", phone, (sizes.Size(64, 1, 0, 32.0, timed),))
    assert sizes.summarise(result) == (
        "The triangulator matters at 64 px, most at 64 px (32 px per polygon): b saves 25.0% of "
        "a's draw time on phone; break-even after 6 draws."
    )


def test_a_polygon_that_the_grid_cuts_into_pieces_counts_once(harness, monkeypatch):
    neck = Polygon([(3, 2), (7, 2.3), (7, 2.3001), (3, 2.0001)])
    cut = box(0, 0, 4, 4).union(neck).union(box(6, 0, 10, 4))
    write_geojson(Path("cut.geojson"), [cut, box(20, 0, 20.00001, 9)])
    command = ("inspect", "cut.geojson", "--triangulator", "ear-clipping,flips:l1")
    document = json.loads(require_ok(harness(*command, "--sizes", "64", "--json"))[0])
    assert document["sizes"][0]["polygons"] == document["sizes"][0]["skipped"] == 1
    drawn = []
    monkeypatch.setattr(
        "harness.heatmaps.draw_heatmaps", lambda _, parts: drawn.extend(parts.values()) or b""
    )
    require_ok(harness(*command))
    assert [len(np.unique(triangles)) for triangles in drawn] == [10, 10]


def test_contributed_profiles_are_found_by_name(harness):
    write_geojson(Path("l.geojson"), [box(0, 0, 8, 8) - box(4, 4, 9, 9)])
    command = ("inspect", "l.geojson", "--sizes", "64")
    out, _ = require_ok(harness(*command, "--profile", "opengl-llvmpipe"))
    assert "ms of a draw on llvmpipe" in out
    interval = r"\(95 % CI -?\d+\.\d to \d+\.\d%\) of ear-clipping's draw time on llvmpipe"
    assert re.search(interval, " ".join(out.split()))
    assert not list(Path().glob("l-sizes*"))  # charts are only written to --out
    answer = harness(*command, "--profile", "opengl-lvmpipe")
    assert_refused(answer, "--profile opengl-lvmpipe", "did you mean 'opengl-llvmpipe'?")
    Path("none.json").write_text('{"terms": [], "device": {"name": "x"}}')
    assert_refused(harness(*command, "--profile", "none.json"), "none.json is not a profile")
    Path("none.json").write_text('{"unit": "cycles"}')
    assert_refused(harness(*command, "--profile", "none.json"), "unsupported unit 'cycles'")


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        *(("--sizes 64-16", ["--sizes", "exceeds"]), ("--sizes 1-16", ["--sizes", "8 to 16384"])),
        ("--sizes 16-64 --resolution 64", ["--resolution", "--sizes"]),
        *(("--profile x.json", ["--profile", "--sizes"]), ("--json", ["--json", "--sizes"])),
        ("--sizes 16 --every paper", ["--every", "--sizes"]),
        ("--sizes 16 --triangulator fan", ["fan", "two or more"]),
        ("--sizes 16 --out x.pdf", ["x.pdf", ".svg"]),
    ],
)
def test_invalid_arguments_are_one_line(harness, arguments, parts):
    write_geojson(Path("l.geojson"), [box(0, 0, 8, 8)])
    assert_refused(harness("inspect", "l.geojson", *arguments.split()), *parts)


def test_few_pixels_and_skipped_polygons_are_reported(harness):
    """Seven squares are smaller than the grid, a fan supports no hole, and a square remains."""
    ring = box(0, 2, 4, 6) - box(1, 3, 3, 5)
    squares = [box(0, 0, 1, 1), ring, *(box(n, 0, n + 1e-4, 1e-4) for n in range(2, 9))]
    write_geojson(Path("few.geojson"), squares)
    command = ("inspect", "few.geojson", "--sizes", "16", "--triangulator", "ear-clipping,fan")
    out, err = require_ok(harness(*command, "--out", "chart.png"))
    assert Path("chart.png").read_bytes().startswith(b"\x89PNG")
    assert "Inconclusive: at most 2 pixels are covered" in " ".join(out.split())
    assert "counted at 16 px: 1; skipped, as they vanish on the grid" in err
    assert "or a triangulator fails: 8" in err
    size = json.loads(harness(*command, "--json")[1])["sizes"][0]
    assert (size["polygons"], size["skipped"]) == (1, 8)
