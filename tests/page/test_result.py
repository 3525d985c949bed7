"""What a page saved becomes a run like any other; what it did not save is refused."""

import json
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, IncompatibleRunsError, InputError
from harness.metrics.per_polygon import columns_of
from harness.page.result import counted_exactly, import_result
from harness.page.saved import device_name
from harness.rasterisers.reference import SHADED
from harness.results import drawings
from harness.results.run_folder import read_run
from tests.conftest import assert_refused, require_ok
from tests.page.conftest import ROUNDS, make_result, read_result, write_saved
from tests.records import lines_of
from triangulators.polygon_arrays import PolygonArray


def test_the_imported_run_is_read_like_any_other(harness, saved, small_run):
    out, _ = require_ok(
        harness("import", str(saved()), "--out", "phone", "--run", str(small_run.path))
    )
    assert "apple-metal-3-safari" in out
    records = lines_of(read_run(Path("phone")))
    assert {record["rasteriser"] for record in records} == {"webgpu"}
    for record in records:
        (original,) = [
            each
            for each in lines_of(small_run)
            if all(each[name] == record[name] for name in ("triangulator", "resolution"))
        ]
        assert record["predicted"] == original["predicted"]
        for name in SHADED:
            assert record["counters"][name] == original["counters"][name]
        assert record["coverage_error"] == 0
        assert len(record["time"]["samples_s"]) == ROUNDS
        assert record["time"]["epochs"] == [2] * 6
    assert Path("phone/report.html").is_file()
    assert harness("report", "phone")[0] == 0
    require_ok(harness("study", "gains", "phone", "--out", "gains"))
    out, _ = require_ok(harness("compare", "phone", "phone"))
    assert "No regression: 6 cases" in out
    assert harness("history", "phone")[0] in (0, 5)


def test_without_the_run_it_has_totals_alone(harness, saved):
    require_ok(harness("import", str(saved()), "--out", "phone", "--device", "my phone"))
    assert {record["device"] for record in lines_of(read_run(Path("phone")))} == {"my-phone"}
    assert not Path("phone/polygons").exists()
    assert harness("report", "phone")[0] == 0


def test_what_went_wrong_on_the_page_is_said(harness, saved):
    def change(result: dict[str, Any]) -> None:
        result |= {"complete": False, "problem": "The browser lost\nthe GPU.", "hidden": True}
        result["views"][0]["cases"]["delaunay"]["differing"] = 3
        result["device"]["step"] = 16
        result["views"][1] |= {"times": None, "epochs": []}

    _, err = require_ok(harness("import", str(saved(change)), "--out", "phone"))
    assert "warning: the page told of a problem: The browser lost the GPU." in err
    assert "stopped before" in err
    assert "snaps to 1/16 px" in err
    assert "hidden" in err
    assert "differ from the run's in 3 polygons" in err
    untimed = [record for record in lines_of(read_run(Path("phone"))) if "time" not in record]
    assert len(untimed) == 3


def test_another_scenes_run_is_refused(harness, saved, small_run):
    def change(result: dict[str, Any]) -> None:
        for view in result["views"]:
            for case in view["cases"].values():
                case["record"]["scene_hash"] = "0" * 64

    arguments = ("import", str(saved(change)), "--out", "phone", "--run", str(small_run.path))
    assert_refused(harness(*arguments), "of the page's polygons at 128 px")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a file that a measuring page saved"),
        (b"\xff\xfe", "not a file that a measuring page saved"),
        (b"[" * 100_000, "not a file that a measuring page saved"),
        (b"[]", "not a file that a measuring page saved"),
        (b'{"format": "raster-harness device result", "version": 2}', "another version"),
        (b'{"format": "raster-harness device result", "version": 1}', "damaged"),
        (
            b'{"format": "raster-harness device result", "version": 1, "result": "\\ud800"}',
            "not a file that a measuring page saved",
        ),
    ],
)
def test_what_is_no_result_is_one_line(harness, tmp_path, content, message):
    file = tmp_path / "saved.json"
    file.write_bytes(content)
    assert_refused(harness("import", str(file), "--out", "phone"), message)
    assert not Path("phone").exists()


def test_a_file_that_is_not_there(harness):
    assert_refused(harness("import", "nowhere.json"), "nowhere.json: No such file")


WRONG = (None, "", "1", -1, -0.5, 1e300, True, [], {}, [None], {"": 0}, "\x00", "x" * 20_000)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path to each value inside."""
    inside = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [path, *(found for key, each in inside for found in places(each, (*path, key)))]


def changed(result: dict[str, Any], path: tuple[Any, ...], value: Any) -> Any:
    """Return a copy with another value in one place."""
    copy = json.loads(json.dumps(result))
    if not path:
        return value
    part = copy
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    return copy


def test_a_thousand_changed_results(tmp_path, small_run):
    """Half have bytes changed, which the digest tells; half have their digest, and a wrong value.

    A value that is as good as the one before is read; everything else is refused in one line, and
    what was read makes a run.
    """
    rng = random.Random(0)
    result = make_result(small_run)
    whole = write_saved(result, tmp_path / "whole.json").read_bytes()
    everywhere = places(result)
    messages = []
    for number in range(1000):
        file = tmp_path / "changed.json"
        if number % 2:
            content = bytearray(whole)
            for _ in range(rng.randint(1, 4)):
                at = rng.randrange(len(content))
                content[at] = (content[at] + rng.randrange(1, 256)) % 256
            file.write_bytes(content[: rng.choice([len(content), rng.randrange(len(content))])])
        else:
            path, value = rng.choice(everywhere), rng.choice(WRONG)
            write_saved(changed(result, path, value), file)
        try:
            found = read_result(file)
        except HarnessError as error:
            messages.append(str(error))
            continue
        assert not number % 2, "damage that the digest did not tell"
        assert allowed(path, value), (path, value)
        import_result(found, tmp_path / f"run-{number}", device_name(found))
        assert read_run(tmp_path / f"run-{number}").problems == []
    assert 600 < len(messages) < 1000
    assert all("\n" not in message and len(message) < 1000 for message in messages)


def allowed(path: tuple[Any, ...], value: Any) -> bool:
    """Whether a value may stand in that place."""
    name = str(path[-1])
    texts = ("harness", "created", "started", "ended", "browser", "vendor", "architecture")
    if isinstance(value, str):
        free = name in (*texts, "device", "description", "reason", "scene", "problem")
        return free and (len(value) <= 500 or name in ("reason", "problem"))
    if value is True:
        return name in ("complete", "hidden", "timer", "fallback", "conforming")
    if value is None:
        optional = ("step", "problem", "timer", "times", "reason", "conforming", "gpu_s")
        return name in (*optional, "triangulate_s", "proven", "largest_gap", "outline_quads")
    if isinstance(value, float | int):
        return "predicted" in path or (name == "rotation" and False)
    if value in ([], {}):
        return name in ("predicted", "cases", "times")
    return name == "predicted"


def first_case(result):
    return next(iter(result["views"][0]["cases"].values()))


def all_zero(result):
    for case in result["views"][0]["cases"].values():
        case["counters"] = {name: [0] * len(each) for name, each in case["counters"].items()}


def one_more_fragment_than_lanes(result):
    counters = first_case(result)["counters"]
    counters["fragments"][0] = 4 * counters["quads"][0] + 1


def a_partial_quad_without_a_helper(result):
    counters = first_case(result)["counters"]
    lanes = 4 * counters["quads"][0] - counters["fragments"][0]
    counters["partial_quads"][0] = lanes // 3 - 1


MADE_UP = [
    (lambda r: r["views"][0]["cases"]["delaunay"]["counters"]["quads"].pop(), "counters of 19"),
    (lambda r: r["views"][0]["epochs"].append(1), "of the same rounds"),
    (lambda r: r["views"][0]["times"].update(more=r["views"][0]["times"]["(empty)"]), "not count"),
    (lambda r: r["views"][0].update(resolution=256), "of another case"),
    (lambda r: r.update(views=[]), "views"),
    (lambda r: r.update(extra=1), "extra"),
    (lambda r: first_case(r)["counters"].update(quads=[10**9] * 20), "fewer than one pixel"),
    (lambda r: r["views"][0]["times"]["delaunay"].update(samples_s=[0.0] * 12), "took no time"),
    (lambda r: first_case(r)["record"].update(scene_hash="1" * 64), "of different scenes"),
    (all_zero, "nothing was drawn: all counters are zero"),
    (lambda r: first_case(r)["record"].update(polygons=1000), "1000 polygons and counters of 20"),
    (one_more_fragment_than_lanes, "fewer than one pixel, or more than four"),
    (a_partial_quad_without_a_helper, "without a helper lane, or with more than three"),
    (lambda r: first_case(r)["record"].update(proven=1_000_000), "1000000 of 20 polygons proven"),
    (lambda r: first_case(r)["record"].update(triangles=1), "too few for its polygons"),
    (lambda r: r["views"].append(r["views"][0]), "one view is there twice"),
]


@pytest.mark.parametrize(("change", "message"), MADE_UP)
def test_a_made_up_result_is_refused(imported, change, message):
    with pytest.raises(HarnessError, match=message):
        imported(change)


OF_THE_RUN = {
    "predicted": lambda r: first_case(r)["record"].update(
        predicted={**first_case(r)["record"]["predicted"], "half_perimeter": 1.0}
    ),
    "triangles": lambda r: first_case(r)["record"].update(triangles=400),
    "conforming": lambda r: first_case(r)["record"].update(t_junctions=3),
    "counters": lambda r: first_case(r)["counters"]["quads"].reverse(),
    "differing": lambda r: first_case(r).update(differing=2),
}


@pytest.mark.parametrize("change", OF_THE_RUN.values(), ids=OF_THE_RUN)
def test_what_contradicts_the_run_is_refused(saved, small_run, tmp_path, change):
    """It passes by itself; what the run's polygons and triangles say is another thing."""

    def fitting(result):
        change(result)
        counters = first_case(result)["counters"]
        counters["fragments"] = [
            min(4 * q, max(q, f))
            for f, q in zip(counters["fragments"], counters["quads"], strict=True)
        ]
        lanes = [4 * q - f for f, q in zip(counters["fragments"], counters["quads"], strict=True)]
        counters["partial_quads"] = [-(-each // 3) for each in lanes]

    result = read_result(saved(fitting))
    with pytest.raises((InputError, IncompatibleRunsError), match=r"contradict|do not differ"):
        import_result(result, tmp_path / "run", "phone", small_run)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("rounds", [1, 2])
def test_a_single_round_is_no_time_and_two_are(imported, rounds):
    def few_rounds(result):
        for view in result["views"]:
            view["epochs"] = [rounds]
            for times in view["times"].values():
                times["samples_s"] = times["samples_s"][:rounds]

    assert {"time" in record for record in lines_of(imported(few_rounds))} == {rounds == 2}


@pytest.mark.parametrize(("share", "reached"), [(0.009, True), (0.011, False)])
def test_a_time_that_is_not_precise_says_so(imported, share, reached):
    """Half of the samples are longer by a share of a millisecond, half shorter."""

    def spread(result):
        times = result["views"][0]["times"]["delaunay"]
        times["samples_s"] = [1e-3 * (1 - share), 1e-3 * (1 + share)] * (ROUNDS // 2)

    found = {
        (record["triangulator"], record["resolution"]): record["time"]["precision_reached"]
        for record in lines_of(imported(spread))
    }
    assert found["delaunay", 128] is reached
    assert found["delaunay", 64]


def test_polygons_that_were_left_out_count_among_those_counted(saved, tmp_path):
    def left_out(result):
        record = first_case(result)["record"]
        record["polygons"] -= 3
        record |= {"polygons_skipped": 1, "polygons_failed": 2}

    def miscounted(result):
        left_out(result)
        first_case(result)["record"]["polygons_skipped"] = 3

    assert read_result(saved(left_out))
    with pytest.raises(InputError, match="polygons and counters of"):
        read_result(saved(miscounted))


def test_a_last_polygon_without_triangles_covers_nothing():
    corners = np.array([(0, 0), (1024, 0), (0, 1024)] * 2, np.int32)
    kept = drawings.Geometry(PolygonArray.of_single_rings(corners, 3), np.arange(2), {})
    counted = counted_exactly(kept, np.array([(0, 1, 2)], np.int32))
    assert [len(each) for each in counted] == [2, 2, 2]
    assert [each[1] for each in counted] == [0, 0, 0]
    assert min(each[0] for each in counted[:2]) > 0


def test_polygons_counted_otherwise_are_as_many_as_the_file_says(imported, small_run):
    """Three have one fragment less than the reference counts."""

    def changed(result):
        counters = first_case(result)["counters"]
        numbers = enumerate(zip(*counters.values(), strict=True))
        places = [k for k, (f, q, partial) in numbers if f > q and 4 * q - f < 3 * partial]
        for place in places[:3]:
            counters["fragments"][place] -= 1
        first_case(result)["differing"] = 3

    def miscounted(result):
        changed(result)
        first_case(result)["differing"] = 2

    assert lines_of(imported(changed, small_run))
    with pytest.raises(InputError, match="do not differ from the exact reference in 2"):
        imported(miscounted, small_run)


def test_the_renderer_is_what_the_browser_calls_it_or_the_device(imported):
    def described(result):
        result["device"]["description"] = "Apple M1"

    for change, renderer in ((described, "Apple M1"), (lambda _: None, "phone")):
        (device,) = imported(change).facts["devices"].values()
        assert device["details"]["renderer"] == renderer


def only_triangles(result):
    """All polygons are triangles, and one is drawn in full quads, one as not a pixel."""
    for case in result["views"][0]["cases"].values():
        record, counters = case["record"], case["counters"]
        record |= {"triangles": record["polygons"], "vertices": 3 * record["polygons"]}
        counters["fragments"][0] = 4 * counters["quads"][0]
        counters["partial_quads"][0] = counters["partial_quads"][1] = 0
        counters["fragments"][1] = counters["quads"][1] = 0


def no_polygons(result):
    for case in result["views"][0]["cases"].values():
        case["record"] |= dict.fromkeys(("polygons", "triangles", "vertices", "proven"), 0)
        case["counters"] = {"fragments": [], "quads": [], "partial_quads": []}


def one_corner_less(result):
    only_triangles(result)
    first_case(result)["record"]["vertices"] -= 1


def one_polygon_less(result):
    case = first_case(result)
    case["record"]["polygons"] -= 1
    for counts in case["counters"].values():
        counts.pop()


@pytest.mark.parametrize(
    ("least", "less", "message"),
    [
        (only_triangles, one_corner_less, "too few for its polygons"),
        (no_polygons, one_polygon_less, "of polygons"),
    ],
)
def test_the_least_that_there_may_be_is_read_and_a_little_less_refused(saved, least, less, message):
    assert read_result(saved(least))
    with pytest.raises(HarnessError, match=message):
        read_result(saved(less))


def test_a_file_may_be_as_large_as_the_largest(saved, monkeypatch):
    file = saved()
    size = file.stat().st_size
    monkeypatch.setattr("harness.page.saved.MOST_BYTES", size)
    assert read_result(file)
    monkeypatch.setattr("harness.page.saved.MOST_BYTES", size - 1)
    with pytest.raises(InputError, match="larger than any page saves"):
        read_result(file)


@pytest.mark.parametrize(("step", "bits"), [(1, 8), (2, 7), (16, 4)])
def test_the_grid_of_the_device_is_told(imported, step, bits):
    def one_view(result):
        result["device"]["step"] = step
        result["views"] = result["views"][:1]

    facts = imported(one_view).facts
    (device,) = facts["devices"].values()
    assert device["details"]["subpixel_bits"] == bits
    assert [line for line in facts["warnings"] if "snaps" in line] == (
        [f"the device snaps to 1/{256 // step} px: polygons were moved there"] if step > 1 else []
    )
    assert facts["imported"] is True
    assert facts["plan"]["seed"] == 0
    assert facts["scene"]["polygons"] == 20


def test_a_page_that_drew_nothing_makes_an_empty_run(imported):
    def nothing(result):
        for view in result["views"]:
            view |= {"cases": {}, "times": None, "epochs": []}

    run = imported(nothing)
    assert lines_of(run) == []
    assert run.facts["scene"] == {"name": "city:buildings=20", "hash": "", "polygons": 0}


def test_what_covers_fewer_polygons_is_not_set_against_those_that_cover_all(imported):
    """And a record says no more than the file does."""

    def left_out(result):
        record = first_case(result)["record"]
        record |= {"polygons": record["polygons"] - 3, "polygons_skipped": 3}
        record.pop("proven", None)

    own, *others = (r for r in lines_of(imported(left_out)) if r["resolution"] == 128)
    assert own["coverage_error"] is None
    assert {record["coverage_error"] for record in others} == {0}
    assert "proven" not in own


def test_of_one_case_the_scene_is_that_of_all(imported):
    def one(result):
        first = result["views"][0]["cases"]["delaunay"]
        for view in result["views"]:
            view |= {"cases": {}, "times": None, "epochs": []}
        result["views"][0]["cases"] = {"delaunay": first}

    assert imported(one).facts["scene"] == imported(lambda _: None).facts["scene"]


def test_a_single_drawing_was_timed_beside_the_reference(imported):
    def alone(result):
        view = result["views"][0]
        names = ("(empty)", "(reference)", "delaunay")
        view["times"] = {name: view["times"][name] for name in names}

    own = [r for r in lines_of(imported(alone)) if r["resolution"] == 128]
    assert [r["triangulator"] for r in own if "time" in r] == ["delaunay"]


def test_a_device_without_a_timer_has_no_times(imported):
    run = imported(lambda result: result.update(timer=None))
    assert all("time" not in record for record in lines_of(run))


def test_what_a_file_does_not_say_contradicts_nothing(imported, small_run, tmp_path):
    def unsaid(result):
        first_case(result)["record"].pop("triangulate_s")

    def snapped(result):
        result["device"]["step"] = 16
        first_case(result)["differing"] = 3

    def counted_otherwise(result):
        first_case(result)["counters"]["fragments"][0] += 1

    bare = replace(small_run, path=tmp_path / "bare")  # no frames tell exact counters
    for change, run in ((unsaid, small_run), (snapped, small_run), (counted_otherwise, bare)):
        assert lines_of(imported(change, run))


def test_an_imported_run_keeps_frames_and_each_polygons_predictions(imported, small_run):
    run = imported(lambda _: None, small_run)
    for view in {record.id.view for record in run.records}:
        own, known = (drawings.read(each, view) for each in (run, small_run))
        assert own.points.tolist() == known.points.tolist()
    before = {(each.name, each.id.view): each for each in small_run.records}
    for record in run.records:
        kept = columns_of(run, record)
        known = columns_of(small_run, before[record.name, record.id.view])
        for name in ("predicted_half_perimeter", "quads", "fragments"):
            assert kept[name].tolist() == known[name].tolist()
