"""The geometry of docs/try.html, in Node.js, is that of Python, and it reads what people paste."""

import importlib.util
import json
import subprocess
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from harness.frame import View, make_frame
from harness.grid import SUBPIXEL
from harness.rasterisers.reference import predict
from scenes import load
from tests.conftest import make_geojson
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.polygons import random_polygons
from triangulators import criteria, triangulate, vertices

GRID = 2**20
"""As in polygon.js."""

_spec = importlib.util.spec_from_file_location("build_try", ROOT / "docs" / "try" / "build.py")
assert _spec is not None
assert _spec.loader is not None
build = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(build)

OF_EACH = """
    return given.map(({text, size, rotation}) => {
        const {rings} = readPolygon(text), placed = place(rings, size, rotation);
        const {points} = placed, simple = isSimple(placed), ways = {};
        for (const [name, rows] of Object.entries(simple ? triangulations(placed) : {})) {
            if (!rows) continue;
            ways[name] = {rows, h: halfPerimeter(points, rows), counts: shade(points, rows)};
        }
        return {rings, again: toLink(rings, size, rotation), points, simple, ways};
    });
"""
RUN = """
    import {readFileSync} from "node:fs";
    import vm from "node:vm";
    const {files, code, given} = JSON.parse(readFileSync(0, "utf8"));
    globalThis.given = given;
    const sources = files.map((file) => readFileSync(file, "utf8"));
    const called = `globalThis.told = (() => { ${code} })();`;
    vm.runInThisContext([...sources, called].join("\\n"));
    console.log(JSON.stringify(globalThis.told));
"""


def in_node(code: str, given: Any) -> Any:
    """Return what a function's body returns that uses `given` and what needs no page."""
    node = languages.find_node()
    if node is None or languages.find_earcut() is None:
        pytest.skip("needs Node.js and npm's earcut; make setup-test installs them")
    told = json.dumps({"files": list(map(str, build.GEOMETRY)), "code": code, "given": given})
    script = [node, "--input-type=module", "-e", RUN]
    done = subprocess.run(script, input=told, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@cache
def cases() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Polygons of four scenes and random ones, in several views; what JavaScript makes of them."""
    polygons = [
        polygon
        for scene in ("paper", "city:buildings=40", "glyphs", "counties")
        for polygon in load(scene, attributes=False).polygons[:40]
    ]
    polygons += [Polygon(points) for points, ends in random_polygons(7, 120) if len(ends) == 1]
    given = [
        {
            "text": polygon.wkt,
            "size": (16, 64, 96, 256)[number % 4],
            "rotation": (0, 15, 90, 211)[number // 4 % 4],
        }
        for number, polygon in enumerate(polygons)
    ]
    return given, in_node(OF_EACH, given)


def points_of(told: dict[str, Any]) -> np.ndarray:
    return np.array(told["points"], np.int32).reshape(-1, 2)


def test_a_polygon_is_laid_where_a_run_lays_it():
    """Every corner, in 1/256 px, as `run --fit circle` has it; whatever snapping breaks is told."""
    laid = 0
    for given, told in zip(*cases(), strict=True):
        view = View(given["size"], given["rotation"], "circle")
        frame = make_frame([Polygon(told["rings"][0], told["rings"][1:])], view)
        if any("cross" in reason for _, reason in (*frame.repaired, *frame.dropped)):
            assert not told["simple"]
            continue
        assert (points_of(told) == frame.points).all()
        laid += 1
    assert laid > 200


def test_counts_are_those_of_the_reference():
    ways = 0
    for told in cases()[1]:
        points = points_of(told)
        for way in told["ways"].values():
            triangles = np.array(way["rows"], np.int32).reshape(-1, 3)
            expected = {name: int(each.sum()) for name, each in predict(points, triangles).items()}
            counts = way["counts"]
            for name in ("fragments", "quads", "helper_lanes", "partial_quads"):
                assert counts[name] == expected[name]
            ways += 1
    assert ways > 800


def test_the_optimum_costs_what_pythons_costs():
    found = 0
    for told in cases()[1]:
        if "optimal" not in told["ways"]:
            continue
        polygon = Polygon(points_of(told) / SUBPIXEL)
        rows = triangulate(polygon, "optimal:half-perimeter")
        least = criteria.predict(vertices(polygon), rows)["half_perimeter"] * SUBPIXEL
        assert told["ways"]["optimal"]["h"] == least
        found += 1
    assert found > 180


def test_a_link_holds_the_polygon():
    """A link that the page writes gives the same corners, size and rotation again."""
    given, told = cases()
    found = in_node("return given.map((link) => fromLink(link));", [one["again"] for one in told])
    for view, one, again in zip(given, told, found, strict=True):
        assert again == {"rings": one["rings"], "size": view["size"], "rotation": view["rotation"]}
    whole = told[0]["again"]
    cut = [whole[:end] for end in range(len(whole))]
    for bad in (*cut, "64/0/zz/", "64/0/1-1-2-2/", "x/0/1-1-2-2-3-4/"):
        assert in_node("return [fromLink(given)];", bad) == [None], bad


def l_shape() -> Polygon:
    return Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 4), (0, 4)])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("POLYGON ((0 0, 6 0, 6 2, 2 2, 2 4, 0 4, 0 0))", l_shape()),
        ("0,0 6,0 6,2 2,2 2,4 0,4", l_shape()),
        ("M0 0h6v-2h-4v-2H0z", l_shape()),
        ('<svg><path d="M 0 0 L6 0 6-2 2-2 2-4 0-4Z"/></svg>', l_shape()),
        ('<polygon points="0,0 6,0 6,-2 2,-2 2,-4 0,-4"/>', l_shape()),
        (
            json.dumps(shapely.geometry.mapping(shapely.affinity.scale(l_shape(), 400, 400))),
            l_shape(),
        ),
        (
            "MULTIPOLYGON(((0 0,1 0,1 1,0 0)),((0 0,9 0,9 9,0 9,0 0),(3 3,3 6,6 6,3 3)))",
            Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(3, 3), (3, 6), (6, 6)]]),
        ),
        (
            "M0 0H9V9H0ZM3 3V6H6Z",
            Polygon([(0, 0), (9, 0), (9, -9), (0, -9)], [[(3, -3), (3, -6), (6, -6)]]),
        ),
        (
            "M0 0H9V9H0ZM2 2V7H7V2ZM4 4H5V5H4Z",  # what lies in the hole is another polygon
            Polygon([(0, 0), (9, 0), (9, -9), (0, -9)], [[(2, -2), (2, -7), (7, -7), (7, -2)]]),
        ),
    ],
)
def test_texts_are_read(text, expected):
    """Equal up to place and scale, which the page does away with."""
    rings = in_node("return readPolygon(given).rings;", text)
    found = Polygon(rings[0], rings[1:])
    assert found.exterior.is_ccw
    low_x, low_y, high_x, high_y = expected.bounds
    scale = GRID / max(high_x - low_x, high_y - low_y)
    middle = np.array([(low_x + high_x) / 2, (low_y + high_y) / 2])
    moved = shapely.transform(expected, lambda xy: (xy - middle) * scale + GRID / 2)
    assert found.symmetric_difference(moved).area < 1e-5 * moved.area


def test_longitude_and_latitude_are_drawn_as_wide_as_they_are():
    """At 60 degrees north two degrees of longitude are as long as one of latitude."""
    boxes = [box(0, 0, 0.1, 0.1), box(20, 59.5, 22, 60.5)]
    found = in_node("return readPolygon(given);", make_geojson(boxes))
    low_x, low_y, high_x, high_y = Polygon(found["rings"][0]).bounds
    assert high_x - low_x == pytest.approx(high_y - low_y, rel=1e-5)
    assert found["note"] == "The largest of 2 polygons."
    assert found["degrees"] is True


def test_one_polygon_is_one_whatever_it_is_written_in():
    """WKT has no reference system, so the page takes it as it looks, or as it is told to."""
    footprint = Polygon([(24.93, 60.17), (24.932, 60.17), (24.932, 60.171), (24.931, 60.1705)])
    written = [json.dumps(shapely.geometry.mapping(footprint)), f"SRID=4326;{footprint.wkt}"]
    asked = [[text, None] for text in (*written, footprint.wkt)] + [[footprint.wkt, False]]
    code = "return given.map(([text, told]) => readPolygon(text, told));"
    one, two, three, plain = in_node(code, asked)
    assert one["rings"] == two["rings"] == three["rings"] != plain["rings"]
    assert [each["degrees"] for each in (one, two, three, plain)] == [True, True, True, False]
    for text, degrees in (("0 0, 700 0, 0 700", None), ("0 0, 9 0, 9 9", False)):
        assert in_node("return readPolygon(given).degrees;", text) is degrees
    copied = in_node("const p = readPolygon(given); return toWkt(p.rings, p.degrees);", written[0])
    assert copied.startswith("SRID=4326;")


@pytest.mark.parametrize(
    "text",
    [
        "POLYGON ((24.93 60.17, 24.932 60.17, 24.932 60.1712, 24.93 60.17))",
        "POLYGON ((386054.25 6672087.5, 386104.5 6672073, 386080 6672101.25, 386054.25 6672087.5))",
        "POLYGON ((0 0, 9 1, 8 6, 4 3, 1 7, 0 0), (5 2, 6 2, 7 4, 5 2))",
    ],
)
def test_a_polygon_is_copied_in_its_own_numbers(text):
    """To the last place, for degrees told and for plain coordinates."""
    code = """
        const told = (degrees) => readPolygon(given, degrees);
        return [false, true].map(told).map(({rings, back}) => toWkt(rings.map((r) => r.map(back))));
    """
    expected = shapely.from_wkt(text)
    for copied in in_node(code, text):
        assert shapely.equals(shapely.from_wkt(copied), expected)


def test_curves_and_arcs_are_followed():
    circles = [
        "M0 5A5 5 0 0 1 10 5A5 5 0 0 1 0 5Z",
        "M0 5a5 5 0 0110 0a5 5 0 01-10 0z",
        "M5 0C7.76 0 10 2.24 10 5S7.76 10 5 10 0 7.76 0 5 2.24 0 5 0Z",
    ]
    for text in circles:
        ring = in_node("return readPolygon(given).rings[0];", text)
        assert Polygon(ring).area / GRID**2 == pytest.approx(np.pi / 4, rel=0.03)
    ring = in_node("return readPolygon(given).rings[0];", "M0 0Q5 8 10 0T20 0V-9H0Z")
    assert Polygon(ring).is_valid


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hello", "none of WKT"),
        ('{"type": "Polygon"', "not whole JSON"),
        ('{"type": "Point", "coordinates": [0, 0]}', "no polygon with an area"),
        ("POLYGON ((0 0, 1 1, 2 2, 0 0))", "no polygon with an area"),
        ('{"type": "Polygon"}', "no polygon with an area"),
        ('{"type": "Polygon", "coordinates": [[1, 2, 3]]}', "is no number"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], ["9", 9]]]}', "is no number"),
        ("POLYGON ((0, 1 1, 2 2))", "fewer than two coordinates"),
        ("POLYGON ((0 0, 10 1, 12 7, 9", "not whole"),
        ("POINT (3 4)", "no polygon"),
        ("POLYGON((0 0,9 0,9 9,0 9,0 0),(20 20,22 20,22 22,20 20))", "A hole of this polygon"),
        ("POLYGON((0 0,9 0,9 9,0 0),(4 1,8 1,8 5,4 1),(6 2,7 2,7 3,6 2))", "in another hole"),
        (",".join(f"{x} {x * x}" for x in range(3000)), "draws up to 2000"),
    ],
)
def test_what_is_no_polygon_is_said(text, said):
    code = "try { readPolygon(given); return ''; } catch (error) { return error.message; }"
    assert said in in_node(code, text)
