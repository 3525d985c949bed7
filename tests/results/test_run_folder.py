"""A run folder survives kills, torn lines, corrupt lines and full disks."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from harness import atomic
from harness.compare.comparison import compare_runs
from harness.errors import InputError, StorageError, UsageError
from harness.report.page import write_report
from harness.results.record import Record
from harness.results.run_folder import (
    SCHEMA_VERSION,
    make_file_stem,
    read_arrays,
    read_counted,
    read_run,
)
from harness.results.run_writer import RunFolder
from tests.records import get_rows, make_record


def record(letter: str, **more: object) -> dict[str, object]:
    names = ("scene", "triangulator", "rasteriser", "device")
    view = {"resolution": 64, "rotation": 0.0}
    return {"key": letter * 16, **dict.fromkeys(names, "x"), **view, "status": "ok", **more}


def stored(letter: str, **more: object) -> Record:
    return make_record(**record(letter, **more))


A, B, C = (letter * 16 for letter in "abc")


def test_appended_records_are_read_back(tmp_path):
    with RunFolder.create(tmp_path / "run") as store:
        store.write_facts({"plan": {"scene": "city"}})
        store.append(stored("a", scene="Straße"))
        store.append(stored("b"))
        store.write_arrays(A, {"fragments": np.array([1, 2])})
    run = read_run(tmp_path / "run")
    assert [entry["key"] for entry in get_rows(run)] == [A, B]
    assert get_rows(run)[0]["scene"] == "Straße"
    assert run.facts["schema_version"] == SCHEMA_VERSION
    assert run.facts["plan"] == {"scene": "city"}
    assert run.problems == []
    arrays = read_arrays(run, A)
    assert arrays["fragments"].tolist() == [1, 2]
    assert read_arrays(run, B) is None


@pytest.mark.parametrize("when", ["meanwhile", "after", "never", "instead"])
def test_records_modified_after_the_run_are_reported(tmp_path, when):
    """A plugin may modify the records and claim success."""
    forged = json.dumps(record("b")) + "\n"
    with RunFolder.create(tmp_path) as store:
        store.append(stored("a"))
        if when == "meanwhile":
            with (tmp_path / "cases.jsonl").open("a") as file:
                file.write(forged)
        store.append(stored("c"))
        store.write_facts({"interrupted": False})
    if when == "after":
        with (tmp_path / "cases.jsonl").open("a") as file:
            file.write(forged)
    if when == "instead":
        content = (tmp_path / "cases.jsonl").read_text()
        (tmp_path / "cases.jsonl").write_text(content.replace("cccc", "bbbb"))
    problems = "".join(read_run(tmp_path).problems)
    assert ("modified after the run" in problems) == (when != "never")
    with RunFolder.resume(tmp_path) as store:  # after the warning a resumed run is accepted
        store.append(stored("d"))
        store.write_facts({"interrupted": False})
    assert read_run(tmp_path).problems == []


@pytest.mark.parametrize("when", ["meanwhile", "after", "never"])
def test_modified_arrays_are_reported_and_ignored(tmp_path, when):
    def forge() -> None:
        np.savez(tmp_path / "polygons" / f"{A}.npz", fragments=np.array([1, 1]))

    with RunFolder.create(tmp_path) as store:
        store.append(stored("a"))
        for key in (A, B):
            store.write_arrays(key, {"fragments": np.array([1, 2])})
        if when == "meanwhile":
            forge()
        store.write_facts({"interrupted": False})
    if when == "after":
        forge()
    for _ in range(2):
        run = read_run(tmp_path)
        message = f"polygons/{A}.npz: modified after the run (checksum mismatch); ignored"
        assert (message in "".join(run.problems)) == (when != "never")
        assert (read_arrays(run, A) is None) == (when != "never")
        assert read_arrays(run, B) is not None
        with RunFolder.resume(tmp_path) as store:  # other arrays are still those of the plugin
            store.write_facts({"interrupted": False})
    with RunFolder.resume(tmp_path) as store:
        store.write_arrays(A, {"fragments": np.array([1, 2])})
        store.write_facts({"interrupted": False})
    assert read_run(tmp_path).problems == []


@pytest.mark.parametrize("arrays", [None, [], 3, {"../x": 3, "polygons": "", "": None}])
def test_invalid_digests_are_ignored(tmp_path, arrays):
    with RunFolder.create(tmp_path) as store:
        store.append(stored("a"))
        store.write_facts({"interrupted": False})
    facts = json.loads((tmp_path / "run.json").read_text())
    facts["written"]["arrays"] = arrays
    (tmp_path / "run.json").write_text(json.dumps(facts))
    assert read_run(tmp_path).problems == []


def test_truncated_records_are_refused_by_compare_and_report(tmp_path):
    for name in ("base", "head"):
        with RunFolder.create(tmp_path / name) as store:
            store.append(stored("a"))
            store.append(stored("b"))
            store.write_facts({"interrupted": False})
    base = read_run(tmp_path / "base")
    cases = tmp_path / "head" / "cases.jsonl"
    content = cases.read_bytes()
    for part in (content[: len(content) // 2 + 9], content[:7], b""):
        cases.write_bytes(part)
        head = read_run(tmp_path / "head")
        sizes = f"{len(part):,} of {len(content):,} bytes"
        message = f"{cases}: incomplete, {sizes} (truncated, or modified after the run)"
        assert head.problems == [message]
        for pair in ((base, head), (head, base)):
            with pytest.raises(InputError, match=r"incomplete.*measure again"):
                compare_runs(*pair)
    with pytest.raises(InputError, match=r"neither a case nor a study .*incomplete"):
        write_report(head)
    cases.write_bytes(content)
    assert read_run(tmp_path / "head").truncation == ""


def test_incomplete_last_line_is_ignored_and_removed_on_resume(tmp_path):
    with RunFolder.create(tmp_path) as store:
        store.write_facts({})
        store.append(stored("a"))
    with (tmp_path / "cases.jsonl").open("a") as file:
        file.write('{"key": "b", "stat')
    assert [entry["key"] for entry in get_rows(read_run(tmp_path))] == [A]
    with RunFolder.resume(tmp_path) as store:
        store.append(stored("c"))
    run = read_run(tmp_path)
    assert [entry["key"] for entry in get_rows(run)] == [A, C]
    assert run.problems == []


def test_corrupt_line_is_reported_and_other_lines_are_read(tmp_path):
    lines = [json.dumps(record("a")), "\x00garbage", "[1]", "[" * 200_000, json.dumps(record("b"))]
    (tmp_path / "cases.jsonl").write_text("\n".join(lines) + "\n")
    run = read_run(tmp_path)
    assert [entry["key"] for entry in get_rows(run)] == [A, B]
    assert len(run.problems) == 3
    assert "line 2" in run.problems[0]


def test_later_record_of_a_case_is_used(tmp_path):
    with RunFolder.create(tmp_path) as store:
        for letter, status in (("a", "failed"), ("b", "ok"), ("a", "ok")):
            store.append(stored(letter, status=status))
    records = get_rows(read_run(tmp_path))
    assert [(r["key"], r["status"]) for r in records] == [(B, "ok"), (A, "ok")]


def test_a_folder_that_holds_a_run_is_not_overwritten(tmp_path):
    RunFolder.create(tmp_path).close()  # killed at once: there is nothing to lose
    with RunFolder.create(tmp_path) as store:
        store.write_facts({})
    with pytest.raises(UsageError, match="already has a run"):
        RunFolder.create(tmp_path)


@pytest.mark.parametrize("call", [RunFolder.resume, read_run])
def test_a_folder_without_a_run_is_refused(tmp_path, call):
    with pytest.raises(InputError, match="has no run"):
        call(tmp_path)


def test_folder_that_cannot_be_created_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=r"cannot use .*file/run: Not a directory"):
        RunFolder.create(tmp_path / "file" / "run")


def test_a_full_disk_loses_nothing_written(tmp_path, monkeypatch):
    store = RunFolder.create(tmp_path)
    store.append(stored("a"))
    real_write = os.write

    def half_then_full(descriptor: int, content: bytes) -> int:
        if len(content) < 10:
            raise OSError(28, "No space left on device")
        return real_write(descriptor, content[: len(content) - 5])

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half_then_full)
        with pytest.raises(StorageError, match=r"disk of .* is full.*--resume"):
            store.append(stored("b", reason="x" * 100))
    store.append(stored("c"))
    run = read_run(tmp_path)
    assert [r["key"] for r in get_rows(run)] == [A, C]
    assert run.problems == []


def test_file_stem_replaces_unsafe_characters():
    assert make_file_stem("city:buildings=40 a/b") == "city-buildings-40-a-b"
    assert make_file_stem("Straße_22.5-x") == "Straße_22.5-x"


@pytest.mark.parametrize("key", ["../../victim", "", "a" * 15, "A" * 16, "a" * 16 + "\n", 7, None])
def test_invalid_keys_are_refused(tmp_path, key):
    lines = [json.dumps(record("a")), json.dumps({**record("b"), "key": key})]
    for name in ("cases.jsonl", "counted.jsonl"):
        (tmp_path / name).write_text("\n".join(lines) + "\n")
    run = read_run(tmp_path)
    assert [r["key"] for r in get_rows(run)] == [A]
    assert "line 2: key: is " in run.problems[0]
    assert list(read_counted(tmp_path)) == [A]


def test_nan_and_infinity_are_read_as_missing(tmp_path):
    (tmp_path / "run.json").write_text('{"seconds": {"all": NaN, "count": 1e999}}')
    assert read_run(tmp_path).facts["seconds"] == {"all": None, "count": None}


def test_missing_median_is_computed_from_the_samples(tmp_path):
    times = {"samples_s": [3.0, 1.0, 2.0, 9.0]}, {"samples_s": [1.0], "median_s": 7.0}
    lines = [json.dumps(record(name, time=time)) for name, time in zip("ab", times, strict=True)]
    (tmp_path / "cases.jsonl").write_text("\n".join(lines) + "\n")
    assert [r["time"]["median_s"] for r in get_rows(read_run(tmp_path))] == [2.5, 7.0]


def test_run_is_locked_by_the_writing_process(tmp_path):
    with RunFolder.create(tmp_path) as store:
        store.write_facts({})
        store.append(stored("a"))
        with pytest.raises(StorageError, match="in use by another run"):
            RunFolder.resume(tmp_path)
    with RunFolder.resume(tmp_path) as store:
        store.append(stored("b"))
    assert [r["key"] for r in get_rows(read_run(tmp_path))] == [A, B]


def _write_more(folder: Path) -> None:
    with RunFolder.resume(folder) as store:
        store.append_counted(stored("b"))
        store.write_arrays(A, {"fragments": np.array([1, 2])})


@pytest.mark.parametrize("name", ["cases.jsonl", "counted.jsonl", "run.json", "polygons"])
@pytest.mark.parametrize("hard", [False, True])
def test_links_out_of_the_folder_are_not_followed(tmp_path, name, hard):
    """Otherwise a file outside the folder would lose a line or get records."""
    foreign = tmp_path / "foreign"
    foreign.write_text("a line\nthe last, without a line break")
    with RunFolder.create(tmp_path / "run") as store:
        store.write_facts({"plan": {}})
    link = tmp_path / "run" / name
    link.unlink(missing_ok=True)
    if name == "polygons":
        foreign.rename(tmp_path / "kept")
        foreign.mkdir()
    elif name == "run.json":
        foreign.write_text('{"plan": {}}')
    if hard and name in ("cases.jsonl", "counted.jsonl"):
        link.hardlink_to(foreign)
    else:
        link.symlink_to(foreign)
    before = foreign.read_text() if foreign.is_file() else ""
    with pytest.raises(StorageError, match=rf"{name}: a (hard )?link"):
        _write_more(tmp_path / "run")
    assert (foreign.read_text() if foreign.is_file() else "") == before
    assert foreign.is_file() or not any(foreign.iterdir())


@pytest.mark.parametrize("name", ["/proc/self/status", "../outside.npz", "polygons/link.npz"])
def test_arrays_are_read_only_inside_the_folder(tmp_path, name):
    (tmp_path / "outside.npz").write_bytes(b"")
    with RunFolder.create(tmp_path / "run") as store:
        (tmp_path / "run/polygons").mkdir()
        (tmp_path / "run/polygons/link.npz").symlink_to(tmp_path / "outside.npz")
        store._arrays[name] = hashlib.sha256(b"").hexdigest()
        store.write_facts({"interrupted": False})
    run = read_run(tmp_path / "run")
    assert run.modified == {name}
    assert any(name in line and "modified after the run" in line for line in run.problems)
    assert read_arrays(run, "link") is None


def test_sizes_are_bounded(tmp_path, monkeypatch):
    """Sparse files and highly compressed archives of zeros are rejected."""
    with RunFolder.create(tmp_path) as store:
        store.write_arrays(A, {"fragments": np.zeros(100_000, np.int64)})
    run = read_run(tmp_path)
    assert read_arrays(run, A) is not None
    monkeypatch.setattr(atomic, "MAX_READ_BYTES", 10_000)
    assert (tmp_path / f"polygons/{A}.npz").stat().st_size < 10_000
    assert read_arrays(run, A) is None
    os.truncate(tmp_path / "cases.jsonl", 10_001)
    with pytest.raises(StorageError, match=r"cases.jsonl: larger than"):
        read_run(tmp_path)


def test_full_disk_while_merging_reports_a_remedy(tmp_path, monkeypatch):
    """A partial merge cannot be resumed."""
    remedy = "remove merged and run the same command again"
    with RunFolder.create(tmp_path / "merged", remedy) as store:
        monkeypatch.setattr(os, "write", lambda *_: (_ for _ in ()).throw(OSError(28, "full")))
        full = "full; free some space, then remove merged"
        with pytest.raises(StorageError, match=full) as caught:
            store.append(stored("a"))
    assert "resume" not in str(caught.value)
