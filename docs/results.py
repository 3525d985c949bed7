"""Functions that compute the figures of the documents from the files under `results/`.

Each public function in `FUNCTIONS` can be named in a figure comment (`docs/figures.py`) and in a
chart. Arguments are those of the comment: a scene, a size in px, a triangulator.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from functools import cache
from itertools import product
from statistics import median
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from docs.figures import ALIASES, ROOT, Interval, format_value
from harness.frame import Frame, View, make_frame
from harness.metrics.statistics import Ratio, add_run_scatter, compute_spearman
from harness.profile.report import format_seconds
from harness.rasterisers.reference import count_per_triangle
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load

REFERENCE = ROOT / "results" / "reference"

SCENES = ("city", "helsinki", "glyphs", "counties")

H200_SCENES = ("city", "glyphs", "cad")

PICTURE_PX = 64
"""Side of the viewport of a polygon in a picture."""

MIN_COVERAGE = 0.93
"""Coverage below which an interval of 95 % is reported as not covering."""


@cache
def _table(file: str) -> pd.DataFrame:
    """Return a CSV file under `results/reference`, its criteria named with underscores."""
    table = pd.read_csv(REFERENCE / file)
    if "criterion" in table:
        table["criterion"] = table["criterion"].str.replace("-", "_")
    return table


@cache
def _json(file: str) -> Any:
    return json.loads((ROOT / "results" / file).read_text(encoding="utf-8"))


def select(file: str, **where: object) -> pd.DataFrame:
    """Return the rows of a CSV file whose columns equal `where`; `{key}` in the file's name is
    replaced by the value of that key.
    """
    name = file.format_map(where)
    columns = {key: value for key, value in where.items() if f"{{{key}}}" not in file}
    table = _table(name)
    rows = table[(table[list(columns)] == list(columns.values())).all(axis=1)]
    if rows.empty:
        raise LookupError(f"results/reference/{name}: no row with {columns}")
    return rows


def csv(file: str, column: str, **where: object) -> list[Any]:
    """Return a column of the selected rows; `value/low/high` makes intervals of three columns."""
    rows = select(file, **where)
    if "/" in column:
        return [Interval(*row) for row in rows[column.split("/")].itertuples(index=False)]
    return rows[column].tolist()


def json_values(file: str, path: str, **keys: object) -> list[Any]:
    """Return the values at a dotted path; `*` is any item, `key=value` the items that match."""
    values = [_json(file.format_map(keys))]
    for step in path.format_map(keys).split("."):
        key, _, value_of_key = step.partition("=")
        values = [
            item
            for value in values
            for item in (
                value
                if step == "*"
                else [item for item in value if str(item[key]) == value_of_key]
                if value_of_key
                else [value[int(step) if isinstance(value, list) else step]]
            )
        ]
    return values


def number_after(file: str, word: str) -> int:
    """Return the number that follows the only occurrence of a word in a text file."""
    text = (REFERENCE / file).read_text(encoding="utf-8")
    (number,) = re.findall(rf"\b{re.escape(word)} *\| *(\d+)", text)
    return int(number)


def number_before(file: str, word: str) -> int:
    """Return the number that stands before the only occurrence of a word in a text file."""
    text = (REFERENCE / file).read_text(encoding="utf-8")
    (number,) = re.findall(rf"([\d,]+) {re.escape(word)}\b", text)
    return int(number.replace(",", ""))


def picture_frame(scene: str, quantile: float) -> Frame:
    """Return the frame of a polygon of `scripts/pictures.py`."""
    (index,) = csv("gallery.csv", "polygon", scene=scene, quantile=quantile)
    return make_frame([load(scene).polygons[index]], View(PICTURE_PX))


def triangulate_frame(frame: Frame, triangulator: str) -> NDArray[np.int32]:
    """Return the triangles (m, 3) of a frame of one polygon."""
    return frame.join_triangles(triangulate_polygons(parse(triangulator), frame.polygons).parts)


def count_helper_lanes(frame: Frame, triangulator: str) -> int:
    """Return the helper lanes of a frame of one polygon."""
    return int(
        sum(
            count_per_triangle(frame.points, triangulate_frame(frame, triangulator))["helper_lanes"]
        )
    )


def picture(scene: str, quantile: float, triangulator: str = "ear-clipping") -> int:
    """Return the helper lanes of a polygon of `scripts/pictures.py`."""
    return count_helper_lanes(picture_frame(scene, quantile), triangulator)


def gain(
    scene: str, px: int, triangulator: str, base: str = "ear-clipping", rasteriser: str = "opengl"
) -> float:
    """Return the draw time on llvmpipe relative to another triangulator's."""
    (ratio,) = csv(
        "llvmpipe/gains/gains.csv", "time_ratio", scene=scene, resolution=px, base=base,
        triangulator=triangulator, rasteriser=rasteriser, order="native", work=0, samples=1,
        fit="box", rotation=0,
    )  # fmt: skip
    return float(ratio)


def predicted_lanes() -> pd.DataFrame:
    """Return helper lanes relative to ear clipping's: `by_quads` 4Q - S, `by_length` H + T,
    `counted`.

    One row for each triangulator of `gains-<scene>` at 256, 1024 and 4096 px that draws all
    polygons.
    """
    tables = []
    for scene, px in product(SCENES, (256, 1024, 4096)):
        file = f"llvmpipe/gains-{scene}/summary.csv"
        view = select(file, resolution=px, status="ok").set_index("triangulator")
        view = view[view["polygons"] == view["polygons"]["ear-clipping"]]
        lanes = pd.DataFrame(
            {
                "by_quads": 4.0 * view["expected_quads"] - view["fragments"],
                "by_length": view["half_perimeter"] + view["triangles"],
                "counted": view["helper_lanes"],
            }
        )
        relative = lanes / lanes.loc["ear-clipping"]
        tables.append(relative.drop("ear-clipping").dropna().assign(scene=scene))
    return pd.concat(tables)


def prediction_error(column: str) -> float:
    """Return the root mean square error of a column of predicted lanes as a share."""
    lanes = predicted_lanes()
    return math.expm1(math.sqrt((np.log(lanes[column] / lanes["counted"]) ** 2).mean()))


def repeated(column: str) -> float:
    """Return how many correlations with counters are `equal` in two runs, of how `many`, and by how
    much those with times `differ` at most.
    """
    key = ["rasteriser", "device", "criterion", "measure", "statistic"]
    files = (f"llvmpipe/validate-city{suffix}/correlations.csv" for suffix in ("", "-again"))
    first, second = (select(file).set_index(key)["value"].dropna() for file in files)
    second = second.reindex(first.index)
    timed = first.index.get_level_values("measure").str.startswith("time")
    within = first.index.get_level_values("statistic") == "spearman_within"
    return {
        "equal": sum((first == second)[~timed]),
        "many": sum(~timed),
        "differ": math.ceil(1000 * (first - second)[timed & within].abs().max()) / 1000,
    }[column]


def in_order(
    scene: str, px: int, triangulator: str, order: str, base: str = "", base_order: str = ""
) -> float:
    """Return a time on the H200 relative to that of a base (default: the same triangulator) in
    `base_order` (default: the same order).
    """
    view = {"scene": scene, "resolution": px, "work": 0, "samples": 1}
    times = [
        csv("h200/judged.csv", "measured_ns", **view, triangulator=name, order=submitted)
        for name, submitted in ((triangulator, order), (base or triangulator, base_order or order))
    ]
    return float(times[0][0] / times[1][0])


def walk_correlation(scene: str, px: int, criterion: str) -> float:
    """Return the rank correlation of a criterion with the H200's times of lists in a walk."""
    table = select(f"h200/orders-{scene}/summary.csv", resolution=px, order="walk")
    return compute_spearman(table[criterion].to_numpy(), table["draw_ms"].to_numpy())


def arithmetic_ps(px: int, rounds: int) -> list[float]:
    """Return the picoseconds that a round of arithmetic in a lane took on the H200, if time is the
    time of the arithmetic alone.
    """
    rows = select("h200/judged.csv", resolution=px, work=rounds)
    return list(1e3 * rows["measured_ns"] / (4 * rows["quads"] * rounds))


def repeated_on_h200(column: str) -> float:
    """Return how many draws of the first day were measured again, and the largest change."""
    key = ["scene", "resolution", "triangulator"]
    repeated = select("h200/judged.csv", work=0, samples=1, order="native").set_index(key)
    first = pd.concat(select(f"h200/gains-{scene}/summary.csv") for scene in ("city", "glyphs"))
    first = first.set_index(key)["draw_ms"]
    changes = (repeated["measured_ns"].reindex(first.index) / (1e6 * first) - 1).abs()
    return {"draws": changes.count(), "change": changes.max()}[column]


def equal_counters(column: str) -> int:
    """Return how many draws of the H200 have `equal` counters to the reference's, of how `many`."""
    key = ["scene", "triangulator", "resolution"]
    counters = ["fragments", "quads", "helper_lanes"]
    tables = [
        pd.concat(select(f"h200/equality-{s}/summary.csv", rasteriser=r) for s in H200_SCENES)
        for r in ("opengl", "reference")
    ]
    gpu, reference = (table.set_index(key)[counters].sort_index() for table in tables)
    return {"equal": int((gpu == reference).all(axis=1).sum()), "many": len(reference)}[column]


def moved_on_another_cpu() -> float:
    """Return the largest change of a ratio of times on another CPU, as a share rounded up."""
    key = ["scene", "rasteriser", "resolution", "rotation", "fit", "work", "samples", "order"]
    files = ("llvmpipe/gains-on-another.csv", "llvmpipe/gains/gains.csv")
    another, first = (
        select(f).set_index([*key, "triangulator", "base"])["time_ratio"] for f in files
    )
    return math.ceil(100 * (another / first.reindex(another.index) - 1).abs().max()) / 100


def flips_ms(
    scene: str,
    language: str,
    candidate: str,
    base: str = "",
    add: int = 0,
    file: str = "flips-times.csv",
) -> str:
    """Return milliseconds of `scripts/flips_times.py`, with the ratio to a base in brackets."""
    selection = {"scene": scene, "language": language}
    ms, before = (
        csv(file, "ms", candidate=name.replace("_", " "), **selection)[0]
        for name in (candidate, base or candidate)
    )
    if not base:
        return f"{ms:.2f}"
    return f"{add + ms / before:.2f}" if add else f"{ms:.2f} ({ms / before:.2f})"


def state(state: str) -> list[str]:
    """Return the row of a state of the machine: the runs and the verdicts."""
    runs = select("states/states.csv", state=state)
    planted = select("states/planted.csv", state=state)["compare"]
    ratios = csv("states/ratios.csv", "ratio", state=state, scene="city", triangulator=ALIASES["H"])
    draws = runs[runs["scene"] == "city"]["reference_ms"]
    return [
        str(len(runs)),
        *(
            str(sum(runs["machine_state"] == word))
            for word in ("quiet", "disturbed", "not to be trusted")
        ),
        f"{min(draws):.2f} to {max(draws):.2f}",
        f"{min(ratios):.3f} to {max(ratios):.3f}",
        str(sum(runs["compare"] == 1)),
        # The sentences of all runs are compared with a quiet run's.
        "-" if state == "quiet" else str(sum(runs["wrong"])),
        f"{sum(planted == 1)} of {len(planted)}",
    ]


def interleaved(share: float, **where: object) -> int:
    """Return the number of runs with an interleaved baseline that was slower by `share`."""
    table = _table("interleaved.csv")
    columns = {"share": share, **where}
    return int((table[list(columns)] == list(columns.values())).all(axis=1).sum())


def coverage(interval: str) -> list[str]:
    """Return the row of an interval: kinds of data, minimum coverage, data with less coverage."""
    if interval == "law":
        return _law_coverage()
    rows = select("coverage.csv", interval=interval.replace("_", " "))
    lost = rows[rows["covered"] < MIN_COVERAGE]
    covered = rows.drop(lost.index)
    simpler = covered["covered_simpler"]
    simpler_min = f"{simpler.min():.3f}" if simpler.any() else ""
    exceptions = (f"{row['data']}: {row['covered']:.3f}" for _, row in lost.iterrows())
    return [str(len(rows)), f"{covered['covered'].min():.3f}", simpler_min, "; ".join(exceptions)]


def _law_coverage() -> list[str]:
    terms, profiles = select("law-coverage.csv"), select("law-coverage-profiles.csv")
    pooled = terms["term"] == "all"
    (worst,) = terms[~pooled].nsmallest(1, "covered").to_dict("records")
    lost = profiles[profiles["covered"] < MIN_COVERAGE]
    exceptions = [
        f"single terms: {worst['covered']:.3f} and more",
        *(
            f"for deviations like those of {row['profile']}: {row['covered']:.3f}, a false cost in"
            f" {format_value(1 - row['no_false_cost'], '%')} % of devices"
            for _, row in lost.iterrows()
        ),
    ]
    minimum = min([*terms["covered"][pooled], *profiles["covered"].drop(lost.index)])
    return [str(sum(pooled) + len(profiles)), f"{minimum:.3f}", "", "; ".join(exceptions)]


def profile_term(term: str, profile: str) -> str:
    """Return the cost of a term of a device's law, "-" if it is not significant."""
    (term_entry,) = json_values(f"reference/profiles/{profile}.json", f"terms.name={term}")
    return format_seconds(term_entry["cost"]) if term_entry["shown"] else "-"


def judged(profile: str, scene: str) -> list[str]:
    """Return the row of a device's predictions for polygons outside the fit."""
    rows = select(f"profiles/{profile}-judged.csv", scene=scene).set_index("triangulator")
    advised = rows[rows["advice"] == 1].iloc[0]
    names = [*(ALIASES[letter] for letter in "HQA"), "earcut-refine", "optimal:calibrated"]
    regrets = {name: f"{format_value(rows['regret'][name], '.1%')} %" for name in names}
    above = Interval(*advised[["above", "above_low", "above_high"]])
    return [
        *(f"{rows[column].iloc[0]:.3f}" for column in ("law_over", "law_within", "r2_max")),
        *(f"**{cell}**" if rows["advice"][n] == 1 else cell for n, cell in regrets.items()),
        format_value(above, ".1%"),
    ]


def size_or_aspect(quantity: str, profile: str) -> str:
    """Return the relative time of small or thin triangles.

    quantity : "8px", a pixel of triangles of that area relative to one of large ones; "16:1", thin
        triangles relative to 1:1, for both areas; "twice", the aspect from which triangles take
        twice as long
    """
    device = _json(f"reference/profiles/{profile}.json")
    if quantity == "twice":
        doubled = (aspect["doubled_at"] for aspect in device["aspects"])
        return ", ".join(f"{ends[0]:.0f}:1" if ends else "-" for ends in doubled)
    if quantity.endswith(":1"):
        ratios = (dict(zip(a["aspects"], a["ratios"], strict=True)) for a in device["aspects"])
        return ", ".join(f"{by_aspect[int(quantity[:-2])]:.2f}" for by_aspect in ratios)
    timed = {draw["name"]: draw for draw in device["times"] if draw["kind"] == "size"}
    small, large = (
        (median(timed[f"{side} px"]["epochs"]) - device["empty"])
        / timed[f"{side} px"]["counters"]["fragments"]
        for side in (math.isqrt(2 * int(quantity[:-2])), 64)
    )
    return f"{small / large:.1f}"


def time_ratio(row: pd.Series[Any]) -> Interval:
    """Return a row's ratio of times with its interval, widened by how much runs scatter.

    The files behind findings.md were written before an interval included that.
    """
    ratio = add_run_scatter(
        Ratio(row["time_ratio"], row["time_ratio_low"], row["time_ratio_high"], 0)
    )
    return Interval(ratio.value, ratio.low, ratio.high)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        csv, picture, gain, prediction_error, repeated, in_order, arithmetic_ps,
        walk_correlation, repeated_on_h200, equal_counters,
        moved_on_another_cpu, flips_ms, state, interleaved, coverage, profile_term, judged,
        size_or_aspect, number_after, number_before,
    )
} | {"json": json_values}  # fmt: skip
"""Functions that a figure comment can name."""
