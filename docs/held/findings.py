"""The figures of docs/findings.md, and what other pages and charts cite of its files."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from docs.held import Held, profiles, simulated
from docs.held.lookups import at_most, ends, one, some, values
from docs.held.names import BEST_FOR_H, BEST_FOR_Q, REFINED, scenes
from harness.stats.intervals import Ratio, of_any_run

SCENES = scenes("city", "helsinki", "glyphs", "counties")
Q_H_A = ("expected_quads", "half_perimeter", "overdraw")
TRUSTED = {
    "Q": ("criterion", "expected-quads"),
    "H": ("criterion", "half-perimeter"),
    "`refined`": ("triangulator", REFINED),
    "E": ("criterion", "edge-length"),
    "A": ("criterion", "overdraw"),
    "Delaunay": ("triangulator", "delaunay"),
    "`flips:beauty`": ("triangulator", "flips:beauty"),
    "D": ("criterion", "shape"),
    "ear clipping": ("triangulator", "ear-clipping"),
}
"""Whom one may trust, by how the documents call them."""


ON_GPU = ("city", "glyphs", "cad")
"""Scenes that the H200 drew; of cad there are counters alone."""


def gain(scene: str, px: int, name: str, base: str = "ear-clipping", **where: object) -> float:
    """Return the draw time in ratio to another triangulator's, on llvmpipe unless told."""
    plain = {"rasteriser": "opengl", "order": "native", "work": 0, "samples": 1, "fit": "box"}
    known = {"scene": scene, "resolution": px, "triangulator": name, "base": base, "rotation": 0}
    return float(one("llvmpipe/gains/gains.csv", **{**plain, **known, **where})["time_ratio"])


def ordered(scene: str, name: str, base: str = "ear-clipping") -> pd.Series[Any]:
    """Return times in ratio to another triangulator's, by order of triangles."""
    file = "llvmpipe/orders/orders.csv"
    return one(file, scene=scene, triangulator=name, base=base, resolution=1024)


def correlation(
    criterion: str, measure: str, rasteriser: str = "opengl", statistic: str = "spearman_within"
) -> pd.Series[Any]:
    """Return the row of a rank correlation of the city."""
    where = {"criterion": criterion, "measure": measure, "rasteriser": rasteriser}
    return one("llvmpipe/validate-city/correlations.csv", statistic=statistic, **where)


def regret(scene: str, px: int, who: str, measure: str = "helper_lanes") -> pd.Series[Any]:
    """Return the row of what trusting a criterion, or a triangulator, costs."""
    kind, name = TRUSTED[who]
    file = f"cpu/regret-{scene}/regret.csv"
    return one(file, resolution=px, measure=measure, kind=kind, name=name)


def run_of(scene: str) -> str:
    """Return the file of a scene's draw times."""
    return f"llvmpipe/gains-{scene}/summary.csv"


def time_ratio(row: pd.Series[Any]) -> tuple[float, float, float]:
    """Return a row's ratio of times with its interval, which holds how much runs scatter.

    The files behind findings.md were written before an interval held that.
    """
    found = of_any_run(Ratio(row["time_ratio"], row["time_ratio_low"], row["time_ratio_high"], 0))
    return found.value, found.low, found.high


def predicted_lanes() -> pd.DataFrame:
    """Return lanes `by_quads`, 4Q - S, `by_length`, H + T, and `counted`, over ear clipping's.

    One row for each triangulator of `gains-<scene>` at 256, 1024 and 4096 px that draws all
    polygons.
    """
    found = []
    for scene, px in product(SCENES, (256, 1024, 4096)):
        view = some(run_of(scene), resolution=px, status="ok").set_index("triangulator")
        view = view[view["polygons"] == view["polygons"]["ear-clipping"]]
        lanes = pd.DataFrame(
            {
                "by_quads": 4.0 * view["expected_quads"] - view["fragments"],
                "by_length": view["half_perimeter"] + view["triangles"],
                "counted": view["helper_lanes"],
            }
        )
        over = lanes / lanes.loc["ear-clipping"]
        found.append(over.drop("ear-clipping").dropna().assign(scene=scene))
    return pd.concat(found)


def error_of_prediction(by: str) -> float:
    """Return the root mean square error of a column of predicted lanes, in per cent."""
    lanes = predicted_lanes()
    return 100.0 * math.expm1(math.sqrt((np.log(lanes[by] / lanes["counted"]) ** 2).mean()))


def rotated(name: str, base: str = "ear-clipping") -> pd.Series[float]:
    """Return helper lanes in ratio to a triangulator's, by angle."""
    table_of = some("llvmpipe/gains-rotation/summary.csv")
    lanes = table_of.pivot(index="rotation", columns="triangulator", values="helper_lanes")
    return lanes[name] / lanes[base]


def _again() -> list[object]:
    """Return how many correlations with counters are equal in both runs, of how many, and by how
    much those with times differ at most.
    """
    key = ["rasteriser", "device", "criterion", "measure", "statistic"]
    files = (f"llvmpipe/validate-city{which}/correlations.csv" for which in ("", "-again"))
    first, second = (some(file).set_index(key)["value"].dropna() for file in files)
    second = second.reindex(first.index)
    timed = first.index.get_level_values("measure").str.startswith("time")
    within = first.index.get_level_values("statistic") == "spearman_within"
    apart = (first - second)[timed & within].abs().max()
    return [sum((first == second)[~timed]), sum(~timed), math.ceil(1000 * apart) / 1000]


def on_gpu(scene: str, px: int, name: str, what: str = "time_ratio") -> float:
    """Return a figure of a triangulator on the H200."""
    rows = some(f"h200/gains-{scene}/summary.csv", resolution=px).set_index("triangulator")
    return float(rows[what][name])


def _counted() -> list[int]:
    """Return how many draws of the H200 have the reference's counters, of how many."""
    key = ["scene", "triangulator", "resolution"]
    counters = ["fragments", "quads", "helper_lanes"]
    both = [
        pd.concat(some(f"h200/equality-{s}/summary.csv", rasteriser=of) for s in ON_GPU)
        for of in ("opengl", "reference")
    ]
    gpu, reference = (each.set_index(key)[counters].sort_index() for each in both)
    return [sum((gpu == reference).all(axis=1)), len(reference)]


def _moved() -> list[int]:
    """Return by how many per cent at most ratios of times move on another CPU."""
    key = ["scene", "rasteriser", "resolution", "rotation", "fit", "work", "samples", "order"]
    files = ("llvmpipe/gains-on-another.csv", "llvmpipe/gains/gains.csv")
    there, here = (some(f).set_index([*key, "triangulator", "base"])["time_ratio"] for f in files)
    return [math.ceil(100 * (there / here.reindex(there.index) - 1).abs().max())]


FIRST: Held = {
    **simulated.IN_SHORT,
    **simulated.WITH_SHADER,
    **simulated.IN_WHOLE,
    "Times are of an AMD EPYC {}/{} ({}-bit), in": lambda: map(
        values("reference/llvmpipe/gains-city/run.json")["cpu"].get,
        ("family", "model", "vector_bits"),
    ),
    "in {:.2f} of ear clipping's time for city ... {:.2f} for Helsinki's, ... {:.2f} ... {:.2f}"
    " for counties. Delaunay's triangles take {:.2f}, {:.2f}, {:.2f} and {:.2f}.": lambda: [
        gain(s, 1024, n) for n in (BEST_FOR_H, "delaunay") for s in SCENES
    ],
    "`refined` takes {:.1%} to {:g} % longer than the best for H": lambda: [
        min(gain(s, 1024, REFINED, BEST_FOR_H) for s in SCENES) - 1,
        100 * at_most((gain(s, 1024, REFINED, BEST_FOR_H) - 1 for s in SCENES), 3),
    ],
    "its error in a scene's helper lanes, ... is {:.1f} % ... H + T, ... is {:.1f} %.": lambda: map(
        error_of_prediction, ("by_quads", "by_length")
    ),
    "with a median correlation of {:.3f}, H with {:.3f}, the paper's A with {:.3f} and D with"
    " {:.3f}. ... A ranks the pixels that a walk of bounding boxes tests with {:.3f}.": lambda: [
        *(correlation(each, "helper_lanes")["value"] for each in (*Q_H_A, "shape")),
        correlation("overdraw", "bbox_tests", "bounding-box")["value"],
    ],
    "trusting Q costs a mean of about {:%} to {:%} % ... Trusting H costs {:%} to {:%} %. Trusting"
    " A costs {:%} % on letters and {:%} % on ... ear clipping costs {:%} % and {:%} %.": lambda: [
        *(e for who in "QH" for e in ends(regret(scene, 1024, who)["mean"] for scene in SCENES)),
        *(
            regret(scene, 1024, who)["mean"]
            for who, scene in product(("A", "ear clipping"), ("glyphs", "counties"))
        ),
    ],
    "{:,} of {:,} correlations with counters are equal ... differ by up to {:.3f}.": _again,
    "by earlier code, a ratio of times moved by up to {} %": _moved,
    **profiles.FIRST,
    "in {:.2f}, {:.2f} and {:.2f} of ear clipping's time at 256 px, 1024 px and 4096 px, the best"
    " for H in {:.2f}, {:.2f} and {:.2f}": lambda: [
        on_gpu("city", px, name) for name in (BEST_FOR_Q, BEST_FOR_H) for px in (256, 1024, 4096)
    ],
    "On letters at 256 and 1024 px they take {:.2f} and {:.2f}, and {:.2f} and {:.2f}": lambda: [
        on_gpu("glyphs", px, name) for name in (BEST_FOR_Q, BEST_FOR_H) for px in (256, 1024)
    ],
    "is {:.2f} to {:.2f}, that of H {:.2f} to {:.2f}, of A {:.2f} to {:.2f}": lambda: [
        end
        for criterion in Q_H_A
        for end in ends(v["ranks"][criterion] for v in values("devices/opengl-h200.json")["views"])
    ],
    "On letters Q's is {:.2f} at 1024 px, but {:.2f} at 256 px": lambda: [
        v["ranks"]["expected_quads"] for v in values("devices/opengl-h200-glyphs.json")["views"]
    ],
    "at 256 px takes {:.2f} of ear clipping's time, with {:.2f} of its helper lanes": lambda: [
        on_gpu("glyphs", 256, "delaunay"),
        on_gpu("glyphs", 256, "delaunay", "helper_lanes")
        / on_gpu("glyphs", 256, "ear-clipping", "helper_lanes"),
    ],
    "In {} of {} draws": _counted,
}
"""The first page's."""
