"""In a damaged run, damaged cases are reported and the other cases are compared."""

import json
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from harness.compare.comparison import compare_runs
from harness.compare.outputs import to_json, to_markdown
from harness.errors import HarnessError
from tests.compare.runs import TRIANGULATORS, make_case, make_cases, read_back, write_pair
from tests.conftest import require_ok
from tests.fuzz.damage import JSON

pytestmark = pytest.mark.usefixtures("no_plots")

FIELDS = sorted(make_case("fan", seed=1))
FACTS = ("plan", "environment", "devices", "warnings", "created", "interrupted")


@settings(deadline=None, max_examples=60)
@given(field=st.sampled_from([f for f in FIELDS if f != "key"]), value=JSON)
@example(field="vertices", value=10**400)
@example(field="triangulate_s", value=10**400)
def test_any_value_in_any_field_is_reported_or_compared(field, value):
    damaged = make_cases(2)
    damaged[1] = {**damaged[1], field: value}
    try:
        comparison = compare_runs(read_back({}, make_cases(1)), read_back({}, damaged))
    except HarnessError:
        return  # e.g. all devices of a rasteriser differ
    json.dumps(to_json(comparison), allow_nan=False)
    assert to_markdown(comparison).startswith("**")
    assert len(comparison.cases) >= len(TRIANGULATORS)


@settings(deadline=None, max_examples=60)
@given(facts=st.dictionaries(st.sampled_from(FACTS), JSON))
@example(facts={"devices": {"opengl on llvmpipe": None}})
def test_any_facts_are_read(facts):
    comparison = compare_runs(*(read_back(facts, make_cases(1)) for _ in range(2)))
    assert comparison.verdict == "good"
    json.dumps(to_json(comparison), allow_nan=False)


@pytest.mark.parametrize("content", ["[]", "3", '"text"', "null", "{", '{"devices": 3}'])
def test_a_damaged_run_json_is_reported(harness, content):
    write_pair()
    Path("head/run.json").write_text(content)
    out, _ = require_ok(harness("compare", "base", "head"))
    assert "run.json" in out


def test_a_gate_on_times_alone_needs_times(harness):
    def untimed(entry):
        del entry["time"]

    write_pair({"edits": {"*": untimed}}, edits={"*": untimed})
    assert harness("compare", "base", "head")[0] == 0
    code, out, _ = harness("compare", "base", "head", "--gate", "time")
    assert code == 4
    assert "no case was timed" in out


def test_repeated_case_is_reported_and_the_later_record_is_used(harness):
    write_pair()
    later = make_case("fan", seed=3) | {"key": "0123456789abcdef", "scene_hash": "0" * 16}
    with Path("head/cases.jsonl").open("a") as stream:
        stream.write(json.dumps(later) + "\n")
    out, _ = require_ok(harness("compare", "base", "head"))
    name = "HEAD: fan, city 1024 px, opengl on llvmpipe"
    assert f"{name}: measured twice; the later record is used" in out
    assert "1 case with changed content" in out


def test_deeply_nested_fields_skip_the_record():
    damaged = make_cases(1)
    damaged[0]["options"] = {}
    for _ in range(700):
        damaged[0]["options"] = {"a": damaged[0]["options"]}
    run = read_back({"plan": damaged[0]["options"]}, damaged)
    assert len(run.records) == len(damaged) - 1
    assert any("line 1: nested too deeply" in problem for problem in run.problems)
