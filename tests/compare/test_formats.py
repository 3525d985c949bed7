"""All output formats of all scenarios are valid for Jenkins, GitHub, JSON readers and browsers."""

import contextlib
import json
import re
from pathlib import Path

import jsonschema
import pytest
from lxml import etree
from markdown_it import MarkdownIt

from harness.compare import outputs
from harness.compare.comparison import compare_runs, compare_without_baseline
from harness.compare.model import Settings
from harness.compare.wording import format_headline
from harness.results.run_folder import read_run
from tests.chromium import LOADED
from tests.compare.runs import (
    SCENARIOS,
    TRIANGULATORS,
    add_cost,
    add_time,
    make_cases,
    read_pair,
    set_failed,
)
from tests.paths import ROOT
from tests.records import make_run

SCHEMA = json.loads((ROOT / "docs/ci/compare.schema.json").read_text())
XSD = etree.XMLSchema(etree.parse(Path(__file__).parent / "junit.xsd"))


@pytest.fixture(scope="module", params=SCENARIOS)
def comparison(request, tmp_path_factory):
    with contextlib.chdir(tmp_path_factory.mktemp(request.param)):
        SCENARIOS[request.param].make()
        head = read_run(Path("head"))
        if not Path("base").exists():
            return compare_without_baseline("base", head, Settings())
        return compare_runs(read_run(Path("base")), head)


@pytest.fixture
def markup_comparison(tmp_path):
    markup = ("a|b`c", "<img src=x onerror=alert(1)>", "*bold* [x](y)")
    mention = "@someone \x1b[31m\u202e#7 <b>"
    names = (*markup, "tab\there", f"nul\x00bell\x07{mention}")
    failed = set_failed("failed", "]]> & <script>alert(1)</script> | `code` @someone #1 \x1b[31m")

    def rename(name, change):
        def edit(entry):
            entry |= {"triangulator": name, "scene": mention}
            (failed if change and name == "tab\there" else add_cost(0.1 * change))(entry)

        return edit

    base, head = (
        {key: rename(name, change) for key, name in zip(TRIANGULATORS, names, strict=True)}
        for change in (False, True)
    )
    return compare_runs(*read_pair(tmp_path, {"edits": base}, edits=head))


def valid_junit(text: str) -> etree._Element:
    tree = etree.fromstring(text.encode())
    XSD.assertValid(tree)
    return tree


def test_junit_is_valid_and_inconclusive_times_are_skipped_tests(comparison):
    tree = valid_junit(outputs.to_junit(comparison))
    for suite in tree:
        assert int(suite.get("tests")) == len(suite.findall("testcase"))
    troubled = tree.findall(".//failure") + tree.findall(".//error")
    assert bool(troubled) == (comparison.verdict == "regression")
    names = [test.get("name") for test in tree.iter("testcase")]
    for case in comparison.cases:
        assert any(name.startswith(case.id.name) for name in names)
    timed = [case for case in comparison.list_compared() if case.time is not None]
    noisy = {f"{case.id.name}: time" for case in timed if case.time.outcome == "inconclusive"}
    skipped = {t.get("name") for t in tree.iter("testcase") if t.find("skipped") is not None}
    assert noisy <= skipped


def test_json_follows_its_schema(comparison):
    content = json.loads(json.dumps(outputs.to_json(comparison), allow_nan=False))
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.Draft202012Validator(SCHEMA).validate(content)
    assert content["exit_code"] == comparison.exit_code


def render(markdown: str) -> etree._Element:
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown)
    return etree.fromstring(f"<body>{html}</body>", etree.XMLParser(recover=False))


def test_markdown_renders_with_the_verdict_first(comparison):
    text = outputs.to_markdown(comparison)
    page = render(text)
    first = "".join(page[0].itertext()).strip()
    assert page[0].tag == "p"
    assert first == " ".join(format_headline(comparison).split())
    for table in page.iter("table"):
        widths = {len(row) for row in table.iter("tr")}
        assert len(widths) == 1
    assert text.count("<details>") == len(page.findall(".//details"))
    assert text.rstrip().endswith(outputs.MARKER)


def test_markup_in_names_and_reasons_stays_text(markup_comparison):
    text = outputs.to_markdown(markup_comparison)
    page = render(text)
    assert not list(page.iter("img", "script", "b"))
    cells = " ".join("".join(cell.itertext()) for cell in page.iter("td"))
    assert "a|b`c" in cells
    assert "<img src=x onerror=alert(1)>" in cells
    assert "*bold* [x](y)" in cells
    assert text.count("someone") >= 2
    assert "@someone" not in text
    assert "#7" not in text.replace("\\#7", "")
    assert "<b>" not in text.replace("\\<b\\>", "")
    assert all(letter.isprintable() or letter in "\n\u200b" for letter in text)
    valid_junit(outputs.to_junit(markup_comparison))
    html = outputs.to_html(markup_comparison)
    assert "<script" not in html
    assert "<img" not in html


def test_markdown_fits_a_comment_and_counts_omitted_tables():
    runs = []
    for seed, edits in ((1, {}), (2, {"fan": add_cost(0.1)})):
        cases = make_cases(seed, edits)
        for case in cases:
            del case["key"]
        views = [{**case, "resolution": 100 + size} for size in range(40) for case in cases]
        runs.append(make_run(views))
    comparison = compare_runs(*runs)
    text = outputs.to_markdown(comparison, limit=20_000)
    full_text = outputs.to_markdown(comparison)
    assert len(text) <= 20_000 < len(full_text) <= outputs.MAX_COMMENT_LENGTH
    omitted = full_text.count("<details>") - text.count("<details>")
    assert f"{omitted} tables omitted" in text
    # The limit leaves room for the line about omitted tables.
    limit = len(full_text) + 200 - len(f"\n\n{outputs.MARKER}\n")
    assert outputs.to_markdown(comparison, limit) == full_text
    assert "1 table omitted" in outputs.to_markdown(comparison, limit - 1)
    sizes = range(3000, 20_000, 600)
    assert all(len(outputs.to_markdown(comparison, size)) <= size for size in sizes)
    assert text.startswith("**Regression:** fan, city 100 px, opengl on llvmpipe: helper lanes")
    assert len(list(render(text).iter("table"))) > 10


def test_html_makes_no_requests(comparison):
    page = outputs.to_html(comparison)
    # Names of XML namespaces are not requests.
    attributes = re.findall(r'\b(?:src|href|action|poster|data|srcset)\s*=\s*"([^"]*)"', page)
    assert all(value.startswith(("#", "data:")) for value in attributes)
    assert not re.search(r"@import|url\((?!#)|<script|<iframe|<link(?! rel=\"icon\")", page)
    timed = any(case.time and case.time.ratio for case in comparison.cases)
    assert ("<svg" in page) == timed


def test_html_plots_times_with_intervals(tmp_path):
    def untimed(entry):
        del entry["time"]

    runs = read_pair(tmp_path, edits={"optimal:overdraw": add_time(0.4), "fan": untimed})
    comparison = compare_runs(*runs, Settings(thresholds={"time": 0.25}))
    page = outputs.to_html(comparison)
    drawn = {}
    pattern = r'band" x="(.*?)" width="(.*?)".*?M80 .*?M(.*?) 6H(.*?)"/>.*?cx="(.*?)"'
    for row in re.findall('<tr class="[a-z]+"><td>([^<]+)</td>(.*?)</tr>', page, re.DOTALL):
        name, cells = row
        if "<svg" in cells:
            drawn[name] = [*map(float, re.search(pattern, cells, re.DOTALL).groups())]
    times = {case.id.name: case.time for case in comparison.list_compared()}
    times.pop("fan")  # it was not timed
    assert drawn.keys() == times.keys()
    reach = max(abs(end - 1) for time in times.values() for end in (time.low, time.high))
    for name, time in times.items():
        ends = [80 + 76 * (end - 1) / reach for end in (time.low, time.high, time.ratio)]
        band = [80 - 76 * 0.25 / reach, 152 * 0.25 / reach]
        assert drawn[name] == pytest.approx([*band, *ends], abs=0.051)
        assert 0 <= drawn[name][2] <= drawn[name][3] <= 160


def test_browser_fixture_records_errors_and_requests(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text('<!DOCTYPE html><title>bad</title><img alt="">')
    browser.open(page, LOADED)
    assert browser.errors == []
    browser.evaluate("console.error('noticed')")
    ask = "document.images[0].src = 'http://127.0.0.1:9/a.png'; document.images[0].decode()"
    assert browser.evaluate(f"{ask}.catch(() => 'failed')") == "failed"
    assert any("noticed" in line for line in browser.errors)
    assert "http://127.0.0.1:9/a.png" in browser.requests
