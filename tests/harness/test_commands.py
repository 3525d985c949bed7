"""The smaller commands: triangulate, cache, inspect, doctor, gains."""

import errno
import json
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh

from harness.commands.options import choose_rasterisers
from harness.commands.runs import choose_folder
from harness.commands.triangulate import COMPILING
from harness.profile.law import COSTS
from harness.results.run_folder import read_facts
from harness.triangulating.database import ModelDatabase, TimedTriangles
from harness.triangulating.triangulate import triangulate_many
from tests.conftest import assert_one_line, assert_refused, require_ok
from tests.harness.test_cli import MOCK
from tests.paths import ROOT

pytestmark = pytest.mark.usefixtures("no_plots", "in_process")


def test_triangulate_writes_the_mesh_and_prints_a_summary(harness, block):
    out, _ = require_ok(harness("triangulate", str(block), "-o", "block.glb"))
    assert "3 polygons" in out
    mesh = trimesh.load("block.glb", force="mesh")
    # y is up in glTF.
    assert mesh.extents == pytest.approx([36, 0, 28])
    flat, out, _ = harness("triangulate", str(block), "-o", "block.obj", "--quiet")
    assert flat == 0
    # An L of 72, a courtyard of 256 - 64, a square of 64 square metres.
    assert trimesh.load("block.obj", force="mesh").area == pytest.approx(72 + 192 + 64)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["missing.geojson", "-o", "x.glb"], ["missing.geojson"]),
        (["city:buildings=3", "-o", "x.docx"], ["docx", "glb"]),
        (["city:buildings=3", "-o", "x.glb", "--triangulator", "delauny"], ["delaunay"]),
        (["city:buildings=3", "-o", "/proc/none/x.glb"], ["/proc/none"]),
        (
            ["paper", "-o", "x.glb", "--triangulator=worst:shape", "--criterion=shape"],
            ["worst:shape", "criterion 'shape' are mutually exclusive"],
        ),
        (["paper", "-o", "x.glb", "--certify", "--evidence=./x.glb"], ["also the name of -o"]),
    ],
)
def test_triangulate_refuses_unsupported_arguments(harness, arguments, parts):
    assert_refused(harness("triangulate", *arguments), *parts)
    assert not Path("x.glb").exists()


@pytest.mark.parametrize(
    ("arguments", "full"),
    [
        ([], "optimal:half-perimeter"),
        (["--triangulator", "optimal"], "optimal:overdraw"),
        (["--triangulator", "earcut"], "ear-clipping"),
        (["--criterion", "edge-length"], "optimal:edge-length"),
        (["--triangulator", "worst", "--criterion", "shape"], "worst:shape"),
        (["--triangulator", "optimal:mixed=1.0/.5/0"], "optimal:mixed=1/0.5/0"),
    ],
)
def test_triangulate_resolves_names_as_other_commands_do(harness, block, arguments, full):
    assert harness("triangulate", str(block), "-o", "block.npz", "--quiet", *arguments)[0] == 0
    with np.load("block.npz") as arrays:
        assert arrays["triangulator"] == full


def test_the_cache_is_listed_and_cleared(harness, monkeypatch, tmp_path):
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "cache.sqlite"))
    with ModelDatabase() as database:
        database.store("delaunay", b"key", TimedTriangles(np.zeros((1, 3), np.int32), 1.0))
    out, _ = require_ok(harness("cache", "info"))
    assert "cache.sqlite" in out
    assert "delaunay" in out
    assert harness("cache", "clear")[0] == 0
    assert "0 triangulations" in harness("cache", "info")[1]
    assert_refused(harness("cache", "burn"), "choose from info, clear")


@pytest.mark.parametrize("many", [False, True])
def test_failed_polygons_are_skipped_with_exit_code_5(block, harness, many):
    """The fan skips the courtyard: the file has two of three footprints."""
    out = ("-o", "out") if many else ("-o", "block.npz")
    source = str(block.with_name("*.geojson")) if many else str(block)
    code, output, err = harness("triangulate", source, *out, "--triangulator", "fan")
    assert code == 5
    assert "2 polygons, " in output
    assert f"error: 1 polygon failed; the others are in {out[1]}" in err
    assert "failed 1: " in err
    assert Path(out[1]).exists()
    arguments = ("triangulate", source, *out, "--triangulator", "strip")
    assert not many or harness(*arguments)[0] == 2  # the folder belongs to another triangulator


def test_inspect_draws_a_picture_that_survives_a_full_disk(harness, block, monkeypatch):
    def fill_disk(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    inspect = ("inspect", str(block), "--out", "picture.png", "--polygon")
    require_ok(harness(*inspect, "1"))
    picture = Path("picture.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert_refused(harness(*inspect, "9"), "polygons 0 to 2")
    monkeypatch.setattr("harness.atomic.move", fill_disk)
    assert harness(*inspect, "0")[0] != 0
    assert Path("picture.png").read_bytes() == picture


def test_webgpu_in_place_of_opengl_is_reported(harness, monkeypatch, capsys):
    for name in ("opengl", "webgpu"):
        monkeypatch.setattr("harness.rasterisers.choose_default_rasteriser", lambda name=name: name)
        assert choose_rasterisers(None)[0] == name
        message = "no device works here; measuring with webgpu"
        assert (message in capsys.readouterr().err) is (name == "webgpu")
    assert message in harness("profile", "--device", "no-such-device")[2]


def test_inspect_numbers_polygons_as_the_scene_does(harness, block, monkeypatch):
    names = []

    def draw(frame, *_):
        names.extend(frame.source.tolist())
        return b""

    monkeypatch.setattr("harness.heatmaps.draw_heatmaps", draw)
    code, out, _ = harness("inspect", str(block), "--polygon", "2")
    assert (code, names) == (0, [2])
    assert "counted from 0" not in out
    Path("two.v1.wkt").write_text("POINT (1 1)\nPOLYGON ((0 0, 2 0, 2 2, 0 1, 0 0))\n")
    command = ("inspect", "two.v1.wkt", "--polygon", "0")
    _, out, _ = harness(*command)
    assert Path("two.v1-0.png").exists()
    line = "polygon 0: counted from 0, among the 1 valid polygons"
    assert line in out
    out, err = require_ok(harness(*command, "--sizes", "64", "--json"))
    assert json.loads(out)["sizes"][0]["polygons"] == 1
    assert line in err


def test_triangulate_reports_compilation(harness, block, monkeypatch):
    def slowly(*arguments, **options):
        time.sleep(0.2)
        return triangulate_many(*arguments, **options)

    monkeypatch.setattr("harness.commands.triangulate.NOTE_AFTER_S", 0.0)
    monkeypatch.setattr("harness.export.export.triangulate_many", slowly)
    _, err = require_ok(harness("triangulate", str(block), "-o", "block.obj"))
    assert COMPILING in err


def test_inspect_every_refuses_too_many_triangulations(harness):
    answer = harness("inspect", "stress", "--every", "conforming", "--polygon", "0")
    assert_refused(answer, "triangulations", "optimal")


@pytest.mark.parametrize("option", [("--resolution", "64"), ("--triangulator", "fan")])
def test_inspect_every_refuses_options_of_pictures(harness, option):
    answer = harness("inspect", "paper", "--every", "paper", *option)
    assert_refused(answer, f"{option[0]} cannot be combined with --every")


GAINS = ("study", "gains", "run", "--out", "gains")


@pytest.fixture
def measure(harness, block):
    """Return a function that measures triangulators of the block with the mock."""

    def call(out: str, names: str, *options: str) -> None:
        run = ("run", "--scene", str(block), "--out", out, "--triangulators", names, *MOCK)
        require_ok(harness(*run, *options))

    return call


def test_gains_compare_times_with_bases(harness, measure):
    """The mock's times follow its counters, so the fastest triangulator is known."""
    measure("run", "ear-clipping,delaunay,optimal", "--resolution", "64,128")
    require_ok(harness(*GAINS))
    table = pd.read_csv("gains/gains.csv")
    assert set(table["base"]) == {"ear-clipping", "delaunay"}
    assert set(table["resolution"]) == {64, 128}
    assert (table[table["triangulator"] == table["base"]]["time_ratio"] == 1).all()
    names = [path.name for path in Path("gains/plots").iterdir()]
    assert any(name.startswith("gain-resolution-") for name in names)
    out, _ = require_ok(harness(*GAINS, "--bases", "optimal,ear-clipping"))
    table = pd.read_csv("gains/gains.csv")
    assert set(table["base"]) == {"optimal:overdraw", "ear-clipping"}
    for base in ("optimal:overdraw", "ear-clipping"):
        rows = table[table["base"] == base]
        beaten = rows[rows["verdict"] == "faster"]["resolution"].nunique()
        assert f"{base}: no triangulator is significantly faster in {2 - beaten} of 2 views" in out
    assert_refused(harness(*GAINS, "--bases", "nothing"), "unknown triangulator")


def test_interrupted_gains_leave_existing_files(harness, measure, monkeypatch):
    measure("run", "ear-clipping,delaunay", "--resolution", "64")
    require_ok(harness(*GAINS))
    before = {path: path.read_bytes() for path in Path("gains").rglob("*") if path.is_file()}

    def cut_off(_table, folder):
        folder.mkdir()
        (folder / "half.png").write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("harness.commands.study_gains.plot_gains", cut_off)
    assert harness(*GAINS, "--bases", "delaunay")[0] == 130
    after = {path: path.read_bytes() for path in Path("gains").rglob("*") if path.is_file()}
    assert after == before


def test_gains_are_drawn_over_varying_views(harness, measure, monkeypatch):
    turned = ("--resolution", "64", "--rotation", "0,10,20", "--fit", "circle")
    measure("still", "ear-clipping,delaunay", "--resolution", "128")
    measure("turned", "ear-clipping,delaunay", *turned)
    figures = {}
    monkeypatch.setattr(
        "harness.style.draw_figure",
        lambda _, name, make, *arguments: [figures.setdefault(name, make(*arguments))],
    )
    assert harness("study", "gains", "still", "turned", "--out", "gains")[0] == 0
    (name,) = [n for n in figures if "rotation" in n and n.endswith("over-ear-clipping")]
    line = figures[name].axes[0].lines[0]
    assert list(line.get_xdata()) == [0, 10, 20]


def test_gains_do_not_pair_times_of_different_runs(harness, measure):
    """Three runs: a view twice, with other triangulators, and in another fit."""
    measure("one", "ear-clipping,delaunay", "--resolution", "64")
    measure("again", "ear-clipping,optimal", "--resolution", "64")
    measure("round", "delaunay", "--resolution", "64", "--fit", "circle")
    gains = ("study", "gains", "one", "again", "round", "--out", "gains")
    out, _ = require_ok(harness(*gains, "--bases", "ear-clipping,delaunay"))
    table = pd.read_csv("gains/gains.csv")
    box = table[table["fit"] == "box"]
    assert set(box["triangulator"]) == {"ear-clipping", "delaunay"}
    assert len(box) == 4
    assert len(table) == 5
    assert "of 1 views" in out


def test_optimal_calibrated_needs_a_profile(harness, block, tmp_path):
    run = ("run", "--scene", str(block), "--triangulators", "optimal:calibrated", *MOCK)
    assert_refused(harness(*run, "--device", "scripted"), "--profile FILE")
    terms = dict.fromkeys(COSTS, 0.0) | {"draw": 1e-6, "half_perimeter": 1e-8}
    profile = json.loads((ROOT / "results/reference/profiles/opengl-llvmpipe.json").read_text())
    Path("c.json").write_text(json.dumps(profile | {"coefficients": terms}))
    assert harness(*run, "--profile", "c.json", "--out", "run")[0] == 0


def test_two_runs_within_a_second_get_separate_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.strftime", lambda form: "20260101-120000")
    folders = []
    for _ in range(3):
        folders.append(choose_folder("city", None))
        folders[-1].mkdir(parents=True)
    stamp = "city-20260101-120000"
    assert [folder.name for folder in folders] == [stamp, f"{stamp}-2", f"{stamp}-3"]
    of_a_study = choose_folder("there/own.geojson", None, None, before="validate-")
    assert of_a_study.name == "validate-own-20260101-120000"


@pytest.mark.parametrize("kind", ["scenes", "triangulators", "rasterisers", "criteria", "metrics"])
def test_lists_are_available_as_json(harness, kind):
    out, err = require_ok(harness("list", kind, "--json"))
    assert err == ""
    rows = json.loads(out)
    assert json.loads(harness("list", "--json")[1])[kind] == rows
    assert len(rows) >= 3
    assert len({tuple(row) for row in rows}) == 1
    for table in (harness("list", kind)[1], harness("list")[1]):
        assert all(next(iter(row.values())) in table for row in rows)


def test_json_of_a_run_has_its_cases(harness, block):
    run = ("run", "--scene", str(block), "--triangulators", "delaunay,greedy", *MOCK)
    out, _ = require_ok(harness(*run, "--budget", "0.002", "--out", "out", "--json"))
    document = json.loads(out)
    timing = read_facts(Path("out"), [])["plan"]["timing"]
    assert timing["budget_s"] == 0.002, "--budget overrides --quick"
    assert document["results"] == "out"
    assert not document["interrupted"]
    cases = {case["triangulator"]: case for case in document["cases"]}
    assert set(cases) == {"delaunay", "greedy"}
    assert cases["greedy"]["status"] == "ok"
    assert cases["greedy"]["time_ratio_low"] <= cases["greedy"]["time_ratio"]


def test_written_proofs_are_accepted_and_modified_ones_refused(harness):
    triangulate = ("triangulate", "paper", "-o", "paper.glb", "--certify", "--evidence")
    assert harness(*triangulate, "proofs.jsonl")[0] == 0
    code, out, err = harness("check-evidence", "proofs.jsonl")
    assert (code, out.strip(), err) == (0, "1: optimal", "")
    line = Path("proofs.jsonl").read_text()
    Path("forged.jsonl").write_text(line + line.replace('"gap": 0.0', '"gap": -0.01'))
    code, out, err = harness("check-evidence", "forged.jsonl")
    assert code == 5
    assert out.splitlines()[1].startswith("2: refused: the stated gap is below 0.0")
    assert_one_line(err, "forged.jsonl", "1 of 2 proofs are refused")
    Path("empty.jsonl").write_text("")
    assert_refused(harness("check-evidence", "empty.jsonl"), "empty.jsonl", "--evidence")
