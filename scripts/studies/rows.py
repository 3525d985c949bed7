"""Does a law lack what a device takes for each row of pixels? Of profiles, whatever drew them.

    PYTHONPATH=. python scripts/studies/rows.py results/reference/profiles/*.json [--out FILE]

Triangles of one area and aspect have equal widths and heights when turned by 90 degrees, exchanged:
terms of a law hardly tell them apart, but a device that goes through a triangle row by row does.
Writes a row for each profile:

steep_8, steep_64 : time of the thinnest triangles of 8 and 64 px^2 that stand upright, in ratio to
    those that lie, the empty draw left out
r2_over, r2_within : of log time of draws held out, as the profile's law has them
with_rows_over, with_rows_within : the same, if the law had one more term: rows of pixels whose
    centres are between a triangle's lowest and highest corner
row_s : seconds of a row then
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL
from harness.profile import design, law
from harness.profile.counted import design_of
from harness.profile.design import AREAS, ASPECTS, Draw
from harness.profile.placing import LEVEL, STEEP
from harness.profile.profile import fitted_of
from harness.study import cost_model

COLUMNS = (
    *("profile", "steep_8", "steep_64", "r2_over", "r2_within"),
    *("with_rows_over", "with_rows_within", "row_s"),
)


def rows_of(draw: Draw) -> int:
    """Return how many rows of pixels a draw's triangles go through, all together."""
    heights = draw.frame.points[draw.triangles][:, :, 1].astype(np.int64)
    half = SUBPIXEL // 2
    first = -((half - heights.min(axis=1)) // SUBPIXEL)
    last = (heights.max(axis=1) - half) // SUBPIXEL
    return int(np.maximum(last - first + 1, 0).sum())


def judged(profile: dict[str, Any]) -> dict[str, float]:
    """Return the figures of `COLUMNS` of a profile."""
    step = profile["device"]["details"].get("step") or 1
    made = [design.snapped(draw, step) for draw in design.draws(profile["seed"])]
    timed = {(each["kind"], each["name"]): each for each in profile["times"]}
    draws = [draw for draw in made if (draw.kind, draw.name) in timed]
    told = [timed[draw.kind, draw.name] for draw in draws]
    seconds = np.exp(np.log([each["epochs_s"] for each in told]).mean(axis=1))
    rows = design_of([each["counters"] for each in told])
    fitted, _ = fitted_of(draws)
    labels = np.unique([draws[n].group for n in fitted], return_inverse=True)[1]
    more = np.column_stack([rows, [rows_of(draw) for draw in draws]])[fitted]
    own, with_rows = (_r2(each, seconds[fitted], labels) for each in (rows[fitted], more))
    found = dict(zip(COLUMNS[3:7], (*own, *with_rows), strict=True))
    found["row_s"] = float(cost_model.solve(more, seconds[fitted], labels)[-1])
    for area in AREAS:
        found[f"steep_{area}"] = _steep(draws, seconds - profile["empty_s"], area)
    return found


def _r2(
    rows: NDArray[np.float64], seconds: NDArray[np.float64], labels: NDArray[np.int64]
) -> tuple[float, float]:
    predicted = law.held_out(rows, seconds, labels, 0)
    return (
        cost_model.r_squared(np.log(seconds), np.log(predicted)),
        cost_model.r_squared_within(seconds, predicted, labels.tolist()),
    )


def _steep(draws: list[Draw], seconds: NDArray[np.float64], area: int) -> float:
    """Return the time of upright triangles in ratio to that of lying ones."""
    names = [f"{area} px^2, {ASPECTS[-1]}:1, turned {turn.x}/{turn.y}" for turn in (STEEP, LEVEL)]
    upright, lying = (
        next(s for draw, s in zip(draws, seconds, strict=True) if draw.name == name)
        for name in names
    )
    return float(upright / lying)


def main() -> None:
    """Judge each profile."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("profiles", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("results/reference/profile-rows.csv"))
    given = parser.parse_args()
    with given.out.open("w", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        table.writeheader()
        for file in sorted(given.profiles):
            figures = judged(json.loads(file.read_text()))
            row = {"profile": file.stem} | {name: f"{v:.4g}" for name, v in figures.items()}
            table.writerow(row)
            print(row, flush=True)


if __name__ == "__main__":
    main()
