"""Data sets: each footprint once, resumption, reported faults, incompatible results."""

import errno
import json
import os
import shutil
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyogrio
import pytest
import shapely

from harness import atomic
from harness.errors import IncompatibleRunsError, UsageError
from harness.progress import Reporter
from harness.scaling.dataset import MANIFEST, Dataset
from harness.scaling.executors import Executor
from harness.scaling.triangulated import Triangulating
from harness.triangulating.triangulate import triangulate_many
from scenes.files import read_chunks
from scenes.slices import cut_file, parse_comparisons
from tests.conftest import require_ok
from tests.scaling.conftest import (
    EVERY,
    PER_FILE,
    find_parts,
    read_all,
    read_ids,
    read_parts,
    write_parquet,
)
from tests.scenes.test_files import write

WORK = Triangulating("optimal:half-perimeter")


def complete(pattern, out, work=WORK):
    return Dataset(str(pattern), out, work).complete(Executor(), Reporter(quiet=True))


def read_manifest(out):
    """Return the manifest of an output folder without times."""
    content = json.loads((out / MANIFEST).read_text())
    for part in content["parts"]:
        del part["seconds"]
    return content


def test_each_footprint_is_triangulated_once(parts, tmp_path, footprints):
    summary = complete(parts, tmp_path / "out")
    assert read_ids(tmp_path / "out") == list(range(EVERY))
    assert summary.polygons == summary.proven == EVERY
    expected = triangulate_many(footprints, WORK.triangulator)
    assert summary.triangles == len(expected.triangles)
    tables = pa.concat_tables(read_all(tmp_path / "out"))
    areas = shapely.area(shapely.from_wkb(tables["geometry"].to_numpy()))
    assert areas == pytest.approx(shapely.area(footprints))
    counts = shapely.get_num_geometries(shapely.from_wkb(tables["geometry"].to_numpy()))
    assert counts.tolist() == np.diff(expected.triangle_offsets).tolist()


def test_all_parts_have_one_schema_and_the_sources_types(parts, tmp_path):
    complete(parts, tmp_path / "out")
    schemas = [table.schema for table in read_all(tmp_path / "out")]
    assert all(schema.equals(schemas[0]) for schema in schemas)
    assert schemas[0].field("storeys").type == pa.int16()
    assert pa.types.is_struct(schemas[0].field("bbox").type)
    storeys = pa.concat_tables(read_all(tmp_path / "out"))["storeys"].to_pylist()
    assert storeys == [None if n % 7 == 3 else n % 5 for n in range(EVERY)]


def test_rerun_completes_only_missing_parts(parts, tmp_path):
    out = tmp_path / "out"
    complete(parts, out)
    before = read_parts(out)
    manifest = read_manifest(out)
    first, second, third, *_ = find_parts(out)
    first.unlink()
    second.write_bytes(second.read_bytes()[:-50])
    (out / MANIFEST).unlink()
    stamp = third.stat().st_mtime_ns
    summary = complete(parts, out)
    assert (summary.fresh, summary.parts_done) == (2, 6)
    assert read_parts(out) == before
    assert third.stat().st_mtime_ns == stamp
    assert read_manifest(out) == manifest


def test_keys_depend_on_content_and_not_on_the_path(parts, tmp_path, footprints):
    complete(parts, tmp_path / "out")
    moved = parts.rename(tmp_path / "elsewhere")
    complete(moved, tmp_path / "moved")
    assert read_parts(tmp_path / "moved") == read_parts(tmp_path / "out")
    complete(moved, tmp_path / "other", Triangulating("refined:half-perimeter"))
    assert not set(read_parts(tmp_path / "other")) & set(read_parts(tmp_path / "out"))


def test_repeated_file_is_processed_twice(parts, tmp_path):
    (parts / "again").mkdir()
    shutil.copy2(parts / "0.parquet", parts / "again")
    summary = complete(f"{parts}/**/*.parquet", tmp_path / "out")
    assert summary.parts_done == 9
    assert len(find_parts(tmp_path / "out")) == 9


def test_results_of_other_options_code_or_input_are_not_mixed(parts, tmp_path, footprints):
    out = tmp_path / "out"
    complete(parts, out)
    with pytest.raises(IncompatibleRunsError, match="results written with other options"):
        complete(parts, out, Triangulating("optimal:overdraw"))
    write_parquet(parts / "1.parquet", footprints[:60], 0)
    with pytest.raises(IncompatibleRunsError, match=r"older version of 1\.parquet"):
        complete(parts, out)
    stranger = tmp_path / "own"
    stranger.mkdir()
    write_parquet(stranger / "mine.parquet", footprints[:10], 0)
    with pytest.raises(UsageError, match=r"mine\.parquet was not written by this command"):
        complete(parts, stranger)


def test_invalid_files_are_reported_and_the_exit_code_is_5(harness, parts, tmp_path, footprints):
    torn = parts / "2-torn.parquet"
    torn.write_bytes((parts / "0.parquet").read_bytes()[:5000])
    write_parquet(parts / "3-plain.parquet", footprints[:10], 0, geo=None)
    code, _, error = harness("triangulate", f"{parts}/*.parquet", "-o", "out")
    assert code == 5
    assert read_ids(tmp_path / "out") == list(range(EVERY))
    lines = [line for line in error.splitlines() if line.startswith("warning: set aside")]
    assert len(lines) == 2
    assert "2-torn.parquet is truncated" in lines[0]
    assert "3-plain.parquet has no geometry column" in lines[1]
    assert error.splitlines()[-1].startswith("error: out: 2 parts were set aside")
    aside = json.loads((tmp_path / "out" / MANIFEST).read_text())["summary"]["set_aside"]
    assert set(aside) == {str(torn), str(parts / "3-plain.parquet")}


def test_rerun_after_a_full_disk_completes_the_part(parts, tmp_path, monkeypatch):
    out = tmp_path / "out"
    refused = []
    move = atomic.move

    def full(output, path, *, forced=False):
        if path.suffix == ".parquet" and path.stem == key:
            refused.append(path)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        move(output, path, forced=forced)

    dataset = Dataset(str(parts), out, WORK)
    key = dataset.missing[2].key
    with monkeypatch.context() as patch:
        patch.setattr(atomic, "move", full)
        summary = dataset.complete(Executor(), Reporter(quiet=True))
    assert len(refused) == 3
    ((which, why),) = summary.set_aside.items()
    assert which == dataset.parts[2].label
    assert "No space left on device" in why
    assert summary.parts_done == 5
    assert len(read_ids(out)) == EVERY - 40
    assert sorted(file.name for file in out.iterdir()) == sorted([MANIFEST, *read_parts(out)])
    assert complete(parts, out).fresh == 1
    assert read_ids(out) == list(range(EVERY))


def test_dropped_features_are_counted_by_reason(tmp_path, footprints, finely):
    odd = footprints[:90].copy()
    odd[[3, 50]] = shapely.Point(0, 0)
    odd[60] = shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)])
    write_parquet(tmp_path / "odd.parquet", odd, 0)
    summary = complete(tmp_path / "odd.parquet", tmp_path / "out")
    assert summary.counts == {
        ("dropped", "is a Point, not a polygon"): 2,
        ("repaired", "self-intersects"): 1,
    }
    assert summary.polygons == 89


def test_condition_prunes_and_filters_rows(harness, parts, tmp_path, footprints):
    edge = float(shapely.bounds(footprints)[100, 0])
    condition = f"bbox.xmin < {edge!r} AND storeys < 0"
    command = ("triangulate", f"{parts}/*.parquet", "--where")
    _, error = require_ok(harness(*command, condition, "-o", "out"))
    assert "skipped 240 rows unread" in error
    require_ok(harness(*command, "id < 50 AND storeys IS NULL", "-o", "few"))
    assert read_ids(tmp_path / "few") == [n for n in range(50) if n % 7 == 3]
    assert {len(table) for table in read_all(tmp_path / "few")} == {0, 1, 6}


def test_a_file_without_a_feature_is_an_empty_part(tmp_path):
    (tmp_path / "none.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    summary = complete(tmp_path / "none.geojson", tmp_path / "out")
    assert (summary.parts_done, summary.polygons, summary.set_aside) == (1, 0, {})


def test_certificates_are_summed_over_parts(parts, tmp_path):
    work = Triangulating("ear-clipping", where="id < 45", certify=True)
    summary = complete(parts / "0.parquet", tmp_path / "out", work)
    assert [part["polygons"] for part in summary.certified] == [40, 5]
    assert 0 < summary.proven < 45


def test_ctrl_c_keeps_completed_parts_and_names_the_remedy(harness, parts, tmp_path, monkeypatch):
    write, calls = Triangulating.write_part, count(1)

    def stopping(*arguments):
        if next(calls) == 4:
            raise KeyboardInterrupt
        return write(*arguments)

    monkeypatch.setattr(Triangulating, "write_part", stopping)
    code, _, error = harness("triangulate", f"{parts}/*.parquet", "-o", "out")
    assert code == 130
    assert "stopped; 3 of 6 parts are in out; to continue, run the same command again" in error
    assert len(json.loads((tmp_path / "out" / MANIFEST).read_text())["parts"]) == 3
    _, error = require_ok(harness("triangulate", f"{parts}/*.parquet", "-o", "out"))
    assert "3 of 6 parts exist already" in error
    assert read_ids(tmp_path / "out") == list(range(EVERY))


def test_usage_errors_are_one_line(harness, parts):
    for arguments, message in (
        (["nothing-*.parquet", "-o", "out"], "nothing-*.parquet: no such file"),
        ([f"{parts}/*.parquet", "-o", "out.glb"], "give a folder, to store a file for each part"),
        ([f"{parts}/*.parquet", "-o", "out", "--limit", "3"], "--limit is for one file"),
        ([f"{parts}/*.parquet", "-o", "out", "--where", "colour = 3"], None),
    ):
        code, _, error = harness("triangulate", *arguments)
        assert code == (2 if message else 5)
        assert (message or "no such column: colour") in error


def polygons_of(path, rows, **options):
    chunks = read_chunks(str(path), rows=rows, **options)
    return np.concatenate([chunk.cleaned.polygons for chunk in chunks])


def test_small_row_groups_are_joined_and_large_groups_split(parts, monkeypatch):
    monkeypatch.setattr("scenes.slices.MIN_ROWS", 60)
    monkeypatch.setattr("scenes.slices.MAX_ROWS", 80)
    assert cut_file(str(parts / "0.parquet")).rows == [(0, 80), (80, 120)]
    monkeypatch.setattr("scenes.slices.MIN_ROWS", 5)
    monkeypatch.setattr("scenes.slices.MAX_ROWS", 15)
    rows = cut_file(str(parts / "0.parquet")).rows
    assert rows == [*pairwise([0, 13, 26, 40, 53, 66, 80, 93, 106, 120])]
    read = [polygons_of(parts / "0.parquet", rows_of_part) for rows_of_part in rows]
    assert [len(rows_of_part) for rows_of_part in read] == [end - start for start, end in rows]
    complete = polygons_of(parts / "0.parquet", (0, PER_FILE))
    assert (np.concatenate(read) == complete).all()


def test_statistics_prune_row_groups_and_rows_are_filtered(parts, footprints):
    edge = float(np.sort(shapely.bounds(footprints[:PER_FILE])[:, 0])[50])
    condition = f"bbox.xmin < {edge!r}"
    slices = cut_file(str(parts / "0.parquet"), where=condition)
    assert (slices.rows, slices.sizes) == ([(0, 40), (40, 80)], [40, 40])
    assert slices.pruned == 40
    read = [polygons_of(parts / "0.parquet", rows, where=condition) for rows in slices.rows]
    assert [len(polygons) for polygons in read] == [40, 10]


@pytest.mark.parametrize(
    "condition",
    ["bbox.xmin > 1e9 OR id = 1", "NOT bbox.xmin > 1e9", "id IN (1, 2)", "storeys = '3'", None],
)
def test_only_plain_comparisons_prune(parts, condition):
    assert parse_comparisons(condition) == []
    assert len(cut_file(str(parts / "0.parquet"), where=condition).rows) == 3


def test_a_change_of_the_file_changes_its_identity(parts, footprints):
    before = cut_file(str(parts / "0.parquet")).identity
    assert cut_file(str(parts / "0.parquet")).identity == before
    assert cut_file(str(parts / "1.parquet")).identity != before
    os.utime(parts / "0.parquet", (1, 1))
    assert cut_file(str(parts / "0.parquet")).identity != before


@pytest.mark.parametrize("suffix", [".dbf", ".prj"])
def test_a_change_of_a_part_of_a_shapefile_changes_its_identity(tmp_path, suffix):
    file = Path(write(tmp_path / "town.shp"))
    before = cut_file(str(file)).identity
    file.with_suffix(suffix).rename(tmp_path / f"old{suffix}")
    assert cut_file(str(file)).identity != before


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
    slices = cut_file(str(file))
    assert slices.rows == [(0, 40), (40, 80), (80, 100)]
    tables = [next(read_chunks(str(file), rows=rows)).attributes for rows in slices.rows]
    assert pd.concat(tables)["id"].tolist() == list(range(100))
    assert cut_file(str(file), where="id > 3").rows == [None]
