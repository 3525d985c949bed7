"""Compilation does not count as triangulating: it has a separate budget and message."""

import io
from collections.abc import Callable
from itertools import count
from typing import Any

from rich.console import Console
from shapely import box

from harness.measuring import pool as measuring_pool
from harness.measuring.pool import COMPILE_TIMEOUT_S, SECOND_PROCESS
from harness.measuring.run import run
from harness.progress import Reporter
from harness.triangulating.recipes import parse_all
from harness.worker import TaskTimeoutError
from tests.inline import InlineWorker
from tests.measuring.test_run import make_plan
from tests.records import get_rows
from triangulators import triangulate
from triangulators.compute import compiled_files


class Slow(InlineWorker):
    """An executor that reports a minute of loading, and notes the tasks' time limits."""

    def __init__(self, log: list[tuple[str, float | None]], fails: str = "") -> None:
        self._log = log
        self._fails = fails

    def call(self, function, *arguments, timeout_s=None, tick=None):
        self._log.append((function.__name__, timeout_s))
        if function.__name__ == self._fails:
            raise TaskTimeoutError("it exceeded its time limit and was killed")
        if tick and function.__name__ in ("warm_up", "triangulate_polygons"):
            tick(60.0)
        return super().call(function, *arguments)


def measured(block, out, log, fails="", names=("ear-clipping", "optimal:overdraw")):
    stream = io.StringIO()
    seconds = count(step=60)
    reporter = Reporter(console=Console(file=stream, width=200), clock=lambda: next(seconds))
    plan = make_plan(block, triangulators=names, timeout_s=7.0)
    result = run(plan, out, reporter, open_worker=lambda *_: Slow(log, fails))
    return get_rows(result), stream.getvalue()


def test_compilation_has_a_separate_budget_and_message(block, tmp_path):
    log: list[tuple[str, float | None]] = []
    records, output = measured(block, tmp_path / "out", log)
    assert {record["status"] for record in records} == {"ok"}
    assert {seconds for name, seconds in log if name == "warm_up"} == {COMPILE_TIMEOUT_S}
    assert {seconds for name, seconds in log if name == "triangulate_polygons"} == {7.0}
    # Once each before timing: the baseline, which is not a case, and the two triangulators.
    names = [name for name, _ in log if name in ("warm_up", "triangulate_polygons")]
    assert names == ["warm_up", "triangulate_polygons"] * 3
    assert ("compute_min_quads", COMPILE_TIMEOUT_S) in log
    assert output.count("compiling optimal:overdraw, once on each machine") == 1


def test_waiting_for_third_party_code_is_reported(block, tmp_path):
    name = "tests.broken:triangulate_clockwise"
    _, output = measured(block, tmp_path / "out", [], names=("ear-clipping", name))
    assert output.count(f"still waiting for the first polygons of {name}") == 1
    assert f"compiling {name}" not in output
    # One line while waiting for the baseline, one at its end, and so on.
    lines = [line for line in output.splitlines() if line.startswith("triangulating: ")]
    assert [line.split()[1] for line in lines] == ["0%", "33%", "33%", "67%", "67%"]


def test_slow_compilation_and_slow_triangulation_are_distinguished(block, tmp_path):
    slow, _ = measured(block, tmp_path / "slow", [], "triangulate_polygons")
    assert {record["status"] for record in slow} == {"skipped"}
    assert "triangulation exceeded 7 s; increase --timeout" in slow[0]["reason"]
    compiling, _ = measured(block, tmp_path / "compiling", [], "warm_up")
    assert {record["status"] for record in compiling} == {"skipped"}
    assert f"compilation exceeded {COMPILE_TIMEOUT_S:g} s" in compiling[0]["reason"]
    assert "smaller scene" not in compiling[0]["reason"]


class Recorded(InlineWorker):
    """An executor that notes the loaded triangulators, and whether it was closed."""

    def __init__(self, name: str, log: list[tuple[str, list[str]]]) -> None:
        self.name, self._log = name, log

    def call(self, function: Callable[..., Any], *arguments: Any, **_: Any) -> Any:
        self._log.append((self.name, [str(recipe) for recipe in arguments]))

    def close(self, *, at_once: bool = False) -> None:
        self._log.append((f"{self.name} closed", [str(at_once)]))


def test_a_second_process_compiles_in_reverse_order_if_nothing_is_compiled(monkeypatch):
    recipes = parse_all(["fan", "refined", "optimal", "tests.broken:triangulate_clockwise"])
    compiled = [(SECOND_PROCESS.name, ["optimal:overdraw", "refined:half-perimeter", "fan"])]
    for is_cached, cores, expected in ((False, 2, compiled), (True, 2, []), (False, 1, [])):
        log: list[tuple[str, list[str]]] = []
        monkeypatch.setattr(measuring_pool, "is_cached", lambda _, is_cached=is_cached: is_cached)
        monkeypatch.setattr(measuring_pool, "count_usable_cores", lambda cores=cores: cores)
        pool = measuring_pool.MeasuringPool(lambda name, *_: Recorded(name, log), 1.0)  # noqa: B023 - used up at once
        pool.compile_ahead(recipes)
        pool.compile_ahead(recipes)
        for thread in pool._threads.values():
            thread.shutdown()
        pool.close()
        assert log == [*expected, *[(f"{SECOND_PROCESS.name} closed", ["True"])] * len(expected)]


def test_the_late_module_has_kernels():
    triangulate(box(0, 0, 2, 1), "optimal:half-perimeter")
    assert compiled_files.is_cached(measuring_pool.COMPILED_LATE)
    assert not compiled_files.is_cached("triangulators.errors")
    assert not compiled_files.is_cached("triangulators.not_there")
