"""The scripts of docs/try.html in Node.js: geometry as in Python, and reading of polygons."""

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
from harness.rasterisers.reference import SHADED, count_per_triangle
from harness.rasterisers.vertex_batches import count_batches
from scenes import load
from scenes.files import read
from tests.conftest import make_geojson
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.polygons import random_polygons
from triangulators import criteria, triangulate, vertices

GRID = 2**20
"""The constant of polygon.js."""

_spec = importlib.util.spec_from_file_location("build_try", ROOT / "docs" / "try" / "build.py")
assert _spec is not None
assert _spec.loader is not None
build = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(build)

MEASURE = """
    return given.map(({text, size, rotation}) => {
        const {rings} = readPolygon(text), placed = fitToViewport(rings, size, rotation);
        const {points} = placed, valid = !findFault(placed.rings), ways = {};
        for (const [name, rows] of Object.entries(valid ? triangulateByMethods(placed) : {})) {
            if (rows) ways[name] = {rows, counts: countLanes(points, rows)};
            for (const limit of rows ? [5, 32] : []) {
                ways[name][`batches ${limit}`] = countBatches(rows, limit, limit + 2);
            }
        }
        return {rings, link: toLink(rings, size, rotation), points, valid, ways};
    });
"""
RUN = """
    import {readFileSync} from "node:fs";
    import vm from "node:vm";
    const {files, code, given} = JSON.parse(readFileSync(0, "utf8"));
    globalThis.given = given;
    const sources = files.map((file) => readFileSync(file, "utf8"));
    const call = `globalThis.result = (() => { ${code} })();`;
    vm.runInThisContext([...sources, call].join("\\n"));
    console.log(JSON.stringify(globalThis.result));
"""


def run_js(code: str, given: Any) -> Any:
    """Return the result of a function body that uses `given` and the page's scripts."""
    node = languages.find_node()
    if node is None or languages.find_earcut() is None:
        pytest.skip("needs Node.js and npm's earcut; make setup-test installs them")
    message = json.dumps({"files": list(map(str, build.GEOMETRY)), "code": code, "given": given})
    script = [node, "--input-type=module", "-e", RUN]
    done = subprocess.run(script, input=message, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@cache
def cases() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
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
    return given, run_js(MEASURE, given)


def read_points(result: dict[str, Any]) -> np.ndarray:
    return np.array(result["points"], np.int32).reshape(-1, 2)


def test_polygons_are_placed_as_in_a_run():
    """Every vertex, in 1/256 px, as with `run --fit circle`, unless snapping makes it invalid."""
    placed = 0
    for given, result in zip(*cases(), strict=True):
        view = View(given["size"], given["rotation"], "circle")
        frame = make_frame([Polygon(result["rings"][0], result["rings"][1:])], view)
        if any("cross" in reason for _, reason in (*frame.repaired, *frame.dropped)):
            assert not result["valid"]
            continue
        assert result["valid"]
        assert (read_points(result) == frame.points).all()
        placed += 1
    assert placed > 200


def test_counts_are_those_of_the_reference():
    ways = 0
    for result in cases()[1]:
        points = read_points(result)
        for way in result["ways"].values():
            triangles = np.array(way["rows"], np.int32).reshape(-1, 3)
            expected, counts = count_per_triangle(points, triangles), way["counts"]
            for name in SHADED:
                assert counts[name] == expected[name].sum()
            assert counts["covering_triangles"] == (expected["fragments"] > 0).sum()
            assert counts["vertex_batches"] == count_batches(triangles)[0]
            for limit in (5, 32):
                batches, _ = count_batches(triangles, limit, limit + 2)
                assert way[f"batches {limit}"] == batches
            ways += 1
    assert ways > 800


@pytest.mark.parametrize(
    ("way", "criterion", "error"),
    [("optimal", "half_perimeter", 0), ("quads", "expected_quads", 1e-12)],
)
def test_optima_have_the_cost_of_pythons_optimum(way, criterion, error):
    compared = 0
    for result in cases()[1]:
        if way not in result["ways"]:
            continue
        polygon = Polygon(read_points(result) / SUBPIXEL)
        own = np.array(result["ways"][way]["rows"]).reshape(-1, 3)
        rows = triangulate(polygon, f"optimal:{criterion.replace('_', '-')}")
        costs = [criteria.predict(vertices(polygon), r)[criterion] for r in (own, rows)]
        assert costs[0] == pytest.approx(costs[1], rel=error, abs=0)
        compared += 1
    assert compared > 180


def test_validity_is_that_of_shapely():
    """Random polygons with holes on a coarse grid, where rings often touch, cross and overlap."""
    random = np.random.default_rng(8)
    polygons = [Polygon([(0, 0), (9, 0), (9, 9), (0, 9)]).wkt]
    for _ in range(2500):
        side, holes = random.integers(4, 9), random.integers(0, 4)
        shell = random.integers(0, side, (random.integers(3, 7), 2))
        if random.random() < 0.8:
            shell = np.array([(0, 0), (side, 0), (side, side), (0, side)])
        rings = [shell, *(random.integers(0, side + 1, (3 + k % 2, 2)) for k in range(holes))]
        polygons.append(Polygon(rings[0], rings[1:]).wkt)
    expected = shapely.is_valid(shapely.from_wkt(polygons))
    code = """
        return given.map((text) => {
            const rings = readWkt(text)[0].map(removeRepeats);
            const fault = findFault(rings), lists = fault ? {} : triangulateByMethods({
                rings: rings.map((ring) => ring.map(([x, y]) => [256 * x, 256 * y])),
                points: rings.flat(2).map((value) => 256 * value), ends: listRingEnds(rings),
            });
            return [fault, ["ears", "refined", "flipped"].map((name) => Boolean(lists[name]))];
        });
    """
    results = run_js(code, polygons)
    for wkt, is_valid, (fault, covered) in zip(polygons, expected, results, strict=True):
        assert (fault is None) == is_valid, (wkt, fault)
        assert not is_valid or all(covered), wkt
    assert 400 < sum(expected) < 2000


def test_links_restore_the_polygon():
    """A link also has size and rotation; truncated and hostile links are invalid."""
    given, results = cases()
    links = [result["link"] for result in results]
    read = "return given.map((link) => fromLink(link));"
    for view, result, restored in zip(given, results, run_js(read, links), strict=True):
        assert restored | {"text": view["text"]} == view | {"rings": result["rings"]}
    truncated = [links[0][:end] for end in range(len(links[0]))]
    many = f"64/{'9' * 400}/0-0-a-0-0-a/"
    invalid = [*truncated, "64/0/zz/", "64/0/1-1-2-2/", "x/0/1-1-2-2-3-4/", many]
    assert run_js(read, invalid) == [None] * len(invalid)


SQUARE = "0 0,9 0,9 9,0 9,0 0"


L_SHAPE = Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 4), (0, 4)])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("POLYGON ((0 0, 6 0, 6 2, 2 2, 2 4, 0 4, 0 0))", L_SHAPE),
        ("0,0 6,0 6,2 2,2 2,4 0,4", L_SHAPE),
        ("[0,0, 6,0, 6,2, 2,2, 2,4, 0,4]", L_SHAPE),
        ("[[0,0], [6,0], [6,2], [2,2], [2,4], [0,4]]", L_SHAPE),
        ("[[[0,0], [6,0], [6,2], [2,2], [2,4], [0,4]]]", L_SHAPE),
        ("M0 0h6v-2h-4v-2H0z", L_SHAPE),
        ('<svg><path d="M 0 0 L6 0 6-2 2-2 2-4 0-4Z"/></svg>', L_SHAPE),
        ('<polygon points="0,0 6,0 6,-2 2,-2 2,-4 0,-4"/>', L_SHAPE),
        (shapely.to_geojson(shapely.affinity.scale(L_SHAPE, 400, 400)), L_SHAPE),
        (
            "MULTIPOLYGON(((0 0,1 0,1 1,0 0)),((0 0,9 0,9 9,0 9,0 0),(3 3,3 6,6 6,3 3)))",
            Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(3, 3), (3, 6), (6, 6)]]),
        ),
        (
            "M0 0H9V9H0ZM3 3V6H6Z",
            Polygon([(0, 0), (9, 0), (9, -9), (0, -9)], [[(3, -3), (3, -6), (6, -6)]]),
        ),
        (
            "M0 0H9V9H0ZM2 2V7H7V2ZM4 4H5V5H4Z",  # an island in the hole is another polygon
            Polygon([(0, 0), (9, 0), (9, -9), (0, -9)], [[(2, -2), (2, -7), (7, -7), (7, -2)]]),
        ),
    ],
)
def test_texts_are_read(text, expected):
    """Polygons equal those of shapely up to position and scale, which the page normalises."""
    rings = run_js("return readPolygon(given).rings;", text)
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
    found = run_js("return readPolygon(given);", make_geojson(boxes))
    low_x, low_y, high_x, high_y = Polygon(found["rings"][0]).bounds
    assert high_x - low_x == pytest.approx(high_y - low_y, rel=1e-5)
    assert found["note"] == "2 polygons: choose one below."
    assert found["degrees"] is True


def test_degrees_are_recognised_in_every_format():
    """WKT has no reference system: the coordinates decide, unless the user does."""
    footprint = Polygon([(24.93, 60.17), (24.932, 60.17), (24.932, 60.171), (24.931, 60.1705)])
    written = [shapely.to_geojson(footprint), f"SRID=4326;{footprint.wkt}"]
    asked = [[text, None] for text in (*written, footprint.wkt)] + [[footprint.wkt, False]]
    code = "return given.map(([text, degrees]) => readPolygon(text, degrees));"
    one, two, three, plain = run_js(code, asked)
    assert one["rings"] == two["rings"] == three["rings"] != plain["rings"]
    assert [each["degrees"] for each in (one, two, three, plain)] == [True, True, True, False]
    for text, degrees in (("0 0, 700 0, 0 700", None), ("0 0, 9 0, 9 9", False)):
        assert run_js("return readPolygon(given).degrees;", text) is degrees
    copied = run_js("const p = readPolygon(given); return toWkt(p.rings, p.degrees);", written[0])
    assert copied.startswith("SRID=4326;")


@pytest.mark.parametrize(
    "text",
    [
        "POLYGON ((24.93 60.17, 24.932 60.17, 24.932 60.1712, 24.93 60.17))",
        "POLYGON ((386054.25 6672087.5, 386104.5 6672073, 386080 6672101.25, 386054.25 6672087.5))",
        "POLYGON ((0 0, 9 1, 8 6, 4 3, 1 7, 0 0), (5 2, 6 2, 7 4, 5 2))",
    ],
)
def test_a_polygon_is_copied_in_its_original_coordinates(text):
    """Coordinates of the text are restored to the last decimal, in degrees and in other units."""
    code = """
        const read = (degrees) => readPolygon(given, degrees);
        const write = ({rings, toSource}) => toWkt(rings.map((ring) => ring.map(toSource)));
        return [false, true].map(read).map(write);
    """
    expected = shapely.from_wkt(text)
    for copied in run_js(code, text):
        assert shapely.equals(shapely.from_wkt(copied), expected)


SHAPES = """
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">
<defs><rect width="90" height="90"/></defs>
<g transform="translate(10 5) rotate(30,4,4)" fill="#fff"><rect id="a" x="1" width="20" height="9"/>
<rect id="b" width="20" height="12" rx="4" style="transform: translateX(3px) scale(2)"/></g>
<circle id="c" cx="1in" cy="5mm" r="7" transform="matrix(1 .2 0 1 100-50)skewX(9)"/>
<ellipse id="d" rx="9" ry="4" fill="none" style="fill: red"/><polyline id="e" points="0,0 9,1 4 8"/>
<path id="f" d="M0 0H100V100H0Z M10 10H90V90H10Z M30 30V70H70V30Z"/>
<path id="g" fill-rule="evenodd" d="M0 0H100V100H0Z M10 10H90V90H10Z M30 30V70H70V30Z"/>
<path id="h" d="M0 0C9 0 9 9 0 20S-9 30-20 20a25 15 20 11-9-30z" stroke="none"/>
<rect id="i" width="9" height="9" fill="rgba(0,0,0,0)"/>
<rect id="j" width="9" height="9" opacity="0"/>
<g display="none"><rect id="k" width="9" height="9"/></g><!-- <rect width="9" height="9"/> -->
<rect id="l" width="9" height="9" transform="translateX(2)"/>
<path id="m" d="M0 0Q5 8 10 0T20 0V-9H0Z M30 5A5 5 0 0 1 40 5A5 5 0 0 1 30 5Z"/></svg>
"""


def test_svg_shapes_are_those_of_the_program(tmp_path):
    """Each shape has the area that the SVG reader finds: transforms, fill rules, invisible ones."""
    file = tmp_path / "shapes.svg"
    file.write_text(SHAPES)
    scene = read(file)
    expected = dict.fromkeys(scene.attributes["id"], shapely.Polygon())
    for name, polygon in zip(scene.attributes["id"], scene.polygons, strict=True):
        expected[name] = expected[name].union(polygon)
    areas = dict.fromkeys(expected, shapely.Polygon())
    for shape in run_js("return readSvg(given.trim()).polygons;", SHAPES):
        rings = [[(x, -y) for x, y in ring] for ring in shape["rings"]]
        name = shape["label"].split()[1]
        areas[name] = areas[name].union(Polygon(rings[0], rings[1:]))
    assert areas.keys() == expected.keys() == set("abcdefghm")
    for name, area in expected.items():
        assert area.symmetric_difference(areas[name]).area < 2e-3 * area.area, name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello", "not WKT"),
        ('{"type": "Polygon"', "not valid JSON"),
        ('{"type": "Point", "coordinates": [0, 0]}', "no polygon with an area"),
        ("POLYGON ((0 0, 1 1, 2 2, 0 0))", "no polygon with an area"),
        ('{"type": "Polygon"}', "no polygon with an area"),
        ('{"type": "Polygon", "coordinates": [[1, 2, 3]]}', "is not a number"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], ["9", 9]]]}', "is not a number"),
        ("POLYGON ((0, 1 1, 2 2))", "fewer than two coordinates"),
        ("POLYGON ((0 0, 10 1, 12 7, 9", "truncated"),
        ("POINT (3 4)", "not a polygon"),
        (",".join(f"{x} {x * x}" for x in range(3000)), "has 3,000 vertices in 1 ring"),
        (f"POLYGON(({SQUARE}){f',({SQUARE})' * 20_000})", "has 80,004 vertices in 20,001 rings"),
        (f"<svg><path d='{'M0 0h9v9z' * 20_000}'/></svg>", "has more than 2,000 vertices"),
        ("POLYGON" + "(" * 5_000_000, "too many opening parentheses"),
        ("[" * 1_000_000 + "]" * 1_000_000, "no polygon with an area"),
        ("<svg>" + "<g>" * 100_000, "SVG is truncated"),
        ("<svg " + "a" * 2_000_000, "SVG is truncated"),
        ("<svg><rect width='9' height='9' transform='tilt(3)'/></svg>", "unsupported transform"),
        ("<svg><rect width='9' height='9' clip-path='url(#a)'/></svg>", "has a clip path"),
        ("M0 0h9v9h9x", "invalid path data"),
        ("1" * 21_000_000, "has 21,000,000 characters"),
    ],
)
def test_texts_without_a_usable_polygon_are_refused(text, message):
    code = "try { readPolygon(given); return ''; } catch (error) { return error.message; }"
    assert message in run_js(code, text)
