"""Census of map tiles: counters equal those of the scene, for all archives, in parts."""

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest
import shapely
from pmtiles.tile import Compression, Entry, TileType, serialize_directory, zxy_to_tileid
from pmtiles.writer import write

from harness.frame import get_scene_view, make_scene_frame
from harness.grid import SUBPIXEL
from harness.progress import Reporter
from harness.rasterisers.reference import count_per_triangle
from harness.scaling.census import TileCensus
from harness.scaling.counts import CensusCounts
from harness.scaling.dataset import Dataset, Summary
from harness.scaling.executors import Executor
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import SceneError, load
from scenes.readers.tile_archives import PMTiles, TilePosition, compute_first_number, open_archive
from scenes.slices import MAX_TILES, cut_tiles, parse_tile_selection
from scenes.tiles import FILE
from tests.conftest import assert_refused, require_ok
from tests.scenes.test_tiles import COURT, encoded, pmtiles, three_archives

NAMES = ("ear-clipping", "flips:l1")
EXACT = ("fragments", "quads", "helper_lanes", "partial_quads", "bbox_tests", "triangles")


def count_all(text: str, out: Path, names: tuple[str, ...] = NAMES) -> tuple[CensusCounts, Summary]:
    name, selection = parse_tile_selection(text)
    dataset = Dataset(name, out, TileCensus(names, selection))
    summary = dataset.complete(Executor(), Reporter(quiet=True))
    return CensusCounts.read(out / f"{key}.npz" for key in dataset.keys_done), summary


def sum_scene(text: str, names: tuple[str, ...] = NAMES) -> dict[tuple[str, str], dict]:
    """Return sums by layer and triangulator of the scene with a view per tile."""
    scene = load(text)
    frame = make_scene_frame(scene, get_scene_view(scene))
    layers = scene.attributes["layer"].to_numpy()[frame.source]
    sums = {}
    for name in names:
        rows = frame.join_triangles(triangulate_polygons(parse(name), frame.polygons).parts)
        counted = count_per_triangle(frame.points, rows, frame.window)
        counted["triangles"] = np.ones(len(rows), np.int64)
        width, height = np.ptp(frame.points[rows] / SUBPIXEL, axis=1).T
        counted["half_perimeter"] = width + height
        owner = layers[frame.find_owners(rows)]
        for layer in set(layers):
            values_of_layer = {key: values[owner == layer].sum() for key, values in counted.items()}
            sums[layer, name] = values_of_layer | {
                "polygons": len(set(frame.source[layers == layer]))
            }
    return sums


@pytest.mark.parametrize(("zoom", "pixels"), [(12, 512), (14, 512), (13, 256), (13, 1024)])
def test_sums_equal_those_of_the_scene(zoom, pixels, tmp_path, monkeypatch):
    monkeypatch.setattr("scenes.slices.MAX_TILES", 2)
    monkeypatch.setattr("harness.scaling.counts.CHUNK_ROWS", 300)
    counted, summary = count_all(f"{FILE}:zoom={zoom},pixels={pixels}", tmp_path)
    expected = sum_scene(f"helsinki-tiles:zoom={zoom},tiles=999,pixels={pixels}")
    assert summary.parts == {12: 1, 13: 1, 14: 2}[zoom]
    assert set(counted.groups) == {(zoom, "area"), (zoom, "building")}
    for (layer, name), scene_sums in expected.items():
        sums = counted.groups[zoom, layer]
        assert sums.get_count("polygons") == scene_sums["polygons"]
        for measure in EXACT:
            total = sums.get_total(measure)[NAMES.index(name)]
            assert total == scene_sums[measure], (layer, name, measure)
        half = sums.get_total("half_perimeter")[NAMES.index(name)]
        assert half == pytest.approx(scene_sums["half_perimeter"], rel=1e-12)


def test_lost_polygons_tiles_and_vertices_are_counted(tmp_path):
    counted, summary = count_all(f"{FILE}:zoom=14", tmp_path)
    groups, total = counted.groups, counted.sum_groups()
    scene = load("helsinki-tiles:zoom=14,tiles=999")
    layers = [which.split()[1] for which, _ in scene.dropped]
    assert {layer: sums.get_count("dropped") for (_, layer), sums in groups.items()} == {
        layer: layers.count(layer) for layer in ("area", "building")
    }
    assert total.get_count("repaired") == len(scene.repaired)
    assert [sums.get_count("tiles") for sums in groups.values()] == [4, 4]
    frame = make_scene_frame(scene, get_scene_view(scene))
    assert total.get_count("vertices") == len(frame.points)
    assert sum(count for (kind, _), count in summary.counts.items() if kind == "dropped") == 5


def write_tiles(path: Path, tiles: dict[int, bytes]) -> str:
    with write(str(path)) as writer:
        for number, data in tiles.items():
            writer.write_tile(number, data)
        header = {"tile_type": TileType.MVT, "tile_compression": Compression.NONE}
        writer.finalize(header, {})
    return str(path)


def test_repeated_tiles_are_multiplied(tmp_path, monkeypatch):
    first, read, original, sums = compute_first_number(8), [], PMTiles.read, []
    monkeypatch.setattr(PMTiles, "read", lambda *args: read.append(args) or original(*args))
    for count in (1, 9):
        tiles = {first + k: encoded([COURT]) for k in range(count)}
        path = write_tiles(tmp_path / f"{count}.pmtiles", tiles)
        counts, _ = count_all(path, tmp_path / str(count))
        sums.append(counts.groups[8, "land"])
        assert len(read) == len(sums)
    one, nine = sums
    assert [nine.get_count(name) for name in ("polygons", "tiles")] == [9, 9]
    for values, values_of_one in zip(nine, one, strict=True):
        assert np.array_equal(values, 9 * values_of_one)


def test_slices_partition_the_tiles(tmp_path):
    first = compute_first_number(9)
    tiles = {first + 3 * k: bytes([k % 251, k // 251]) * 2 for k in range(10_000)}
    path = write_tiles(tmp_path / "a.pmtiles", tiles)
    slices = cut_tiles(path, None)
    assert len(slices.rows) == -(-len(tiles) // MAX_TILES)
    assert sum(slices.sizes) == len(tiles)
    assert max(slices.sizes) == MAX_TILES
    archive = open_archive(Path(path))
    tile_runs = [run for rows in slices.rows for run in archive.list_tile_runs(9, *rows)]
    assert [archive.get_tile_key(run.first) for run in tile_runs] == archive.list_tile_keys(9)


def test_large_tiles_are_separate_slices(tmp_path, monkeypatch):
    monkeypatch.setattr("scenes.slices.MAX_BYTES", 100)
    sizes = (40, 40, 40, 300, 10, 90, 1)
    tiles = {compute_first_number(4) + k: bytes([k]) * size for k, size in enumerate(sizes)}
    assert cut_tiles(write_tiles(tmp_path / "a.pmtiles", tiles), None).sizes == [2, 1, 1, 2, 1]


def test_entries_next_to_leaves_are_in_order(tmp_path):
    """A root directory may have entries and leaves, in the order of tile numbers."""
    first = compute_first_number(3)
    leaf = serialize_directory([Entry(first + 1, 0, 4, 1), Entry(first + 2, 4, 4, 1)])
    before, after = Entry(first, 8, 4, 1), Entry(first + 9, 12, 4, 2)
    root = serialize_directory([before, Entry(first + 1, 0, len(leaf), 0), after])
    zooms = {"min_zoom": 3, "max_zoom": 3}
    tiles = PMTiles(Path(pmtiles(tmp_path / "a.pmtiles", root, leaf, b"aaaabbbbccccdddd", **zooms)))
    stored = [tiles.read_stored(name) for name in tiles.list_tile_keys(3)]
    assert stored == [b"cccc", b"aaaa", b"bbbb", b"dddd", b"dddd"]
    tile_runs = [(run.first - first, run.repeats) for run in tiles.list_tile_runs(3)]
    assert tile_runs == [(0, 1), (1, 1), (2, 1), (9, 2)]


def test_repeated_entry_is_skipped(tmp_path):
    """In a damaged archive two entries may have the same number; the tile is read once."""
    first = compute_first_number(3)
    root = serialize_directory([Entry(first + offset, 0, 4, 1) for offset in (0, 2, 2, 5)])
    path = Path(pmtiles(tmp_path / "a.pmtiles", root, data=b"aaaa", min_zoom=3, max_zoom=3))
    assert [run.first - first for run in PMTiles(path).list_tile_runs(3)] == [0, 2, 5]
    assert len(PMTiles(path).list_tile_keys(3)) == 3


def test_damaged_tile_is_reported_and_others_counted(tmp_path):
    tiles = {TilePosition(5, k, 7): encoded([COURT]) for k in range(4)}
    file = write_tiles(tmp_path / "good.pmtiles", {zxy_to_tileid(*k): v for k, v in tiles.items()})
    good = count_all(file, tmp_path / "good")[0].groups
    tiles[TilePosition(5, 2, 7)] = tiles[TilePosition(5, 2, 7)][:-3]
    for kind, path in three_archives(tmp_path, tiles, Compression.NONE).items():
        counts, summary = count_all(path, tmp_path / f"bad-{kind}")
        ((name, why),) = counts.damaged
        assert name == "5/2/7"
        assert why.startswith("cannot be read: not a vector tile")
        assert counts.layers == {"land"}
        assert summary.counts["damaged", "tile or layer that cannot be read"] == 1
        assert counts.groups[5, "land"].get_count("tiles") == 3
        assert np.array_equal(4 * counts.groups[5, "land"].totals, 3 * good[5, "land"].totals)


def test_lost_polygons_are_counted_and_rounding_reported(tmp_path):
    tile = encoded([shapely.box(0, 0, 1, 1), COURT])
    path = write_tiles(tmp_path / "a.pmtiles", {0: tile})
    counts, summary = count_all(f"{path}:pixels=8", tmp_path / "small")
    assert [counts.sum_groups().get_count(name) for name in ("polygons", "dropped")] == [1, 1]
    assert summary.counts["dropped", "thinner than the grid of 1/256 px"] == 1
    lines: list[str] = []
    reporter = Reporter(quiet=True)
    reporter.say_once = lines.append
    path = write_tiles(tmp_path / "5000.pmtiles", {0: encoded([COURT], extents=5000)})
    name, selection = parse_tile_selection(path)
    dataset = Dataset(name, tmp_path / "5000", TileCensus(NAMES, selection))
    dataset.complete(Executor(), reporter)
    assert "1/5000 of 512 px" in lines[0]


def read_table(folder: Path) -> list[dict[str, str]]:
    with (folder / "census.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_command_has_a_line_for_each_zoom_and_layer(harness, tmp_path):
    arguments = ("census", f"{FILE}:zoom=9-13", "-o", "out", "--triangulators", ",".join(NAMES))
    out, error = require_ok(harness(*arguments))
    lines = [line.split() for line in out.splitlines() if line.startswith(("12", "13"))]
    assert [line[:2] for line in lines] == [
        [zoom, layer] for zoom in ("12", "13") for layer in ("area", "building")
    ]
    assert "warning: dropped" in error
    rows = [row for row in read_table(tmp_path / "out") if row["measure"] == "helper_lanes"]
    assert len(rows) == 4 * len(NAMES)
    for line, row in zip(lines, rows[1::2], strict=True):
        counts = [row[name] for name in ("tiles", "polygons", "dropped")]
        counts.append(f"{float(row['total_of_base']):.0f}")
        assert [cell.replace(",", "") for cell in line[2:6]] == counts
        assert line[6] == f"{-float(row['gain_of_total']):+z.1%}"
    assert (tmp_path / "out" / "plots" / "gains.svg").stat().st_size > 5000
    assert not (tmp_path / "out" / "damaged.csv").exists()
    before = (tmp_path / "out" / "census.csv").read_bytes()
    parts = sorted((tmp_path / "out" / "parts").glob("*.npz"))
    assert len(parts) == 2
    parts[0].unlink()
    parts[1].write_bytes(parts[1].read_bytes()[:-40])  # as a disk that was full leaves it
    assert harness(*arguments)[0] == 0
    assert (tmp_path / "out" / "census.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["FILE:zoom=3"], "has no zoom 3; it has 12 to 16"),
        (["FILE:zoom=3-4"], "has no zooms 3 to 4; it has 12 to 16"),
        (["FILE:zoom=16-12"], "zoom=16-12 is invalid: give zoom=14 or zoom=12-16"),
        (["FILE:zoom=x"], "zoom=x is invalid"),
        (["FILE:pixels=7"], "pixels=7 is not an even number"),
        (["FILE:layer=a"], "has no parameter 'layer'; did you mean layers?"),
        (["FILE:zoom=12,layers=wood"], "no layer 'wood'; it has: area, building"),
        (["FILE", "--cell", "5"], "--cell is not for map tiles; write FILE:zoom=12-16"),
        (["FILE", "--triangulators", "fan"], "give two or more to compare"),
        (["no.pmtiles"], "no.pmtiles: no such file"),
        (["bad.pmtiles"], "is not a PMTiles archive: give a PMTiles archive of version 3"),
        (["a.mvt:zoom=3"], "is unknown: leave zoom= out"),
        (["a.gpkg:pixels=512"], "a.gpkg holds no tiles"),
    ],
)
def test_usage_errors_are_one_line(harness, tmp_path, arguments, message):
    (tmp_path / "bad.pmtiles").write_bytes(bytes(200))
    (tmp_path / "a.mvt").write_bytes(encoded([COURT]))
    (tmp_path / "a.gpkg").write_bytes(b"x")
    options = [argument.replace("FILE", str(FILE)) for argument in arguments]
    err = assert_refused(harness("census", *options, "-o", "out", "-q"), message)
    assert err.count("\n") == 1


def test_which_files_are_map_tiles(tmp_path):
    for name in ("a.mvt", "zooms/14/9/8.pbf", "packed/b.mvt.gz", "archives/c.pmtiles"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(gzip.compress(encoded([COURT])))
    (tmp_path / "no").mkdir()
    (tmp_path / "no" / "a.osm.pbf").write_bytes(b"")
    for name in ("a.mvt", "zooms", "packed", "archives", "archives/*.pmtiles"):
        assert parse_tile_selection(str(tmp_path / name)) is not None, name
    for name in ("no", "no/a.osm.pbf", "a.parquet", "*.gpkg"):
        assert parse_tile_selection(str(tmp_path / name)) is None, name
    with pytest.raises(SceneError, match="has no parameter 'tiles'"):
        parse_tile_selection("a.pmtiles:tiles=4")
    counts, _ = count_all(str(tmp_path / "packed"), tmp_path / "out")
    assert list(counts.groups) == [(None, "land")]
