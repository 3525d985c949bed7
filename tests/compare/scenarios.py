"""Pairs of runs that every output is tested with, each with the exit code it must lead to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tests.compare.runs import MACHINE, beside, costlier, failed, old, plan, slower, write_run


class Scenario(NamedTuple):
    """How `base` and `head` are made in the current folder, and what compare must say."""

    make: Callable[[], None]
    exit_code: int
    options: tuple[str, ...] = ()


BASE, HEAD = Path("base"), Path("head")


def equal_runs() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2)


def real_regression() -> None:
    write_run(BASE, seed=1)
    edits = {"ear-clipping": costlier(0.09, time=0.12), "delaunay": costlier(-0.02, time=-0.09)}
    write_run(HEAD, seed=2, edits=edits)


def time_regression() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, edits={"delaunay": slower(0.1)})


def noise_only() -> None:
    write_run(BASE, seed=1, noise=0.5)
    write_run(HEAD, seed=2, noise=0.5)


def missing_cases() -> None:
    def other_content(entry):
        entry["scene_hash"] = "5ce9e5ce9e5ce9e0"

    write_run(BASE, seed=1, leave_out=("optimal:half-perimeter",))
    write_run(HEAD, seed=2, leave_out=("ear-clipping",), edits={"delaunay": other_content})


def now_skipped() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, edits={"*": failed("skipped", "triangulating took more than 60 s")})


def cut_short() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, cut_short=("delaunay", "optimal:overdraw"))


def counters_of_others() -> None:
    """A rasteriser that nobody registered: its counters are its own, and nothing is timed."""

    def foreign(share):
        def edit(entry):
            entry |= {"rasteriser": "tiler", "device": "asic"}
            entry["counters"] = {"hits": 182_217, "spills": round(5_000 * share)}
            entry.pop("time", None)

        return edit

    facts = {"plan": plan(rasterisers=["tiler"])}
    write_run(BASE, seed=1, edits={"*": foreign(1)}, facts=facts)
    write_run(HEAD, seed=2, edits={"*": foreign(1), "delaunay": foreign(1.5)}, facts=facts)


def same_rounds() -> None:
    """BASE and HEAD were timed together; one case takes 3 % longer, whatever the machine did."""
    write_run(BASE, seed=1, noise=0.05)
    write_run(HEAD, seed=1, noise=0.05, edits={"*": beside(), "delaunay": beside(0.03)})


def now_failing() -> None:
    write_run(BASE, seed=1)
    crashed = failed("failed", "triangulators died: SIGSEGV | last <output> & `more`")
    write_run(HEAD, seed=2, edits={"delaunay": crashed})


def different_machine() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, speed=1.7, machine={**MACHINE, "cpu": "Other CPU", "threads": 4})


def everything_slower() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, edits={"*": slower(0.12)})


def busy_machine() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2, speed=0.85)


def older_schema() -> None:
    write_run(BASE, seed=1, edits={"*": old}, facts={"schema_version": 0, "plan": None})
    write_run(HEAD, seed=2)


def corrupt_line() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2)
    lines = (HEAD / "cases.jsonl").read_text().splitlines(keepends=True)
    lines[2] = lines[2][: len(lines[2]) // 2] + "\n"
    (HEAD / "cases.jsonl").write_text("".join(lines) + '{"key": "torn')


def empty_run() -> None:
    write_run(BASE, seed=1)
    write_run(HEAD, seed=2)
    (HEAD / "cases.jsonl").write_text("")


def single_file() -> None:
    """Only the file of records is kept, as an artifact of CI may be."""
    for run, seed in ((BASE, 1), (HEAD, 2)):
        write_run(Path(f"{run}-folder"), seed=seed)
        (Path(f"{run}-folder") / "cases.jsonl").rename(run)


def changed_plan() -> None:
    write_run(BASE, seed=1)
    changed = plan(seed=7, timing={"precision": 0.01, "budget_s": 2.0})
    write_run(HEAD, seed=2, facts={"plan": changed})


def no_baseline() -> None:
    write_run(HEAD, seed=2)


SCENARIOS = {
    "equal-runs": Scenario(equal_runs, 0),
    "real-regression": Scenario(real_regression, 1),
    "time-regression": Scenario(time_regression, 1),
    "noise-only": Scenario(noise_only, 5),
    "missing-cases": Scenario(missing_cases, 0, ("--gate", "counters")),
    "now-skipped": Scenario(now_skipped, 1, ("--gate", "counters")),
    "cut-short": Scenario(cut_short, 1),
    "counters-of-others": Scenario(counters_of_others, 1, ("--gate", "counters")),
    "same-rounds": Scenario(same_rounds, 1),
    "not-gated": Scenario(everything_slower, 0, ("--gate", "counters")),
    "now-failing": Scenario(now_failing, 1),
    "different-machine": Scenario(different_machine, 0),
    "everything-slower": Scenario(everything_slower, 0),
    "busy-machine": Scenario(busy_machine, 0),
    "older-schema": Scenario(older_schema, 0),
    "corrupt-line": Scenario(corrupt_line, 1),
    "empty-run": Scenario(empty_run, 1),
    "single-file": Scenario(single_file, 0),
    "changed-plan": Scenario(changed_plan, 0),
    "no-baseline": Scenario(no_baseline, 0, ("--allow-missing-baseline",)),
}
