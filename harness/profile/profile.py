"""A profile: what was measured and what follows from it, as one JSON file.

The file is a calibration, too: `coefficients` are seconds of each of `cost_model.TERMS`, which
`optimal:calibrated` minimises. All figures follow from the times of each epoch that it holds, so
whoever reads it can compute them anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness import __version__
from harness.profile import law as laws
from harness.profile.aspects import aspects
from harness.profile.counted import TERMS, design_of
from harness.profile.design import DESIGN, Draw
from harness.profile.law import Law
from harness.profile.measured import Measured
from harness.study import cost_model
from harness.study.calibration_draws import LEAST_R2
from harness.study.calibration_draws import design_of as predicted_of

FORMAT, VERSION = "raster-harness profile", 1

NOT_FITTED = ("twice",)
"""Kinds that the law is not fitted to: a device may leave out what is covered by what follows."""


def profile(
    draws: Sequence[Draw],
    counted: Sequence[Mapping[str, int]],
    measured: Measured,
    device: Mapping[str, Any],
    seed: int,
    version: int = DESIGN,
) -> dict[str, Any]:
    """Return a profile's content, JSON-ready.

    counted : the draws' `counters`; device : what is known of it; version : of the design
    """
    design = design_of(counted)
    fitted, plain = fitted_of(draws)
    groups = [draw.group for draw in draws]
    of_fitted = [groups[n] for n in fitted]
    law = laws.fit(design[fitted], measured.epochs[:, fitted], of_fitted, seed)
    predicted = predicted_of([(draws[n].frame, draws[n].triangles) for n in plain])
    labels = np.unique([groups[n] for n in plain], return_inverse=True)[1].tolist()
    calibration = cost_model.fit(predicted, measured.seconds[plain], labels, seed)
    good = law.r2_over >= LEAST_R2 and law.r2_within >= LEAST_R2
    return {
        "format": FORMAT,
        "version": VERSION,
        "schema_version": 1,
        "harness": __version__,
        "design": version,
        "seed": seed,
        "device": dict(device),
        "terms": _terms(law),
        "fewest": list(laws.fewest(design[fitted], measured.seconds[fitted], of_fitted, seed)),
        "r2_over": law.r2_over,
        "r2_within": law.r2_within,
        "refused": not good,
        "aspects": aspects(draws, design, measured, law),
        "second_filling": _second_filling(draws, measured),
        **calibration.to_json(),
        "control": [measured.control.value, measured.control.low, measured.control.high],
        "drift": measured.drift,
        "rounds": measured.rounds,
        "empty_s": measured.empty_s,
        "times": [_time(draws[n], counted[n], measured.epochs[:, n]) for n in range(len(draws))],
    }


def fitted_of(draws: Sequence[Draw]) -> tuple[list[int], list[int]]:
    """Return the places of the draws that a law is fitted to, and a criterion's costs.

    A criterion knows nothing of the arithmetic of a fragment.
    """
    fitted = [n for n, draw in enumerate(draws) if draw.kind not in NOT_FITTED]
    return fitted, [n for n in fitted if draws[n].work == 0]


def _terms(law: Law) -> list[dict[str, Any]]:
    found = []
    for place, (name, term) in enumerate(TERMS.items()):
        low, high = law.intervals[place].tolist()
        found.append(
            {
                "name": name,
                "unit": term.unit,
                "seconds": float(law.seconds[place]),
                "low": low,
                "high": high,
                "shown": bool(law.shown[place]),
            }
        )
    return found


def _time(draw: Draw, counted: Mapping[str, int], epochs: Any) -> dict[str, Any]:
    return {
        "kind": draw.kind,
        "name": draw.name,
        "group": draw.group,
        "rounds_of_work": draw.work,
        "checksum": draw.checksum,
        "counters": dict(counted),
        "epochs_s": [float(f"{seconds:.5g}") for seconds in epochs],
    }


def _second_filling(draws: Sequence[Draw], measured: Measured) -> dict[str, float]:
    """Return what filling the same pixels again takes, in ratio to the first time, by group."""
    net = dict(zip((d.name for d in draws), measured.seconds - measured.empty_s, strict=True))
    pairs = [d.name for d in draws if d.kind == "twice"]
    return {
        once.partition(",")[0]: float(net[again] / net[once] - 1.0)
        for once, again in zip(pairs[::2], pairs[1::2], strict=True)
    }
