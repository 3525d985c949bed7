"""Change lines at random, run the tests that belong to them, and list the changes no test notices.

    .venv/bin/python scripts/mutate.py --minutes 60 --seed 1 --out FILE
    .venv/bin/python scripts/mutate.py --only harness/compare/html.py:50-64

Each change is one token of code within a function: a comparison, a sign, a number, `and`, `not`,
`min`. It is made in a copy of the checkout, whose own files stay as they are. The tests of a module
are those that `TESTS` names for its folder. They are run once unchanged, and it is noted which
functions each test and its fixtures call. A change is then tried with the tests that call the
function it lies in, quick ones first, and in compiled code, whose calls are not seen, with all of
the folder: as many of them as take a minute. Tests run in a process that is forked off one that has
loaded all libraries. A change that a test fails on, or that makes one compute far longer than
unchanged, is noticed. What `EQUIVALENT` names is not tried.
"""

from __future__ import annotations

import argparse
import ast
import csv
import importlib
import io
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tokenize
from collections import Counter, defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import pytest
from platformdirs import user_cache_path

ROOT = Path(__file__).resolve().parent.parent

TESTS = {
    "harness/figures": "tests/figures tests/harness/test_summary.py tests/report/test_estimates.py",
    "harness/compare": "tests/compare/test_times.py tests/compare/test_gate.py"
    " tests/compare/test_golden.py tests/compare/test_formats.py tests/compare/test_damage.py"
    " tests/compare/test_cli.py",
    "harness/measuring/timing.py": "tests/measuring/test_timing.py",
    "harness/scaling/merging.py": "tests/scaling/test_merging.py",
    "harness/page/result.py": "tests/page/test_result.py tests/page/test_devices.py",
    "harness/study/correlations.py": "tests/study/test_correlations.py tests/study/test_spread.py",
    "harness/study/regret.py": "tests/study/test_regret.py",
    "harness/profile/fitting.py": "tests/profile/test_fitting.py tests/profile/test_law.py",
    "triangulators/certificate": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_sight.py"
    " tests/triangulators/test_skeleton.py tests/triangulators/test_proof.py"
    " tests/triangulators/test_hunted.py",
    "triangulators/checking": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_sight.py"
    " tests/triangulators/test_hunted.py",
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

NOTICED, SURVIVED, SAME = "noticed", "SURVIVED", "equivalent"

with (ROOT / "scripts" / "equivalent_changes.csv").open(encoding="utf-8", newline="") as _rows:
    EQUIVALENT = {(r["file"], r["piece"], r["tokens"]): r["why"] for r in csv.DictReader(_rows)}
"""Changes of which no result can tell: where a file's name begins so, of these tokens in a piece of
its code, and why. They are not tried."""

LIBRARIES = (
    *("highspy", "hypothesis", "jinja2", "matplotlib.pyplot", "moderngl", "numba", "pandas"),
    *("pydantic", "pyogrio", "pyproj", "rich.console", "rich.progress", "scipy.sparse"),
    *("scipy.stats", "scipy.optimize", "shapely", "trimesh", "typer"),
)
"""What is loaded once, before anything of ours."""

MOST_S = 60.0
"""Seconds of computing that the tests of a change may take unchanged."""

Function = tuple[str, int]
"""A file and the first line of a function in it."""


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


def equivalent(
    change: Change, text: str, known: Mapping[tuple[str, str, str], str] = EQUIVALENT
) -> str | None:
    """Return why no result can tell a change of a file's text, where `known` says that none can."""
    for (file, piece, tokens), why in known.items():
        if change.file.startswith(file) and change.before in tokens.split():
            size = len(piece)
            if text.find(piece, max(0, change.end - size), change.start + size) >= 0:
                return why
    return None


def tests_of(file: str) -> str:
    """Return the tests that belong to a file."""
    return next(tests for place, tests in TESTS.items() if file.startswith(place))


def files() -> list[str]:
    """Return the files that are changed."""
    found = []
    for place in TESTS:
        path = ROOT / place
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [str(path.relative_to(ROOT)) for path in found if path.name != "__init__.py"]


def function_at(file: str, text: str, line: int) -> Function:
    """Return the innermost function that a line lies in, by its first line, its decorators' too."""
    starts = [
        min([node.lineno, *(each.lineno for each in node.decorator_list)])
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0)
    ]
    return file, max(starts)


class Recorder:
    """Notes which functions each test and its fixtures call, and the seconds it takes."""

    def __init__(self, folder: Path, wanted: list[str]) -> None:
        self._files = {str(folder / name): name for name in wanted}
        self._called: set[Function] = set()
        self._by_fixture: dict[Any, set[Function]] = defaultdict(set)
        self.tests: dict[str, tuple[float, set[Function]]] = {}

    def _trace(self, frame: FrameType, _event: str, _argument: Any) -> None:
        name = self._files.get(frame.f_code.co_filename)
        if name is not None:
            self._called.add((name, frame.f_code.co_firstlineno))

    @staticmethod
    def _watch(trace: Any) -> None:
        sys.settrace(trace)
        threading.settrace(trace)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        """Note what a fixture calls for all tests that ask for it."""
        outer, self._called = self._called, self._by_fixture[fixturedef]
        self._watch(self._trace)
        try:
            return (yield)
        finally:
            self._called = outer

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: Any) -> Generator[None, Any, Any]:
        """Note what a test calls."""
        self._called = set()
        self._watch(self._trace)
        start = time.process_time()
        try:
            return (yield)
        finally:
            took = time.process_time() - start
            self._watch(None)
            for definitions in item._fixtureinfo.name2fixturedefs.values():
                for definition in definitions:
                    self._called |= self._by_fixture[definition]
            self.tests[item.nodeid] = took, self._called


def _quick(seconds: dict[str, float]) -> list[str]:
    """Return the tests that take least, as many as take `MOST_S`, at least one."""
    found: list[str] = []
    left = MOST_S
    for name in sorted(seconds, key=seconds.__getitem__):
        left -= seconds[name]
        if left < 0.0 and found:
            break
        found.append(name)
    return found


class Limit:
    """Ends the process where a test computes far longer than it is known to."""

    def __init__(self, seconds: dict[str, float], more_s: float) -> None:
        self._seconds = seconds
        self._more_s = more_s

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, Any, Any]:
        """Give a test its time, and that of what it sets up and compiles."""
        known = self._seconds.get(item.nodeid, 0.0)
        signal.setitimer(signal.ITIMER_PROF, self._more_s + 3.0 * known)
        return (yield)


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
        self._tests: dict[str, dict[str, tuple[float, set[Function]]]] = {}

    def record(self, tests: str) -> None:
        """Run tests unchanged; end the program where one fails."""
        recorder = Recorder(self.folder, files())
        result = self.folder.with_name("recorded")

        def write() -> None:
            result.write_text(repr(recorder.tests))

        if not self._passes(tests.split(), 1800.0, [recorder], write):
            log = self.folder.with_name("log.txt").read_text(encoding="utf-8")
            sys.exit(f"{log}\nfails without any change: {tests}")
        self._tests[tests] = ast.literal_eval(result.read_text())

    def _passes(
        self,
        tests: list[str],
        limit_s: float,
        plugins: list[Any] | None = None,
        after: Callable[[], None] = lambda: None,
    ) -> bool:
        """Whether the tests pass in time, in a process that is forked off."""
        child = os.fork()
        if not child:
            self._run(tests, plugins, after)
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return status == 0
            time.sleep(0.02)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return False

    def _run(self, tests: list[str], plugins: list[Any] | None, after: Callable[[], None]) -> None:
        """Run the tests and end this process."""
        code = 1
        try:
            os.setsid()
            nowhere = os.open(
                self.folder.with_name("log.txt"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            )
            for number in (1, 2):
                os.dup2(nowhere, number)
            os.chdir(self.folder)
            sys.path.insert(0, str(self.folder))
            sys.dont_write_bytecode = True
            os.environ |= {"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
            options = ["-x", "-n0", "-p", "no:cacheprovider"]
            code = pytest.main([*options, *tests], plugins)
            after()
        finally:
            os._exit(code)

    def notices(self, change: Change) -> bool:
        """Whether a test fails where the change is made."""
        file = self.folder / change.file
        before = file.read_text(encoding="utf-8")
        known = self._tests[tests_of(change.file)]
        function = function_at(change.file, before, change.line)
        own = {name: took for name, (took, called) in known.items() if function in called}
        own = own or {name: took for name, (took, _) in known.items()}
        try:
            after = before[: change.start] + change.after + before[change.end :]
            file.write_text(after, encoding="utf-8")
            limit = Limit(own, 90.0 if "njit" in before else 30.0)
            return not self._passes(_quick(own), 300.0, [limit])
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


def chosen_changes(again: Path) -> Iterator[Change]:
    """Yield the changes that survived in an earlier output."""
    for line in again.read_text(encoding="utf-8").splitlines():
        if line.startswith(SURVIVED):
            place, number, rest = line.removeprefix(SURVIVED).strip().split(":", 2)
            text = (ROOT / place).read_text(encoding="utf-8")
            same = [each for each in changes(place, text) if each.line == int(number)]
            yield from (each for each in same if str(each).endswith(f":{rest}"))


def changes_in(only: str) -> list[Change]:
    """Return every change of a file, or of its lines FIRST-LAST: FILE or FILE:FIRST-LAST."""
    file, _, lines = only.partition(":")
    first, _, last = lines.partition("-")
    found = changes(file, (ROOT / file).read_text(encoding="utf-8"))
    return [each for each in found if not lines or int(first) <= each.line <= int(last or first)]


def main() -> None:
    """Make changes for some minutes and print what came of each."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--minutes", type=float, default=60.0)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--again", type=Path, help="try what survived in this output, once each")
    options.add_argument(
        "--only", nargs="+", metavar="FILE[:FIRST-LAST]", help="try every change there once"
    )
    options.add_argument("--out", type=Path)
    chosen = options.parse_args()
    wanted: Iterable[Change] = drawn(chosen.seed)
    tests = list(TESTS.values())
    if chosen.again or chosen.only:
        found = map(changes_in, chosen.only or ())
        wanted = list(chosen_changes(chosen.again) if chosen.again else chain(*found))
        tests = [tests_of(change.file) for change in wanted]
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        os.environ["NUMBA_CACHE_DIR"] = place  # what changed kernels are compiled to goes with it
        compiled = user_cache_path("raster-harness", appauthor=False) / "compiled"
        if compiled.is_dir():
            shutil.copytree(compiled, Path(place) / "compiled")
        for name in LIBRARIES:
            importlib.import_module(name)
        copy = Copy(Path(place) / "checkout")
        for each in dict.fromkeys(tests):
            copy.record(each)
        end = time.monotonic() + 60.0 * chosen.minutes
        for change in wanted:
            if time.monotonic() > end:
                break
            if why := equivalent(change, (copy.folder / change.file).read_text(encoding="utf-8")):
                lines.append(f"{SAME:10} {change}: {why}")
                print(lines[-1], flush=True)
                continue
            start = time.monotonic()
            outcome = NOTICED if copy.notices(change) else SURVIVED
            lines.append(f"{outcome:10} {change}")
            print(f"{lines[-1]} ({time.monotonic() - start:.0f} s)", flush=True)
    counts = Counter(line.split()[0] for line in lines)
    lines.append(
        f"{counts[NOTICED] + counts[SURVIVED]} changes, {counts[SURVIVED]} survivors "
        f"(seed {chosen.seed}); {counts[SAME]} more of which no result can tell"
    )
    print(lines[-1])
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
