"""Runs merged by case: whatever the order, conflicts named, counters of hosts compared."""

import json
import shutil
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import pytest

from harness.errors import IncompatibleRunsError, InputError
from harness.frame import View
from harness.results.run_folder import RunFolder, read_arrays, read_facts, read_run
from harness.scaling.merging import merge, set_host
from tests.conftest import assert_refused, make_geojson, require_ok
from tests.measuring.test_run import measure, plan_for
from tests.records import lines_of, make_record

TRIANGULATORS = ("ear-clipping", "delaunay", "optimal:overdraw")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Three runs: of two views, of one of them with another triangulator, and the first again."""
    place = tmp_path_factory.mktemp("runs")
    scene = place / "block.geojson"
    square = [[0, 0], [9, 0], [9, 9], [5, 4], [0, 9], [0, 0]]
    geometry = {
        "type": "MultiPolygon",
        "coordinates": [[square], [[[x + 20, y] for x, y in square]]],
    }
    scene.write_text(make_geojson([geometry], crs=None))
    both = plan_for(scene, triangulators=TRIANGULATORS, views=(View(64), View(128)))
    other = plan_for(scene, triangulators=("optimal:half-perimeter", "delaunay"), views=(View(64),))
    plans = {"first": both, "second": other, "third": both}
    for name, plan in plans.items():
        measure(plan, place / name)
    return {name: place / name for name in plans}


def contents(folder: Path) -> dict[str, bytes]:
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def with_records(run, change):
    return replace(run, records=[make_record(**change(fields)) for fields in lines_of(run)])


def hosted(runs, *names):
    return [set_host(read_run(runs[name]), name) for name in names]


def test_the_order_makes_no_difference(runs, tmp_path):
    made = []
    for number, order in enumerate(permutations(runs)):
        merge(hosted(runs, *order), tmp_path / str(number))
        made.append(contents(tmp_path / str(number)))
    assert all(each == made[0] for each in made)
    merged = read_run(tmp_path / "0")
    assert len(lines_of(merged)) == 6 + 2 + 6
    assert {record["device"] for record in lines_of(merged)} == {
        "scripted@first",
        "scripted@second",
        "scripted@third",
    }
    assert {record["host"] for record in lines_of(merged)} == set(runs)
    assert len({record["key"] for record in lines_of(merged)}) == len(lines_of(merged))
    for record in lines_of(merged):
        columns = read_arrays(merged, record["key"])
        assert columns["fragments"].sum() == record["counters"]["fragments"]
    assert set(merged.facts["devices"]) == {
        f"tests.mock:MockRasteriser on scripted@{name}" for name in runs
    }


def test_a_run_merged_with_itself_is_itself(runs, tmp_path):
    run = read_run(runs["first"])
    merge([run, run], tmp_path / "out")
    merged = read_run(tmp_path / "out")
    assert sorted(map(json.dumps, lines_of(merged))) == sorted(map(json.dumps, lines_of(run)))


def test_records_of_one_case_that_differ_are_named(runs, tmp_path):
    first = read_run(runs["first"])

    def slower(record):
        if record["triangulator"] == "delaunay" and record["resolution"] == 128:
            record["time"] = {**record["time"], "median_s": 1.0}
        return record

    with pytest.raises(
        IncompatibleRunsError, match=r"differ: delaunay, 128 px, .* on scripted"
    ) as e:
        merge([first, with_records(first, slower)], tmp_path / "out")
    assert "64 px" not in str(e.value)
    assert "--hosts" in str(e.value)
    assert not (tmp_path / "out").exists()


def test_what_worked_somewhere_wins_over_what_failed(runs, tmp_path):
    first = read_run(runs["first"])
    kept = ("key", "scene", "scene_hash", "triangulator", "rasteriser", "device", "resolution")
    kept += ("rotation", "fit", "options")

    def failed(record):
        return {n: record[n] for n in kept} | {"status": "failed", "reason": "hung"}

    for number, order in enumerate(permutations([first, with_records(first, failed)])):
        merge(order, tmp_path / str(number))
        assert {r["status"] for r in lines_of(read_run(tmp_path / str(number)))} == {"ok"}


def test_which_of_two_failures_is_kept_has_nothing_to_do_with_the_order_of_names(runs, tmp_path):
    (first,) = hosted(runs, "first")

    def failed(reason, *, backwards):
        def change(record):
            told = {n: v for n, v in record.items() if n not in ("time", "counters")}
            told |= {"status": "failed", "reason": reason}
            return dict(sorted(told.items(), reverse=backwards))

        return with_records(first, change)

    both = failed("hung", backwards=True), failed("killed", backwards=False)
    for number, order in enumerate(permutations(both)):
        merge(order, tmp_path / str(number))
        assert {r["reason"] for r in lines_of(read_run(tmp_path / str(number)))} == {"hung"}


@pytest.mark.parametrize("wrong", [["quads"], ["triangles"], ["fragments", "quads"]])
def test_hosts_that_count_differently_are_named_by_the_first_in_the_alphabet(runs, tmp_path, wrong):
    def one_more(record):
        if record["triangulator"] == "delaunay":
            counts = record["counters"] = dict(record["counters"])
            for what in wrong:
                (counts if what in counts else record)[what] += 1
        return record

    first, third = hosted(runs, "first", "third")
    with pytest.raises(
        IncompatibleRunsError, match=rf"{wrong[0]} of delaunay, 64 px.*@third.*@first"
    ) as e:
        merge([first, with_records(third, one_more)], tmp_path / "out")
    assert "overdraw" not in str(e.value)


def test_runs_of_other_polygons_are_refused(runs, tmp_path):
    first = read_run(runs["first"])
    scene = {**first.facts["scene"], "hash": "0" * 64}
    other = replace(first, facts={**first.facts, "scene": scene})
    with pytest.raises(IncompatibleRunsError, match=r"different or unknown polygons"):
        merge([first, other], tmp_path / "out")


def test_the_command_merges_reports_and_compares(harness, runs, tmp_path, no_plots):
    first, third = str(runs["first"]), str(runs["third"])
    out, _ = require_ok(harness("merge", first, third, "--hosts", "here,there", "-o", "merged"))
    assert "scripted@here" in out
    assert "scripted@there" in out
    assert "scripted@here" in (tmp_path / "merged" / "report.html").read_text()
    require_ok(harness("compare", "merged", "merged", "--gate", "counters"))
    assert_refused(
        harness("merge", first, third, "--hosts", "here", "-o", "other"), "1 hosts for 2 runs"
    )
    assert_refused(harness("merge", first, third, "--hosts", "a,b/c", "-o", "other"), "host 'b/c'")


def test_a_run_that_names_no_scene_is_refused(runs, tmp_path):
    first = read_run(runs["first"])
    bare = replace(first, facts={n: v for n, v in first.facts.items() if n != "scene"})
    with pytest.raises(IncompatibleRunsError, match=r"different or unknown polygons .*first"):
        merge([first, bare], tmp_path / "out")
    with pytest.raises(IncompatibleRunsError, match=r"different or unknown polygons"):
        merge([bare], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_one_run_under_two_hosts_names_is_refused(runs, tmp_path):
    first = read_run(runs["first"])
    with pytest.raises(IncompatibleRunsError, match=r"two hosts \(here and there\)"):
        merge([set_host(first, "here"), set_host(first, "there")], tmp_path / "out")
    # run.json written anew does not hide that the times are the same
    again = replace(first, facts={**first.facts, "created": "2026-01-01T00:00:00Z"})
    with pytest.raises(IncompatibleRunsError, match=r"same measurements with two hosts"):
        merge([set_host(first, "here"), set_host(again, "there")], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_merged_plan_is_that_of_all(runs, tmp_path):
    merge(hosted(runs, "first", "second"), tmp_path / "out")
    found = read_run(tmp_path / "out").facts
    plans = [read_run(runs[name]).facts["plan"] for name in ("first", "second")]
    names = {name for plan in plans for name in plan["triangulators"]}
    assert found["plan"]["triangulators"] == sorted(names)
    assert found["plan"]["rasterisers"] == plans[0]["rasterisers"]
    resolutions = [view["resolution"] for view in found["plan"]["views"]]
    assert sorted(resolutions) == [64, 128]
    assert found["plan"]["options"] == plans[0]["options"]
    assert found["plan"]["seed"] == plans[0]["seed"]
    assert found["interrupted"] is False


def test_a_merge_that_was_cut_off_leaves_nothing_and_is_given_again(
    harness, runs, monkeypatch, no_plots
):
    command = ("merge", str(runs["first"]), str(runs["second"]), "--hosts", "a,b", "-o", "merged")
    append = RunFolder.append

    def cut_off(store, record):
        append(store, record)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "append", cut_off)
        code, _, err = harness(*command)
        assert code == 130, err
    assert not Path("merged").exists()
    left = Path(".merged.unfinished/merged")  # as of one that was killed
    left.mkdir(parents=True)
    (left / "cases.jsonl").write_text("half")
    assert harness(*command)[0] == 0
    assert len(lines_of(read_run(Path("merged")))) == 8
    assert not left.parent.exists()
    assert_refused(harness(*command), "merged: already exists")


def test_a_run_without_records_adds_none(runs, tmp_path):
    first = read_run(runs["first"])
    merge([first, replace(first, records=[])], tmp_path / "out")
    assert lines_of(read_run(tmp_path / "out")) == lines_of(first)
    with pytest.raises(InputError, match="no records to merge"):
        merge([replace(first, records=[])] * 2, tmp_path / "none")


def test_what_both_runs_say_is_said_once_however_it_is_written(runs, tmp_path):
    first = read_run(runs["first"])
    note = {"step": 256, "why": "snapped"}
    turned = dict(reversed(note.items()))
    frames = [replace(first, facts=first.facts | {"frames": [each]}) for each in (note, turned)]
    merge(frames, tmp_path / "out")
    assert read_run(tmp_path / "out").facts["frames"] == [note]


def test_a_damaged_drawing_costs_that_drawing_alone(runs, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(runs["first"], damaged)
    files = sorted((damaged / "frames").glob("*.npz"))
    files[0].write_bytes(b"PK no more")
    merge([read_run(damaged)], tmp_path / "out")
    assert read_arrays(read_run(tmp_path / "out"), files[1].stem, "frames")


def test_a_merge_that_was_cut_off_says_so(runs, monkeypatch, tmp_path):
    def cut_off(store, record):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "append", cut_off)
        with pytest.raises(KeyboardInterrupt):
            merge(hosted(runs, "first"), tmp_path / "out")
    assert read_facts(tmp_path / "out", [])["interrupted"] is True


def test_other_devices_may_count_otherwise(runs, tmp_path):
    def elsewhere(record):
        counters = {name: count + 1 for name, count in record["counters"].items()}
        return {**record, "device": "other", "counters": counters}

    others = with_records(read_run(runs["third"]), elsewhere)
    merge([*hosted(runs, "first"), set_host(others, "third")], tmp_path / "out")
    devices = {record["device"] for record in lines_of(read_run(tmp_path / "out"))}
    assert devices == {"scripted@first", "other@third"}


def test_what_runs_say_of_themselves_is_kept_of_each(runs, tmp_path):
    """The earliest speaks for all, whatever else it says."""
    early, late = hosted(runs, "first", "second")
    early = replace(early, facts={**early.facts, "created": "2026-01-01", "about": "z"})
    told = {"created": "2026-02-01", "about": "a", "warnings": ["hot"], "interrupted": True}
    late = replace(late, facts={**late.facts, **told})
    merge([late, early], tmp_path / "out")
    found = read_run(tmp_path / "out").facts
    assert (found["created"], found["about"]) == ("2026-01-01", "z")
    assert "hot" in found["warnings"]
    assert found["interrupted"] is True
    assert [host["created"] for host in found["merged"]] == ["2026-01-01", "2026-02-01"]
    for host, name in zip(found["merged"], ("first", "second"), strict=True):
        assert host["devices"] == [f"tests.mock:MockRasteriser on scripted@{name}"]
