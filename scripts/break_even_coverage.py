"""How often the 95 % interval of the break-even holds the truth, by simulation.

Both uncertainties are simulated: rounds of triangulating, 5 or 12, scatter by 2 or 10 %; draws of 8
epochs of 12 rounds scatter by 2 % within and 0.5 % between epochs.

    python scripts/break_even_coverage.py > results/reference/break-even-coverage.csv
"""

from __future__ import annotations

import sys

import numpy as np

from harness.figures.intervals import median_interval
from harness.figures.verdict import AFTER, break_even
from harness.stored.folder import Record

DRAW_S, LONGER_S, ONCE_S = 1e-3, 0.1, 0.02
EPOCHS = [12] * 8
RUNS = 1000


def _record(
    rng: np.random.Generator, draw_s: float, seconds: float, scatter: float, rounds: int
) -> Record:
    places = np.repeat(rng.normal(0, 0.005, len(EPOCHS)), EPOCHS)
    samples = draw_s * np.exp(places + rng.normal(0, 0.02, sum(EPOCHS)))
    told = (seconds * np.exp(rng.normal(0, scatter, rounds))).tolist()
    times = {"samples_s": samples.tolist(), "reference_s": [1.0], "epochs": EPOCHS}
    times |= {"median_s": float(np.median(samples)), "ci95_s": median_interval(samples.tolist())}
    return {"polygons": 1, "time": times, "triangulate_s": told[0], "triangulate_samples_s": told}


def main() -> None:
    """Print a row for each saving, scatter and number of rounds."""
    rng = np.random.default_rng(0)
    sys.stdout.write("ratio,scatter,rounds,runs,shown,covered\n")
    for ratio in (0.8, 0.9, 0.97):
        for scatter in (0.02, 0.1):
            for rounds in (5, 12):
                truth = (LONGER_S - ONCE_S) / (DRAW_S * (1 - ratio)) * np.exp(scatter**2 / 2)
                shown = covered = 0
                for _ in range(RUNS):
                    base = _record(rng, DRAW_S, ONCE_S, scatter, rounds)
                    even = break_even(_record(rng, ratio * DRAW_S, LONGER_S, scatter, rounds), base)
                    if even is not None and even.kind == AFTER and even.high is not None:
                        shown += 1
                        covered += (even.low or 0.0) <= truth <= even.high
                row = f"{ratio},{scatter},{rounds},{RUNS},{shown},{covered / shown:.3f}"
                sys.stdout.write(f"{row}\n")


if __name__ == "__main__":
    main()
