"""Predicted draw times in reports: as `inspect` predicts them, by a given or a stored profile."""

import json
import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from harness import viewport_sizes
from harness.frame import View, make_scene_frame
from harness.metrics.decision import decide_run
from harness.profile.device_costs import find_profile, minimise_slowest_stage, read_costs
from harness.report.page import predict_run
from harness.results.run_folder import FRAMES, STORED_PROFILE, read_geometry, read_run
from harness.settings import TimingSettings
from harness.triangulating.recipes import parse_all
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load
from tests.conftest import require_ok
from tests.measuring.test_run import make_plan, measure
from tests.report.conftest import NAMES, VIEWS

H200 = find_profile("opengl-h200")


def predict(path, name="opengl-h200"):
    stored = read_run(path)
    return predict_run(stored, decide_run(stored), read_costs(find_profile(name)))


def test_predictions_equal_those_of_inspect(folder):
    """All figures and sentences, for every polygon that all triangulators draw."""
    device = read_costs(H200)
    content = predict(folder)
    names = ("ear-clipping", *(name for name in NAMES if name not in ("fan", "ear-clipping")))
    recipes = parse_all(names)
    by_view = {view["view"]: view for view in content["views"]}
    for view, condition in zip(VIEWS, ("256 px", "128 px, turned 30°"), strict=True):
        predicted = by_view.pop(condition)
        size = viewport_sizes.count_size(load("city:buildings=60"), recipes, view, device)
        rows = {row["name"]: row for row in predicted["rows"]}
        assert set(rows) == set(names)  # the fan skips polygons
        assert predicted["base"] == "ear-clipping"
        assert not rows["ear-clipping"]["saved"]
        times = [row["draw_ms"] for row in predicted["rows"]]
        assert times == sorted(times)
        for name, cost in size.costs.items():
            assert rows[name]["draw_ms"] == pytest.approx(1e3 * cost["draw"])
            assert rows[name]["walk_ms"] == pytest.approx(1e3 * cost["draw_walk"])
            assert rows[name]["stage"] == cost["stage"]
            saved = f"{size.saved[name]:.1%} (95 % CI {100 * cost['saved_95'][0]:.1f} to "
            assert name == "ear-clipping" or rows[name]["saved"].startswith(saved)
        (line,) = viewport_sizes.list_stages(viewport_sizes.Sizes("city", device, (size,)))
        start = r"At 256 px ear-clipping is bound by \w+: "
        assert view.rotation or re.match(start, predicted["advice"])
        remedy = line.partition(" is bound by ")[2].partition(": ")[0]
        assert f" is bound by {remedy}: " in predicted["advice"]
    assert by_view == {}


def test_device_of_one_stage_gets_a_remedy(folder):
    content = predict(folder, "opengl-llvmpipe")
    assert not content["has_stages"]
    for view in content["views"]:
        assert re.match(r"At \d+ px.* (use .*, the cheapest .* saving: \d|keep )", view["advice"])


def test_missing_triangulations_are_reported(copy):
    shutil.rmtree(copy / FRAMES)
    content = predict(copy)
    assert content["views"] == []
    assert content["skipped"].startswith("Not predicted: 2 of 2 views, whose triangulations are")


def test_report_predicts_by_a_given_or_stored_profile(copy, harness):
    def write(*options):
        require_ok(harness("report", str(copy), *options))
        return (copy / "report.html").read_text()

    assert "Predicted on NVIDIA H200" in write("--profile", "opengl-h200")
    assert "Predicted on" not in write()
    shutil.copy(H200, copy / STORED_PROFILE)
    text = write()
    assert text.count('<table class="ranking predicted">') == len(VIEWS)
    assert "the slowest" in text
    (copy / STORED_PROFILE).write_text("{}")
    text = write()
    assert "no predicted draw times: " in text
    assert "is not a profile" in text


def test_run_stores_the_profile_and_minimises_the_slowest_stage(tmp_path):
    device = read_costs(H200)
    name, base = "optimal:calibrated", "ear-clipping"
    coefficients = json.loads(H200.read_text())["coefficients"]
    plan = replace(
        make_plan(Path("city:buildings=12"), rasterisers=("reference",), views=(View(2048),)),
        triangulators=parse_all((base, name), calibration=coefficients),
        timing=TimingSettings(precision=0.5, budget_s=1.0, warm_up_s=0.0),
    )
    calibrate = partial(minimise_slowest_stage, device)
    measure(plan, tmp_path / "run", profile=H200.read_bytes(), calibrate=calibrate)
    stored = read_run(tmp_path / "run")
    frame = make_scene_frame(load(plan.scene), plan.views[0])

    def triangulate(recipe):
        return triangulate_polygons(recipe, frame.polygons)

    chosen, expected = minimise_slowest_stage(device, frame, plan.triangulators[1], triangulate)
    assert chosen.calibration != plan.triangulators[1].calibration
    geometry = read_geometry(stored, plan.views[0])
    assert np.array_equal(geometry.triangles[name], frame.join_triangles(expected.parts))
    prediction = predict_run(stored, decide_run(stored), read_costs(stored.folder / STORED_PROFILE))
    assert [row["name"] for row in prediction["views"][0]["rows"]] == [name, base]
    assert all(record.triangulate_samples_s for record in stored.records)
