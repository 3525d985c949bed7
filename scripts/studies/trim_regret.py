"""Keeps of a study's regret what docs/findings.md needs: main measures and named triangulators.

    python scripts/studies/trim_regret.py FOLDER

Random triangulations, other counters and the rasterisers that only count are most of its tables.
Of single polygons, what is simulated with is kept: helper lanes of what criteria choose.
"""

import sys
from pathlib import Path

import pandas as pd

MEASURES = ("quads", "helper_lanes", "partial_quads", "time_work_0")


def main() -> None:
    """Trim both tables of the folder named on the command line."""
    folder = Path(sys.argv[1])
    for name in ("measured.csv", "correlations_by_resolution.csv"):
        (folder / name).unlink(missing_ok=True)
    for name in ("regret.csv", "regret_by_polygon.csv"):
        table = pd.read_csv(folder / name)
        drawn_by = "opengl" if "opengl" in set(table["rasteriser"]) else "reference"
        kept = table["measure"].isin(MEASURES) & (table["rasteriser"] == drawn_by)
        kept &= ~table["name"].str.startswith("random")
        if name == "regret_by_polygon.csv":
            kept &= (table["kind"] == "criterion") & (table["measure"] == "helper_lanes")
        table[kept].to_csv(folder / name, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
