"""Complete runs on a scripted rasteriser: measuring, storing, resuming, refusals."""

import json
import os
import signal
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from rich.console import Console
from shapely import Polygon, box

import triangulators
from harness import rasterisers
from harness.errors import HarnessError, NothingMeasuredError, UsageError
from harness.frame import Frame, View, make_bare_frame
from harness.machine.environment import describe_processor
from harness.measuring import tasks
from harness.measuring.plan import Plan
from harness.measuring.pool import Backend, MeasuringPool
from harness.measuring.run import RunOptions, RunResult, run
from harness.measuring.timing import MIN_ROUNDS, Times, TimingSettings
from harness.progress import Reporter
from harness.rasterisers.base import Counters, Options
from harness.results.run_folder import read_arrays, read_run
from harness.results.run_writer import RunFolder
from harness.triangulating.recipes import Recipe, parse_all
from harness.worker import OpenWorker, Worker
from tests.conftest import write_geojson
from tests.inline import InlineWorker
from tests.mock import MockRasteriser
from tests.records import get_rows
from triangulators import PolygonArray

MOCK = "tests.mock:MockRasteriser"
FAST = TimingSettings(precision=0.5, budget_s=0.01, warm_up_s=0.0)
NAMES = ("ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter")


def inline(name: str, environment: object, limits: object = None) -> InlineWorker:
    return InlineWorker()


def make_plan(scene: Path, **changes: object) -> Plan:
    names = parse_all(changes.pop("triangulators", NAMES))  # type: ignore[arg-type]
    plan = Plan(scene=str(scene), triangulators=names, rasterisers=(MOCK,), timing=FAST)
    return replace(plan, **changes)  # type: ignore[arg-type]


def quiet() -> Reporter:
    return Reporter(quiet=True, console=Console(quiet=True))


def measure(
    plan: Plan, out: Path, open_worker: OpenWorker = inline, **options: object
) -> RunResult:
    MockRasteriser.begin_run()
    return run(plan, out, quiet(), RunOptions(**options), open_worker=open_worker)  # type: ignore[arg-type]


def test_every_case_gets_a_complete_record(block, tmp_path):
    outcome = measure(make_plan(block), tmp_path / "out")
    records = {record["triangulator"]: record for record in get_rows(outcome)}
    assert set(records) == set(NAMES)
    for record in records.values():
        assert (record["status"], record["polygons"], record["conforming"]) == ("ok", 3, True)
        # n + 2h - 2 per polygon: an L of 6, a square with a square hole, a square.
        assert (record["triangles"], record["coverage_error"]) == (4 + 8 + 2, 0)
        counters = record["counters"]
        assert 4 * counters["quads"] == counters["fragments"] + counters["helper_lanes"]
        assert len(record["time"]["samples_s"]) >= MIN_ROUNDS
        assert record["time"]["timer"] == "wall"
        assert record["time"]["reference_s"] == get_rows(outcome)[0]["time"]["reference_s"]
    best = records["optimal:overdraw"]["predicted"]["overdraw"]
    assert best == min(record["predicted"]["overdraw"] for record in records.values())
    stored = read_run(tmp_path / "out")
    assert (stored.records, stored.problems) == (outcome.records, [])
    assert (stored.facts["scene"]["polygons"], stored.facts["interrupted"]) == (3, False)
    columns = read_arrays(stored, records["delaunay"]["key"])
    assert columns["predicted_triangles"].tolist() == [4, 8, 2]
    assert columns["fragments"].sum() == records["delaunay"]["counters"]["fragments"]


def skip_batch(_recipe: Recipe, polygons: PolygonArray) -> tuple[list[object], np.ndarray]:
    return [], np.zeros(len(polygons), np.bool_)


def make_failing(name: str, holes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the triangulator `name` fail on every polygon with this number of holes."""
    original = triangulators.triangulate_with_gap

    def triangulate(polygon: Polygon, triangulator: str, **options: object) -> object:
        if triangulator == name and len(polygon.interiors) == holes:
            raise ValueError("scripted")
        return original(polygon, triangulator, **options)

    monkeypatch.setattr(triangulators, "triangulate_with_gap", triangulate)
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)


def test_excess_coverage_is_detected_if_the_baseline_skips_polygons(block, tmp_path, monkeypatch):
    make_failing("delaunay", 1, monkeypatch)
    count = MockRasteriser._draw_and_count

    def count_too_much(self: MockRasteriser, frame: Frame, *arguments: object) -> Counters:
        counters = count(self, frame, *arguments)  # type: ignore[arg-type]
        # The fan has 4 + 2; ear clipping, with the courtyard, has 14.
        if len(arguments[0]) == 14:  # type: ignore[arg-type]
            counters["fragments"] += [1, 10, 100]
        return counters

    monkeypatch.setattr("tests.mock.MockRasteriser._draw_and_count", count_too_much)
    plan = make_plan(block, triangulators=("fan", "ear-clipping", "delaunay"))
    records = {r["triangulator"]: r for r in get_rows(measure(plan, tmp_path / "out"))}
    errors = {name: r["coverage_error"] for name, r in records.items()}
    assert errors == {"fan": 0, "ear-clipping": 101, "delaunay": 0}
    fan, delaunay = records["fan"], records["delaunay"]
    assert (fan["polygons"], fan["polygons_skipped"]) == (2, 1)
    assert "skipped polygon 1" in fan["reason"]
    assert delaunay["polygons_failed"] == 1


def test_coverage_is_unknown_without_common_polygons(tmp_path, monkeypatch):
    make_failing("delaunay", 0, monkeypatch)
    scene = write_geojson(tmp_path / "squares.geojson", [box(0, 0, 4, 4), box(6, 0, 9, 3)])
    plan = make_plan(scene, triangulators=("fan", "delaunay"))
    records = {r["triangulator"]: r for r in get_rows(measure(plan, tmp_path / "out"))}
    assert (records["fan"]["status"], records["fan"]["coverage_error"]) == ("ok", None)
    assert records["delaunay"]["status"] == "failed"


def test_scenes_of_triangles_are_refused(tmp_path):
    """An icosahedron: no two faces are coplanar."""
    trimesh.creation.icosphere(0).export(tmp_path / "die.obj")
    plan = make_plan(tmp_path / "die.obj", triangulators=("fan",))
    with pytest.raises(NothingMeasuredError, match=r"every polygon is a triangle"):
        measure(plan, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_resume_measures_only_missing_cases(block, tmp_path):
    complete = get_rows(measure(make_plan(block), tmp_path / "whole"))
    out = tmp_path / "out"
    measure(make_plan(block), out)
    lines = (out / "cases.jsonl").read_text().splitlines(keepends=True)
    (out / "cases.jsonl").write_text("".join(lines[:2]) + lines[2][:50])
    stored = get_rows(read_run(out))
    resumed = get_rows(measure(make_plan(block), out, resume=True))
    assert resumed[:2] == stored
    counters = [[(r["key"], r["counters"]) for r in rows] for rows in (resumed, complete)]
    assert counters[0] == counters[1]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ("plan", r"cannot be resumed, as these changed: plan \(seed: 0 then, 7 now\)"),
        ("scene", "the scene's content"),
        ("code", "these changed: the code;"),
        ("machine", "these changed: the machine;"),
    ],
)
def test_resume_refuses_differences_unless_forced(block, tmp_path, monkeypatch, changed, reason):
    plan, out = make_plan(block), tmp_path / "out"
    measure(plan, out)
    if changed == "plan":
        plan = make_plan(block, seed=7)
    elif changed == "scene":
        write_geojson(block, [box(0, 0, 5, 7)])
    elif changed == "code":
        monkeypatch.setattr("harness.machine.environment.hash_code", lambda: "other")
    else:
        other = {**describe_processor(), "label": "another processor"}
        monkeypatch.setattr("harness.measuring.run.describe_processor", lambda: other)
    with pytest.raises(HarnessError, match=reason):
        measure(plan, out, resume=True)
    if changed in ("plan", "machine"):
        assert get_rows(measure(plan, out, resume=True, force=True))


def test_resume_repeats_failed_but_not_skipped_cases(tmp_path, monkeypatch):
    courtyard = box(0, 0, 16, 16).difference(box(4, 4, 12, 12))
    scene = write_geojson(tmp_path / "courtyard.geojson", [courtyard])
    plan = make_plan(scene, triangulators=("fan", "ear-clipping"))
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        make_failing("ear-clipping", 1, patch)
        statuses = [r["status"] for r in get_rows(measure(plan, out))]
    assert statuses == ["skipped", "failed"]
    before = (out / "cases.jsonl").read_text()
    assert [r["status"] for r in get_rows(measure(plan, out, resume=True))] == ["skipped", "ok"]
    after = (out / "cases.jsonl").read_text()
    assert after.startswith(before)
    assert json.loads(after[len(before) :])["triangulator"] == "ear-clipping"  # a single line


def interrupt_after_one(monkeypatch):
    append = RunFolder.append

    def append_and_interrupt(self: RunFolder, record: dict[str, object]) -> None:
        append(self, record)
        if len(get_rows(read_run(self.path))) == 1:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(RunFolder, "append", append_and_interrupt)


def test_an_interrupt_preserves_finished_cases(block, tmp_path, monkeypatch):
    interrupt_after_one(monkeypatch)
    plan = make_plan(block, views=(View(64), View(128)))
    outcome = measure(plan, tmp_path / "out")
    assert outcome.interrupted
    assert {r["resolution"] for r in get_rows(outcome)} == {64}
    assert len(get_rows(outcome)) == len(NAMES)
    assert len(get_rows(measure(plan, tmp_path / "out", resume=True))) == 2 * len(NAMES)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("count:crash", "crashed: SIGABRT"),
        ("time:crash", "crashed: SIGABRT"),
        ("time:raise", "RuntimeError: scripted failure"),
        ("count:hang", "exceeded the time limit of 4 s"),
    ],
)
def test_a_device_failure_affects_only_its_case(tmp_path, monkeypatch, fault, reason):
    # The mock fails on an odd number of triangles. A complete triangulation has 7 + 4 + 3;
    # the fan skips the courtyard and has 4 + 3.
    monkeypatch.setenv("MOCK_FAULT", fault)
    courtyard = Polygon(box(20, 0, 36, 16).exterior, [[(24, 4), (32, 4), (28, 12)]])
    ell = Polygon([(0, 0), (12, 0), (12, 4), (4, 4), (4, 10), (0, 10)])
    house = Polygon([(0, 20), (8, 20), (8, 26), (4, 29), (0, 26)])
    scene = write_geojson(tmp_path / "odd.geojson", [courtyard, ell, house])
    plan = make_plan(scene, triangulators=("fan", "ear-clipping", "delaunay"), timeout_s=4.0)
    outcome = measure(plan, tmp_path / "out", open_worker=Worker)
    records = {record["triangulator"]: record for record in get_rows(outcome)}
    statuses = {name: record["status"] for name, record in records.items()}
    assert statuses == {"fan": "failed", "ear-clipping": "ok", "delaunay": "ok"}
    assert reason in records["fan"]["reason"]
    assert records["delaunay"]["triangles"] == 14


def test_upright_triangulations_are_drawn_rotated(block, tmp_path):
    names = ("delaunay", "optimal:overdraw", "optimal:overdraw@0")
    views = (View(256, 0.0, "circle"), View(256, 35.0, "circle"))
    outcome = measure(make_plan(block, triangulators=names, views=views), tmp_path / "out")
    seen = {(r["triangulator"], r["rotation"]): r for r in get_rows(outcome)}
    assert {record["status"] for record in get_rows(outcome)} == {"ok"}
    fresh, carried = "optimal:overdraw", "optimal:overdraw@0"
    overdraw = {key: record["predicted"]["overdraw"] for key, record in seen.items()}
    assert overdraw[carried, 0.0] == overdraw[fresh, 0.0]
    # The new triangulation is optimal; the carried-over one cannot be better.
    assert overdraw[carried, 35.0] >= overdraw[fresh, 35.0]
    assert seen[carried, 35.0]["coverage_error"] == 0


def test_random_triangulations_have_separate_seeds(block, tmp_path):
    plan = make_plan(block, triangulators=("random#1", "random#2", "random#1"))
    records = get_rows(measure(plan, tmp_path / "out"))
    assert [record["triangulator"] for record in records] == ["random#1", "random#2"]
    with pytest.raises(UsageError, match="write a seed as random#7"):
        measure(make_plan(block, triangulators=("delaunay#1",)), tmp_path / "other")


def test_repeats_are_new_processes_in_turn(block, tmp_path):
    log: list[str] = []

    class Watched(InlineWorker):
        def __init__(self, name: str, *_: object, **__: object) -> None:
            self._name = name
            log.append(f"{name} begins")

        def close(self, *, at_once: bool = False) -> None:
            log.append(f"{self._name} ends")

    plan = make_plan(block, timing=replace(FAST, processes=3))
    assert get_rows(measure(plan, tmp_path / "out", open_worker=Watched))
    drawing = f"{MOCK} on scripted"
    steps = [line.removeprefix(drawing) for line in log if line.startswith(drawing)]
    assert steps == [" begins", " ends"] * 3
    for record in get_rows(read_run(tmp_path / "out")):
        times = record["time"]
        assert len(times["processes"]) == 3
        assert min(times["processes"]) >= MIN_ROUNDS
        assert sum(times["processes"]) == sum(times["epochs"]) == len(times["samples_s"])
        assert len(times["reference_s"]) == len(times["samples_s"])
    # A plan of one process has no field for processes, as in older runs.
    assert "processes" not in make_plan(block).to_json()["timing"]
    assert Plan.from_json(plan.to_json()).timing == plan.timing
    assert Plan.from_json(make_plan(block).to_json()).timing.processes == 1


@pytest.mark.parametrize(
    ("took", "limits"),
    [(2.0, [5.0, 6.0, 8.0, 14.0]), (9.0, [5.0, 11 / 3, 1.0]), (30.0, [5.0])],
)
def test_processes_share_a_time_limit(monkeypatch, took, limits):
    shares: list[float | None] = []

    def timed(*arguments: object) -> dict[str, Times]:
        shares.extend(a.limit_s for a in arguments if isinstance(a, TimingSettings))
        return {"a": Times(1, [took], [1])}

    clock = SimpleNamespace(perf_counter=lambda: took * len(shares))
    monkeypatch.setattr("harness.measuring.pool.time", clock)
    monkeypatch.setattr(tasks, "time_group", timed)
    backend = Backend(MOCK, rasterisers.find_device(MOCK, None))
    corners = np.array([[0, 0], [8, 0], [0, 8]], np.int32)
    drawn = make_bare_frame(8, corners), np.arange(3, dtype=np.int32)[None], Options()
    settings = TimingSettings(processes=4, limit_s=20.0)
    with closing(MeasuringPool(inline, timeout_s=1.0)) as pool:
        groups, failures = pool.time_drawings(backend, {"a": drawn}, settings, seed=0)
    assert not failures
    assert shares == pytest.approx(limits)
    assert groups["a"]["a"].epochs == [1] * len(limits)
