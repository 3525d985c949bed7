"""Does a law lack a term? Of profiles, whatever drew them.

    PYTHONPATH=. python scripts/studies/missing_terms.py PROFILE.json... [--out FILE]

Triangles of one area and aspect have equal widths and heights when turned by 90 degrees, exchanged.
Only the rows of pixels that they pass tell them apart, so a device that goes through a triangle row
by row needs that term. Another device keeps few tiles of the viewport at hand, and fetches others;
how many it fetches depends on the order of the triangles, which no term of a law knows.

Writes a row for each profile:

steep_8, steep_64 : time of the thinnest triangles of 8 and 64 px^2 that stand upright, in ratio to
    those that lie, the empty draw left out
r2_over, r2_within : of log time of draws held out, over all and within groups
no_rows_over, no_rows_within : the same of a law without rows of pixels and covering triangles
tiles_over, tiles_within : the same of a law that knows the tiles that softpipe fetches, too
"""

import argparse
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL
from harness.profile import design, law
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.design import AREAS, ASPECTS, Draw
from harness.profile.law import r_squared, r_squared_within
from harness.profile.placing import LEVEL, STEEP
from harness.profile.profile import fitted_of

COLUMNS = (
    *("profile", "steep_8", "steep_64", "r2_over", "r2_within"),
    *("no_rows_over", "no_rows_within", "tiles_over", "tiles_within"),
)

TILE, KEPT, STEP = 64, 50, 5
"""Side in px of softpipe's tiles, how many it keeps, and by how many places in that cache two tiles
above each other differ; two beside each other by one (Mesa's `sp_tile_cache.c`)."""


def fetched(draw: Draw) -> int:
    """Return how many tiles softpipe fetches for a draw: those that another has taken the place of.

    Triangles touch the tiles of their bounding boxes, row by row.
    """
    corners = draw.frame.points[draw.triangles].astype(np.int64)
    first = corners.min(axis=1) // (TILE * SUBPIXEL)
    last = (corners.max(axis=1) - 1) // (TILE * SUBPIXEL)
    kept: dict[int, tuple[int, int]] = {}
    found = 0
    for (left, bottom), (right, top) in zip(first.tolist(), last.tolist(), strict=True):
        for y in range(bottom, top + 1):
            for x in range(left, right + 1):
                place = (x + STEP * y) % KEPT
                found += kept.get(place) != (x, y)
                kept[place] = x, y
    return found


def drawn(profile: dict[str, Any]) -> tuple[list[Draw], list[dict[str, Any]]]:
    """Return the draws that a profile has times of, made again, and what it holds of each."""
    step = profile["device"]["details"].get("step") or 1
    made = [design.snapped(draw, step) for draw in design.draws(profile["seed"])]
    timed = {(each["kind"], each["name"]): each for each in profile["times"]}
    draws = [draw for draw in made if (draw.kind, draw.name) in timed]
    return draws, [timed[draw.kind, draw.name] for draw in draws]


def judged(profile: dict[str, Any]) -> dict[str, float]:
    """Return the figures of `COLUMNS` of a profile."""
    draws, told = drawn(profile)
    seconds = np.exp(np.log([each["epochs"] for each in told]).mean(axis=1))
    fitted, _ = fitted_of(draws)
    labels = np.unique([draws[n].group for n in fitted], return_inverse=True)[1]
    rows = design_of([counters(draw) for draw in draws])[fitted]
    fewer = rows[:, [name not in ("rows", "covering") for name in TERMS]]
    more = np.column_stack([rows, [fetched(draws[n]) for n in fitted]])
    found = [_r2(each, seconds[fitted], labels) for each in (rows, fewer, more)]
    figures = dict(zip(COLUMNS[3:], np.ravel(found).tolist(), strict=True))
    for area in AREAS:
        figures[f"steep_{area}"] = _steep(draws, seconds - profile["empty"], area)
    return figures


def _r2(
    rows: NDArray[np.float64], seconds: NDArray[np.float64], labels: NDArray[np.int64]
) -> tuple[float, float]:
    predicted = law.held_out(rows, seconds, labels, 0)
    return (
        r_squared(np.log(seconds), np.log(predicted)),
        r_squared_within(seconds, predicted, labels.tolist()),
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
    parser.add_argument("--out", type=Path, default=Path("results/reference/profile-terms.csv"))
    given = parser.parse_args()
    with given.out.open("w", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        table.writeheader()
        for file in sorted(given.profiles):
            figures = judged(json.loads(file.read_text()))
            row = {name: f"{figures[name]:.4g}" for name in COLUMNS[1:]} | {"profile": file.stem}
            table.writerow(row)
            print(row, flush=True)


if __name__ == "__main__":
    main()
