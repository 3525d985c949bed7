"""Several runs as one: the same records in the same order, whatever the order of the runs.

A device on another host is another device, because its times are: it is called device@host.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.errors import IncompatibleRunsError, InputError, UsageError
from harness.metrics.processors import find_mixed_processors, format_processors
from harness.results import drawings
from harness.results.parsing import record_to_json
from harness.results.record import HOST_MARK, CaseGroup, Record, RunFacts
from harness.results.run_folder import POLYGONS, Run, RunFolder, file_stem, read_arrays

STATUSES = ("ok", "skipped", "failed")
"""A record of the first wins over one of the others, which say only that it did not work there."""


@dataclass(frozen=True)
class _Source:
    """A record and the run that it is from, in which `record.key` names its arrays."""

    record: Record
    run: Run


def on_host(run: Run, host: str) -> Run:
    """Return the run with all its devices on `host`, which makes other cases of its cases.

    Raises
    ------
    IncompatibleRunsError, UsageError
        if a host's name cannot be part of a device's
    """
    if not host or file_stem(host) != host:
        raise UsageError(f"host {host!r}: give letters, digits, hyphens and dots")
    for record in run.records:
        if record.id.host or HOST_MARK in record.id.device:
            raise IncompatibleRunsError(
                f"{run.path} has devices of a host already: {record.id.device_name}"
            )
    records = [record.with_id(host=host) for record in run.records]
    named_devices = run.facts.get("devices") or {}
    devices = {f"{label}{HOST_MARK}{host}": device for label, device in named_devices.items()}
    return replace(run, records=records, facts={**run.facts, "devices": devices})


def merge(runs: Sequence[Run], out: Path) -> int:
    """Merge runs into a new run folder; returns how many records it has.

    Raises
    ------
    IncompatibleRunsError
        if times of a software device are of several processors, records of one case differ,
        counters of one kind of device differ between hosts, the runs are of different scenes or do
        not say of which, one run is given under two hosts' names, or the folder cannot be written
    """
    _refuse_other_scenes(runs)
    _refuse_one_run_twice(runs)
    if mixed := find_mixed_processors(runs):
        raise IncompatibleRunsError(
            f"times of a software rasteriser are the processor's: {format_processors(mixed)}; "
            "keep the runs apart with --hosts"
        )
    sources = _by_key(runs)
    _refuse_other_counters([source.record for source in sources])
    facts = _facts(runs)
    names = facts["plan"]["triangulators"]
    sources.sort(key=lambda source: _sort_key(source.record, names))
    again = f"remove {out} and give the same command again"
    with RunFolder.create(out, again) as store:
        store.write_facts({**facts, "interrupted": True})  # until the folder is complete
        _keep_drawings(store, runs)
        for source in sources:
            record = replace(source.record, key=source.record.id.key)
            arrays = read_arrays(source.run, source.record.key)
            if arrays is not None:
                store.write_arrays(record.key, arrays, POLYGONS)
            store.append(record)
        store.write_facts(facts)
    return len(sources)


def _describe(record: Record) -> str:
    case = record.id
    where = f"{case.rasteriser} on {case.device_name}"
    return f"{record.name}, {case.group.condition}, {where}"


def _by_key(runs: Iterable[Run]) -> list[_Source]:
    """Return the record of each case; raise IncompatibleRunsError if two good ones differ."""
    sources: dict[str, _Source] = {}
    for run in sorted(runs, key=lambda run: str(run.path)):
        for record in run.records:
            new, old = _Source(record, run), sources.get(record.id.key)
            if old is None or _rank(new) < _rank(old):
                sources[record.id.key] = new
            elif old.record.status == record.status == "ok" and old.record != record:
                raise IncompatibleRunsError(
                    f"records of one case differ: {_describe(record)} ({old.run.path} and "
                    f"{run.path}); if the runs are of different hosts, name these with --hosts"
                )
    return list(sources.values())


def _rank(source: _Source) -> tuple[int, str]:
    """Return the least for the record to use; two good ones must be equal, so they rank equal."""
    record = source.record
    content = "" if record.is_ok else json.dumps(record_to_json(record), sort_keys=True)
    return STATUSES.index(record.status), content


def _refuse_other_counters(records: Iterable[Record]) -> None:
    """Counters are exact: one kind of device gives the same on every host."""
    first: dict[str, Record] = {}
    for record in sorted(records, key=lambda record: record.id.device_name):
        if not record.is_ok:
            continue
        other = first.setdefault(replace(record.id, host="").key, record)
        if (record.counters, record.triangles) != (other.counters, other.triangles):
            names = {*record.counters, *other.counters}
            wrong = [n for n in names if record.counters.get(n) != other.counters.get(n)]
            what = min(wrong, default="triangles")
            raise IncompatibleRunsError(
                f"hosts count differently: {what} of {_describe(record)} and on "
                f"{other.id.device_name}; see that they have the same version of raster-harness "
                "and of the driver"
            )


def _refuse_other_scenes(runs: Sequence[Run]) -> None:
    if not any(run.records for run in runs):
        raise InputError("no record to merge")
    of_runs = {(run.facts.get("scene") or {}).get("hash") for run in runs}
    if None in of_runs or len(of_runs) > 1:
        places = ", ".join(sorted(str(run.path) for run in runs))
        raise IncompatibleRunsError(
            f"the runs are of different polygons, or one does not say of which ({places}): "
            "merge complete runs of one scene"
        )


def _refuse_one_run_twice(runs: Sequence[Run]) -> None:
    """The same measurements under two hosts' names are no two devices."""
    first: dict[str, tuple[str, Run]] = {}
    for run in runs:
        host = next((record.id.host for record in run.records), "")
        facts = [run.facts.get(name) for name in ("created", "environment", "seconds")]
        times = sorted(_text(record.time.samples_s) for record in run.records if record.time)
        for what in [_text(facts), *([_text(times)] if times else [])]:
            first_host, other = first.setdefault(what, (host, run))
            if first_host != host:
                raise IncompatibleRunsError(
                    f"{other.path} and {run.path} hold the same measurements: one run cannot be "
                    f"of two hosts, {first_host or 'its own'} and {host or 'its own'}"
                )


def _facts(runs: Sequence[Run]) -> RunFacts:
    """The content of run.json; none of it depends on the order of the runs."""
    in_order = sorted((run.facts for run in runs), key=_text)
    in_order.sort(key=lambda facts: str(facts.get("created") or ""))
    first = in_order[0]
    plans = [facts.get("plan") or {} for facts in in_order]
    names = [list(plan.get("triangulators") or []) for plan in plans]
    same = all(name == names[0] for name in names)
    plan = {
        **plans[0],
        "triangulators": names[0] if same else sorted(set().union(*names)),
        **{which: _union(plan.get(which) for plan in plans) for which in _LISTS},
    }
    hosts = [
        {name: facts.get(name) for name in _OF_A_HOST}
        | {"devices": sorted(facts.get("devices") or {})}
        for facts in in_order
    ]
    devices: dict[str, Any] = {}
    for facts in reversed(in_order):
        devices |= facts.get("devices") or {}
    return {
        **first,
        "plan": plan,
        "warnings": sorted({w for facts in in_order for w in facts.get("warnings") or []}),
        "frames": _union(facts.get("frames") for facts in in_order),
        "devices": dict(sorted(devices.items())),
        "interrupted": any(facts.get("interrupted") for facts in in_order),
        "merged": hosts,
    }


_OF_A_HOST = ("created", "environment", "cpu", "state", "seconds", "warnings")
_LISTS = ("rasterisers", "devices", "views", "options")


def _union(lists: Iterable[Any]) -> list[Any]:
    unique = {_text(entry): entry for entries in lists for entry in entries or []}
    return [unique[text] for text in sorted(unique)]


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)


def _sort_key(record: Record, names: Sequence[str]) -> tuple[CaseGroup, int, str]:
    """Return the sort key of records: the group, then the plan's triangulators."""
    position = names.index(record.name) if record.name in names else len(names)
    return record.id.group, position, record.id.key


def _keep_drawings(store: RunFolder, runs: Iterable[Run]) -> None:
    """Keep the frames of all runs, with the triangulations of all."""
    columns: dict[str, dict[str, Any]] = {}
    for run in sorted(runs, key=lambda run: str(run.path)):
        for file in sorted((run.path / drawings.FOLDER).glob("*.npz")):
            columns.setdefault(file.stem, {}).update(
                read_arrays(run, file.stem, drawings.FOLDER) or {}
            )
    for name, arrays in columns.items():
        store.write_arrays(name, dict(sorted(arrays.items())), drawings.FOLDER)
