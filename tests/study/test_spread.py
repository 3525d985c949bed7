"""Criteria judged within the polygons of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.frame import SUBPIXEL, View, make_frame
from harness.rasterisers.reference import predict
from harness.report import matrix
from harness.report.matrix import criteria_of
from harness.report.report_data import content_of
from harness.stored.folder import read_run
from harness.study import subjects
from harness.study.correlations import difference, ranks
from scenes import load
from tests.conftest import exit_code
from triangulators import triangulate

SCENE = "city:buildings=60"


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("spread") / "run"
    arguments = ["run", "--scene", SCENE, "--rasterisers", "reference", "--resolution", "1024"]
    arguments += ["--triangulators", "ear-clipping,delaunay", "--quick", "--quiet"]
    assert exit_code(*arguments, "--out", str(folder)) == 0
    assert exit_code("report", str(folder)) == 0  # draws the plots that a quick run leaves out
    return folder


def test_polygons_are_triangulated_in_many_ways(run_folder):
    table = matrix.read(read_run(run_folder), View(1024))
    assert table["polygon"].nunique() == subjects.POLYGONS
    by_polygon = table.groupby("polygon").size()
    assert by_polygon.max() > 20
    names = set(table["triangulator"])
    assert {"ear-clipping", "worst:half-perimeter", "random#3"} <= names
    assert not table.duplicated(["polygon", "triangulator"]).any()


def test_what_is_counted_is_what_the_polygon_costs_in_its_frame(run_folder):
    table = matrix.read(read_run(run_folder), View(1024))
    frame = make_frame(load(SCENE).polygons, View(1024))
    number = int(table["polygon"].iloc[-1])
    polygon = frame.polygons[frame.source.tolist().index(number)]
    points = np.rint(np.array(polygon.exterior.coords)[:-1] * SUBPIXEL).astype(np.int32)
    own = table[table["polygon"] == number].set_index("triangulator")
    for name in ("random#0", "random#1", "optimal:half-perimeter"):
        base, _, seed = name.partition("#")
        parameters = {"seed": int(seed)} if seed else {}
        counts = predict(points, triangulate(polygon, base, **parameters))
        assert own.loc[name, "helper_lanes"] == counts["helper_lanes"].sum()


def test_criteria_are_ranked_within_polygons(run_folder):
    table = matrix.read(read_run(run_folder), View(1024))
    found = matrix.ranks(table, "helper_lanes")
    q, h, a, d = (found[name] for name in ("expected_quads", "half_perimeter", "overdraw", "shape"))
    assert q.polygons > 20
    assert q.value > h.value > a.value > d.value
    alike = table.assign(rotation=0, samples=1)
    by_q, by_a = (ranks(alike, name, "helper_lanes") for name in ("expected_quads", "overdraw"))
    assert difference(by_q, by_a).verdict == "better"
    assert "complexity" not in found, "it is the same for all, and so ranks nothing"


def test_the_report_says_which_criterion_to_use(run_folder):
    content = content_of(read_run(run_folder))
    sentence = content["groups"][0]["judged"]
    assert sentence.startswith("Within a polygon, ")
    assert "expected quads Q predicts helper lanes best (rank correlation 0.9" in sentence
    assert "over 24 polygons; the paper's overdraw A 0." in sentence


def test_the_default_picture_is_of_polygons(run_folder):
    svg = (run_folder / "plots" / "predicted-vs-measured.svg").read_text()
    assert "within a polygon?" in svg
    assert "random" in svg


def test_a_run_without_it_is_read_as_before(run_folder, tmp_path):
    run = read_run(run_folder)
    assert matrix.read(run, View(512)) is None
    for name, content in (("a", "polygon,resolution\n1,256\n"), ("b", "\0\0"), ("c", "")):
        folder = tmp_path / name
        folder.mkdir()
        for file in ("run.json", "cases.jsonl"):
            (folder / file).write_bytes((run_folder / file).read_bytes())
        (folder / matrix.SPREAD).write_text(content)
        assert matrix.read(read_run(folder), View(1024)) is None
        assert "Within a polygon" not in content_of(read_run(folder))["groups"][0]["judged"]


def test_without_a_spread_the_sentence_is_that_of_ratios():
    words = criteria_of("quads", {"quads": {"half_perimeter": 0.5}})
    assert words == "Of the criteria, half-perimeter H predicts quads best (rank correlation 0.50)."
    assert criteria_of("quads", {}) == ""


def test_the_table_is_a_plain_file(run_folder):
    table = pd.read_csv(Path(run_folder) / matrix.SPREAD)
    assert {"polygon", "triangulator", "half_perimeter", "helper_lanes", "fit"} <= set(table)
