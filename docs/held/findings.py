"""The figures of docs/findings.md."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from docs.held import Held, Sentence, Table
from docs.held.lookups import (
    Row,
    bold,
    interval,
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


def time_ratio(*which: object, **where: object) -> str:
    """Return such a time ratio with three digits."""
    return three(gain(*which, **where)["time_ratio"])  # type: ignore[arg-type]


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


def choice() -> list[str]:
    """Return the table of draw times in ratio to ear clipping's."""
    lines = []
    for scene, label in SCENES.items():
        for px in (256, 1024, 4096):
            found = _some_gains(scene, px)
            if scene == "counties":  # measured in a run of its own
                found["refined:half-perimeter"] = _of_refined_run(px, "refined:half-perimeter")
            cells = [three(found[name]) for name in PEERS]
            best = {place for place, cell in enumerate(cells) if cell == min(cells)}
            over = three(_some_gains(scene, px, "delaunay")["optimal:calibrated"])
            lines.append(table_row(f"{label}, {px}", *bold(cells, best), over))
    return lines


def _of_refined_run(px: int, name: str) -> float:
    file = "llvmpipe/gains-counties-refined/summary.csv"
    return float(one(file, triangulator=name, resolution=px)["time_ratio"])


def ranges(names: Iterable[str], px: Iterable[int], base: str = "ear-clipping") -> list[float]:
    """Return the ratios of some triangulators at some sizes on all scenes."""
    return [
        found[name]
        for scene in SCENES
        for size in px
        for name in names
        if name in (found := _some_gains(scene, size, base))
    ]


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
        table_row(label, *bold(found[name], {p for p, c in enumerate(found[name]) if c == least[p]}))
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
            ranks = [two(view["ranks"][c]) for c in ("expected_quads", "half_perimeter", "overdraw")]
            lines.append(table_row(f"{SCENES[scene]}: {label}", *bold(cells, best), *ranks))
    return lines
