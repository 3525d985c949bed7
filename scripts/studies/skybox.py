"""Does H predict an open GPU's rasteriser? The study that docs/studies/skybox.md registered.

    PYTHONPATH=. RASTER_HARNESS_SKYBOX=... python scripts/studies/skybox.py results/reference/skybox

Writes measured.csv, a row a draw, and what the rules are applied to: ranks.csv, savings.csv,
slopes.csv, thin.csv, border.csv and squares.csv. Counts only: the same at every run.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from harness.frame import Frame, View, bare_frame, frame_of
from harness.metrics.per_polygon import spearman
from harness.rasterisers import Device, Options, get
from harness.rasterisers.simulated import read
from harness.rasterisers.simulated.skybox import Skybox
from harness.settings import StudySize
from harness.study.subjects import choose_polygons
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse_all
from scenes import load
from tests.simulated.descent import descent

SCENES = ("helsinki", "glyphs", "cad", "stress")
SIZES = (64, 256, 1024)
CHOICES = (
    *("ear-clipping", "delaunay", "earcut-refine", "flips:l1", "optimal:half-perimeter"),
    *("optimal:overdraw", "optimal:expected-quads", "worst:half-perimeter", "worst:overdraw"),
)
RANDOM = tuple(f"random#{seed}" for seed in range(4))
SHADERS = (0.5, 1, 2, 4, 8)
PARAMETERS = (
    *("output_quads=1", "tile=16", "tile=64", "block=8", "bins=exact", "fetch=16", "fetch=64"),
    *(f"shader={each:g}" for each in SHADERS),
)
TURNED_AT = 256
"""The size at which parameters are turned."""

DESIGN = StudySize(polygons=6, most_vertices=200)
THIN_AREA, ASPECTS, ANGLES, PLACES = 64.0, (1, 2, 4, 8, 16, 32, 64, 128, 256), (0, 22, 45), 32
KEPT = [
    *("scene", "polygon", "resolution", "device", "triangulator", "triangles", "cycles"),
    *("quads", "nodes", "tiles", "by_squares", "half_perimeter", "overdraw", "edge_length", "area"),
]
"""Columns of measured.csv."""

CRITERIA = ("half_perimeter", "overdraw", "quads", "edge_length")


def subjects() -> Iterator[tuple[str, str, Frame]]:
    """Yield (scene, polygon, frame): each polygon alone, as large as the viewport."""
    for name in SCENES:
        for number, scene in choose_polygons(load(name), DESIGN):
            for size in SIZES:
                yield name, f"{name}#{number}", frame_of(scene, View(size))


def draws(frame: Frame, device: str, triangles: dict[str, np.ndarray]) -> pd.DataFrame:
    """Draw each triangulation alone, and count; a row each."""
    opened = get("simulated")(Device(device, software=True))
    rows = []
    for name, part in triangles.items():
        counted = opened.count(frame, part, Options())
        rows.append({"triangulator": name} | {k: int(v.sum()) for k, v in counted.items()})
    return pd.DataFrame(rows).assign(device=device)


def measure(folder: Path) -> pd.DataFrame:
    """Draw everything, a row a draw; what a run that was stopped has measured is in `folder`."""
    folder.mkdir(exist_ok=True)
    parts = []
    for scene, polygon, frame in subjects():
        file = folder / f"{polygon}-{frame.width}.csv"
        if not file.is_file():
            table = measure_one(polygon, frame)
            table = table.assign(scene=scene, polygon=polygon, resolution=frame.width)
            table.to_csv(file, index=False)
            print(f"{polygon} {frame.width} px", flush=True)
        parts.append(pd.read_csv(file))
    return pd.concat(parts, ignore_index=True)


def measure_one(polygon: str, frame: Frame) -> pd.DataFrame:
    """Draw all triangulations of one polygon at one size."""
    made, criteria = {}, {}
    for recipe in parse_all((*CHOICES, *RANDOM)):
        found = triangulate_polygons(recipe, frame.polygons, None)
        if any(part is None for part in found.parts):
            print(f"{polygon} {frame.width} px: {recipe}: left out", file=sys.stderr)
            continue
        made[str(recipe)] = frame.join(found.parts)
        criteria[str(recipe)] = {name: each.sum() for name, each in found.predicted.items()}
    devices = ["skybox"]
    if frame.width == TURNED_AT:
        devices += [f"skybox:{each}" for each in PARAMETERS]
    parts = []
    for device in devices:
        chosen = {k: v for k, v in made.items() if device == "skybox" or k in CHOICES}
        table = draws(frame, device, chosen)
        for name in ("half_perimeter", "overdraw", "edge_length", "area", "triangles"):
            table[name] = [criteria[each][name] for each in table["triangulator"]]
        if device == "skybox":
            table["by_squares"] = [descent(frame, made[n])[:, 2].sum() for n in chosen]
        parts.append(table)
    return pd.concat(parts, ignore_index=True)


def without_twins(part: pd.DataFrame) -> pd.DataFrame:
    """Leave out a triangulation that another name gave, too."""
    same = ["polygon", "resolution", "device", "half_perimeter", "overdraw", "edge_length"]
    return part[~part[same].round(6).duplicated()]


def ranks(table: pd.DataFrame) -> pd.DataFrame:
    """Return Spearman's correlation within a polygon, the median over a scene's polygons."""
    table, keys = without_twins(table), ["device", "scene", "resolution"]
    rows = [
        (*key, name, spearman(view[name].to_numpy(), view["cycles"].to_numpy()))
        for key, view in table.groupby([*keys, "polygon"], sort=False)
        if len(view) > 2
        for name in CRITERIA
    ]
    found = pd.DataFrame(rows, columns=[*keys, "polygon", "criterion", "value"])
    known = found[np.isfinite(found["value"])].groupby([*keys, "criterion"], sort=False)["value"]
    return known.agg(median="median", least="min", polygons="size").reset_index()


def savings(table: pd.DataFrame) -> pd.DataFrame:
    """Return cycles and quads over ear clipping's, geometric means over a scene's polygons."""
    keys, counts = ["device", "scene", "resolution"], ["cycles", "quads"]
    table = table[table["triangulator"].isin(CHOICES)].set_index([*keys, "polygon"])
    base = table[table["triangulator"] == "ear-clipping"]
    over = np.log(table[counts] / base[counts].reindex(table.index)).assign(polygons=1)
    groups = over.groupby([*keys, table["triangulator"]], sort=False)
    means = np.exp(groups[counts].mean())
    return means.assign(polygons=groups["polygons"].sum()).reset_index()


def slopes(table: pd.DataFrame) -> pd.DataFrame:
    """Return cycles a pixel of H within polygons, by least squares, and R^2."""
    rows = []
    for key, part in without_twins(table).groupby(["device", "resolution"], sort=False):
        whole = part[part["triangles"] == part.groupby("polygon")["triangles"].transform("max")]
        names = ["half_perimeter", "cycles"]
        within = whole[names] - whole.groupby("polygon")[names].transform("mean")
        x, y = (within[name].to_numpy(float) for name in names)
        slope = (x @ y) / (x @ x)
        rows.append((*key, slope, 1 - ((y - slope * x) ** 2).sum() / (y @ y), len(x)))
    names = ["device", "resolution", "cycles_per_px", "r_squared", "draws"]
    return pd.DataFrame(rows, columns=names)


def border(table: pd.DataFrame) -> pd.DataFrame:
    """Return cycles over the larger of descent and shading, by cycles a quad."""
    size = table[(table["resolution"] == TURNED_AT) & table["triangulator"].isin(CHOICES)]
    keys = ["polygon", "triangulator"]
    free = size[size["device"] == "skybox"].set_index(keys)["cycles"]
    rows = []
    for k in SHADERS:
        part = size[size["device"] == f"skybox:shader={k:g}"].set_index(keys)
        least = np.maximum(free.loc[part.index], k * part["quads"])
        over = part["cycles"] / least
        saved = savings(size[size["device"] == f"skybox:shader={k:g}"])
        best = saved[saved["triangulator"] == "optimal:half-perimeter"]
        means = [float(np.exp(np.log(best[name]).mean())) for name in ("cycles", "quads")]
        rows.append((k, float((free / part["quads"]).median()), over.median(), over.max(), *means))
    names = ["shader", "descent_per_quad", "over_larger", "most_over", "cycles", "quads"]
    return pd.DataFrame(rows, columns=names)


def thin() -> pd.DataFrame:
    """Return mean cycles of a triangle of one area alone, by aspect, angle and device."""
    rng = np.random.default_rng(53)
    px, rows = 256, []
    for device in ("skybox", "skybox:bins=exact", "skybox:shader=4"):
        kind, parameters = read(device)
        slice_ = kind(parameters)
        for aspect in ASPECTS:
            for angle in ANGLES:
                # a right triangle's legs are in the ratio, and half their product is the area
                short = np.sqrt(2 * THIN_AREA / aspect)
                legs = np.array([[0.0, 0.0], [short * aspect, 0.0], [0.0, short]])
                cosine, sine = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
                turned = legs @ np.array([[cosine, sine], [-sine, cosine]])
                room = px - np.ptp(turned, axis=0)
                places = rng.random((PLACES, 1, 2)) * room - turned.min(axis=0)
                points = np.rint((turned + places).reshape(-1, 2) * 256).astype(np.int32)
                triangles = np.arange(3 * PLACES, dtype=np.int32).reshape(-1, 3)
                # one after the other, each a draw that ends before the next begins
                alone = replace(bare_frame(px, points, 3), tiles=np.arange(PLACES + 1))
                found = slice_.count(alone, triangles, Options())
                means = (int(found[name].sum()) / PLACES for name in ("cycles", "quads"))
                rows.append((device, aspect, angle, *means))
    return pd.DataFrame(rows, columns=["device", "aspect", "angle", "cycles", "quads"])


def squares(table: pd.DataFrame) -> pd.DataFrame:
    """Return by how many cycles the count of squares misses the published design's."""
    part = table[table["device"] == "skybox"]
    groups = (part["cycles"] - part["by_squares"]).groupby(part["resolution"])
    ends = {"least": groups.min(), "most": groups.max(), "draws": groups.size()}
    return pd.DataFrame(ends).reset_index()


def main(folder: Path) -> None:
    """Measure, unless measured.csv is there, and apply the rules' statistics."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "measured.csv"
    if not file.is_file():
        table = measure(folder / "parts")
        table[KEPT].to_csv(file, index=False, float_format="%.10g")
    thin().to_csv(folder / "thin.csv", index=False, float_format="%.6g")
    table = pd.read_csv(file)
    for make in (ranks, savings, slopes, border, squares):
        make(table).to_csv(folder / f"{make.__name__}.csv", index=False, float_format="%.5g")


if __name__ == "__main__":
    assert Skybox.sources.problem() is None, Skybox.sources.problem()
    main(Path(sys.argv[1]))
