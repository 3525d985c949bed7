"""Killed commands: running the same command again gives the result of an undisturbed one."""

import hashlib
import json
import os
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from harness.results.run_folder import read_run
from scenes import load
from scenes.tiles import FILE
from tests.fuzz.targets.runs import make_sample_run
from tests.models.various import make_solid
from tests.page.conftest import make_result, write_saved
from tests.paths import ROOT
from tests.records import get_rows
from tests.scaling.conftest import read_ids, write_parquet

REFERENCE = ("--rasterisers", "reference", "--quick", "--quiet", "--no-cache")
STUDY = ("--out", "out", "--quick", "-q", "--resolution", "64", "--rasterisers", "reference")


def read_contents(folder: Path) -> Any:
    """Return the cases of a run by key without times, whether it was interrupted, and its files."""
    stored = read_run(folder)
    names = ("status", "counters", "predicted", "triangles", "coverage_error")
    cases = {record["key"]: [record.get(name) for name in names] for record in get_rows(stored)}
    files = sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())
    return cases, stored.facts.get("interrupted", False), files


def file_digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def read_tables(folder: Path) -> Any:
    """Return the tables of a folder and the names of its pictures."""
    pictures = sorted(file.name for file in folder.rglob("*.png"))
    return {file.name: file.read_text() for file in folder.glob("*.csv")}, pictures


def read_study(folder: Path) -> Any:
    """Return the contents of all parts of a study, and the number of lines of its findings."""
    parts = {str(f.parent): read_contents(f.parent)[:2] for f in sorted(folder.rglob("run.json"))}
    return parts, (folder / "findings.md").read_text().count("\n")


class Repeatable(NamedTuple):
    """A command line, the function that reads its result, and the command line to resume."""

    arguments: tuple[str, ...]
    read_result: Callable[[Path], Any]
    resume: tuple[str, ...] = ()


COMMANDS = {
    **{
        f"run of {name}": Repeatable(
            ("run", "--scene", *scene, *REFERENCE, "--out", "out"),
            read_contents,
            ("run", "--scene", *scene, *REFERENCE, "--resume", "out"),
        )
        for name, scene in {
            "a city": ("city:buildings=40", "--resolution", "64,256"),
            "tiles": ("tiles.pmtiles:pixels=64",),
            "a model": ("plate.glb:views=4",),
        }.items()
    },
    "triangulate": Repeatable(
        ("triangulate", "city:buildings=2000", "-o", "out.glb", "-q"), file_digest
    ),
    "merge": Repeatable(
        ("merge", "RUN", "SECOND", "--hosts", "a,b", "-o", "out", "-q"), read_contents
    ),
    "import": Repeatable(("import", "saved.json", "-o", "out", "-q"), read_contents),
    "report": Repeatable(("report", "RUN", "-o", "out.html"), file_digest),
    "history": Repeatable(("history", "RUN", "SECOND", "--all", "--out", "out"), read_tables),
    "inspect": Repeatable(("inspect", "paper", "--every", "paper", "--out", "out"), read_tables),
    "page": Repeatable(("page", "RUN", "-o", "out.html"), file_digest),
    "census": Repeatable(
        ("census", "block.geojson", "-o", "out", "-q"), lambda out: (out / "census.csv").read_text()
    ),
    "study": Repeatable(("study", "all", "block.geojson", *STUDY), read_study),
}


def execute(arguments: tuple[str, ...], temporary: Path, kill_after_s: float | None = None) -> int:
    """Run a command in a new process; return its exit code, -9 if it was killed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)}
    with Path("log.txt").open("ab") as log:
        command = [sys.executable, "-m", "harness", *arguments]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        try:
            return process.wait(kill_after_s)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def prepare_folder(folder: Path) -> None:
    """Create the input files of the commands in a new folder and change to it."""
    folder.mkdir()
    os.chdir(folder)
    for name in ("RUN", "SECOND"):
        shutil.copytree(make_sample_run(), name)
    second = json.loads(Path("SECOND/run.json").read_text())
    second["created"] = "2026-01-02T12:00:00+00:00"
    Path("SECOND/run.json").write_text(json.dumps(second))
    lines = Path("SECOND/cases.jsonl").read_text()
    slower = lines.replace('"samples_s": [', '"samples_s": [0.0002, ')
    Path("SECOND/cases.jsonl").write_text(slower)
    shutil.copy(make_sample_run().with_name("block.geojson"), ".")
    Path("tiles.pmtiles").symlink_to(FILE)
    make_solid().export("plate.glb")
    write_saved(make_result(read_run(Path("RUN"))), Path("saved.json"))


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """Return a folder for temporary files; sockets in it need a short path."""
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        yield Path(folder)


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_commands_can_be_repeated(
    name, scale_count, report_counts, tmp_path, short_folder, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    command, rng = COMMANDS[name], random.Random(name)
    prepare_folder(tmp_path / "whole")
    start = time.monotonic()
    complete = (0, 5) if name == "study" else (0,)  # 5: other programs disturbed the times
    assert execute(command.arguments, short_folder) in complete, Path("log.txt").read_text()
    duration = time.monotonic() - start
    target = next(iter(Path().glob("out*")))
    expected, files = command.read_result(target), set(Path().iterdir())
    killed = 0
    for number in range(scale_count(30)):
        prepare_folder(tmp_path / str(number))
        killed += execute(command.arguments, short_folder, rng.uniform(0.0, duration)) == -9
        can_resume = command.resume and Path(target, "run.json").exists()
        code = execute(command.resume if can_resume else command.arguments, short_folder)
        log = Path("log.txt").read_text()
        # The output folder exists if the command finished before the kill.
        assert code in complete or (code == 2 and "already exists" in log.splitlines()[-1]), log[
            -2000:
        ]
        assert command.read_result(target) == expected, Path.cwd()
        assert set(Path().iterdir()) == files
        assert not [*short_folder.iterdir()]
        os.chdir(tmp_path)
        shutil.rmtree(tmp_path / str(number))
    report_counts({"kills": killed})


def write_footprints(folder: Path, count: int) -> None:
    """Write numbered footprints as GeoParquet files of at most 50,000."""
    folder.mkdir()
    for number, first in enumerate(range(0, count, 50_000)):
        polygons = load(f"city:buildings={min(50_000, count - first)}", seed=number).polygons
        write_parquet(folder / f"{number:04}.parquet", np.array(polygons), first, rows=5_000)


class Cluster:
    """A scheduler and two workers; `restart_dead` restarts those that exited."""

    def __init__(self, log: Any) -> None:
        with socket.socket() as listener:
            listener.bind(("127.0.0.1", 0))
            port = listener.getsockname()[1]
        self.address, self.log = f"tcp://127.0.0.1:{port}", log
        worker = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--death-timeout", "30"]
        scheduler = ["scheduler", "--port", f"{port}", "--host", "127.0.0.1"]
        self.commands = {"scheduler": scheduler, "worker 0": worker, "worker 1": worker}
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def restart_dead(self) -> None:
        for name, arguments in self.commands.items():
            if name not in self.running or self.running[name].poll() is not None:
                self.running[name] = self.start("dask", *arguments, "--no-dashboard")

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", *arguments]
        return subprocess.Popen(command, cwd=ROOT, stdout=self.log, stderr=self.log)

    def kill_all(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait()


def test_killed_cluster_processes_lose_nothing(scale_count, report_counts, tmp_path):
    """All parts equal those of an undisturbed command, and contain each footprint once."""
    data, undisturbed, log = tmp_path / "data", tmp_path / "whole", tmp_path / "log.txt"
    footprints, kills_left, rng = scale_count(1_000_000), scale_count(100), random.Random(0)
    write_footprints(data, footprints)
    arguments = ("harness", "triangulate", str(data / "*.parquet"), "-o")
    command = [sys.executable, "-m", *arguments, undisturbed, "--dask", "local:2"]
    subprocess.run(command, cwd=ROOT, check=True)
    expected = {file.name: file_digest(file) for file in undisturbed.glob("*.parquet")}
    counts: Counter[str] = Counter()
    while kills_left > 0:
        out = tmp_path / "out"
        with log.open("ab") as output:
            cluster = Cluster(output)
            try:
                code: int | None = -9
                while code != 0:
                    assert code in (-9, 5), f"exit code {code}; see {log}"
                    counts["commands given"] += 1
                    cluster.restart_dead()
                    command = cluster.start(*arguments, str(out), "--dask", cluster.address)
                    next_kill = time.monotonic() + rng.uniform(0.2, 4.0)
                    while (code := command.poll()) is None:
                        time.sleep(0.02)
                        cluster.restart_dead()
                        if time.monotonic() >= next_kill and kills_left > 0:
                            kind = rng.choice(["worker 0", "worker 1", "scheduler", "command"])
                            victim = command if kind == "command" else cluster.running[kind]
                            victim.kill()
                            victim.wait()
                            kills_left -= 1
                            counts[f"kills of a {kind.rstrip(' 01')}"] += 1
                            next_kill = time.monotonic() + rng.uniform(0.2, 4.0)
            finally:
                cluster.kill_all()
        assert {file.name: file_digest(file) for file in out.glob("*.parquet")} == expected
        assert {f.name for f in out.iterdir()} == {*expected, "manifest.json"}
        assert read_ids(out) == list(range(footprints))
        shutil.rmtree(out)
    report_counts(counts)
