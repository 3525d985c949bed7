import json
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
"""Default fields of a case."""


def make_record(triangulator: str = "ear-clipping", **fields: Any) -> Record:
    """Return a record of default fields, a computed key, and `fields`, named as in cases.jsonl."""
    record = parse_record({"key": "0" * 16, **CASE, "triangulator": triangulator, **fields})
    return record if "key" in fields else replace(record, key=record.id.key)


def make_time(**fields: Any) -> Time:
    """Return the times of a record from fields named as in cases.jsonl."""
    time = make_record(time=fields).time
    assert time is not None
    return time


def make_group(
    records: Iterable[Record | Mapping[str, Any]], base: str = "", state: Any = "quiet"
) -> RecordGroup:
    parsed = [record if isinstance(record, Record) else make_record(**record) for record in records]
    if not parsed:
        return RecordGroup(make_record().id.group, (), base, state)
    (group,) = group_records(parsed, base, state)
    return group


def make_run(records: Iterable[Record | Mapping[str, Any]], **facts: Any) -> Run:
    """Return a run without a folder from records, or from fields for `make_record`."""
    parsed = [record if isinstance(record, Record) else make_record(**record) for record in records]
    return Run(Path("nowhere"), facts, parsed)


class HasRecords(Protocol):
    """A run or the result of a run."""

    @property
    def records(self) -> Any: ...


def get_rows(run: HasRecords) -> list[dict[str, Any]]:
    """Return the fields of a run's records, with full names of triangulators and devices."""
    return [
        {
            **json.loads(json.dumps(record_to_json(record))),
            "triangulator": record.name,
            "device": record.id.device_name,
        }
        for record in run.records
    ]
