"""A stopped run stores finished cases and counters, and prints how to continue."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from harness.frame import View
from harness.measuring.pool import MeasuringPool
from harness.results.run_folder import read_arrays, read_run
from harness.results.run_writer import RunFolder
from tests.measuring.test_run import MOCK, NAMES, make_plan, measure
from tests.mock import MockRasteriser
from tests.paths import ROOT
from tests.records import get_rows

pytestmark = pytest.mark.usefixtures("no_plots")


def signal_in(step: str, number: signal.Signals, patch: pytest.MonkeyPatch) -> None:
    """Send a signal to the harness at the start of a step; timing follows counting."""

    def stopped(*_: object) -> None:
        os.kill(os.getpid(), number)
        raise AssertionError("it went on")

    patch.setattr(MeasuringPool, step, stopped)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_counters_of_a_run_stopped_while_timing_are_reused(block, tmp_path, monkeypatch, number):
    complete = get_rows(measure(make_plan(block), tmp_path / "whole"))
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        signal_in("time_drawings", number, patch)
        result = measure(make_plan(block), out)
    assert (result.interrupted, result.aborted) == (True, True)
    assert get_rows(result) == get_rows(read_run(out)) == []
    assert read_run(out).facts["interrupted"] is True
    counted = [json.loads(line) for line in (out / "counted.jsonl").read_text().splitlines()]
    assert [record["status"] for record in counted] == ["counted"] * len(NAMES)
    assert {r["key"]: r["counters"] for r in counted} == {r["key"]: r["counters"] for r in complete}

    def count(*_: object) -> None:
        raise AssertionError("counted again")

    monkeypatch.setattr(MockRasteriser, "_draw_and_count", count)
    resumed = get_rows(measure(make_plan(block), out, resume=True))
    assert [record["status"] for record in resumed] == ["ok"] * len(NAMES)
    for record, other in zip(resumed, complete, strict=True):
        # The number of timed rounds depends on the speed.
        names = [[n for n in fields if n != "triangulate_samples_s"] for fields in (record, other)]
        assert names[0] == names[1]
        assert record["counters"] == other["counters"]
        assert record["coverage_error"] == 0
        assert record["time"]["samples_s"]
        arrays = read_arrays(read_run(out), record["key"])
        assert arrays["fragments"].sum() == record["counters"]["fragments"]
    assert not (out / "counted.jsonl").exists()


@pytest.mark.parametrize("step", ["triangulate", "draw_and_count"])
def test_first_interrupt_stops_at_once_while_nothing_is_timed(block, tmp_path, monkeypatch, step):
    signal_in(step, signal.SIGINT, monkeypatch)
    result = measure(make_plan(block), tmp_path / "out")
    assert (result.interrupted, result.aborted) == (True, True)
    assert read_run(tmp_path / "out").facts["interrupted"] is True


def test_counted_cases_are_stored_at_once(block, tmp_path, monkeypatch):
    """Killed while counting the third case, with a partial line: two are not counted again."""
    out = tmp_path / "out"
    count = MockRasteriser._draw_and_count
    calls = []

    def count_twice(self: MockRasteriser, *arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return count(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(MockRasteriser, "_draw_and_count", count_twice)
    assert measure(make_plan(block), out).interrupted
    with (out / "counted.jsonl").open("a") as file:
        file.write('{"key": "torn')
    calls[:] = ["a third call", "is", "none"]
    assert len(get_rows(measure(make_plan(block), out, resume=True))) == len(NAMES)
    # The two missing cases, and the baseline, which defines the coverage.
    assert len(calls) == 3 + 3


def test_force_counts_cases_of_other_code_again(block, tmp_path, monkeypatch):
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        signal_in("time_drawings", signal.SIGTERM, patch)
        measure(make_plan(block), out)
    lines = (out / "counted.jsonl").read_text().replace('"quads": ', '"quads": 1')
    (out / "counted.jsonl").write_text(lines)
    forced = get_rows(measure(make_plan(block), out, resume=True, force=True))
    complete = get_rows(measure(make_plan(block), tmp_path / "whole"))
    assert [r["counters"] for r in forced] == [r["counters"] for r in complete]


def test_the_command_prints_how_to_resume(block, harness, monkeypatch):
    append = RunFolder.append

    def append_and_stop(self: RunFolder, record: dict[str, object]) -> None:
        append(self, record)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(RunFolder, "append", append_and_stop)
    names = ("--triangulators", "ear-clipping,delaunay", "--rasterisers", MOCK, "--quick", "-q")
    code, out, err = harness("run", "--scene", str(block), "--out", "out", *names)
    assert code == 130
    assert "stopped early; continue with: raster-harness run --resume out" in out
    assert "Traceback" not in err
    assert Path("out/cases.jsonl").read_text().count("\n") == 1


def measure_many(scene: str, out: str, *resume: str) -> None:
    """Measure many short cases on the scripted rasteriser, without worker processes or plots."""
    views = tuple(View(size) for size in (64, 96, 128, 256, 512, 1024))
    measure(make_plan(Path(scene), views=views), Path(out), resume=bool(resume))


def test_a_killed_run_loses_nothing_and_can_be_resumed(block, tmp_path):
    """`make endurance` kills complete commands at 30 moments each."""
    out, cases = tmp_path / "killed", tmp_path / "killed" / "cases.jsonl"
    measure_many(str(block), str(tmp_path / "whole"))
    expected = {r["key"]: r["counters"] for r in get_rows(read_run(tmp_path / "whole"))}
    command = [sys.executable, "-m", "tests.measuring.test_stopping", str(block), str(out)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (cases.exists() and cases.read_bytes().count(b"\n") >= 9):
        time.sleep(0.001)
    process.kill()
    process.wait()
    finished = get_rows(read_run(out))
    lines = cases.read_bytes().split(b"\n")
    assert [json.loads(line)["key"] for line in lines[:-1]] == [r["key"] for r in finished]
    assert 9 <= len(finished) < len(expected) == 24
    subprocess.run([*command, "resume"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    resumed = read_run(out)
    assert resumed.problems == []
    assert get_rows(resumed)[: len(finished)] == finished
    assert {r["key"]: r["counters"] for r in get_rows(resumed)} == expected
    assert not (out / "counted.jsonl").exists()


if __name__ == "__main__":
    measure_many(*sys.argv[1:])
