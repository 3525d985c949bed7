"""Measure the same scenes while the machine is in seven states, and judge what is said of it.

Each run is compared with a quiet one of its kind: no false regression, and no first sentence that
shows by times what the quiet ones do not. In each state two versions are measured in the same
rounds, too, of which one is worse on purpose: it draws a tenth of a drawing's triangles twice, or
shades a hundredth more quads. It takes some hours, alone on the machine. What is done is in the
folder: the same command goes on.

    PYTHONPATH=. python scripts/states_matrix.py --scenes city,own.geojson --out states
"""

import argparse
import contextlib
import csv
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

from harness.errors import REGRESSION
from harness.metrics.advice import advice
from harness.metrics.decision import decide_all
from harness.metrics.groups import time_ratio
from harness.results.run_folder import read_run
from tests.compare.heavy import EXTRA, WHICH
from tests.paths import ROOT

TRIANGULATORS = "ear-clipping,delaunay,sweep,mine:cut"
HEAVY = "tests.compare.heavy:HeavyOpenGL"
THIRD = "2"
"""Place of HEAD's drawing that is slower, in the order above."""

MINE = "from triangulators import triangulate\ndef cut(p): return triangulate(p, 'greedy')\n"
LOOP = "while True: pass"
COPY = "a = bytearray(1 << 28)\nwhile True: b = bytes(a)"
COMPILE = "import compileall\nwhile True: compileall.compile_dir('harness', quiet=2, force=True)"
STATES: dict[str, tuple[str, ...]] = {
    "quiet": (),
    "loop": (LOOP,),
    "loops": (LOOP,) * 4,
    "copying": (COPY,),
    "compiling": (COMPILE,),
    "midway": (f"import time\ntime.sleep(6)\n{LOOP}",) * 2,
    "half-core": (LOOP,),
}
"""What runs beside, in Python; half-core is held to the core of the loop by its affinity."""

WORSE = """from triangulators import triangulate
def cut(p):
    return triangulate(p, 'ear-clipping' if len(p.exterior.coords) % 6 == 0 else 'greedy')
"""
PLANTED: dict[str, tuple[str, dict[str, str]]] = {
    "times": (MINE, {EXTRA: "0.1", WHICH: THIRD}),
    "quads": (WORSE, {}),
}
"""What is worse in the present version: a triangulator of the user's, and what draws more."""

RUNS = 5
BASE = "ear-clipping"
KINDS: dict[str, tuple[str, ...]] = {"quick": ("--quick",), "default": ()}
FIELDS = ("scene", "kind", "state", "run", "told", "reference_ms", "compare", "shown", "wrong")
RATIOS = ("scene", "kind", "state", "run", "triangulator", "ratio", "low", "high")
SHOWN = re.compile(
    r"by (\S+): it is shown to save [\d.]+ % of .*?interval (-?[\d.]+) to (-?[\d.]+)"
)


def main() -> None:
    """Read the command line, run what is missing, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default="city")
    parser.add_argument("--states", default=",".join(STATES))
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--out", type=Path, default=Path("results/states"))
    chosen = parser.parse_args()
    rows, ratios = [], []
    for scene in chosen.scenes.split(","):
        for kind in chosen.kinds.split(","):
            quiet: list[Path] = []
            for state in ("quiet", *(s for s in chosen.states.split(",") if s != "quiet")):
                for number in range(chosen.runs):
                    key = [Path(scene).stem, kind, state, number]
                    folder = chosen.out / "-".join(map(str, key))
                    run_in(state, folder, ["--scene", scene, *KINDS[kind]])
                    if state == "quiet":
                        quiet.append(folder)
                    rows.append([*key, *judged(folder, quiet)])
                    ratios += [[*key, *row] for row in ratios_of(folder)]
    written(chosen.out / "states.csv", [FIELDS, *rows])
    written(chosen.out / "ratios.csv", [RATIOS, *ratios])
    planted = [
        [state, kind, regression(state, kind, chosen.out)]
        for state in chosen.states.split(",")
        for kind in PLANTED
    ]
    written(chosen.out / "planted.csv", [("state", "worse", "compare"), *planted])
    missed = [f"{kind} in {state}" for state, kind, code in planted if code != REGRESSION]
    false = sum(row[FIELDS.index("compare")] == REGRESSION for row in rows)
    wrong = sum(row[-1] for row in rows)
    print(f"{len(rows)} runs: {false} false regressions, {wrong} first sentences that are wrong")
    print(f"{len(planted)} planted regressions: missed {', '.join(missed) or 'none'}")


def written(file: Path, rows: Sequence[Sequence[object]]) -> None:
    """Write a table."""
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows(rows)


@contextlib.contextmanager
def beside(state: str) -> Iterator[None]:
    """Have the programs of a state run, and end them."""
    programs = [subprocess.Popen([sys.executable, "-c", text]) for text in STATES[state]]
    if state == "half-core":
        for program in programs:
            os.sched_setaffinity(program.pid, {0})
    try:
        time.sleep(1.0 if programs else 0.0)
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def run_in(state: str, folder: Path, options: Sequence[str], **settings: Any) -> None:
    """Make a run in a state, unless it is there; `settings` are `subprocess.run`'s."""
    done = folder.with_suffix(".done")
    if done.exists():
        return
    resume = ["--resume" if (folder / "run.json").exists() else "--out", str(folder)]
    command = [sys.executable, "-m", "harness", "run", "-q", *options, *resume]
    held = ["taskset", "-c", "0"] if state == "half-core" else []
    folder.parent.mkdir(parents=True, exist_ok=True)
    with beside(state):
        subprocess.run([*held, *command], check=True, stdout=subprocess.DEVNULL, **settings)
    done.touch()


def regression(state: str, kind: str, out: Path) -> int:
    """Return what `compare` ends with where the present version is worse than the one beside it."""
    content, variables = PLANTED[kind]
    out = out.resolve()
    project = out / "project"
    if not (project / ".git").exists():
        project.mkdir(parents=True, exist_ok=True)
        (project / "mine.py").write_text(MINE)
        who = ("-c", "user.name=who", "-c", "user.email=who@user.example")
        for command in (["init", "-q"], ["add", "mine.py"], ["commit", "-q", "-m", "first"]):
            subprocess.run(["git", "-C", str(project), *who, *command], check=True)
    (project / "mine.py").write_text(content)
    folder = out / f"planted-{kind}-{state}"
    options = ["--scene", "city", "--beside", "HEAD", "--draw-twice", "--rasterisers", HEAVY]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    options += ["--triangulators", TRIANGULATORS]
    run_in(state, folder, options, cwd=project, env=environment)
    return compared(folder / "base", folder)


def judged(folder: Path, quiet: list[Path]) -> list[object]:
    """Return a run's state, its reference draw, what `compare` says of it after a quiet one, what
    its first sentence shows, and whether no quiet run's does.
    """
    run = read_run(folder)
    told = (run.facts.get("state") or {}).get("state")
    base = next((path for path in quiet if path != folder), None)
    code: int | str = ""
    if base is not None:
        code = compared(base, folder)
    own, others = shown(folder), [each for each in map(shown, quiet) if each]
    wrong = own is not None and not any(
        own[0] == name and own[1] <= high and low <= own[2] for name, low, high in others
    )
    drawn = [s for r in run.records if r.time for s in r.time.reference_s]
    return [told, f"{1e3 * median(drawn):.3f}", code, " ".join(map(str, own or ())), wrong]


def ratios_of(folder: Path) -> Iterator[list[str]]:
    """Yield each triangulator's draw time in ratio to ear clipping's, with its interval."""
    records = {record.name: record for record in read_run(folder).records}
    for name, record in records.items():
        if name != BASE and (ratio := time_ratio(record, records[BASE])):
            yield [name, *(f"{end:.4f}" for end in (ratio.value, ratio.low, ratio.high))]


def compared(base: Path, head: Path) -> int:
    """Return what `compare` ends with."""
    command = [sys.executable, "-m", "harness", "compare", str(base), str(head)]
    return subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode


@cache
def shown(folder: Path) -> tuple[str, float, float] | None:
    """Return the triangulator that a run's first sentence shows to save, and the interval, in %."""
    for _, decision in decide_all(read_run(folder)):
        if found := SHOWN.search(advice(decision)):
            return found[1], float(found[2]), float(found[3])
    return None


if __name__ == "__main__":
    main()
