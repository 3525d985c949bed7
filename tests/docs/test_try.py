"""docs/try.html: its geometry is Python's, and it does what people do to it, in Chromium."""

import base64
import gzip
import importlib.util
import json
import re
import subprocess
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from harness.frame import SUBPIXEL, View, make_frame
from harness.rasterisers.reference import predict
from scenes import load
from tests.chromium import REPORT_READY, Chromium
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.polygons import random_polygons
from triangulators import criteria, triangulate, vertices

PAGE = ROOT / "docs" / "try.html"
_spec = importlib.util.spec_from_file_location("build_try", ROOT / "docs" / "try" / "build.py")
assert _spec is not None
assert _spec.loader is not None
build = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(build)

OF_EACH = """
    return given.map(({link, size, rotation}) => {
        const {rings} = fromLink(link), placed = place(rings, size, rotation);
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
    node = languages.node()
    if node is None or languages.earcut() is None:
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
            "link": build.link(polygon),
            "size": (16, 64, 96, 256)[number % 4],
            "rotation": (0, 15, 90, 211)[number // 4 % 4],
        }
        for number, polygon in enumerate(polygons)
    ]
    return given, in_node(OF_EACH, given)


def points_of(told: dict[str, Any]) -> np.ndarray:
    return np.array(told["points"], np.int32).reshape(-1, 2)


def test_the_page_is_current_and_small():
    made = build.page()
    assert parts(PAGE.read_text()) == parts(made), (
        "make it anew: .venv/bin/python docs/try/build.py"
    )
    assert len(made.encode()) < 400_000


def parts(text: str) -> tuple[str, str, Any]:
    """Return the page, the page in it that measures a device, and its data, which are packed."""
    match = re.search(r'const PROFILE = "(.*?)";', text)
    assert match is not None
    profile = gzip.decompress(base64.b64decode(match[1])).decode()
    data = re.search(r'id="data"[^>]*>(.*?)<', profile, re.S)
    assert data is not None
    content = json.loads(gzip.decompress(base64.b64decode(data[1])))
    return text.replace(match[1], ""), profile.replace(data[1], ""), content


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
    scale = build.GRID / max(high_x - low_x, high_y - low_y)
    middle = np.array([(low_x + high_x) / 2, (low_y + high_y) / 2])
    moved = shapely.transform(expected, lambda xy: (xy - middle) * scale + build.GRID / 2)
    assert found.symmetric_difference(moved).area < 1e-5 * moved.area


def test_longitude_and_latitude_are_drawn_as_wide_as_they_are():
    """At 60 degrees north two degrees of longitude are as long as one of latitude."""
    collection = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": shapely.geometry.mapping(box(*bounds))}
            for bounds in ((0, 0, 0.1, 0.1), (20, 59.5, 22, 60.5))
        ],
    }
    found = in_node("return readPolygon(given);", json.dumps(collection))
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
        assert Polygon(ring).area / build.GRID**2 == pytest.approx(np.pi / 4, rel=0.03)
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


def opened(browser: Chromium, width: int = 1200, fragment: str = "") -> None:
    browser.resize(width, 900)
    browser.open(PAGE, REPORT_READY, fragment=fragment)


def told(browser: Chromium, part: str) -> str:
    return browser.evaluate(f"$('{part}').textContent")


def after(browser: Chromium, action: str) -> None:
    """Do something in the page, and wait until it shows the result."""
    before = browser.evaluate("Number(document.documentElement.dataset.ready)")
    browser.evaluate(f"{action}; null")
    browser.wait(f"Number(document.documentElement.dataset.ready) > {before}")


def paste(browser: Chromium, text: str) -> None:
    after(
        browser,
        f"$('text').value = {json.dumps(text)}; $('text').dispatchEvent(new Event('input'))",
    )


def test_a_new_user_pastes_a_polygon_and_reads_the_number(browser):
    """Three quarters of a disc, and what each way shades of it."""
    opened(browser)
    arc = shapely.get_coordinates(shapely.Point(0, 0).buffer(9, quad_segs=14))[:42]
    paste(browser, Polygon([(0, 0), *arc[:41]]).wkt)
    counted = "Object.entries(state.found.ways).map(([name, way]) => [name, way.counts.quads])"
    quads = dict(browser.evaluate(counted))
    saved = [1 - quads[name] / quads["ears"] for name in ("refined", "flipped", "optimal")]
    assert max(saved) > 0.01
    shares = {f"{100 * abs(each):.1f} % {'more' if each < 0 else 'fewer'}" for each in saved}
    shares = {share for share in shares if not share.startswith("0.0 %")}  # "as many"
    answer = told(browser, "answer")
    assert set(re.findall(r"[\d.]+ % (?:more|fewer)", answer)) == shares
    names = browser.evaluate("SAID")
    least = min(names, key=lambda name: quads[name])
    assert answer.startswith("Cheapest at 64 px: ")
    assert names[least] in answer.split(", with")[0]
    marked = "WAYS.map(([name]) => name).filter((name) => !panels[name].best.hidden)"
    assert set(browser.evaluate(marked)) == {name for name in quads if quads[name] == quads[least]}
    assert re.fullmatch(r"42 corners, 61 . 60 px", told(browser, "corners"))
    caption = browser.evaluate("panels.ears.caption.textContent")
    assert caption.startswith(f"{4 * quads['ears']:,} lanes for ")
    assert browser.requests == [PAGE.as_uri()]
    assert not browser.errors


def test_size_rotation_and_link_go_together(browser):
    opened(browser)
    before = told(browser, "answer")
    after(browser, "$('size').value = 8; $('size').dispatchEvent(new Event('input'))")
    after(browser, "$('rotation').value = 30; $('rotation').dispatchEvent(new Event('input'))")
    answer = told(browser, "answer")
    assert "at 256 px" in answer
    assert answer != before
    link = browser.evaluate("location.hash.slice(1)")
    assert link.startswith("256/30/")
    opened(browser, fragment=link)
    assert told(browser, "answer") == answer
    assert browser.evaluate("$('rotation').value") == "30"


def test_corners_are_dragged_added_and_removed(browser):
    opened(browser)
    paste(browser, "POLYGON ((0 0, 4 0, 4 4, 0 4, 0 0))")
    top = browser.evaluate(TOP)
    dot = "document.querySelector('[data-corner=\"2\"]').getBoundingClientRect()"
    x, y = browser.evaluate(f"(({{x, y, width}}) => [x + width / 2, y + width / 2])({dot})")
    ring = browser.evaluate("state.rings[0]")
    mouse = {"button": "left", "clickCount": 1}
    browser.send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", x=x - 60, y=y + 40, buttons=1)
    browser.send("Input.dispatchMouseEvent", type="mouseReleased", x=x - 60, y=y + 40, **mouse)
    now = browser.evaluate("state.rings[0]")
    assert [one == other for one, other in zip(ring, now, strict=True)] == [1, 1, 0, 1]
    assert now[2][0] < ring[2][0]
    assert now[2][1] < ring[2][1]
    assert browser.evaluate(TOP) == top
    browser.evaluate("$('editor').focus(); null")
    for key, corners in (("n", 4), ("Insert", 5), ("ArrowLeft", 5), ("Delete", 4), ("Delete", 3)):
        browser.press(key)
        assert len(browser.evaluate("state.rings[0]")) == corners, key
    browser.press("Delete")  # a triangle stays
    assert len(browser.evaluate("state.rings[0]")) == 3
    browser.wait("$('answer').textContent.startsWith('A triangle has one triangulation')")


def test_a_polygon_is_drawn_by_clicks(browser):
    opened(browser)
    browser.evaluate("$('draw').click(); null")
    box = browser.evaluate(
        "(({x, y, width}) => [x, y, width])($('editor').getBoundingClientRect())"
    )
    for across, down in ((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.5, 0.4), (0.2, 0.8), (0.2, 0.2)):
        browser.click(box[0] + across * box[2], box[1] + down * box[2])
    browser.wait("state.open === null && $('corners').textContent.startsWith('5 corners,')")
    assert browser.evaluate("doubledArea(state.rings[0])") > 0
    assert "px" in told(browser, "answer")


def test_a_polygon_is_drawn_by_keys(browser):
    """A cross is moved and corners are set; Escape goes back to the polygon before."""
    opened(browser)
    before = browser.evaluate("state.rings")
    browser.evaluate("$('draw').click(); null")
    browser.wait("$('ways').classList.contains('stale')")
    assert "Space sets a corner" in told(browser, "answer")
    for keys in ("ArrowLeft", "ArrowUp", "ArrowRight ArrowRight", "ArrowDown ArrowDown"):
        for key in keys.split():
            browser.press(key)
        browser.press(" ")
    assert told(browser, "corner").startswith("Cross at 510, 510")
    browser.press("Escape")
    browser.wait("!$('ways').classList.contains('stale')")
    assert browser.evaluate("state.rings") == before
    assert browser.evaluate("document.querySelectorAll('[aria-pressed=true]').length") == 1
    browser.evaluate("$('draw').click(); null")
    for key in ("Enter", " ", "ArrowUp", " ", "ArrowLeft", " "):
        browser.press(key)
    after(browser, "keyPressed(new KeyboardEvent('keydown', {key: 'Enter'}))")
    assert told(browser, "corners").startswith("3 corners,")
    browser.press("z", modifiers=2)
    browser.wait("$('corners').textContent.startsWith('67 corners,')")
    assert browser.evaluate("state.rings") == before


TOP = "$('editor').getBoundingClientRect().top"


def test_what_cannot_be_compared_is_said(browser):
    opened(browser)
    paste(browser, "POLYGON ((0 0, 4 4, 4 0, 0 4, 0 0))")  # the two halves of a bow-tie cancel
    assert told(browser, "answer").startswith("Edges of this polygon cross")
    for way in ("ears", "refined", "flipped", "optimal"):
        assert browser.evaluate(f"panels.{way}.none.textContent") == "its edges cross or touch"
    paste(browser, "POLYGON ((0 0, 9 0, 9 9, 0 9, 0 0), (3 3, 6 3, 6 6, 3 6, 3 3))")
    assert "with holes" in browser.evaluate("panels.optimal.none.textContent")
    top = browser.evaluate(TOP)
    browser.evaluate("$('text').value = 'nonsense'; $('text').dispatchEvent(new Event('input'))")
    assert "none of WKT" in told(browser, "notice")
    assert browser.evaluate(TOP) == top
    assert "the one from before" in told(browser, "notice")
    assert browser.evaluate("$('ways').classList.contains('stale')")
    answer = browser.evaluate("$('notice').getBoundingClientRect().bottom")
    assert 0 < answer < browser.evaluate("innerHeight")
    after(browser, "$('undo').click()")
    assert told(browser, "corners").startswith("4 corners,")


def test_what_matters_little_is_called_so_only_if_nothing_differs(browser):
    """A way that takes more than ear clipping is named, too."""
    opened(browser)
    sentence = """
        (saved, matters) => {
            const of = (way, i) => [way[0], {saved: [0, ...saved][i], cheapest: false}];
            const ways = Object.fromEntries(WAYS.map(of));
            const placed = {points: {length: 10}};
            return sentenceOf({simple: true, ways, matters, placed}, 64).join("");
        }
    """
    assert "does not matter" in browser.evaluate(f"({sentence})([0.004, 0.002, -0.004], false)")
    said = browser.evaluate(f"({sentence})([0.004, 0.002, -0.047], true)")
    assert "none of these saves 1 %" in said
    assert "the optimum for H 4.7 % more" in said
    assert "flips" not in said


def test_files_and_links_are_taken(browser):
    opened(browser)
    after(browser, "takeFile(new File(['0 0, 9 0, 9 9, 5 4, 0 9'], 'my.txt'))")
    assert told(browser, "corners").startswith("5 corners,")
    assert not browser.evaluate("$('degrees-label').hidden")
    before = browser.evaluate("state.rings")
    after(browser, "$('degrees').click()")
    assert browser.evaluate("state.rings") != before
    whole = browser.evaluate("link()")
    after(browser, "$('undo').click()")
    paste(browser, f"see page.html#{whole}")
    assert browser.evaluate("link()") == whole
    opened(browser, fragment=whole[:-9])
    assert "not whole" in told(browser, "notice")


def test_a_device_is_measured_in_the_page(browser):
    """The page that profiles begins by itself; without WebGPU it says so."""
    opened(browser)
    browser.evaluate("$('profile').click(); null")
    frame = "document.querySelector('iframe')?.contentDocument"
    browser.wait(f"{frame}?.documentElement?.dataset.state !== undefined")
    assert "on this device" in browser.evaluate(f"{frame}.querySelector('h1').textContent")
    assert browser.evaluate("document.querySelector('iframe').contentWindow.isSecureContext")
    assert not [each for each in browser.requests if each.startswith("http")]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 768, 1200])
def test_nothing_is_cut_off(browser, width, scheme):
    browser.prefer(scheme)
    opened(browser, width)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    small = "[...document.querySelectorAll('button')].filter((b) => b.offsetHeight < 24).length"
    assert browser.evaluate(small) == 0
    colour = browser.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, colour[4:-1].split(","))) > 384) == (scheme == "light")
