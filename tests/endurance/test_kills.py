"""Whatever is killed, and whenever: given again, a command makes what an undisturbed one makes."""

import hashlib
import json
import os
import random
import shutil
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pytest
import shapely
from pyarrow import parquet

from harness.results.run_folder import read_run
from scenes import load
from scenes.tiles.read import FILE
from tests.fuzz.targets.runs import sound
from tests.models.various import solid
from tests.page.conftest import result_of, saved_as
from tests.paths import ROOT
from tests.records import lines_of

REFERENCE = ("--rasterisers", "reference", "--quick", "--quiet", "--no-cache")
SCENE = ("--scene", "city:buildings=40", "--resolution", "64,256")
STUDY = ("--out", "out", "--quick", "-q", "--resolution", "64", "--rasterisers", "reference")


def records(folder: Path) -> Any:
    """What a run holds but times, by key; whether it is whole; and which files there are."""
    stored = read_run(folder)
    names = ("status", "counters", "predicted", "triangles", "coverage_error")
    found = {each["key"]: [each.get(name) for name in names] for each in lines_of(stored)}
    files = sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())
    return found, stored.facts.get("interrupted", False), files


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def tables(folder: Path) -> Any:
    """The tables in a folder, and the names of its pictures."""
    pictures = sorted(file.name for file in folder.rglob("*.png"))
    return {file.name: file.read_text() for file in folder.glob("*.csv")}, pictures


def studied(folder: Path) -> Any:
    """What all parts of a study hold, and how many findings are judged."""
    parts = {str(f.parent): records(f.parent)[:2] for f in sorted(folder.rglob("run.json"))}
    return parts, (folder / "findings.md").read_text().count("\n")


class Command(NamedTuple):
    """What is given, what must be the same afterwards, and what is given where it had begun."""

    given: tuple[str, ...]
    made: Callable[[Path], Any]
    again: tuple[str, ...] = ()


COMMANDS = {
    "run": Command(
        ("run", *SCENE, *REFERENCE, "--out", "out"),
        records,
        ("run", *SCENE, *REFERENCE, "--resume", "out"),
    ),
    **{
        f"run of {name}": Command(
            ("run", "--scene", scene, *REFERENCE, "--out", "out"),
            records,
            ("run", "--scene", scene, *REFERENCE, "--resume", "out"),
        )
        for name, scene in (("tiles", "tiles.pmtiles:pixels=64"), ("a model", "plate.glb:views=4"))
    },
    "triangulate": Command(("triangulate", "city:buildings=2000", "-o", "out.glb", "-q"), digest),
    "merge": Command(("merge", "RUN", "SECOND", "--hosts", "a,b", "-o", "out", "-q"), records),
    "import": Command(("import", "saved.json", "-o", "out", "-q"), records),
    "report": Command(("report", "RUN", "-o", "out.html"), digest),
    "history": Command(("history", "RUN", "SECOND", "--all", "--out", "out"), tables),
    "inspect": Command(("inspect", "paper", "--every", "paper", "--out", "out"), tables),
    "page": Command(("page", "RUN", "-o", "out.html"), digest),
    "census": Command(
        ("census", "block.geojson", "-o", "out", "-q"), lambda out: (out / "census.csv").read_text()
    ),
    "study": Command(("study", "all", "block.geojson", *STUDY), studied),
}


def carry_out(arguments: tuple[str, ...], kill_after_s: float | None = None) -> int:
    """Start a command as a user does; return its exit code, -9 where it was killed."""
    with Path("log.txt").open("ab") as log:
        command = [sys.executable, "-m", "harness", *arguments]
        process = subprocess.Popen(
            command, stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": str(ROOT)}
        )
        try:
            return process.wait(kill_after_s)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def prepare(place: Path) -> None:
    """Make the files that commands are given, and go there."""
    place.mkdir()
    os.chdir(place)
    for name in ("RUN", "SECOND"):
        shutil.copytree(sound(), name)
    second = json.loads(Path("SECOND/run.json").read_text())
    second["created"] = "2026-01-02T12:00:00+00:00"
    Path("SECOND/run.json").write_text(json.dumps(second))
    lines = Path("SECOND/cases.jsonl").read_text()
    moved = lines.replace('"samples_s": [', '"samples_s": [0.0002, ')
    Path("SECOND/cases.jsonl").write_text(moved)
    shutil.copy(sound().with_name("block.geojson"), ".")
    Path("tiles.pmtiles").symlink_to(FILE)
    solid().export("plate.glb")
    saved_as(result_of(read_run(Path("RUN"))), Path("saved.json"))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_killed_command_given_again(name, times, tell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command, choice = COMMANDS[name], random.Random(name)
    prepare(tmp_path / "whole")
    begun = time.monotonic()
    assert carry_out(command.given) == 0, Path("log.txt").read_text()
    took = time.monotonic() - begun
    target = next(iter(Path().glob("out*")))
    expected = command.made(target)
    killed = 0
    for number in range(times(30)):
        prepare(tmp_path / str(number))
        killed += carry_out(command.given, choice.uniform(0.0, took)) == -9
        begun_there = command.again and Path(target, "run.json").exists()
        code = carry_out(command.again if begun_there else command.given)
        log = Path("log.txt").read_text()
        # Where it was quicker than the kill, or the kill came late, the folder is there already.
        assert code == 0 or (code == 2 and "is there already" in log.splitlines()[-1]), log[-2000:]
        assert command.made(target) == expected, Path.cwd()
        assert not [each for each in Path().iterdir() if ".unfinished" in each.name]
        os.chdir(tmp_path)
        shutil.rmtree(tmp_path / str(number))
    tell({"kills": killed})


def write_footprints(folder: Path, count: int) -> None:
    """Write generated footprints as GeoParquet files of at most 50,000, each with its number."""
    folder.mkdir()
    for number, first in enumerate(range(0, count, 50_000)):
        polygons = load(f"city:buildings={min(50_000, count - first)}", seed=number).polygons
        column = {"encoding": "WKB", "geometry_types": ["Polygon"], "crs": None}
        geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
        ids = np.arange(first, first + len(polygons))
        table = pa.table({"id": ids, "geometry": pa.array(shapely.to_wkb(polygons), pa.binary())})
        parquet.write_table(
            table.replace_schema_metadata({"geo": json.dumps(geo)}),
            folder / f"{number:04}.parquet",
            row_group_size=5_000,
        )


class Cast:
    """A scheduler and two workers; each that is dead is started again, as a supervisor would."""

    def __init__(self, log: Any) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address, self.log = f"tcp://127.0.0.1:{port}", log
        worker = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        scheduler = ["scheduler", "--port", f"{port}", "--host", "127.0.0.1", "--no-dashboard"]
        waiting = [*worker, "--death-timeout", "30"]
        self.commands = {"scheduler": scheduler, "worker 0": waiting, "worker 1": waiting}
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def keep(self) -> None:
        for name, arguments in self.commands.items():
            if name not in self.running or self.running[name].poll() is not None:
                self.running[name] = self.start("dask", *arguments)

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", *arguments]
        return subprocess.Popen(command, cwd=ROOT, stdout=self.log, stderr=self.log)

    def end(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait()


def test_killed_workers_scheduler_and_command_lose_nothing(times, tell, tmp_path):
    """Parts are those of an undisturbed command, byte by byte, and each footprint is there once."""
    data, whole, log = tmp_path / "data", tmp_path / "whole", tmp_path / "log.txt"
    footprints, left, choice = times(1_000_000), times(100), random.Random(0)
    write_footprints(data, footprints)
    given = ("harness", "triangulate", str(data / "*.parquet"), "-o")
    subprocess.run([sys.executable, "-m", *given, whole, "--dask", "local:2"], cwd=ROOT, check=True)
    expected = {file.name: digest(file) for file in whole.glob("*.parquet")}
    counts: Counter[str] = Counter()
    while left > 0:
        out = tmp_path / "out"
        with log.open("ab") as output:
            cast = Cast(output)
            try:
                code: int | None = -9
                while code != 0:
                    assert code in (-9, 5), f"exit code {code}; see {log}"
                    counts["commands given"] += 1
                    cast.keep()
                    command = cast.start(*given, str(out), "--dask", cast.address)
                    again = time.monotonic() + choice.uniform(0.2, 4.0)
                    while (code := command.poll()) is None:
                        time.sleep(0.02)
                        cast.keep()
                        if time.monotonic() >= again and left > 0:
                            kind = choice.choice(["worker 0", "worker 1", "scheduler", "command"])
                            victim = command if kind == "command" else cast.running[kind]
                            victim.kill()
                            victim.wait()
                            left -= 1
                            counts[f"kills of a {kind.rstrip(' 01')}"] += 1
                            again = time.monotonic() + choice.uniform(0.2, 4.0)
            finally:
                cast.end()
        assert {file.name: digest(file) for file in out.glob("*.parquet")} == expected
        assert {f.name for f in out.iterdir()} == {*expected, "manifest.json"}
        ids = [
            parquet.read_table(f, columns=["id"])["id"].to_numpy()
            for f in out.iterdir()
            if f.suffix == ".parquet"
        ]
        assert np.array_equal(np.sort(np.concatenate(ids)), np.arange(footprints))
        shutil.rmtree(out)
    tell(counts)
