"""Keeps of a study's regret what docs/findings.md needs: main measures and named triangulators.

    python scripts/trim_regret.py FOLDER

Random triangulations and counters that nobody looks at are most of regret_by_polygon.csv.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

MEASURES = ("quads", "helper_lanes", "time_work_0")


def main() -> None:
    """Trim both tables of the folder named on the command line."""
    folder = Path(sys.argv[1])
    for name in ("regret.csv", "regret_by_polygon.csv"):
        table = pd.read_csv(folder / name)
        kept = table["measure"].isin(MEASURES) & ~table["name"].str.startswith("random")
        table[kept].to_csv(folder / name, index=False)


if __name__ == "__main__":
    main()
