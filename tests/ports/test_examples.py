"""Build and open the examples: pictures and savings of three.js and MapLibre with flips."""

import os
import subprocess
import sys

import numpy as np
import pytest

from harness.frame import UNBOUNDED
from harness.rasterisers.spans import FRAGMENTS, QUADS, count_pixels_per_triangle
from tests.paths import ROOT
from tests.ports import languages
from triangulators import flip

EXAMPLES = ROOT / "examples"
SUBPIXEL = 256
EXPECTED = {
    "three": {
        "triangles": 9289,
        "half_perimeters": (44_369_109, 34_221_325),
        "helper_lanes": (103_618, 82_902),
    },
    "maplibre": {
        "triangles": 8877,
        "half_perimeters": (87_975_328, 59_760_032),
        "helper_lanes": (272_576, 196_528),
    },
}
"""Sums before and after flips; half-perimeters in 1/256 px."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    node = languages.find_node()
    if node is None or not (EXAMPLES / "node_modules" / "esbuild").exists():
        pytest.skip("three.js and MapLibre are not installed; run with a network: make setup-test")
    folder = tmp_path_factory.mktemp("examples")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # packages of a clone are not installed
    for program, script in ((sys.executable, "data.py"), (node, "build.mjs")):
        command = [program, str(EXAMPLES / script), str(folder)]
        subprocess.run(command, cwd=ROOT, env=environment, check=True)
    return folder


@pytest.fixture(scope="module", params=EXPECTED)
def page_results(request, pages, gpu_browser):
    """Return the name, text and global `results` of a page."""
    gpu_browser.open(pages / f"{request.param}.html")
    assert gpu_browser.errors == []
    addresses = {address.split(":")[0] for address in gpu_browser.requests}
    assert addresses <= {"file", "blob", "data"}
    text = gpu_browser.evaluate("document.body.innerText")
    return request.param, text, gpu_browser.evaluate("results")


def read_arrays(state):
    points = np.array(state["points"], np.int32).reshape(-1, 2)
    return points, np.array(state["triangles"], np.int32).reshape(-1, 3)


def double_areas(points, triangles):
    a, b, c = (points[triangles[:, k]].astype(np.int64) for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def test_flips_do_not_change_the_picture(page_results):
    name, _, results = page_results
    points, before = read_arrays(results["before"])
    points_after, after = read_arrays(results["after"])
    assert np.array_equal(points, points_after)
    assert np.array_equal(np.unique(before), np.unique(after))
    assert (np.sort(before, axis=1) != np.sort(after, axis=1)).any(axis=1).mean() > 0.4
    areas = [double_areas(points, triangles) for triangles in (before, after)]
    orientation = np.sign(areas[0][0])
    assert all((triangles * orientation > 0).all() for triangles in areas)
    assert areas[0].sum() == areas[1].sum()
    # SwiftShader rounds vertices to 1/16 px; if that folds a sliver triangle, a pixel may differ.
    assert results["differing"] <= 3
    if name == "three":  # MapLibre reverses and renumbers triangles after earcut
        assert np.array_equal(flip(points / SUBPIXEL, before), after)


def test_page_reports_the_savings_of_flips(page_results):
    name, text, results = page_results
    expected = EXPECTED[name]
    costs = []
    for key in ("before", "after"):
        points, triangles = read_arrays(results[key])
        counts = count_pixels_per_triangle(points, triangles, UNBOUNDED).sum(axis=0)
        helper_lanes = int(4 * counts[QUADS] - counts[FRAGMENTS])
        assert len(triangles) == expected["triangles"]
        half_perimeters = int(np.ptp(points[triangles], axis=1).sum(dtype=np.int64))
        costs.append((half_perimeters, helper_lanes))
        assert results[key]["counted"] == {
            "triangles": len(triangles),
            "halfPerimeters": half_perimeters / SUBPIXEL,
            "fragments": counts[FRAGMENTS],
            "quads": counts[QUADS],
            "helperLanes": helper_lanes,
        }
    halves, lanes = zip(*costs, strict=True)
    assert (halves, lanes) == (expected["half_perimeters"], expected["helper_lanes"])
    assert results["before"]["counted"]["fragments"] == results["after"]["counted"]["fragments"]
    assert f"Flips save {lanes[0] - lanes[1]:,} helper lanes." in text
