"""Mutation testing: change tokens at random, run the related tests, and report survivors.

    .venv/bin/python scripts/mutate.py --minutes 60 --seed 1 --out FILE
    .venv/bin/python scripts/mutate.py --only harness/compare/wording.py:50-64

A change replaces one token of code in a function, e.g. a comparison, a sign, a number, `and`, `not`
or `min`, in a copy of the checkout. `TESTS` maps folders of modules to test files. These run once
without a change to record the functions that each test file calls. A change is tried with the test
files that call its function, the fastest first; calls in compiled code are not recorded, so changes
there are tried with all test files. A change that makes tests run far longer counts as detected.
Changes in `equivalent_changes.csv` are not tried. (mutmut 3.8 skips decorated functions and so all
compiled ones: mutmut/mutation/file_mutation.py.)
"""

import argparse
import ast
import csv
import importlib
import io
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tokenize
from collections import Counter, defaultdict
from collections.abc import Generator, Iterator, Mapping
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import pytest

from harness.machine.git import run_git

ROOT = Path(__file__).resolve().parent.parent

TESTS = {
    "harness/results": "tests/results",
    "harness/metrics": "tests/metrics tests/harness/test_summary.py tests/report/test_plots.py",
    "harness/compare": "tests/compare/test_times.py tests/compare/test_gate.py"
    " tests/compare/test_golden.py tests/compare/test_formats.py tests/compare/test_damage.py"
    " tests/compare/test_cli.py tests/compare/test_polygons.py",
    "harness/measuring/timing.py": "tests/measuring/test_timing.py",
    "harness/commands/merge.py": "tests/harness/test_merge.py",
    "harness/page/result.py": "tests/page/test_result.py tests/page/test_devices.py",
    "harness/study/correlations.py": "tests/study/test_correlations.py",
    "harness/study/regret.py": "tests/study/test_regret.py",
    "harness/profile/cost_terms.py": "tests/profile/test_fitting.py",
    "harness/profile/law.py": "tests/profile/test_fitting.py",
    "triangulators/certificate": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_skeleton.py"
    " tests/triangulators/test_proof.py tests/triangulators/test_holes.py",
    "triangulators/checking": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_skeleton.py"
    " tests/triangulators/test_holes.py",
}

_MUTATIONS = (
    "< <=|<= <|> >=|>= >|== !=|!= ==|+ -|- +|* /|/ *|// *|+= -=|and or|or and|not |True False"
)
_MUTATIONS += "|False True|min max|max min|any all|all any|break continue"
MUTATION = dict(pair.split(" ") for pair in _MUTATIONS.split("|"))

with (ROOT / "scripts" / "equivalent_changes.csv").open(encoding="utf-8", newline="") as _rows:
    EQUIVALENT_CHANGES = {
        (r["file"], r["piece"], r["tokens"]): r["why"] for r in csv.DictReader(_rows)
    }
"""Equivalent changes, which cannot affect a result: (prefix of a file's path, piece of its code,
tokens in the piece) -> reason."""

LIBRARIES = "highspy hypothesis jinja2 matplotlib.pyplot moderngl numba pandas pydantic pyogrio"
LIBRARIES += " pyproj rich.console rich.progress scipy.sparse scipy.stats shapely trimesh typer"
"""Modules that the parent process imports once, before it forks runs of tests."""

Function = tuple[str, int]
"""A file and the first line of a function in it."""


class Change(NamedTuple):
    """The replacement of a token, the characters from `start` to `end` of a file's text."""

    file: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def __str__(self) -> str:
        after = self.after or "(nothing)"
        return f"{self.file}:{self.line}: {self.before} -> {after}"


def find_changes(file: str, text: str) -> Iterator[Change]:
    """Yield all possible changes of a file."""
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    code_lines = _code_lines(ast.parse(text))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.start[0] not in code_lines:
            continue
        after = MUTATION.get(token.string)
        if token.type == tokenize.NUMBER:
            after = f"({token.string} + 1)"
        elif token.type not in (tokenize.OP, tokenize.NAME) or after is None:
            continue
        start = starts[token.start[0] - 1] + token.start[1]
        end = start + len(token.string)
        yield Change(file, token.start[0], start, end, token.string, after)


def _code_lines(tree: ast.Module) -> set[int]:
    """Return the lines of statements in functions, except docstrings, imports and `raise`."""
    line_numbers: set[int] = set()
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for statement in function.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.expr) and not isinstance(node, ast.Constant):
                    line_numbers.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        for node in ast.walk(function):
            text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if text or isinstance(node, ast.Raise | ast.Import | ast.ImportFrom):
                line_numbers.difference_update(
                    range(node.lineno, (node.end_lineno or node.lineno) + 1)
                )
    return line_numbers


def find_reason(
    change: Change, text: str, reasons: Mapping[tuple[str, str, str], str] = EQUIVALENT_CHANGES
) -> str | None:
    """Return why a change of a file's text cannot affect a result, or None if it can."""
    for (file, piece, tokens), why in reasons.items():
        if change.file.startswith(file) and change.before in tokens.split():
            size = len(piece)
            if text.find(piece, max(0, change.end - size), change.start + size) >= 0:
                return why
    return None


def find_tests(file: str) -> str:
    """Return the test files of a module, separated by spaces."""
    return next(tests for path, tests in TESTS.items() if file.startswith(path))


def list_files() -> list[str]:
    """Return the files to change."""
    paths = chain.from_iterable(
        sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path]
        for path in TESTS
    )
    return [str(path.relative_to(ROOT)) for path in paths if path.name != "__init__.py"]


class Recorder:
    """A pytest plugin that records the functions that each test file calls, and its CPU seconds."""

    def __init__(self, folder: Path) -> None:
        self._names = {str(folder / name): name for name in list_files()}
        self.calls: dict[str, set[Function]] = defaultdict(set)
        self.seconds: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, Any, Any]:
        """Record the calls of a test and its fixtures."""
        file, start = item.nodeid.partition("::")[0], time.process_time()

        def trace(frame: FrameType, _event: str, _argument: Any) -> None:
            if name := self._names.get(frame.f_code.co_filename):
                self.calls[file].add((name, frame.f_code.co_firstlineno))

        sys.settrace(trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            self.seconds[file] += time.process_time() - start


class CheckoutCopy:
    """A copy of the checkout, in which changes are made one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in run_git(ROOT, "ls-files", "-z").split("\0"):
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        (folder / ".venv").symlink_to(ROOT / ".venv")
        self._recorded: dict[str, tuple[dict[str, set[Function]], dict[str, float]]] = {}

    def record_calls(self, tests: str) -> None:
        """Run tests without a change and record their calls; exit if a test fails."""
        if not self._run_tests(tests.split(), 1800.0, Recorder(self.folder)):
            sys.exit(f"{self._log().read_text()}\n{tests}: fail without a change; fix them first")
        self._recorded[tests] = ast.literal_eval(self._log("recorded").read_text())

    def _log(self, name: str = "log.txt") -> Path:
        return self.folder.with_name(name)

    def _run_tests(
        self, tests: list[str], limit_s: float, recorder: Recorder | None = None
    ) -> bool:
        """Return whether the tests pass within the time limit, in a forked process."""
        child = os.fork()
        if not child:
            code = 1
            try:
                os.setsid()
                log = os.open(self._log(), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                for number in (1, 2):
                    os.dup2(log, number)
                os.chdir(self.folder)
                sys.path.insert(0, str(self.folder))
                sys.dont_write_bytecode = True
                os.environ |= {"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
                options = ["-x", "-n0", "-p", "no:cacheprovider", *tests]
                code = int(pytest.main(options, [recorder] if recorder else []))
                if recorder:
                    calls_and_seconds = (dict(recorder.calls), dict(recorder.seconds))
                    self._log("recorded").write_text(repr(calls_and_seconds))
            finally:
                os._exit(code)
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            finished, status = os.waitpid(child, os.WNOHANG)
            if finished:
                return status == 0
            time.sleep(0.02)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return False

    def is_detected(self, change: Change) -> bool:
        """Return whether a test fails or takes far longer with the change."""
        file = self.folder / change.file
        before = file.read_text(encoding="utf-8")
        calls, seconds = self._recorded[find_tests(change.file)]
        starts = [
            min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            for node in ast.walk(ast.parse(before))
            if isinstance(node, ast.FunctionDef) and node.lineno <= change.line <= node.end_lineno
        ]
        tests = [name for name in seconds if (change.file, max(starts)) in calls.get(name, set())]
        tests = sorted(tests or seconds, key=seconds.__getitem__)
        try:
            after = before[: change.start] + change.after + before[change.end :]
            file.write_text(after, encoding="utf-8")
            limit_s = 90.0 if "njit" in before else 30.0
            return not self._run_tests(tests, limit_s + 3.0 * sum(seconds[name] for name in tests))
        finally:
            file.write_text(before, encoding="utf-8")


def draw_changes(seed: int) -> Iterator[Change]:
    """Yield random changes without end: a folder of `TESTS`, then a file, then a change."""
    generator = random.Random(seed)
    changes = {name: select_changes(name) for name in list_files()}
    folders = [[name for name in changes if name.startswith(path)] for path in TESTS]
    tried: set[Change | None] = {None}
    while True:
        change = generator.choice(changes[generator.choice(generator.choice(folders))] or [None])
        if change not in tried:
            tried.add(change)
            yield change


def select_changes(selection: str) -> list[Any]:
    """Return all changes of a file or a range of lines, selected as FILE or FILE:FIRST-LAST."""
    file, _, lines = selection.partition(":")
    first, _, last = lines.partition("-")
    changes = find_changes(file, (ROOT / file).read_text(encoding="utf-8"))
    return [
        change for change in changes if not lines or int(first) <= change.line <= int(last or first)
    ]


def main() -> None:
    """Try changes for some minutes and print the outcome of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", default=(), metavar="FILE[:FIRST-LAST]")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    selected = [change for selection in options.only for change in select_changes(selection)]
    counts: Counter[str] = Counter()
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        os.environ["NUMBA_CACHE_DIR"] = temporary  # discard compiled kernels of changed code
        for name in LIBRARIES.split():
            importlib.import_module(name)
        copy = CheckoutCopy(Path(temporary) / "checkout")
        for tests in {find_tests(change.file) for change in selected} or TESTS.values():
            copy.record_calls(tests)
        end = time.monotonic() + 60.0 * options.minutes
        for change in selected or draw_changes(options.seed):
            if time.monotonic() > end:
                break
            if find_reason(change, (copy.folder / change.file).read_text(encoding="utf-8")):
                continue
            outcome = "detected" if copy.is_detected(change) else "SURVIVED"
            counts[outcome] += 1
            lines.append(f"{outcome:10} {change}")
            print(lines[-1], flush=True)
    lines.append(f"{counts.total()} changes, {counts['SURVIVED']} survivors (seed {options.seed})")
    print(lines[-1])
    if options.out:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
