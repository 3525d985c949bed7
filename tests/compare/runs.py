"""Run folders for tests, which differ from a default run by named edits."""

import json
import random
import statistics
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from harness.results.run_folder import Run, read_run
from tests.records import CASE

TRIANGULATORS = {
    "fan": (70_373, 99_275, 3.0e-3),
    "ear-clipping": (70_400, 99_383, 2.9e-3),
    "delaunay": (68_393, 91_355, 2.6e-3),
    "optimal:overdraw": (67_455, 87_603, 2.55e-3),
    "optimal:half-perimeter": (66_753, 84_795, 2.45e-3),
}
"""Triangulator -> quads, helper lanes, seconds of a draw."""

FRAGMENTS = 182_217
ROUNDS = 30
MACHINE = {"cpu": "Test CPU", "threads": 8, "kernel": "Linux 6.1", "python": "3.11.2"}

Edit = Callable[[dict[str, Any]], None]


def make_case(
    triangulator: str, *, seed: int, noise: float = 0.01, speed: float = 1.0
) -> dict[str, Any]:
    """Return the record of a default case; `noise` is the scatter of the samples."""
    quads, helpers, seconds = TRIANGULATORS[triangulator]
    times = make_time_without_median(f"{triangulator} {seed}", seconds / speed, noise)
    return {
        **CASE,
        "key": f"{list(TRIANGULATORS).index(triangulator):016x}",
        "triangulator": triangulator,
        "fit": "box",
        "options": {"samples": 1, "work": 0, "order": "native", "seed": 0},
        "reason": None,
        "polygons": 500,
        "vertices": 5_000,
        "triangles": 4_000,
        "predicted": {"overdraw": 150_000.0 + quads, "half_perimeter": 50_000.5 + quads},
        "counters": {"fragments": FRAGMENTS, "quads": quads, "helper_lanes": helpers},
        "triangulate_s": 0.05,
        "conforming": True,
        "t_junctions": 0,
        "coverage_error": 0,
        "time": {
            "timer": "wall",
            "samples_s": times,
            "median_s": statistics.median(times),
            "ci95_s": [sorted(times)[9], sorted(times)[20]],
            "reference_s": make_time_without_median(f"reference {seed}", 1.0e-3 / speed, noise),
            "empty_s": make_time_without_median(f"empty {seed}", 1.0e-5 / speed, noise),
        },
    }


def make_time_without_median(seed: str, seconds: float, noise: float) -> list[float]:
    """Return simulated times, which other programs lengthen but never shorten."""
    generator = random.Random(seed)
    return [
        round(seconds * (1 + abs(generator.gauss(0, noise)) + 0.002 * generator.random()), 9)
        for _ in range(ROUNDS)
    ]


def make_cases(
    seed: int, edits: Mapping[str, Edit] | None = None, without: tuple[str, ...] = (), **more: float
) -> list[dict[str, Any]]:
    """Return the records of all triangulators except `without`; see `write_run`."""
    names = [name for name in TRIANGULATORS if name not in without]
    cases = [make_case(name, seed=seed, **more) for name in names]
    for name, case in zip(names, cases, strict=True):
        for key in ("*", name):
            if edits and key in edits:
                edits[key](case)
    return cases


def write_run(
    path: Path,
    *,
    seed: int,
    edits: Mapping[str, Edit] | None = None,
    leave_out: tuple[str, ...] = (),
    cut_short: tuple[str, ...] = (),
    machine: Mapping[str, Any] = MACHINE,
    noise: float = 0.01,
    speed: float = 1.0,
    facts: Mapping[str, Any] | None = None,
) -> Path:
    """Write a run folder of all triangulators except `leave_out`.

    cut_short : triangulators that are in the plan and have no record
    edits : triangulator -> edit of the record; "*" is all triangulators
    """
    path.mkdir(parents=True)
    cases = make_cases(seed, edits, (*leave_out, *cut_short), noise=noise, speed=speed)
    (path / "cases.jsonl").write_text("".join(f"{json.dumps(case)}\n" for case in cases))
    git = {"commit": f"{seed:02d}" * 20, "dirty": False}
    details = {"renderer": "llvmpipe (LLVM 15.0.6, 256 bits)", "version": "4.5"}
    content = {
        "schema_version": 1,
        "created": f"2026-01-{seed:02d}T12:00:00Z",
        "plan": make_plan(leave_out),
        "environment": {"harness": "0.1.0", "git": git, **machine},
        "devices": {"opengl on llvmpipe": {"details": details}},
        "warnings": [],
        **(facts or {}),
    }
    (path / "run.json").write_text(json.dumps(content, indent=2))
    return path


def make_plan(leave_out: tuple[str, ...] = (), **changes: Any) -> dict[str, Any]:
    return {
        "scene": "city",
        "seed": 0,
        "triangulators": [name for name in TRIANGULATORS if name not in leave_out],
        "rasterisers": ["opengl"],
        "devices": [],
        "views": [{"resolution": 1024, "rotation": 0.0, "fit": "box"}],
        "options": [{"samples": 1, "work": 0, "order": "native", "seed": 0}],
        "timing": {"precision": 0.03, "budget_s": 0.3},
        **changes,
    }


def add_cost(share: float, *, time: float | None = None) -> Edit:
    """Return an edit that adds `share` to quads and, if given, `time` to every sample."""

    def edit(entry: dict[str, Any]) -> None:
        counters = entry["counters"]
        counters["quads"] = round(counters["quads"] * (1 + share))
        counters["helper_lanes"] = 4 * counters["quads"] - counters["fragments"]
        if time is not None:
            add_time(time)(entry)

    return edit


def add_time(share: float) -> Edit:
    def edit(entry: dict[str, Any]) -> None:
        timing = entry["time"]
        timing["samples_s"] = [round(s * (1 + share), 9) for s in timing["samples_s"]]
        timing["median_s"] *= 1 + share
        timing["ci95_s"] = [bound * (1 + share) for bound in timing["ci95_s"]]

    return edit


def pair_rounds(share: float = 0.0) -> Edit:
    """Return an edit that makes samples those of BASE in the same rounds, times 1 + `share`."""

    def edit(entry: dict[str, Any]) -> None:
        generator = random.Random(f"{entry['triangulator']} {share}")
        entry["time"]["samples_s"] = [
            round(s * (1 + share) * (1 + generator.gauss(0, 0.005)), 9)
            for s in entry["time"]["samples_s"]
        ]

    return edit


def set_failed(status: str, reason: str) -> Edit:
    def edit(entry: dict[str, Any]) -> None:
        for name in ("polygons", "counters", "time", "predicted", "triangles"):
            entry.pop(name, None)
        entry |= {"status": status, "reason": reason}

    return edit


def make_old(entry: dict[str, Any]) -> None:
    """Remove the fields that the oldest run files lack."""
    for name in ("fit", "options", "scene_hash", "polygons", "coverage_error", "predicted"):
        entry.pop(name)
    entry["time"].pop("empty_s")


def read_back(facts: Any, records: list[dict[str, Any]]) -> Run:
    with tempfile.TemporaryDirectory() as folder:
        lines = "".join(json.dumps(entry) + "\n" for entry in records)
        (Path(folder) / "cases.jsonl").write_text(lines)
        (Path(folder) / "run.json").write_text(json.dumps(facts))
        return read_run(Path(folder))


class Scenario(NamedTuple):
    """A function that writes `base` and `head`, and the expected exit code."""

    make: Callable[[], object]
    exit_code: int
    options: tuple[str, ...] = ()


BASE, HEAD = Path("base"), Path("head")


def write_pair(
    base: Mapping[str, Any] | None = None, folder: Path = Path(), **head: Any
) -> list[Path]:
    """Write BASE and HEAD, which differ from default runs by arguments of `write_run`."""
    base_path = write_run(folder / BASE, **{"seed": 1, **(base or {})})
    return [base_path, write_run(folder / HEAD, **{"seed": 2, **head})]


def read_pair(folder: Path, base: Mapping[str, Any] | None = None, **head: Any) -> list[Run]:
    return [read_run(path) for path in write_pair(base, folder, **head)]


def pair(base: Mapping[str, Any] | None = None, **head: Any) -> Callable[[], object]:
    return partial(write_pair, base, **head)


def missing_cases() -> None:
    def other_content(entry):
        entry["scene_hash"] = "5ce9e5ce9e5ce9e0"

    edits = {"delaunay": other_content}
    write_pair({"leave_out": ("optimal:half-perimeter",)}, leave_out=("ear-clipping",), edits=edits)


def counters_of_others() -> None:
    """An unregistered rasteriser with counters of other names, without times."""

    def foreign(share):
        def edit(entry):
            entry |= {"rasteriser": "tiler", "device": "asic"}
            entry["counters"] = {"hits": 182_217, "spills": round(5_000 * share)}
            entry.pop("time", None)

        return edit

    facts = {"plan": make_plan(rasterisers=["tiler"])}
    edits = {"*": foreign(1), "delaunay": foreign(1.5)}
    write_pair({"edits": {"*": foreign(1)}, "facts": facts}, edits=edits, facts=facts)


def corrupt_line() -> None:
    write_pair()
    lines = (HEAD / "cases.jsonl").read_text().splitlines(keepends=True)
    lines[2] = lines[2][: len(lines[2]) // 2] + "\n"
    (HEAD / "cases.jsonl").write_text("".join(lines) + '{"key": "torn')


def empty_run() -> None:
    write_pair()
    (HEAD / "cases.jsonl").write_text("")


def single_file() -> None:
    """Only the files of records, as stored by some CI jobs."""
    for run, seed in ((BASE, 1), (HEAD, 2)):
        write_run(Path(f"{run}-folder"), seed=seed)
        (Path(f"{run}-folder") / "cases.jsonl").rename(run)


REAL_REGRESSION = {"ear-clipping": add_cost(0.09, time=0.12)}
REAL_REGRESSION |= {"delaunay": add_cost(-0.02, time=-0.09)}
SKIPPED = set_failed("skipped", "triangulating took more than 60 s")
CRASHED = set_failed("failed", "triangulators crashed: SIGSEGV | last <output> & `more`")
SAME_ROUNDS = {"*": pair_rounds(), "delaunay": pair_rounds(0.03)}
OTHER_MACHINE = {**MACHINE, "cpu": "Other CPU", "threads": 4}
OLDER = {"edits": {"*": make_old}, "facts": {"schema_version": 0, "plan": None}}
CHANGED_PLAN = make_plan(seed=7, timing={"precision": 0.01, "budget_s": 2.0})
EVERYTHING_SLOWER = pair(edits={"*": add_time(0.12)})

SCENARIOS = {
    "equal-runs": Scenario(pair(), 0),
    "real-regression": Scenario(pair(edits=REAL_REGRESSION), 1),
    "time-regression": Scenario(pair(edits={"delaunay": add_time(0.1)}), 1),
    "noise-only": Scenario(pair({"noise": 0.5}, noise=0.5), 5),
    "missing-cases": Scenario(missing_cases, 0, ("--gate", "counters")),
    "now-skipped": Scenario(pair(edits={"*": SKIPPED}), 1, ("--gate", "counters")),
    "cut-short": Scenario(pair(cut_short=("delaunay", "optimal:overdraw")), 1),
    "counters-of-others": Scenario(counters_of_others, 1, ("--gate", "counters")),
    # Timed in the same rounds; one case takes 3 % longer.
    "same-rounds": Scenario(pair({"noise": 0.05}, seed=1, noise=0.05, edits=SAME_ROUNDS), 1),
    "not-gated": Scenario(EVERYTHING_SLOWER, 0, ("--gate", "counters")),
    "now-failing": Scenario(pair(edits={"delaunay": CRASHED}), 1),
    "different-machine": Scenario(pair(speed=1.7, machine=OTHER_MACHINE), 0),
    "everything-slower": Scenario(EVERYTHING_SLOWER, 0),
    "busy-machine": Scenario(pair(speed=0.85), 0),
    "older-schema": Scenario(pair(OLDER), 0),
    "corrupt-line": Scenario(corrupt_line, 1),
    "empty-run": Scenario(empty_run, 1),
    "single-file": Scenario(single_file, 0),
    "changed-plan": Scenario(pair(facts={"plan": CHANGED_PLAN}), 0),
    "no-baseline": Scenario(partial(write_run, HEAD, seed=2), 0, ("--allow-missing-baseline",)),
}
