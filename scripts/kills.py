"""Kills workers, the scheduler and the command at random moments, and checks that nothing is lost.

    PYTHONPATH=. .venv/bin/python scripts/kills.py --footprints 1000000 --kills 100

One run of `harness triangulate` is left alone. Then the same work is done by two workers and a
scheduler that are killed (SIGKILL) and started again, as a system's supervisor would; if the
command is killed, it is given again. When its folder is complete, its files must be those of the
first run, byte by byte, and each footprint must be there once. With kills left, it begins again in
a new folder.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from pyarrow import parquet

from scripts.footprints import write

ROOT = Path(__file__).resolve().parent.parent
KINDS = ("worker", "worker", "scheduler", "command")
"""What is killed; there are two workers."""

MOST_S = 1800.0


class Cast:
    """The processes that work for the command; each that is dead is started again."""

    def __init__(self, log: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self._log = log.open("ab")
        dask = [sys.executable, "-m", "dask"]
        worker = [*dask, "worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        self._commands = {
            "scheduler": [*dask, "scheduler", "--port", self.address.rpartition(":")[2]]
            + ["--host", "127.0.0.1", "--no-dashboard"],
            "worker 0": [*worker, "--death-timeout", "30"],
            "worker 1": [*worker, "--death-timeout", "30"],
        }
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.keep()

    def keep(self) -> None:
        """Start what is not running."""
        for name, command in self._commands.items():
            if name not in self._running or self._running[name].poll() is not None:
                self._running[name] = start(command, self._log)

    def kill(self, kind: str, choice: random.Random) -> None:
        """Kill the scheduler, or one of the workers."""
        names = [name for name in self._running if name.startswith(kind)]
        victim = self._running[choice.choice(names)]
        victim.kill()
        victim.wait()

    def end(self) -> None:
        """Kill everything."""
        for process in self._running.values():
            process.kill()
            process.wait()
        self._log.close()


def start(command: list[str], log: object) -> subprocess.Popen[bytes]:
    """Start a program in the repository."""
    return subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log)  # type: ignore[call-overload]


def command(data: Path, out: Path, where: str) -> list[str]:
    """The command that is killed."""
    pattern = str(data / "*.parquet")
    return [
        sys.executable,
        "-m",
        "harness",
        "triangulate",
        pattern,
        "-o",
        str(out),
        "--dask",
        where,
    ]


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each part in a folder; what is left of processes that died must be gone."""
    parts = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folder.iterdir()
        if file.suffix == ".parquet"
    }
    others = {file.name for file in folder.iterdir()} - set(parts) - {"manifest.json"}
    assert not others, f"left behind: {others}"
    return parts


def numbers(folder: Path) -> np.ndarray:
    """The numbers of all footprints in a folder's parts, sorted."""
    columns = [parquet.read_table(file, columns=["id"])["id"] for file in folder.glob("*.parquet")]
    return np.sort(np.concatenate([column.to_numpy() for column in columns]))


def disturbed(
    data: Path, out: Path, kills: int, choice: random.Random, log: Path
) -> tuple[Counter[str], int]:
    """Carry out the work while at most `kills` processes are killed.

    Returns how many of each kind were, and how often the command was given.
    """
    killed: Counter[str] = Counter()
    given = 0
    begun = time.monotonic()
    cast = Cast(log)
    with log.open("ab") as output:
        try:
            while True:
                given += 1
                running = start(command(data, out, cast.address), output)
                again = time.monotonic() + choice.uniform(0.2, 4.0)
                while running.poll() is None:
                    assert time.monotonic() - begun < MOST_S, f"stuck; see {log}"
                    time.sleep(0.02)
                    cast.keep()
                    if time.monotonic() >= again and killed.total() < kills:
                        kind = choice.choice(KINDS)
                        killed[kind] += 1
                        if kind == "command":
                            running.kill()
                        else:
                            cast.kill(kind, choice)
                        again = time.monotonic() + choice.uniform(0.2, 4.0)
                code = running.returncode
                if code == 0:
                    return killed, given
                assert code in (-9, 5), f"exit code {code}; see {log}"
        finally:
            cast.end()


def main() -> None:
    """Read the command line, kill, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--footprints", type=int, default=1_000_000)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="where the data are made and kept")
    chosen = parser.parse_args()
    choice = random.Random(chosen.seed)
    place = chosen.folder or Path(tempfile.mkdtemp(prefix="kills-"))
    data, whole, log = place / "data", place / "whole", place / "log.txt"
    write(data, chosen.footprints)
    if whole.exists():
        shutil.rmtree(whole)
    subprocess.run(command(data, whole, "local:2"), cwd=ROOT, check=True)
    expected = digests(whole)
    killed: Counter[str] = Counter()
    rounds = given = 0
    begun = time.monotonic()
    while killed.total() < chosen.kills:
        out = place / f"disturbed-{rounds}"
        shutil.rmtree(out, ignore_errors=True)
        left = chosen.kills - killed.total()
        now, times = disturbed(data, out, left, choice, log)
        killed, rounds, given = killed + now, rounds + 1, given + times
        found = numbers(out)
        lost = chosen.footprints - len(np.unique(found))
        twice = len(found) - len(np.unique(found))
        equal = digests(out) == expected
        line = {"round": rounds, "killed": dict(now), "given": times}
        print(json.dumps({**line, "lost": lost, "twice": twice, "equal": equal}), flush=True)
        assert (lost, twice, equal) == (0, 0, True), f"see {out}"
        shutil.rmtree(out)
    print(
        f"{killed.total()} kills ({dict(killed)}) in {rounds} rounds and "
        f"{time.monotonic() - begun:.0f} s over {chosen.footprints:,} footprints in "
        f"{len(expected)} parts; the command was given {given} times: 0 lost, 0 twice, "
        "every file equal to the undisturbed run's"
    )
    if chosen.folder is None:
        shutil.rmtree(place)


if __name__ == "__main__":
    main()
