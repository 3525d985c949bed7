"""Inputs damaged at random, the program given them, and what an end has to be like.

Each input is a process of its own, forked from a program that was loaded once, or started anew.
"""

import contextlib
import copy
import os
import selectors
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import psutil

from tests.endurance.forked import Program
from tests.fuzz.damage import edited
from tests.paths import ROOT

ALLOWED = (0, 2, 4, 5)
"""Done; refused; nothing could be done; a part failed. Never 70 (a defect), 1 or a signal."""

SILENT_S = 10.0
"""Longest without a line, by the wall clock but for what it waits for a core that others have."""

PATIENCE_S = 60.0
"""Seconds by the wall clock after which a silent program is killed."""

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}


@dataclass(frozen=True)
class Ended:
    """How a program ended, what it said, and its longest silence."""

    code: int
    said: str
    silent_s: float


def run(arguments: list[str], folder: Path, command: tuple[str, ...] = ()) -> Ended:
    """Run the program, reading what it says as it says it."""
    command = command or (sys.executable, "-m", "harness")
    process = subprocess.Popen(
        [*command, *arguments],
        cwd=folder,
        env={**ENVIRONMENT, "RASTER_HARNESS_CACHE": str(folder / "cache" / "models.db")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        bufsize=0,
    )
    assert process.stdout is not None
    heard = listen(process.stdout, process.pid)
    return Ended(process.wait(60), *heard)


_own = threading.local()


def run_forked(arguments: list[str], folder: Path) -> Ended:
    """Run the program as `run` does, forked from one that each thread has loaded once."""
    if not hasattr(_own, "program"):
        _own.program = Program()
    environment = {"COLUMNS": "200", "RASTER_HARNESS_CACHE": str(folder / "cache" / "models.db")}
    pid, output = _own.program.start(arguments, folder, environment)
    heard = listen(output, pid)
    return Ended(_own.program.wait(), *heard)


def listen(output: IO[bytes], pid: int) -> tuple[str, float]:
    """Return what a process says to its end, and its longest silence; kills one that hangs."""
    said, silent = b"", 0.0
    spoke, waited = time.monotonic(), 0.0
    with output, selectors.DefaultSelector() as selector:
        selector.register(output, selectors.EVENT_READ)
        while True:
            ready = selector.select(0.2)
            now, waits = time.monotonic(), _waited(pid)
            silent = max(silent, now - spoke - max(0.0, waits - waited))
            if now - spoke > PATIENCE_S:
                os.kill(pid, signal.SIGKILL)
                break
            if ready:
                part = output.read(1 << 16)
                if not part:
                    break
                said = (said + part)[-100_000:]
                spoke, waited = now, waits
    return said.decode(errors="replace"), silent


def _waited(pid: int) -> float:
    """Return the seconds that a process, its threads and its children waited for a core so far."""
    total = 0
    with contextlib.suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        for each in (process, *process.children(recursive=True)):
            for file in Path(f"/proc/{each.pid}/task").glob("*/schedstat"):
                with contextlib.suppress(OSError):
                    total += int(file.read_text().split()[1])
    return total / 1e9


def problem_of(ended: Ended) -> str:
    """Return what is wrong with an end, "" if nothing is."""
    last = ended.said.strip().splitlines()[-1:] or [""]
    if ended.code not in ALLOWED:
        return f"exit code {ended.code}: {last[0][:200]}"
    if "Traceback" in ended.said:
        return f"a traceback: {last[0][:200]}"
    if ended.silent_s > SILENT_S:
        return f"silent for {ended.silent_s:.0f} s"
    if ended.code and not any(
        line.startswith("error: ") and len(line) < 2000 for line in ended.said.splitlines()
    ):
        return f"exit code {ended.code} without a word: {last[0][:200]}"
    return ""


def each(count: int, one, tell, tmp_path: Path, at_once: int = 2) -> Counter[int]:
    """Do `one` for each number, so many `at_once`, and require that none has a problem.

    one : (number, folder) -> (how it ended, problem)

    Returns how many ended with which code.
    """

    def apart(number: int) -> tuple[int, int, str]:
        folder = tmp_path / str(number)
        folder.mkdir()
        ended, problem = one(number, folder)
        if not problem:
            shutil.rmtree(folder, ignore_errors=True)
        return number, ended.code, problem

    with ThreadPoolExecutor(at_once) as pool:
        found = list(pool.map(apart, range(count)))
    codes = Counter(code for _, code, _ in found)
    problems = [f"{number}: {problem}" for number, _, problem in found if problem]
    tell({"inputs": count, **{f"ended with {code}": n for code, n in codes.items()}})
    assert problems == [], problems
    return codes


HOSTILE: tuple[Any, ...] = (
    *(-1, 0, 1, 2**31, 2**63, 10**30, -0.5, 1e308, True, None),
    *("", "x", "../x", "\0", [], {}, [-1], [[]], {"a": 1}, "SCALAR", "VEC2"),
)


def spoilt(data: bytes, chance: np.random.Generator) -> bytes:
    """Bits turned, bytes set, pieces dropped or said twice, or the end cut off."""
    ways = ("flip", "set", "drop", "double", "end")
    edits = [
        {"do": chance.choice(ways), "place": place, "length": int(chance.integers(1, 64))}
        for place in chance.integers(0, 10**9, chance.integers(1, 5)).tolist()
    ]
    return edited(data, edits) or b"\0"


def spoilt_json(told: Any, chance: np.random.Generator) -> Any:
    """A value somewhere in it is another one."""
    made = copy.deepcopy(told)
    for _ in range(chance.integers(1, 4)):
        at = made
        while True:
            keys = list(at) if isinstance(at, dict) else range(len(at))
            key = keys[int(chance.integers(0, len(keys)))]
            if isinstance(at[key], (dict, list)) and at[key] and chance.random() < 0.9:
                at = at[key]
                continue
            at[key] = HOSTILE[int(chance.integers(0, len(HOSTILE)))]
            break
    return made
