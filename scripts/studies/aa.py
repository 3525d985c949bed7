"""Compares equal code with itself as CI does, while other programs start and stop.

    python scripts/studies/aa.py --pairs 100 --slower 20 --out results/aa

A pair is one `run --beside HEAD --draw-twice`, so that every drawing is there twice, and its
`compare`. In every other pair a program that keeps a core busy starts or stops on the way. Of the
slower pairs, one of HEAD's drawings has 3 % of its triangles drawn twice, which no counter sees.
Each pair's exit code and time are appended to `pairs.csv`; a series that was stopped goes on.

Ends with 1 if equal code was called a regression or slower code was not.
"""

import argparse
import csv
import os
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
TRIANGULATORS = "ear-clipping,delaunay,sweep,mine:cut"
HEAVY = "tests.compare.heavy:HeavyOpenGL"
WHICH = "2"
"""Place of HEAD's drawing that is slower, in the order above."""

MINE = "from triangulators import triangulate\ndef cut(p): return triangulate(p, 'greedy')\n"
BUSY = "import os; p = os.getppid()\nwhile os.getppid() == p: sum(range(100_000))"
"""It ends with whoever started it, even where that was killed."""
COLUMNS = ("number", "share", "load", "exit_code", "seconds")


def main() -> int:
    """Run the series; returns the exit code."""
    options = _options()
    out = options.out.resolve()
    project = project_of_a_user(out / "project")
    file = out / "pairs.csv"
    done = {(row["number"], row["share"]) for row in _rows(file)}
    wanted = [(n, 0.0) for n in range(options.pairs)]
    wanted += [(n, options.share) for n in range(options.slower)]
    with file.open("a", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if stream.tell() == 0:
            writer.writeheader()
        for number, share in wanted:
            if (str(number), str(share)) not in done:
                writer.writerow(_pair(project, out / "reports", number, share, options.run))
                stream.flush()
    rows = _rows(file)
    equal = Counter(row["exit_code"] for row in rows if float(row["share"]) == 0)
    slower = Counter(row["exit_code"] for row in rows if float(row["share"]) > 0)
    print(f"equal code, exit codes: {dict(equal)}; slower code: {dict(slower)}")
    return int(equal["1"] > 0 or slower["1"] < slower.total())


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, default=100, help="of equal code")
    parser.add_argument("--slower", type=int, default=20, help="pairs with more work in HEAD")
    parser.add_argument("--share", type=float, default=0.03, help="how much more")
    parser.add_argument("--run", default="--scene city", help="options of raster-harness run")
    parser.add_argument("--out", type=Path, default=Path("results/aa"))
    return parser.parse_args()


def project_of_a_user(folder: Path) -> Path:
    """Make the repository of a user who has a triangulator."""
    if not (folder / ".git").exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "mine.py").write_text(MINE)
        who = ("-c", "user.name=aa", "-c", "user.email=aa@aa.example")
        for command in (["init", "-q"], ["add", "mine.py"], ["commit", "-q", "-m", "first"]):
            subprocess.run(["git", "-C", str(folder), *who, *command], check=True)
    return folder


def _pair(project: Path, reports: Path, number: int, share: float, run: str) -> dict[str, object]:
    """Measure and compare once; every other time with another program on the way."""
    loaded = number % 2 == 1
    script = [str(ROOT / "scripts/ci-compare.sh"), str(reports / "none"), str(reports), "--"]
    script += [*run.split(), "--draw-twice", "--triangulators", TRIANGULATORS]
    script += ["--rasterisers", HEAVY]
    environment = {**os.environ, "BESIDE": "HEAD", "PYTHON": sys.executable}
    environment |= {"HEAVY_EXTRA": str(share), "HEAVY_DRAWING": WHICH}
    environment.pop("GITHUB_STEP_SUMMARY", None)
    (reports / "compare.md").unlink(missing_ok=True)
    over = threading.Event()
    thread = threading.Thread(target=disturb, args=(over, random.Random(number)))
    began = time.monotonic()
    if loaded:
        thread.start()
    done = subprocess.run(
        script, cwd=project, env=environment, capture_output=True, text=True, check=False
    )
    over.set()
    if loaded:
        thread.join()
    report = reports / "compare.md"
    headline = report.read_text().splitlines()[0] if report.exists() else done.stderr.strip()
    print(f"{number:4} {share:5.0%} {'loaded' if loaded else ''} {done.returncode} {headline}")
    values = (number, share, loaded, done.returncode, round(time.monotonic() - began, 1))
    return dict(zip(COLUMNS, values, strict=True))


def disturb(over: threading.Event, rng: random.Random) -> None:
    """Keep a core busy now and then, until it is over."""
    while not over.wait(rng.uniform(0.0, 15.0)):
        program = subprocess.Popen([sys.executable, "-c", BUSY])
        over.wait(rng.uniform(3.0, 20.0))
        program.kill()
        program.wait()


def _rows(file: Path) -> list[dict[str, str]]:
    if not file.exists():
        return []
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


if __name__ == "__main__":
    sys.exit(main())
