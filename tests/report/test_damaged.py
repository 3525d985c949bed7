"""A record with a field that is missing or null costs that record, never the report."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest

from harness.figures.groups import time_ratio
from harness.report.report_data import content_of
from harness.stored.folder import read_run
from tests.compare.runs import read_back
from tests.fuzz.targets.runs import sound


def fields(value: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of each field of a record, however deep."""
    if isinstance(value, dict):
        for name in value:
            yield (*above, name)
            yield from fields(value[name], (*above, name))


@pytest.mark.parametrize("damage", ["missing", "null"])
def test_each_field_may_be_damaged(damage):
    run = read_run(sound())
    whole = run.records[0]
    assert "least" in whole
    ignored = set()
    for path in fields(whole):
        record = copy.deepcopy(whole)
        inner = record
        for name in path[:-1]:
            inner = inner[name]
        if damage == "missing":
            del inner[path[-1]]
        else:
            inner[path[-1]] = None
        run.records[0] = record
        found = read_back(run.facts, run.records)
        json.dumps(content_of(found), allow_nan=False)
        if len(found.records) < len(run.records):
            ignored.add(path[0])
    assert {"key", "resolution", "rotation", "triangulator", "least"} <= ignored
    assert {"reason", "polygons", "outline_quads", "triangulate_s"}.isdisjoint(ignored)


def damaged(change):
    """Return a sound run of which a record, and its facts, were changed."""
    run = read_run(sound())
    record = copy.deepcopy(run.records[0])
    facts = copy.deepcopy(run.facts)
    change(record, facts)
    return read_back(facts, [record, *run.records[1:]])


def test_an_interval_of_one_end_is_no_record():
    found = damaged(lambda record, _: record["time"].update(ci95_s=[0.1]))
    assert len(found.records) == len(read_run(sound()).records) - 1


def test_rounds_of_another_number_are_paired_with_none():
    found = damaged(lambda record, _: record["time"]["samples_s"].append(0.1))
    json.dumps(content_of(found), allow_nan=False)
    first, second = found.records[:2]
    assert time_ratio(first, second) is None
    assert time_ratio(second, second) is not None


def test_a_plan_of_no_names_has_none():
    found = damaged(lambda _, facts: facts["plan"].update(triangulators=[{"a": 1}]))
    assert found.facts["plan"]["triangulators"] == []
    assert any("triangulators" in line for line in found.problems)
