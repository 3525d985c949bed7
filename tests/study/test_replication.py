"""Replication of findings: tables with known results, and a small study."""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import pandas as pd
import pytest

from harness.errors import HarnessError, InconclusiveError, NothingMeasuredError, UsageError
from harness.metrics.run_quality import DISTURBED, RunState
from harness.settings import StudySize
from harness.study.replication import CLAIMS, Evidence, evaluate_claims, format_page
from tests.conftest import assert_refused, require_ok, run_command


def correlations(**values: float) -> pd.DataFrame:
    """Return correlations.csv of one device, criterion -> rank correlation +-0.01."""
    measures = {"helper_lanes": "opengl", "time_work_0": "opengl", "bbox_tests": "bounding-box"}
    rows = [
        (rasteriser, criterion.replace("_", "-"), measure, value, value - 0.01, value + 0.01)
        for criterion, value in values.items()
        for measure, rasteriser in measures.items()
    ]
    columns = ["rasteriser", "criterion", "measure", "value", "ci_low", "ci_high"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(device="cpu", statistic="spearman_within", polygons=24)


def compare(**values: float) -> pd.DataFrame:
    """Return criteria_compared.csv of the same criteria: differences +-0.01."""
    rows = [
        (measure, one.replace("_", "-"), two.replace("_", "-"), values[one] - values[two])
        for one, two in combinations(values, 2)
        for measure in ("helper_lanes", "time_work_0")
    ]
    table = pd.DataFrame(rows, columns=["measure", "criterion", "other", "difference"])
    ends = {"ci_low": table["difference"] - 0.01, "ci_high": table["difference"] + 0.01}
    return table.assign(rasteriser="opengl", device="cpu", polygons=24, **ends)


def gains(triangulator: str, base: str, ratio: float, lanes: float = 0.9) -> pd.DataFrame:
    row = {"rasteriser": "opengl", "triangulator": triangulator, "base": base}
    row |= {"resolution": 1024, "time_ratio": ratio, "helper_lanes_ratio": lanes}
    row |= {"time_ratio_low": ratio - 0.01, "time_ratio_high": ratio + 0.01}
    return pd.DataFrame([row, {**row, "resolution": 256, "time_ratio": 2.0}])


def get_verdicts(evidence: Evidence) -> dict[str, bool | None]:
    findings = evaluate_claims(evidence)
    return {claim.sentence: finding and finding.holds for claim, finding in findings}


EAR_CLIPPING = {"overdraw": 0.86, "half_perimeter": 0.98, "expected_quads": 0.99}
EAR_CLIPPING |= {"edge_length": 0.93, "shape": 0.75}


def test_each_claim_can_hold_and_fail_or_have_no_evidence():
    assert set(get_verdicts(Evidence()).values()) == {None}
    assert set(get_verdicts(make_good_evidence()).values()) == {True}
    poor = {"overdraw": 0.86, "half_perimeter": 0.86, "expected_quads": 0.86}
    poor |= {"edge_length": 0.5, "shape": 0.75}
    bad = evidence(correlations(**poor), compare(**poor), 0.02, 1.0, 0.995, (0.96, 0.90))
    assert set(get_verdicts(bad).values()) == {False}


def make_good_evidence() -> Evidence:
    """Return evidence in which each claim holds."""
    ranks = correlations(**EAR_CLIPPING)
    of_boxes = (ranks["measure"] == "bbox_tests") & (ranks["criterion"] == "overdraw")
    exact = {name: ranks[name].mask(of_boxes, 1.0) for name in ("value", "ci_low", "ci_high")}
    differences = compare(**EAR_CLIPPING)
    return evidence(ranks.assign(**exact), differences, 0.002, 0.9, 0.95, (0.92, 0.99))


def evidence(ranks, differences, lost, choice, walked, turned: tuple[float, float]) -> Evidence:
    """Return evidence with given ratios of times and of helper lanes of H- and A-optima."""
    best, rotated_base = "optimal:half-perimeter", "ear-clipping@0"
    choices = [gains(best, base, choice) for base in ("ear-clipping", "delaunay")]
    rotated = [
        gains(f"{best}@0", rotated_base, 0.9, turned[0]),
        gains("optimal:overdraw@0", rotated_base, 0.95, turned[1]),
    ]
    return Evidence(
        correlations=ranks,
        compared=differences,
        regret=regret(lost),
        choice=pd.concat(choices),
        walked=gains(best, "delaunay", walked),
        turned=pd.concat(rotated),
    )


def regret(mean: float) -> pd.DataFrame:
    row = {"rasteriser": "opengl", "kind": "criterion", "name": "expected-quads"}
    row |= {"measure": "quads", "resolution": 1024, "polygons": 24, "worst": mean * 3}
    return pd.DataFrame([{**row, "mean": mean, "ci_low": mean / 2, "ci_high": mean * 2}])


def test_page_shows_reference_and_finding():
    ranks = Evidence(correlations=correlations(**EAR_CLIPPING))
    text = format_page([("mine", ranks)], "On a machine.")
    assert "| mine | 2 | 1 | 8 |" in text
    assert f"| {CLAIMS[0].reference} | 0.990 (0.980 to 1.000) | holds |" in text
    assert "not measured" in text
    assert all(claim.sentence in text for claim in CLAIMS)


def test_two_data_sets_of_one_name_are_refused(harness):
    answer = harness("study", "all", "a/city.geojson", "b/city.geojson", "--out", "study")
    assert_refused(answer, "rename one")


STUDY = ("--out", "study", "--quick", "--rasterisers", "reference", "--resolution", "64")
CITY = ("study", "all", "city:buildings=20", *STUDY)


@pytest.fixture
def small(monkeypatch):
    size = StudySize(2, random=4, max_vertices=20)
    monkeypatch.setattr("harness.commands.study_validate.QUICK", size)
    monkeypatch.setattr("harness.commands.study_validate.QUICK_S", 1e-4)
    monkeypatch.setattr("harness.commands.study_all.ANGLES", (0.0, 45.0))


@pytest.mark.usefixtures("no_plots", "in_process", "small")
def test_a_small_study_is_measured_once(harness):
    out, _ = require_ok(harness(*CITY))
    assert "findings hold" in out
    text = Path("study/findings.md").read_text()
    assert "| city-buildings-20 | " in text
    before = {file: file.read_bytes() for file in Path("study").rglob("cases.jsonl")}
    assert len(before) == 4
    assert run_command(*CITY) == 0
    assert {file: file.read_bytes() for file in Path("study").rglob("cases.jsonl")} == before
    cases = Path("study/city-buildings-20/choice/cases.jsonl")
    cases.write_bytes(b'{"resolution": 4}' + cases.read_bytes()[cases.read_bytes().index(b"\n") :])
    out, err = require_ok(harness(*CITY))
    assert "choice/cases.jsonl, line 1: " in " ".join((out + err).split())


@pytest.mark.usefixtures("no_plots", "in_process", "small")
def test_parts_run_although_one_fails(harness, tmp_path):
    source = tmp_path / "squares.wkt"
    source.write_text("POLYGON ((0 0, 4 0, 4 4, 0 4, 0 0))\nPOLYGON ((5 0, 9 0, 9 5, 5 4, 5 0))\n")
    out, _ = require_ok(harness("study", "all", str(source), *STUDY))
    assert "validate: squares" in out
    assert "no polygon without holes" in out
    assert Path("study/squares/choice/gains.csv").is_file()


@pytest.mark.usefixtures("no_plots", "in_process", "small")
def test_disturbed_times_leave_findings_on_counters(harness, monkeypatch):
    disturbed = RunState(DISTURBED, ("9 of 10 samples waited for a core",))
    monkeypatch.setattr("harness.measuring.run.assess_records", lambda *_: disturbed)
    code, out, err = harness(*CITY)
    assert code == 5
    assert "3 of 4 parts of the study are incomplete" in err
    assert "choice: the run's times are disturbed: 9 of 10 samples waited for a core" in out
    assert "in study: city-buildings-20/choice, city-buildings-20/walked, city-b" in err
    gains = pd.read_csv("study/city-buildings-20/turned/gains.csv")
    assert gains["time_ratio"].isna().all()
    lines = Path("study/findings.md").read_text().splitlines()
    decided = {line for line in lines if line.endswith(("holds |", "does not hold |"))}
    assert sum("Rotated after triangulation" in line for line in decided) == 2
    assert not any("faster" in line for line in decided)


def test_comparisons_use_paired_differences():
    """Overlapping intervals do not exclude a difference within each polygon, or the reverse."""
    wide = correlations(**EAR_CLIPPING)
    wide = wide.assign(ci_low=wide["value"] - 0.2, ci_high=wide["value"] + 0.2)
    evidence = Evidence(correlations=wide, compared=compare(**EAR_CLIPPING))
    page = format_page([("city", evidence)], "here")
    assert "A 0.860 (0.660 to 1.060), difference 0.120 (0.110 to 0.130) | holds" in page
    close = compare(**{**EAR_CLIPPING, "half_perimeter": 0.865})
    judged = get_verdicts(Evidence(correlations=correlations(**EAR_CLIPPING), compared=close))
    assert [v for sentence, v in judged.items() if "polygon by polygon" in sentence] == [False] * 2


def test_too_few_polygons_decide_no_claim():
    table = correlations(**EAR_CLIPPING)
    unknown = {"ci_low": float("nan"), "ci_high": float("nan"), "polygons": 1}
    evidence = Evidence(
        correlations=table.assign(**unknown),
        compared=compare(**EAR_CLIPPING).assign(**unknown),
        regret=regret(0.002).assign(**unknown),
        turned=gains("optimal:half-perimeter@0", "ear-clipping@0", 0.9).assign(**unknown),
    )
    findings = [figure for _, figure in evaluate_claims(evidence) if figure is not None]
    assert len(findings) == 7
    assert {figure.verdict for figure in findings} == {"too few"}
    assert "| city | 0 | 0 | 11 |" in format_page([("city", evidence)], "here")


def fail_with(error: HarnessError) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


REFUSED = fail_with(UsageError("no polygon without holes"))


def test_invalid_input_of_all_parts_is_refused_without_output(harness, monkeypatch):
    for name in ("_measure_validation", "_measure_gains"):
        monkeypatch.setattr(f"harness.commands.study_all.{name}", REFUSED)
    answer = harness("study", "all", "city", "--out", "out")
    assert_refused(answer, "error: no polygon without holes")
    assert not Path("out").exists()


def test_study_without_findings_measured_nothing(harness, monkeypatch):
    nothing = fail_with(NothingMeasuredError("every case was skipped"))
    monkeypatch.setattr("harness.commands.study_all._measure_validation", REFUSED)
    monkeypatch.setattr("harness.commands.study_all._measure_gains", nothing)
    code, _, err = harness("study", "all", "city", "--out", "out")
    assert code == 4
    assert err.count("error: ") == 1
    assert "no finding could be evaluated" in err
    assert Path("out/findings.md").exists()


def test_study_with_failed_parts_is_inconclusive(harness, monkeypatch):
    """The gains of a run with failed cases are those of the measured cases."""
    monkeypatch.setattr("harness.commands.study_all._measure_validation", lambda *_: None)
    failed = fail_with(InconclusiveError("1 of 8 cases failed (mine:cut)"))
    monkeypatch.setattr("harness.commands.runs.finish_run", failed)
    monkeypatch.setattr("harness.measuring.run.run", lambda *_: None)
    monkeypatch.setattr("harness.results.run_folder.read_run", lambda folder: folder)
    asked = []
    monkeypatch.setattr(
        "harness.commands.study_gains.write_gains", lambda runs, *_: asked.extend(runs)
    )
    tables = make_good_evidence()
    monkeypatch.setattr("harness.study.replication.read_evidence", lambda folder: tables)
    code, out, err = harness("study", "all", "city", "--out", "out")
    assert code == 5
    assert "error: 3 of 4 parts of the study are incomplete" in err
    assert "city: 11 of 11 findings hold" in out
    assert [path.name for path in asked] == ["choice", "walked", "turned"]
    monkeypatch.setattr("harness.commands.runs.finish_run", lambda *_, **__: None)
    assert harness("study", "all", "city", "--out", "out")[0] == 0
