"""Compare the laws of profiles with measured draws of scenes that they were not fitted to.

    PYTHONPATH=. python scripts/studies/accuracy.py count SCENE...
    PYTHONPATH=. python scripts/studies/accuracy.py compare

`count` triangulates scenes of docs/studies/gpu.md as they were drawn on an H200, and writes
results/reference/h200/counters-<scene>.csv: all counters of each triangulation in its native order.

`compare` writes results/reference/law-accuracy.csv from files of results/reference alone: the
measurements of the H200, and <profile>-draws.csv.xz of software devices, which
`scripts/studies/profiles.py` measures. A row for each profile and set of draws: `SETS` of the H200;
all draws, or those of one scene, of software devices. Columns:

compared, relative_rms : draws by other triangulators than ear clipping; root mean square error of
    predicted times relative to ear clipping's
large, signs : draws whose time differs from ear clipping's by more than 3 %, and the number of
    these that the law predicts to differ in the same direction
draws, absolute_rms : all draws, and the root mean square error of predicted times. On software
    devices the time of an empty draw is measured, and the other predicted times are multiplied by a
    common factor for the speed of the machine
additive_... : for the H200, the same for the additive law (additive-law-h200.csv) that commit
    94a2d01c fitted to the same stored times

`compare` also writes law-arithmetic.csv: for each form of law, a fit to the designed draws of the
H200 and to the city with arithmetic at one size (`ARITHMETIC_FITTED`). Columns: held_out, the error
of held-out groups; chosen, whether `law.fit` chooses the form; lane_ps, picoseconds of a round in a
lane; draws, relative_rms, absolute_rms of the city with arithmetic at the other sizes.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.frame import View, make_scene_frame
from harness.measuring.plan import load_scene
from harness.profile import law
from harness.profile.cost_terms import TERMS, count_cost_terms, make_design_rows
from harness.progress import Reporter
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scripts.studies.profiles import TRIANGULATORS as STUDIED
from scripts.studies.profiles import scale_prediction

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
H200, PROFILES = REFERENCE / "h200", REFERENCE / "profiles"

SIZES = {"city": (256, 1024, 4096), "glyphs": (256, 1024, 4096), "cad": (256,)}
"""Sizes in px at which counters are compared with measured times, by scene."""

TRIANGULATORS = (
    *("ear-clipping", "earcut-refine", "flips:l1", "delaunay", "refined", "optimal:overdraw"),
    *("optimal:half-perimeter", "optimal:expected-quads", "worst:half-perimeter"),
)
UNMEASURED = {"cad": ("earcut-refine", "flips:l1")}

SETS = ("first", "extended", "second", "shuffled", "arithmetic")
"""Draws of the H200: those of 26 November 2026 for the city and letters up to 1024 px, and with
letters at 4096 px and cad at 256 px; those of 27 November without arithmetic in orders that are not
shuffled, shuffled, and those with arithmetic."""

ARITHMETIC_FITTED = 1024
"""Size in px of the draws with arithmetic that a law is fitted to."""

LARGE = 0.03
"""Relative difference from ear clipping whose sign a law should predict."""

COMPARED = ("relative_rms", "signs", "absolute_rms")
"""Errors that are also given for the additive law."""

VIEW = ["scene", "resolution", "order", "rounds"]
"""Columns that the draws have in common which are compared with each other."""

Costs = dict[str, float]


def count_scene(scene_name: str) -> Path:
    """Write the counters of a scene's triangulations; return the file."""
    scene = load_scene(scene_name, 0, Reporter(quiet=True))
    rows = []
    for resolution in SIZES[scene_name]:
        frame = make_scene_frame(scene, View(resolution))
        for name in TRIANGULATORS:
            if name not in UNMEASURED.get(scene_name, ()):
                recipe = parse(name)
                result = triangulate_polygons(recipe, frame.polygons)
                case = {"scene": scene_name, "resolution": resolution, "triangulator": str(recipe)}
                rows.append(case | count_cost_terms(frame, frame.join_triangles(result.parts)))
    file = H200 / f"counters-{scene_name}.csv"
    pd.DataFrame(rows).to_csv(file, index=False)
    return file


def read_gpu_draws() -> dict[str, pd.DataFrame]:
    """Return the sets of draws of an H200 by name: `VIEW`, triangulator, counters and `seconds`."""
    counters = pd.concat(pd.read_csv(H200 / f"counters-{scene}.csv") for scene in SIZES)
    of_first_day = [
        pd.read_csv(H200 / f"gains-{scene}/summary.csv") for scene in ("city", "glyphs")
    ]
    first = pd.concat(of_first_day).assign(order="native", rounds=0)
    more = [
        pd.read_csv(H200 / f"equality-{scene}/summary.csv").query(
            f"rasteriser == 'opengl' and resolution == {resolution}"
        )
        for scene, resolution in (("glyphs", 4096), ("cad", 256))
    ]
    extended = pd.concat([first, *more]).assign(order="native", rounds=0)
    second = pd.read_csv(H200 / "judged.csv").rename(columns={"work": "rounds"})
    second = second.assign(draw_ms=1e-6 * second["measured_ns"])
    shuffled = second["order"] == "shuffled"
    plain = second["rounds"] == 0
    tables = (
        *(first, extended, second[plain & ~shuffled], second[plain & shuffled]),
        second[~plain],
    )
    sets = dict(zip(SETS, tables, strict=True))
    return {name: join_counters(table, counters) for name, table in sets.items()}


def join_counters(measured: pd.DataFrame, counters: pd.DataFrame) -> pd.DataFrame:
    """Return measured draws with all counters; vertex batches are those of the drawn order."""
    case = ["scene", "resolution", "triangulator"]
    recorded = [name for name in ("vertex_batches", "transformed_vertices") if name in measured]
    columns = [*VIEW, "triangulator", "draw_ms", "fragments", "helper_lanes", *recorded]
    table = measured[columns].merge(counters, on=case, suffixes=("", "_counted"))
    for name in ("fragments", "helper_lanes"):
        if len(table) != len(measured) or (table[name] != table[f"{name}_counted"]).any():
            sys.exit(f"counters of {name} differ from those measured; run `count` again")
    work = 4 * table["quads"] * table["rounds"]
    return table.assign(seconds=1e-3 * table["draw_ms"], work=work)


def read_software_draws(profile: str) -> dict[str, pd.DataFrame]:
    """Return the draws of polygons on a software device, all and by scene.

    Each polygon is a view of its own, so that its triangulations are compared with each other.
    """
    table = pd.read_csv(PROFILES / f"{profile}-draws.csv.xz")
    table = table[table["triangulator"].isin(STUDIED)]
    polygon = table["scene"] + " " + table["polygon"].astype(str)
    view = {"scene": polygon, "resolution": 512, "order": "walk", "rounds": 0, "work": 0}
    table = table.assign(source=table["scene"], **view)
    return {"all": table} | dict(list(table.groupby("source", sort=False)))


def read_law(profile: str) -> tuple[str, Costs]:
    """Return the form and the costs of a profile's law."""
    content = json.loads((PROFILES / f"{profile}.json").read_text(encoding="utf-8"))
    return content["form"], {term["name"]: term["cost"] for term in content["terms"]}


def predict_by_form(form: str, costs: Costs, table: pd.DataFrame) -> NDArray[np.float64]:
    """Return the seconds of each draw by a law of one of `law.FORMS`."""
    rows = make_design_rows(table.to_dict("records"))
    return law.predict_times(rows, np.array([costs[name] for name in TERMS]), form)


def predict_by_sum(costs: Costs, table: pd.DataFrame) -> NDArray[np.float64]:
    """Return the seconds of each draw by an additive law; older laws have other terms."""
    columns = table.assign(
        draw=1.0, half_perimeter=table["half_perimeter"] / 256, near=table["near"] / 256
    )
    return np.asarray(columns[list(costs)].to_numpy() @ np.array(list(costs.values())), float)


def measure_errors(table: pd.DataFrame, predicted: NDArray[np.float64]) -> dict[str, object]:
    """Return the errors of predicted seconds; see the columns in the module's description."""
    times = table[[*VIEW, "triangulator", "seconds"]].assign(predicted=predicted)
    base = times[times["triangulator"] == "ear-clipping"].set_index(VIEW)
    of_base = base.reindex(pd.MultiIndex.from_frame(times[VIEW]))
    ratio = times["seconds"].to_numpy() / of_base["seconds"].to_numpy()
    expected = predicted / of_base["predicted"].to_numpy()
    compared = (times["triangulator"] != "ear-clipping").to_numpy() & ~np.isnan(ratio)
    large = compared & (np.abs(ratio - 1) > LARGE)
    return {
        "compared": int(compared.sum()),
        "relative_rms": root_mean_square((expected / ratio - 1)[compared]),
        "large": int(large.sum()),
        "signs": int((np.sign(ratio - 1) == np.sign(expected - 1))[large].sum()),
        "draws": len(times),
        "absolute_rms": root_mean_square(predicted / times["seconds"].to_numpy() - 1),
    }


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt((values**2).mean()))


def compare_laws() -> Iterator[dict[str, object]]:
    """Yield a row for each profile and set of draws."""
    (additive,) = pd.read_csv(PROFILES / "additive-law-h200.csv").to_dict("records")
    form, costs = read_law("opengl-h200")
    for name, table in read_gpu_draws().items():
        errors = measure_errors(table, predict_by_form(form, costs, table))
        of_sum = measure_errors(table, predict_by_sum(additive, table))
        additive_errors = {f"additive_{key}": of_sum[key] for key in COMPARED}
        yield {"profile": "opengl-h200", "form": form, "set": name} | errors | additive_errors
    for file in sorted(PROFILES.glob("*-draws.csv.xz")):
        profile = file.name.removesuffix("-draws.csv.xz")
        form, costs = read_law(profile)
        for name, table in read_software_draws(profile).items():
            predicted = predict_by_form(form, costs, table) - costs["draw"]
            errors = measure_errors(table, scale_to_session(table, predicted))
            yield {"profile": profile, "form": form, "set": name} | errors


def scale_to_session(table: pd.DataFrame, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return predicted seconds with the time of an empty draw, and the speed, of the session.

    predicted : without the cost of the draw itself
    """
    result = np.empty(len(table))
    for source in table["source"].unique():
        rows = (table["source"] == source).to_numpy()
        seconds, empty = table["seconds"].to_numpy()[rows], float(table["empty_s"][rows].iloc[0])
        result[rows] = scale_prediction(seconds, empty, predicted[rows])[0]
    return result


def compare_forms() -> Iterator[dict[str, object]]:
    """Yield a row for each form of law that is fitted to draws with arithmetic."""
    content = json.loads((PROFILES / "opengl-h200.json").read_text(encoding="utf-8"))
    stored = [row for row in content["times"] if row["kind"] != "twice"]
    city = read_gpu_draws()["arithmetic"]
    is_fitted = city["resolution"] == ARITHMETIC_FITTED
    part, rest = city[is_fitted], city[~is_fitted]
    seconds = np.exp([np.log(row["epochs"]).mean() for row in stored])
    rows = make_design_rows([*(row["counters"] for row in stored), *part.to_dict("records")])
    groups = [*(row["group"] for row in stored), *("city " + part["triangulator"])]
    times = np.r_[seconds, part["seconds"]]
    fitted = law.fit_law(rows, times[None], groups)
    labels = np.unique(groups, return_inverse=True)[1]
    for form in law.FORMS:
        costs, _ = law.fit_form(rows, times, labels, form)
        predicted = law.predict_times(make_design_rows(rest.to_dict("records")), costs, form)
        errors = measure_errors(rest, predicted)
        yield {
            "form": form,
            "stages": len(law.FORMS[form]),
            "held_out": fitted.errors[form],
            "chosen": form == fitted.form,
            "lane_ps": 1e12 * costs[list(TERMS).index("work")],
        } | {name: errors[name] for name in ("draws", "relative_rms", "absolute_rms")}


def main() -> None:
    """Run the command of the first argument."""
    command, *names = sys.argv[1:] or [""]
    if command == "count" and names:
        for name in names:
            print(count_scene(name))
    elif command == "compare":
        for name, rows in (("accuracy", compare_laws()), ("arithmetic", compare_forms())):
            file = REFERENCE / f"law-{name}.csv"
            pd.DataFrame(rows).convert_dtypes().to_csv(file, index=False, float_format="%.5f")
            print(file)
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
