"""Decisions of scripts/studies/gpu.py on the stored measurements of an H200."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from scripts.studies import gpu
from tests.paths import ROOT

STORED = ROOT / "results/reference/h200"
RUNS = ("orders-city", "orders-glyphs", "work-city", "again")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of the runs; their counters, which are exact, replace the reference's."""
    for name in RUNS:
        shutil.copytree(STORED / name, tmp_path / name)
    drawn = pd.concat([pd.read_csv(STORED / name / "summary.csv") for name in RUNS[:2]])
    (tmp_path / "reference-all").mkdir()
    both = pd.concat([drawn, drawn.assign(rasteriser="reference")])
    both.to_csv(tmp_path / "reference-all" / "summary.csv", index=False)
    return tmp_path


def test_stored_decisions_follow_from_the_measurements(folder):
    gpu.predict(folder)
    gpu.judge(folder)
    for name in ("hypotheses", "equality", "judged", "decisions"):
        written = (folder / f"{name}.csv").read_text()
        assert written == (STORED / f"{name}.csv").read_text(), name


@pytest.mark.parametrize("missing", ["the driver's statistics", "a scene"])
def test_hypotheses_on_missing_measurements_are_open(folder, missing):
    for file in [folder / name / "summary.csv" for name in RUNS]:
        if missing != "a scene":
            pd.read_csv(file).drop(columns=gpu.DRIVER).to_csv(file, index=False)
        elif file.parent.name == "orders-glyphs":
            file.unlink()
    gpu.judge(folder)
    table = pd.read_csv(folder / "decisions.csv").set_index("hypothesis")
    affected = [1, 2, 3] if missing == "a scene" else [5]
    assert table.loc[affected, ["value", "holds"]].isna().all(axis=None)
    assert table.loc[[0, 7], "holds"].all()
