"""Simulated machines on which drawings with known true times are timed together.

A machine is a function that returns its effect on the rounds of a run: the factors by which all
drawings of a round are slowed down, (rounds,), and the seconds that the sample of each drawing
waited for a core, (drawings, rounds). `simulate_run` returns the records of such a run.
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
    """Simulate a machine without other programs."""
    return np.ones(ROUNDS), np.zeros((drawings, ROUNDS))


def time_slices(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Simulate other programs that share the core in time slices: a third of all samples waits."""
    waited = np.where(rng.random((drawings, ROUNDS)) < 1 / 3, 4e-3 * rng.integers(1, 4), 0.0)
    return np.ones(ROUNDS), waited


def two_speeds(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Simulate a neighbour on the core that is active for some rounds at a time."""
    slower = np.repeat(rng.random(ROUNDS // 4) < 0.5, 4)
    return np.where(slower, 1.4, 1.0), np.zeros((drawings, ROUNDS))


def late_load(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Simulate endless loops that start midway: waits, and a slower core."""
    loaded = np.arange(ROUNDS) >= rng.integers(ROUNDS // 4, 3 * ROUNDS // 4)
    waited = np.where(loaded & (rng.random((drawings, ROUNDS)) < 0.4), 8e-3, 0.0)
    return np.where(loaded, 1.2, 1.0), waited


def heavy_tails(rng: np.random.Generator, drawings: int) -> tuple[Values, Values]:
    """Simulate rounds that take many times as long for all drawings."""
    longer = (rng.random(ROUNDS) < 0.05) * rng.pareto(1.2, ROUNDS)
    return 1 + longer, np.zeros((drawings, ROUNDS))


MACHINES: dict[str, Machine] = {
    "quiet": quiet,
    "slices": time_slices,
    "two speeds": two_speeds,
    "loops from midway": late_load,
    "heavy tails": heavy_tails,
}


def simulate_run(
    rng: np.random.Generator, machine: Machine, factors: Sequence[float], tail: bool = False
) -> list[Record]:
    """Return records of drawings timed together, whose true times are `factors` times `DRAW_S`.

    Standard deviations are 0.2 % between epochs (position of the buffers in memory), 0.3 % between
    processes and 1 % between samples. A sample that waited has cold caches and takes up to 10 %
    longer.

    tail : also let some samples of single drawings take many times as long
    """
    shared, waited = machine(rng, len(factors))
    records = []
    epoch_factors = np.exp(0.002 * rng.standard_normal((len(factors), EPOCHS)))
    process_factors = np.exp(0.003 / np.sqrt(2) * rng.standard_normal(len(factors)))
    for number, factor in enumerate(factors):
        own_factors = np.repeat(epoch_factors[number], ROUNDS // EPOCHS) * process_factors[number]
        noise = np.exp(0.01 * rng.standard_normal(ROUNDS))
        if tail:
            noise *= 1 + (rng.random(ROUNDS) < 0.05) * rng.pareto(1.5, ROUNDS)
        cold = np.where(waited[number] > 0, 1 + 0.1 * rng.random(ROUNDS), 1.0)
        samples = DRAW_S * factor * shared * own_factors * noise * cold
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
