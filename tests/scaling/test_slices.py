"""Files in slices: what is joined, cut and pruned, and what changes a file's identity."""

from __future__ import annotations

import os
from itertools import pairwise

import numpy as np
import pandas as pd
import pyogrio
import pytest
import shapely

from scenes import SceneError
from scenes.files import read_chunks
from scenes.slices import comparisons, cut
from tests.scaling.conftest import PER_FILE, write_parquet


def polygons_of(path, rows, **options):
    chunks = read_chunks(str(path), rows=rows, **options)
    return np.concatenate([chunk.cleaned.polygons for chunk in chunks])


def test_row_groups_are_slices_and_give_the_file(parts, footprints):
    found = cut(str(parts / "0.parquet"))
    assert found.rows == [(0, 40), (40, 80), (80, 120)]
    assert found.sizes == [40, 40, 40]
    read = np.concatenate([polygons_of(parts / "0.parquet", rows) for rows in found.rows])
    assert shapely.equals_exact(shapely.normalize(read), shapely.normalize(footprints[:120])).all()


def test_small_row_groups_are_joined_and_large_ones_are_cut(parts, monkeypatch):
    monkeypatch.setattr("scenes.slices.LEAST", 60)
    monkeypatch.setattr("scenes.slices.MOST", 80)
    assert cut(str(parts / "0.parquet")).rows == [(0, 80), (80, 120)]
    monkeypatch.setattr("scenes.slices.LEAST", 5)
    monkeypatch.setattr("scenes.slices.MOST", 15)
    rows = cut(str(parts / "0.parquet")).rows
    assert rows == [*pairwise([0, 13, 26, 40, 53, 66, 80, 93, 106, 120])]
    read = [polygons_of(parts / "0.parquet", each) for each in rows]
    assert [len(each) for each in read] == [end - start for start, end in rows]
    whole = polygons_of(parts / "0.parquet", (0, PER_FILE))
    assert (np.concatenate(read) == whole).all()


def test_statistics_prune_and_the_rest_is_filtered(parts, footprints):
    edge = float(np.sort(shapely.bounds(footprints[:PER_FILE])[:, 0])[50])
    where = f"bbox.xmin < {edge!r}"
    found = cut(str(parts / "0.parquet"), where=where)
    assert found.rows == [(0, 40), (40, 80)]
    assert found.pruned == 40
    read = [polygons_of(parts / "0.parquet", rows, where=where) for rows in found.rows]
    assert [len(each) for each in read] == [40, 10]


@pytest.mark.parametrize(
    "where",
    ["bbox.xmin > 1e9 OR id = 1", "NOT bbox.xmin > 1e9", "id IN (1, 2)", "storeys = '3'", None],
)
def test_what_is_no_plain_comparison_prunes_nothing(parts, where):
    assert comparisons(where) == []
    assert len(cut(str(parts / "0.parquet"), where=where).rows) == 3


def test_a_change_of_the_file_changes_its_identity(parts, footprints):
    before = cut(str(parts / "0.parquet")).identity
    assert cut(str(parts / "0.parquet")).identity == before
    assert cut(str(parts / "1.parquet")).identity != before
    os.utime(parts / "0.parquet", (1, 1))
    assert cut(str(parts / "0.parquet")).identity != before


def test_a_geopackage_is_cut_by_features(tmp_path, footprints, finely):
    file = tmp_path / "town.gpkg"
    pyogrio.raw.write(
        file,
        shapely.to_wkb(footprints[:100]),
        [np.arange(100)],
        ["id"],
        geometry_type="Polygon",
        crs="EPSG:3067",
    )
    found = cut(str(file))
    assert found.rows == [(0, 40), (40, 80), (80, 100)]
    tables = [next(read_chunks(str(file), rows=rows)).attributes for rows in found.rows]
    assert pd.concat(tables)["id"].tolist() == list(range(100))
    assert cut(str(file), where="id > 3").rows == [None]


def test_a_truncated_file_and_one_without_geometry_are_refused_in_one_line(parts, footprints):
    file = parts / "0.parquet"
    file.write_bytes(file.read_bytes()[:-1000])
    with pytest.raises(SceneError, match=r"0\.parquet cannot be read as GeoParquet"):
        cut(str(file))
    write_parquet(file, footprints[:10], 0, geo=None)
    with pytest.raises(SceneError, match="no geometry column"):
        cut(str(file))
