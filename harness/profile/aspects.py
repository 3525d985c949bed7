"""Are thin triangles slow, from which aspect on, and why: times at equal area."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.figures.intervals import student_interval
from harness.profile.counted import TERMS, Design
from harness.profile.design import AREAS, ASPECTS, Draw
from harness.profile.law import Law
from harness.profile.measured import Measured

LANES = "helper_lanes"


def aspects(
    draws: Sequence[Draw], design: Design, measured: Measured, law: Law
) -> list[dict[str, Any]]:
    """Return for each area of the design what thin triangles cost there, JSON-ready.

    area : px^2; aspects : base in ratio to height
    ratios, low, high : time less the empty draw's, mean over the angles, in ratio to aspect 1
    lanes : lanes shaded in ratio to those of aspect 1
    lanes_alone : the same as `ratios` if, of all that changes, helper lanes alone took time
    doubled_at : aspect at which the ratio is 2, with its interval; None where it does not get there
    shares : of what the thinnest takes more than the widest, how much each term of the law is; each
        with its interval
    """
    return [_of_area(area, draws, design, measured, law) for area in AREAS]


def _of_area(
    area: int, draws: Sequence[Draw], design: Design, measured: Measured, law: Law
) -> dict[str, Any]:
    rows = [
        [n for n, draw in enumerate(draws) if (draw.area, draw.aspect) == (area, aspect)]
        for aspect in ASPECTS
    ]
    times = np.stack([measured.epochs[:, row].mean(axis=1) for row in rows], axis=1)
    # A timer's noise must not make a draw shorter than nothing.
    net = np.maximum(times - measured.empty_s, 1e-3 * times)
    ratios = net / net[:, :1]
    ends = np.exp([student_interval(np.log(column)) for column in ratios.T])
    counts = np.stack([design[row].mean(axis=0) for row in rows])
    whole = np.exp(np.log(net).mean(axis=0))
    lane = law.seconds[list(TERMS).index(LANES)]
    shaded = counts[:, list(TERMS).index("fragments")] + counts[:, list(TERMS).index(LANES)]
    more = counts[:, list(TERMS).index(LANES)] - counts[0, list(TERMS).index(LANES)]
    return {
        "area": area,
        "aspects": list(ASPECTS),
        "ratios": ends[:, 0].tolist(),
        "low": ends[:, 1].tolist(),
        "high": ends[:, 2].tolist(),
        "lanes": (shaded / shaded[0]).tolist(),
        "lanes_alone": (1.0 + lane * more / whole[0]).tolist(),
        "doubled_at": _doubled(ratios),
        "shares": _shares(counts[-1] - counts[0], float(whole[-1] - whole[0]), law),
    }


def _doubled(ratios: NDArray[np.float64]) -> list[float] | None:
    """Return the aspect at which (e, a) ratios reach 2, in between two aspects by their logarithms.

    With Student's interval over the epochs; None unless all of them get there.
    """
    found = []
    steps = np.log2(ASPECTS)
    for each in np.log2(ratios):
        over = np.flatnonzero(each >= 1.0)
        if not len(over):
            return None
        place = int(over[0])
        share = (1.0 - each[place - 1]) / (each[place] - each[place - 1])
        found.append(steps[place - 1] + share * (steps[place] - steps[place - 1]))
    return [float(2.0**end) for end in student_interval(found)]


def _shares(more: NDArray[np.float64], seconds: float, law: Law) -> Mapping[str, list[float]]:
    """Return what each term takes of `seconds`, as shares with intervals, largest first."""
    if seconds <= 0:
        return {}
    value = more * law.seconds / seconds
    ends = np.sort(more[:, None] * law.intervals / seconds, axis=1)
    order = np.argsort(-value)
    names = list(TERMS)
    return {names[n]: [float(value[n]), *ends[n].tolist()] for n in order if abs(value[n]) > 1e-6}
