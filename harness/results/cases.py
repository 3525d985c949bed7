"""Records by case: of cases that a run holds twice, the later record counts."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from harness.results.record import CaseId, Record
from harness.results.run_folder import Run, read_run


def latest(run: Run) -> Run:
    """Return the run with one record a case, and a problem for each record that is left out.

    A run that was resumed by force may hold two contents of a scene.
    """
    problems = list(run.problems)
    records: dict[CaseId, Record] = {}
    for record in run.records:
        if records.pop(record.id, None) is not None:
            problems.append(f"{record.id}: measured twice; the later counts")
        records[record.id] = record
    return replace(run, records=list(records.values()), problems=problems)


def read_latest(path: Path, warn: Callable[[str], None]) -> Run:
    """Return `latest` of the run at `path`; `warn` gets each problem, such as a damaged record.

    Raises
    ------
    UsageError
        as `read_run` does
    """
    run = latest(read_run(path))
    for problem in run.problems:
        warn(problem)
    return run
