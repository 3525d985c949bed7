"""Static plots: width, units on the axes, and estimates of counters."""

import re
from dataclasses import replace

import matplotlib.colors
import numpy as np
import pytest
from PIL import Image

from harness.metrics.registry import PREDICTED, find_metric
from harness.rasterisers.counters import ESTIMATES, compute_estimates
from harness.report.plots import NAME, plot_run
from harness.results.run_folder import read_run
from harness.style import COLOURS, STYLE, TWO_COLUMNS
from tests.conftest import PRINTED_DPI
from triangulators import criteria

LABELS = (
    "helper lanes by 4Q - S,",
    "helper lanes by H + T,",
    "RMS error of a polygon&#x27;s ratio ",
    "the paper&#x27;s overdraw A",
    "counted helper lanes,",
)


def test_plots_have_the_width_of_a_paper_and_labels_with_units(copy, monkeypatch):
    monkeypatch.setitem(STYLE, "savefig.dpi", PRINTED_DPI)
    plot_run(read_run(copy))
    svg = (copy / "plots" / f"{NAME}.svg").read_text()
    width = float(re.search(r'width="([\d.]+)pt"', svg)[1]) / 72
    assert width == pytest.approx(TWO_COLUMNS, abs=0.01)
    for label in LABELS:
        assert label in svg or label.replace("&#x27;", "'") in svg
    assert "<image" not in svg, "marks are vectors"
    with Image.open(copy / "plots" / f"{NAME}.png") as picture:
        assert picture.width == pytest.approx(200 * TWO_COLUMNS, abs=2)


def test_each_view_has_separate_plots(copy):
    run = read_run(copy)
    walked = [
        record.with_id(options=replace(record.id.options, order="walk")) for record in run.records
    ]
    files = plot_run(replace(run, path=copy / "cases.jsonl", records=[*run.records, *walked]))
    names = {file.name for file in files}
    assert "predicted-vs-measured-reference-cpu-128-30.svg" in names
    assert "predicted-vs-measured-reference-cpu-128-30-order-walk.svg" in names
    assert len(names) == len(files) == 8


def test_colours_differ_in_lightness_or_hue_for_colour_blind_eyes():
    # Machado et al. 2009, full deuteranopia, in linear RGB.
    blind = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    linear = np.array([matplotlib.colors.to_rgb(colour) for colour in COLOURS[:7]]) ** 2.2
    seen = np.clip(linear @ blind.T, 0, 1) ** (1 / 2.2)
    gaps = [np.abs(seen[i] - seen[j]).max() for i in range(len(seen)) for j in range(i)]
    assert min(gaps) > 0.1


def test_new_criterion_has_a_bar_in_the_plot(copy, monkeypatch):
    half = criteria.CRITERIA["half-perimeter"]
    new = replace(half, name="sparkle-length", label="sparkle", symbol="K")
    monkeypatch.setitem(criteria.CRITERIA, new.name, new)
    run = read_run(copy)
    for file in (copy / "polygons").glob("*.npz"):
        with np.load(file) as arrays:
            columns = dict(arrays)
        columns["predicted_sparkle_length"] = columns["predicted_expected_quads"] * 2.0
        np.savez_compressed(file, **columns)
    files = plot_run(run)
    svg = next(f for f in files if f.name == "predicted-vs-measured.svg").read_text()
    assert "sparkle K" in svg


FEATURES = {"expected_quads": 30.0, "half_perimeter": 40.0, "overdraw": 25.0, "area": 60.0}


def test_formulas_of_estimates():
    estimates = compute_estimates({**FEATURES, "triangles": 7.0})
    assert estimates == {
        "helper_lanes_by_quads": 4 * 30 - 60,
        "helper_lanes_by_half_perimeter": 40 + 7,
        "bbox_tests_by_overdraw": 25 + 60,
    }
    assert "helper_lanes_by_half_perimeter" not in compute_estimates(FEATURES)
    features = {PREDICTED + name: value for name, value in FEATURES.items()}
    prefixed = compute_estimates(features, PREDICTED)
    assert prefixed[f"{PREDICTED}bbox_tests_by_overdraw"] == 85


def test_estimates_have_the_unit_of_their_counter():
    for name, estimate in ESTIMATES.items():
        figure = find_metric(PREDICTED + name)
        assert figure.unit == find_metric(estimate.measure).unit
        assert figure.title == f"{find_metric(estimate.measure).label} by {estimate.formula}"
