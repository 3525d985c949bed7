"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os

import pytest

from harness.errors import UsageError
from harness.stored import atomic


def test_a_file_appears_with_its_content_and_usual_rights(tmp_path):
    place = tmp_path / "a.txt"
    atomic.write(place, b"one")
    atomic.write(place, b"two", forced=True)
    assert place.read_bytes() == b"two"
    assert place.stat().st_mode & 0o777 == 0o644
    assert list(tmp_path.iterdir()) == [place]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch, step):
    place = tmp_path / "a.txt"
    atomic.write(place, b"one")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, step, full)
    monkeypatch.setattr("pathlib.Path.replace", lambda *_: full())
    with pytest.raises(OSError, match="No space left"):
        atomic.write(place, b"two", forced=True)
    assert place.read_bytes() == b"one"
    assert list(tmp_path.iterdir()) == [place]


def test_a_folder_is_added_to_another_file_by_file_the_outermost_last(tmp_path, monkeypatch):
    place = tmp_path / "out"
    (place / "plots").mkdir(parents=True)
    (place / "own.txt").write_text("own")
    (place / "table.csv").write_text("old")
    moved = []
    rename = atomic.move
    monkeypatch.setattr(atomic, "move", lambda one, two: (moved.append(two.name), rename(one, two)))
    with atomic.folder(place, added=True) as made:
        (made / "plots").mkdir()
        (made / "plots" / "a.png").write_text("new")
        (made / "table.csv").write_text("new")
        assert (place / "table.csv").read_text() == "old"
    assert moved == ["a.png", "table.csv"]
    assert [each.read_text() for each in sorted(place.rglob("*.*"))] == ["own", "new", "new"]
    assert list(tmp_path.iterdir()) == [place]


def half_of_it(place):
    with atomic.folder(place, added=True) as made:
        (made / "table.csv").write_text("ha")
        raise KeyboardInterrupt


def test_what_was_not_finished_changes_nothing_that_was_there(tmp_path):
    place = tmp_path / "out"
    with atomic.folder(place, added=True) as made:  # nothing is there yet
        (made / "table.csv").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        half_of_it(place)
    assert (place / "table.csv").read_text() == "old"
    assert list(tmp_path.iterdir()) == [place]
    with pytest.raises(UsageError, match="there already"), atomic.folder(place):
        pass


def test_the_content_is_on_the_disk_before_the_name(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: calls.append(os.fstat(descriptor).st_mode))
    atomic.write(tmp_path / "a.txt", b"one", forced=True)
    assert [mode & 0o170000 for mode in calls] == [0o100000, 0o040000]
