"""Machines on which drawings are timed together, made up so that the truth is known.

Each machine says what it does to the rounds of a run: what all drawings of a round are lengthened
by, (rounds,), and the seconds that each drawing's sample waited for a core, (drawings, rounds).
`timed` makes a run's records of it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from harness.results.parsing import parse_record
from harness.results.record import Record

Values = NDArray[np.float64]
Machine = Callable[[np.random.Generator, int], tuple[Values, Values]]

EPOCHS, ROUNDS = 6, 72
DRAW_S = 2e-3


def quiet(_: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Nothing else runs."""
    return np.ones(ROUNDS), np.zeros((drawings, ROUNDS))


def sliced(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Other programs take the core between a scheduler's slices: a third of all samples waits."""
    waited = np.where(rng.random((drawings, ROUNDS)) < 1 / 3, 4e-3 * rng.integers(1, 4), 0.0)
    return np.ones(ROUNDS), waited


def two_speeds(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """A neighbour on the core comes and goes, for some rounds at a time."""
    slower = np.repeat(rng.random(ROUNDS // 4) < 0.5, 4)
    return np.where(slower, 1.4, 1.0), np.zeros((drawings, ROUNDS))


def switched(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Loops are switched on midway: slices, and a slower core."""
    late = np.arange(ROUNDS) >= rng.integers(ROUNDS // 4, 3 * ROUNDS // 4)
    waited = np.where(late & (rng.random((drawings, ROUNDS)) < 0.4), 8e-3, 0.0)
    return np.where(late, 1.2, 1.0), waited


def heavy(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Some rounds take many times as long, for all drawings."""
    longer = (rng.random(ROUNDS) < 0.05) * rng.pareto(1.2, ROUNDS)
    return 1 + longer, np.zeros((drawings, ROUNDS))


MACHINES: dict[str, Machine] = {
    "quiet": quiet,
    "slices": sliced,
    "two speeds": two_speeds,
    "loops from midway": switched,
    "heavy tails": heavy,
}


def timed(
    rng: np.random.Generator, machine: Machine, factors: Sequence[float], tail: bool = False
) -> list[Record]:
    """Return records of drawings that take `factors` times the first one's time, timed together.

    Where its buffers lie moves a drawing by 0.2 % an epoch, its process by 0.3 % against another,
    a sample scatters by 1 %; one that waited finds its caches cold, and takes up to a tenth longer.

    tail : some samples of one drawing alone take many times as long, too
    """
    shared, waited = machine(rng, len(factors))
    records = []
    place = np.exp(0.002 * rng.standard_normal((len(factors), EPOCHS)))
    process = np.exp(0.003 / np.sqrt(2) * rng.standard_normal(len(factors)))
    for number, factor in enumerate(factors):
        own = np.repeat(place[number], ROUNDS // EPOCHS) * process[number]
        noise = np.exp(0.01 * rng.standard_normal(ROUNDS))
        if tail:
            noise *= 1 + (rng.random(ROUNDS) < 0.05) * rng.pareto(1.5, ROUNDS)
        cold = np.where(waited[number] > 0, 1 + 0.1 * rng.random(ROUNDS), 1.0)
        samples = DRAW_S * factor * shared * own * noise * cold
        times = {
            "timer": "cpu",
            "samples_s": samples.tolist(),
            "waited_s": waited[number].tolist(),
            "epochs": [ROUNDS // EPOCHS] * EPOCHS,
            "reference_s": shared.tolist(),
            "median_s": float(np.median(samples)),
            "ci95_s": [float(samples.min()), float(samples.max())],
        }
        record = parse_record(
            {
                "key": f"{number:016x}",
                "scene": "s",
                "rasteriser": "opengl",
                "device": "llvmpipe",
                "resolution": 64,
                "rotation": 0.0,
                "triangulator": "ear-clipping" if number == 0 else f"rival {number}",
                "status": "ok",
                "polygons": 1,
                "counters": {"quads": 100 + number},
                "time": times,
            }
        )
        records.append(record)
    return records
