"""Reduce the regret tables of a study to the rows that docs/findings.md needs.

    python scripts/studies/trim_regret.py FOLDER

Most rows are removed: random triangulations, counters that the document does not cite, and
rasterisers that only count. Of single polygons, retain only the helper lanes of the triangulations
that criteria choose, for `interval_coverage.py`.
"""

import sys
from pathlib import Path

import pandas as pd

MEASURES = ("quads", "helper_lanes", "partial_quads", "time_work_0")


def main() -> None:
    """Reduce both tables in the folder from the command line."""
    folder = Path(sys.argv[1])
    for name in ("measured.csv", "correlations_by_resolution.csv"):
        (folder / name).unlink(missing_ok=True)
    for name in ("regret.csv", "regret_by_polygon.csv"):
        table = pd.read_csv(folder / name)
        rasteriser = "opengl" if "opengl" in set(table["rasteriser"]) else "reference"
        retained = table["measure"].isin(MEASURES) & (table["rasteriser"] == rasteriser)
        retained &= ~table["name"].str.startswith("random")
        if name == "regret_by_polygon.csv":
            retained &= (table["kind"] == "criterion") & (table["measure"] == "helper_lanes")
        table[retained].to_csv(folder / name, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
