"""A GLB with EXT_mesh_polygon passes Khronos' validator, and CesiumJS draws it as we do."""

import base64
import json
import os
import subprocess

import numpy as np
import pytest
import shapely

from harness.export.export import export_file
from harness.frame import UNBOUNDED
from harness.rasterisers.spans import fill_picture
from scenes import load
from scenes.readers.gltf import GltfFile
from tests.paths import ROOT
from tests.ports.languages import find_node
from triangulators import triangulate, vertices

PACKAGES = ROOT / "examples" / "node_modules"
CITY = "city:buildings=200"
SIDE = 384  # of the picture, in pixels

ROUNDING = 1 / 16
"""SwiftShader rounds vertices to 1/16 px, our rasteriser to 1/256 px: pixels whose centres are this
near to an edge may differ."""

VALIDATE = """
const {validateBytes} = require("gltf-validator");
validateBytes(new Uint8Array(require("fs").readFileSync(process.argv[1])))
    .then(({issues}) => console.log(JSON.stringify(issues)));
"""


def run_node(*command):
    node = find_node()
    if node is None or not (PACKAGES / "@cesium" / "engine").exists():
        pytest.skip("CesiumJS is not installed; run with a network: make setup-test")
    environment = {**os.environ, "NODE_PATH": str(PACKAGES)}
    arguments = [node, *map(str, command)]
    return subprocess.check_output(arguments, cwd=ROOT, env=environment, text=True)


@pytest.fixture(scope="module")
def glb(tmp_path_factory):
    out = tmp_path_factory.mktemp("cesium") / "city.glb"
    export_file(CITY, out, polygons=True, chunk=64)
    return out


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    options = ("--bundle", "--minify", "--log-level=error", "--define:import.meta.url=''")
    options += ("--define:CESIUM_BASE_URL=''", f"--outfile={folder / 'cesium.js'}")
    run_node(PACKAGES / "esbuild" / "bin" / "esbuild", "tests/export/cesium.js", *options)
    page = folder / "page.html"
    page.write_text('<!doctype html><meta charset="utf-8"><body><script src="cesium.js"></script>')
    return page


def test_validator_reports_no_error(glb):
    issues = json.loads(run_node("-e", VALIDATE, glb))
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0)
    # The validator does not know the draft, so its accessors seem unused.
    accessors = 3 * len(GltfFile(glb).json["meshes"])
    codes = [message["code"] for message in issues["messages"]]
    assert sorted(codes) == ["UNSUPPORTED_EXTENSION", *accessors * ["UNUSED_OBJECT"]]


def draw_city(bounds):
    """Return a mask of the pixels that the city covers, bottom row first, by our rasteriser."""
    image = np.zeros((SIDE, SIDE), np.uint32)
    left, bottom, right, _ = bounds
    for polygon in load(CITY).polygons:
        points = (vertices(polygon) - (left, bottom)) * (SIDE * 256 / (right - left))
        triangles = triangulate(polygon, "delaunay")
        colours = np.ones(len(triangles), np.uint32)
        fill_picture(np.rint(points).astype(np.int32), triangles, colours, image, UNBOUNDED)
    return image > 0


def test_cesium_draws_the_city_as_we_do(glb, page, gpu_browser):
    polygons = load(CITY).polygons
    assert shapely.get_num_interior_rings(polygons).sum() == 12
    origin = np.array(GltfFile(glb).json["asset"]["extras"]["origin"])
    bounds = np.concatenate((origin - 290.0, origin + 290.0))
    expected = draw_city(bounds)
    edges, scale = shapely.union_all(shapely.boundary(polygons)), 580.0 / SIDE
    view = json.dumps((bounds - np.tile(origin, 2)).tolist())
    model = json.dumps(base64.b64encode(glb.read_bytes()).decode())
    gpu_browser.open(page)
    for as_tile in (False, True):
        script = f"draw({model}, {json.dumps(as_tile)}, {view}, [{SIDE}, {SIDE}])"
        result = gpu_browser.evaluate(script)
        assert (result.get("failure"), result.get("loaded")) == (None, True)
        covered = np.array([*result["covered"]]).reshape(SIDE, SIDE) == "1"
        rows, columns = np.nonzero(covered != expected)
        centres = np.column_stack((columns, rows)) + 0.5
        points = shapely.points(bounds[:2] + centres * scale)
        assert (shapely.distance(points, edges) <= ROUNDING * scale).all()
        assert len(rows) < 0.01 * expected.sum()
    assert {address.split(":")[0] for address in gpu_browser.requests} <= {"file", "blob", "data"}
