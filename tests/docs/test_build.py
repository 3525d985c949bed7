"""The site builds without warnings; its pages load no external files and fit the window."""

import json
import re
from pathlib import Path

import pytest
import yaml
from markdown import markdown

from docs import generate
from tests.chromium import LOADED
from tests.docs.blocks import pages
from tests.paths import ROOT, run_python


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("docs") / "site"
    build = ("-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", out)
    done = run_python(*build, env={"NO_MKDOCS_2_WARNING": "1"})
    assert done.returncode == 0, done.stderr
    return out


def test_pages_load_no_external_files(site):
    pattern = r'<(?:script|img|iframe|source)[^>]+src="(?:https?:)?//|<link[^>]+stylesheet[^>]+//'
    for page in site.rglob("*.html"):
        assert not re.search(pattern, page.read_text()), page.name


TOO_WIDE = """[...document.querySelectorAll("article :is(table, pre, img, svg)")]
    .filter((part) => part.getBoundingClientRect().right > innerWidth + 1)
    .map((part) => part.outerHTML.slice(0, 80))"""


def test_every_page_fits_the_window(site, browser):
    for page in sorted({*site.rglob("*.html")} - {site / "404.html", site / "try.html"}):
        browser.open(page, LOADED)
        for width in (1200, 400):
            browser.resize(width, 800)
            fits = f"{TOO_WIDE}.length === 0 && document.documentElement.scrollWidth <= {width}"
            browser.wait(f"innerWidth === {width} && {fits}")  # tables follow the event `resize`


def test_a_wide_table_becomes_a_list_in_a_narrow_window(site, browser):
    page, stacked = site / "devices.html", "document.querySelectorAll('table.stacked').length"
    labels = "[...document.querySelectorAll('table td')].every((cell) => cell.dataset.label)"
    for width, expected in ((1600, 0), (400, 4)):
        browser.resize(width, 800)
        browser.open(page, LOADED)
        assert browser.evaluate(stacked) == expected
        # The theme draws only tables without the attribute.
        assert browser.evaluate("document.querySelector('table[class=\"\"]') === null")
        assert browser.evaluate(labels)


def test_the_site_has_few_sections_with_every_page_once():
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text().partition("nav:")[2])
    assert len(nav) <= 8
    entries = [
        file for section in nav for page in next(iter(section.values())) for file in page.values()
    ]
    files = [page.relative_to(ROOT / "docs") for page in (ROOT / "docs").rglob("*.md")]
    assert sorted(entries) == sorted([*map(str, files), "try.html"])


def test_no_wrapped_line_begins_a_list():
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        last = 0
        for before, number in re.findall(r"(?=\n(.*)\n *(\d+)\. )", text):
            expected = {last + 1} - {1} if before.strip() else {1, last + 1}
            assert int(number) in expected, f"{page.name}: {number}. after {before!r}"
            last = int(number)


def test_formulas_are_typeset():
    page = "a\n\n```math\nQ \\leq \\frac{S}{4}\n```\n\n   ```math\n   x^2\n   ```\n"
    typeset = generate.typeset(page)
    assert typeset.count('<svg class="formula"') == 2
    assert 'aria-label="Q \\leq \\frac{S}{4}"' in typeset
    assert "```" not in typeset
    assert "currentColor" in typeset
    assert "#010203" not in typeset
    assert re.search(r"^   <svg", typeset, flags=re.MULTILINE)
    with pytest.raises(ValueError, match="Unknown symbol"):
        generate.typeset("```math\n\\nosuch\n```")


def test_links_of_pages_outside_docs_exist():
    for page in pages()[:2]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), (page.name, target)


def test_citation_and_issue_templates_are_valid():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    cited = {author["family-names"] for author in citation["references"][0]["authors"]}
    assert cited == {"Kryvda", "Sulema"}
    for template in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        content = yaml.safe_load(template.read_text())
        if template.name != "config.yml":
            assert {"name", "description", "body"} <= set(content), template.name


def test_the_try_page_links_to_the_site(site):
    """Outside the site, the page is a single file without links."""
    links = re.findall(r'<a href="([^"#]+)"', (site / "try.html").read_text())
    assert {"index.html", "how-to/put-it-in-your-program.html"} < set(links)
    assert all((site / link).exists() for link in links)
    assert not re.findall(r'<a href="([^"#]+)"', (ROOT / "docs" / "try.html").read_text())


TABLE = ("table", "thead", "tbody", "tr", "th", "td", "code")


def test_contributed_names_are_shown_as_text(tmp_path, monkeypatch, browser):
    """Fields of contributed profiles are untrusted: pages must show markup in them as text."""
    markup = 'x\n\n# y <img src=x onerror="1"> [here](javascript:1) {: onmouseover="1" }'
    profiles, devices = "results/reference/profiles", "results/devices"
    profile, summary = (
        json.loads((ROOT / folder / "opengl-llvmpipe.json").read_text())
        for folder in (profiles, devices)
    )
    profile["device"] |= dict.fromkeys(("name", "rasteriser", "cpu"), markup)
    profile["advice"]["triangulator"] = markup
    summary |= dict.fromkeys(("device", "driver", "cpu"), markup)
    for folder, content in ((profiles, profile), (devices, summary)):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "hostile.json").write_text(json.dumps(content))
    monkeypatch.setattr("docs.generate.ROOT", tmp_path)
    for made, times in ((generate.profiles, 4), (generate.devices, 3)):
        row = made().splitlines()[-1]
        assert row.count("&lt;img") == times
        assert not {"<", "[", "{"} & set(row)
        shown = markdown(made(), extensions=["tables", "attr_list"])
        tags = re.findall("<[^>]*>", shown)
        assert {tag.strip("</>") for tag in tags} <= {*TABLE}
        page = tmp_path / "page.html"
        page.write_text(f"<!doctype html><title>{made.__name__}</title>{shown}")
        browser.open(page, LOADED)
        assert browser.evaluate("document.body.textContent").count("onerror=") > 0
        assert browser.evaluate("document.querySelectorAll('img, [onmouseover], a').length") == 0
