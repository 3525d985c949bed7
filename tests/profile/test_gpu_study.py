"""Decisions of scripts/studies/gpu.py on simulated measurements that obey or violate the law."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from scripts.studies import gpu

TRIANGULATORS = ("ear-clipping", "earcut-refine", "flips:l1", "delaunay")
BATCHES = {"native": (509, 648, 646, 868), "walk": (482, 480, 483, 480), "shuffled": (1330,) * 4}


def make_cases(scene: str, resolution: int, order: str, work: int, covering: int) -> pd.DataFrame:
    """Return the counters of one view, a row per triangulator, as in summary.csv."""
    view = {"scene": scene, "resolution": resolution, "samples": 1, "work": work, "order": order}
    counts = {"triangles": 13_000, "fragments": 3000, "covering_triangles": covering}
    varying = {
        "quads": covering * 10 + np.arange(4),
        "helper_lanes": 100 + np.arange(4),
        "vertex_batches": BATCHES[order],
        "transformed_vertices": 32 * np.array(BATCHES[order]),
    }
    names = {"triangulator": TRIANGULATORS, "status": "ok"}
    return pd.DataFrame({**view, **names, **counts, **varying})


def write_run(folder: Path, cases: list[pd.DataFrame], **columns: object) -> None:
    folder.mkdir()
    pd.concat(cases).assign(**columns).to_csv(folder / "summary.csv", index=False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for scene, resolution, covering in (("glyphs", 256, 100), ("city", 1024, 20_000)):
        cases = [make_cases(scene, resolution, order, 0, covering) for order in BATCHES]
        both = [each.assign(rasteriser=name) for each in cases for name in ("opengl", "reference")]
        write_run(tmp_path / f"reference-{scene}", both)
    gpu.predict(tmp_path)
    return tmp_path


def write_measurements(folder: Path, *, factor: dict[str, float] | None = None) -> None:
    """Write runs whose times are those of the law, times a factor for each order."""
    predicted = pd.read_csv(folder / "predicted.csv")
    counters = pd.read_csv(folder / "reference-city/summary.csv").columns
    factors = predicted["order"].map(factor or {}).fillna(1.0)
    measured = predicted.assign(
        status="ok",
        draw_ms=1e-6 * predicted["predicted_ns"] * factors,
        vertex_shader_invocations=predicted["transformed_vertices"],
        rasteriser="opengl",
    )[[*counters, "draw_ms", "vertex_shader_invocations"]]
    for name, scene in product(("orders", "work"), ("city", "glyphs")):
        rows = measured[(measured["scene"] == scene) & ((measured["work"] > 0) == (name == "work"))]
        write_run(folder / f"{name}-{scene}", [rows])
    write_run(folder / "again", [measured[measured["scene"] == "city"]])


def decide(folder: Path) -> dict[int, bool]:
    gpu.judge(folder)
    table = pd.read_csv(folder / "decisions.csv")
    return table.groupby("hypothesis")["holds"].all().to_dict()


def test_measurements_that_obey_the_law_confirm_every_hypothesis(folder):
    write_measurements(folder)
    assert decide(folder) == dict.fromkeys(range(8), True)
    equality = pd.read_csv(folder / "equality.csv")
    assert (equality["cases"] == equality["equal"]).all()
    assert equality["cases"].sum() > 0


@pytest.mark.parametrize(
    ("factor", "refuted"), [({"shuffled": 1.2}, {3, 4, 6}), ({"walk": 1.04}, {4})]
)
def test_an_order_that_costs_something_else_refutes(folder, factor, refuted):
    write_measurements(folder, factor=factor)
    assert {number for number, holds in decide(folder).items() if not holds} == refuted


@pytest.mark.parametrize("missing", ["the driver's statistics", "a scene"])
def test_hypotheses_on_missing_measurements_are_open(folder, missing):
    write_measurements(folder)
    for file in folder.glob("*/summary.csv"):
        if missing != "a scene":
            table = pd.read_csv(file).drop(columns="vertex_shader_invocations", errors="ignore")
            table.to_csv(file, index=False)
        elif file.parent.name in ("orders-glyphs", "work-glyphs"):
            file.unlink()
    gpu.judge(folder)
    table = pd.read_csv(folder / "decisions.csv").set_index("hypothesis")
    affected = [1, 2, 3] if missing == "a scene" else [5]
    assert table.loc[affected, ["value", "holds"]].isna().all(axis=None)
    assert table.loc[[4, 7], "holds"].all()
