"""docs/try.html is current, and it does what people do to it, in Chromium."""

import base64
import gzip
import json
import re
from typing import Any

import pytest
import shapely
from shapely import Polygon

from tests.chromium import REPORT_READY, Chromium
from tests.docs.test_try_geometry import build
from tests.paths import ROOT

PAGE = ROOT / "docs" / "try.html"


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
