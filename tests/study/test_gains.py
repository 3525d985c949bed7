"""Gains of triangulators, where those of the order and of the diagonals are separate."""

import pandas as pd
import pytest

from harness.commands.study_gains import list_faster, split_by_order
from harness.metrics.statistics import FASTER, SLOWER


def row(triangulator: str, order: str, ratio: float, **changes: object) -> dict[str, object]:
    view = {"resolution": 256, "rotation": 0.0, "fit": "box", "work": 0, "samples": 1}
    names = {"scene": "letters", "rasteriser": "opengl", "device": "llvmpipe"}
    names |= {"order": order, "triangulator": triangulator, "base": "ear-clipping"}
    return {**names, **view, "time_ratio": ratio, **changes}


ROWS = [
    row("ear-clipping", "native", 1.0),
    row("optimal:half-perimeter", "native", 0.82),
    row("optimal:half-perimeter", "walk", 0.97),
    row("optimal:half-perimeter", "vertex-cache", 0.96),
    row("delaunay", "native", 0.93),
    row("delaunay", "walk", 0.94),
]


def test_by_order_has_a_column_per_order():
    wide = split_by_order(pd.DataFrame(ROWS), "ear-clipping").set_index("triangulator")
    assert list(wide.index) == ["optimal:half-perimeter", "delaunay"]
    best = wide.loc["optimal:half-perimeter"]
    assert (best["native"], best["walk"], best["vertex-cache"]) == (0.82, 0.97, 0.96)
    assert wide.loc["delaunay", "walk"] == pytest.approx(0.94)
    assert pd.isna(wide.loc["delaunay", "vertex-cache"])


def test_faster_triangulators_are_listed_with_their_gain():
    rows = [{**row, "verdict": FASTER if row["time_ratio"] < 0.95 else SLOWER} for row in ROWS]
    faster = list_faster(pd.DataFrame(rows), "ear-clipping").set_index("order")["faster"]
    assert faster.to_dict() == {
        "native": "optimal:half-perimeter 18.0%; delaunay 7.0%",
        "walk": "delaunay 6.0%",
        "vertex-cache": "",
    }


def test_by_order_separates_views_and_skips_single_orders():
    single = row("optimal:half-perimeter", "native", 0.7, resolution=512)
    wide = split_by_order(pd.DataFrame([*ROWS, single]), "ear-clipping")
    assert set(wide["resolution"]) == {256}
    assert split_by_order(pd.DataFrame(ROWS), "delaunay").empty
    assert split_by_order(pd.DataFrame(ROWS[:2]), "ear-clipping").empty
