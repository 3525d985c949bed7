"""Execution of the commands of pages in a folder like that of a reader."""

import contextlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from harness import serving
from harness.measuring.run import run
from harness.worker import Limits, Worker
from scenes.tiles import FILE
from tests.conftest import BLOCK, BRIEF_TIMING, run_command, write_geojson
from tests.docs.blocks import COMMAND, Block
from tests.paths import ROOT
from triangulators.compute import compiled_files

FULL = bool(os.environ.get("DOCS_FULL"))
"""True in `make docs-full`: run all commands, also slow ones, in a shell with full durations."""


class _SharedWorker:
    """A worker that several runs share, because its start takes one or two seconds."""

    def __init__(self, worker: Worker) -> None:
        self.call = worker.call

    def close(self, *, at_once: bool = False) -> None:
        pass


class Workers:
    """Workers by name, started on first use and closed at the end of the session."""

    def __init__(self) -> None:
        # A worker process ends with the thread that started it, so one thread starts all.
        self._thread = ThreadPoolExecutor(1)
        self._workers: dict[str, Worker] = {}

    def open(
        self, name: str, environment: Mapping[str, str], limits: Limits | None = None
    ) -> Worker | _SharedWorker:
        # A reader's module may change between two runs, so its worker is not shared.
        if name.startswith(("triangulator ", "rasteriser ", "scene ")):
            return Worker(name, environment, limits)
        if name not in self._workers:
            self._workers[name] = self._thread.submit(self._start, name, environment).result()
        return _SharedWorker(self._workers[name])

    @staticmethod
    def _start(name: str, environment: Mapping[str, str]) -> Worker:
        with contextlib.chdir(ROOT):  # a reader's folder is removed, and Numba needs a folder
            worker = Worker(name, environment)
        worker.call(os.getpid)
        return worker

    def close(self) -> None:
        for worker in self._workers.values():
            worker.close()
        self._thread.shutdown()


@pytest.fixture(scope="session")
def workers() -> Iterator[Workers]:
    serving.start_server()  # not in a reader's folder: its removal would end the server
    kept = Workers()
    yield kept
    kept.close()


class Reader:
    """Write the files and run the commands of a page in one folder, as a reader would."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / ".venv").symlink_to(ROOT / ".venv")
        write_geojson(folder / "buildings.geojson", BLOCK)
        (folder / "berlin.pmtiles").symlink_to(FILE)

    def follow(self, block: Block) -> None:
        """Write the file or run the commands of a block; require the exit code of each command."""
        if block.kind == "file":
            (self.folder / block.note).write_text(block.content)
        elif block.language != "sh" or block.kind == "not run":
            return
        elif block.lines[0].startswith("make "):
            self._in_a_clone(block)
        elif block.kind != "slow" or FULL:
            for number, line in enumerate(block.lines, start=1):
                last = number == len(block.lines)
                assert self.run(line) == (block.exit_code if last else 0), line

    def run(self, line: str) -> int:
        command = COMMAND.match(line)
        if command and not FULL:
            return run_command(*shlex.split(command["arguments"]))
        environment = {**os.environ, "PYTHONPATH": f"{self.folder}:{ROOT}"}
        # A reader's current folder is the clone, which has the packages; here it is on the path.
        line = line.removeprefix("PYTHONPATH=. ")
        done = subprocess.run(["bash", "-c", line], cwd=self.folder, env=environment, check=False)
        return done.returncode

    def _in_a_clone(self, block: Block) -> None:
        if not FULL:
            targets = {word for line in block.lines for word in line.split()[1:]}
            known = {line.split(":")[0] for line in (ROOT / "Makefile").read_text().splitlines()}
            assert targets <= known
            return
        clone = self.folder / "clone"
        if not clone.exists():
            subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
            (clone / ".venv").symlink_to(ROOT / ".venv")
        for line in block.lines:
            subprocess.run(["bash", "-c", line], cwd=clone, check=True)


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: Workers) -> Iterator[Reader]:
    folder = tmp_path / "reader"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{ROOT}")
    # All readers share compiled code; otherwise every new process would compile again.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(compiled_files.cache_folder().parents[1]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if not FULL:
        monkeypatch.setitem(run.__kwdefaults__, "open_worker", workers.open)
        monkeypatch.setattr("harness.commands.run.QUICK", BRIEF_TIMING)
        # tests/report tests the plots, which would take time in each run here.
        monkeypatch.setattr("harness.report.plots.plot_run", lambda run: [])
    yield Reader(folder)
    shutil.rmtree(folder, ignore_errors=True)
