"""A run that is stopped keeps what it has, counters too, and says how to go on."""

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
from harness.results.run_folder import RunFolder, read_arrays, read_run
from tests.measuring.test_run import MOCK, NAMES, measure, plan_for
from tests.mock import MockRasteriser
from tests.paths import ROOT
from tests.records import lines_of

pytestmark = pytest.mark.usefixtures("no_plots")


def signal_while_timing(number: signal.Signals, patch: pytest.MonkeyPatch) -> None:
    """Have the harness told to stop when all is counted and nothing is timed."""

    def stopped(*_: object) -> None:
        os.kill(os.getpid(), number)
        raise AssertionError("it went on")

    patch.setattr(MeasuringPool, "time", stopped)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_counters_outlive_a_run_that_is_stopped_while_timing(block, tmp_path, monkeypatch, number):
    whole = lines_of(measure(plan_for(block), tmp_path / "whole"))
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        signal_while_timing(number, patch)
        result = measure(plan_for(block), out)
    assert result.interrupted
    assert result.aborted
    assert lines_of(result) == lines_of(read_run(out)) == []
    assert read_run(out).facts["interrupted"] is True
    counted = [json.loads(line) for line in (out / "counted.jsonl").read_text().splitlines()]
    assert [record["status"] for record in counted] == ["counted"] * len(NAMES)
    assert {r["key"]: r["counters"] for r in counted} == {r["key"]: r["counters"] for r in whole}

    def count(*_: object) -> None:
        raise AssertionError("counted again")

    monkeypatch.setattr(MockRasteriser, "_count", count)
    resumed = lines_of(measure(plan_for(block), out, resume=True))
    assert [record["status"] for record in resumed] == ["ok"] * len(NAMES)
    for record, other in zip(resumed, whole, strict=True):
        # How often triangulating is timed depends on how long it takes.
        names = [[n for n in each if n != "triangulate_samples_s"] for each in (record, other)]
        assert names[0] == names[1]
        assert record["counters"] == other["counters"]
        assert record["coverage_error"] == 0
        assert record["time"]["samples_s"]
        arrays = read_arrays(read_run(out), record["key"])
        assert arrays is not None
        assert arrays["fragments"].sum() == record["counters"]["fragments"]
    assert not (out / "counted.jsonl").exists()


def test_a_case_is_kept_as_soon_as_it_is_counted(block, tmp_path, monkeypatch):
    """Killed while the third is counted, with a torn line: two need not be counted again."""
    out = tmp_path / "out"
    count = MockRasteriser._count
    calls = []

    def count_twice(self: MockRasteriser, *rest: object) -> object:
        calls.append(rest)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return count(self, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(MockRasteriser, "_count", count_twice)
    assert measure(plan_for(block), out).interrupted
    with (out / "counted.jsonl").open("a") as file:
        file.write('{"key": "torn')
    calls[:] = ["a third call", "is", "none"]
    assert len(lines_of(measure(plan_for(block), out, resume=True))) == len(NAMES)
    # The two that were missing, and the baseline, which says what they cover.
    assert len(calls) == 3 + 3


def test_what_was_counted_by_other_code_is_counted_again_if_forced(block, tmp_path, monkeypatch):
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        signal_while_timing(signal.SIGTERM, patch)
        measure(plan_for(block), out)
    lines = (out / "counted.jsonl").read_text().replace('"quads": ', '"quads": 1')
    (out / "counted.jsonl").write_text(lines)
    forced = lines_of(measure(plan_for(block), out, resume=True, force=True))
    whole = lines_of(measure(plan_for(block), tmp_path / "whole"))
    assert [r["counters"] for r in forced] == [r["counters"] for r in whole]


def test_the_command_says_how_to_go_on(block, harness, monkeypatch):
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
    """Measure many short cases on the scripted rasteriser: no other processes, no plots."""
    views = tuple(View(size) for size in (64, 96, 128, 256, 512, 1024))
    measure(plan_for(Path(scene), views=views), Path(out), resume=bool(resume))


def test_a_killed_run_loses_nothing_and_can_be_resumed(block, tmp_path):
    """`make endurance` kills whole commands at 30 moments each."""
    out, cases = tmp_path / "killed", tmp_path / "killed" / "cases.jsonl"
    measure_many(str(block), str(tmp_path / "whole"))
    expected = {r["key"]: r["counters"] for r in lines_of(read_run(tmp_path / "whole"))}
    alone = [sys.executable, "-m", "tests.measuring.test_stopping", str(block), str(out)]
    process = subprocess.Popen(alone, cwd=ROOT, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (cases.exists() and cases.read_bytes().count(b"\n") >= 9):
        time.sleep(0.001)
    process.kill()
    process.wait()
    finished = lines_of(read_run(out))
    lines = cases.read_bytes().split(b"\n")
    assert [json.loads(line)["key"] for line in lines[:-1]] == [r["key"] for r in finished]
    assert 9 <= len(finished) < len(expected) == 24
    subprocess.run([*alone, "resume"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    resumed = read_run(out)
    assert resumed.problems == []
    assert lines_of(resumed)[: len(finished)] == finished
    assert {r["key"]: r["counters"] for r in lines_of(resumed)} == expected
    assert not (out / "counted.jsonl").exists()


if __name__ == "__main__":
    measure_many(*sys.argv[1:])
