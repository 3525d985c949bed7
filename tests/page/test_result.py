"""Import of the file of a measuring page as a run, and refusal of other files."""

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, IncompatibleRunsError, InputError
from harness.metrics.groups import read_columns
from harness.page.result import COUNTERS, count_per_polygon, import_result
from harness.page.saved import make_device_name
from harness.rasterisers.reference import SHADED
from harness.results.run_folder import Geometry, read_geometry, read_run
from tests.conftest import assert_refused, require_ok
from tests.fuzz.damage import apply_value_edit, iter_paths
from tests.page.conftest import ROUNDS, make_result, read_result, write_saved
from tests.records import get_rows
from triangulators.polygon_arrays import PolygonArray


def test_imported_run_is_a_regular_run(harness, saved, small_run):
    run = ("--run", str(small_run.path))
    out, _ = require_ok(harness("import", str(saved()), "--out", "phone", *run))
    assert "apple-metal-3-safari" in out
    originals = {(row["triangulator"], row["resolution"]): row for row in get_rows(small_run)}
    for record in get_rows(read_run(Path("phone"))):
        original = originals.pop((record["triangulator"], record["resolution"]))
        assert record["rasteriser"] == "webgpu"
        assert record["predicted"] == original["predicted"]
        for name in SHADED:
            assert record["counters"][name] == original["counters"][name]
        assert record["coverage_error"] == 0
        assert len(record["time"]["samples_s"]) == ROUNDS
        assert record["time"]["epochs"] == [2] * 6
    assert not originals
    assert Path("phone/report.html").is_file()
    assert harness("report", "phone")[0] == 0
    require_ok(harness("study", "gains", "phone", "--out", "gains"))
    out, _ = require_ok(harness("compare", "phone", "phone"))
    assert "No regression: 6 cases" in out
    assert harness("history", "phone")[0] in (0, 5)


def test_import_without_the_run_has_only_totals(harness, saved):
    require_ok(harness("import", str(saved()), "--out", "phone", "--device", "my phone"))
    assert {record["device"] for record in get_rows(read_run(Path("phone")))} == {"my-phone"}
    assert not Path("phone/polygons").exists()
    assert harness("report", "phone")[0] == 0


def test_problems_of_the_page_are_reported(harness, saved):
    def change(result: dict[str, Any]) -> None:
        result |= {"complete": False, "problem": "The browser lost\nthe GPU.", "hidden": True}
        result["views"][0]["cases"]["delaunay"]["differing"] = 3
        result["device"]["step"] = 16
        result["views"][1] |= {"times": None, "epochs": []}

    _, err = require_ok(harness("import", str(saved(change)), "--out", "phone"))
    assert "warning: the page reported a problem: The browser lost the GPU." in err
    for text in ("stopped before", "snaps to 1/16 px", "hidden", "run's in 3 polygons"):
        assert text in err
    untimed = [record for record in get_rows(read_run(Path("phone"))) if "time" not in record]
    assert len(untimed) == 3


def test_run_of_another_scene_is_refused(harness, saved, small_run):
    def change(result: dict[str, Any]) -> None:
        for view in result["views"]:
            for case in view["cases"].values():
                case["record"]["scene_hash"] = "0" * 64

    arguments = ("import", str(saved(change)), "--out", "phone", "--run", str(small_run.path))
    assert_refused(harness(*arguments), "of the page's polygons at 128 px")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "saved.json: No such file"),
        (b"", "not a file saved by a measuring page"),
        (b"\xff\xfe", "not a file saved by a measuring page"),
        (b"[" * 100_000, "not a file saved by a measuring page"),
        (b'{"format": "another", "version": 1}', "not a file saved by a measuring page"),
        (b'{"format": "raster-harness device result", "version": 2}', "another version"),
        (b'{"format": "raster-harness device result", "version": 1}', "modified after saving"),
        (
            b'{"format": "raster-harness device result", "version": 1, "result": "\\ud800"}',
            "not a file saved by a measuring page",
        ),
    ],
)
def test_invalid_files_are_refused_in_one_line(harness, tmp_path, content, message):
    if content is not None:
        (tmp_path / "saved.json").write_bytes(content)
    assert_refused(harness("import", "saved.json", "--out", "phone"), message)
    assert not Path("phone").exists()


WRONG_VALUES = (None, "", "1", -1, -0.5, 1e300, True, [], {}, [None], {"": 0}, "\x00", "x" * 20_000)


def test_changed_results_are_refused_or_consistent(tmp_path, small_run):
    """Half of the files have changed bytes, the others a wrong value and a valid digest."""
    rng = random.Random(0)
    result = make_result(small_run)
    content_before = write_saved(result, tmp_path / "whole.json").read_bytes()
    paths = list(iter_paths(result))
    messages = []
    for number in range(1000):
        file = tmp_path / "changed.json"
        if number % 2:
            content = bytearray(content_before)
            for _ in range(rng.randint(1, 4)):
                index = rng.randrange(len(content))
                content[index] = (content[index] + rng.randrange(1, 256)) % 256
            file.write_bytes(content[: rng.choice([len(content), rng.randrange(len(content))])])
        else:
            position, value = rng.randrange(len(paths)), rng.choice(WRONG_VALUES)
            edit = {"position": position, "action": "set", "value": value}
            write_saved(apply_value_edit(result, edit), file)
        try:
            parsed = read_result(file)
        except HarnessError as error:
            messages.append(str(error))
            continue
        assert not number % 2, "damage not detected by the digest"
        assert is_allowed(paths[position], value), (paths[position], value)
        import_result(parsed, tmp_path / f"run-{number}", make_device_name(parsed))
        assert read_run(tmp_path / f"run-{number}").problems == []
    assert 600 < len(messages) < 1000
    assert all("\n" not in message and len(message) < 1000 for message in messages)


def is_allowed(path: tuple[Any, ...], value: Any) -> bool:
    name = str(path[-1])
    if isinstance(value, str):
        texts = "harness created started ended browser vendor architecture device description scene"
        is_long_text = name in ("reason", "problem")
        return is_long_text or (name in texts.split() and len(value) <= 500)
    if value is True:
        return name in ("complete", "hidden", "timer", "fallback", "conforming")
    if value is None:
        optional = "step problem timer times reason conforming gpu_s triangulate_s proven"
        return name in (*optional.split(), "largest_gap", "outline_quads", *COUNTERS[3:])
    if isinstance(value, float | int):
        return "predicted" in path
    if value in ([], {}):
        return name in ("predicted", "cases", "times")
    return name == "predicted"


def first_case(result):
    return next(iter(result["views"][0]["cases"].values()))


def set_zero(result):
    for case in result["views"][0]["cases"].values():
        case["counters"] = {name: [0] * len(values) for name, values in case["counters"].items()}


def add_fragment_beyond_lanes(result):
    counters = first_case(result)["counters"]
    counters["fragments"][0] = 4 * counters["quads"][0] + 1


def add_partial_quad_without_helper(result):
    counters = first_case(result)["counters"]
    lanes = 4 * counters["quads"][0] - counters["fragments"][0]
    counters["partial_quads"][0] = lanes // 3 - 1


IMPOSSIBLE = [
    (lambda r: r["views"][0]["cases"]["delaunay"]["counters"]["quads"].pop(), "counters of 19"),
    (lambda r: r["views"][0]["epochs"].append(1), "different numbers of rounds"),
    (lambda r: r["views"][0]["times"].update(more=r["views"][0]["times"]["(empty)"]), "not count"),
    (lambda r: r["views"][0].update(resolution=256), "belongs to a different case"),
    (lambda r: r.update(views=[]), "views"),
    (lambda r: r.update(extra=1), "extra"),
    (lambda r: first_case(r)["counters"].update(quads=[10**9] * 20), "fewer than one pixel"),
    (lambda r: r["views"][0]["times"]["delaunay"].update(samples_s=[0.0] * 12), "took no time"),
    (lambda r: first_case(r)["record"].update(scene_hash="1" * 64), "different scenes"),
    (set_zero, "nothing was drawn: all counters are zero"),
    (lambda r: first_case(r)["record"].update(polygons=1000), "20 polygons, expected 1000"),
    (add_fragment_beyond_lanes, "fewer than one pixel, or more than four"),
    (
        lambda r: first_case(r)["counters"]["covering_triangles"].reverse(),
        "more of them than quads",
    ),
    (add_partial_quad_without_helper, "without a helper lane, or with more than three"),
    (lambda r: first_case(r)["record"].update(proven=10**6), "1000000 of 20 polygons proven"),
    (lambda r: first_case(r)["record"].update(triangles=1), "too few triangles or vertices"),
    (lambda r: r["views"].append(r["views"][0]), "a view occurs twice"),
]


@pytest.mark.parametrize(("change", "message"), IMPOSSIBLE)
def test_impossible_results_are_refused(imported, change, message):
    with pytest.raises(HarnessError, match=message):
        imported(change)


CONTRADICTIONS = {
    "predicted": lambda r: first_case(r)["record"].update(
        predicted={**first_case(r)["record"]["predicted"], "half_perimeter": 1.0}
    ),
    "triangles": lambda r: first_case(r)["record"].update(triangles=400),
    "conforming": lambda r: first_case(r)["record"].update(t_junctions=3),
    "counters": lambda r: first_case(r)["counters"]["quads"].reverse(),
    "differing": lambda r: first_case(r).update(differing=2),
}


@pytest.mark.parametrize("change", CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_contradictions_to_the_run_are_refused(saved, small_run, tmp_path, change):
    """The result is consistent, but contradicts the polygons and triangles of the run."""

    def make_consistent(result):
        change(result)
        counters = first_case(result)["counters"]
        fragments, quads, _, covering = map(np.array, counters.values())
        fragments = np.clip(fragments, quads, 4 * quads)
        partial = -(-(4 * quads - fragments) // 3)
        columns = (fragments, quads, partial, np.minimum(quads, np.maximum(covering, 1)))
        first_case(result)["counters"] = {
            name: column.tolist() for name, column in zip(counters, columns, strict=True)
        }

    result = read_result(saved(make_consistent))
    errors = (InputError, IncompatibleRunsError)
    with pytest.raises(errors, match=r"contradict|counters differ from"):
        import_result(result, tmp_path / "run", "phone", small_run)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("rounds", [1, 2])
def test_times_need_two_rounds(imported, rounds):
    def truncate(result):
        for view in result["views"]:
            view["epochs"] = [rounds]
            for times in view["times"].values():
                times["samples_s"] = times["samples_s"][:rounds]

    assert {"time" in record for record in get_rows(imported(truncate))} == {rounds == 2}


@pytest.mark.parametrize(("share", "reached"), [(0.009, True), (0.011, False)])
def test_imprecise_time_is_marked(imported, share, reached):
    """Half of the samples are longer by a share of 1 ms, the others shorter."""

    def spread_times(result):
        times = result["views"][0]["times"]["delaunay"]
        times["samples_s"] = [1e-3 * (1 - share), 1e-3 * (1 + share)] * (ROUNDS // 2)

    reached_by_case = {
        (record["triangulator"], record["resolution"]): record["time"]["precision_reached"]
        for record in get_rows(imported(spread_times))
    }
    assert reached_by_case["delaunay", 128] is reached
    assert reached_by_case["delaunay", 64]


def test_last_polygon_without_triangles_has_zero_counters():
    corners = np.array([(0, 0), (1024, 0), (0, 1024)] * 2, np.int32)
    geometry = Geometry(PolygonArray.of_single_rings(corners, 3), np.arange(2), {})
    counts = count_per_polygon(geometry, np.array([(0, 1, 2)], np.int32))
    assert [len(values) for values in counts] == [2] * len(COUNTERS)
    assert not any(values[1] for values in counts)
    assert min(values[0] for values in counts[:2]) > 0


def test_number_of_differing_polygons_is_verified(imported, small_run):
    """Three polygons have one fragment less than counted by the reference."""

    def change_counts(result):
        counters = first_case(result)["counters"]
        numbers = enumerate(zip(*counters.values(), strict=True))
        places = [k for k, (f, q, partial, _) in numbers if f > q and 4 * q - f < 3 * partial]
        for index in places[:3]:
            counters["fragments"][index] -= 1
        first_case(result)["differing"] = 3

    def miscount(result):
        change_counts(result)
        first_case(result)["differing"] = 2

    assert get_rows(imported(change_counts, small_run))
    with pytest.raises(InputError, match="differ from the exact reference is not 2"):
        imported(miscount, small_run)


def test_results_of_older_pages_lack_covering_triangles(imported, small_run):
    def remove_counter(result):
        for view in result["views"]:
            for case in view["cases"].values():
                del case["counters"]["covering_triangles"]

    for record in imported(remove_counter, small_run).records:
        assert set(record.counters) == {*SHADED} - {"covering_triangles"}


def test_renderer_is_the_description_or_the_device_name(imported):
    def described(result):
        result["device"]["description"] = "Apple M1"

    for change, renderer in ((described, "Apple M1"), (lambda _: None, "phone")):
        (device,) = imported(change).facts["devices"].values()
        assert device["details"]["renderer"] == renderer


def skip_polygons(result):
    record = first_case(result)["record"]
    record["polygons"] -= 3
    record |= {"polygons_skipped": 1, "polygons_failed": 2}


def miscount_skipped(result):
    skip_polygons(result)
    first_case(result)["record"]["polygons_skipped"] = 3


def use_only_triangles(result):
    """Make all polygons triangles, one of which covers full quads and one no pixel."""
    for case in result["views"][0]["cases"].values():
        record, counters = case["record"], case["counters"]
        record |= {"triangles": record["polygons"], "vertices": 3 * record["polygons"]}
        counters["fragments"][0] = 4 * counters["quads"][0]
        counters["partial_quads"][0] = counters["partial_quads"][1] = 0
        counters["fragments"][1] = counters["quads"][1] = counters["covering_triangles"][1] = 0


def remove_polygons(result):
    for case in result["views"][0]["cases"].values():
        case["record"] |= dict.fromkeys(("polygons", "triangles", "vertices", "proven"), 0)
        case["counters"] = {name: [] for name in COUNTERS}


def remove_vertex(result):
    use_only_triangles(result)
    first_case(result)["record"]["vertices"] -= 1


def remove_polygon(result):
    case = first_case(result)
    case["record"]["polygons"] -= 1
    for counts in case["counters"].values():
        counts.pop()


@pytest.mark.parametrize(
    ("possible", "impossible", "message"),
    [
        (use_only_triangles, remove_vertex, "too few triangles or vertices"),
        (remove_polygons, remove_polygon, "of polygons"),
        (skip_polygons, miscount_skipped, "counters of"),
    ],
)
def test_extreme_counts_are_read_and_impossible_ones_refused(saved, possible, impossible, message):
    assert read_result(saved(possible))
    with pytest.raises(HarnessError, match=message):
        read_result(saved(impossible))


def test_file_above_the_size_limit_is_refused(saved, monkeypatch):
    file = saved()
    size = file.stat().st_size
    monkeypatch.setattr("harness.page.saved.MAX_BYTES", size)
    assert read_result(file)
    monkeypatch.setattr("harness.page.saved.MAX_BYTES", size - 1)
    with pytest.raises(InputError, match="too large for a saved result"):
        read_result(file)


@pytest.mark.parametrize(("step", "bits"), [(1, 8), (2, 7), (16, 4)])
def test_grid_of_the_device_is_recorded(imported, step, bits):
    def one_view(result):
        result["device"]["step"] = step
        result["views"] = result["views"][:1]

    facts = imported(one_view).facts
    (device,) = facts["devices"].values()
    assert device["details"]["subpixel_bits"] == bits
    warning = f"the device snaps to 1/{256 // step} px: polygons were moved to its grid"
    assert [line for line in facts["warnings"] if "snaps" in line] == [warning] * (step > 1)
    assert facts["imported"] is True
    assert facts["plan"]["seed"] == 0
    assert facts["scene"]["polygons"] == 20


def remove_cases(result):
    for view in result["views"]:
        view |= {"cases": {}, "times": None, "epochs": []}


def test_page_without_drawings_gives_an_empty_run(imported):
    run = imported(remove_cases)
    assert get_rows(run) == []
    assert run.facts["scene"] == {"name": "city:buildings=20", "hash": "", "polygons": 0}


def test_coverage_of_partial_cases_is_not_compared(imported):
    """A record has no fields that the file lacks."""

    def skip_unproven(result):
        skip_polygons(result)
        first_case(result)["record"].pop("proven", None)

    partial, *complete = (r for r in get_rows(imported(skip_unproven)) if r["resolution"] == 128)
    assert partial["coverage_error"] is None
    assert {record["coverage_error"] for record in complete} == {0}
    assert "proven" not in partial


def test_scene_of_a_single_case_is_the_scene_of_all(imported):
    def one(result):
        first = result["views"][0]["cases"]["delaunay"]
        remove_cases(result)
        result["views"][0]["cases"] = {"delaunay": first}

    assert imported(one).facts["scene"] == imported(lambda _: None).facts["scene"]


def test_single_drawing_with_the_reference_has_a_time(imported):
    def keep_one(result):
        view = result["views"][0]
        names = ("(empty)", "(reference)", "delaunay")
        view["times"] = {name: view["times"][name] for name in names}

    records = [r for r in get_rows(imported(keep_one)) if r["resolution"] == 128]
    assert [r["triangulator"] for r in records if "time" in r] == ["delaunay"]


def test_device_without_a_timer_has_no_times(imported):
    run = imported(lambda result: result.update(timer=None))
    assert all("time" not in record for record in get_rows(run))


def test_missing_fields_are_no_contradiction(imported, small_run, tmp_path):
    def remove_field(result):
        first_case(result)["record"].pop("triangulate_s")

    def snapped(result):
        result["device"]["step"] = 16
        first_case(result)["differing"] = 3

    def counted_otherwise(result):
        first_case(result)["counters"]["fragments"][0] += 1

    bare = replace(small_run, path=tmp_path / "bare")  # has no frames to verify counters with
    cases = ((remove_field, small_run), (snapped, small_run), (counted_otherwise, bare))
    for change, run in cases:
        assert get_rows(imported(change, run))


def test_imported_run_has_frames_and_predictions(imported, small_run):
    run = imported(lambda _: None, small_run)
    for view in {record.id.view for record in run.records}:
        imported_drawing, drawing = (read_geometry(source, view) for source in (run, small_run))
        assert imported_drawing.points.tolist() == drawing.points.tolist()
    before = {(record.name, record.id.view): record for record in small_run.records}
    for record in run.records:
        columns = read_columns(run, record)
        drawing = read_columns(small_run, before[record.name, record.id.view])
        for name in ("predicted_half_perimeter", "quads", "fragments"):
            assert columns[name].tolist() == drawing[name].tolist()
