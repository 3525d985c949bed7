"""The paper's question of several criteria: which triangulations lie between the least A and the
least D, and which of them are faster.

For a single polygon, the whole Pareto front of A and D is computed. For a scene, the weights of the
mixture are swept. This gives the corners of the convex hull of the scene's front, exactly, in the
two measures that the mixture weighs: the means over polygons of A over the polygon's area, and of D
per triangle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.figures.groups import groups, time_ratio
from harness.figures.polygons import PREDICTED, columns_of
from harness.figures.ratios import Ratio
from harness.frame import View, make_frame
from harness.measuring.run import Part
from harness.stored.folder import Record, Run
from harness.study.design import Design
from harness.study.subjects import choose_polygons
from harness.triangulating.recipes import parse_all
from scenes import Scene
from triangulators import criteria, registry
from triangulators.methods import exhaustive
from triangulators.methods.count_triangulations import count_triangulations
from triangulators.methods.pareto import LIMIT, pareto_front

NAMED = (
    "fan",
    "ear-clipping",
    "delaunay",
    "sweep",
    "greedy",
    "max-area",
    "optimal:overdraw",
    "optimal:shape",
    "optimal:half-perimeter",
    "optimal:edge-length",
)
"""Triangulators that are compared with the front; those that are not installed are left out."""

STEPS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""beta over alpha between the two ends of the sweep, A alone and D alone."""

MOST_POINTS = 15
"""Most points of one front that are measured; a longer front is sampled evenly, with both ends."""

MOST_SHOWN = 500
"""A polygon with at most this many triangulations has all of them plotted beside the front."""

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

WITHOUT_C, WITH_C = mixture(1, 1), mixture(1, 1, 1)
"""Two optima that are one if C changes nothing."""


@dataclass(frozen=True)
class MeasuredFront:
    """The exact front of one polygon of a scene, as it is drawn.

    costs : (f, 2), A in px^2 and D in degrees, ascending in A
    chosen : the numbers of the points that are measured
    everything : (t, 2), the costs of all triangulations, None where there are too many to show
    """

    polygon: int
    costs: NDArray[np.float64]
    chosen: tuple[int, ...]
    everything: NDArray[np.float64] | None = None


def named() -> tuple[str, ...]:
    """Return those of `NAMED` that are installed."""
    return tuple(name for name in NAMED if registry.parse(name).entry.available() is None)


def take_apart(
    label: str, scene: Scene, polygons: int, view: View
) -> tuple[list[Part], dict[str, MeasuredFront]]:
    """Return what is measured, and the front of each single polygon by the label of its part.

    polygons : how many single polygons to take; of a scene of one, that one is all

    Raises
    ------
    UsageError
        if there is no polygon to take
    """
    alone = len(scene.polygons) == 1
    fronts: dict[str, MeasuredFront] = {}
    parts = []
    if alone or polygons:
        design = Design(polygons=max(polygons, 1), most_vertices=LIMIT)
        for number, part in choose_polygons(scene, design):
            front = _front(number, part, view)
            if front is None:
                continue
            points = tuple(f"pareto#{k}" for k in front.chosen)
            sweep = (*SWEEP, WITH_C) if alone else ()
            name = f"{label}#{number}"
            parts.append(Part(name, part, parse_all((*points, *named(), *sweep))))
            fronts[name] = front
    if not alone:
        parts.append(Part(label, scene, parse_all((*SWEEP, WITH_C, *named()))))
    if not parts:
        raise UsageError(f"{scene.name}: its polygon breaks apart at {view.resolution} px")
    return parts, fronts


def _front(number: int, scene: Scene, view: View) -> MeasuredFront | None:
    """Return the front of a scene's only polygon, None if the grid breaks it."""
    frame = make_frame(scene.polygons, view)
    if len(frame.polygons) != 1 or frame.polygons[0].interiors:
        return None
    polygon = frame.polygons[0]
    costs = pareto_front(polygon, "overdraw", "shape").costs
    steps = np.linspace(0, len(costs) - 1, min(MOST_POINTS, len(costs)))
    chosen = tuple(dict.fromkeys(np.rint(steps).astype(int).tolist()))
    if count_triangulations(polygon) > MOST_SHOWN:
        return MeasuredFront(number, costs, chosen)
    every = exhaustive.tabulate(polygon)
    return MeasuredFront(
        number, costs, chosen, np.column_stack((every["overdraw"], every["shape"]))
    )


def front_table(fronts: Mapping[str, MeasuredFront]) -> pd.DataFrame:
    """Return the contents of fronts.csv: one row per point, measured or not."""
    rows = [
        (front.polygon, k, *cost, k in front.chosen)
        for front in fronts.values()
        for k, cost in enumerate(front.costs.tolist())
    ]
    return pd.DataFrame(rows, columns=["polygon", "k", "overdraw", "shape", "measured"])


def pareto_table(run: Run, fronts: Mapping[str, MeasuredFront]) -> pd.DataFrame:
    """Return the contents of pareto.csv: one row per triangulation, rasteriser and device.

    Triangulators that left polygons out are not in it: their sums are over fewer polygons.
    """
    rows: list[dict[str, object]] = []
    place = {record["scene"]: number for number, record in enumerate(reversed(run.records))}
    for members in sorted(groups(run.records), key=lambda group: -place[group[0]["scene"]]):
        good = [record for record in members if record["status"] == "ok"]
        most = max((record["polygons"] for record in good), default=0)
        whole = [record for record in good if record["polygons"] == most]
        base = least_overdraw_end(whole)
        if base is not None:
            front = fronts.get(base["scene"])
            rows += [_row(run, record, base, front) for record in whole]
    table = pd.DataFrame(rows)
    return table if table.empty else _with_undominated(table, fronts)


def least_overdraw_end(records: Sequence[Record]) -> Record | None:
    """Return the record of a group that times are compared with."""
    by_name = {record["triangulator"]: record for record in records}
    return by_name.get("pareto#0", by_name.get(SWEEP[0]))


def _row(run: Run, record: Record, base: Record, front: MeasuredFront | None) -> dict[str, object]:
    name = record["triangulator"]
    ratio = time_ratio(record, base)
    return {
        "polygon": WHOLE if front is None else str(front.polygon),
        "kind": _kind(name),
        "triangulator": name,
        **_weights(name),
        **{which: record["predicted"][which] for which in ("overdraw", "shape", "half_perimeter")},
        "same_as_end": same(record, base),
        **dict(zip(NORMALISED, _normalised(run, record, base), strict=True)),
        **{which: record["counters"].get(which) for which in ("helper_lanes", "bbox_tests")},
        **{which: record[which] for which in ("rasteriser", "device", "resolution")},
        **_of_ratio(ratio),
    }


def _of_ratio(ratio: Ratio | None) -> dict[str, object]:
    columns = {"time_ratio": "value", "ci_low": "low", "ci_high": "high", "verdict": "verdict"}
    return {name: None if ratio is None else getattr(ratio, of) for name, of in columns.items()}


def same(record: Record, base: Record) -> bool:
    """Whether two records are of one triangulation, as their criteria show."""
    one, other = record["predicted"], base["predicted"]
    names = ("overdraw", "shape", "half_perimeter", "edge_length")
    return all(abs(one[name] - other[name]) <= SAME * abs(other[name]) for name in names)


def _kind(name: str) -> str:
    if name.startswith("pareto#"):
        return "front"
    return "sweep" if name.startswith("optimal:mixed") else "named"


def _weights(name: str) -> dict[str, float | None]:
    """Return alpha, beta and gamma of a mixture's name, None for anything else."""
    letters = ("alpha", "beta", "gamma")
    if _kind(name) != "sweep":
        return dict.fromkeys(letters)
    written = name.partition("=")[2] or "1/1/1"
    return dict(zip(letters, map(float, written.split("/")), strict=True))


def _normalised(run: Run, record: Record, base: Record) -> tuple[float, float]:
    """Return A over the area and D a triangle (degrees), each a mean over polygons.

    Areas and numbers of triangles are the base's, so that all are divided by the same.
    """
    own, others = columns_of(run, record), columns_of(run, base)
    if own is None or others is None:  # one polygon: its columns are its record's totals
        sums, scale = record["predicted"], base["predicted"]
        return sums["overdraw"] / scale["area"], sums["shape"] / scale["triangles"]
    area, triangles = others[f"{PREDICTED}area"], others[f"{PREDICTED}triangles"]
    return (
        float(np.mean(own[f"{PREDICTED}overdraw"] / area)),
        float(np.mean(own[f"{PREDICTED}shape"] / triangles)),
    )


def _with_undominated(table: pd.DataFrame, fronts: Mapping[str, MeasuredFront]) -> pd.DataFrame:
    """Add `undominated`: whether nothing is as good in A and in D and better in one.

    For a single polygon that is the whole front, for a scene the other rows.
    """
    known = {str(front.polygon): front.costs for front in fronts.values()}
    marks = pd.Series(False, index=table.index)
    for (polygon, *_), part in table.groupby(["polygon", "rasteriser", "device"], sort=False):
        front = known.get(str(polygon))
        names = NORMALISED if front is None else ("overdraw", "shape")
        costs = part[list(names)].to_numpy(float)
        marks[part.index] = undominated(costs, costs if front is None else front)
    table["undominated"] = marks
    return table


def undominated(costs: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Say of each row of (c, 2) whether no row of `others` is as good in both and better in one.

    Values closer than a part in 10^9 are equal.
    """
    slack = SAME * np.maximum(np.abs(costs).max(axis=0, initial=0.0), 1e-300)
    as_good = (others[None] <= costs[:, None] + slack).all(axis=2)
    better = (others[None] < costs[:, None] - slack).any(axis=2)
    return np.asarray(~(as_good & better).any(axis=1))
