import itertools
import json
import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.frame import View, make_frame
from harness.rasterisers.base import sum_per_polygon
from harness.rasterisers.reference import count_per_triangle
from harness.report.page import write_report
from harness.results.run_folder import read_run
from harness.results.run_writer import RunFolder
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import sum_criteria_per_polygon, triangulate_polygons
from scenes import load
from tests.chromium import Chromium
from tests.conftest import BRIEF_TIMING
from tests.measuring.test_run import make_plan, measure

NAMES = ("fan", "ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter")
VIEWS = (View(256), View(128, 30.0))
DRAWN = {"status": "ok", "reason": None, "polygons": 600, "conforming": True, "triangles": 8000}
CRITERIA = {"overdraw": 3e5, "half_perimeter": 1e5, "expected_quads": 7e4}


@pytest.fixture(autouse=True)
def _usual_window(request: pytest.FixtureRequest) -> Iterator[None]:
    """Open pages in a window of usual size, and require that they report no error."""
    if "browser" not in request.fixturenames:
        yield
        return
    chromium: Chromium = request.getfixturevalue("browser")
    chromium.resize(1280, 900)
    chromium.prefer("light")
    yield
    assert chromium.errors == []


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of 60 footprints in two views, counted and timed by the CPU reference."""
    path = tmp_path_factory.mktemp("report") / "city"
    fields = {"triangulators": NAMES, "rasterisers": ("reference",), "views": VIEWS}
    measure(make_plan(Path("city:buildings=60"), timing=BRIEF_TIMING, **fields), path)
    facts = json.loads((path / "run.json").read_text())
    facts["state"] |= {"state": "quiet", "why": []}  # whatever else the machine does
    (path / "run.json").write_text(json.dumps(facts))
    write_report(read_run(path))
    return path


@pytest.fixture
def page(browser: Chromium, folder: Path) -> Chromium:
    browser.open(folder / "report.html")
    return browser


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    path = tmp_path / "copy"
    shutil.copytree(folder, path)
    return path


@pytest.fixture(scope="session")
def large_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_many(tmp_path_factory.mktemp("report") / "many", devices=1)


def write_many(path: Path, devices: int) -> Path:
    """Write a run of 1,000 cases per device: 200 views of 5 triangulators, one with polygons."""
    store = RunFolder.create(path)
    store.write_facts({"plan": {"triangulators": list(NAMES)}, "scene": {"name": "city"}})
    frame = make_frame(load("city:buildings=600", seed=0).polygons, View(256))
    triangles, columns = {}, {}
    for name in NAMES:
        parts = triangulate_polygons(parse(name), frame.polygons).parts
        triangles[name] = frame.join_triangles(parts)
        counted = count_per_triangle(frame.points, triangles[name])
        predicted = sum_criteria_per_polygon(frame.polygons, parts)
        columns[name] = {f"predicted_{key}": column for key, column in predicted.items()} | {
            key: sum_per_polygon(frame, triangles[name], column) for key, column in counted.items()
        }
    store.write_geometry(frame, triangles)
    values = random.Random(0)
    lines = []
    conditions = itertools.product(
        ("opengl", "bounding-box"),
        [f"gpu{k}" for k in range(devices)],
        [256 * k for k in range(1, 11)],
        [9.0 * k for k in range(10)],
    )
    for number, condition in enumerate(conditions):
        names = ("rasteriser", "device", "resolution", "rotation")
        fields = dict(zip(names, condition, strict=True))
        reference = [values.gauss(1e-3, 1e-5) for _ in range(20)]
        for rank, name in enumerate(NAMES):
            cost = 1.0 - 0.05 * rank
            samples = [values.gauss(1e-3 * cost, 1e-5) for _ in range(20)]
            helpers = int(1e5 * cost * values.uniform(0.95, 1.05))
            record = {
                "key": f"{number * len(NAMES) + rank:016x}",
                "scene": "city",
                "triangulator": name,
                **fields,
                **DRAWN,
                "triangulate_s": 0.1,
                "predicted": {"area": 1.8e5, **{k: cost * v for k, v in CRITERIA.items()}},
                "counters": {"fragments": 180000, "quads": 70000, "helper_lanes": helpers},
                "time": {"timer": "gpu", "samples_s": samples, "reference_s": reference},
            }
            lines.append(json.dumps(record) + "\n")
            if condition[2:] == (256, 0.0):
                store.write_arrays(record["key"], columns[name])
    store.close()
    (path / "cases.jsonl").write_text("".join(lines))
    write_report(read_run(path))
    return path
