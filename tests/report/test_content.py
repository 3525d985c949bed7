import hashlib
import json
import shutil
from importlib import resources
from pathlib import Path

import pytest

from harness.errors import InputError
from harness.report.content import choose_sample, make_content
from harness.report.page import write_report
from harness.results.run_folder import read_run
from tests.compare.runs import read_back
from tests.conftest import require_ok
from tests.fuzz.damage import apply_value_edit, iter_paths
from tests.fuzz.targets.runs import make_sample_run
from tests.records import get_rows

ECHARTS = "1f13280aba3161f77fc801bf5f9c786f55f10432153a0683fc5cc0700b013d5"

CORRELATIONS = """\
rasteriser,device,criterion,measure,statistic,value,ci_low,ci_high,polygons
opengl,llvmpipe,half_perimeter,helper_lanes,spearman_within,0.99,0.985,0.995,24
opengl,llvmpipe,overdraw,helper_lanes,spearman_within,0.70,0.62,0.77,24
opengl,llvmpipe,overdraw,draw_ms,spearman_within,0.66,0.6,0.7,24
opengl,llvmpipe,overdraw,helper_lanes,spearman_pooled,0.2,,,24
"""


def test_chart_library_has_the_published_digest():
    static = resources.files("harness.report") / "static"
    content = (static / "echarts.common.min.js").read_bytes()
    assert hashlib.sha256(content).hexdigest().endswith(ECHARTS)
    assert "Apache License" in (static / "LICENSE-echarts.txt").read_text()


def test_command_writes_a_file_in_a_new_folder(harness, copy):
    out, _ = require_ok(harness("report", str(copy), "--out", "else/where.html"))
    assert "where.html" in out
    assert Path("else/where.html").read_text().startswith("<!DOCTYPE html>")


def test_failures_are_listed(copy, browser):
    file = copy / "cases.jsonl"
    records = [json.loads(line) for line in file.read_text().splitlines()]
    for record in records[:2]:
        record |= {"status": "failed", "reason": "crashed: SIGSEGV"}
        del record["time"], record["counters"]
    file.write_text("".join(json.dumps(record) + "\n" for record in records))
    browser.open(write_report(read_run(copy)))
    browser.evaluate("$('show-failed').click()")
    assert browser.read_text("found") == "1 to 2 of 2"
    assert "SIGSEGV" in browser.read_text("cases")


@pytest.mark.parametrize("lost", ["frames", "polygons", "run.json"])
def test_run_with_missing_files_is_shown_without_them(copy, browser, lost):
    path = copy / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    browser.open(write_report(read_run(copy)))
    assert browser.evaluate("document.querySelectorAll('#ranking tbody tr').length") == 5
    has_heatmap = browser.evaluate("!document.getElementById('heatmap').hidden")
    assert has_heatmap is (lost == "run.json")
    browser.evaluate("openMark(chart.marks[0])")
    assert browser.evaluate("document.activeElement.id") == "heatmap-title"


def test_study_shows_the_matrix_with_intervals(copy, browser):
    (copy / "correlations.csv").write_text(CORRELATIONS)
    browser.open(write_report(read_run(copy)))
    matrix = browser.evaluate("document.getElementById('matrix').innerText")
    assert "0.990" in matrix
    assert "0.985 to 0.995" in matrix
    assert browser.read_text("answer") == (
        "Half-perimeter H predicts the helper lanes of opengl on llvmpipe best (rank correlation "
        "within a polygon 0.99, 95 % CI 0.98-0.99); the paper's overdraw A reaches 0.70."
    )
    options = "[...document.getElementById('statistic').options].map((each) => each.value)"
    assert browser.evaluate(options) == ["spearman_within", "spearman_pooled"]
    best = "[...document.querySelectorAll('#matrix .best')].map((each) => each.firstChild.data)"
    assert sorted(browser.evaluate(best)) == ["0.660", "0.990"]


def test_study_without_cases_is_shown(tmp_path, browser):
    (tmp_path / "correlations.csv").write_text(CORRELATIONS)
    (tmp_path / "run.json").write_text('{"schema_version": 1}')
    browser.open(write_report(read_run(tmp_path)))
    assert "0.990" in browser.read_text("matrix")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("rasteriser,device\n", "no column criterion"),
        (CORRELATIONS.replace("0.99,", "much,"), "line 2: not a number"),
    ],
)
def test_damaged_study_is_refused(copy, content, problem):
    (copy / "correlations.csv").write_text(content)
    with pytest.raises(InputError, match=problem):
        write_report(read_run(copy))


def test_sample_of_polygons_is_reproducible_and_sorted():
    assert choose_sample(5, 10).tolist() == [0, 1, 2, 3, 4]
    sample = choose_sample(1000, 50)
    assert sample.tolist() == sorted(set(sample.tolist()))
    assert len(sample) == 50
    assert (sample == choose_sample(1000, 50)).all()


@pytest.mark.parametrize("action", ["remove", "set"])
def test_each_field_may_be_missing_or_null(action):
    run = read_run(make_sample_run())
    record_of_run, *other_records = get_rows(run)
    assert "least" in record_of_run
    ignored = set()
    for position, path in enumerate(iter_paths(record_of_run)):
        edit = {"position": position, "action": action, "value": None}
        record = apply_value_edit(record_of_run, edit)
        damaged_run = read_back(run.facts, [record, *other_records])
        json.dumps(make_content(damaged_run), allow_nan=False)
        if len(damaged_run.records) < len(run.records):
            ignored.add(path[0])
    assert {"key", "resolution", "rotation", "triangulator", "least"} <= ignored
    assert {"reason", "polygons", "outline_quads", "triangulate_s"}.isdisjoint(ignored)


def test_invalid_plan_is_ignored():
    sample = read_run(make_sample_run())
    facts = {**sample.facts, "plan": {**sample.facts["plan"], "triangulators": [{"a": 1}]}}
    run = read_back(facts, get_rows(sample))
    assert "plan" not in run.facts
    assert any("plan: invalid" in line for line in run.problems)
