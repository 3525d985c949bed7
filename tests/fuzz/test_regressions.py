"""Regression tests of inputs from the random search, and tests of the search itself."""

import json
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.fuzz.target import REGRESSIONS, UNFINISHED, Target, load_targets, search_inputs
from tests.fuzz.targets import options, runs
from tests.paths import run_python

TARGETS = load_targets()
STORED = sorted(REGRESSIONS.glob("*/*.json"))


@pytest.mark.parametrize("file", STORED, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_stored_inputs_pass(file: Path):
    TARGETS[file.parent.name].check(json.loads(file.read_text()))


@pytest.mark.parametrize("name", TARGETS)
def test_random_inputs_of_each_target_pass(name: str):
    target, values = TARGETS[name], []
    max_examples = {"damaged-file": 400, "svg-path-data": 40, "damaged-model": 60}.get(name, 8)

    @settings(max_examples=max_examples, suppress_health_check=list(HealthCheck))
    @given(target.inputs)
    def attempt(value):
        # Stored values must survive a round trip.
        value = json.loads(json.dumps(value))
        values.append(value)
        target.check(value)

    attempt()
    assert len(values) >= 8


def test_failing_input_is_reduced_and_stored(tmp_path: Path):
    def check(value):
        assert sum(value) < 1000

    target = Target("sums", st.lists(st.integers(0, 10**6)), check)
    with pytest.raises(AssertionError) as failure:
        search_inputs(target, 60, tmp_path)
    (file,) = (tmp_path / "sums").iterdir()
    assert failure.value.__notes__[-1] == f"stored as {file}"
    assert json.loads(file.read_text()) == [1000]


def test_search_ends_at_the_time_limit(tmp_path: Path):
    """Every check takes a second on this clock; a rejected input counts, too."""
    checks = []
    target = Target("patient", st.integers(), lambda value: checks.append(assume(value % 3)))
    assert search_inputs(target, 250, tmp_path, clock=lambda: len(checks)) >= 250
    assert len(checks) == 250
    assert list((tmp_path / "patient").iterdir()) == []


@pytest.mark.parametrize(("statement", "code"), [("os.abort()", -6), ("time.sleep(60)", 1)])
def test_input_that_ends_the_process_remains(tmp_path: Path, statement: str, code: int):
    script = (
        "import os, pathlib, time\n"
        "from hypothesis import strategies as st\n"
        "from tests.fuzz import target\n"
        "target.TIMEOUT_S = 0.2\n"
        f"fatal = target.Target('fatal', st.just(7), lambda value: {statement})\n"
        "target.search_inputs(fatal, 60, pathlib.Path())\n"
    )
    assert run_python("-c", script, cwd=tmp_path).returncode == code
    assert json.loads((tmp_path / "fatal" / UNFINISHED).read_text()) == 7


def test_silent_command_is_tried_in_a_new_process(monkeypatch):
    """`list` prints nothing in a new process either, which is an error."""
    silent = Mock(side_effect=runs.SilentError("no output"))
    monkeypatch.setattr(options, "call_command", silent)
    monkeypatch.setattr(options, "run_program", lambda *arguments: (0, ""))
    value = {"command": "list", "option": "--scene", "value": "0"}
    assert options.check_option(value) == "list --scene: exit 0"
    assert silent.call_count == 1
    monkeypatch.setattr(options, "run_program", silent)
    with pytest.raises(runs.SilentError):
        options.check_option(value)


def test_silence_is_an_error(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(runs, "SILENT_S", 0.0)
    with pytest.raises(runs.SilentError, match="no output for"):
        options.run_program("--version")
