"""Cut and damage files of all formats at random, read them, and count what came of it.

    PYTHONPATH=. python scripts/damaged_files.py --files 1000 --seed 1

Half of the files are cut; of the other half some bytes are changed, removed or doubled. A file that
is read gives sound polygons, one that is not gives one line. Where the format shows that a file was
cut, the polygons read and those named as lost are all that the whole file has. Each file is read in
a process that may end; ends with 1 if anything did not hold.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import sys
import warnings
from collections import Counter
from multiprocessing.connection import Connection
from typing import Any

from tests.fuzz.targets.files import spoilt
from tests.scenes.whole_files import KINDS, outcome, whole

PATIENCE_S = 10.0
DOS = ("flip", "flip", "drop", "double", "end")
BAD = ("hang", "signal", "lost", "error")


def main() -> int:
    """Read the files and print a table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    reader = Reader()
    for number in range(arguments.files):
        kind = KINDS[number % len(KINDS)]
        task = _task(kind, rng, cut=number // len(KINDS) % 2 == 0)
        became = reader.read(task)
        counts[kind]["cut" if task["length"] is not None else "spoilt"] += 1
        counts[kind][became.partition(":")[0]] += 1
        if became.startswith(BAD):
            print(f"{kind}, file {number}: {became}", flush=True)
    reader.close()
    _print(counts)
    return int(any(counts[kind][bad] for kind in KINDS for bad in BAD))


def _task(kind: str, rng: random.Random, *, cut: bool) -> dict[str, Any]:
    data = whole(kind)[f"a.{kind}"]
    if cut:
        length = rng.randrange(len(data))
        return {"kind": kind, "data": data[:length], "length": length}
    edits = [
        {"place": rng.randrange(10**6), "do": rng.choice(DOS), "length": rng.randint(1, 60)}
        for _ in range(rng.randint(1, 6))
    ]
    return {"kind": kind, "data": spoilt(data, edits), "length": None}


class Reader:
    """A process that reads files, and another one once it has ended or hangs."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None

    def read(self, task: dict[str, Any]) -> str:
        """What became of a file: one of `BAD`, or what `outcome` says."""
        if self._process is None:
            context = multiprocessing.get_context("fork")
            self._ours, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
        self._ours.send(task)
        try:
            if self._ours.poll(PATIENCE_S):
                return str(self._ours.recv())
            became = f"hang: nothing after {PATIENCE_S:.0f} s"
        except EOFError:
            self._process.join()
            became = f"signal: the process ended with {self._process.exitcode}"
        self.close()
        return became

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None


def _serve(connection: Connection) -> None:
    warnings.simplefilter("ignore")
    while True:
        task = connection.recv()
        try:
            became = outcome(task["kind"], task["data"], task["length"])
        except AssertionError as error:
            became = f"lost: {error}"
        except Exception as error:  # what the command line would end with 70 for
            became = f"error: {type(error).__name__}: {error}"
        connection.send(became)


def _print(counts: dict[str, Counter[str]]) -> None:
    columns = ("cut", "spoilt", "refused", "read", "read, all there or named")
    columns = (*columns, "read, no cut to be seen", *BAD)
    print("| format | " + " | ".join(columns) + " |")
    print("|---|" + "---|" * len(columns))
    total: Counter[str] = Counter()
    for kind, row in counts.items():
        total += row
        print(f"| {kind} | " + " | ".join(str(row[column]) for column in columns) + " |")
    print("| all | " + " | ".join(str(total[column]) for column in columns) + " |")


if __name__ == "__main__":
    sys.exit(main())
