"""No polygon is lost silently: dropped polygons are noted, or the file is refused."""

import json
import os
import shutil
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import shapely

from scenes import SceneError, load
from scenes.files import read_chunks
from scenes.readers import gdal
from scenes.slices import cut_file
from tests.scenes.conftest import SQUARE, feature, require_error, write_file
from tests.scenes.samples import BOXES, KINDS, NAMED, make_files, outcome
from tests.scenes.test_files import write as write_vector


def line(x: int) -> str:
    return json.dumps(feature([[[px + x, py] for px, py in SQUARE]], name=str(x)))


class TestSequences:
    @pytest.mark.parametrize("size", [1, 3, 100])
    @pytest.mark.parametrize("has_library", [True, False])
    def test_every_line_without_a_feature_is_noted(self, tmp_path, monkeypatch, size, has_library):
        if not has_library:  # as if the GDAL library was not found
            monkeypatch.setattr(gdal, "load_library", lambda: None)
        rows = [line(0), line(20)[:40], "", "{broken", '{"type": "Town"}', "[1]", line(40), ""]
        path = write_file(tmp_path / "town.geojsonl", "\n".join(rows))
        chunks = list(read_chunks(str(path), size=size, project=False))
        assert sum(len(chunk.cleaned.polygons) for chunk in chunks) == 2
        names = [which for chunk in chunks for which, _ in chunk.cleaned.dropped]
        assert names == ["line 2", "line 4", "line 5", "line 6"]

    def test_invalid_line_is_noted_despite_a_condition_or_refused(self, tmp_path, monkeypatch):
        content = "\n".join([line(0), "{broken", line(40), ""])
        path = write_file(tmp_path / "town.geojsonl", content)
        scene = load(path, where="name = '40'", project=False)
        assert len(scene.polygons) == 1
        assert [name for name, _ in scene.dropped] == ["line 2"]
        monkeypatch.setattr("scenes.readers.vector.find_spec", lambda name: None)  # no pyarrow
        require_error("JSON parsing error", path)

    @pytest.mark.parametrize("suffix", [".geojsonl", ".geojsons", ".geojson", ".json"])
    def test_sequence_truncated_within_a_line_is_refused(self, tmp_path, suffix):
        start = "\x1e" if suffix == ".json" else ""  # the record separator of RFC 8142
        whole = "\n".join(start + line(20 * k) for k in range(4))
        path = write_file(tmp_path / f"town{suffix}", whole)
        assert len(load(path, project=False).polygons) == 4
        write_file(path, whole[:-9])
        require_error(r"is truncated \(the last line is incomplete\)", path)

    def test_text_truncated_within_a_word_is_refused(self, tmp_path):
        for start in ("P", "POLYG", "POLYGON", "POLYGON ("):
            path = write_file(tmp_path / "a.wkt", f"{BOXES[0].wkt}\n{start}")
            require_error("is truncated", path)


@pytest.mark.parametrize("where", [None, "height >= 0"])
def test_file_with_missing_features_is_refused(tmp_path, where):
    """GDAL does not report FlatGeobuf truncated between two features."""
    path = tmp_path / "a.fgb"
    write_vector(path, BOXES)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    require_error(r"\d+ of 24 features", path, where=where)


def test_slice_with_missing_features_is_refused(tmp_path):
    path = tmp_path / "a.gpkg"
    write_vector(path, BOXES)
    with pytest.raises(SceneError, match="9 of 15 features"):
        list(read_chunks(str(path), rows=(15, 30)))


def test_features_that_gdal_cannot_read_are_noted(tmp_path):
    """If the index of a Shapefile points beyond the end, features have no geometry."""
    path = tmp_path / "a.shp"
    write_vector(path, BOXES)
    index = bytearray(path.with_suffix(".shx").read_bytes())
    for record in (3, 4):
        struct.pack_into(">I", index, 100 + 8 * record, 10**6)
    path.with_suffix(".shx").write_bytes(index)
    scene = load(path)
    assert len(scene.polygons) == 22
    assert [name for name, _ in scene.dropped] == ["feature 3", "feature 4"]


def test_sequence_of_which_gdal_reads_one_line_is_refused(tmp_path):
    path = write_file(tmp_path / "town.json", "\ufeff" + line(0) + "\n" + line(20) + "\n")
    require_error("GDAL reads only some of them", path)


def test_faces_of_off_are_as_many_as_the_header_states(tmp_path):
    corners = "".join(f"{x} {y} 0\n" for y in range(3) for x in range(4))
    rows = "".join(f"4 {a} {a + 1} {a + 5} {a + 4}\n" for a in (0, 1, 2, 4, 5, 6))
    text = f"OFF # a plate\n12 6 0\n{corners}{rows}"
    path = write_file(tmp_path / "a.off", text)
    assert sum(p.area for p in load(path).polygons) == pytest.approx(6)
    for cut in (-12, -3):
        require_error("5 of 6 faces", write_file(path, text[:cut]))


class TestText:
    def test_byte_order_mark(self, tmp_path):
        path = tmp_path / "a.wkt"
        for text in (BOXES[0].wkt, f"{BOXES[0].wkt}\n{BOXES[1].wkt}\n"):
            path.write_text(text, encoding="utf-8-sig")
            scene = load(path)
            assert len(scene.polygons) == text.count("POLYGON")
            assert scene.dropped == []

    @pytest.mark.parametrize("size", [1, 100])
    def test_first_line_sets_the_reference_system(self, tmp_path, size):
        path = write_file(tmp_path / "a.wkt", f"{BOXES[0].wkt}\nSRID=3857;{BOXES[1].wkt}\n")
        chunks = list(read_chunks(str(path), size=size))
        dropped = [note for chunk in chunks for note in chunk.cleaned.dropped]
        assert dropped == [("line 2", "is in EPSG:3857, previous lines in none")]

    @pytest.mark.parametrize("size", [1, 100])
    def test_line_in_another_reference_system_is_dropped(self, tmp_path, size):
        systems = ["SRID=3067;", "", "SRID=3857;", "SRID=3067;"]
        lines = [f"{srid}{box.wkt}\n" for srid, box in zip(systems, BOXES, strict=False)]
        path = write_file(tmp_path / "a.wkt", "".join(lines))
        chunks = list(read_chunks(str(path), size=size))
        assert sum(len(chunk.cleaned.polygons) for chunk in chunks) == 3
        dropped = [note for chunk in chunks for note in chunk.cleaned.dropped]
        assert dropped == [("line 3", "is in EPSG:3857, previous lines in EPSG:3067")]

    @pytest.mark.parametrize("properties", ["x", None, 3, {"name": 4}])
    def test_invalid_crs_member_is_ignored(self, geojson, properties):
        path = Path(geojson(feature([SQUARE]), planar=False))
        crs = {"type": "name", "properties": properties}
        path.write_text(json.dumps(json.loads(path.read_text()) | {"crs": crs}))
        assert len(load(path, project=False).polygons) == 1

    def test_continued_lines(self, tmp_path):
        content = "v 0 0 0\nv 1 0 \\\n 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\r\n 3 4\n"
        (polygon,) = load(write_file(tmp_path / "a.obj", content)).polygons
        assert polygon.area == 1.0

    @pytest.mark.parametrize(
        "name",
        [
            *("a[1].geojson", "a*?.geojson", "a\x1b[31m.geojson", "it's #1 %20.geojson"),
            "a folder with spaces/häuser ü 建物.geojson",
        ],
    )
    def test_names_of_files(self, geojson, name):
        path = geojson(feature([SQUARE]), name=name)
        assert len(load(path).polygons) == 1
        assert require_error(None, path, layer="none").isprintable()

    def test_a_name_with_an_end_of_line(self, tmp_path, geojson):
        assert len(load(write_file(tmp_path / "a\nb.wkt", BOXES[0].wkt)).polygons) == 1
        path = geojson(feature([SQUARE]), name="a\nb.geojson")
        require_error(r"a\\nb.geojson has a tab or line end", path)
        Path(write_vector(tmp_path / "c.gpkg")).rename(tmp_path / "c\td.gpkg")
        with pytest.raises(SceneError, match="has a tab or line end"):
            cut_file(str(tmp_path / "c\td.gpkg"))


class TestNesting:
    """GEOS parses nested collections by recursion, which overflows the stack if they are deep."""

    DEEP = 60_000

    def test_text(self, tmp_path):
        text = "GEOMETRYCOLLECTION (" * self.DEEP + BOXES[0].wkt + ")" * self.DEEP
        path = write_file(tmp_path / "a.wkt", f"{BOXES[0].wkt}\n{text}\n{text[:900_000]}\n")
        scene = load(path)
        assert len(scene.polygons) == 1
        assert [name for name, _ in scene.dropped] == ["line 2", "line 3"]
        require_error("holds no usable polygon", write_file(path, text.replace("(", "(\n")))

    @pytest.mark.parametrize("order", "<>")
    @pytest.mark.parametrize("kind", [4, 5, 6, 7, 7 | 0x80000000, 1006, 3007])
    def test_binary(self, tmp_path, order, kind):
        level = struct.pack(f"{order}BII", order == "<", kind, 1)
        deep = level * self.DEEP + BOXES[0].wkb
        require_error("nested more than 100 levels deep", write_file(tmp_path / "a.wkb", deep))
        scene = load(write_file(tmp_path / "a.wkt", f"{deep.hex()}\n{BOXES[0].wkt}\n"))
        assert [name for name, _ in scene.dropped] == ["line 1"]

    def test_after_other_parts(self, tmp_path):
        parts = [shapely.Point(1, 2), BOXES[0].exterior, *BOXES[:2], shapely.MultiPolygon(BOXES)]
        valid_parts = [shapely.to_wkb(shapely.force_3d(part), flavor="extended") for part in parts]
        head = struct.pack("<BIII", 1, 0x20000007, 3067, len(valid_parts) + 1)
        deep = struct.pack("<BII", 1, 7, 1) * self.DEEP + BOXES[0].wkb
        path = tmp_path / "a.wkb"
        require_error("levels deep", write_file(path, head + b"".join(valid_parts) + deep))
        whole = head + b"".join([*valid_parts, valid_parts[2]])
        assert len(load(write_file(path, whole)).polygons) == 27


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes on this system")
class TestPipes:
    """A pipe is refused at once, because reading may block for ever."""

    def refused(self, path, **parameters):
        require_error("is a pipe, socket or device, not a file", path, **parameters)

    @pytest.mark.parametrize("suffix", [".geojson", ".wkt", ".svg", ".obj", ".parquet", ".gpkg"])
    def test_as_a_file_or_font_and_a_device(self, tmp_path, suffix):
        path = tmp_path / f"a{suffix}"
        os.mkfifo(path)
        self.refused(path)
        self.refused("glyphs", font=str(path))
        self.refused("/dev/zero")

    @pytest.mark.parametrize("suffix", [".dbf", ".shx", ".prj", ".cpg", ".qix"])
    def test_next_to_a_shapefile(self, tmp_path, suffix):
        path = tmp_path / "a.shp"
        write_vector(path, BOXES)
        path.with_suffix(suffix).unlink(missing_ok=True)
        os.mkfifo(path.with_suffix(suffix))
        self.refused(path)

    def test_named_by_a_model(self, tmp_path):
        model = {"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 4}]}
        path = write_file(tmp_path / "a.gltf", json.dumps(model))
        os.mkfifo(tmp_path / "a.bin")
        self.refused(path)

    @pytest.mark.parametrize("data_source", ["a.geojson", "/vsistdin/"])
    def test_named_by_a_virtual_file(self, tmp_path, data_source):
        source = f'<SrcDataSource relativeToVRT="1">{data_source}</SrcDataSource>'
        layer = f'<OGRVRTLayer name="a">{source}</OGRVRTLayer>'
        path = tmp_path / "town.vrt"
        path.write_text(f"<OGRVRTDataSource>{layer}</OGRVRTDataSource>")
        os.mkfifo(tmp_path / "a.geojson")
        self.refused(path)


def test_damaged_font_loses_letters_or_is_refused(tmp_path):
    from matplotlib import font_manager

    data = shutil.copy(font_manager.findfont("DejaVu Sans Mono"), tmp_path / "a.ttf").read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(12):
        damaged = np.frombuffer(data, dtype=np.uint8).copy()
        positions = rng.integers(0, len(damaged), rng.choice([3, 300, 3000]))
        damaged[positions] = rng.integers(0, 256, len(positions))
        (tmp_path / "a.ttf").write_bytes(damaged.tobytes())
        with suppress(SceneError):  # anything else is an error
            load("glyphs", font=str(tmp_path / "a.ttf"), text="AgB&")


@pytest.mark.parametrize("kind", KINDS)
def test_complete_files_are_read_and_truncated_ones_refused(kind):
    """Except if the truncation is undetectable or removes no polygon; see also tests/fuzz."""
    data = make_files(kind)[f"a.{kind}"]
    assert outcome(kind, data) == "read"
    for share in (0.35, 0.6, 0.8, 0.97):
        length = int(share * len(data))
        assert outcome(kind, data[:length], length) != NAMED or kind == "tab"
    outcome(kind, data[:-3], len(data) - 3)
