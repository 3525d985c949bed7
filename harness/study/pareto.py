"""Pareto fronts of the paper's criteria A (overdraw) and D (shape), with draw times.

For a single polygon, the complete Pareto front is computed. For a scene, the weights of the mixture
are swept. This gives exactly the vertices of the convex hull of the scene's front in the two
measures that the mixture weighs: the means over polygons of A over the polygon's area, and of D per
triangle. `make_triangulation_table` lists all triangulations of a small polygon.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.console import Console
from shapely import Polygon

from harness.errors import InputError
from harness.frame import View, make_frame
from harness.measuring.run import ScenePart
from harness.metrics.groups import IDENTIFYING_CRITERIA, RecordGroup, group_run, read_columns
from harness.metrics.registry import PREDICTED
from harness.metrics.statistics import FASTER, SLOWER
from harness.results.record import Record
from harness.results.run_folder import Run
from harness.settings import StudySize
from harness.study.subjects import choose_polygons, sample_evenly
from harness.style import make_plain_table
from harness.triangulating.recipes import parse_all
from scenes import Scene
from triangulators import criteria, registry, vertices
from triangulators.criteria import predict
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.methods.pareto import MAX_VERTICES, pareto_front

COMPARED = (  # with the front, if installed
    *("fan", "ear-clipping", "delaunay", "sweep", "greedy", "max-area"),
    *("optimal:overdraw", "optimal:shape", "optimal:half-perimeter", "optimal:edge-length"),
)

STEPS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of D's weight to A's weight
MAX_POINTS = 15  # of a front that are measured; a longer front is sampled evenly
ALL = "all"  # polygon of rows about the complete scene
NORMALISED = ("overdraw_over_area", "shape_a_triangle")  # the measures that the mixture weighs
TOLERANCE = 1e-9  # relative difference up to which costs are equal


def name_mixture(alpha: float, beta: float, gamma: float = 0.0) -> str:
    """Return the name of the triangulator that minimises alpha A + beta D + gamma C."""
    return f"optimal:{criteria.mixed(alpha, beta, gamma).name}"


SWEEP = (name_mixture(1, 0), *(name_mixture(1, step) for step in STEPS), name_mixture(0, 1))
"""Names of the sweep's mixtures, from A alone to D alone."""

WITH_C = name_mixture(1, 1, 1)  # the paper's C (complexity) has no effect on the result

CRITERIA = ("overdraw", "shape", "complexity", "half_perimeter", "edge_length", "triangles")

FRONTS = ("polygon", "k", "overdraw", "shape", "measured")  # of fronts.csv; k is the rank by A


def list_compared() -> tuple[str, ...]:
    """Return the installed triangulators of `COMPARED`."""
    return tuple(
        name for name in COMPARED if registry.parse(name).entry.find_install_command() is None
    )


def make_parts(
    label: str, scene: Scene, polygons: int, view: View
) -> tuple[list[ScenePart], dict[str, pd.DataFrame]]:
    """Return the parts to measure, and each single polygon's front (`FRONTS`) by its part's name.

    polygons : number of single polygons; a scene of one polygon is always that polygon
    """
    is_single = len(scene.polygons) == 1
    fronts = {}
    parts = []
    if is_single or polygons:
        design = StudySize(polygons=max(polygons, 1), max_vertices=MAX_VERTICES)
        for number, part in choose_polygons(scene, design):
            drawn = make_frame(part.polygons, view).polygons
            if len(drawn) != 1 or drawn[0].interiors:  # the grid splits the polygon
                continue
            costs = pareto_front(drawn[0], "overdraw", "shape").costs.tolist()
            sample = sample_evenly(range(len(costs)), MAX_POINTS)
            points = (f"pareto#{k}" for k in sample)
            sweep = (*SWEEP, WITH_C) if is_single else ()
            name = f"{label}#{number}"
            parts.append(ScenePart(name, part, parse_all((*points, *list_compared(), *sweep))))
            rows = [(number, k, *cost, k in sample) for k, cost in enumerate(costs)]
            fronts[name] = pd.DataFrame(rows, columns=FRONTS)
    if not is_single:
        parts.append(ScenePart(label, scene, parse_all((*SWEEP, WITH_C, *list_compared()))))
    if not parts:
        raise InputError(
            f"{scene.name}: the polygon is split by the grid at {view.resolution} px; "
            "use a larger --resolution"
        )
    return parts, fronts


def make_pareto_table(run: Run, fronts: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the contents of pareto.csv: one row per triangulation, rasteriser and device.

    Triangulators that skipped polygons are omitted, because their sums cover fewer polygons.
    """
    table: list[dict[str, object]] = []
    position = {record.id.scene: number for number, record in enumerate(reversed(run.records))}
    for group in sorted(group_run(run), key=lambda group: -position[group.id.scene]):
        drawn = max((record.polygons for record in group.measured), default=0)
        complete = [record for record in group.measured if record.polygons == drawn]
        by_name = {record.name: record for record in complete}
        base = by_name.get("pareto#0", by_name.get(SWEEP[0]))
        if base is not None:
            front = fronts.get(group.id.scene)
            polygon = ALL if front is None else str(front["polygon"][0])
            rows = [{"polygon": polygon, **_make_row(run, group, r, base)} for r in complete]
            # A single polygon is compared with its complete front, a scene with its other rows.
            names = list(NORMALISED if front is None else ("overdraw", "shape"))
            costs = np.array([[row[name] for name in names] for row in rows], np.float64)
            reference = costs if front is None else front[names].to_numpy()
            marks = mark_undominated(costs, reference).tolist()
            table += [row | {"undominated": m} for row, m in zip(rows, marks, strict=True)]
    return pd.DataFrame(table)


def _make_row(run: Run, group: RecordGroup, record: Record, base: Record) -> dict[str, object]:
    """Return a row of pareto.csv; base : the end of the front with minimum A, for time ratios."""
    name, case = record.name, record.id
    ratio = group.compute_ratio(record, base)
    kind = "sweep" if name.startswith("optimal:mixed") else "named"
    weights: Sequence[float | None] = (None, None, None)
    if kind == "sweep":
        weights = [float(weight) for weight in (name.partition("=")[2] or "1/1/1").split("/")]
    predicted, end = record.predicted, base.predicted
    return {
        "kind": "front" if name.startswith("pareto#") else kind,
        "triangulator": name,
        **dict(zip(("alpha", "beta", "gamma"), weights, strict=True)),
        **{column: predicted[column] for column in ("overdraw", "shape", "half_perimeter")},
        "same_as_end": all(
            abs(predicted[column] - end[column]) <= TOLERANCE * abs(end[column])
            for column in IDENTIFYING_CRITERIA
        ),
        **dict(zip(NORMALISED, _normalise_criteria(run, record, base), strict=True)),
        **{counter: record.counters.get(counter) for counter in ("helper_lanes", "bbox_tests")},
        "rasteriser": case.rasteriser,
        "device": case.device_name,
        "resolution": case.view.resolution,
        "time_ratio": ratio and ratio.value,
        "ci_low": ratio and ratio.low,
        "ci_high": ratio and ratio.high,
        "verdict": ratio and ratio.verdict,
    }


def _normalise_criteria(run: Run, record: Record, base: Record) -> tuple[float, float]:
    """Return means over polygons of A over area and D per triangle, with the divisors of `base`."""
    columns, base_columns = read_columns(run, record), read_columns(run, base)
    if columns is None or base_columns is None:  # a single polygon: totals are its columns
        sums, scale = record.predicted, base.predicted
        return sums["overdraw"] / scale["area"], sums["shape"] / scale["triangles"]
    area, triangles = base_columns[f"{PREDICTED}area"], base_columns[f"{PREDICTED}triangles"]
    return (
        float(np.mean(columns[f"{PREDICTED}overdraw"] / area)),
        float(np.mean(columns[f"{PREDICTED}shape"] / triangles)),
    )


def mark_undominated(
    costs: NDArray[np.float64], reference: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return the (c,) mask of the rows of (c, 2) costs that no row of `reference` dominates.

    A row dominates another if it is nowhere larger and somewhere smaller, beyond `TOLERANCE`.
    """
    slack = TOLERANCE * np.maximum(np.abs(costs).max(axis=0, initial=0.0), 1e-300)
    not_larger = (reference[None] <= costs[:, None] + slack).all(axis=2)
    smaller = (reference[None] < costs[:, None] - slack).any(axis=2)
    return np.asarray(~(not_larger & smaller).any(axis=1))


def print_pareto_table(table: pd.DataFrame, scene: str, console: Console) -> None:
    """Print for each polygon, rasteriser and device how many points are faster or slower."""
    title = f"{scene}: time relative to the minimum of A on the front of A and D"
    headings = ("polygon", "rasteriser", ">points", ">slower", ">faster", "fastest triangulator")
    printed = make_plain_table(title, *headings)
    keys = ["polygon", "rasteriser", "device"]
    for (polygon, rasteriser, _), part in table.groupby(keys, sort=False):
        kind = "front" if (part["kind"] == "front").any() else "sweep"
        compared = part[~part["same_as_end"]].dropna(subset=["time_ratio"])
        points = compared[(compared["kind"] == kind) & (compared["gamma"].fillna(0) == 0)]
        counts = [len(points) + 1, *((points["verdict"] == v).sum() for v in (SLOWER, FASTER))]
        fastest = compared.sort_values("time_ratio").head(1).itertuples()
        cells = [f"{row.time_ratio:.3f} {row.triangulator}" for row in fastest]
        printed.add_row(str(polygon), str(rasteriser), *map(str, counts), *(cells or ["-"]))
    console.print(printed)


def make_triangulation_table(
    polygon: Polygon, mode: Literal["conforming", "paper"]
) -> pd.DataFrame:
    """Return one row per triangulation, sorted by overdraw; columns `CRITERIA` and two more.

    conforming : without T-junctions; diagonals : pairs of vertex numbers, "1-3 3-5"
    """
    points = vertices(polygon)
    rows = []
    for triangles in enumerate_triangulations(polygon, mode):
        predicted = predict(points, triangles)
        row: dict[str, object] = {name: predicted[name] for name in CRITERIA}
        row["triangles"] = len(triangles)
        row["conforming"] = len(triangles) == len(points) - 2
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        pairs = np.unique(edges, axis=0).tolist()
        diagonals = (f"{a}-{b}" for a, b in pairs if b - a not in (1, len(points) - 1))
        row["diagonals"] = " ".join(diagonals)
        rows.append(row)
    table = pd.DataFrame(rows)
    return table.sort_values(["overdraw", "shape"], kind="stable").reset_index(drop=True)
