"""Studies end to end on the exact CPU rasterisers, where the right answers are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.errors import UsageError
from harness.store import read_run
from harness.study.analysis import correlate, tabulate
from harness.study.design import Design, choose_polygons, choose_triangulators
from scenes import load
from tests.conftest import exit_code


def test_polygons_are_simple_and_of_all_sizes():
    city = load("city")
    chosen = choose_polygons(city, Design(polygons=12))
    sizes = [len(part.polygons[0].exterior.coords) - 1 for _, part in chosen]
    assert sizes == sorted(sizes)
    assert sizes[0] >= 8
    assert sizes[-1] >= 30
    for number, part in chosen:
        assert part.polygons == [city.polygons[number]]
        assert not part.polygons[0].interiors


def test_triangulations_are_sampled_broadly():
    names = choose_triangulators(Design(random=30))
    assert {"ear-clipping", "delaunay", "optimal:overdraw", "worst:half-perimeter"} <= set(names)
    assert sum(name.startswith("random#") for name in names) == 30
    assert len(set(names)) == len(names)


def test_a_scene_without_simple_polygons_is_refused():
    with pytest.raises(UsageError, match="no polygon without holes"):
        choose_polygons(load("city:buildings=5"), Design(most_vertices=3))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small study of the city's polygons on the CPU reference."""
    folder = tmp_path_factory.mktemp("study") / "out"
    arguments = ["validate", "--scene", "city:buildings=80", "--quick", "--quiet"]
    arguments += ["--rasterisers", "reference", "--resolution", "512", "--out", str(folder)]
    assert exit_code(*arguments) == 0
    return folder


def test_a_is_exact_for_box_tests_and_h_is_not(study):
    table = pd.read_csv(study / "correlations.csv")
    assert list(table.columns) == [
        *("rasteriser", "device", "criterion", "measure", "statistic"),
        *("value", "ci_low", "ci_high", "polygons"),
    ]
    cells = table[table["statistic"] == "spearman_within"].set_index(
        ["rasteriser", "criterion", "measure"]
    )["value"]
    assert cells["reference", "overdraw", "bbox_tests"] > 0.999
    assert cells["reference", "exact_quads", "helper_lanes"] == 1.0
    assert cells["binning", "exact_tiles_16", "tiles_16"] == 1.0
    assert cells["reference", "half_perimeter", "helper_lanes"] > 0.9
    assert (
        cells["reference", "half_perimeter", "helper_lanes"]
        > cells["reference", "overdraw", "helper_lanes"]
    )
    assert np.isnan(cells["reference", "complexity", "helper_lanes"])


def test_a_study_has_a_record_a_triangulation_and_its_plots(study):
    run = read_run(study)
    assert run.problems == []
    assert {record["status"] for record in run.records} <= {"ok", "skipped"}
    assert len({record["scene"] for record in run.records}) == 6
    plots = {path.name for path in (study / "plots").iterdir()}
    assert {"matrix-reference-cpu.png", "predicted-vs-measured-reference-cpu.svg"} <= plots


def test_the_same_triangulation_by_two_names_counts_once(study):
    records = read_run(study).records
    table = tabulate(records)
    twin = [dict(record, triangulator="twin", key="twin" + record["key"]) for record in records]
    again = tabulate([*records, *twin])
    assert len(again) == len(table)
    pd.testing.assert_frame_equal(correlate(again), correlate(table))


def test_all_triangulations_of_the_papers_polygon_are_listed(harness, tmp_path):
    counts = {}
    for mode in ("paper", "conforming"):
        assert harness("enumerate", "--mode", mode, "--out", f"all/{mode}")[0] == 0
        table = pd.read_csv(tmp_path / "all" / mode / "triangulations.csv")
        counts[mode] = len(table)
        assert (tmp_path / "all" / mode / "plots" / "difference-vs-overdraw.png").exists()
    assert counts == {"paper": 47, "conforming": 29}
    table = pd.read_csv(tmp_path / "all" / "paper" / "triangulations.csv")
    assert table["conforming"].sum() == 29
    assert table.loc[0, "overdraw"] == 53
    assert not table.loc[0, "conforming"]
    assert table[table["conforming"]]["overdraw"].min() == 56
