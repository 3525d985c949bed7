"""Every output of every scenario is what its readers accept: Jenkins, GitHub, JSON, browsers."""

import contextlib
import json
import re
from pathlib import Path

import jsonschema
import pytest
from lxml import etree
from markdown_it import MarkdownIt

from harness.compare.comparison import compare_runs, no_baseline
from harness.compare.model import Settings
from harness.compare.outputs import (
    MARKER,
    MAX_COMMENT_LENGTH,
    to_html,
    to_json,
    to_junit,
    to_markdown,
)
from harness.compare.wording import format_headline
from harness.results.run_folder import read_run
from tests.chromium import LOADED
from tests.compare.runs import SCENARIOS, TRIANGULATORS, costlier, failed, slower, write_run
from tests.paths import ROOT

SCHEMA = json.loads((ROOT / "docs/ci/compare.schema.json").read_text())
XSD = etree.XMLSchema(etree.parse(Path(__file__).parent / "junit.xsd"))


@pytest.fixture(scope="module", params=SCENARIOS)
def comparison(request, tmp_path_factory):
    with contextlib.chdir(tmp_path_factory.mktemp(request.param)):
        SCENARIOS[request.param].make()
        head = read_run(Path("head"))
        if not Path("base").exists():
            return no_baseline("base", head, Settings())
        return compare_runs(read_run(Path("base")), head)


@pytest.fixture
def nasty(tmp_path):
    """A comparison whose names and reasons are all that markup dislikes."""
    names = (
        "a|b`c",
        "<img src=x onerror=alert(1)>",
        "*bold* [x](y)",
        "tab\there",
        "nul\x00bell\x07",
    )
    reason = "]]> & <script>alert(1)</script> | `code` @someone #1 \x1b[31m"

    def rename(name):
        def edit(entry):
            entry["triangulator"] = name
            if name == "tab\there":
                failed("failed", reason)(entry)
            else:
                costlier(0.1)(entry)

        return edit

    def only_name(name):
        return lambda entry: entry.update(triangulator=name)

    pairs = dict(zip(TRIANGULATORS, names, strict=True))
    edits = {key: only_name(name) for key, name in pairs.items()}
    base = write_run(tmp_path / "base", seed=1, edits=edits)
    edits = {key: rename(name) for key, name in pairs.items()}
    return compare_runs(read_run(base), read_run(write_run(tmp_path / "head", seed=2, edits=edits)))


def valid_junit(text: str) -> etree._Element:
    tree = etree.fromstring(text.encode())
    XSD.assertValid(tree)
    return tree


def test_junit_is_valid_and_counts_its_tests(comparison):
    tree = valid_junit(to_junit(comparison))
    for suite in tree:
        assert int(suite.get("tests")) == len(suite.findall("testcase"))
    troubled = tree.findall(".//failure") + tree.findall(".//error")
    assert bool(troubled) == (comparison.verdict == "regression")
    for case in comparison.cases:
        name = case.id.name
        assert any(test.get("name").startswith(name) for test in tree.iter("testcase"))


def test_inconclusive_is_never_a_passed_test(comparison):
    tree = etree.fromstring(to_junit(comparison).encode())
    noisy = {
        f"{case.id.name}: time"
        for case in comparison.compared()
        if case.time is not None and case.time.outcome == "inconclusive"
    }
    skipped = {t.get("name") for t in tree.iter("testcase") if t.find("skipped") is not None}
    assert noisy <= skipped


def test_json_follows_its_schema(comparison):
    content = json.loads(json.dumps(to_json(comparison), allow_nan=False))
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.Draft202012Validator(SCHEMA).validate(content)
    assert content["exit_code"] == comparison.exit_code


def render(markdown: str) -> etree._Element:
    """Render as GitHub does: tables, and HTML blocks left in."""
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown)
    return etree.fromstring(f"<body>{html}</body>", etree.XMLParser(recover=False))


def test_markdown_renders_with_the_verdict_first(comparison):
    text = to_markdown(comparison)
    page = render(text)
    first = "".join(page[0].itertext()).strip()
    assert page[0].tag == "p"
    assert first == " ".join(format_headline(comparison).split())
    for table in page.iter("table"):
        widths = {len(row) for row in table.iter("tr")}
        assert len(widths) == 1
    assert text.count("<details>") == len(page.findall(".//details"))
    assert text.rstrip().endswith(MARKER)


def test_markup_in_names_and_reasons_stays_text(nasty):
    page = render(to_markdown(nasty))
    assert not list(page.iter("img", "script"))
    shown = " ".join("".join(cell.itertext()) for cell in page.iter("td"))
    assert "a|b`c" in shown
    assert "<img src=x onerror=alert(1)>" in shown
    assert "*bold* [x](y)" in shown
    assert not re.search("[\x00-\x09\x0b-\x1f]", to_markdown(nasty))
    valid_junit(to_junit(nasty))
    html = to_html(nasty)
    assert "<script" not in html
    assert "<img" not in html


def test_markdown_of_many_cases_fits_a_comment_and_says_what_it_left_out(tmp_path):
    runs = []
    for name, seed in (("base", 1), ("head", 2)):
        folder = write_run(tmp_path / name, seed=seed, edits={"fan": costlier(0.1 * (seed - 1))})
        lines = (folder / "cases.jsonl").read_text().splitlines()
        many = []
        for size in range(40):
            for line in lines:
                entry = json.loads(line)
                entry |= {"resolution": 100 + size, "key": f"{len(many):016x}"}
                many.append(json.dumps(entry))
        (folder / "cases.jsonl").write_text("\n".join(many) + "\n")
        runs.append(read_run(folder))
    comparison = compare_runs(*runs)
    text = to_markdown(comparison, limit=20_000)
    whole = to_markdown(comparison)
    assert len(text) <= 20_000 < len(whole) <= MAX_COMMENT_LENGTH
    left = whole.count("<details>") - text.count("<details>")
    assert f"{left} tables omitted" in text
    least = len(whole) + 200 - len(f"\n\n{MARKER}\n")  # with room for what says that it is cut
    assert to_markdown(comparison, least) == whole
    assert "1 table left out" in to_markdown(comparison, least - 1)
    assert all(len(to_markdown(comparison, size)) <= size for size in range(3000, 20_000, 600))
    assert text.startswith("**Regression:** fan, city 100 px, opengl on llvmpipe: helper lanes")
    assert len(list(render(text).iter("table"))) > 10


def test_html_asks_for_nothing(comparison):
    page = to_html(comparison)
    # Names of XML namespaces and the like are no requests.
    attributes = re.findall(r'\b(?:src|href|action|poster|data|srcset)\s*=\s*"([^"]*)"', page)
    assert all(value.startswith(("#", "data:")) for value in attributes)
    assert not re.search(r"@import|url\((?!#)|<script|<iframe|<link(?! rel=\"icon\")", page)
    timed = any(case.time and case.time.ratio for case in comparison.cases)
    assert ("<svg" in page) == timed


def test_markdown_calls_nobody_and_obeys_nothing(tmp_path):
    """In a table, in a heading that is folded, in a fact: names are text."""
    name = "@someone \x1b[31m\u202e#7 <b>"

    def rename(entry):
        entry.update(triangulator=name, scene=name)

    edits = {next(iter(TRIANGULATORS)): rename}
    runs = [write_run(tmp_path / each, seed=1, edits=edits) for each in ("base", "head")]
    text = to_markdown(compare_runs(*map(read_run, runs)))
    assert text.count("someone") >= 2
    assert "@someone" not in text
    assert "#7" not in text.replace("\\#7", "")
    assert "<b>" not in text.replace("\\<b\\>", "")
    assert all(letter.isprintable() or letter in "\n\u200b" for letter in text)


def test_times_are_drawn_beside_their_figures(tmp_path):
    """Of each case that was timed: its interval, its ratio, and the threshold about 1."""

    def untimed(entry):
        del entry["time"]

    edits = {"optimal:overdraw": slower(0.4), "fan": untimed}
    runs = [write_run(tmp_path / f"{bool(e)}", seed=1 + bool(e), edits=e) for e in ({}, edits)]
    found = compare_runs(*map(read_run, runs), Settings(thresholds={"time": 0.25}))
    page = to_html(found)
    drawn = {}
    for row in re.findall('<tr class="[a-z]+"><td>([^<]+)</td>(.*?)</tr>', page, re.DOTALL):
        name, cells = row
        if "<svg" in cells:
            pattern = r'band" x="(.*?)" width="(.*?)".*?M80 .*?M(.*?) 6H(.*?)"/>.*?cx="(.*?)"'
            drawn[name] = [float(each) for each in re.search(pattern, cells, re.DOTALL).groups()]
    times = {case.id.name: case.time for case in found.compared()}
    times.pop("fan")  # it was not timed
    assert drawn.keys() == times.keys()
    reach = max(abs(end - 1) for time in times.values() for end in (time.low, time.high))
    for name, time in times.items():
        ends = [80 + 76 * (end - 1) / reach for end in (time.low, time.high, time.ratio)]
        band = [80 - 76 * 0.25 / reach, 152 * 0.25 / reach]
        assert drawn[name] == pytest.approx([*band, *ends], abs=0.051)
        assert 0 <= drawn[name][2] <= drawn[name][3] <= 160


def test_the_page_is_quiet_and_self_contained(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SCENARIOS["real-regression"].make()
    page = tmp_path / "page.html"
    page.write_text(to_html(compare_runs(read_run(Path("base")), read_run(Path("head")))))
    browser.open(page, LOADED)
    assert browser.errors == []
    assert browser.requests == [page.as_uri()]
    assert browser.evaluate("document.querySelectorAll('svg').length") == 5
    assert browser.evaluate("document.querySelector('h1').className") == "regression"


def test_this_test_would_notice(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text('<!DOCTYPE html><title>bad</title><img alt="">')
    browser.open(page, LOADED)
    assert browser.errors == []
    browser.evaluate("console.error('noticed')")
    ask = "document.images[0].src = 'http://127.0.0.1:9/a.png'; document.images[0].decode()"
    assert browser.evaluate(f"{ask}.catch(() => 'failed')") == "failed"
    assert any("noticed" in line for line in browser.errors)
    assert "http://127.0.0.1:9/a.png" in browser.requests
