import json
from pathlib import Path

import pytest

from harness.commands.report import report
from harness.errors import InputError
from harness.metrics.decision import decide_run
from harness.results.run_folder import read_run
from harness.style import format_latex_table
from harness.summary import write_table
from tests.records import make_run
from tests.report.conftest import NAMES, VIEWS

CASES = len(NAMES) * len(VIEWS)


def test_markdown_and_latex_have_a_row_for_each_case(folder: Path, tmp_path: Path):
    markdown, latex = tmp_path / "run.md", tmp_path / "run.tex"
    report(folder, markdown)
    report(folder, latex)
    heading, alignment, *rows = markdown.read_text().splitlines()
    assert heading.startswith("| scene, device | triangulator | helpers | ")
    assert heading.endswith(" | time relative to the base (95 % CI) |")
    assert alignment.startswith("| --- | --- | --: |")
    assert len(rows) == CASES
    base = next(row for row in rows if "| ear-clipping |" in row)
    assert base.endswith("| - |")
    lines = latex.read_text().splitlines()
    assert lines[0] == f"\\begin{{tabular}}{{ll{'r' * (heading.count('|') - 3)}}}"
    assert [line.split(" & ")[:3] for line in lines[4:-2]] == [
        row[2:].split(" | ")[:3] for row in rows
    ]
    assert "95 \\% CI" in lines[2]


def test_characters_of_latex_are_escaped():
    table = format_latex_table(["50 %", "a_b"], [["#1 & $2", "x"]], 1)
    assert "50 \\% & a\\_b \\\\" in table
    assert "\\#1 \\& \\$2 & x \\\\" in table


def test_bencher_gets_times_with_intervals_and_counters(folder: Path, tmp_path: Path):
    report(folder, tmp_path / "run.json")
    benchmarks = json.loads((tmp_path / "run.json").read_text())
    records = {
        (record.id.view.resolution, record.name): record for record in read_run(folder).records
    }
    assert len(benchmarks) == len(records) == CASES
    for name, measures in benchmarks.items():
        resolution = next(view.resolution for view in VIEWS if f"{view.resolution} px" in name)
        record = records[
            resolution, name.rpartition(" px")[2].partition(": ")[2].partition(": ")[2]
        ]
        latency = measures.pop("latency")
        assert latency["value"] == pytest.approx(record.time.median_s * 1e9)
        assert latency["lower_value"] <= latency["value"] <= latency["upper_value"]
        assert {key: part["value"] for key, part in measures.items()} == record.counters


def test_a_run_without_a_case_has_no_table(tmp_path: Path):
    with pytest.raises(InputError, match="table not written"):
        write_table(decide_run(make_run([])), tmp_path / "run.md")
