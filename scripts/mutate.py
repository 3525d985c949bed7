"""Change lines at random, run the tests that belong to them, and list the changes no test notices.

    .venv/bin/python scripts/mutate.py --minutes 60 --seed 1

Each change is one token of code within a function: a comparison, a sign, a number, `and`, `not`,
`min`. It is made in a copy of the checkout, whose own files stay as they are. The tests of a module
are those that `TESTS` names for its folder. A change that a test fails on, or that makes the tests
run far longer than they take unchanged, is noticed.
"""

from __future__ import annotations

import argparse
import ast
import io
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tokenize
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent

TESTS = {
    "harness/figures": "tests/figures tests/harness/test_summary.py tests/report/test_content.py",
    "harness/compare": "tests/compare/test_times.py tests/compare/test_gate.py"
    " tests/compare/test_golden.py tests/compare/test_formats.py tests/compare/test_damage.py",
    "harness/measuring/timing.py": "tests/measuring/test_timing.py",
    "harness/scaling/merging.py": "tests/scaling/test_merging.py",
    "harness/page/result.py": "tests/page/test_result.py tests/page/test_devices.py",
    "harness/study/statistics.py": "tests/study",
    "harness/study/regret.py": "tests/study",
    "harness/study/cost_model.py": "tests/study",
    "triangulators/certificate": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_sight.py tests/triangulators/test_skeleton.py"
    " tests/triangulators/test_hunted.py",
    "triangulators/checking": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_sight.py tests/triangulators/test_hunted.py",
}

OTHER = {
    "<": "<=",
    "<=": "<",
    ">": ">=",
    ">=": ">",
    "==": "!=",
    "!=": "==",
    "+": "-",
    "-": "+",
    "*": "/",
    "/": "*",
    "//": "*",
    "+=": "-=",
    "-=": "+=",
    "and": "or",
    "or": "and",
    "not": "",
    "True": "False",
    "False": "True",
    "min": "max",
    "max": "min",
    "any": "all",
    "all": "any",
    "break": "continue",
}

NOTICED, SURVIVED = "noticed", "SURVIVED"


class Change(NamedTuple):
    """One token of a file, given as characters from `start` to `end` of its text."""

    file: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def __str__(self) -> str:
        after = self.after or "(nothing)"
        return f"{self.file}:{self.line}: {self.before} becomes {after}"


def changes(file: str, text: str) -> Iterator[Change]:
    """Yield every change that may be made to a file."""
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    wanted = _lines_of_code(ast.parse(text))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.start[0] not in wanted:
            continue
        after = OTHER.get(token.string)
        if token.type == tokenize.NUMBER:
            after = f"({token.string} + 1)"
        elif token.type not in (tokenize.OP, tokenize.NAME) or after is None:
            continue
        start = starts[token.start[0] - 1] + token.start[1]
        end = start + len(token.string)
        yield Change(file, token.start[0], start, end, token.string, after)


def _lines_of_code(tree: ast.Module) -> set[int]:
    """Return the lines of statements in functions; not their heads, docstrings and raised texts."""
    found: set[int] = set()
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for statement in function.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.expr) and not isinstance(node, ast.Constant):
                    found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        for node in ast.walk(function):
            text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if text or isinstance(node, ast.Raise | ast.Import | ast.ImportFrom):
                found.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def tests_of(file: str) -> list[str]:
    """Return the tests that belong to a file."""
    return next(tests.split() for place, tests in TESTS.items() if file.startswith(place))


def files() -> list[str]:
    """Return the files that are changed."""
    found = []
    for place in TESTS:
        path = ROOT / place
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [str(path.relative_to(ROOT)) for path in found if path.name != "__init__.py"]


class Copy:
    """A copy of the checkout in which changes are made, one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        names = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
        for name in names:
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        (folder / ".venv").symlink_to(ROOT / ".venv")

    def passes(self, tests: list[str], limit_s: float) -> bool:
        """Whether the tests pass in time."""
        command = [ROOT / ".venv/bin/python", "-m", "pytest", "-q", "-x", "-n0", *tests]
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
        with subprocess.Popen(
            command,
            cwd=self.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as running:
            try:
                return running.wait(limit_s) == 0
            except subprocess.TimeoutExpired:
                os.killpg(running.pid, 9)
                return False

    def notices(self, change: Change, limit_s: float) -> bool:
        """Whether a test fails where the change is made."""
        file = self.folder / change.file
        before = file.read_text(encoding="utf-8")
        try:
            after = before[: change.start] + change.after + before[change.end :]
            file.write_text(after, encoding="utf-8")
            return not self.passes(tests_of(change.file), limit_s)
        finally:
            file.write_text(before, encoding="utf-8")


def drawn(seed: int) -> Iterator[Change]:
    """Yield changes at random, a file as often as another of its folder, without end."""
    generator = random.Random(seed)
    known = {
        name: list(changes(name, (ROOT / name).read_text(encoding="utf-8"))) for name in files()
    }
    places = [[name for name in known if name.startswith(place)] for place in TESTS]
    tried: set[Change] = set()
    while True:
        change = generator.choice(known[generator.choice(generator.choice(places))] or [None])
        if change is not None and change not in tried:
            tried.add(change)
            yield change


def main() -> None:
    """Make changes for some minutes and print what came of each."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--minutes", type=float, default=60.0)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--copies", type=int, default=1, help="how many are tried at once")
    chosen = options.parse_args()
    end = time.monotonic() + 60.0 * chosen.minutes
    with tempfile.TemporaryDirectory() as place:
        copies = [Copy(Path(place) / f"{number}" / "checkout") for number in range(chosen.copies)]
        limits: dict[str, float] = {}
        for tests in dict.fromkeys(TESTS.values()):
            for copy in copies:  # the first time kernels are compiled, the second is the measure
                copy.passes(tests.split(), 900.0)
            start = time.monotonic()
            if not copies[0].passes(tests.split(), 900.0):
                sys.exit(f"fails without any change: {tests}")
            limits[tests] = 60.0 + 4.0 * (time.monotonic() - start)
        wanted = drawn(chosen.seed)
        turn = threading.Lock()

        def work(copy: Copy) -> list[tuple[Change, bool]]:
            found = []
            while time.monotonic() < end:
                with turn:
                    change = next(wanted)
                noticed = copy.notices(change, limits[" ".join(tests_of(change.file))])
                print(f"{NOTICED if noticed else SURVIVED:9} {change}", flush=True)
                found.append((change, noticed))
            return found

        with ThreadPoolExecutor(len(copies)) as pool:
            results = [each for found in pool.map(work, copies) for each in found]
    survivors = sum(not noticed for _, noticed in results)
    print(f"{len(results)} changes, {survivors} survivors (seed {chosen.seed})")


if __name__ == "__main__":
    main()
