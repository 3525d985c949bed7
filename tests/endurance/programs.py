"""Random damage to inputs, execution of the program with them, and checks of the outcome."""

import contextlib
import copy
import os
import selectors
import shutil
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from tests.fuzz.damage import apply_byte_edits
from tests.paths import ROOT

ALLOWED_CODES = (0, 2, 4, 5)
"""Success, bad input, nothing measured, partial failure; never 70 (internal error) or a signal."""

SILENT_S = 10.0
"""Maximum time without output, by the wall clock minus the time waiting for a core."""

TIMEOUT_S = 60.0
"""Wall-clock time without output after which the program is killed."""


@dataclass(frozen=True)
class Outcome:
    """Exit code, output, and longest time without output of a program."""

    code: int
    output: str
    silent_s: float


def run(arguments: list[str], folder: Path, command: tuple[str, ...] = ()) -> Outcome:
    """Run the program in a new process, reading its output continuously."""
    command = command or (sys.executable, "-m", "harness")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    process = subprocess.Popen(
        [*command, *arguments],
        cwd=folder,
        env={**environment, "RASTER_HARNESS_CACHE": str(folder / "cache" / "models.db")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        bufsize=0,
    )
    return read_outcome(process)


def read_outcome(process: subprocess.Popen[bytes]) -> Outcome:
    """Read the output of a process until it ends; kill the process if it hangs."""
    text, silent = b"", 0.0
    last_output, last_wait = time.monotonic(), 0.0
    with process.stdout as output, selectors.DefaultSelector() as selector:
        selector.register(output, selectors.EVENT_READ)
        while True:
            ready = selector.select(0.2)
            now, wait = time.monotonic(), _measure_wait_s(process.pid)
            silent = max(silent, now - last_output - max(0.0, wait - last_wait))
            if now - last_output > TIMEOUT_S:
                process.kill()
                break
            if ready:
                part = output.read(1 << 16)
                if not part:
                    break
                text = (text + part)[-100_000:]
                last_output, last_wait = now, wait
    return Outcome(process.wait(60), text.decode(errors="replace"), silent)


def _measure_wait_s(pid: int) -> float:
    """Return the seconds that a process, with its threads and children, has waited for a core."""
    total = 0
    with contextlib.suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        for run_each in (process, *process.children(recursive=True)):
            for file in Path(f"/proc/{run_each.pid}/task").glob("*/schedstat"):
                with contextlib.suppress(OSError):
                    total += int(file.read_text().split()[1])
    return total / 1e9


def find_problem(outcome: Outcome) -> str:
    """Return the problem of an outcome, or "" if there is none."""
    last = outcome.output.strip().splitlines()[-1:] or [""]
    if outcome.code not in ALLOWED_CODES:
        return f"exit code {outcome.code}: {last[0][:200]}"
    if "Traceback" in outcome.output:
        return f"a traceback: {last[0][:200]}"
    if outcome.silent_s > SILENT_S:
        return f"silent for {outcome.silent_s:.0f} s"
    if outcome.code and not any(
        line.startswith("error: ") and len(line) < 2000 for line in outcome.output.splitlines()
    ):
        return f"exit code {outcome.code} without an error message: {last[0][:200]}"
    return ""


def run_each(count: int, run_one, report_counts, tmp_path: Path, threads: int = 2) -> Counter[int]:
    """Count exit codes of `run_one(number, folder)` -> (outcome, problem); require no problem."""

    def run_in_folder(number: int) -> tuple[int, int, str]:
        folder = tmp_path / str(number)
        folder.mkdir()
        outcome, problem = run_one(number, folder)
        if not problem:
            shutil.rmtree(folder, ignore_errors=True)
        return number, outcome.code, problem

    with ThreadPoolExecutor(threads) as pool:
        outcomes = list(pool.map(run_in_folder, range(count)))
    codes = Counter(code for _, code, _ in outcomes)
    problems = [f"{number}: {problem}" for number, _, problem in outcomes if problem]
    report_counts({"inputs": count, **{f"exit code {code}": n for code, n in codes.items()}})
    assert problems == [], problems
    return codes


HOSTILE_VALUES: tuple[Any, ...] = (
    *(-1, 0, 1, 2**31, 2**63, 10**30, -0.5, 1e308, True, None),
    *("", "x", "../x", "\0", [], {}, [-1], [[]], {"a": 1}, "SCALAR", "VEC2"),
)


def damage_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes with flipped bits, set bytes, dropped or duplicated chunks, or truncated."""
    actions = ("flip", "set", "drop", "double", "end")
    edits = [
        {"action": rng.choice(actions), "position": position, "length": int(rng.integers(1, 64))}
        for position in rng.integers(0, 10**9, rng.integers(1, 5)).tolist()
    ]
    return apply_byte_edits(data, edits) or b"\0"


def damage_json(document: Any, rng: np.random.Generator) -> Any:
    changed = copy.deepcopy(document)
    for _ in range(rng.integers(1, 4)):
        parent, key = choose_value(changed, rng)
        parent[key] = HOSTILE_VALUES[int(rng.integers(0, len(HOSTILE_VALUES)))]
    return changed


def choose_value(document: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """Return the container and the key of a random value, which is mostly a scalar."""
    while True:
        keys = list(document) if isinstance(document, dict) else range(len(document))
        key = keys[int(rng.integers(len(keys)))]
        if not isinstance(document[key], dict | list) or not document[key] or rng.random() < 0.1:
            return document, key
        document = document[key]
