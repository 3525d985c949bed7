"""The paper's question of several criteria: which triangulations lie between the least A and the
least D, and which of them are faster.

For a single polygon, the whole Pareto front of A and D is computed. For a scene, the weights of the
mixture are swept. This gives the corners of the convex hull of the scene's front, exactly, in the
two measures that the mixture weighs: the means over polygons of A over the polygon's area, and of D
per triangle.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.console import Console

from harness.errors import InputError
from harness.frame import View, make_frame
from harness.measuring.run import Part
from harness.metrics.groups import RecordGroup, group_run
from harness.metrics.per_polygon import read_columns
from harness.metrics.registry import PREDICTED
from harness.results.record import Record
from harness.results.run_folder import Run
from harness.settings import StudySize
from harness.stats.intervals import FASTER, SLOWER
from harness.study.subjects import choose_polygons, evenly
from harness.style import plain_table
from harness.triangulating.recipes import parse_all
from scenes import Scene
from triangulators import criteria, registry
from triangulators.methods.pareto import MAX_VERTICES, pareto_front

NAMED = (
    *("fan", "ear-clipping", "delaunay", "sweep", "greedy", "max-area"),
    *("optimal:overdraw", "optimal:shape", "optimal:half-perimeter", "optimal:edge-length"),
)
"""Triangulators that are compared with the front; those that are not installed are left out."""

STEPS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""beta over alpha between the two ends of the sweep, A alone and D alone."""

MOST_POINTS = 15
"""Most points of one front that are measured; a longer front is sampled evenly, with both ends."""

WHOLE = "all"
"""`polygon` of the rows about the whole scene."""

NORMALISED = ("overdraw_over_area", "shape_a_triangle")
"""Columns that the mixture weighs: means over polygons of A over the area, and of D/T."""

SAME = 1e-9
"""Costs with a smaller relative difference are equal."""


def mixture(alpha: float, beta: float, gamma: float = 0.0) -> str:
    """Return the full name of the optimum for these weights."""
    return f"optimal:{criteria.mixed(alpha, beta, gamma).name}"


SWEEP = (mixture(1, 0), *(mixture(1, step) for step in STEPS), mixture(0, 1))
"""The sweep, from A alone to D alone."""

WITH_C = mixture(1, 1, 1)
"""The same triangulations as without C, whose weight changes nothing."""


FRONTS = ("polygon", "k", "overdraw", "shape", "measured")
"""Columns of fronts.csv: the points of a polygon's front as it is drawn, ascending in A."""


def named() -> tuple[str, ...]:
    """Return those of `NAMED` that are installed."""
    return tuple(name for name in NAMED if registry.parse(name).entry.available() is None)


def take_apart(
    label: str, scene: Scene, polygons: int, view: View
) -> tuple[list[Part], dict[str, pd.DataFrame]]:
    """Return what is measured, and `FRONTS` of each single polygon by the label of its part.

    polygons : how many single polygons to take; of a scene of one, that one is all

    Raises
    ------
    InputError
        if there is no polygon to take
    """
    alone = len(scene.polygons) == 1
    fronts = {}
    parts = []
    if alone or polygons:
        design = StudySize(polygons=max(polygons, 1), most_vertices=MAX_VERTICES)
        for number, part in choose_polygons(scene, design):
            drawn = make_frame(part.polygons, view).polygons
            if len(drawn) != 1 or drawn[0].interiors:  # the grid breaks it
                continue
            costs = pareto_front(drawn[0], "overdraw", "shape").costs.tolist()
            chosen = evenly(range(len(costs)), MOST_POINTS)
            points = (f"pareto#{k}" for k in chosen)
            sweep = (*SWEEP, WITH_C) if alone else ()
            name = f"{label}#{number}"
            parts.append(Part(name, part, parse_all((*points, *named(), *sweep))))
            rows = [(number, k, *cost, k in chosen) for k, cost in enumerate(costs)]
            fronts[name] = pd.DataFrame(rows, columns=FRONTS)
    if not alone:
        parts.append(Part(label, scene, parse_all((*SWEEP, WITH_C, *named()))))
    if not parts:
        raise InputError(f"{scene.name}: its polygon breaks apart at {view.resolution} px")
    return parts, fronts


def pareto_table(run: Run, fronts: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the contents of pareto.csv: one row per triangulation, rasteriser and device.

    Triangulators that left polygons out are not in it: their sums are over fewer polygons.
    """
    table: list[dict[str, object]] = []
    position = {record.id.scene: number for number, record in enumerate(reversed(run.records))}
    for group in sorted(group_run(run), key=lambda group: -position[group.id.scene]):
        most = max((record.polygons for record in group.measured), default=0)
        complete = [record for record in group.measured if record.polygons == most]
        by_name = {record.name: record for record in complete}
        base = by_name.get("pareto#0", by_name.get(SWEEP[0]))
        if base is not None:
            front = fronts.get(group.id.scene)
            polygon = WHOLE if front is None else str(front["polygon"][0])
            rows = [{"polygon": polygon, **_row(run, group, each, base)} for each in complete]
            # Beside the whole front of a single polygon, of a scene beside the other rows.
            names = list(NORMALISED if front is None else ("overdraw", "shape"))
            costs = np.array([[row[name] for name in names] for row in rows], np.float64)
            others = costs if front is None else front[names].to_numpy()
            marks = undominated(costs, others).tolist()
            table += [row | {"undominated": m} for row, m in zip(rows, marks, strict=True)]
    return pd.DataFrame(table)


def _row(run: Run, group: RecordGroup, record: Record, base: Record) -> dict[str, object]:
    """Return a row; `base` is the least-A end, with which times are compared."""
    name, case = record.name, record.id
    ratio = group.compare(record, base)
    kind = "sweep" if name.startswith("optimal:mixed") else "named"
    weights: Sequence[float | None] = (None, None, None)
    if kind == "sweep":
        weights = [float(each) for each in (name.partition("=")[2] or "1/1/1").split("/")]
    one, other = record.predicted, base.predicted
    alike = ("overdraw", "shape", "half_perimeter", "edge_length")
    return {
        "kind": "front" if name.startswith("pareto#") else kind,
        "triangulator": name,
        **dict(zip(("alpha", "beta", "gamma"), weights, strict=True)),
        **{which: one[which] for which in ("overdraw", "shape", "half_perimeter")},
        "same_as_end": all(abs(one[n] - other[n]) <= SAME * abs(other[n]) for n in alike),
        **dict(zip(NORMALISED, _normalised(run, record, base), strict=True)),
        **{which: record.counters.get(which) for which in ("helper_lanes", "bbox_tests")},
        "rasteriser": case.rasteriser,
        "device": case.device_name,
        "resolution": case.view.resolution,
        "time_ratio": ratio and ratio.value,
        "ci_low": ratio and ratio.low,
        "ci_high": ratio and ratio.high,
        "verdict": ratio and ratio.verdict,
    }


def _normalised(run: Run, record: Record, base: Record) -> tuple[float, float]:
    """Return A over the area and D a triangle (degrees), each a mean over polygons.

    Areas and numbers of triangles are the base's, so that all are divided by the same.
    """
    own, others = read_columns(run, record), read_columns(run, base)
    if own is None or others is None:  # one polygon: its columns are its record's totals
        sums, scale = record.predicted, base.predicted
        return sums["overdraw"] / scale["area"], sums["shape"] / scale["triangles"]
    area, triangles = others[f"{PREDICTED}area"], others[f"{PREDICTED}triangles"]
    return (
        float(np.mean(own[f"{PREDICTED}overdraw"] / area)),
        float(np.mean(own[f"{PREDICTED}shape"] / triangles)),
    )


def undominated(costs: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Say of each row of (c, 2) whether no row of `others` is as good in both and better in one.

    Values closer than a part in 10^9 are equal.
    """
    slack = SAME * np.maximum(np.abs(costs).max(axis=0, initial=0.0), 1e-300)
    as_good = (others[None] <= costs[:, None] + slack).all(axis=2)
    better = (others[None] < costs[:, None] - slack).any(axis=2)
    return np.asarray(~(as_good & better).any(axis=1))


def print_table(table: pd.DataFrame, scene: str, console: Console) -> None:
    """Print a row for each polygon, rasteriser and device: how many points are faster or slower.

    Of a whole scene, the points are the steps of its sweep.
    """
    title = f"{scene}: time in ratio to the least-A end of the front of A and D"
    heads = ("polygon", "rasteriser", ">points", ">slower", ">faster", "fastest of all")
    shown = plain_table(title, *heads)
    where = ["polygon", "rasteriser", "device"]
    for (polygon, rasteriser, _), part in table.groupby(where, sort=False):
        kind = "front" if (part["kind"] == "front").any() else "sweep"
        others = part[~part["same_as_end"]].dropna(subset=["time_ratio"])
        points = others[(others["kind"] == kind) & (others["gamma"].fillna(0) == 0)]
        counts = [len(points) + 1, *((points["verdict"] == v).sum() for v in (SLOWER, FASTER))]
        fastest = others.sort_values("time_ratio").head(1).itertuples()
        told = [f"{row.time_ratio:.3f} {row.triangulator}" for row in fastest]
        shown.add_row(str(polygon), str(rasteriser), *map(str, counts), *(told or ["-"]))
    console.print(shown)
