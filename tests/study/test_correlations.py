import numpy as np
import pandas as pd
import pytest

from harness.frame import View, make_frame
from harness.grid import SUBPIXEL
from harness.rasterisers.reference import count_per_triangle
from harness.report import matrix
from harness.report.content import make_content
from harness.report.matrix import format_best_criterion
from harness.results.run_folder import read_run
from harness.study import subjects
from harness.study.correlations import (
    IDENTIFYING_CRITERIA,
    MIN_TRIANGULATIONS,
    NOT_SIGNIFICANT,
    TIME,
    Estimate,
    compare_criteria,
    correlate_by_resolution,
    correlate_within_polygons,
    estimate_median,
    make_correlation_table,
    make_measure_table,
    plot_study,
    write_correlations,
)
from scenes import load
from tests.conftest import run_command
from tests.records import make_record
from tests.study.test_regret import make_cases
from triangulators import triangulate

RANDOM = np.random.default_rng(3)


def make_table(records: list[dict]) -> pd.DataFrame:
    return make_measure_table([make_record(**fields) for fields in records])


def rank_views(columns: list[tuple[np.ndarray, np.ndarray]], polygons: str = "") -> Estimate:
    """Return the estimate of (predicted, measured) of each view of the `polygons`."""
    rows = [
        (polygons[view] if polygons else str(view), view, *pair)
        for view, (x, y) in enumerate(columns)
        for pair in zip(x, y, strict=True)
    ]
    table = pd.DataFrame(rows, columns=["polygon", "rotation", "overdraw", "quads"])
    return estimate_median(correlate_within_polygons(table, "overdraw", "quads"))


def polygons(number: int, noise: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return columns of polygons of different sizes; within each, y follows x with noise."""
    columns = []
    for size in 2.0 ** np.arange(number):
        x = size * RANDOM.uniform(1, 2, 40)
        columns.append((x, 3 * x**2 * np.exp(noise * RANDOM.standard_normal(40))))
    return columns


def test_pooling_makes_a_useless_criterion_look_good():
    columns = [(x, RANDOM.permutation(y)) for x, y in polygons(12, 0.0)]
    rows = [(str(k), *pair) for k, (x, y) in enumerate(columns) for pair in zip(x, y, strict=True)]
    table = pd.DataFrame(rows, columns=["polygon", "overdraw", "quads"])
    table = table.assign(resolution=64, rotation=0.0, samples=1, rasteriser="r", device="d")
    values = make_correlation_table(table).set_index("statistic")["value"]
    assert abs(values["spearman_within"]) < 0.2
    assert values["spearman_pooled"] > 0.95


def test_a_constant_criterion_has_no_correlation():
    estimate = rank_views([(np.ones(9), np.arange(9.0) + 1)] * 4)
    assert estimate.polygons == 0
    assert np.isnan(estimate.value)


def test_median_of_few_values_has_no_interval():
    assert np.isnan(estimate_median(np.arange(5.0))[1:3]).all()
    assert estimate_median(np.arange(6.0)) == (2.5, 0.0, 5.0, 6)
    assert estimate_median(np.ones(8)) == (1.0, 1.0, 1.0, 8)


def test_median_interval_covers_the_median():
    samples = [np.random.default_rng(seed).normal(0.5, 0.1, 25) for seed in range(60)]
    estimates = [estimate_median(values) for values in samples]
    assert sum(estimate.low <= 0.5 <= estimate.high for estimate in estimates) >= 54


def test_a_polygon_in_several_views_counts_once():
    """Two views of four polygons are four polygons, too few for an interval."""
    views = polygons(4, 0.1)
    estimate = rank_views([*views, *views], "abcdabcd")
    assert estimate.polygons == 4
    assert np.isnan(estimate.low)
    assert estimate.verdict == "too few"
    assert not np.isnan(rank_views([*views, *views]).low)


def test_paired_difference_has_a_narrower_interval():
    level = np.random.default_rng(2).uniform(0.2, 0.9, 24)
    one, two = pd.Series(level + 0.02), pd.Series(level)
    assert not estimate_median(one).low > estimate_median(two).high
    assert estimate_median(one - two).verdict == "better"
    assert estimate_median(two - one).verdict == "worse"
    assert estimate_median(one - one).verdict == "not significant"
    assert estimate_median(one[:5] - two[:5]).verdict == "too few"


SCENE = "city:buildings=60"


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("spread") / "run"
    arguments = ["run", "--scene", SCENE, "--rasterisers", "reference", "--resolution", "1024"]
    arguments += ["--triangulators", "ear-clipping,delaunay", "--quick", "--quiet"]
    assert run_command(*arguments, "--out", str(folder)) == 0
    return folder


def test_polygons_are_triangulated_in_many_ways(run_folder):
    table = matrix.read_spread(read_run(run_folder), View(1024))
    assert table["polygon"].nunique() == subjects.POLYGONS
    by_polygon = table.groupby("polygon").size()
    assert by_polygon.max() > 20
    names = set(table["triangulator"])
    assert {"ear-clipping", "worst:half-perimeter", "random#3"} <= names
    assert not table.duplicated(["polygon", "triangulator"]).any()
    columns = pd.read_csv(run_folder / matrix.SPREAD).columns
    assert {"polygon", "triangulator", "half_perimeter", "helper_lanes", "fit"} <= set(columns)


def test_counters_are_those_of_the_polygon_in_its_frame(run_folder):
    table = matrix.read_spread(read_run(run_folder), View(1024))
    frame = make_frame(load(SCENE).polygons, View(1024))
    number = int(table["polygon"].iloc[-1])
    polygon = frame.polygons[frame.source.tolist().index(number)]
    points = np.rint(np.array(polygon.exterior.coords)[:-1] * SUBPIXEL).astype(np.int32)
    rows_of_polygon = table[table["polygon"] == number].set_index("triangulator")
    for name in ("random#0", "random#1", "optimal:half-perimeter"):
        base, _, seed = name.partition("#")
        parameters = {"seed": int(seed)} if seed else {}
        counts = count_per_triangle(points, triangulate(polygon, base, **parameters))
        assert rows_of_polygon.loc[name, "helper_lanes"] == counts["helper_lanes"].sum()


def test_criteria_are_ranked_within_polygons(run_folder):
    table = matrix.read_spread(read_run(run_folder), View(1024))
    spread = matrix.correlate_predictions_within_polygons(table, "helper_lanes")
    names = ("expected_quads", "half_perimeter", "overdraw", "shape")
    q, h, a, d = (spread[name] for name in names)
    assert q.polygons > 20
    assert q.value > h.value > a.value > d.value
    names = ("expected_quads", "overdraw")
    by_q, by_a = (correlate_within_polygons(table, name, "helper_lanes") for name in names)
    assert estimate_median(by_q - by_a).verdict == "better"
    assert "complexity" not in spread, "it is the same for all, and so ranks nothing"


def test_report_recommends_a_criterion(run_folder):
    content = make_content(read_run(run_folder))
    sentence = content["groups"][0]["judged"]
    assert sentence.startswith("Within a polygon, ")
    assert "expected quads Q predicts helper lanes best (rank correlation 0.9" in sentence
    assert "24 polygons; the paper's overdraw A 0." in sentence


def test_run_without_columns_is_readable(run_folder, tmp_path):
    run = read_run(run_folder)
    assert matrix.read_spread(run, View(512)) is None
    for name, content in (("a", "polygon,resolution\n1,256\n"), ("b", "\0\0"), ("c", "")):
        folder = tmp_path / name
        folder.mkdir()
        for file in ("run.json", "cases.jsonl"):
            (folder / file).write_bytes((run_folder / file).read_bytes())
        (folder / matrix.SPREAD).write_text(content)
        assert matrix.read_spread(read_run(folder), View(1024)) is None
        assert "Within a polygon" not in make_content(read_run(folder))["groups"][0]["judged"]


def test_sentence_without_a_spread_uses_ratios():
    sentence = "Of the criteria, half-perimeter H predicts quads best (rank correlation 0.50)."
    assert format_best_criterion("quads", {"quads": {"half_perimeter": 0.5}}) == sentence
    assert format_best_criterion("quads", {}) == ""


def ranked() -> pd.DataFrame:
    """Return a table of polygons at two sizes; quads and times follow H exactly and A loosely."""
    random = np.random.default_rng(8)
    rows = []
    for polygon, size in [(str(k), size) for k in range(8) for size in (64, 256)]:
        lengths = size * random.uniform(1, 2, 12)
        for length in lengths:
            overdraw = length * random.uniform(0.5, 1.5)
            rows.append((polygon, size, length, overdraw, np.rint(length), 1e-6 * length))
    names = ["polygon", "resolution", "half_perimeter", "overdraw", "quads", f"{TIME}0"]
    table = pd.DataFrame(rows, columns=names)
    table = table.assign(helper_lanes=3 * table["quads"], **{f"{TIME}8": 2 * table[f"{TIME}0"]})
    return table.assign(rotation=0.0, samples=1, rasteriser="opengl", device="llvmpipe")


def test_criteria_are_compared_by_rank_correlation():
    rows, names = ranked(), ("overdraw", "half_perimeter")
    table = compare_criteria(rows).set_index(["measure", "criterion", "other"])
    row = table.loc[("helper_lanes", "overdraw", "half-perimeter")]
    one, other = (correlate_within_polygons(rows, name, "helper_lanes") for name in names)
    assert row["difference"] == np.median(one - other)
    assert row["verdict"] != NOT_SIGNIFICANT


def test_tables_and_plots_contain_the_correlations(tmp_path, monkeypatch):
    rows = ranked()
    rows["edge_length"] = rows["half_perimeter"] * np.linspace(1, 1.2, len(rows))  # a third one
    rows["exact_quads"] = rows["helper_lanes"]  # the count itself: no criterion
    table = pd.concat([rows, rows.assign(rasteriser="cuda")], ignore_index=True)
    correlations = write_correlations(table, tmp_path)
    assert list(pd.read_csv(tmp_path / "measured.csv").columns) == list(table.columns)
    tables = {"correlations": correlations, "criteria_compared": compare_criteria(table)}
    tables["correlations_by_resolution"] = correlate_by_resolution(table)
    for name, written in tables.items():
        read = pd.read_csv(tmp_path / f"{name}.csv")
        pd.testing.assert_frame_equal(read, written, check_dtype=False, rtol=1e-5)
    drawn = {}

    def scatter(panel, rows, criterion, measure, _key):
        drawn[panel] = (*rows["rasteriser"].unique(), criterion, measure)
        return np.array([0.9, 1.0, 1.1]), np.array([1.18, 1.2, 1.22])

    monkeypatch.setattr("harness.study.correlations.draw_scatter_over_medians", scatter)
    files = plot_study(correlations, table, tmp_path)
    names = ("opengl", "cuda")  # in the order of the run
    assert [file.name for file in files] == [
        f"predicted-vs-measured-{name}-llvmpipe.{kind}" for name in names for kind in ("png", "svg")
    ]
    assert list(drawn.values()) == [
        (name, criterion, measure)
        for name in names
        for measure in ("helper_lanes", f"{TIME}0")  # the main counter, the time of the least work
        for criterion in ("overdraw", "half_perimeter")  # the paper's, the best
    ]
    values = correlations.set_index(["statistic", "criterion", "measure"])["value"]
    for panel, (_, criterion, measure) in drawn.items():
        value = values["spearman_within", criterion.replace("_", "-"), measure].iloc[0]
        assert panel.get_title() == f"rank correlation {value:.3f}"
        (line,) = panel.lines
        assert line.get_slope() == pytest.approx(0.2)
        assert line.get_xy1() == pytest.approx((1, 1.2))


def test_failed_cases_and_t_junctions_are_skipped():
    good = judged()
    bad = [{**r, **why} for r in good for why in ({"status": "failed"}, {"conforming": False})]
    table = make_table(good)
    assert len(table) > 3
    pd.testing.assert_frame_equal(make_table([*good, *bad]), table)
    assert make_table(bad).empty


def test_measures_of_some_rows_are_correlated():
    table = ranked()
    partial = table.assign(spills=table["quads"].where(table.index % 2 == 0), hits=np.nan)
    measures = set(make_correlation_table(partial)["measure"])
    assert {"spills", "quads"} <= measures
    assert "hits" not in measures


def test_minimum_number_of_triangulations_is_ranked():
    x = np.arange(1.0, MIN_TRIANGULATIONS + 1)
    estimate = rank_views([(x, x**2)] * 6)
    assert (estimate.value, estimate.polygons) == (pytest.approx(1), 6)
    assert rank_views([(x[1:], x[1:] ** 2)] * 6).polygons == 0


def test_equal_triangulations_are_one_row():
    twice = [{**r, "triangulator": f"{r['triangulator']} {k}"} for r in judged() for k in range(2)]
    assert len(make_table(twice)) == len(make_table(judged()))
    backwards = make_table(twice[::-1])["triangulator"]  # the first of the run stands for both
    assert backwards.tolist() == [r["triangulator"] for r in twice[::-2]]


def test_resolutions_have_separate_correlations():
    table = ranked()
    of_64 = table.query("resolution == 64")
    assert correlate_by_resolution(of_64).empty
    sizes = correlate_by_resolution(table)
    assert set(sizes["resolution"]) == {64, 256}
    correlated = sizes[sizes["resolution"] == 64].drop(columns="resolution").reset_index(drop=True)
    pd.testing.assert_frame_equal(correlated, make_correlation_table(of_64))


def test_exact_counts_are_of_one_sample_per_pixel():
    good = judged()
    drawn = [{**r, "rasteriser": "opengl", "counters": {"quads": 7}} for r in good]
    four = {"options": {"work": 0, "samples": 4}, "counters": {"quads": 8}}
    exact = make_table([*drawn, *({**r, **four} for r in good), *good])["exact_quads"]
    assert exact.tolist() == 3 * [r["counters"]["quads"] for r in good]


def judged() -> list[dict]:
    good = make_cases("p")
    for length, entry in enumerate(good):
        entry["predicted"] |= dict.fromkeys(IDENTIFYING_CRITERIA, float(length))
    return good
