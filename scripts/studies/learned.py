"""The study of docs/studies/learned.md: is it worth learning which polygons to optimise?

    PYTHONPATH=. python scripts/studies/learned.py --out results/reference/learned

Needs scikit-learn (`pip install 'raster-harness[studies]'`) and takes some ten minutes on one
core. Writes shares.csv, a row for each held-out scene, time and rule; and prints the verdict.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd
import shapely
from numba import njit
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor

from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from scenes import load
from triangulators import triangulate_many, vertices
from triangulators.batch.triangulate_many import ragged

SCENES = ("city", "helsinki", "cad", "glyphs", "counties", "meshes")
OPTIMUM, USUAL, REFINED = "optimal:half-perimeter", "ear-clipping", "refined:half-perimeter"
MOST_VERTICES = 500
MOST_POLYGONS = 2000
QUARTER = 0.25
RUNS = 5
LEAST_S = 1e-3
"""Copies of a polygon are timed together for at least this long."""

RESAMPLES = 2000

Column = NDArray[np.float64]


@dataclass(frozen=True)
class Data:
    """What is known of a scene's p polygons; every column is (p,), times in seconds.

    features : (p, 13)
    saving, refined_saving : helper lanes, ear clipping's less the optimum's, or refined's
    optimum_s : of the optimum, each polygon by itself
    usual_s, refined_s, features_s : of all polygons together
    """

    name: str
    features: Column
    corners: Column
    saving: Column
    refined_saving: Column
    optimum_s: Column
    usual_s: float
    refined_s: float
    features_s: float


def main() -> None:
    """Measure all scenes, hold each out in turn, write and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    data = []
    for name in SCENES:
        data.append(_measure(name))
        one = data[-1]
        print(
            f"{name}: {len(one.saving):,} polygons, optimum {one.optimum_s.sum():.3f} s, "
            f"ear clipping {one.usual_s:.3f} s, refined {one.refined_s:.3f} s, "
            f"features {one.features_s:.4f} s",
            flush=True,
        )
    rows = []
    for held_out in data:
        rows += _judge(held_out, [each for each in data if each is not held_out])
    table = pd.DataFrame(rows)
    given.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(given.out / "shares.csv", index=False, float_format="%.5g")
    print(table.to_string(index=False, float_format=lambda value: f"{value:.3f}"))
    print(_verdict(table))


def _measure(name: str) -> Data:
    """Triangulate a scene's polygons three ways, count their helper lanes and take the times."""
    frame = make_frame(load(name, seed=0).polygons, View(1024))
    polygons = [p for p in frame.polygons if len(vertices(p)) <= MOST_VERTICES]
    if len(polygons) > MOST_POLYGONS:
        chosen = np.random.default_rng(0).choice(len(polygons), MOST_POLYGONS, replace=False)
        polygons = [polygons[k] for k in np.sort(chosen)]
    arrays = ragged(polygons)
    made = {rule: triangulate_many(polygons, rule) for rule in (USUAL, REFINED, OPTIMUM)}
    assert all(not found.failed for found in made.values())
    lanes = {
        rule: np.array([_helper_lanes(p, found[k]) for k, p in enumerate(polygons)])
        for rule, found in made.items()
    }
    columns = _columns(polygons, [made[USUAL][k] for k in range(len(polygons))])
    return Data(
        name=name,
        features=features(*columns),
        corners=np.array([len(vertices(p)) for p in polygons], float),
        saving=(lanes[USUAL] - lanes[OPTIMUM]).astype(float),
        refined_saving=(lanes[USUAL] - lanes[REFINED]).astype(float),
        optimum_s=np.array([_alone(p) for p in polygons]),
        usual_s=_timed(lambda: triangulate_many(arrays, USUAL, threads=1)),
        refined_s=_timed(lambda: triangulate_many(arrays, REFINED, threads=1)),
        features_s=_timed(lambda: features(*columns)),
    )


def _helper_lanes(polygon: shapely.Polygon, triangles: NDArray[np.int32]) -> int:
    points = np.rint(vertices(polygon) * 256).astype(np.int32)
    return int(predict(points, triangles)["helper_lanes"].sum())


def _alone(polygon: shapely.Polygon) -> float:
    """Return the seconds of one polygon's optimum in a batch, where no call is paid for."""
    copies = 1
    while True:
        arrays = ragged([polygon] * copies)
        start = time.perf_counter()
        triangulate_many(arrays, OPTIMUM, threads=1)
        if time.perf_counter() - start >= LEAST_S or copies > 4096:
            break
        copies *= 4
    return _timed(lambda: triangulate_many(arrays, OPTIMUM, threads=1)) / copies


def _timed(work: Callable[[], Any]) -> float:
    taken = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return median(taken)


def _columns(polygons: list[shapely.Polygon], made: list[NDArray[np.int32]]) -> tuple[Any, ...]:
    """Return vertices, ends of rings, rings of each polygon and triangles, one after another."""
    points, ring_ends, owners, rows, bounds = [], [0], [0], [], [0]
    for polygon, triangles in zip(polygons, made, strict=True):
        for ring in (polygon.exterior, *polygon.interiors):
            ring_ends.append(ring_ends[-1] + len(ring.coords) - 1)
        owners.append(owners[-1] + 1 + len(polygon.interiors))
        points.append(vertices(polygon))
        rows.append(triangles)
        bounds.append(bounds[-1] + len(triangles))
    return (
        np.concatenate(points),
        np.array(ring_ends),
        np.array(owners),
        np.concatenate(rows).astype(np.int64),
        np.array(bounds),
    )


@njit(cache=True)
def features(
    points: Column,
    ring_ends: NDArray[np.int64],
    owners: NDArray[np.int64],
    rows: NDArray[np.int64],
    bounds: NDArray[np.int64],
) -> Column:
    """Return the (p, 13) features that the study registers, in one pass."""
    found = np.zeros((len(owners) - 1, 13))
    for k in range(len(found)):
        first, last = ring_ends[owners[k]], ring_ends[owners[k + 1]]
        own = points[first:last]
        after = np.zeros(last - first, np.int64)
        reflex, length, area = 0, 0.0, 0.0
        for ring in range(owners[k], owners[k + 1]):
            start, stop = ring_ends[ring], ring_ends[ring + 1]
            twice = 0.0
            for i in range(start, stop):
                j = i + 1 if i + 1 < stop else start
                twice += points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0]
            outer = 1.0 if ring == owners[k] else -1.0
            area += outer * abs(twice) / 2
            turn = outer if twice > 0 else -outer
            for i in range(start, stop):
                j = i + 1 if i + 1 < stop else start
                h = j + 1 if j + 1 < stop else start
                ux, uy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                vx, vy = points[h, 0] - points[j, 0], points[h, 1] - points[j, 1]
                length += abs(ux) + abs(uy)
                after[i - first] = j - first
                if turn * (ux * vy - uy * vx) < 0:
                    reflex += 1
        width = own[:, 0].max() - own[:, 0].min()
        height = own[:, 1].max() - own[:, 1].min()
        sides = last - first
        total, longest, diagonals, number = 0.0, 0.0, 0.0, 0
        for t in range(bounds[k], bounds[k + 1]):
            for corner in range(3):
                a, b = rows[t, corner], rows[t, (corner + 1) % 3]
                step = abs(own[a, 0] - own[b, 0]) + abs(own[a, 1] - own[b, 1])
                total += step / 2
                if after[a] != b and after[b] != a:
                    longest = max(longest, step)
                    diagonals += step
                    number += 1
        row = found[k]
        row[0] = sides
        row[1] = owners[k + 1] - owners[k] - 1
        row[2] = reflex
        row[3] = area
        row[4] = width
        row[5] = height
        row[6] = length
        row[7] = area / (width * height)
        row[8] = length / (2 * (width + height))
        row[9] = total / length
        row[10] = longest
        row[11] = diagonals / max(number, 1)
        row[12] = row[11] / (length / sides)
    return found


def _judge(held_out: Data, others: list[Data]) -> list[dict[str, Any]]:
    """Return each rule's share of the saving, at a quarter of the time and at refined's."""
    model = HistGradientBoostingRegressor(random_state=0)
    model.fit(
        np.concatenate([each.features for each in others]),
        np.concatenate([each.saving for each in others]),
    )
    # The optimum's time is a constant times n cubed, fitted where the time is spent.
    cubes = np.concatenate([each.corners for each in others]) ** 3
    constant = np.concatenate([each.optimum_s for each in others]).sum() / cubes.sum()
    promised = model.predict(held_out.features)
    predict_s = _timed(lambda: model.predict(held_out.features))
    order = np.argsort(-promised / (constant * held_out.corners**3), kind="stable")
    overhead = held_out.usual_s + held_out.features_s + predict_s
    whole = float(held_out.optimum_s.sum())
    rows = []
    for label, budget in (("a quarter", QUARTER * whole), ("refined", held_out.refined_s)):
        rules = {
            "learned": (order, overhead),
            "small first": (np.argsort(held_out.corners, kind="stable"), held_out.usual_s),
        }
        for rule, (chosen, before) in rules.items():
            value, low, high = _interval(held_out, chosen, before, budget)
            rows.append(_row(held_out, label, budget / whole, rule, value, low, high))
        value, low, high = _interval_of_refined(held_out)
        fits = held_out.refined_s <= budget
        if fits:
            rows.append(_row(held_out, label, budget / whole, "refined", value, low, high))
    rows[0] |= {"spent_before": overhead / whole}
    return rows


def _row(
    data: Data, at: str, share_of_time: float, rule: str, value: float, low: float, high: float
) -> dict[str, Any]:
    return {
        "held_out": data.name,
        "polygons": len(data.saving),
        "at": at,
        "share_of_time": share_of_time,
        "rule": rule,
        "share_of_saving": value,
        "low": low,
        "high": high,
    }


def _share(data: Data, order: NDArray[np.int64], before: float, budget: float) -> float:
    """Return the share of the whole saving that the first polygons of an order get in time."""
    spent = before + np.cumsum(data.optimum_s[order])
    got = data.saving[order][spent <= budget].sum()
    return float(got / data.saving.sum())


def _interval(
    data: Data, order: NDArray[np.int64], before: float, budget: float
) -> tuple[float, float, float]:
    """Return a rule's share with its 95 % bootstrap interval over polygons.

    A resample takes polygons with their times, and its budget and overhead grow with its time.
    """
    rng = np.random.default_rng(0)
    place = np.argsort(order)
    shares = []
    whole = data.optimum_s.sum()
    for _ in range(RESAMPLES):
        drawn = rng.integers(0, len(order), len(order))
        drawn = drawn[np.argsort(place[drawn], kind="stable")]
        spent = before + np.cumsum(data.optimum_s[drawn])
        limit = budget * data.optimum_s[drawn].sum() / whole
        saving = data.saving[drawn]
        shares.append(saving[spent <= limit].sum() / saving.sum())
    low, high = np.percentile(shares, [2.5, 97.5])
    return _share(data, order, before, budget), float(low), float(high)


def _interval_of_refined(data: Data) -> tuple[float, float, float]:
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(RESAMPLES):
        drawn = rng.integers(0, len(data.saving), len(data.saving))
        shares.append(data.refined_saving[drawn].sum() / data.saving[drawn].sum())
    low, high = np.percentile(shares, [2.5, 97.5])
    return float(data.refined_saving.sum() / data.saving.sum()), float(low), float(high)


def _verdict(table: pd.DataFrame) -> str:
    """Apply the registered rule of success."""
    won = 0
    for _, scene in table.groupby("held_out"):
        beaten = []
        for _, there in scene.groupby("at"):
            learned = there[there["rule"] == "learned"].iloc[0]
            others = there[there["rule"] != "learned"]
            beaten.append(bool((learned["low"] > others["high"]).all()))
        won += all(beaten)
    outcome = "success" if won >= 5 else "not worth it"
    return f"learned is above all other rules in {won} of {table['held_out'].nunique()}: {outcome}"


if __name__ == "__main__":
    main()
