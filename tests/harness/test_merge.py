import json
import shutil
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path

import pytest
import shapely
from shapely import Polygon

from harness.commands.merge import merge_runs, set_host
from harness.errors import IncompatibleRunsError, InputError
from harness.frame import View
from harness.results.run_folder import read_arrays, read_facts, read_run
from harness.results.run_writer import RunFolder
from tests.conftest import assert_refused, require_ok, write_geojson
from tests.measuring.test_run import make_plan, measure
from tests.records import get_rows, make_record

TRIANGULATORS = ("ear-clipping", "delaunay", "optimal:overdraw")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Write three runs: of two views, of one view with a third triangulator, the first again."""
    folder = tmp_path_factory.mktemp("runs")
    scene = folder / "block.geojson"
    notched = Polygon([(0, 0), (9, 0), (9, 9), (5, 4), (0, 9)])
    write_geojson(scene, [notched, shapely.transform(notched, lambda xy: xy + (20, 0))])
    first = make_plan(scene, triangulators=TRIANGULATORS, views=(View(64), View(128)))
    names = ("optimal:half-perimeter", "delaunay")
    plans = {"first": first, "second": make_plan(scene, triangulators=names, views=(View(64),))}
    for name, plan in (plans | {"third": first}).items():
        measure(plan, folder / name)
    return {name: folder / name for name in ("first", "second", "third")}


@pytest.fixture
def first(runs):
    return read_run(runs["first"])


def contents(folder: Path) -> dict[str, bytes]:
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def with_records(run, change):
    return replace(run, records=[make_record(**change(fields)) for fields in get_rows(run)])


def fail(record, reason="hung"):
    """Return the record of the case without measurements."""
    fields = {name: value for name, value in record.items() if name not in ("time", "counters")}
    return fields | {"status": "failed", "reason": reason}


def hosted(runs, *names):
    return [set_host(read_run(runs[name]), name) for name in names]


def test_result_is_independent_of_the_order(runs, tmp_path):
    results = []
    for number, order in enumerate(permutations(runs)):
        merge_runs(hosted(runs, *order), tmp_path / str(number))
        results.append(contents(tmp_path / str(number)))
    assert all(content == results[0] for content in results)
    merged = read_run(tmp_path / "0")
    assert len(get_rows(merged)) == 6 + 2 + 6
    devices = {f"scripted@{name}" for name in runs}
    assert {record["device"] for record in get_rows(merged)} == devices
    assert {record["host"] for record in get_rows(merged)} == set(runs)
    assert len({record["key"] for record in get_rows(merged)}) == len(get_rows(merged))
    for record in get_rows(merged):
        columns = read_arrays(merged, record["key"])
        assert columns["fragments"].sum() == record["counters"]["fragments"]
    names = {f"tests.mock:MockRasteriser on {device}" for device in devices}
    assert set(merged.facts["devices"]) == names


def test_different_records_of_a_case_are_refused(first, tmp_path):
    def slower(record):
        if record["triangulator"] == "delaunay" and record["resolution"] == 128:
            record["time"] = {**record["time"], "median_s": 1.0}
        return record

    with pytest.raises(IncompatibleRunsError, match=r"differ: delaunay, .* 128 px, .* on") as error:
        merge_runs([first, with_records(first, slower)], tmp_path / "out")
    assert "64 px" not in str(error.value)
    assert "--hosts" in str(error.value)
    assert not (tmp_path / "out").exists()


def test_measured_record_replaces_a_failed_record(first, tmp_path):
    for number, order in enumerate(permutations([first, with_records(first, fail)])):
        merge_runs(order, tmp_path / str(number))
        assert {r["status"] for r in get_rows(read_run(tmp_path / str(number)))} == {"ok"}


def test_choice_between_failures_is_independent_of_names(runs, tmp_path):
    (first,) = hosted(runs, "first")
    reasons = ("hung", "killed")
    failures = [with_records(first, partial(fail, reason=reason)) for reason in reasons]
    for number, order in enumerate(permutations(failures)):
        merge_runs(order, tmp_path / str(number))
        assert {r["reason"] for r in get_rows(read_run(tmp_path / str(number)))} == {"hung"}


@pytest.mark.parametrize("wrong", [["quads"], ["triangles"], ["fragments", "quads"]])
def test_different_counters_of_hosts_are_refused(runs, tmp_path, wrong):
    def one_more(record):
        if record["triangulator"] == "delaunay":
            counts = record["counters"] = dict(record["counters"])
            for name in wrong:
                (counts if name in counts else record)[name] += 1
        return record

    first, third = hosted(runs, "first", "third")
    message = rf"{wrong[0]} of delaunay, .* 64 px.*@third.*@first"
    with pytest.raises(IncompatibleRunsError, match=message) as error:
        merge_runs([first, with_records(third, one_more)], tmp_path / "out")
    assert "overdraw" not in str(error.value)


def test_runs_of_other_or_unknown_polygons_are_refused(first, tmp_path):
    scene = {**first.facts["scene"], "hash": "0" * 64}
    other = replace(first, facts={**first.facts, "scene": scene})
    bare = replace(first, facts={n: v for n, v in first.facts.items() if n != "scene"})
    for merged in ([first, other], [first, bare], [bare]):
        with pytest.raises(IncompatibleRunsError, match=r"different or unknown polygons .*first"):
            merge_runs(merged, tmp_path / "out")
        assert not (tmp_path / "out").exists()


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


def test_run_with_two_hosts_is_refused(first, tmp_path):
    with pytest.raises(IncompatibleRunsError, match=r"two hosts \(here and there\)"):
        merge_runs([set_host(first, "here"), set_host(first, "there")], tmp_path / "out")
    # a rewritten run.json does not hide equal times
    later = replace(first, facts={**first.facts, "created": "2026-01-01T00:00:00Z"})
    with pytest.raises(IncompatibleRunsError, match=r"same measurements with two hosts"):
        merge_runs([set_host(first, "here"), set_host(later, "there")], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_interrupted_merge_leaves_no_folder_and_can_be_repeated(
    harness, runs, monkeypatch, no_plots
):
    command = ("merge", str(runs["first"]), str(runs["second"]), "--hosts", "a,b", "-o", "merged")
    append = RunFolder.append

    def cut_off(store, record):
        append(store, record)
        assert read_facts(store.path, [])["interrupted"] is True
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "append", cut_off)
        code, _, err = harness(*command)
        assert code == 130, err
    assert not Path("merged").exists()
    remainder = Path(".merged.unfinished/merged")  # as of one that was killed
    remainder.mkdir(parents=True)
    (remainder / "cases.jsonl").write_text("half")
    assert harness(*command)[0] == 0
    assert len(get_rows(read_run(Path("merged")))) == 8
    assert not remainder.parent.exists()
    assert_refused(harness(*command), "merged: already exists")


def test_run_without_records_is_merged(first, tmp_path):
    merge_runs([first, replace(first, records=[])], tmp_path / "out")
    assert get_rows(read_run(tmp_path / "out")) == get_rows(first)
    with pytest.raises(InputError, match="no records to merge"):
        merge_runs([replace(first, records=[])] * 2, tmp_path / "none")


def test_equal_records_and_facts_are_merged_independently_of_key_order(first, tmp_path):
    note = {"step": 256, "why": "snapped"}
    turned = dict(reversed(note.items()))
    frames = [replace(first, facts=first.facts | {"frames": [frame]}) for frame in (note, turned)]
    merge_runs(frames, tmp_path / "out")
    merged = read_run(tmp_path / "out")
    assert merged.facts["frames"] == [note]
    assert sorted(map(json.dumps, get_rows(merged))) == sorted(map(json.dumps, get_rows(first)))


def test_only_the_damaged_drawing_is_lost(runs, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(runs["first"], damaged)
    files = sorted((damaged / "frames").glob("*.npz"))
    files[0].write_bytes(b"PK no more")
    merge_runs([read_run(damaged)], tmp_path / "out")
    assert read_arrays(read_run(tmp_path / "out"), files[1].stem, "frames")


def test_counters_of_different_devices_may_differ(runs, tmp_path):
    def elsewhere(record):
        counters = {name: count + 1 for name, count in record["counters"].items()}
        return {**record, "device": "other", "counters": counters}

    changed = with_records(read_run(runs["third"]), elsewhere)
    merge_runs([*hosted(runs, "first"), set_host(changed, "third")], tmp_path / "out")
    devices = {record["device"] for record in get_rows(read_run(tmp_path / "out"))}
    assert devices == {"scripted@first", "other@third"}


def test_facts_of_each_run_and_the_union_of_the_plans_are_stored(runs, tmp_path):
    """The other facts are those of the earliest run."""
    early, late = hosted(runs, "first", "second")
    early = replace(early, facts={**early.facts, "created": "2026-01-01", "about": "z"})
    given_facts = {"created": "2026-02-01", "about": "a", "warnings": ["hot"], "interrupted": True}
    given_facts["state"] = {"state": "disturbed", "why": ["a neighbour"], "draws": []}
    late = replace(late, facts={**late.facts, **given_facts})
    merge_runs([late, early], tmp_path / "out")
    facts = read_run(tmp_path / "out").facts
    assert (facts["created"], facts["about"]) == ("2026-01-01", "z")
    assert "hot" in facts["warnings"]
    assert facts["interrupted"] is True
    assert facts["state"]["state"] == "disturbed"
    assert "a neighbour" in facts["state"]["why"]
    plans = [run.facts["plan"] for run in (early, late)]
    names = {name for plan in plans for name in plan["triangulators"]}
    assert facts["plan"]["triangulators"] == sorted(names)
    assert sorted(view["resolution"] for view in facts["plan"]["views"]) == [64, 128]
    for name in ("rasterisers", "options", "seed"):
        assert facts["plan"][name] == plans[0][name]
    assert [host["created"] for host in facts["merged"]] == ["2026-01-01", "2026-02-01"]
    for host, name in zip(facts["merged"], ("first", "second"), strict=True):
        assert host["devices"] == [f"tests.mock:MockRasteriser on scripted@{name}"]
