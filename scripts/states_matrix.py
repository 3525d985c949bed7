"""Measure the same scenes in seven states of the machine, and check reports of regressions.

Each run is compared with a quiet run with the same options: there should be no false regression,
and no recommendation by times that differs from the quiet runs. In each state two versions are also
measured in the same rounds; the second is worse on purpose: it draws 10 % of the triangles of a
drawing twice, or shades 1 % more quads. This takes some hours on an otherwise idle machine. The
same command resumes an interrupted study.

    PYTHONPATH=. python scripts/states_matrix.py --scenes city,own.geojson --out states
"""

import argparse
import contextlib
import csv
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

from harness.errors import REGRESSION
from harness.machine.git import run_git
from harness.metrics.decision import decide_run
from harness.metrics.groups import compute_time_ratio
from harness.results.run_folder import read_run
from tests.compare.heavy import EXTRA, WHICH
from tests.paths import ROOT

TRIANGULATORS = "ear-clipping,delaunay,sweep,mine:cut"
HEAVY = "tests.compare.heavy:HeavyOpenGL"
SLOWED_INDEX = "2"
"""Index in `TRIANGULATORS` of the drawing that is slower in the present version."""

PLUGIN = "from triangulators import triangulate\ndef cut(p): return triangulate(p, 'greedy')\n"
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
"""Python programs that run at the same time; half-core shares the core of a loop by affinity."""

WORSE_PLUGIN = """from triangulators import triangulate
def cut(p):
    return triangulate(p, 'ear-clipping' if len(p.exterior.coords) % 6 == 0 else 'greedy')
"""
PLANTED: dict[str, tuple[str, dict[str, str]]] = {
    "times": (PLUGIN, {EXTRA: "0.1", WHICH: SLOWED_INDEX}),
    "quads": (WORSE_PLUGIN, {}),
}
"""The worse present version: source of the plugin, and environment variables."""

RUNS = 5
BASE = "ear-clipping"
PRECISIONS: dict[str, tuple[str, ...]] = {"quick": ("--quick",), "default": ()}
STATE_COLUMNS = (
    *("scene", "precision", "state", "run"),
    *("machine_state", "reference_ms", "compare", "recommended", "wrong"),
)
RATIO_COLUMNS = ("scene", "precision", "state", "run", "triangulator", "ratio", "low", "high")


def main() -> None:
    """Measure missing runs and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default="city")
    parser.add_argument("--states", default=",".join(STATES))
    parser.add_argument("--precisions", default=",".join(PRECISIONS))
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--out", type=Path, default=Path("results/states"))
    options = parser.parse_args()
    rows, ratios = [], []
    for scene in options.scenes.split(","):
        for precision in options.precisions.split(","):
            quiet: list[Path] = []
            for state in ("quiet", *(s for s in options.states.split(",") if s != "quiet")):
                for number in range(options.runs):
                    key = [Path(scene).stem, precision, state, number]
                    folder = options.out / "-".join(map(str, key))
                    measure(state, folder, ["--scene", scene, *PRECISIONS[precision]])
                    if state == "quiet":
                        quiet.append(folder)
                    rows.append([*key, *make_row(folder, quiet)])
                    ratios += [[*key, *row] for row in list_time_ratios(folder)]
    write_csv(options.out / "states.csv", [STATE_COLUMNS, *rows])
    write_csv(options.out / "ratios.csv", [RATIO_COLUMNS, *ratios])
    planted = [
        [state, worsening, compare_planted(state, worsening, options.out)]
        for state in options.states.split(",")
        for worsening in PLANTED
    ]
    write_csv(options.out / "planted.csv", [("state", "worsening", "compare"), *planted])
    missed = [f"{worsening} in {state}" for state, worsening, code in planted if code != REGRESSION]
    false_regressions = sum(row[STATE_COLUMNS.index("compare")] == REGRESSION for row in rows)
    wrong = sum(row[-1] for row in rows)
    print(f"{len(rows)} runs: {false_regressions} false regressions, {wrong} wrong recommendations")
    print(f"{len(planted)} planted regressions: missed {', '.join(missed) or 'none'}")


def write_csv(file: Path, rows: Sequence[Sequence[object]]) -> None:
    """Write a table as CSV."""
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows(rows)


@contextlib.contextmanager
def run_programs(state: str) -> Iterator[None]:
    """Run the programs of a state within the context."""
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


def measure(state: str, folder: Path, options: Sequence[str], **settings: Any) -> None:
    """Measure a run in a state unless it is complete; `settings` are those of `subprocess.run`."""
    marker = folder.with_suffix(".done")
    if marker.exists():
        return
    resume = ["--resume" if (folder / "run.json").exists() else "--out", str(folder)]
    command = [sys.executable, "-m", "harness", "run", "-q", *options, *resume]
    prefix = ["taskset", "-c", "0"] if state == "half-core" else []
    folder.parent.mkdir(parents=True, exist_ok=True)
    with run_programs(state):
        subprocess.run([*prefix, *command], check=True, stdout=subprocess.DEVNULL, **settings)
    marker.touch()


def compare_planted(state: str, worsening: str, out: Path) -> int:
    """Return the exit code of `compare` for a worse present version measured with --beside."""
    content, variables = PLANTED[worsening]
    folder = out.resolve() / f"planted-{worsening}-{state}"
    measure_versions(state, folder, content, variables)
    return compare(folder / "base", folder)


def measure_versions(
    state: str, folder: Path, content: str, variables: Mapping[str, str], *options: str
) -> None:
    """Measure two versions of the plugin, of which the first is the base, in the same rounds.

    content : source of the present version
    variables : environment variables of the run, which `tests/compare/heavy.py` reads
    """
    project = folder.parent / "project"
    if not (project / ".git").exists():
        project.mkdir(parents=True, exist_ok=True)
        (project / "mine.py").write_text(PLUGIN)
        run_git(project, "init", "-q")
        for name, value in (("name", "who"), ("email", "who@user.example")):
            run_git(project, "config", f"user.{name}", value)
        run_git(project, "add", "mine.py")
        run_git(project, "commit", "-q", "-m", "first")
    (project / "mine.py").write_text(content)
    command = ["--scene", "city", "--beside", "HEAD", "--draw-twice", "--rasterisers", HEAVY]
    command += ["--triangulators", TRIANGULATORS, *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    measure(state, folder, command, cwd=project, env=environment)


def make_row(folder: Path, quiet: list[Path]) -> list[object]:
    """Return the columns of a run from `machine_state` on.

    `compare` is the exit code against a quiet run; `wrong` is whether no quiet run recommends the
    same triangulator with an overlapping interval.
    """
    run = read_run(folder)
    machine_state = (run.facts.get("state") or {}).get("state")
    baseline = next((path for path in quiet if path != folder), None)
    code: int | str = ""
    if baseline is not None:
        code = compare(baseline, folder)
    recommended = find_recommendation(folder)
    wrong = recommended is not None and not any(
        recommended[0] == name and recommended[1] <= high and low <= recommended[2]
        for name, low, high in filter(None, map(find_recommendation, quiet))
    )
    reference_s = [s for r in run.records if r.time for s in r.time.reference_s]
    cells = f"{1e3 * median(reference_s):.3f}", code, " ".join(map(str, recommended or ()))
    return [machine_state, *cells, wrong]


def list_time_ratios(folder: Path) -> Iterator[list[str]]:
    """Yield the draw time of each triangulator relative to ear clipping, with its interval."""
    records = {record.name: record for record in read_run(folder).records}
    for name, record in records.items():
        if name != BASE and (ratio := compute_time_ratio(record, records[BASE])):
            yield [name, *(f"{end:.4f}" for end in (ratio.value, ratio.low, ratio.high))]


def compare(base: Path, head: Path) -> int:
    """Return the exit code of `compare`."""
    command = [sys.executable, "-m", "harness", "compare", str(base), str(head)]
    return subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode


@cache
def find_recommendation(folder: Path) -> tuple[str, float, float] | None:
    """Return the triangulator that saves time significantly and its interval in %, or None."""
    for _, decision in decide_run(read_run(folder)):
        if decision and (ratio := decision.saving):
            low, high = (round(100 * (1 - end), 1) for end in (ratio.high, ratio.low))
            return decision.choice.name, low, high
    return None


if __name__ == "__main__":
    main()
