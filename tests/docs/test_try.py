"""docs/try.html in Chromium: up to date, and controlled by text, files, clicks and keys."""

import base64
import gzip
import json
import re
from typing import Any

import numpy as np
import pandas as pd
import pytest
import shapely
from shapely import Polygon

from scenes import load
from tests.chromium import REPORT_READY, Chromium
from tests.docs.test_try_geometry import build
from tests.paths import ROOT

PAGE = ROOT / "docs" / "try.html"


def test_the_page_is_current_and_small():
    built = build.render_page()
    assert split(PAGE.read_text()) == split(built), "run: .venv/bin/python docs/try/build.py"
    assert len(built.encode()) < 400_000


def split(text: str) -> tuple[str, str, Any]:
    """Return three decompressed texts: the page, the measuring page in it, and the data of that."""
    match = re.search(r'const PROFILE = "(.*?)";', text)
    assert match is not None
    profile = gzip.decompress(base64.b64decode(match[1])).decode()
    data = re.search(r'id="data"[^>]*>(.*?)<', profile, re.S)
    assert data is not None
    content = json.loads(gzip.decompress(base64.b64decode(data[1])))
    return text.replace(match[1], ""), profile.replace(data[1], ""), content


def open_page(browser: Chromium, width: int = 1200, fragment: str = "") -> None:
    browser.resize(width, 900)
    browser.open(PAGE, REPORT_READY, fragment=fragment)


def act(browser: Chromium, action: str) -> None:
    before = browser.evaluate("Number(document.documentElement.dataset.ready)")
    browser.evaluate(f"{action}; null")
    browser.wait(f"Number(document.documentElement.dataset.ready) > {before}")


def paste(browser: Chromium, text: str) -> None:
    enter(browser, "text", json.dumps(text))


def enter(browser: Chromium, part: str, value: object, event: str = "input") -> None:
    """Set the value of an element, as a user would."""
    act(browser, f"$('{part}').value = {value}; $('{part}').dispatchEvent(new Event('{event}'))")


def test_a_pasted_polygon_is_compared(browser):
    """Three quarters of a disc: the answer names the best method and all savings."""
    open_page(browser)
    act(browser, "setSize(64); requestUpdate()")
    arc = shapely.get_coordinates(shapely.Point(0, 0).buffer(9, quad_segs=14))[:42]
    paste(browser, Polygon([(0, 0), *arc[:41]]).wkt)
    methods = browser.evaluate("state.result.methods")
    quads = {name: method["counts"]["quads"] for name, method in methods.items()}
    saved = [1 - quads[name] / quads["ears"] for name in ("refined", "flipped", "optimal", "quads")]
    assert max(saved) > 0.01
    shares = {f"{100 * abs(each):.1f} % {'more' if each < 0 else 'fewer'}" for each in saved}
    shares = {share for share in shares if not share.startswith("0.0 %")}  # "as many"
    answer = browser.read_text("answer")
    assert set(re.findall(r"[\d.]+ % (?:more|fewer)", answer)) == shares
    names = browser.evaluate("NAMES")
    least = min(names, key=lambda name: quads[name])
    assert answer.startswith("Best at 64 px: ")
    assert names[least] in answer.split(", with")[0]
    marked = "METHODS.map(([name]) => name).filter((name) => !panels[name].best.hidden)"
    assert set(browser.evaluate(marked)) == {name for name in quads if quads[name] == quads[least]}
    assert re.fullmatch(r"42 vertices, 61 . 60 px", browser.read_text("vertex-count"))
    caption = browser.evaluate("panels.ears.caption.textContent")
    assert caption.startswith(f"{4 * quads['ears']:,} lanes for ")
    assert browser.requests == [PAGE.as_uri()]
    assert not browser.errors


def test_a_drawing_with_several_elements_offers_a_choice(browser):
    """Each element is a polygon; the largest is shown first, transformed as drawn."""
    open_page(browser)
    group = '<g transform="rotate(30) scale(20)"><path d="M0 0H4V3Z"/></g>'
    paste(browser, f'<svg><rect id="small" width="9" height="9"/>{group}<use href="#small"/></svg>')
    assert browser.evaluate("state.choices") == ["path 2: 3 vertices", "rect small: 4 vertices"]
    assert "2 polygons" in browser.read_text("notice")
    assert "copy of another element" in browser.read_text("notice")
    enter(browser, "choices", 1, "change")
    assert browser.read_text("vertex-count").startswith("4 vertices,")
    assert not browser.evaluate("$('choices-label').hidden")
    for button, number, count in (("previous", 0, 3), ("next", 1, 4)):
        act(browser, f"$('{button}').click()")
        assert browser.evaluate("[$('choices').value, state.choice]") == [str(number), number]
        assert browser.read_text("vertex-count").startswith(f"{count} vertices,")
        ends = browser.evaluate("[$('previous').disabled, $('next').disabled]")
        assert ends == [number == 0, number == 1]
    act(browser, "$('remove').click()")
    assert browser.evaluate("$('choices-label').hidden")
    act(browser, "$('undo').click()")
    assert browser.evaluate("$('choices').value") == "1"


def test_hostile_links_are_reported_as_invalid(browser):
    """A rotation of 400 digits was accepted, and the page showed "NaN"."""
    polygon = "0-0-1000-0-0-1000/"
    for fragment in (f"64/{'9' * 400}/{polygon}", f"{'9' * 400}/0/{polygon}", "64/0/0-0-1000"):
        open_page(browser, fragment=fragment)
        assert "truncated or invalid" in browser.read_text("notice")
        assert browser.read_text("vertex-count").startswith("8 vertices,")
        assert "NaN" not in browser.evaluate("document.body.innerText")


def test_the_page_opens_with_a_typical_polygon(browser):
    """The sentence on the share of footprints that save as much is shown for this polygon only."""
    table = pd.read_csv(build.SAVINGS)
    saved = 1 - table[build.OPTIMUM] / table[build.BASE]
    number, size, sentence = build.choose_typical()
    assert saved[number] == pytest.approx(saved.median(), abs=0.001)
    share = f"{100 * (saved >= saved[number]).mean():.0f} % of the {len(saved)} footprints"
    assert share in sentence
    open_page(browser)
    assert browser.read_text("typical") == sentence
    assert not browser.evaluate("$('typical').hidden")
    width, height = browser.evaluate("measureSize(state.result.placed.rings)")
    west, south, east, north = load("city").polygons[number].bounds
    in_scene = table["scale"][0] * np.array([east - west, north - south])
    sizes = browser.evaluate("SIZES")
    assert browser.evaluate("state.size") == min(sizes, key=lambda side: abs(side - size))
    assert np.array([width, height]) == pytest.approx(in_scene, rel=0.25)
    assert browser.evaluate("state.result.methods.quads.saving") > 0
    act(browser, "document.querySelector('[data-example=\"A letter\"]').click()")
    assert browser.evaluate("$('typical').hidden")
    assert browser.evaluate("state.size") == 64


def test_a_picture_is_saved(browser):
    open_page(browser)
    wrapped = "wrapText(document.createElement('canvas').getContext('2d'), 'a b c', 14, '9px mono')"
    assert len(browser.evaluate(wrapped)) > 1
    drawn = """(() => {
        const canvas = drawPicture(state.result), {width, height} = canvas;
        const {data} = canvas.getContext("2d").getImageData(24, 0, 400, height);
        const colours = new Set(Array.from({length: data.length / 4}, (_, i) =>
            data.slice(4 * i, 4 * i + 3).join()));
        return [width, height, colours.size];
    })()"""
    width, height, colours = browser.evaluate(drawn)
    assert width == 3 * 424 + 24
    assert height > 2 * 400
    assert colours > 10
    browser.evaluate("savePicture().then(() => null)")
    browser.wait("$('copied').textContent === 'Picture saved.'")
    browser.evaluate("$('draw').click(); null")
    browser.wait("$('picture').disabled")


def test_size_rotation_and_link_go_together(browser):
    open_page(browser)
    before = browser.read_text("answer")
    enter(browser, "size", 8)
    enter(browser, "rotation", 30)
    answer = browser.read_text("answer")
    assert "at 256 px" in answer
    assert answer != before
    link = browser.evaluate("location.hash.slice(1)")
    assert link.startswith("256/30/")
    open_page(browser, fragment=link)
    assert browser.read_text("answer") == answer
    assert browser.evaluate("$('rotation').value") == "30"


def test_vertices_are_dragged_added_and_removed(browser):
    open_page(browser)
    paste(browser, "POLYGON ((0 0, 4 0, 4 4, 0 4, 0 0))")
    top = browser.evaluate(TOP)
    dot = "document.querySelector('[data-vertex=\"2\"]').getBoundingClientRect()"
    x, y = browser.evaluate(f"(({{x, y, width}}) => [x + width / 2, y + width / 2])({dot})")
    ring = browser.evaluate("state.rings[0]")
    mouse = {"button": "left", "clickCount": 1}
    browser.send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    for kind, fields in (("mouseMoved", {"buttons": 1}), ("mouseReleased", mouse)):
        browser.send("Input.dispatchMouseEvent", type=kind, x=x - 60, y=y + 40, **fields)
    now = browser.evaluate("state.rings[0]")
    assert [one == other for one, other in zip(ring, now, strict=True)] == [1, 1, 0, 1]
    assert now[2][0] < ring[2][0]
    assert now[2][1] < ring[2][1]
    assert browser.evaluate(TOP) == top
    browser.evaluate("$('editor').focus(); null")
    for key, count in (("n", 4), ("Insert", 5), ("ArrowLeft", 5), ("Delete", 4), ("Delete", 3)):
        browser.press(key)
        assert len(browser.evaluate("state.rings[0]")) == count, key
    browser.press("Delete")  # a triangle stays
    assert len(browser.evaluate("state.rings[0]")) == 3
    browser.wait("$('answer').textContent.startsWith('A triangle has one triangulation')")


def test_a_polygon_is_drawn_by_clicks(browser):
    open_page(browser)
    browser.evaluate("$('draw').click(); null")
    browser.wait("$('vertex-count').textContent === '0 placed so far'")  # the layout is final
    corners = ((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.5, 0.4), (0.2, 0.8), (0.2, 0.2))
    # the editor does not move under the pointer, as it would during a smooth scroll
    editor = browser.evaluate("$('editor').getBoundingClientRect().toJSON()")
    x, y, side = editor["x"], editor["y"], editor["width"]
    for count, (across, down) in enumerate(corners, start=1):
        browser.click(x + across * side, y + down * side)
        browser.wait(f"state.drawing === null || state.drawing.length === {count}")
    browser.wait("state.drawing === null")
    browser.wait("$('vertex-count').textContent.startsWith('5 vertices,')")
    assert browser.evaluate("doubledArea(state.rings[0])") > 0
    assert "px" in browser.read_text("answer")


def test_a_polygon_is_drawn_by_keys(browser):
    """Keys move a cross and place vertices; Escape returns to the previous polygon."""
    open_page(browser)
    before = browser.evaluate("state.rings")
    browser.evaluate("$('draw').click(); null")
    browser.wait("$('methods').classList.contains('stale')")
    assert "Space places a vertex" in browser.read_text("answer")
    for keys in ("ArrowLeft", "ArrowUp", "ArrowRight ArrowRight", "ArrowDown ArrowDown"):
        for key in keys.split():
            browser.press(key)
        browser.press(" ")
    assert browser.read_text("announcement").startswith("Cross at 510, 510")
    browser.press("Escape")
    browser.wait("!$('methods').classList.contains('stale')")
    assert browser.evaluate("state.rings") == before
    assert browser.evaluate("document.querySelectorAll('[aria-pressed=true]').length") == 1
    browser.evaluate("$('draw').click(); null")
    for key in ("Enter", " ", "ArrowUp", " ", "ArrowLeft", " "):
        browser.press(key)
    act(browser, "onKeyDown(new KeyboardEvent('keydown', {key: 'Enter'}))")
    assert browser.read_text("vertex-count").startswith("3 vertices,")
    browser.press("z", modifiers=2)
    browser.wait("$('vertex-count').textContent.startsWith('8 vertices,')")
    assert browser.evaluate("state.rings") == before


TOP = "$('editor').getBoundingClientRect().top"


def test_invalid_polygons_and_texts_are_reported(browser):
    open_page(browser)
    for wkt, fault in (
        ("((0 0, 4 4, 4 0, 0 4, 0 0))", "self-intersects"),  # both halves together have no area
        ("((0 0, 9 0, 9 9, 0 0), (20 2, 22 2, 22 3, 20 2))", "has a hole outside its exterior"),
        ("((0 0, 9 0, 9 9, 0 9, 0 0), (5 5, 15 5, 15 7, 5 5))", "self-intersects"),
    ):
        paste(browser, f"POLYGON {wkt}")
        assert browser.read_text("answer").startswith(f"Invalid: this polygon {fault}")
        for method in ("ears", "refined", "flipped", "optimal", "quads"):
            shown = browser.evaluate(f"panels.{method}.missing.textContent")
            assert shown == "the polygon is invalid"
    paste(browser, "POLYGON ((0 0, 9 0, 9 9, 0 9, 0 0), (3 3, 6 3, 6 6, 3 6, 3 3))")
    assert "with holes" in browser.evaluate("panels.optimal.missing.textContent")
    top = browser.evaluate(TOP)
    browser.evaluate("$('text').value = 'nonsense'; $('text').dispatchEvent(new Event('input'))")
    assert "not WKT" in browser.read_text("notice")
    assert browser.evaluate(TOP) == top
    assert "the previous polygon" in browser.read_text("notice")
    assert browser.evaluate("$('methods').classList.contains('stale')")
    answer = browser.evaluate("$('notice').getBoundingClientRect().bottom")
    assert 0 < answer < browser.evaluate("innerHeight")
    act(browser, "$('undo').click()")
    assert browser.read_text("vertex-count").startswith("7 vertices,")


def test_small_differences_are_reported_as_none(browser):
    """A difference below 1 % is none; a method that takes more than ear clipping is named."""
    open_page(browser)
    sentence = """
        (savings, isDifferent) => {
            const entry = ([name], i) => [name, {saving: [0, ...savings][i], isBest: false}];
            const methods = Object.fromEntries(METHODS.map(entry));
            const placed = {points: {length: 10}};
            return describeResult({fault: null, methods, isDifferent, placed}, 64).join("");
        }
    """
    assert "No difference" in browser.evaluate(f"({sentence})([0.004, 0.002, -0.004], false)")
    answer = browser.evaluate(f"({sentence})([0.004, 0.002, -0.047], true)")
    assert "no method saves 1 %" in answer
    assert "the optimum for H 4.7 % more" in answer
    assert "flips" not in answer


def test_files_and_links_are_loaded(browser):
    open_page(browser)
    choose = """
        const chosen = new DataTransfer();
        chosen.items.add(new File(['0 0, 9 0, 9 9, 5 4, 0 9'], 'my.txt'));
        $('file').files = chosen.files;
        $('file').dispatchEvent(new Event('change'))"""
    act(browser, choose)
    assert browser.evaluate("$('file').files.length") == 0  # the same file can be chosen again
    assert browser.read_text("vertex-count").startswith("5 vertices,")
    assert not browser.evaluate("$('degrees-label').hidden")
    before = browser.evaluate("state.rings")
    act(browser, "$('degrees').click()")
    assert browser.evaluate("state.rings") != before
    link = browser.evaluate("currentLink()")
    act(browser, "$('undo').click()")
    paste(browser, f"see page.html#{link}")
    assert browser.evaluate("currentLink()") == link


def test_a_device_is_measured_in_the_page(browser):
    """The measuring page starts at once, and reports that WebGPU is missing."""
    open_page(browser)
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
    open_page(browser, width)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    small = "(b) => b.offsetParent && b.offsetHeight < 24"
    small = f"[...document.querySelectorAll('button')].filter({small}).length"
    assert browser.evaluate(small) == 0
    colour = browser.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, colour[4:-1].split(","))) > 384) == (scheme == "light")
