"""`harness merge`: several runs of one scene as one run.

The result is independent of the order of the runs. Devices of different hosts are different
devices, named device@host, because times differ.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from harness.commands.options import Quiet, ValueList, make_list_parser
from harness.errors import IncompatibleRunsError, InputError, UsageError
from harness.progress import Reporter

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from harness.results.record import CaseGroup, Record, RunFacts
    from harness.results.run_folder import Run
    from harness.results.run_writer import RunFolder

STATUSES = ("ok", "skipped", "failed", "counted")  # by priority: a measured record replaces another
HOST_FACTS = ("created", "environment", "cpu", "state", "seconds", "warnings")  # of each run
PLAN_LISTS = ("rasterisers", "devices", "views", "options")  # united


def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of one scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the merged run.")],
    hosts: Annotated[
        ValueList | None,
        typer.Option(
            parser=make_list_parser(),
            metavar="NAME,...",
            help="Names of the hosts that measured the runs, in the same order. Devices are then "
            "named device@host, so that devices with the same name on several hosts are not "
            "merged.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Merge runs of one scene into one run; the order of the runs does not matter.

    The merged run has one record for each case (scene, view, triangulator, device and options).
    Measured records of the same case must be equal, unless --hosts distinguishes their devices.
    With --hosts, counters of devices with the same name must agree on all hosts.
    """
    from harness.commands.runs import make_run
    from harness.results.run_folder import read_latest

    stored = [read_latest(run, Reporter().warn) for run in runs]
    if hosts:
        if len(hosts) != len(stored):
            raise UsageError(
                f"--hosts: {len(hosts)} hosts for {len(stored)} runs; name one host for each run"
            )
        stored = [set_host(run, name) for run, name in zip(stored, hosts, strict=True)]
    make_run(out, lambda folder: merge_runs(stored, folder), quiet=quiet)


class _Source(NamedTuple):
    """A record and its run, in whose folder `record.key` names the record's arrays."""

    record: Record
    run: Run


def set_host(run: Run, host: str) -> Run:
    """Return the run with all devices on `host`, which changes the identities of the cases."""
    from harness.results.record import HOST_MARK
    from harness.results.run_folder import make_file_stem

    if not host or make_file_stem(host) != host:
        raise UsageError(f"host {host!r}: invalid name; give letters, digits, hyphens and dots")
    for record in run.records:
        if record.id.host or HOST_MARK in record.id.device:
            raise IncompatibleRunsError(
                f"{run.path} has devices of a host already: {record.id.device_name}"
            )
    records = [record.with_id(host=host) for record in run.records]
    named_devices = run.facts.get("devices") or {}
    devices = {f"{label}{HOST_MARK}{host}": device for label, device in named_devices.items()}
    return replace(run, records=records, facts={**run.facts, "devices": devices})


def merge_runs(runs: Sequence[Run], out: Path) -> int:
    """Merge compatible runs into a new run folder; return the number of records."""
    from harness.metrics.groups import find_mixed_processors, format_processors
    from harness.results.run_folder import read_arrays
    from harness.results.run_writer import RunFolder

    _refuse_differing_scenes(runs)
    _refuse_one_run_twice(runs)
    if mixed := find_mixed_processors(runs):
        raise IncompatibleRunsError(
            f"software devices were timed on several processors: {format_processors(mixed)}; "
            "keep the runs apart with --hosts"
        )
    sources = _select_records(runs)
    _refuse_differing_counters([source.record for source in sources])
    facts = _merge_facts(runs)
    names = facts["plan"]["triangulators"]
    sources.sort(key=lambda source: _sort_key(source.record, names))
    remedy = f"remove {out} and run the same command again"
    with RunFolder.create(out, remedy) as store:
        store.write_facts({**facts, "interrupted": True})  # until the folder is complete
        _store_drawings(store, runs)
        for source in sources:
            record = replace(source.record, key=source.record.id.key)
            arrays = read_arrays(source.run, source.record.key)
            if arrays is not None:
                store.write_arrays(record.key, arrays)
            store.append(record)
        store.write_facts(facts)
    return len(sources)


def _select_records(runs: Iterable[Run]) -> list[_Source]:
    """Return one record per case; raise IncompatibleRunsError if two measured records differ."""
    sources: dict[str, _Source] = {}
    for run in sorted(runs, key=lambda run: str(run.path)):
        for record in run.records:
            new, old = _Source(record, run), sources.get(record.id.key)
            if old is None or _get_priority(new) < _get_priority(old):
                sources[record.id.key] = new
            elif old.record.status == record.status == "ok" and old.record != record:
                raise IncompatibleRunsError(
                    f"records of one case differ: {record.id} ({old.run.path} and {run.path}); "
                    "if the runs are of different hosts, name the hosts with --hosts"
                )
    return list(sources.values())


def _get_priority(source: _Source) -> tuple[int, str]:
    """Return the sort key by which one of a case's records is selected; equal for ok records."""
    from harness.results.parsing import record_to_json

    record = source.record
    content = "" if record.is_ok else json.dumps(record_to_json(record), sort_keys=True)
    return STATUSES.index(record.status), content


def _refuse_differing_counters(records: Iterable[Record]) -> None:
    first: dict[str, Record] = {}
    for record in sorted(records, key=lambda record: record.id.device_name):
        if not record.is_ok:
            continue
        other = first.setdefault(replace(record.id, host="").key, record)
        if (record.counters, record.triangles) != (other.counters, other.triangles):
            names = {*record.counters, *other.counters}
            differing = [n for n in names if record.counters.get(n) != other.counters.get(n)]
            name = min(differing, default="triangles")
            raise IncompatibleRunsError(
                f"counters differ between hosts: {name} of {record.id} and on "
                f"{other.id.device_name}; use the same version of raster-harness and of the driver"
            )


def _refuse_differing_scenes(runs: Sequence[Run]) -> None:
    if not any(run.records for run in runs):
        raise InputError("runs: no records to merge; give complete runs")
    hashes = {(run.facts.get("scene") or {}).get("hash") for run in runs}
    if None in hashes or len(hashes) > 1:
        paths = ", ".join(sorted(str(run.path) for run in runs))
        raise IncompatibleRunsError(
            f"runs: different or unknown polygons ({paths}); merge complete runs of one scene"
        )


def _refuse_one_run_twice(runs: Sequence[Run]) -> None:
    first: dict[str, tuple[str, Run]] = {}
    for run in runs:
        host = next((record.id.host for record in run.records), "")
        facts = [run.facts.get(name) for name in ("created", "environment", "seconds")]
        timed = [record.time.samples_s for record in run.records if record.time]
        times = sorted(map(_format_value, timed))
        for content in [_format_value(facts), *([_format_value(times)] if times else [])]:
            first_host, other = first.setdefault(content, (host, run))
            if first_host != host:
                raise IncompatibleRunsError(
                    f"{other.path} and {run.path}: the same measurements with two hosts "
                    f"({first_host or 'no name'} and {host or 'no name'}); give each run once"
                )


def _merge_facts(runs: Sequence[Run]) -> RunFacts:
    """Return the content of run.json, independent of the order of the runs."""
    from harness.metrics.run_quality import STATES, get_run_state

    in_order = sorted((run.facts for run in runs), key=_format_value)
    in_order.sort(key=lambda facts: str(facts.get("created") or ""))
    plans = [facts.get("plan") or {} for facts in in_order]
    names = [list(plan.get("triangulators") or []) for plan in plans]
    same = all(name == names[0] for name in names)
    plan = {
        **plans[0],
        "triangulators": names[0] if same else sorted(set().union(*names)),
        **{which: _list_distinct(plan.get(which) for plan in plans) for which in PLAN_LISTS},
    }
    hosts = [
        {name: facts.get(name) for name in HOST_FACTS}
        | {"devices": sorted(facts.get("devices") or {})}
        for facts in in_order
    ]
    states = [get_run_state(run) for run in runs]
    draws = ((facts.get("state") or {}).get("draws") for facts in in_order)
    devices: dict[str, Any] = {}
    for facts in reversed(in_order):
        devices |= facts.get("devices") or {}
    return {
        **in_order[0],
        "plan": plan,
        "warnings": sorted({w for facts in in_order for w in facts.get("warnings") or []}),
        "frames": _list_distinct(facts.get("frames") for facts in in_order),
        "devices": dict(sorted(devices.items())),
        "interrupted": any(facts.get("interrupted") for facts in in_order),
        "state": {
            "state": max((state.state for state in states), key=STATES.index),
            "why": sorted({reason for state in states for reason in state.why}),
            "draws": _list_distinct(draws),
        },
        "merged": hosts,
    }


def _list_distinct(lists: Iterable[Any]) -> list[Any]:
    unique = {_format_value(entry): entry for entries in lists for entry in entries or []}
    return [unique[text] for text in sorted(unique)]


def _format_value(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)


def _sort_key(record: Record, names: Sequence[str]) -> tuple[CaseGroup, int, str]:
    position = names.index(record.name) if record.name in names else len(names)
    return record.id.group, position, record.id.key


def _store_drawings(store: RunFolder, runs: Iterable[Run]) -> None:
    from harness.results.run_folder import FRAMES, read_arrays

    columns: dict[str, dict[str, Any]] = {}
    for run in sorted(runs, key=lambda run: str(run.path)):
        for file in sorted((run.path / FRAMES).glob("*.npz")):
            arrays = read_arrays(run, file.stem, FRAMES) or {}
            columns.setdefault(file.stem, {}).update(arrays)
    for name, arrays in columns.items():
        store.write_arrays(name, dict(sorted(arrays.items())), FRAMES)
