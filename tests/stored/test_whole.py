"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os

import pytest

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


def test_the_content_is_on_the_disk_before_the_name(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: calls.append(os.fstat(descriptor).st_mode))
    atomic.write(tmp_path / "a.txt", b"one", forced=True)
    assert [mode & 0o170000 for mode in calls] == [0o100000, 0o040000]
