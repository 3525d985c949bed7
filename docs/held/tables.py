"""The tables of docs/findings.md, and the figures of its sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import product

import numpy as np

from docs.held.lookups import (
    BEST_FOR_H,
    Row,
    grid,
    matched,
    one,
    percent,
    some,
    text,
    three,
    two,
    values,
    whole,
)
from docs.held.others import alarms
from harness.figures.intervals import Ratio, of_any_run
from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from harness.study.regret import why_no_interval
from scenes import load
from triangulators import criteria, vertices
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.verify import verify

SCENES = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters", "counties": "counties"}


def processor() -> list[str]:
    """Return family, model and vector width of the CPU that times were measured on."""
    cpu = values("reference/llvmpipe/gains-city/run.json")["cpu"]
    return [cpu["family"], cpu["model"], str(cpu["vector_bits"])]


# ---------------------------------------------------------------- what the choice buys

PEERS = (
    "delaunay",
    "earcut-refine",
    "greedy",
    "manifold",
    "optimal:overdraw",
    "optimal:expected-quads",
    "flips:beauty",
    "flips:l1",
    "refined:half-perimeter",
    "optimal:half-perimeter",
    "optimal:calibrated",
)


def gain(scene: str, px: int, name: str, base: str = "ear-clipping", **where: object) -> Row:
    """Return the row of a time in ratio to another triangulator's, on llvmpipe."""
    plain = {"rasteriser": "opengl", "order": "native", "work": 0, "samples": 1, "fit": "box"}
    known = {"scene": scene, "resolution": px, "triangulator": name, "base": base, "rotation": 0}
    return one("llvmpipe/gains/gains.csv", **{**plain, **known, **where})


def ratio(*which: object, **where: object) -> str:
    """Return such a time ratio with two digits."""
    return two(gain(*which, **where)["time_ratio"])  # type: ignore[arg-type]


# ---------------------------------------------------------------- does a criterion predict?

CRITERIA = {
    "expected_quads": "**Q**, expected quads",
    "half_perimeter": "**H**, half-perimeter",
    "edge_length": "E, edge length",
    "overdraw": "**A**, the paper's overdraw",
    "shape": "D, shape deviation",
    "beauty": "B, Blender's beauty",
}


def correlation(
    criterion: str, measure: str, rasteriser: str = "opengl", device: str = "llvmpipe"
) -> Row:
    """Return the rank correlation within a polygon of the city."""
    file = f"{device}/validate-city/correlations.csv"
    where = {"criterion": criterion, "measure": measure, "rasteriser": rasteriser}
    return one(file, statistic="spearman_within", **where)


def predicts() -> list[str]:
    """Return the table of rank correlations within a polygon."""
    columns = (
        *(("helper_lanes", "opengl"), ("partial_quads", "opengl")),
        *(("time_work_0", "opengl"), ("time_work_8", "opengl")),
        *(("bbox_tests", "bounding-box"), ("time_work_0", "bounding-box")),
    )

    def cell(criterion: str, of: tuple[str, str]) -> str:
        row = correlation(criterion, *of)
        top = max(float(correlation(other, *of)["value"]) for other in CRITERIA)
        shown = f"**{three(row['value'])}**" if float(row["value"]) == top else three(row["value"])
        with_ends = of[1] != "bounding-box"
        return shown + f" ({three(row['ci_low'])}-{three(row['ci_high'])})" * with_ends

    return grid(CRITERIA, columns, cell)


def pooled(criterion: str) -> str:
    """Return a criterion's rank correlation with helper lanes over all polygons at once."""
    file = "llvmpipe/validate-city/correlations.csv"
    where = {"rasteriser": "opengl", "measure": "helper_lanes", "statistic": "spearman_pooled"}
    return three(one(file, criterion=criterion, **where)["value"])


def sizes(measure: str) -> Callable[[], list[str]]:
    """Return what makes the table of rank correlations with a counter by the viewport's size."""

    def cell(px: int, of: tuple[str, str]) -> str:
        file = f"cpu/validate-{of[0]}-sizes/correlations_by_resolution.csv"
        where = {"resolution": px, "criterion": of[1], "measure": measure}
        shown = three(one(file, statistic="spearman_within", **where)["value"])
        return f"**{shown}**" if of[1] == "expected_quads" else shown

    columns = tuple(product(("city", "helsinki"), ("expected_quads", "half_perimeter", "overdraw")))
    return lambda: grid({px: f"{px} px" for px in (64, 256, 1024)}, columns, cell)


# ---------------------------------------------------------------- what trusting a criterion costs

TRUSTED = {
    "Q": ("criterion", "expected-quads"),
    "H": ("criterion", "half-perimeter"),
    "`refined`": ("triangulator", "refined:half-perimeter"),
    "E": ("criterion", "edge-length"),
    "A": ("criterion", "overdraw"),
    "Delaunay": ("triangulator", "delaunay"),
    "`flips:beauty`": ("triangulator", "flips:beauty"),
    "D": ("criterion", "shape"),
    "ear clipping": ("triangulator", "ear-clipping"),
}


def regret(place: str, scene: str, px: int, who: str, measure: str) -> Row:
    """Return the row of what trusting a criterion, or a triangulator, costs."""
    kind, name = TRUSTED[who]
    file = f"{place}/regret-{scene}/regret.csv"
    return one(file, resolution=px, measure=measure, kind=kind, name=name)


def _regret_cell(row: Row, signed: bool = False) -> str:
    low, high = row["ci_low"], row["ci_high"]
    between = " to " if signed else "-"
    digits = 2 if not signed and float(row["mean"]) < 0.001 else None
    if not low:
        told = {name: float(row[name]) for name in ("polygons", "mean", "worst")}
        return f"{percent(row['mean'], digits)} % ({why_no_interval(told)})"
    low, high = percent(low, digits), percent(high, digits)
    return f"{percent(row['mean'], digits)} % ({low}{between}{high})"


def regrets(*scenes: str) -> Callable[[], list[str]]:
    """Return what makes the table of helper lanes above the fewest there are."""
    labels = {who: f"**{who}**" if who == "Q" else who for who in TRUSTED}
    views = tuple(product(scenes, (256, 1024)))
    return lambda: grid(
        labels, views, lambda who, of: _regret_cell(regret("cpu", *of, who, "helper_lanes"))
    )


def quads_regret(px: int, who: str, scenes: Iterable[str] = SCENES) -> list[float]:
    """Return the mean regret in quads of each scene."""
    return [float(regret("cpu", scene, px, who, "quads")["mean"]) for scene in scenes]


def of_the_paper() -> list[str]:
    """Return partial quads of the paper's worst by A beside its best: of all, of conforming."""
    (polygon,) = make_frame(load("paper").polygons, View(512)).polygons
    corners = vertices(polygon)
    points = np.rint(corners * 256.0).astype(np.int32)
    ways = [
        (
            criteria.predict(corners, triangles)["overdraw"],
            float(predict(points, triangles)["partial_quads"].sum()),
            verify(polygon, triangles).conforming,
        )
        for triangles in enumerate_triangulations(polygon, "paper")
    ]
    found = []
    for few in (ways, [way for way in ways if way[2]]):
        (_, best, _), (_, worst_one, _) = min(few), max(few)
        found.append(two(worst_one / best))
    return found


def orders() -> list[str]:
    """Return the table of times in three orders of triangles."""
    labels = {
        "optimal:half-perimeter": "**best for H**",
        "refined:half-perimeter": "`refined`",
        "greedy": "greedy",
        "optimal:expected-quads": "best for Q",
        "optimal:overdraw": "best for A",
        "delaunay": "Delaunay",
    }
    columns = tuple(product(SCENES, ("own", "vertex-cache", "walk")))
    return grid(labels, columns, lambda name, of: three(ordered(of[0], name)[of[1]]), "column")


def ordered(scene: str, name: str, base: str = "ear-clipping") -> Row:
    """Return the row of times in ratio to another triangulator's, by order of triangles."""
    file = "llvmpipe/orders/orders.csv"
    return one(file, scene=scene, triangulator=name, base=base, resolution=1024)


DEVICES = {
    "opengl-llvmpipe": "llvmpipe by OpenGL",
    "webgpu-lavapipe": "lavapipe by WebGPU",
    "swiftshader-chromium": "SwiftShader in Chromium",
    "opengl-softpipe": "softpipe",
}
SHOWN = (
    "optimal:half-perimeter",
    "refined:half-perimeter",
    "optimal:expected-quads",
    "optimal:overdraw",
    "delaunay",
)


def device_view(device: str, scene: str) -> dict:  # type: ignore[type-arg]
    """Return what a device measured of a scene at 1024 px."""
    views = values(f"devices/{device}.json")["views"]
    return next(v for v in views if v["scene"] == scene and v["resolution"] == 1024)


def on_devices() -> list[str]:
    """Return the table of times on other rasterisers."""
    labels = {
        (device, scene): f"{SCENES[scene]}: {label}"
        for scene in ("city", "helsinki")
        for device, label in DEVICES.items()
    }
    return grid(
        labels,
        SHOWN,
        lambda of, name: two(device_view(*of)["triangulators"][name]["time"][0]),
        "row",
        lambda of: [
            two(device_view(*of)["ranks"][name]) for name in list(CRITERIA)[:2] + ["overdraw"]
        ],
    )


def of(file: str, name: str, px: int = 1024) -> Row:
    """Return the row of a run's summary on llvmpipe."""
    return one(f"llvmpipe/{file}/summary.csv", triangulator=name, resolution=px)


REFINED = "refined:half-perimeter"
CALIBRATED = "optimal:calibrated"


def drawn(scene: str, px: int, name: str) -> float:
    """Return the time in ratio to ear clipping's."""
    return float(gain(scene, px, name)["time_ratio"])


def choice() -> list[str]:
    """Return the table of draw times in ratio to ear clipping's."""
    views = {(s, px): f"{name}, {px}" for s, name in SCENES.items() for px in (256, 1024, 4096)}
    return grid(
        views,
        PEERS,
        lambda of, name: three(drawn(*of, name)),
        "row",
        lambda of: [three(gain(*of, CALIBRATED, "delaunay")["time_ratio"])],
    )


def run_of(scene: str) -> str:
    """Return the file of a scene's draw times."""
    return f"llvmpipe/gains-{scene}/summary.csv"


def time_ratio(row: Row) -> tuple[float, float, float]:
    """Return a row's ratio of times with its interval, which holds how much runs scatter.

    The files behind findings.md were written before an interval held that.
    """
    low, middle, high = (float(row[f"time_ratio{end}"]) for end in ("_low", "", "_high"))
    found = of_any_run(Ratio(middle, low, high, 0))
    return found.value, found.low, found.high


def widest(small: bool) -> str:
    """Return the half width of the widest interval of the table of draw times.

    small : of scenes but counties up to 1024 px; of all other views otherwise
    """
    halves = []
    for scene in SCENES:
        for row in some(run_of(scene)):
            is_small = scene != "counties" and row["resolution"] in ("256", "1024")
            shown = row["resolution"] in ("256", "1024", "4096") and row["triangulator"] in PEERS
            if shown and is_small == small:
                _, low, high = time_ratio(row)
                halves.append(high - low)
    return f"{math.ceil(500 * max(halves)) / 1000:.3f}"


def predicted_lanes() -> list[tuple[str, float, float, float]]:
    """Return (scene, predicted by 4Q - S, by H + T, counted), each in ratio to ear clipping's.

    One row for each triangulator of `gains-<scene>` at 256, 1024 and 4096 px that draws all
    polygons.
    """
    found = []
    for scene in SCENES:
        rows = some(run_of(scene))
        for px in (256, 1024, 4096):
            view = {row["triangulator"]: row for row in rows if row["resolution"] == str(px)}
            base = view["ear-clipping"]
            for name, row in view.items():
                if name == "ear-clipping" or row["status"] != "ok":
                    continue
                if row["helper_lanes"] and row["polygons"] == base["polygons"]:
                    by_quads, by_length, counted = (
                        of(row) / of(base)
                        for of in (
                            lambda r: 4.0 * float(r["expected_quads"]) - float(r["fragments"]),
                            lambda r: float(r["half_perimeter"]) + float(r["triangles"]),
                            lambda r: float(r["helper_lanes"]),
                        )
                    )
                    found.append((scene, by_quads, by_length, counted))
    return found


def error_of_prediction(column: int) -> str:
    """Return the root mean square error of predicted lanes, in per cent, of a column of theirs."""
    squares = [math.log(row[column] / row[3]) ** 2 for row in predicted_lanes()]
    return f"{100.0 * math.expm1(math.sqrt(sum(squares) / len(squares))):.1f}"


def slower(scene: str) -> float:
    """Return by how much more time the drawings of `refined` take than those of the best for H."""
    row = gain(scene, 1024, "refined:half-perimeter", BEST_FOR_H)
    return float(row["time_ratio"]) - 1


def rotated(name: str, column: str, base: str = "ear-clipping") -> list[float]:
    """Return a column in ratio to a triangulator's, by angle."""
    file = "llvmpipe/gains-rotation/summary.csv"
    angles = sorted({float(row["rotation"]) for row in some(file)})
    return [
        float(one(file, triangulator=name, rotation=angle)[column])
        / float(one(file, triangulator=base, rotation=angle)[column])
        for angle in angles
    ]


def fronts(rasteriser: str) -> Counter[str]:
    """Count the verdicts on points of the city's fronts that are not their end."""
    rows = some("llvmpipe/pareto-city/pareto.csv", rasteriser=rasteriser, kind="front")
    return Counter(row["verdict"] for row in rows if row["same_as_end"] != "True")


def again() -> tuple[str, str, str]:
    """Return how many correlations with counters there are, how many are equal in both runs, and
    by how much those with times differ at most.
    """
    first = rows_by_key("llvmpipe/validate-city/correlations.csv")
    second = rows_by_key("llvmpipe/validate-city-again/correlations.csv")
    counters = [key for key in first if first[key] and not key[3].startswith("time")]
    equal = sum(first[key] == second[key] for key in counters)
    apart = max(
        abs(float(first[key]) - float(second[key]))
        for key in first
        if key[3].startswith("time") and key[4] == "spearman_within" and first[key] and second[key]
    )
    return whole(len(counters)), whole(equal), three(apart)


def rows_by_key(file: str) -> dict[tuple[str, ...], str]:
    """Return the values of a table of correlations by what they are of."""
    key = ("rasteriser", "device", "criterion", "measure", "statistic")
    return {tuple(row[name] for name in key): row["value"] for row in some(file)}


def on_the_device() -> list[str]:
    """Return how many footprints, and how often the scenes' rings, a device solved."""
    file = "llvmpipe/optimum-equality.txt"
    solved = [line.split()[-2] for line in text(file).splitlines() if " px, " in line]
    total = sum(int(each.replace(",", "")) for each in solved)
    return [*matched(file, r"footprints on the device: ([\d,]+)"), f"{total:,}"]


def holding() -> list[str]:
    """Return how many findings hold on each data set."""
    names = ("poly2tri-testbed", "earcut-fixtures", "helsinki-areas", "cad")
    return [matched("llvmpipe/study/findings.md", rf"\| {name} \| (\d+) \|")[0] for name in names]


def called() -> list[str]:
    """Return pairs of equal code, those called a regression, slower ones, and those found."""
    equal, wrongly, _, found, changed = alarms()
    return [equal, wrongly, changed, found]


def worst(scene: str, who: str) -> str:
    """Return a regret in helper lanes at 1024 px in per cent."""
    return percent(regret("cpu", scene, 1024, who, "helper_lanes")["mean"])


def own_order_costs() -> list[str]:
    """Return by how many per cent Delaunay's own order is slower than a walk, by scene."""
    rows = (ordered(scene, "delaunay") for scene in SCENES)
    return [f"{100.0 * (float(row['own']) / float(row['walk']) - 1.0):.0f}" for row in rows]


def work(name: str, work: int, samples: int) -> str:
    """Return the time in ratio to ear clipping's with more work a fragment, or more samples."""
    return ratio("city", 1024, name, work=work, samples=samples)


def boxes(name: str, px: int, rasteriser: str = "bounding-box") -> str:
    """Return the time in ratio to ear clipping's on a rasteriser of ours."""
    return ratio("city", px, name, rasteriser=rasteriser)


def limit() -> list[str]:
    """Return lanes of the city in one piece, by the best for H and by ear clipping, and what the
    choice saves of the diagonals' price, in per cent.
    """
    best, clipped = (of("gains-city", name) for name in (BEST_FOR_H, "ear-clipping"))
    outline = 4.0 * float(best["outline_quads"]) - float(best["fragments"])
    lanes = [float(best["helper_lanes"]), float(clipped["helper_lanes"])]
    saved = (lanes[1] - lanes[0]) / (lanes[1] - outline)
    return [whole(outline), *map(whole, lanes), percent(saved)]
