"""Figures, tables, charts and generated parts of the documents equal their sources."""

import re

import pytest

from docs.figures import INLINE, ROOT, format_value, render, without_comments
from docs.generate import filled, pages
from docs.results import csv, gain, select
from harness.study.replication import CLAIMS
from scripts.charts import CHARTS, render_svg
from scripts.pictures import PICTURES, choose_polygon, draw_picture

TABLE = """<!-- table
rows triangulator=delaunay,H
cells csv skybox/savings.csv cycles device=skybox scene=cad resolution=64,256 :.2f
bold min column
-->

| | 64 px | 256 px |
|---|---|---|

<!-- end -->
"""


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_every_page_is_up_to_date(page):
    """`make documents` writes what this test compares."""
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text


def test_a_wrong_figure_is_overwritten():
    text = "".join((ROOT / name).read_text() for name in ("README.md", "docs/findings.md"))
    marked = INLINE.findall(text)
    assert len(marked) > 70
    wrong = INLINE.sub(lambda match: f"7.77<!-- = {match[2]} -->", text)
    assert INLINE.findall(wrong) != marked
    assert INLINE.findall(render(wrong)) == marked


def test_words_around_a_figure_are_free():
    comment = "<!-- = gain city 1024 H :.2f -->"
    expected = f"{gain('city', 1024, 'optimal:half-perimeter'):.2f}"
    for sentence in ("It takes 3{}.", "(**+1.5{}**)", "Write: {}, then\n-{} times"):
        rendered = render(sentence.replace("{}", comment))
        assert rendered.count(f"{expected}{comment}") == sentence.count("{}")
        words = re.sub(rf"[-+]?[\d.]*{comment}", "{}", rendered)
        assert words == re.sub(r"[-+]?[\d.]*{}", "{}", sentence)
        assert comment not in without_comments(rendered)


def test_wrong_rows_of_a_table_are_overwritten():
    row = render(TABLE).splitlines()[9]
    assert row.startswith("| best for H | **")
    assert render(render(TABLE).replace(row, "| best for H | 1 | 2 |")) == render(TABLE)


def test_a_ratio_can_be_written_as_a_saving():
    written = [format_value(value, spec) for value, spec in [(0.5, "-%"), (1.02, "+.1%")]]
    assert written == ["50", "2.0"]
    assert format_value(-0.00001, ".2f") == "0.00"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3<!-- = gain mars 1024 H :.2f -->", "gain mars 1024 H :.2f.: .*no row with"),
        ("3<!-- = weight city -->", "weight city"),
        ("3<!-- = csv skybox/squares.csv draws -->", "values instead of one"),
        (TABLE.replace("| 64 px | 256 px |", "| 64 px |"), "differ in length"),
    ],
)
def test_a_figure_that_cannot_be_computed_is_named(text, message):
    with pytest.raises(ValueError, match=message):
        render(text)


@pytest.mark.parametrize("name", sorted({**CHARTS, **PICTURES}))
def test_charts_and_pictures_are_up_to_date(name):
    stored = (ROOT / "docs" / "images" / f"{name}.svg").read_text(encoding="utf-8")
    assert stored == (render_svg(CHARTS[name]) if name in CHARTS else draw_picture(*PICTURES[name]))


def test_the_polygons_of_pictures_are_at_their_quantiles():
    for quantile in (0.5, 1.0):
        (polygon,) = csv("gallery.csv", "polygon", scene="city", quantile=quantile)
        assert polygon == choose_polygon("city", quantile)


CORRELATIONS = "llvmpipe/validate-city/correlations.csv"


def ranks(measure, *criteria, rasteriser="opengl"):
    columns = "value/ci_low/ci_high"
    where = {"measure": measure, "statistic": "spearman_within", "rasteriser": rasteriser}
    found = (csv(CORRELATIONS, columns, criterion=name, **where)[0] for name in criteria)
    return [f"{number:.3f}" for interval in found for number in interval]


def worst_turned(triangulator):
    rows = select("llvmpipe/gains-rotation/summary.csv")
    lanes = rows.pivot(index="rotation", columns="triangulator", values="helper_lanes")
    return f"{(lanes[f'{triangulator}@0'] / lanes['ear-clipping']).max():.2f}"


def test_claims_of_replication_cite_the_files():
    h, a = "optimal:half-perimeter", "optimal:overdraw"
    walk = [
        csv("llvmpipe/orders/orders.csv", "walk", scene=scene, triangulator=h, base="delaunay")[0]
        for scene in ("helsinki", "glyphs")
    ]
    (regret,) = csv(
        "cpu/regret-city/regret.csv",
        "mean/ci_low/ci_high",
        name="expected-quads",
        measure="quads",
        resolution=1024,
    )
    expected = [  # in the order of the claims
        ranks("helper_lanes", "expected_quads"),
        ranks("helper_lanes", "half_perimeter", "overdraw"),
        ranks("time_work_0", "half_perimeter", "overdraw"),
        ranks("bbox_tests", "overdraw", rasteriser="bounding-box")[:1],
        ranks("helper_lanes", "shape"),
        [f"{gain('city', 1024, h):.3f}"],
        [f"{gain('city', 1024, h, 'delaunay'):.3f}"],
        [f"{ratio:.3f}" for ratio in walk],
        [f"{100 * number:.2f}" for number in regret],
        [worst_turned(h)],
        [worst_turned(a)],
    ]
    assert [re.findall(r"\d+\.\d+", claim.reference) for claim in CLAIMS] == expected
