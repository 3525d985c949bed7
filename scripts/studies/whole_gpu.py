"""The study docs/studies/whole-gpu.md: what a whole GPU, simulated, makes of a triangulation.

    PYTHONPATH=. python scripts/studies/whole_gpu.py OUT [--polygons 12] [SCENE ...]

Writes a row a draw to OUT/draws.csv, which a second call goes on with, and what the study asks of
them to OUT/ratios.csv, ranks.csv and orders.csv. Cycles are counts: a busy machine does not bend
them.
"""

import argparse
import csv
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from harness.frame import View, frame_of
from harness.metrics.per_polygon import spearman
from harness.rasterisers import Device, Options, get
from harness.rasterisers.simulated.attila import BINDING, Attila
from harness.settings import StudySize
from harness.stats.intervals import mean_interval, median_over
from harness.study.subjects import choose_polygons
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse_all
from scenes import load

SCENES = ("city", "helsinki", "glyphs", "cad")
PIXELS = 256
BASE = "ear-clipping"
TRIANGULATORS = (
    *(BASE, "earcut-refine", "delaunay", "flips:l1"),
    *("optimal:half-perimeter", "optimal:overdraw", "optimal:expected-quads"),
)
ORDERS = {
    "native": Options(order="native"),
    "walk": Options(order="walk"),
    "shuffled": Options(order="shuffled", seed=1),
}
KEYS = ["scene", "polygon", "triangulator", "bound", "order"]
PREDICTED = ("half_perimeter", "overdraw", "expected_quads")
COUNTED = (*Attila.counters, "cycles")


def draws(scene: str, polygons: int) -> Iterator[tuple[tuple[object, ...], Callable[[], dict]]]:
    """Yield each draw's key, and what draws it and returns its row of the file."""
    gpus = {
        bound: get("simulated")(Device(f"attila:bound={bound}", software=True)) for bound in BINDING
    }
    for number, alone in choose_polygons(load(scene), StudySize(polygons=polygons)):
        frame = frame_of(alone, View(PIXELS))
        for recipe in parse_all(TRIANGULATORS):
            made = triangulate_polygons(recipe, frame.polygons, None)
            for (bound, gpu), (order, options) in product(gpus.items(), ORDERS.items()):
                key = (scene, number, str(recipe), bound, order)
                yield key, partial(row, key, gpu, frame, made, options)


def row(key, gpu, frame, made, options):
    """Draw once; the row of the file."""
    triangles = frame.join(made.parts)
    counted = gpu.count(frame, triangles, options)
    told = dict(zip(KEYS, key, strict=True), triangles=len(triangles))
    told |= {name: made.predicted[name].sum().item() for name in PREDICTED}
    return told | {name: int(counted[name]) for name in COUNTED}


def measure(file: Path, scenes: list[str], polygons: int) -> None:
    """Append the rows that the file has not, two draws at once."""
    done = set()
    if file.exists():
        done = set(map(tuple, pd.read_csv(file, dtype=str)[KEYS].to_numpy().tolist()))
    with file.open("a", newline="") as out, ThreadPoolExecutor(os.cpu_count()) as pool:
        table = csv.DictWriter(out, [*KEYS, "triangles", *PREDICTED, *COUNTED])
        if not done:
            table.writeheader()
        for scene in scenes:
            left = (each for each in draws(scene, polygons) if tuple(map(str, each[0])) not in done)
            for told in pool.map(lambda each: each[1](), left):
                table.writerow(told)
                out.flush()


def of_base(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return each polygon's and triangulator's ratio to the base, orders averaged as logarithms."""
    logs = np.log(rows.set_index(KEYS)[column].astype(float)).unstack("triangulator")
    ratios = logs.sub(logs[BASE], axis=0).drop(columns=BASE)
    return ratios.groupby(["scene", "bound", "polygon"]).mean()


def ratios(rows: pd.DataFrame) -> pd.DataFrame:
    """Geometric means over polygons, with 95 % intervals, of cycles and of quads."""
    found = []
    for column in ("cycles", "quads", "half_perimeter"):
        for (scene, bound), logs in of_base(rows, column).groupby(["scene", "bound"]):
            for name in logs.columns:
                low, high = mean_interval(logs[name].to_numpy())
                mean, low, high = (math.exp(each) for each in (logs[name].mean(), low, high))
                found.append((scene, bound, name, column, len(logs), mean, low, high))
    columns = ["scene", "bound", "triangulator", "of", "polygons", "ratio", "low", "high"]
    return pd.DataFrame(found, columns=columns)


def ranks(rows: pd.DataFrame) -> pd.DataFrame:
    """Spearman's coefficient within polygons of cycles (orders' geometric mean), by predictor."""
    rows = rows.assign(cycles=np.log(rows["cycles"]))
    mean = rows.groupby(["scene", "bound", "polygon", "triangulator"]).mean(numeric_only=True)
    found = []
    for (scene, bound), part in mean.groupby(["scene", "bound"]):
        views = [view for _, view in part.groupby("polygon")]
        for by in (*PREDICTED, "quads", "busiest_pipe_quads", "colour_misses", "traversal_cycles"):
            each = (spearman(view[by].to_numpy(float), view["cycles"].to_numpy()) for view in views)
            known = np.array([value for value in each if not math.isnan(value)])
            middle = float(np.median(known)) if len(known) else math.nan
            found.append((scene, bound, by, len(known), middle, *median_over(known)))
    columns = ["scene", "bound", "by", "polygons", "median", "low", "high"]
    return pd.DataFrame(found, columns=columns)


def orders(rows: pd.DataFrame) -> pd.DataFrame:
    """How far cycles lie apart, as standard deviations of logarithms within a polygon.

    triangulation : between triangulators, orders averaged; order : between the orders of one
    triangulation; walk, shuffled : geometric mean of cycles over those of the native order
    """
    found = []
    for (scene, bound), part in rows.groupby(["scene", "bound"]):
        logs = np.log(part.set_index(KEYS)["cycles"].astype(float)).unstack("order")
        between = logs.mean(axis=1).groupby("polygon").std().mean()
        within = logs.std(axis=1).groupby("polygon").mean().mean()
        over = logs.sub(logs["native"], axis=0)
        found.append(
            (scene, bound, between, within, within / between if between else math.nan)
            + (math.exp(over["walk"].mean()), math.exp(over["shuffled"].mean()))
        )
    columns = ["scene", "bound", "triangulation", "order", "order_over_triangulation"]
    return pd.DataFrame(found, columns=[*columns, "walk", "shuffled"])


def main() -> None:
    """Measure what is missing, and write the tables."""
    reader = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    reader.add_argument("out", type=Path)
    reader.add_argument("scenes", nargs="*", default=SCENES)
    reader.add_argument("--polygons", type=int, default=12)
    given = reader.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    measure(given.out / "draws.csv", list(given.scenes), given.polygons)
    rows = pd.read_csv(given.out / "draws.csv")
    for name, table in (("ratios", ratios), ("ranks", ranks), ("orders", orders)):
        table(rows).to_csv(given.out / f"{name}.csv", index=False, float_format="%.4f")


if __name__ == "__main__":
    main()
