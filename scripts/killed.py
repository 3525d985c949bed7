"""Kills commands at random moments, gives each again, and compares with an undisturbed one.

    PYTHONPATH=. .venv/bin/python scripts/killed.py --kills 100 --out FILE

Each command runs in a process that is forked off, with everything imported, and is killed
(SIGKILL) at a random share of the time that it takes undisturbed. A run and the parts of a study go
on with --resume; everything else is given again as it was. What is there then must be what the
undisturbed command made, but for times. `scripts/kills.py` does the same to Dask's workers.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from harness import cli
from harness.commands import census, export, merge, page, study  # noqa: F401 - loaded once
from harness.measuring.run import run
from harness.measuring.worker import Inline
from harness.report import plots
from harness.stored.folder import read_run
from tests.fuzz.targets.runs import sound
from tests.page.conftest import result_of, saved_as

REFERENCE = ("--rasterisers", "reference", "--quick", "--quiet", "--no-cache")
SCENE = ("--scene", "city:buildings=40")


class Command(NamedTuple):
    """What is given, what is given again after a kill, and what must be the same then."""

    given: tuple[str, ...]
    again: tuple[str, ...]
    made: Callable[[Path], Any]
    share: int


def records(folder: Path) -> Any:
    """What a run holds but times, by key; whether it is whole; and which files there are."""
    stored = read_run(folder)
    names = ("status", "counters", "predicted", "triangles", "coverage_error")
    found = {each["key"]: [each.get(name) for name in names] for each in stored.records}
    files = sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())
    # Of a run that was cut off at its end, `counted.jsonl` goes with the next one.
    return found, stored.facts.get("interrupted", False), files


def digest(file: Path) -> str:
    """SHA-256 of a file, without what differs from one time to the next."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def studied(folder: Path) -> Any:
    """What all parts of a study hold, and how many findings are judged."""
    parts = {
        str(file.parent.relative_to(folder)): records(file.parent)[:2]
        for file in sorted(folder.rglob("run.json"))
    }
    return parts, (folder / "findings.md").read_text().count("\n")


def tables(folder: Path) -> Any:
    """The tables in a folder, and the names of its pictures."""
    pictures = sorted(file.name for file in folder.rglob("*.png"))
    return {file.name: file.read_text() for file in folder.glob("*.csv")}, pictures


def counted(folder: Path) -> Any:
    """The table of a census."""
    return (folder / "census.csv").read_text()


COMMANDS = {
    "run": Command(
        ("run", *SCENE, *REFERENCE, "--resolution", "64,256", "--out", "out"),
        ("run", *SCENE, *REFERENCE, "--resolution", "64,256", "--resume", "out"),
        records,
        20,
    ),
    "triangulate": Command(
        *[("triangulate", "city:buildings=2000", "-o", "out.glb", "--no-cache", "-q")] * 2,
        digest,
        15,
    ),
    "merge": Command(
        *[("merge", "RUN", "SECOND", "--hosts", "a,b", "-o", "out", "-q")] * 2, records, 15
    ),
    "import": Command(*[("import", "saved.json", "-o", "out", "-q")] * 2, records, 15),
    "report": Command(*[("report", "RUN", "-o", "out.html")] * 2, digest, 10),
    "gains": Command(*[("study", "gains", "RUN", "--out", "out")] * 2, tables, 5),
    "history": Command(*[("history", "RUN", "SECOND", "--all", "--out", "out")] * 2, tables, 5),
    "inspect": Command(*[("inspect", "paper", "--every", "paper", "--out", "out")] * 2, tables, 5),
    "page": Command(*[("page", "RUN", "-o", "out.html")] * 2, digest, 10),
    "census": Command(*[("census", "block.geojson", "-o", "out", "-q")] * 2, counted, 10),
    "study": Command(
        *[
            ("study", "all", "block.geojson", "--out", "out", "--quick", "-q", "--resolution", "64")
            + ("--rasterisers", "reference")
        ]
        * 2,
        studied,
        5,
    ),
}


def start(arguments: tuple[str, ...]) -> int:
    """Fork a process that carries out a command; returns its number."""
    child = os.fork()
    if child:
        return child
    os.setpgid(0, 0)
    nowhere = os.open("log.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(nowhere, number)
    sys.argv = ["raster-harness", *arguments]
    code = 70
    try:
        cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.stdout.flush()
        os._exit(code)


def carry_out(arguments: tuple[str, ...], kill_after_s: float | None = None) -> int | None:
    """Carry out a command; returns its exit code, None where it was killed."""
    child = start(arguments)
    begun = time.monotonic()
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if kill_after_s is not None and time.monotonic() - begun >= kill_after_s:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(0.002)


def prepare(place: Path) -> None:
    """Make the files that commands are given, and go there."""
    place.mkdir(parents=True)
    os.chdir(place)
    shutil.copytree(sound(), "RUN")
    shutil.copytree(sound(), "SECOND")
    second = json.loads(Path("SECOND/run.json").read_text())
    second["created"] = "2026-01-02T12:00:00+00:00"
    Path("SECOND/run.json").write_text(json.dumps(second))
    lines = Path("SECOND/cases.jsonl").read_text()
    moved = lines.replace('"samples_s": [', '"samples_s": [0.0002, ')
    Path("SECOND/cases.jsonl").write_text(moved)
    shutil.copy(sound().with_name("block.geojson"), ".")
    saved_as(result_of(read_run(Path("RUN"))), Path("saved.json"))


def disturbed(name: str, kills: int, choice: random.Random, place: Path) -> str:
    """Kill a command so many times, each in a folder of its own; returns a row of the table."""
    command = COMMANDS[name]
    prepare(place / name / "whole")
    begun = time.monotonic()
    assert carry_out(command.given) == 0, Path("log.txt").read_text()
    took = time.monotonic() - begun
    target = next(iter(Path().glob("out*")))
    expected = command.made(target)
    killed = late = more = 0
    number = 0
    while killed < kills:
        number += 1
        prepare(place / name / str(number))
        if carry_out(command.given, choice.uniform(0.0, took)) is not None:
            late += 1  # it was quicker than the first time
            assert late < 20 * kills
            shutil.rmtree(place / name / str(number))
            continue
        killed += 1
        code = 2
        if command.again != command.given and Path(target, "run.json").exists():
            code = carry_out(command.again) or 0
        else:  # nothing had begun
            code = carry_out(command.given) or 0
        log = Path("log.txt").read_text()
        done = code == 2 and "out is there already" in log.splitlines()[-1]  # the kill came late
        assert code == 0 or done, f"{name}: exit {code}: {log[-2000:]}"
        assert command.made(target) == expected, f"{name}: {Path.cwd()} differs"
        left = [each.name for each in Path().iterdir() if ".unfinished" in each.name]
        assert not left, f"{name}: left behind {left}"
        more += 1
        os.chdir(place)
        shutil.rmtree(place / name / str(number))
    return f"| {name} | {took:.1f} s | {killed} | {more} |"


def main() -> None:
    """Read the command line, kill, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    out = chosen.out.absolute() if chosen.out else None
    run.__kwdefaults__["open_worker"] = lambda *_: Inline()
    plots.plot_run = lambda run: []  # type: ignore[assignment] # noqa: ARG005 - seconds each
    choice = random.Random(chosen.seed)
    sound()
    lines = [
        "| command | undisturbed | killed | as undisturbed when given again |",
        "|---|---:|---:|---:|",
    ]
    total = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, command in COMMANDS.items():
            kills = max(1, command.share * chosen.kills // 100)
            total += kills
            lines.append(disturbed(name, kills, choice, Path(folder)))
            print(lines[-1], flush=True)
        os.chdir("/")
    lines += ["", f"{total} kills; nothing was lost, and nothing was left behind."]
    if out:
        out.write_text("\n".join(lines) + "\n")
    print(lines[-1])


if __name__ == "__main__":
    main()
