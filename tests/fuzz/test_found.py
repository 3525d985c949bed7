"""What the random search found before stays mended, and no target has gone stale."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.fuzz.target import FOUND, UNFINISHED, Target, search, targets
from tests.fuzz.targets import options, runs
from tests.paths import ROOT

TARGETS = targets()
KEPT = sorted(FOUND.glob("*/*.json"))


@pytest.mark.parametrize("file", KEPT, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_what_was_found_is_mended(file: Path):
    TARGETS[file.parent.name].check(json.loads(file.read_text()))


@pytest.mark.parametrize("name", TARGETS)
def test_a_few_inputs_of_each_target(name: str):
    wanted, tried = TARGETS[name], []
    most = {"spoilt-file": 400, "svg-path-data": 40, "spoilt-model": 60}.get(name, 8)

    @settings(max_examples=most, suppress_health_check=list(HealthCheck))
    @given(wanted.inputs)
    def attempt(value):
        # What is kept must come back as it was.
        value = json.loads(json.dumps(value))
        tried.append(value)
        wanted.check(value)

    attempt()
    assert len(tried) >= 8


def test_a_failure_is_made_small_and_kept(tmp_path: Path):
    def check(value):
        assert sum(value) < 1000

    wanted = Target("sums", st.lists(st.integers(0, 10**6)), check)
    with pytest.raises(AssertionError) as failure:
        search(wanted, 60, tmp_path)
    (file,) = (tmp_path / "sums").iterdir()
    assert failure.value.__notes__[-1] == f"kept as {file}"
    assert json.loads(file.read_text()) == [1000]


def test_a_search_ends_with_its_time(tmp_path: Path):
    """With a clock on which every check takes a second."""
    now = 0.0

    def check(value):
        nonlocal now
        assume(value % 3)  # what a check refuses costs its time too
        now += 1

    wanted = Target("patient", st.integers(), check)
    assert search(wanted, 250, tmp_path, clock=lambda: now) >= 250
    assert now == 250
    assert list((tmp_path / "patient").iterdir()) == []


@pytest.mark.parametrize(("ending", "code"), [("os.abort()", -6), ("time.sleep(60)", 1)])
def test_an_input_that_ends_the_process_stays_behind(tmp_path: Path, ending: str, code: int):
    script = tmp_path / "search.py"
    script.write_text(
        "import os, pathlib, time\n"
        "from hypothesis import strategies as st\n"
        "from tests.fuzz import target\n"
        "target.PATIENCE_S = 0.2\n"
        f"wanted = target.Target('deadly', st.just(7), lambda value: {ending})\n"
        f"target.search(wanted, 60, pathlib.Path({str(tmp_path)!r}))\n"
    )
    command = [sys.executable, script]
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, check=False)
    assert done.returncode == code
    file = tmp_path / "deadly" / UNFINISHED
    assert json.loads(file.read_text()) == 7


def test_what_is_silent_here_is_started_as_a_user_does(monkeypatch):
    """Started, `list` says nothing either, and is told of: no worker of its own could speak."""
    asked = []

    def silent(*arguments):
        asked.append(arguments)
        raise runs.SilentError("said nothing")

    monkeypatch.setattr(options, "command", silent)
    monkeypatch.setattr(options, "start", lambda *arguments: (0, ""))
    value = {"command": "list", "option": "--scene", "value": "0"}
    assert options.check_option(value) == "list --scene: exit 0"
    assert len(asked) == 1
    monkeypatch.setattr(options, "start", silent)
    with pytest.raises(runs.SilentError):
        options.check_option(value)


def test_silence_is_heard(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(runs, "SILENT_S", 0.0)
    with pytest.raises(runs.SilentError, match="said nothing for"):
        options.start("--version")
