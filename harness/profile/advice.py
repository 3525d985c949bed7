"""Which criterion to triangulate by on a device, and what that saves, by its fitted model."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import View, make_frame
from harness.measuring.pool import MeasuringPool
from harness.profile.counted import TERMS, Design
from harness.profile.design import AREAS, ASPECTS, Draw
from harness.profile.law import COSTS, Law
from harness.profile.measured import Measured
from harness.stats.intervals import mean_interval, student_interval
from harness.study.subjects import evenly
from harness.triangulating.recipes import parse
from scenes import SceneError, load

SCENES = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters"}
"""What is triangulated, with its name in a sentence; one that is not installed is left out."""

POLYGONS = 48
"""Of each scene, at equal steps from the smallest to the largest."""

RESOLUTION = 1024

BASE = "ear-clipping"
CRITERIA = {
    "optimal:half-perimeter": "H",
    "optimal:expected-quads": "Q",
    "optimal:overdraw": "A",
}
OWN = "optimal:calibrated"

CLOSE = 0.005
"""Regret up to which a criterion that needs no file will do as well as the device's own."""


def advise(
    pool: MeasuringPool, coefficients: Mapping[str, float], seed: int = 0
) -> dict[str, Any] | None:
    """Return what to triangulate by where draws take what `coefficients`, by `COSTS`, say.

    None where no scene can be loaded, or the coefficients give no triangle a cost
    """
    own = np.array([coefficients[term] for term in COSTS[1:]])
    if not (own > 0).any():
        return None
    costs = {}
    for scene in SCENES:
        found = terms_of(pool, scene, (BASE, *CRITERIA, OWN), seed, coefficients)
        if found is not None:
            costs[scene] = {name: rows @ own for name, rows in found.items()}
    return choose(costs) if costs else None


def choose(costs: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> dict[str, Any]:
    """Return the advice of (p,) seconds a polygon, by scene and triangulator, JSON-ready.

    triangulator : a criterion's optimum, or the optimum for the device's own coefficients where
        the regret of each criterion is more than `CLOSE`
    regret : of each, what its triangulations cost above those of the device's own optimum, by the
        model, mean over the scenes; the draw itself left out
    saved : by scene, the share of ear clipping's time that the advice saves by the model, with its
        95 % interval over polygons
    """
    regret = {
        name: float(np.mean([each[name].sum() / each[OWN].sum() - 1 for each in costs.values()]))
        for name in (BASE, *CRITERIA, OWN)
    }
    best = min(CRITERIA, key=lambda name: regret[name])
    chosen = best if regret[best] <= CLOSE else OWN
    saved = {}
    for scene, each in costs.items():
        logs = np.log(each[chosen] / each[BASE])
        low, high = mean_interval(logs)
        saved[scene] = (1.0 - np.exp([logs.mean(), high, low])).tolist()
    return {"triangulator": chosen, "regret": regret, "saved": saved}


def terms_of(
    pool: MeasuringPool,
    scene: str,
    triangulators: Sequence[str],
    seed: int = 0,
    coefficients: Mapping[str, float] | None = None,
) -> dict[str, NDArray[np.float64]] | None:
    """Return (p, 8) sums of `COSTS` but the draw's of a scene's polygons, by triangulator.

    Of the polygons that all of them triangulate; None where there is none.
    coefficients : what optimal:calibrated minimises
    """
    try:
        polygons = load(scene, seed=seed, attributes=False).polygons
    except SceneError:
        return None
    frame = make_frame(polygons, View(RESOLUTION))
    sizes = frame.grid.vertex_counts
    # A triangle has one triangulation.
    chosen = evenly(
        [n for n in np.argsort(sizes, kind="stable").tolist() if sizes[n] > 3], POLYGONS
    )
    shown = frame.polygons.take(chosen)
    found, kept = {}, np.ones(len(shown), np.bool_)
    for name in triangulators:
        made = pool.triangulate(parse(name, seed=seed, calibration=coefficients), shown)
        found[name] = np.stack([made.predicted[term] for term in COSTS[1:]], axis=1)
        kept &= np.array([part is not None for part in made.parts])
    return {name: rows[kept] for name, rows in found.items()} if kept.any() else None


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
    found = []
    lane, pixel = (list(TERMS).index(name) for name in ("helper_lanes", "fragments"))
    for area in AREAS:
        rows = [
            [n for n, draw in enumerate(draws) if (draw.area, draw.aspect) == (area, aspect)]
            for aspect in ASPECTS
        ]
        times = np.stack([measured.epochs[:, row].mean(axis=1) for row in rows], axis=1)
        # A timer's noise must not make a draw shorter than nothing.
        net = np.maximum(times - measured.empty, 1e-3 * times)
        ratios = net / net[:, :1]
        ends = np.exp([_over_epochs(np.log(column)) for column in ratios.T])
        counts = np.stack([design[row].mean(axis=0) for row in rows])
        whole = np.exp(np.log(net).mean(axis=0))
        shaded = counts[:, pixel] + counts[:, lane]
        more = counts[:, lane] - counts[0, lane]
        found.append(
            {
                "area": area,
                "aspects": list(ASPECTS),
                "ratios": ends[:, 0].tolist(),
                "low": ends[:, 1].tolist(),
                "high": ends[:, 2].tolist(),
                "lanes": (shaded / shaded[0]).tolist(),
                "lanes_alone": (1.0 + law.costs[lane] * more / whole[0]).tolist(),
                "doubled_at": _doubled(ratios),
                "shares": _shares(counts[-1] - counts[0], float(whole[-1] - whole[0]), law),
            }
        )
    return found


def _over_epochs(values: Any) -> tuple[float, float, float]:
    """Return a mean over epochs with Student's interval."""
    return student_interval(values)


def _doubled(ratios: NDArray[np.float64]) -> list[float] | None:
    """Return the aspect at which (e, a) ratios reach 2, in between two aspects by their logarithms.

    With its interval over the epochs; None unless all of them get there.
    """
    found = []
    steps = np.log2(ASPECTS)
    for each in np.log2(ratios):
        over = np.flatnonzero(each >= 1.0)
        if not len(over):
            return None
        ends = slice(over[0] - 1, over[0] + 1)
        found.append(np.interp(1.0, each[ends], steps[ends]))
    return [float(2.0**end) for end in _over_epochs(found)]


def _shares(more: NDArray[np.float64], seconds: float, law: Law) -> Mapping[str, list[float]]:
    """Return what each term takes of `seconds`, as shares with intervals, largest first."""
    if seconds <= 0:
        return {}
    value = more * law.costs / seconds
    ends = np.sort(more[:, None] * law.intervals / seconds, axis=1)
    order = np.argsort(-value)
    names = list(TERMS)
    return {names[n]: [float(value[n]), *ends[n].tolist()] for n in order if abs(value[n]) > 1e-6}
