"""The study of docs/studies/gpu.md: predict draw times of a GPU from counters, and judge them.

    python scripts/studies/gpu.py predict FOLDER    before the measurement
    python scripts/studies/gpu.py judge FOLDER      after it

FOLDER is the folder of `scripts/gpu.sh`. `predict` reads the counters of the reference rasteriser
and writes predicted.csv (a row per case) and hypotheses.csv (the bounds). `judge` reads the
measured runs and writes equality.csv (counters against the reference), judged.csv (a row per
case: measured and predicted time) and decisions.csv (a row per hypothesis).

The law is the maximum of three stages that was fitted to all 35 draws of the H200 on 26 November
2026 (results/reference/h200): vertex batches; covering triangles and helper lanes; quads and
helper lanes. One round of arithmetic costs `ROUND_NS` per lane (the profile of that day).
"""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

STAGES: dict[str, dict[str, float]] = {
    "vertices": {"vertex_batches": 19.9},
    "triangles": {"covering_triangles": 1.96, "helper_lanes": 0.184},
    "pixels": {"quads": 0.264, "helper_lanes": 0.051},
}
"""Nanoseconds of each counter in each stage."""

ROUND_NS = 0.011

CASE = ["scene", "resolution", "samples", "work", "order", "triangulator"]
EXACT = ["triangles", "fragments", "quads", "helper_lanes", "covering_triangles"]
"""Counters that the reference rasteriser counts as well."""

COUNTERS = [*EXACT, "vertex_batches", "transformed_vertices"]
DRIVER = ["vertex_shader_invocations", "clipping_input_primitives", "clipping_output_primitives"]
WALK_BATCHES = (480, 485)


def read_runs(folder: Path, *patterns: str) -> pd.DataFrame:
    """Return the measured cases of all runs in `folder` whose names match, a row per case."""
    files = [file for pattern in patterns for file in folder.glob(f"{pattern}/summary.csv")]
    tables = [pd.read_csv(file) for file in sorted(files)]
    if not tables:
        sys.exit(f"{folder}: no run matches {' or '.join(patterns)}; see scripts/gpu.sh")
    table = pd.concat(tables, ignore_index=True)
    return table[table["status"] == "ok"]


def predict_times(table: pd.DataFrame) -> pd.DataFrame:
    """Return `table` with the nanoseconds of each stage, the law's time and the binding stage."""
    stages = pd.DataFrame(
        {
            stage: sum(cost * table[counter] for counter, cost in costs.items())
            for stage, costs in STAGES.items()
        }
    )
    stages["pixels"] += ROUND_NS * 4 * table["quads"] * table["work"]
    return table.assign(
        **{f"{stage}_ns": stages[stage] for stage in STAGES},
        predicted_ns=stages.max(axis=1),
        stage=stages.idxmax(axis=1),
    )


def divide_by_base(table: pd.DataFrame, column: str, **base: str) -> pd.Series:
    """Return a column divided by that of the case that has the values of `base`, else the same."""
    other_columns = [name for name in CASE if name not in base]
    is_base = (table[list(base)] == list(base.values())).all(axis=1)
    of_base = table[is_base].set_index(other_columns)[column]
    return (
        table[column] / of_base.reindex(pd.MultiIndex.from_frame(table[other_columns])).to_numpy()
    )


def select_rows(table: pd.DataFrame, **where: object) -> pd.DataFrame:
    """Return the rows whose columns equal `where`; by default one sample and no arithmetic."""
    selection = {"samples": 1, "work": 0, **where}
    return table[(table[list(selection)] == list(selection.values())).all(axis=1)]


def compute_errors(measured: pd.Series, predicted: pd.Series) -> pd.Series:
    """Return the relative differences of measured and predicted values."""
    return (measured / predicted - 1).abs()


Decision = tuple[str, float, float]
"""The quantity of a hypothesis, its value, and the largest value with which it holds."""


def decide(table: pd.DataFrame, ns: str, invocations: str) -> Iterator[tuple[int, Decision]]:
    """Yield the quantities of the hypotheses, by number.

    ns : column of the times; invocations : column of the vertex shader's invocations
    """
    letters = select_rows(table, scene="glyphs", resolution=256)
    walk = letters[letters["order"] == "walk"]
    low, high = WALK_BATCHES
    outside = np.maximum(low - walk["vertex_batches"], walk["vertex_batches"] - high).max()
    yield 1, ("batches of a walk outside 480 to 485", float(np.maximum(0.0, outside)), 0.0)
    yield 1, ("slowest over fastest triangulator in a walk", compute_spread(walk[ns]), 0.02)
    over_base = divide_by_base(letters, ns, triangulator="ear-clipping")
    expected = divide_by_base(letters, "predicted_ns", triangulator="ear-clipping")
    flipped = letters["triangulator"].isin(["flips:l1", "earcut-refine"])
    native = flipped & (letters["order"] == "native")
    off = compute_errors(over_base[native], expected[native]).max()
    yield 2, ("native flips over ear clipping against the law", float(off), 0.05)
    shuffled = letters["order"] == "shuffled"
    over_walk = divide_by_base(letters, ns, order="walk")
    expected = divide_by_base(letters, "predicted_ns", order="walk")
    off = compute_errors(over_walk[shuffled], expected[shuffled]).max()
    yield 3, ("shuffled over walk against the law", float(off), 0.10)
    city = select_rows(table, scene="city", resolution=1024)
    off = (divide_by_base(city, ns, order="native") - 1).abs().max()
    yield 4, ("city at 1024 px, an order against the native one", float(off), 0.03)
    off = math.nan
    if invocations in table:
        off = compute_errors(table[invocations], table["transformed_vertices"]).max()
    yield 5, ("vertex shader invocations against transformed vertices", float(off), 0.03)
    plain = select_rows(table)
    yield (
        6,
        (
            "times against the law",
            float(compute_errors(plain[ns], plain["predicted_ns"]).max()),
            0.06,
        ),
    )
    shaded = select_rows(table, scene="city", resolution=1024, work=64)
    saved = divide_by_base(shaded, ns, triangulator="ear-clipping")
    quads = divide_by_base(shaded, "quads", triangulator="ear-clipping")
    off = compute_errors(saved, quads).max()
    yield 7, ("city, 64 rounds: times relative to ear clipping against quads", float(off), 0.03)


def compute_spread(values: pd.Series) -> float:
    """Return the maximum divided by the minimum, minus 1."""
    return float(values.max() / values.min() - 1)


def predict(folder: Path) -> None:
    """Write the predicted times, and the value of each hypothesis if the law holds exactly."""
    table = read_runs(folder, "reference-*")
    table = table[table["rasteriser"] == "opengl"]
    columns = [*CASE, *COUNTERS]
    shaded = [table.assign(work=rounds) for rounds in (16, 64)]
    table = predict_times(pd.concat([table, *(t[t["order"] == "native"] for t in shaded)]))
    columns += [*(f"{stage}_ns" for stage in STAGES), "predicted_ns", "stage"]
    table[columns].round(1).to_csv(folder / "predicted.csv", index=False)
    decisions = decide(table, "predicted_ns", "transformed_vertices")
    write_decisions(folder / "hypotheses.csv", decisions)


def judge(folder: Path) -> None:
    """Compare the measurements with the predictions; print the decisions."""
    measured = read_runs(folder, "orders-*", "work-*", "samples")
    compare_counters(folder, measured)
    table = predict_times(measured)
    table["measured_ns"] = 1e6 * table["draw_ms"]
    table["error"] = table["measured_ns"] / table["predicted_ns"] - 1
    columns = [*CASE, *COUNTERS, *(name for name in DRIVER if name in table)]
    columns += [*(f"{stage}_ns" for stage in STAGES), "predicted_ns", "stage"]
    table[[*columns, "measured_ns", "error"]].to_csv(
        folder / "judged.csv", index=False, float_format="%.5g"
    )
    decisions = [*measure_scatter(folder, measured), *decide(table, "measured_ns", DRIVER[0])]
    write_decisions(folder / "decisions.csv", decisions)
    print((folder / "decisions.csv").read_text(encoding="utf-8"))


def measure_scatter(folder: Path, measured: pd.DataFrame) -> Iterator[tuple[int, Decision]]:
    """Yield the largest difference of two measurements of a case, as hypothesis 0."""
    pairs = measured.merge(read_runs(folder, "again"), on=CASE, suffixes=("", "_again"))
    off = compute_errors(pairs["draw_ms_again"], pairs["draw_ms"]).max()
    yield 0, ("a second measurement against the first", float(off), 0.01)


def compare_counters(folder: Path, measured: pd.DataFrame) -> None:
    """Write the number of cases whose counters equal the reference's, by scene and counter."""
    reference = read_runs(folder, "reference-*")
    reference = reference[reference["rasteriser"] == "reference"]
    pairs = measured.merge(reference, on=CASE, suffixes=("", "_of_reference"))
    result = [
        {"scene": scene, "counter": counter, "cases": len(part), "equal": int(equal.sum())}
        for scene, part in pairs.groupby("scene")
        for counter in EXACT
        for equal in [part[counter] == part[f"{counter}_of_reference"]]
    ]
    pd.DataFrame(result).to_csv(folder / "equality.csv", index=False)


def write_decisions(file: Path, decisions: Iterable[tuple[int, Decision]]) -> None:
    """Write one row per quantity: hypothesis, value, bound, and whether it holds."""
    columns = ["hypothesis", "quantity", "value", "bound", "holds"]
    content = [
        [number, quantity, value, bound, "" if math.isnan(value) else value <= bound]
        for number, (quantity, value, bound) in decisions
    ]
    pd.DataFrame(content, columns=columns).to_csv(file, index=False, float_format="%.4g")


COMMANDS: dict[str, Callable[[Path], None]] = {"predict": predict, "judge": judge}

if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in COMMANDS:
        sys.exit(__doc__)
    COMMANDS[sys.argv[1]](Path(sys.argv[2]))
