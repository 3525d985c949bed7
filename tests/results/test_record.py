"""The identity of a case: independent of the scene's content, sortable, and with a key."""

import json
from dataclasses import replace

import pytest

from harness.frame import View
from harness.rasterisers.base import Options
from harness.results.parsing import FieldError, parse_record, record_to_json
from harness.results.record import CaseId, split_name
from tests.records import CASE, make_record

CITY = CaseId("city", View(64, 30.0), "fan", "opengl", "llvmpipe", Options(work=8))


def test_scene_content_changes_only_the_key():
    changed = replace(CITY, scene_hash="1")
    assert changed == CITY
    assert hash(changed) == hash(CITY)
    assert changed.key != CITY.key
    assert replace(CITY, device="zink").key != CITY.key
    assert CITY.key == "6d54e161525d05e7"  # as the first version computed it


def test_names_include_marks_and_hosts():
    case = replace(CITY, triangulator="random", number=7, upright=True, host="lab")
    assert case.name == "random#7@0"
    assert str(case) == "random#7@0, city 64 px, turned 30°, work 8, opengl on llvmpipe@lab"
    group = replace(CITY, view=View(64, 22.5, "circle")).group
    assert str(group) == "city 64 px, turned 22.5°, fit to a circle, work 8, opengl on llvmpipe"
    assert replace(case, version="base").name == "BASE random#7@0"
    assert len({id_.key for id_ in (case, CITY, replace(case, version="base"))}) == 3


def test_cases_are_sorted_by_number():
    sizes = [replace(CITY, view=View(size)) for size in (1024, 64, 256)]
    assert [case.view.resolution for case in sorted(sizes)] == [64, 256, 1024]
    assert sorted([replace(CITY, triangulator="greedy"), CITY])[0] == CITY


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        *(("fan", ("fan", None, False)), ("pareto#0", ("pareto", 0, False))),
        ("random#12@0", ("random", 12, True)),
        ("optimal:overdraw@0", ("optimal:overdraw", None, True)),
        ("mine:cut", ("mine:cut", None, False)),
        ("odd#name", ("odd#name", None, False)),
    ],
)
def test_names_of_older_versions_are_split(name, parts):
    assert split_name(name) == parts
    assert make_record(name).name == name


def test_record_round_trips_through_json():
    time = {
        "timer": "cpu", "samples_s": [1.0, 3.0], "reference_s": [2.0, 2.0], "ci95_s": [1.0, 3.0],
        "epochs": [1, 1], "warnings": ["short"],
    }  # fmt: skip
    more = {
        "polygons": 2, "counters": {"quads": 5}, "predicted": {"area": 1.5}, "proven": 1,
        "least": {"polygons": 1, "quads": 1, "shaded": 2, "fragments": 3}, "time": time,
        "views": {"names": ["a", "b"], "quads": [2, 3]}, "triangulate_samples_s": [0.1, 0.2],
    }  # fmt: skip
    record = make_record("random#3@0", host="lab", device="gpu0@lab", **more)
    line = json.loads(json.dumps(record_to_json(record)))
    assert (line["triangulator"], line["number"], line["upright"]) == ("random", 3, True)
    assert (line["device"], line["host"]) == ("gpu0", "lab")
    assert line["largest_gap"] is None
    assert line["time"]["round_group"] == record.time.round_group != ""
    assert line["time"]["median_s"] == 2.0
    assert parse_record(line) == record
    assert "texture" not in line["options"]  # as in records of older versions
    textured = make_record("random#3@0", host="lab", device="gpu0@lab", options={"texture": 2})
    assert textured.id.key != record.id.key
    assert "2 texture lookups" in str(textured.id)
    assert parse_record(record_to_json(textured)) == textured


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"resolution": 4}, r"resolution 4: out of range"),
        ({"resolution": 64.5}, r"resolution: Input should be a valid integer"),
        ({"fit": "cover"}, r"fit: Input should be 'box', 'circle', 'tile'"),
        ({"options": {"order": "foo"}}, r"options.order: Input should be 'native'"),
        ({"options": {"colour": 1}}, r"options.colour: is unknown"),
        ({"options": {"texture": 65}}, r"65 texture lookups: out of range"),
        ({"status": "good"}, r"status: Input should be 'ok', 'skipped'"),
        ({"scene": None}, r"scene: Field required"),
        ({"counters": {"quads": 1.5}}, r"counters.quads: Input should be a valid integer"),
        ({"counters": {"quads": 2**63}}, r"counters.quads: Input should be less than"),
        ({"predicted": {"area": True}}, r"predicted.area: Input should be a valid number"),
        ({"key": "7"}, r"key: is not 16 hexadecimal digits"),
        ({"time": {"samples_s": [1.0], "epochs": [0]}}, r"time.epochs.0: Input should be greater"),
        *(({"views": views}, "views") for views in ([1], {"quads": 3}, {"quads": [1, "2"]}, 7)),
        ({"views": {"a": [1], "b": [1, 2]}}, r"views: has lists of different lengths"),
        ({"views": {"a": [1], "names": ["x", "y"]}}, r"views: has lists of different lengths"),
        ({"views": {"names": 3}}, r"views"),
        ({"options": {"work": 1.5}}, r"options.work: Input should be a valid integer"),
        ({"options": {"seed": True}}, r"options.seed: Input should be a valid integer"),
        ({"time": {"samples_s": []}}, r"time.samples_s: is missing"),
        ({"time": {"samples_s": [1.0], "ci95_s": [0.1]}}, r"time.ci95_s"),
        ({"time": 3}, r"time: Input should be an object"),
    ],
)
def test_invalid_field_is_reported_with_a_reason(fields, problem):
    with pytest.raises(FieldError, match=f"^{problem}"):
        parse_record({**CASE, "triangulator": "fan", "key": "0" * 16, **fields})
