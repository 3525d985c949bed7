"""The examples, built and opened: what three.js and MapLibre draw with flips, what it saves."""

import os
import subprocess
import sys

import numpy as np
import pytest

from harness.frame import UNBOUNDED
from harness.rasterisers.spans import FRAGMENTS, QUADS, count_triangles
from tests.chromium import REPORT_READY, WEBGPU_FLAGS, Chromium
from tests.paths import ROOT
from tests.ports import languages
from triangulators import flip

EXAMPLES = ROOT / "examples"
SUBPIXEL = 256
FIGURES = {
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
"""Before and after; half-perimeters in 1/256 px."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Return the folder of the pages, built as `make examples` does."""
    node = languages.node()
    if node is None or not (EXAMPLES / "node_modules" / "esbuild").exists():
        pytest.skip("the clients are not here; with network: make setup-test")
    folder = tmp_path_factory.mktemp("examples")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # a clone's packages are not installed
    for program, script in ((sys.executable, "data.py"), (node, "build.mjs")):
        command = [program, str(EXAMPLES / script), str(folder)]
        subprocess.run(command, cwd=ROOT, env=environment, check=True)
    return folder


@pytest.fixture(scope="module")
def chromium():
    """A browser with WebGL 2 on the CPU."""
    opened = Chromium(WEBGPU_FLAGS)
    yield opened
    opened.close()


@pytest.fixture(scope="module", params=FIGURES)
def drawn(request, pages, chromium):
    """Return a page's name, what it says, and what was drawn before and after, with its figures."""
    chromium.open(pages / f"{request.param}.html", REPORT_READY)
    assert chromium.errors == []
    addresses = {address.split(":")[0] for address in chromium.requests}
    assert addresses <= {"file", "blob", "data"}
    said = chromium.evaluate("document.body.innerText")
    return request.param, said, chromium.evaluate("results")


def arrays(state):
    points = np.array(state["points"], np.int32).reshape(-1, 2)
    return points, np.array(state["triangles"], np.int32).reshape(-1, 3)


def doubled_areas(points, triangles):
    a, b, c = (points[triangles[:, k]].astype(np.int64) for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def half_perimeters(points, triangles):
    corners = points[triangles].astype(np.int64)
    return int((corners.max(axis=1) - corners.min(axis=1)).sum())


def test_flips_keep_the_picture(drawn):
    name, _, results = drawn
    (points, before), (same, after) = arrays(results["before"]), arrays(results["after"])
    assert np.array_equal(points, same)
    assert np.array_equal(np.unique(before), np.unique(after))
    assert (np.sort(before, axis=1) != np.sort(after, axis=1)).any(axis=1).mean() > 0.4
    areas = [doubled_areas(points, each) for each in (before, after)]
    winding = np.sign(areas[0][0])
    assert all((each * winding > 0).all() for each in areas)
    assert areas[0].sum() == areas[1].sum()
    # SwiftShader rounds vertices to 1/16 px; where that folds a sliver, a pixel may differ.
    assert results["differing"] <= 3
    if name == "three":  # MapLibre turns triangles round and renumbers them after earcut
        assert np.array_equal(flip(points / SUBPIXEL, before), after)


def test_flips_save_what_the_page_says(drawn):
    name, said, results = drawn
    expected = FIGURES[name]
    found = []
    for key in ("before", "after"):
        points, triangles = arrays(results[key])
        counts = count_triangles(points, triangles, UNBOUNDED).sum(axis=0)
        helper_lanes = int(4 * counts[QUADS] - counts[FRAGMENTS])
        assert len(triangles) == expected["triangles"]
        found.append((half_perimeters(points, triangles), helper_lanes))
        assert results[key]["counted"] == {
            "triangles": len(triangles),
            "halfPerimeters": found[-1][0] / SUBPIXEL,
            "fragments": counts[FRAGMENTS],
            "quads": counts[QUADS],
            "helperLanes": helper_lanes,
        }
    halves, lanes = zip(*found, strict=True)
    assert (halves, lanes) == (expected["half_perimeters"], expected["helper_lanes"])
    assert results["before"]["counted"]["fragments"] == results["after"]["counted"]["fragments"]
    assert f"Flips save {lanes[0] - lanes[1]:,} helper lanes." in said
