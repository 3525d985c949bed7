"""The report in a browser: rendering, reaction of its parts to choices, no network requests."""

import csv
import io
import time

import pytest

from harness.results.run_folder import read_arrays, read_run
from tests.chromium import TIMEOUT_S, Chromium
from tests.records import get_rows
from tests.report.conftest import NAMES

POINT = """(() => {
  const box = document.getElementById("chart").getBoundingClientRect();
  const mark = chart.marks.toSorted((p, q) => p.x[0] - q.x[0])[0];
  const [x, y] = chart.plot.convertToPixel({seriesIndex: 0}, [mark.x[0], mark.y]);
  return [box.left + x, box.top + y, mark.polygon, mark.case.row.triangulator];
})()"""


def read_texts(page: Chromium, selector: str) -> list[str]:
    return page.evaluate(
        f"[...document.querySelectorAll({selector!r})].map((each) => each.textContent.trim())"
    )


def select(page: Chromium, name: str, value: str, event: str = "change") -> None:
    page.evaluate(f"$({name!r}).value = {value!r}; $({name!r}).dispatchEvent(new Event({event!r}))")


def read_table(page: Chromium, name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(page.evaluate(f"tables[{name!r}]()"))))


def test_report_renders_without_errors_or_requests(page, folder):
    assert read_texts(page, "h1") == ["city: cost of its triangulations when rasterised"]
    start = "Recommendation for city:buildings=60 on cpu (reference, 256 px): "
    assert page.read_text("answer").strip().startswith(start)
    assert len(read_texts(page, "#ranking tbody tr")) == len(NAMES)
    assert page.evaluate("document.querySelectorAll('#chart canvas').length") > 0
    assert page.requests == [(folder / "report.html").resolve().as_uri()]


def test_each_mark_is_in_the_series_of_its_triangulator(page):
    counts = page.evaluate(
        "chart.plot.getOption().series.filter((s) => s.type === 'scatter')"
        ".map((s) => [s.name, s.data.length])"
    )
    marks = page.evaluate("chart.marks.map((m) => m.case.row.triangulator)")
    expected = [[name, marks.count(name)] for name in NAMES]
    assert counts == expected * 2
    assert dict(expected)["ear-clipping"] == 0
    # Polygons whose triangulation is the base's are marks on 1, which are counted and not drawn.
    same = page.evaluate("chart.same")
    assert 0 < same < 60
    assert f"{same} marks on 1" in read_texts(page, "#chart-note")[0]
    select(page, "scale", "absolute")
    assert page.evaluate("chart.marks.length") > len(marks) + same


def test_conditions_change_every_part(page):
    before = read_texts(page, "#answer")
    page_options = read_texts(page, "#condition option")
    assert len(page_options) == 2
    select(page, "condition", page_options[1])
    assert "128 px, turned 30°" in read_texts(page, "#ranking caption")[0]
    assert read_texts(page, "#answer") != before
    assert page.evaluate("group().view") == "128px-30deg-box"
    assert page.evaluate("chart.marks.length") > 0
    assert "128 px" in read_texts(page, "#status")[0]


def test_hidden_triangulator_is_absent_from_chart_and_ranking(page):
    before = page.evaluate("chart.marks.length")
    names = page.evaluate("chart.marks.map((mark) => mark.case.row.triangulator)")
    hidden = names.count("delaunay")
    assert hidden > 0
    page.evaluate("document.querySelector('#names input[value=delaunay]').click()")
    assert page.evaluate("chart.marks.length") == before - hidden
    assert "delaunay" not in read_texts(page, "#ranking tbody th")
    page.evaluate("document.querySelector('#names input[value=delaunay]').click()")
    assert page.evaluate("chart.marks.length") == before


@pytest.mark.parametrize("level", ["polygons", "cases"])
@pytest.mark.parametrize("scale", ["ratio", "absolute"])
def test_marks_are_polygons_or_cases_as_ratios_or_absolute(page, level, scale):
    select(page, "level", level)
    select(page, "scale", scale)
    assert page.evaluate("chart.marks.length") > 0
    titles = page.evaluate("chart.plot.getOption().xAxis.map((axis) => axis.name)")
    expected = ("ratio to ear-clipping",) if scale == "ratio" else ("[px", "[lanes]", "[quads]")
    assert all(any(word in title for word in expected) for title in titles)


def test_hover_shows_the_case_and_a_click_opens_its_heatmap(page):
    page.evaluate("document.getElementById('chart').scrollIntoView({behavior: 'instant'})")
    x, y, polygon, name = page.evaluate(POINT)
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=x - 2, y=y)
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    page.wait("document.getElementById('chart').textContent.includes('measured')")
    tooltip = read_texts(page, "#chart")[0]
    assert name in tooltip
    assert "reference on cpu" in tooltip
    page.click(x, y)
    page.wait("document.activeElement.id === 'heatmap-title'")
    assert page.evaluate("heat.k") == polygon
    assert page.evaluate("document.getElementById('right').value") == name


def test_chart_is_accessible_by_keyboard(page):
    page.evaluate("document.getElementById('chart').focus()")
    page.press("ArrowRight", 39)
    first = read_texts(page, "#mark")[0]
    page.press("ArrowRight", 39)
    second = read_texts(page, "#mark")[0]
    assert "measured helper lanes" in first
    assert first != second
    page.press("Enter", 13)
    page.wait("document.activeElement.id === 'heatmap-title'")


def test_heatmaps_equal_the_counters(page, folder):
    run = read_run(folder)
    for record in get_rows(run):
        if record["resolution"] != 256 or record["triangulator"] == "fan":
            continue
        counted = page.evaluate(
            "(() => { const drawing = currentDrawing(); return drawing.sizes.map((_, k) => {"
            f" const map = computeMap(k, {record['triangulator']!r});"
            " return [map.fragments, map.helpers, map.tests]; }); })()"
        )
        columns = read_arrays(run, record["key"])
        assert columns is not None
        for index, name in enumerate(("fragments", "helper_lanes", "bbox_tests")):
            assert [row[index] for row in counted] == columns[name].tolist(), name


def test_slider_and_gallery_change_the_picture(page):
    select(page, "split", "20", "input")
    clip = page.evaluate("getComputedStyle(document.getElementById('canvas-right')).clipPath")
    assert "20%" in clip
    caption = read_texts(page, "#heatmap-caption")
    page.evaluate("document.querySelectorAll('#gallery button')[3].click()")
    assert read_texts(page, "#heatmap-caption") != caption
    buttons = "[...document.querySelectorAll('#gallery button')]"
    pressed = page.evaluate(f"{buttons}.map((b) => b.ariaPressed === 'true')")
    assert [index for index, is_pressed in enumerate(pressed) if is_pressed] == [3]


def test_cases_are_found_and_sorted(page):
    select(page, "find", "DELAUNAY 128", "input")
    assert read_texts(page, "#cases tbody th") == ["delaunay"]
    assert read_texts(page, "#found") == ["1 to 1 of 1"]
    select(page, "find", "256", "input")
    column = read_texts(page, "#cases thead th").index("helper lanes")
    for direction in ("ascending", "descending"):
        page.evaluate(f"document.querySelectorAll('#cases thead button')[{column}].click()")
        column_texts = read_texts(page, f"#cases td:nth-child({column + 1})")
        cells = [int(text.replace(",", "")) for text in column_texts]
        assert cells == sorted(cells, reverse=direction == "descending")
        head = f"document.querySelectorAll('#cases thead th')[{column}].ariaSort"
        assert page.evaluate(head) == direction
    select(page, "state", "failed")
    assert read_texts(page, "#found") == ["no matching case"]


def test_every_table_has_a_csv_file(page, folder):
    records = get_rows(read_run(folder))
    cases = {row["key"]: row for row in read_table(page, "cases")}
    assert set(cases) == {record["key"] for record in records}
    for record in records:
        row = cases[record["key"]]
        assert int(row["helper_lanes"]) == record["counters"]["helper_lanes"]
        assert float(row["draw_ms"]) == pytest.approx(1e3 * record["time"]["median_s"], rel=1e-5)
    ranking = read_table(page, "ranking")
    assert [row["triangulator"] for row in ranking][-1] == "fan"
    assert len(read_table(page, "chart")) == page.evaluate("chart.marks.length")
    matrix = {(row["criterion"], row["measure"]) for row in read_table(page, "matrix")}
    assert ("half_perimeter", "helper_lanes") in matrix
    pixels = read_table(page, "heatmap")
    lanes_of_maps = page.evaluate("Object.values(heat.maps).map((m) => m.fragments + m.helpers)")
    assert sum(int(row["lanes"]) for row in pixels) == sum(lanes_of_maps)
    assert any(row["fact"] == "cpu" for row in read_table(page, "environment"))
    buttons = "document.querySelectorAll('[data-csv]').length"
    assert page.evaluate(f"{buttons} === Object.keys(tables).length") is True


def test_csv_button_downloads_the_file(page, tmp_path):
    page.send("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.evaluate("document.querySelector('[data-csv=ranking]').click()")
    end = time.monotonic() + TIMEOUT_S
    while not (tmp_path / "ranking.csv").exists() and time.monotonic() < end:
        page.evaluate("new Promise((done) => setTimeout(done, 50))")
    rows = list(csv.DictReader((tmp_path / "ranking.csv").open()))
    assert {row["triangulator"] for row in rows} == set(NAMES)


def test_table_of_cases_has_pages_of_fifty(browser, large_run):
    browser.open(large_run / "report.html")
    assert read_texts(browser, "#found") == ["1 to 50 of 1,000"]
    assert browser.evaluate("state.report.cases.length") == 1_000
    select(browser, "level", "cases")
    assert browser.evaluate("chart.marks.length") == 800
    browser.evaluate("document.getElementById('after').click()")
    assert read_texts(browser, "#found") == ["51 to 100 of 1,000"]
