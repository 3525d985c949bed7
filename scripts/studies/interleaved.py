"""Compare equal code, and code that is 8 % slower, by `run --beside` on a busy machine.

All drawings are timed separately for each version of a plugin (`--draw-twice`). The slower version
draws 8 % of the triangles of one drawing twice, so all counters are equal. `--state` starts other
programs, as in `states_matrix.py`; `quiet` starts none, for a machine that is busy already. The
same command resumes an interrupted study.

    PYTHONPATH=. python scripts/studies/interleaved.py --out interleaved
"""

import argparse
from pathlib import Path

import pandas as pd

from harness.compare.comparison import compare_runs
from harness.errors import REGRESSION
from harness.results.run_folder import read_run
from scripts.states_matrix import (
    PLUGIN,
    SLOWED_INDEX,
    STATES,
    TRIANGULATORS,
    measure_versions,
)
from tests.compare.heavy import EXTRA, WHICH

SHARE = 0.08
SLOWED = TRIANGULATORS.split(",")[int(SLOWED_INDEX)]
RUNS = {SHARE: 10, 0.0: 40}
"""Number of runs of each share of triangles that is drawn twice."""


def main() -> None:
    """Measure the missing runs, write the table and print its counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/interleaved"))
    parser.add_argument("--state", default="loops", choices=STATES)
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    file = out / "interleaved.csv"
    rows = pd.read_csv(file).to_dict("records") if file.exists() else []
    for share, number in ((s, n) for s, count in RUNS.items() for n in range(count)):
        if any((row["share"], row["run"]) == (share, number) for row in rows):
            continue
        folder = out / f"{round(100 * share)}-{number}"
        variables = {EXTRA: str(share), WHICH: SLOWED_INDEX}
        measure_versions(options.state, folder, PLUGIN, variables, "--no-report")
        rows.append({"share": share, "run": number, **make_row(folder)})
        pd.DataFrame(rows).to_csv(file, index=False)
    for share, table in pd.DataFrame(rows).groupby("share"):
        correct = (table["slowed"] == "regressed") & (table["others_regressed"] == 0)
        print(
            f"{share:.0%} drawn twice: compare exits with 1 in "
            f"{(table['exit_code'] == REGRESSION).sum()} of {len(table)} runs, "
            f"in {correct.sum()} for this drawing alone"
        )


def make_row(folder: Path) -> dict[str, object]:
    """Return the state of a run, the exit code of `compare` and the outcomes of the times."""
    base, head = read_run(folder / "base"), read_run(folder)
    comparison = compare_runs(base, head)
    times = {case.id.name: case.time for case in comparison.list_compared() if case.time}
    waited = [record.time for record in head.records if record.time]
    slowed = times.pop(SLOWED)
    outcomes = [time.outcome for time in times.values()]
    return {
        "machine_state": (head.facts.get("state") or {}).get("state"),
        "waited": round(
            sum(sum(time.waited_s) / sum(time.wall_s) for time in waited) / len(waited), 3
        ),
        "rounds": min(len(time.samples_s) for time in waited),
        "exit_code": comparison.exit_code,
        "slowed": slowed.outcome,
        **{name: round(getattr(slowed, name), 4) for name in ("ratio", "low", "high")},
        "others_regressed": outcomes.count("regressed"),
        "others_inconclusive": outcomes.count("inconclusive"),
    }


if __name__ == "__main__":
    main()
