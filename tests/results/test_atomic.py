"""Output is atomic; pipes, devices and sockets are never replaced."""

import errno
import os
import socket
import stat
import subprocess
import sys
import threading

import pytest

from harness import atomic
from harness.atomic import write_output
from harness.errors import HarnessError, InputError
from harness.machine import system
from harness.page import device_summaries
from harness.profile.profile import read_coefficients
from harness.results.run_folder import POLYGONS, Run, read_arrays
from tests.compare.runs import write_run
from tests.conftest import assert_refused
from tests.page.conftest import read_result
from tests.paths import run_python


@pytest.mark.parametrize(("mask", "rights"), [(0o022, 0o644), (0o077, 0o600)])
def test_file_has_its_content_and_default_permissions(tmp_path, mask, rights):
    path = tmp_path / "a.txt"
    before = os.umask(mask)
    atomic.write(path, b"one")
    atomic.write(path, b"two", forced=True)
    os.umask(before)
    assert path.read_bytes() == b"two"
    assert path.stat().st_mode & 0o777 == rights
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_full_disk_leaves_the_existing_file(tmp_path, monkeypatch, step):
    path = tmp_path / "a.txt"
    atomic.write(path, b"one")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, step, full)
    monkeypatch.setattr("pathlib.Path.replace", lambda *_: full())
    with pytest.raises(OSError, match="No space left"):
        atomic.write(path, b"two", forced=True)
    assert path.read_bytes() == b"one"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("state", ["abandoned", "in use", "a link"])
def test_temporary_file_of_a_killed_process_is_used_again(tmp_path, state):
    target, temporary = tmp_path / "a.txt", tmp_path / ".a.txt.unfinished"
    (tmp_path / "other").write_text("other")
    temporary.symlink_to("other") if state == "a link" else temporary.write_text("much more text")
    with temporary.open() as file:
        if state == "in use":
            assert system.lock_file(file.fileno(), wait=False)
        atomic.write(target, b"new")
    assert target.read_bytes() == b"new"
    assert temporary.exists() == (state != "abandoned")
    assert (tmp_path / "other").read_text() == "other"


def test_temporary_folder_of_a_killed_process_is_used_again(tmp_path):
    code = "import os, sys; from pathlib import Path; from harness.atomic import Output\n"
    code += "with Output(Path('a.glb')) as output:\n"
    code += "    output.open_published().write(b'half'); output.open_unpublished('b')\n"
    code += "    os.kill(os.getpid(), 9)"
    assert run_python("-c", code, cwd=tmp_path).returncode == -9
    assert len(list(tmp_path.iterdir())) == 1
    target = tmp_path / "a.glb"
    with atomic.Output(target) as output, atomic.Output(target) as second:
        second.open_published().write(b"second")
        output.open_published().write(b"first")
        second.publish()
        output.publish()
    assert target.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [target]


def test_folder_is_merged_file_by_file_outermost_last(tmp_path, monkeypatch):
    path = tmp_path / "out"
    (path / "plots").mkdir(parents=True)
    (path / "own.txt").write_text("own")
    (path / "table.csv").write_text("old")
    moved = []
    rename = atomic.move
    monkeypatch.setattr(atomic, "move", lambda one, two: (moved.append(two.name), rename(one, two)))
    with atomic.create_folder(path, merge=True) as folder:
        (folder / "plots").mkdir()
        (folder / "plots" / "a.png").write_text("new")
        (folder / "table.csv").write_text("new")
        assert (path / "table.csv").read_text() == "old"
    assert moved == ["a.png", "table.csv"]
    assert [file.read_text() for file in sorted(path.rglob("*.*"))] == ["own", "new", "new"]
    assert list(tmp_path.iterdir()) == [path]


def write_half(path):
    with atomic.create_folder(path, merge=True) as folder:
        (folder / "table.csv").write_text("ha")
        raise KeyboardInterrupt


def test_interrupted_output_leaves_existing_files_unchanged(tmp_path):
    path = tmp_path / "out"
    with atomic.create_folder(path, merge=True) as folder:  # the folder does not exist yet
        (folder / "table.csv").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_half(path)
    assert (path / "table.csv").read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(HarnessError, match="already exists"), atomic.create_folder(path):
        pass


def test_the_content_is_on_the_disk_before_the_name(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: calls.append(os.fstat(descriptor).st_mode))
    atomic.write(tmp_path / "a.txt", b"one", forced=True)
    assert [mode & 0o170000 for mode in calls] == [0o100000, 0o040000]


def test_devices_and_sockets_stay(tmp_path, monkeypatch):
    """A socket, which any user can create, is like a device node not a regular file."""
    monkeypatch.chdir(tmp_path)
    endpoint = tmp_path / "endpoint"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("endpoint")
    with pytest.raises(FileExistsError, match=r"not a regular file: .*endpoint"):
        write_output(endpoint, "text")
    with pytest.raises(FileExistsError):
        atomic.write(endpoint, b"text")
    assert stat.S_ISSOCK(endpoint.stat().st_mode)
    assert [file.name for file in endpoint.parent.iterdir()] == ["endpoint"]


def test_a_pipe_is_written_into(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_text()))
    reader.start()
    write_output(pipe, "text")
    reader.join(10)
    assert received == ["text"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("to_file", [False, True])
def test_standard_output_is_written_into(tmp_path, to_file):
    code = "from pathlib import Path; from harness.atomic import write_output;"
    code += "write_output(Path('/dev/stdout'), 'text')"
    target = tmp_path / "out"
    with target.open("wb") as file:
        stdout = file if to_file else subprocess.PIPE
        done = subprocess.run([sys.executable, "-c", code], stdout=stdout, check=True)
    assert (target.read_bytes() if to_file else done.stdout) == b"text"


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("name", ["cases.jsonl", "run.json"])
@pytest.mark.parametrize(
    "command",
    [
        *("report {}", "page {}", "study gains {} --out gains", "history {}", "compare {} {}"),
        *("merge {} {} --hosts a,b --out merged", "run --resume {}"),
    ],
)
def test_a_pipe_in_a_run_is_refused_before_it_is_waited_for(harness, tmp_path, command, name):
    folder = write_run(tmp_path / "run", seed=1)
    (folder / name).unlink()
    os.mkfifo(folder / name)
    assert_refused(harness(*command.format(folder, folder).split()), f"{name}: not a regular file")


def test_pipes_are_refused_by_all_readers(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for read in (read_coefficients, device_summaries._read_summary, read_result):
        with pytest.raises(InputError, match=r"not a regular file|pipe or device, not a file"):
            read(tmp_path / "pipe")
    (tmp_path / POLYGONS).mkdir()
    os.mkfifo(tmp_path / POLYGONS / "key.npz")
    assert read_arrays(Run(tmp_path, {}, []), "key") is None
