"""Accessibility of the report: colour schemes, small windows, print, keyboard, screen readers."""

import itertools

import pytest

CONTRAST = """(() => {
  const light = (colour) => {
    const part = colour.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255);
    const [r, g, b] = part.map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (a, b) => {
    const [low, high] = [light(styled(a)), light(styled(b))].sort((p, q) => p - q);
    return (high + 0.05) / (low + 0.05);
  };
  const found = [];
  for (const ink of ["--ink", "--soft", "--accent", "--good", "--bad"]) {
    for (const paper of ["--paper", "--panel"]) found.push([ink, paper, ratio(ink, paper)]);
  }
  return found;
})()"""

NAMED = {"button", "combobox", "checkbox", "slider", "searchbox"}
NAMED |= {"table", "image", "link", "region"}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_has_contrast_in_both_colour_schemes(browser, folder, scheme):
    browser.prefer(scheme)
    browser.open(folder / "report.html")
    assert browser.evaluate("state.dark") is (scheme == "dark")
    for ink, paper, ratio in browser.evaluate(CONTRAST):
        assert ratio >= 4.5, (scheme, ink, paper)


def test_colours_can_differ_from_the_systems(page):
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    for _ in range(2):
        page.evaluate("document.getElementById('theme').click()")
    after = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert page.evaluate("document.getElementById('theme').textContent") == "Colours: dark"
    assert before != after
    assert page.evaluate("state.dark") is True


def test_page_has_landmarks_names_and_headings(page):
    page.send("Accessibility.enable")
    nodes = [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in page.send("Accessibility.getFullAXTree")["nodes"]
        if not node.get("ignored")
    ]
    page.send("Accessibility.disable")
    roles = [role for role, _ in nodes]
    for landmark in ("banner", "main", "navigation", "contentinfo", "form"):
        assert roles.count(landmark) == 1, landmark
    nameless = [role for role, name in nodes if role in NAMED and not name.strip()]
    assert nameless == []
    levels = page.evaluate("[...document.querySelectorAll('h1,h2,h3')].map((h) => +h.tagName[1])")
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(later - earlier <= 1 for earlier, later in itertools.pairwise(levels))


def test_structure_of_the_page_is_valid(page):
    names = page.evaluate("[...document.querySelectorAll('[id]')].map((e) => e.id)")
    assert len(names) == len(set(names))
    assert page.evaluate("document.documentElement.lang") == "en"
    bare = "[...document.querySelectorAll('table')].filter((t) => !t.querySelector('th[scope]'))"
    assert page.evaluate(f"{bare}.length") == 0
    broken = (
        "[...document.querySelectorAll('a[href^=\"#\"]')]"
        ".filter((a) => !document.querySelector(a.getAttribute('href'))).length"
    )
    assert page.evaluate(broken) == 0


def test_tab_goes_through_the_page_from_top_to_bottom(page):
    page.evaluate("document.body.focus()")
    tops, seen = [], []
    for _ in range(60):
        page.press("Tab", 9)
        seen.append(page.evaluate("document.activeElement.className || document.activeElement.id"))
        top = "document.activeElement.getBoundingClientRect().top + scrollY"
        tops.append(page.evaluate(top))
        if page.evaluate("document.activeElement.id") == "find":
            break
    assert seen[0] == "skip"
    assert {"chart", "split", "find"} <= set(seen)
    order = [top for top, name in zip(tops, seen, strict=True) if name != "skip"]
    jumps = [b - a for a, b in itertools.pairwise(order)]
    assert min(jumps) > -700, "focus jumps far back"


@pytest.mark.parametrize("width", [320, 360, 400, 768, 1200, 1400, 1920])
def test_page_charts_and_ranking_fit_the_window(browser, folder, width):
    browser.prefer("dark" if width == 768 else "light")
    browser.resize(width, 900)
    browser.open(folder / "report.html")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    styles = browser.evaluate("chart.plot.getOption().title.map((title) => title.textStyle)")
    room = width if width < 700 else width / 2
    assert len(styles) == 2
    assert all(0 < style["width"] < room and style["overflow"] == "break" for style in styles)
    heads = "[...document.querySelectorAll('.ranking thead')].map((head) => head.offsetHeight)"
    assert max(browser.evaluate(heads)) < 110  # four lines
    cells = "[...document.querySelectorAll('.ranking .key')].map((key) => key.closest('tr'))"
    named = f"{cells}.every((row) => row.cells.length > 4 && row.textContent.length > 20)"
    assert browser.evaluate(named) is True
    too_wide = "(box) => box.querySelector('table.ranking') && box.scrollWidth > box.clientWidth"
    assert browser.evaluate(f"[...document.querySelectorAll('.scroll')].some({too_wide})") is False
    assert browser.evaluate("document.querySelectorAll('.scroll table.ranking').length") > 0


def test_chart_first_shows_helper_lanes_by_their_estimate(page):
    criteria = page.evaluate("['a', 'b'].map((side) => $(`criterion-${side}`).value)")
    assert criteria[0] == "helper_lanes_by_quads"
    assert criteria[1] != criteria[0]
    main = page.evaluate("group().main")
    assert page.evaluate("state.report.estimates.helper_lanes_by_quads") == main


def test_print_is_on_white_with_all_facts(browser, folder, tmp_path):
    browser.prefer("dark")
    browser.open(folder / "report.html")
    browser.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert browser.evaluate("state.dark") is False
    assert browser.evaluate("document.querySelector('details').open") is True
    browser.evaluate("dispatchEvent(new Event('afterprint'))")
    assert browser.evaluate("state.dark") is True
    content = browser.print(tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert len(content) > 20_000
