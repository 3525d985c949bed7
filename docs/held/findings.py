"""The figures of docs/findings.md."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable

from docs.held import Held, Sentence, Table
from docs.held.lookups import (
    Row,
    bold,
    matched,
    one,
    percent,
    some,
    table_row,
    three,
    two,
    values,
    whole,
)
from docs.held.others import alarms, apart, states

SCENES = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters", "counties": "counties"}

# ---------------------------------------------------------------- what the choice buys

PEERS = (
    "delaunay",
    "greedy",
    "manifold",
    "optimal:overdraw",
    "optimal:expected-quads",
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


def _some_gains(scene: str, px: int, base: str = "ear-clipping") -> dict[str, float]:
    found = {}
    for name in PEERS:
        rows = some(
            "llvmpipe/gains/gains.csv",
            scene=scene,
            resolution=px,
            triangulator=name,
            base=base,
            rasteriser="opengl",
            order="native",
            work=0,
            samples=1,
            fit="box",
            rotation=0,
        )
        if rows:
            found[name] = float(rows[0]["time_ratio"])
    return found


# ---------------------------------------------------------------- does a criterion predict?

CRITERIA = {
    "expected_quads": "**Q**, expected quads",
    "half_perimeter": "**H**, half-perimeter",
    "edge_length": "E, edge length",
    "overdraw": "**A**, the paper's overdraw",
    "shape": "D, shape deviation",
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
        ("helper_lanes", "opengl", True),
        ("time_work_0", "opengl", True),
        ("time_work_8", "opengl", True),
        ("bbox_tests", "bounding-box", False),
        ("time_work_0", "bounding-box", False),
    )
    cells: dict[str, list[str]] = {name: [] for name in CRITERIA}
    for measure, rasteriser, with_interval in columns:
        found = {name: correlation(name, measure, rasteriser) for name in CRITERIA}
        top = max(float(row["value"]) for row in found.values())
        for name, row in found.items():
            cell = three(row["value"])
            if float(row["value"]) == top:
                cell = f"**{cell}**"
            if with_interval:
                cell += f" ({three(row['ci_low'])}-{three(row['ci_high'])})"
            cells[name].append(cell)
    return [table_row(label, *cells[name]) for name, label in CRITERIA.items()]


def _pooled(criterion: str) -> str:
    file = "llvmpipe/validate-city/correlations.csv"
    where = {"rasteriser": "opengl", "measure": "helper_lanes", "statistic": "spearman_pooled"}
    return three(one(file, criterion=criterion, **where)["value"])


def sizes() -> list[str]:
    """Return the table of rank correlations with helper lanes by the size of the viewport."""
    lines = []
    for px in (64, 256, 1024):
        cells = []
        for scene in ("city", "helsinki"):
            file = f"cpu/validate-{scene}-sizes/correlations_by_resolution.csv"
            for criterion in ("expected_quads", "half_perimeter", "overdraw"):
                row = one(
                    file,
                    criterion=criterion,
                    measure="helper_lanes",
                    rasteriser="reference",
                    statistic="spearman_within",
                    resolution=px,
                )
                cells.append(three(row["value"]))
        lines.append(table_row(f"{px} px", *bold(cells, {0, 3})))
    return lines


# ---------------------------------------------------------------- what trusting a criterion costs

TRUSTED = {
    "Q": ("criterion", "expected-quads"),
    "H": ("criterion", "half-perimeter"),
    "`refined`": ("triangulator", "refined:half-perimeter"),
    "E": ("criterion", "edge-length"),
    "A": ("criterion", "overdraw"),
    "Delaunay": ("triangulator", "delaunay"),
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
    low, high = percent(low, digits), percent(high, digits)
    return f"{percent(row['mean'], digits)} % ({low}{between}{high})"


def regrets(*scenes: str) -> Callable[[], list[str]]:
    """Return what makes the table of helper lanes above the fewest there are."""

    def lines() -> list[str]:
        return [
            table_row(
                f"**{who}**" if who == "Q" else who,
                *(
                    _regret_cell(regret("cpu", scene, px, who, "helper_lanes"))
                    for scene in scenes
                    for px in (256, 1024)
                ),
            )
            for who in TRUSTED
        ]

    return lines


def regrets_of_times() -> list[str]:
    """Return the table of times above the best."""
    lines = []
    for device in ("llvmpipe", "zink"):
        for who in ("H", "`refined`", "Q", "E", "A", "D", "Delaunay", "ear clipping"):
            cells = [
                _regret_cell(regret(device, scene, px, who, "time_work_0"), signed=True)
                for px in (256, 1024)
                for scene in ("city", "helsinki", "glyphs")
            ]
            lines.append(table_row(f"{device}: {f'**{who}**' if who == 'H' else who}", *cells))
    return lines


def _quads_regret(px: int, who: str, scenes: Iterable[str] = SCENES) -> list[tuple[float, float]]:
    found = [regret("cpu", scene, px, who, "quads") for scene in scenes]
    return [(float(row["mean"]), float(row["ci_high"])) for row in found]


# ---------------------------------------------------------------- other tables

TERMS = {
    ("expected_blocks",): "P",
    ("half_perimeter", "expected_blocks"): "H + P",
    ("half_perimeter", "expected_blocks", "expected_setups"): "**H + P + R**",
    None: "all eight",
    ("area",): "S",
    ("area", "half_perimeter"): "S + H",
    ("triangles", "area", "half_perimeter"): "**T + S + H**",
}


def terms() -> list[str]:
    """Return the table of the fewest terms that predict a draw's time."""
    fits = [
        fit
        for name in ("four-scenes", "three-terms")
        for fit in values(f"reference/llvmpipe/calibration/{name}.json")["models"]
    ]
    lines = []
    for wanted, label in TERMS.items():
        fit = next(
            fit
            for fit in fits
            if (len(fit["terms"]) == 8 if wanted is None else set(fit["terms"]) == set(wanted))
        )
        low, high = fit["regret_ci95"]
        shown = f"{percent(fit['regret'], 2)} % ({percent(low, 2)} to {percent(high, 2)})"
        of = (three(fit["r2_over_polygons"]), three(fit["r2_within_polygons"]))
        lines.append(table_row(label, *of, shown))
    return lines


def _coefficient(file: str, name: str, unit: float, digits: int = 0) -> tuple[str, str, str]:
    fit = values(file)
    low, high = fit["intervals"][name]
    mean = fit["coefficients"][name]
    return tuple(f"{value / unit:.{digits}f}" for value in (mean, low, high))  # type: ignore[return-value]


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
    columns = [(scene, order) for scene in SCENES for order in ("own", "vertex-cache", "walk")]
    found = {name: [three(_ordered(scene, name)[o]) for scene, o in columns] for name in labels}
    least = [min(cells[place] for cells in found.values()) for place in range(len(columns))]
    return [
        table_row(
            label, *bold(found[name], {p for p, c in enumerate(found[name]) if c == least[p]})
        )
        for name, label in labels.items()
    ]


def _ordered(scene: str, name: str) -> Row:
    file = "llvmpipe/orders/orders.csv"
    return one(file, scene=scene, triangulator=name, base="ear-clipping", resolution=1024)


def extremes() -> list[str]:
    """Return the table of the worst by A in ratio to the best by A, on the paper's polygon."""
    lines = []
    for among, label in (("all", "as the paper"), ("conforming", "conforming alone")):

        def measured(device: str, rasteriser: str, measure: str, among: str = among) -> Row:
            file = f"{device}/validate-paper/extremes.csv"
            where = {"criterion": "overdraw", "among": among, "measure": measure}
            return one(file, rasteriser=rasteriser, **where)

        tests = measured("llvmpipe", "bounding-box", "bbox_tests")
        lines.append(
            table_row(
                label,
                two(tests["predicted_ratio"]),
                two(tests["ratio"]),
                two(measured("llvmpipe", "bounding-box", "time_work_0")["ratio"]),
                two(measured("llvmpipe", "opengl", "helper_lanes")["ratio"]),
                three(measured("llvmpipe", "opengl", "quads")["ratio"]),
                two(measured("llvmpipe", "opengl", "time_work_0")["ratio"]),
                two(measured("zink", "opengl", "time_work_0")["ratio"]),
                two(measured("osmesa", "osmesa", "time_work_0")["ratio"]),
            )
        )
    return lines


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
    lines = []
    for scene in ("city", "helsinki"):
        for device, label in DEVICES.items():
            view = device_view(device, scene)
            cells = [two(view["triangulators"][name]["time"][0]) for name in SHOWN]
            best = {place for place, cell in enumerate(cells) if cell == min(cells)}
            ranks = [
                two(view["ranks"][c]) for c in ("expected_quads", "half_perimeter", "overdraw")
            ]
            lines.append(table_row(f"{SCENES[scene]}: {label}", *bold(cells, best), *ranks))
    return lines


# ---------------------------------------------------------------- sentences


def _of(file: str, name: str, px: int = 1024) -> Row:
    return one(f"llvmpipe/{file}/summary.csv", triangulator=name, resolution=px)


BEST_FOR_H = "optimal:half-perimeter"
REFINED = "refined:half-perimeter"
CALIBRATED = "optimal:calibrated"

_FILES = {"counties": "gains-counties-refined"}
"""Runs of scenes on the CPU that the others were drawn on, where it is not `gains-<scene>`."""


def drawn(scene: str, px: int, name: str) -> float:
    """Return the time in ratio to ear clipping's, on the CPU that most scenes were drawn on."""
    if scene == "counties":
        return float(one(run_of(scene), triangulator=name, resolution=px)["time_ratio"])
    return float(gain(scene, px, name)["time_ratio"])


def _xeon_row(scene: str, px: int) -> list[float | None]:
    if scene != "counties":
        return [float(gain(scene, px, name)["time_ratio"]) for name in PEERS]
    has = {row["triangulator"] for row in some(run_of(scene))}
    return [drawn(scene, px, name) if name in has else None for name in PEERS]


def choice() -> list[str]:
    """Return the table of draw times in ratio to ear clipping's."""
    lines = []
    for scene, label in SCENES.items():
        for px in (256, 1024, 4096):
            found = _xeon_row(scene, px)
            least = min(three(value) for value in found if value is not None)
            cells = ["" if value is None else three(value) for value in found]
            over = three(_some_gains(scene, px, "delaunay")[CALIBRATED]) if all(cells) else ""
            best = {place for place, cell in enumerate(cells) if cell == least}
            lines.append(table_row(f"{label}, {px}", *bold(cells, best), over))
    return lines


def counties() -> list[str]:
    """Return the table of draw times of counties, on another CPU."""
    lines = []
    for px in (256, 1024, 4096):
        found = _some_gains("counties", px)
        cells = [three(found[name]) for name in PEERS if name != REFINED]
        best = {place for place, cell in enumerate(cells) if cell == min(cells)}
        over = three(_some_gains("counties", px, "delaunay")[CALIBRATED])
        lines.append(table_row(str(px), *bold(cells, best), over))
    return lines


def run_of(scene: str) -> str:
    """Return the file of a scene's draw times, on the CPU that most scenes were drawn on."""
    return f"llvmpipe/{_FILES.get(scene, f'gains-{scene}')}/summary.csv"


def _widest(largest: bool) -> str:
    """Return the half width of the widest interval of the table of draw times."""
    halves = []
    sizes = ("4096",) if largest else ("256", "1024")
    for scene in SCENES:
        for row in some(run_of(scene)):
            if row["triangulator"] in PEERS and row["resolution"] in sizes:
                low, high = float(row["time_ratio_low"]), float(row["time_ratio_high"])
                halves.append((high - low) / 2)
    return two(max(halves))


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
                    counted = float(row["helper_lanes"]) / float(base["helper_lanes"])
                    found.append(
                        (scene, _lanes(row) / _lanes(base), _first(row) / _first(base), counted)
                    )
    return found


def _lanes(row: Row) -> float:
    return 4.0 * float(row["expected_quads"]) - float(row["fragments"])


def _first(row: Row) -> float:
    return float(row["half_perimeter"]) + float(row["triangles"])


def error_of_prediction(column: int) -> str:
    """Return the root mean square error of predicted lanes, in per cent, of a column of theirs."""
    squares = [math.log(row[column] / row[3]) ** 2 for row in predicted_lanes()]
    return f"{100.0 * math.expm1(math.sqrt(sum(squares) / len(squares))):.1f}"


def _slower(scene: str) -> float:
    return drawn(scene, 1024, REFINED) / drawn(scene, 1024, BEST_FOR_H) - 1.0


def _rotated(name: str, column: str, base: str = "ear-clipping") -> list[float]:
    file = "llvmpipe/gains-rotation/summary.csv"
    angles = sorted({float(row["rotation"]) for row in some(file)})
    return [
        float(one(file, triangulator=name, rotation=angle)[column])
        / float(one(file, triangulator=base, rotation=angle)[column])
        for angle in angles
    ]


def _turned(name: str) -> list[float]:
    file = "llvmpipe/gains-rotation/summary.csv"
    return [float(row["time_ratio"]) for row in some(file, triangulator=name)]


def _fronts(rasteriser: str) -> Counter[str]:
    rows = some("llvmpipe/pareto-city/pareto.csv", rasteriser=rasteriser, kind="front")
    return Counter(row["verdict"] for row in rows if row["same_as_end"] != "True")


def _again() -> tuple[str, str, str]:
    first = rows_by_key("llvmpipe/validate-city/correlations.csv")
    second = rows_by_key("llvmpipe/validate-city-again/correlations.csv")
    counters = [key for key in first if not key[3].startswith("time")]
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


def _holding() -> list[str]:
    names = ("poly2tri-testbed", "earcut-fixtures", "helsinki-areas", "cad")
    return [matched("llvmpipe/study/findings.md", rf"\| {name} \| (\d+) \|")[0] for name in names]


def _shares() -> list[str]:
    rows = some("learned/shares.csv", at="refined", rule="refined")
    saved = sorted(float(row["share_of_saving"]) for row in rows)
    spent = sorted(float(row["share_of_time"]) for row in rows)
    return [two(saved[0]), two(saved[-1]), two(spent[0]), two(spent[-1])]


def _alarms() -> list[str]:
    equal, called, _, found, slower = alarms()
    return [equal, called, slower, found]


def _pair(who: str, px: int, scene: str = "counties") -> list[str]:
    return [percent(regret(d, scene, px, who, "time_work_0")["mean"]) for d in ("llvmpipe", "zink")]


def _worst(scene: str, who: str) -> str:
    return percent(regret("cpu", scene, 1024, who, "helper_lanes")["mean"])


def _break_even(name: str) -> list[str]:
    files = [f"llvmpipe/orders-{scene}/summary.csv" for scene in ("city", "helsinki", "counties")]
    # The first row is that of the triangulator's own order.
    found = [some(file, triangulator=name)[0]["break_even_draws"] for file in files]
    return [whole(round(float(value), 1 - len(str(int(float(value)))))) for value in found]


def _branches(name: str, column: str = "mispredicted") -> float:
    return float(one("llvmpipe/branches.csv", scene="glyphs", triangulator=name)[column])


def _d_over_h(order: str) -> str:
    d, h = (gain("glyphs", 256, f"optimal:{c}", order=order) for c in ("shape", "half-perimeter"))
    return f"{100.0 * (1.0 - float(d['time_ratio']) / float(h['time_ratio'])):.1f}"


def _faster(name: str, px: int) -> str:
    one_, other = gain("glyphs", px, name), gain("glyphs", px, BEST_FOR_H)
    return f"{100.0 * (1.0 - float(one_['time_ratio']) / float(other['time_ratio'])):.1f}"


def _own_order_costs() -> list[str]:
    rows = [_ordered(scene, "delaunay") for scene in SCENES]
    base = [(float(row["own"]), float(row["walk"])) for row in rows]
    return [f"{100.0 * (own / walk - 1.0):.0f}" for own, walk in base]


def _work(name: str, work: int, samples: int) -> str:
    return ratio("city", 1024, name, work=work, samples=samples)


def _boxes(name: str, px: int, rasteriser: str = "bounding-box") -> str:
    return ratio("city", px, name, rasteriser=rasteriser)


def _on(device: str, name: str, px: int) -> str:
    file = f"{device}/gains-city/summary.csv"
    return two(one(file, triangulator=name, resolution=px)["time_ratio"])


def _limit() -> list[str]:
    def row(name: str) -> Row:
        return _of("gains-city", name)

    best, clipped = row(BEST_FOR_H), row("ear-clipping")
    outline = 4.0 * float(best["outline_quads"]) - float(best["fragments"])
    lanes = [float(best["helper_lanes"]), float(clipped["helper_lanes"])]
    saved = (lanes[1] - lanes[0]) / (lanes[1] - outline)
    return [whole(outline), *map(whole, lanes), percent(saved)]


def _fit(name: str, unit: float, file: str, digits: int = 0) -> str:
    return _coefficient(file, name, unit, digits)[0]


FIRST = "calibration/llvmpipe.json"
AGAIN = "reference/llvmpipe/calibration/four-scenes.json"


def _held_out(file: str) -> list[str]:
    fit = values(file)["held_out"]
    return [three(fit["r2_over_polygons"]), three(fit["r2_within_polygons"])]


def _city(device: str, criterion: str, measure: str, rasteriser: str = "opengl") -> str:
    return three(correlation(criterion, measure, rasteriser, device)["value"])


SOFTWARE = {"zink": "opengl", "osmesa": "osmesa", "softpipe": "opengl"}


def _lanes_of(criterion: str) -> list[str]:
    return [_city(d, criterion, "helper_lanes", r) for d, r in SOFTWARE.items()]


HELD: list[Held] = [
    Sentence(
        "in {} of ear clipping's time for city footprints, in {} for Helsinki's, in {} for letters"
        " and in {} for counties. Delaunay's triangles take {}, {}, {} and {}.",
        lambda: [two(drawn(s, 1024, n)) for n in (BEST_FOR_H, "delaunay") for s in SCENES],
    ),
    Sentence(
        "its drawings are between {} % faster and {} % slower than the best for H",
        lambda: [percent(-min(map(_slower, SCENES)), 1), percent(max(map(_slower, SCENES)), 1)],
    ),
    Sentence(
        "its error is {} % (root mean square). H + T, the first order of it, is off by {} %",
        lambda: [error_of_prediction(1), error_of_prediction(2)],
    ),
    Sentence(
        "by helper lanes with a correlation of {}, H with {} and the paper's A with {}",
        lambda: [
            three(correlation(c, "helper_lanes")["value"])
            for c in ("expected_quads", "half_perimeter", "overdraw")
        ],
    ),
    Sentence(
        "trusting Q costs at most {} % more helper lanes on any of the four scenes. Trusting H"
        " costs {} to {} %. Trusting A costs {} % on letters and {} % on counties; ear clipping"
        " costs {} % and {} %.",
        lambda: [
            max((_worst(s, "Q") for s in SCENES), key=float),
            min((_worst(s, "H") for s in SCENES), key=float),
            max((_worst(s, "H") for s in SCENES), key=float),
            *(_worst(s, who) for who in ("A", "ear clipping") for s in ("glyphs", "counties")),
        ],
    ),
    Table(
        "| | helper lanes | time, work 0 | time, work 8 | box tests | time, box walk |", predicts
    ),
    Sentence(
        "H has a rank correlation of {}, {} and {} with helper lanes, and A has {}, {} and {} (12",
        lambda: _lanes_of("half_perimeter") + _lanes_of("overdraw"),
    ),
    Sentence(
        "With time, H has {} and A {} on zink; on OSMesa they have {} and {}. On softpipe nothing"
        " predicts the time: the best of these criteria has {}. On a rasteriser that walks rows,"
        " all criteria predict the time badly: H has {}.",
        lambda: [
            *(_city("zink", c, "time_work_0") for c in ("half_perimeter", "overdraw")),
            *(_city("osmesa", c, "time_work_0", "osmesa") for c in ("half_perimeter", "overdraw")),
            max((_city("softpipe", c, "time_work_0") for c in CRITERIA), key=float),
            _city("llvmpipe", "half_perimeter", "time_work_0", "scanline"),
        ],
    ),
    Table("| viewport | city: Q | H | A | Helsinki: Q | H | A |", sizes),
    Sentence(
        "With helper lanes H has {}, D {} and A {}. Q, the best within a polygon, has {},",
        lambda: [_pooled(c) for c in ("half_perimeter", "shape", "overdraw", "expected_quads")],
    ),
    Table(
        "| chosen by | city, 256 px | city, 1024 px | Helsinki, 256 px | Helsinki, 1024 px |",
        regrets("city", "helsinki"),
    ),
    Table(
        "| chosen by | letters, 256 px | letters, 1024 px | counties, 256 px | counties, 1024 px |",
        regrets("glyphs", "counties"),
    ),
    Sentence(
        "at most {} % more quads than the best possible at 1024 px on all four scenes, and at most"
        " {} % more at 256 px. H's choice shades at most {} % more at 1024 px, A's at most {} %.",
        lambda: [
            percent(max(_quads_regret(px, who))[0], 2)
            for px, who in ((1024, "Q"), (256, "Q"), (1024, "H"), (1024, "A"))
        ],
    ),
    Table(
        "| chosen by | city, 256 px | Helsinki, 256 px | letters, 256 px | city, 1024 px"
        " | Helsinki, 1024 px | letters, 1024 px |",
        regrets_of_times,
    ),
    Sentence(
        "At 256 px, H costs {} % on llvmpipe and {} % on zink, Q {} and {} %, A {} and {} %,"
        " Delaunay {} and {} %, D {} and {} %, ear clipping {} and {} %. At 1024 px, H costs {} and"
        " {} %, Q {} and {} %, A {} and {} %, ear clipping {} and {} %.",
        lambda: [
            figure
            for px, names in (
                (256, ("H", "Q", "A", "Delaunay", "D", "ear clipping")),
                (1024, ("H", "Q", "A", "ear clipping")),
            )
            for who in names
            for figure in _pair(who, px)
        ],
    ),
    Sentence(
        "the 500 footprints of the city at 1024 px have {} helper lanes. The optimum for H has {},"
        " ear clipping {}. What is above the limit is the price of diagonals. Choosing them well"
        " saves {} % of the price",
        _limit,
    ),
    Sentence(
        "is {} us for a draw, {} ns for a triangle, {} ns for a pixel of H, {} ns for an expected"
        " 4x4 block and {} ns ({} to {}) for a degree of D.",
        lambda: [
            _fit("draw", 1e-6, FIRST, 1),
            _fit("triangles", 1e-9, FIRST),
            _fit("half_perimeter", 1e-9, FIRST, 1),
            _fit("expected_blocks", 1e-9, FIRST),
            *_coefficient(FIRST, "shape", 1e-9, 2),
        ],
    ),
    Sentence(
        "The model explains {} of the variance of log time over polygons and {} within them (24",
        lambda: _held_out(FIRST),
    ),
    Sentence(
        "the model explains {} over polygons and {} within them. A triangle then costs {} ns, and"
        " {} ns ({} to {}) more where its box holds a pixel centre; a pixel of H {} ns; a block {}"
        " ns; a degree of D {} ns ({} to {}).",
        lambda: [
            *_held_out(AGAIN),
            _fit("triangles", 1e-9, AGAIN),
            *_coefficient(AGAIN, "expected_setups", 1e-9),
            _fit("half_perimeter", 1e-9, AGAIN, 1),
            _fit("expected_blocks", 1e-9, AGAIN),
            *_coefficient(AGAIN, "shape", 1e-9, 2),
        ],
    ),
    Table("| terms | R2 over polygons | R2 within | regret (95 %) |", terms),
    Sentence(
        "then run the same number of instructions, to {} %. They differ in mispredicted branches:"
        " for letters at 256 px, Callgrind counts {} in a draw for H, {} for D and {} for the"
        " calibrated optimum",
        lambda: [
            percent(
                _branches(BEST_FOR_H, "instructions") / _branches("optimal:shape", "instructions")
                - 1.0,
                1,
            ),
            *(whole(_branches(n)) for n in (BEST_FOR_H, "optimal:shape", CALIBRATED)),
        ],
    ),
    Sentence(
        "D's advantage over H is then {} % (`llvmpipe/gains-glyphs-shuffled`), in place of {} %.",
        lambda: [_d_over_h("shuffled"), _d_over_h("native")],
    ),
    Sentence(
        "No 95 % interval reaches further than {} to either side up to 1024 px, and {} at 4096 px.",
        lambda: [_widest(False), _widest(True)],
    ),
    Table(
        "| scene, px | Delaunay | greedy | manifold | best for A | best for Q | `refined` |"
        " best for H | **calibrated** | calibrated over Delaunay |",
        choice,
    ),
    Table(
        "| counties, px | Delaunay | greedy | manifold | best for A | best for Q | best for H |"
        " **calibrated** | calibrated over Delaunay |",
        counties,
    ),
    Sentence(
        "the calibrated optimum is {} and {} % faster than the best for H, and the best for D is"
        " faster than the best for H, too, by {} and {} %.",
        lambda: [_faster(n, px) for n in (CALIBRATED, "optimal:shape") for px in (256, 512)],
    ),
    Sentence(
        "takes {} and {} of ear clipping's time on zink, {} and {} on OSMesa",
        lambda: [_on(d, CALIBRATED, px) for d in ("zink", "osmesa") for px in (256, 1024)],
    ),
    Sentence(
        "1024 px: it takes {}, the best for H takes {} and Delaunay {}. There the paper is right."
        " On a rasteriser that walks rows, the best for H takes {} and {}, the best for A {} and"
        " {}.",
        lambda: [
            *(_boxes(n, 1024) for n in ("optimal:overdraw", BEST_FOR_H, "delaunay")),
            *(
                _boxes(n, px, "scanline")
                for n in (BEST_FOR_H, "optimal:overdraw")
                for px in (256, 1024)
            ),
        ],
    ),
    Sentence(
        "run the vertex shader {} times. The optimum's, walked from neighbour to neighbour, run it"
        " {} times",
        lambda: [
            whole(_of("gains-glyphs", n, 256)["driver_vertex_invocations"])
            for n in ("delaunay", BEST_FOR_H)
        ],
    ),
    Table(
        "| | city: own | cache | walk | Helsinki: own | cache | walk | letters: own | cache | walk"
        " | counties: own | cache | walk |",
        orders,
    ),
    Sentence(
        "its own order costs it {} % on the city, {} % on Helsinki, {} % on letters and {} % on"
        " counties",
        _own_order_costs,
    ),
    Sentence(
        "its helper lanes rise from {} of ear clipping's to {}, and its time from {} to {}. The"
        " best for H stays within {} % of one that is triangulated anew at each angle: its time is"
        " {} to {} and its lanes {} to {} of ear clipping's.",
        lambda: [
            two(_rotated("optimal:overdraw@0", "helper_lanes")[0]),
            two(max(_rotated("optimal:overdraw@0", "helper_lanes"))),
            two(_turned("optimal:overdraw@0")[0]),
            two(max(_turned("optimal:overdraw@0"))),
            percent(
                max(
                    a / b - 1.0
                    for a, b in zip(_turned(f"{BEST_FOR_H}@0"), _turned(BEST_FOR_H), strict=True)
                ),
                1,
            ),
            two(min(_turned(f"{BEST_FOR_H}@0"))),
            two(max(_turned(f"{BEST_FOR_H}@0"))),
            two(min(_rotated(f"{BEST_FOR_H}@0", "helper_lanes"))),
            two(max(_rotated(f"{BEST_FOR_H}@0", "helper_lanes"))),
        ],
    ),
    Sentence(
        "With one iteration, the calibrated optimum takes {} of ear clipping's time. With 64 it"
        " takes {}; there the best for Q takes {}. With 4 samples and one iteration it takes {}.",
        lambda: [
            _work(CALIBRATED, 1, 1),
            _work(CALIBRATED, 64, 1),
            _work("optimal:expected-quads", 64, 1),
            _work(CALIBRATED, 1, 4),
        ],
    ),
    Sentence(
        "after {} draws of the city, {} of Helsinki and {} of the counties, at 1024 px on"
        " llvmpipe; `refined` after {}, {} and {}",
        lambda: _break_even(BEST_FOR_H) + _break_even(REFINED),
    ),
    Sentence(
        "which is {} times less.",
        lambda: [extremes()[0].split("|")[2].strip()],
    ),
    Table(
        "| | predicted | box tests | time, box walk | helper lanes | quads | time, llvmpipe | zink"
        " | OSMesa |",
        extremes,
    ),
    Sentence(
        "That alone turns {} into {}.",
        lambda: [cell.strip() for cell in extremes()[0].split("|")[2:4]],
    ),
    Sentence(
        "{} points of the Pareto fronts of A and D were drawn beside the least-A ends",
        lambda: [str(sum(_fronts("opengl").values()))],
    ),
    Sentence(
        "{} of them are shown to be faster than their end. On OpenGL, {} are faster and {} are"
        " slower.",
        lambda: [
            str(_fronts("bounding-box")["faster"]),
            str(_fronts("opengl")["faster"]),
            str(_fronts("opengl")["slower"]),
        ],
    ),
    Sentence("get {} to {} of the optimum's saving, in {} to {} of its time", _shares),
    Sentence(
        "for each of {} generated footprints and all scenes",
        lambda: matched("llvmpipe/optimum-equality.txt", r"footprints on the device: ([\d,]+)"),
    ),
    Table(
        "| | best for H | refined | best for Q | best for A | Delaunay | Q | H | A |", on_devices
    ),
    Sentence("Of 11 findings, {}, {}, {} and {} hold on them.", _holding),
    Sentence(
        "Of {} correlations with counters, {} are equal to the last digit. Those with times differ"
        " by at most {}.",
        _again,
    ),
    Sentence(
        "Of {} comparisons of equal code, half of them while another program came and went, {}"
        " were called a regression; of {} in which 3 % of one drawing's triangles were drawn"
        " twice, {} were found",
        _alarms,
    ),
    Table("| beside the run | runs | reference draw, ms | best for H | Delaunay |", states),
    Sentence(
        "{} of {} pairs of them are further apart than their intervals allow (best for H), and of"
        " all pairs {} of {}. For Delaunay it is {} of {}, and {} of {}.",
        apart,
    ),
]

DEFINITIONS = (
    r"\b95 %",
    r"\b\d+( and \d+)? px",
    r"\b\d+ and 1024 px",
    r"\b256 and 512",
    r"\b\d+ (city )?polygons|counties: \d+|\d+ footprints of the city",
    r"2x2|4x4|1/256|1/16|4q|4Q|Below 1 ",
    r"work [08] |up to 50 triangulations|700 designed draws|of 1,024 indices",
    r"With 64 it|With 4 samples",
    r"0 to 90 degrees in steps of 5|at 0 degrees",
    r"A = \d+|18 of the 47|the 29 without|All 47",
    r"3 % of one drawing's|Of 11 findings|below 1 % are not|within 3 % of each other",
)
"""Not measured: what was chosen, levels of confidence, exact counts that tests of the code hold."""
