"""Change lines at random, run the tests that belong to them, and list the changes no test notices.

    .venv/bin/python scripts/mutate.py --minutes 60 --seed 1 --out FILE
    .venv/bin/python scripts/mutate.py --only harness/compare/wording.py:50-64

Each change is one token of code within a function: a comparison, a sign, a number, `and`, `not`,
`min`. It is made in a copy of the checkout. The tests of a module are the files that `TESTS` names
for its folder. They run once unchanged, and it is noted which functions each file calls. A change
is tried with the files that call its function, quick ones first; calls in compiled code are not
seen, so there with all. A change that makes tests compute far longer is noticed, too. What
`equivalent_changes.csv` names is not tried. (mutmut passes over decorated functions, so over all
compiled ones: mutmut/mutation/file_mutation.py of 3.8.)
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
import subprocess
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

ROOT = Path(__file__).resolve().parent.parent

TESTS = {
    "harness/results": "tests/results",
    "harness/stats": "tests/metrics",
    "harness/metrics": "tests/metrics tests/harness/test_summary.py tests/report/test_plots.py",
    "harness/compare": "tests/compare/test_times.py tests/compare/test_gate.py"
    " tests/compare/test_golden.py tests/compare/test_formats.py tests/compare/test_damage.py"
    " tests/compare/test_cli.py tests/compare/test_polygons.py",
    "harness/measuring/timing.py": "tests/measuring/test_timing.py",
    "harness/scaling/merging.py": "tests/scaling/test_merging.py",
    "harness/page/result.py": "tests/page/test_result.py tests/page/test_devices.py",
    "harness/study/correlations.py": "tests/study/test_correlations.py",
    "harness/study/regret.py": "tests/study/test_regret.py",
    "harness/profile/law.py": "tests/profile/test_fitting.py",
    "triangulators/certificate": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_skeleton.py"
    " tests/triangulators/test_proof.py tests/triangulators/test_holes.py",
    "triangulators/checking": "tests/triangulators/test_certify.py"
    " tests/triangulators/test_claims.py tests/triangulators/test_skeleton.py"
    " tests/triangulators/test_holes.py",
}

_OTHERS = "< <=|<= <|> >=|>= >|== !=|!= ==|+ -|- +|* /|/ *|// *|+= -=|and or|or and|not |True False"
_OTHERS += "|False True|min max|max min|any all|all any|break continue"
OTHER = dict(pair.split(" ") for pair in _OTHERS.split("|"))

with (ROOT / "scripts" / "equivalent_changes.csv").open(encoding="utf-8", newline="") as _rows:
    EQUIVALENT = {(r["file"], r["piece"], r["tokens"]): r["why"] for r in csv.DictReader(_rows)}
"""Changes of which no result can tell: where a file's name begins so, of these tokens in a piece of
its code, and why."""

LIBRARIES = "highspy hypothesis jinja2 matplotlib.pyplot moderngl numba pandas pydantic pyogrio"
LIBRARIES += " pyproj rich.console rich.progress scipy.sparse scipy.stats shapely trimesh typer"
"""Loaded once, before anything of ours."""

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
    found = chain.from_iterable(
        sorted((ROOT / place).rglob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
        for place in TESTS
    )
    return [str(path.relative_to(ROOT)) for path in found if path.name != "__init__.py"]


class Recorder:
    """A plugin that notes which functions each file of tests calls, and the seconds it takes."""

    def __init__(self, folder: Path) -> None:
        self._names = {str(folder / name): name for name in files()}
        self.called: dict[str, set[Function]] = defaultdict(set)
        self.seconds: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, Any, Any]:
        """Note what a test, and what is set up for it, calls."""
        file, start = item.nodeid.partition("::")[0], time.process_time()

        def trace(frame: FrameType, _event: str, _argument: Any) -> None:
            if name := self._names.get(frame.f_code.co_filename):
                self.called[file].add((name, frame.f_code.co_firstlineno))

        sys.settrace(trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            self.seconds[file] += time.process_time() - start


class Copy:
    """A copy of the checkout in which changes are made, one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        (folder / ".venv").symlink_to(ROOT / ".venv")
        self._known: dict[str, tuple[dict[str, set[Function]], dict[str, float]]] = {}

    def record(self, tests: str) -> None:
        """Run tests unchanged; end the program where one fails."""
        if not self._passes(tests.split(), 1800.0, Recorder(self.folder)):
            sys.exit(f"{self._log().read_text()}\nfails without any change: {tests}")
        self._known[tests] = ast.literal_eval(self._log("recorded").read_text())

    def _log(self, name: str = "log.txt") -> Path:
        return self.folder.with_name(name)

    def _passes(self, tests: list[str], limit_s: float, recorder: Recorder | None = None) -> bool:
        """Whether the tests pass in time, in a process that is forked off."""
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
                    found = (dict(recorder.called), dict(recorder.seconds))
                    self._log("recorded").write_text(repr(found))
            finally:
                os._exit(code)
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return status == 0
            time.sleep(0.02)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return False

    def notices(self, change: Change) -> bool:
        """Whether a test fails, or takes far longer, where the change is made."""
        file = self.folder / change.file
        before = file.read_text(encoding="utf-8")
        called, seconds = self._known[tests_of(change.file)]
        starts = [
            min([node.lineno, *(each.lineno for each in node.decorator_list)])
            for node in ast.walk(ast.parse(before))
            if isinstance(node, ast.FunctionDef) and node.lineno <= change.line <= node.end_lineno
        ]
        own = [name for name in seconds if (change.file, max(starts)) in called.get(name, set())]
        own = sorted(own or seconds, key=seconds.__getitem__)
        try:
            after = before[: change.start] + change.after + before[change.end :]
            file.write_text(after, encoding="utf-8")
            limit_s = 90.0 if "njit" in before else 30.0
            return not self._passes(own, limit_s + 3.0 * sum(seconds[name] for name in own))
        finally:
            file.write_text(before, encoding="utf-8")


def drawn(seed: int) -> Iterator[Change]:
    """Yield changes at random, a file as often as another of its folder, without end."""
    generator = random.Random(seed)
    known = {name: changes_in(name) for name in files()}
    places = [[name for name in known if name.startswith(place)] for place in TESTS]
    tried: set[Change | None] = {None}
    while True:
        change = generator.choice(known[generator.choice(generator.choice(places))] or [None])
        if change not in tried:
            tried.add(change)
            yield change


def changes_in(only: str) -> list[Any]:
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
    options.add_argument("--only", nargs="+", default=(), metavar="FILE[:FIRST-LAST]")
    options.add_argument("--out", type=Path)
    chosen = options.parse_args()
    wanted = [change for each in chosen.only for change in changes_in(each)]
    counts: Counter[str] = Counter()
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        os.environ["NUMBA_CACHE_DIR"] = place  # what changed kernels are compiled to goes with it
        for name in LIBRARIES.split():
            importlib.import_module(name)
        copy = Copy(Path(place) / "checkout")
        for tests in {tests_of(each.file) for each in wanted} or TESTS.values():
            copy.record(tests)
        end = time.monotonic() + 60.0 * chosen.minutes
        for change in wanted or drawn(chosen.seed):
            if time.monotonic() > end:
                break
            if equivalent(change, (copy.folder / change.file).read_text(encoding="utf-8")):
                continue
            outcome = "noticed" if copy.notices(change) else "SURVIVED"
            counts[outcome] += 1
            lines.append(f"{outcome:10} {change}")
            print(lines[-1], flush=True)
    lines.append(f"{counts.total()} changes, {counts['SURVIVED']} survivors (seed {chosen.seed})")
    print(lines[-1])
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
