"""Recommended criterion for a device and its modelled savings; costs by aspect ratio."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import View, make_frame
from harness.measuring.pool import MeasuringPool
from harness.metrics.statistics import compute_mean_interval, compute_student_interval
from harness.profile.cost_terms import TERMS, Design
from harness.profile.design import AREAS, ASPECTS
from harness.profile.law import COSTS
from harness.profile.measured import DrawTimes
from harness.profile.placing import Draw
from harness.study.subjects import sample_evenly
from harness.triangulating.recipes import parse
from scenes import SceneError, load

# Scenes that are triangulated, if they can be loaded, with their names in sentences.
SCENES = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters"}

SCENE_POLYGONS = 48  # of each scene, at equal steps of their order by vertex count

RESOLUTION = 1024

BASE = "ear-clipping"
# Optima that need no profile, with symbols: half-perimeter, expected quads, overdraw.
CRITERIA = {
    "optimal:half-perimeter": "H",
    "optimal:expected-quads": "Q",
    "optimal:overdraw": "A",
}
CALIBRATED_OPTIMUM = "optimal:calibrated"

# Maximum modelled extra cost, as a share, at which a criterion that needs no profile is preferred
# to `CALIBRATED_OPTIMUM`.
MAX_REGRET = 0.005


def recommend_triangulator(
    pool: MeasuringPool, coefficients: Mapping[str, float], seed: int = 0
) -> dict[str, Any] | None:
    """Return the recommendation of `choose_triangulator` for a device's seconds of each of `COSTS`.

    None if no scene can be loaded, or if the coefficients give no triangle a cost.
    """
    weights = np.array([coefficients[term] for term in COSTS[1:]])
    if not (weights > 0).any():
        return None
    costs = {}
    for scene in SCENES:
        sums = sum_scene_features(
            pool, scene, (BASE, *CRITERIA, CALIBRATED_OPTIMUM), seed, coefficients
        )
        if sums is not None:
            costs[scene] = {name: rows @ weights for name, rows in sums.items()}
    return choose_triangulator(costs) if costs else None


def choose_triangulator(costs: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> dict[str, Any]:
    """Return the recommendation, JSON-ready, from modelled seconds of polygons.

    costs : scene -> triangulator -> seconds of each polygon, (p,), not counting the draw itself

    The `triangulator` is a criterion's optimum unless the `regret` of each, the mean extra cost
    over `CALIBRATED_OPTIMUM`, exceeds `MAX_REGRET`; `saved` is the share of ear clipping's time by
    scene, with its 95 % interval over polygons.
    """
    regret = {
        name: float(
            np.mean(
                [
                    times[name].sum() / times[CALIBRATED_OPTIMUM].sum() - 1
                    for times in costs.values()
                ]
            )
        )
        for name in (BASE, *CRITERIA, CALIBRATED_OPTIMUM)
    }
    best = min(CRITERIA, key=lambda name: regret[name])
    recommended = best if regret[best] <= MAX_REGRET else CALIBRATED_OPTIMUM
    saved = {}
    for scene, times in costs.items():
        logs = np.log(times[recommended] / times[BASE])
        low, high = compute_mean_interval(logs)
        saved[scene] = (1.0 - np.exp([logs.mean(), high, low])).tolist()
    return {"triangulator": recommended, "regret": regret, "saved": saved}


def sum_scene_features(
    pool: MeasuringPool,
    scene: str,
    triangulators: Sequence[str],
    seed: int = 0,
    coefficients: Mapping[str, float] | None = None,
) -> dict[str, NDArray[np.float64]] | None:
    """Return triangulator -> (p, 8) features of polygons, `COSTS[1:]`, as sums over triangles.

    Polygons that some triangulator does not solve are omitted; None without a polygon.

    coefficients : weights that optimal:calibrated minimises
    """
    try:
        polygons = load(scene, seed=seed, attributes=False).polygons
    except SceneError:
        return None
    frame = make_frame(polygons, View(RESOLUTION))
    sizes = frame.grid.vertex_counts
    # A triangle has only one triangulation.
    candidates = [n for n in np.argsort(sizes, kind="stable").tolist() if sizes[n] > 3]
    sample = frame.polygons.take(sample_evenly(candidates, SCENE_POLYGONS))
    sums, complete = {}, np.ones(len(sample), np.bool_)
    for name in triangulators:
        result = pool.triangulate(parse(name, seed=seed, calibration=coefficients), sample)
        sums[name] = np.stack([result.predicted[term] for term in COSTS[1:]], axis=1)
        complete &= result.drawn
    return {name: rows[complete] for name, rows in sums.items()} if complete.any() else None


def compare_aspects(
    draws: Sequence[Draw], design: Design, measured: DrawTimes
) -> list[dict[str, Any]]:
    """Return the relative cost of thin triangles, a dictionary for each triangle area in `AREAS`.

    ratios, low, high : time less that of an empty draw, relative to aspect 1, mean over the angles
    lanes : shaded lanes relative to aspect 1
    doubled_at : aspect at which the ratio is 2, with its interval, or None if it stays below
    """
    results = []
    lane, pixel = (list(TERMS).index(name) for name in ("helper_lanes", "fragments"))
    for area in AREAS:
        rows = [
            [n for n, draw in enumerate(draws) if (draw.area, draw.aspect) == (area, aspect)]
            for aspect in ASPECTS
        ]
        times = np.stack([measured.epochs[:, row].mean(axis=1) for row in rows], axis=1)
        # Timer noise must not make the difference negative.
        net = np.maximum(times - measured.empty, 1e-3 * times)
        ratios = net / net[:, :1]
        ends = np.exp([compute_student_interval(column) for column in np.log(ratios.T)])
        counts = np.stack([design[row].mean(axis=0) for row in rows])
        shaded = counts[:, pixel] + counts[:, lane]
        results.append(
            {
                "area": area,
                "aspects": list(ASPECTS),
                "ratios": ends[:, 0].tolist(),
                "low": ends[:, 1].tolist(),
                "high": ends[:, 2].tolist(),
                "lanes": (shaded / shaded[0]).tolist(),
                "doubled_at": _interpolate_doubling(ratios),
            }
        )
    return results


def _interpolate_doubling(ratios: NDArray[np.float64]) -> list[float] | None:
    """Return the aspect at which the ratios (e, a) of all epochs reach 2, with an interval."""
    aspects = []
    steps = np.log2(ASPECTS)
    for logs in np.log2(ratios):
        over = np.flatnonzero(logs >= 1.0)
        if not len(over):
            return None
        ends = slice(over[0] - 1, over[0] + 1)
        aspects.append(np.interp(1.0, logs[ends], steps[ends]))
    return [float(2.0**end) for end in compute_student_interval(np.array(aspects))]
