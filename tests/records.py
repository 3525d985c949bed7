"""Records made up for tests: each names what is special about it, the rest is usual."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from harness.metrics.groups import RecordGroup, group_records
from harness.results.parsing import parse_record, record_to_json
from harness.results.record import Record, Time
from harness.results.run_folder import Run

CASE: dict[str, Any] = {
    "scene": "city",
    "scene_hash": "c17c17c17c17c17c",
    "rasteriser": "opengl",
    "device": "llvmpipe",
    "resolution": 1024,
    "rotation": 0.0,
    "status": "ok",
}
"""Fields of a usual case."""


def make_record(triangulator: str = "ear-clipping", **fields: Any) -> Record:
    """Return a record of a usual case with other fields, as a line of cases.jsonl has them.

    Without a `key` it has that of its case.
    """
    record = parse_record({"key": "0" * 16, **CASE, "triangulator": triangulator, **fields})
    return record if "key" in fields else replace(record, key=record.id.key)


def make_time(**fields: Any) -> Time:
    """Return a record's times, of fields as cases.jsonl has them."""
    time = make_record(time=fields).time
    assert time is not None
    return time


def make_group(
    records: Iterable[Record | Mapping[str, Any]], base: str = "", state: Any = "quiet"
) -> RecordGroup:
    """Return the one group of records, or of fields that `make_record` takes."""
    typed = [each if isinstance(each, Record) else make_record(**each) for each in records]
    if not typed:
        return RecordGroup(make_record().id.group, (), base, state)
    (group,) = group_records(typed, base, state)
    return group


def make_run(records: Iterable[Record | Mapping[str, Any]], **facts: Any) -> Run:
    """Return a run in no folder, of records or of fields that `make_record` takes."""
    typed = [each if isinstance(each, Record) else make_record(**each) for each in records]
    return Run(Path("nowhere"), facts, typed)


class HasRecords(Protocol):
    """A run, or the result of one."""

    @property
    def records(self) -> Any: ...


def lines_of(run: HasRecords) -> list[dict[str, Any]]:
    """Return the fields of a run's records, with full names of triangulators and devices."""
    return [
        {
            **record_to_json(record),
            "triangulator": record.name,
            "device": record.id.device_name,
        }
        for record in run.records
    ]
