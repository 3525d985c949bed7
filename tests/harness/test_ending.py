"""Every end of a command is one line and the right exit code; 1 only for a regression."""

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shapely import box

from harness.measuring.plan import DEFAULT_TRIANGULATORS
from harness.results.run_folder import Run
from tests.conftest import assert_one_line, assert_refused, write_geojson
from tests.harness.test_cli import MOCK
from tests.measuring.test_run import make_plan, measure
from tests.paths import ROOT

pytestmark = pytest.mark.usefixtures("no_plots")
WRITE_REPORT = "harness.report.page.write_report"


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    scene = write_geojson(folder / "squares.geojson", [box(0, 0, 8, 8), box(9, 0, 14, 5)])
    measure(make_plan(scene, triangulators=("ear-clipping", "delaunay")), folder / "run")
    return folder / "run"


@pytest.fixture
def stored(harness, finished) -> Path:
    """Copy the run into the folder in which the command line runs."""
    return Path(shutil.copytree(finished, "run"))


def system_error(number: int) -> OSError:
    return OSError(number, os.strerror(number), "somewhere/file")


def fail_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(WRITE_REPORT, fail)


@pytest.mark.parametrize(
    ("error", "code", "parts"),
    [
        (system_error(errno.ENOSPC), 2, ["somewhere/file", "No space left", "free some space"]),
        (system_error(errno.EROFS), 2, ["somewhere/file", "Read-only file system", "--out"]),
        (system_error(errno.EACCES), 2, ["somewhere/file", "Permission denied"]),
        (MemoryError(), 2, ["out of memory", "smaller scene"]),
        (ImportError("a.so: failed to map segment"), 2, ["out of memory", "smaller scene"]),
        (RuntimeError("can't start new thread"), 2, ["out of memory", "smaller scene"]),
        (SystemExit(0), 2, ["a plugin called sys.exit(0)"]),
        (RuntimeError("odd\nlines"), 70, ["internal error", "RuntimeError: odd"]),
        (EOFError("cut off"), 70, ["internal error", "cut off"]),
    ],
)
def test_uncaught_errors_are_one_line(harness, stored, monkeypatch, error, code, parts):
    fail_with(error, monkeypatch)
    exit_code, _, err = harness("report", "run")
    assert exit_code == code
    (line,) = (line for line in err.splitlines() if line.startswith("error:"))
    assert all(part in line for part in parts)
    # Only an internal error has a traceback.
    assert ("Traceback" in err) == (code == 70)


def test_debug_prints_tracebacks_without_changing_exit_codes(harness):
    code, _, err = harness("--debug", "report", "no-such-folder")
    assert code == 2
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("error: ")
    assert "Traceback" not in assert_refused(harness("report", "no-such-folder"))


def test_the_log_has_workers_retries_and_the_exit_code(harness):
    shapes = [f"POLYGON ((0 0, {size} 0, {size} {size}, 0 {size}, 0 0))" for size in (1, 40)]
    Path("squares.wkt").write_text("\n".join(shapes))
    command = ("triangulate", "squares.wkt", "-o", "squares.obj")
    command += ("--triangulator", "tests.broken:crash_at_large")
    assert harness("--log", "events.log", *command)[0] == 5
    log = Path("events.log").read_text()
    stamp = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3} INFO \[\d+\] harness"
    for event in (
        r"\.cli: raster-harness \S+: --log events\.log triangulate squares\.wkt",
        r"\.worker: triangulator tests\.broken:crash_at_large: started process \d+",
        r"\.worker: triangulator tests\.broken:crash_at_large crashed: SIGSEGV",
        r"\.triangulating\.triangulate: .* retry in halves: polygons 0 to 1",
        r"\.cli: exit code 5",
    ):
        assert re.search(rf"^{stamp}{event}", log, re.MULTILINE), event
    assert harness("list", "criteria")[0] == 0
    assert Path("events.log").read_text() == log  # the log ends with the command
    assert_refused(harness("--log", "/proc/none/events.log", "list"), "/proc/none")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_anywhere_is_130(harness, stored, monkeypatch, number):
    monkeypatch.setattr(WRITE_REPORT, lambda *_, **__: signal.raise_signal(number))
    before = signal.getsignal(number)
    code, _, err = harness("report", "run")
    assert code == 130
    assert "Traceback" not in err
    assert signal.getsignal(number) is before


def test_commands_started_by_nohup_survive_the_terminal(harness, stored, monkeypatch):
    def hang_up(run: Run, *_: object, **__: object) -> Path:
        signal.raise_signal(signal.SIGHUP)
        return run.path / "report.html"

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        monkeypatch.setattr(WRITE_REPORT, hang_up)
        assert harness("report", "run")[0] == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_wrong_option_is_one_line(harness):
    assert_refused(harness("run", "--sceene", "city"), "--sceene", "--scene", "run --help")


def test_without_arguments_the_help_is_shown(harness):
    code, out, err = harness()
    assert code == 2
    assert "Usage" in out + err


def test_a_full_disk_while_plotting_preserves_the_run(harness, block, monkeypatch):
    fail_with(OSError(errno.ENOSPC, "No space left on device"), monkeypatch)
    code, out, err = harness("run", "--scene", str(block), "--out", "run", *MOCK)
    assert code == 2
    assert "ear-clipping" in out
    assert_one_line(err, "disk of run is full", "safe", "report run")
    assert Path("run/cases.jsonl").read_text().count("\n") == len(DEFAULT_TRIANGULATORS)


@pytest.mark.parametrize("command", ["history run again", "study gains run", "report run"])
@pytest.mark.parametrize("path", ["/proc/none", "file"])
def test_unwritable_folders_are_one_line(harness, stored, command, path):
    Path("file").write_text("")
    shutil.copytree("run", "again")
    assert_refused(harness(*command.split(), "--out", f"{path}/new"), path)


def program(*arguments: str, hook: Path = ROOT, stdout: int = subprocess.PIPE) -> subprocess.Popen:
    """Start the command line; the folder `hook` may have a sitecustomize.py."""
    paths = os.pathsep.join([str(hook), os.environ.get("PYTHONPATH", "")])
    command, environment = [sys.executable, "-m", "harness"], {**os.environ, "PYTHONPATH": paths}
    options = {"cwd": ROOT, "env": environment, "stdout": stdout, "stderr": subprocess.PIPE}
    return subprocess.Popen([*command, *arguments], **options)


@pytest.mark.parametrize("arguments", [["list", "criteria"], ["--help"]])
def test_a_closed_pipe_is_not_an_error(arguments):
    reading, writing = os.pipe()
    os.close(reading)
    process = program(*arguments, stdout=writing)
    os.close(writing)
    _, err = process.communicate()
    assert err == b""
    assert process.returncode == 141


LOADING = """import sys, time
class Slow:
    def find_spec(self, name, *_):
        if name == 'typer':
            open({!r}, 'w').close()
            try:
                time.sleep(600)
            except BaseException:
                raise ImportError('caught')
sys.meta_path.insert(0, Slow())
"""
EXITING = """import atexit, time
atexit.register(lambda: (open({!r}, 'w').close(), time.sleep(600)))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("when", ["loading", "after"])
def test_signals_during_loading_and_exit_are_handled(tmp_path, number, when):
    """A hook makes the command line load for ever, while libraries may catch errors."""
    hook = LOADING if when == "loading" else EXITING
    (tmp_path / "sitecustomize.py").write_text(hook.format(str(tmp_path / "loading")))
    process = program("list", "scenes", hook=tmp_path)
    while not (tmp_path / "loading").exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"Traceback" not in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_in_destructors_end_the_command(tmp_path, number):
    """Python only prints an exception of a destructor, and the command continues."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys\n"
        "class Dying:\n"
        "    def __del__(self):\n"
        f"        os.kill(os.getpid(), {int(number)})\n"
        "class Hook:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'scenes.registry':\n"
        "            Dying()\n"
        "sys.meta_path.insert(0, Hook())\n"
    )
    process = program("list", "scenes", hook=tmp_path)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err.splitlines()[-1]) == (130, b"stopped")


def test_name_outside_the_encoding_of_the_output_is_escaped(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    file = tmp_path / "naïve.wkt"
    file.write_text("POLYGON ((0 0, 9 0, 0 9, 0 0))")
    process = program("inspect", str(file), "--sizes", "16")
    out, err = process.communicate()
    assert (process.returncode, b"Traceback" in err) == (0, False)
    assert b"na\\xefve: ms" in out
