"""Fuzz: whatever bytes a file holds, its reader gives sound polygons or one clear line."""

import json
import random
from pathlib import Path

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenes import Scene, SceneError, load
from tests.scenes.conftest import assert_sound, feature
from tests.scenes.test_files import write as write_vector
from tests.scenes.test_readers import FACES, GABLE, HOLED, cityjson, geoparquet, ply

FUZZ = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
SVG = (
    '<svg><g transform="scale(2)"><path d="M0 0h10v10h-10z M2 2h4v4h-4z"/><circle r="4"/></g></svg>'
)


class Samples(dict[str, bytes]):
    """Files by name; a failing example must not print them all."""

    def __repr__(self) -> str:
        return f"Samples of {len(self)} formats"


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Samples:
    """A sound file of each format."""
    folder = tmp_path_factory.mktemp("sound")
    for suffix in (".geojson", ".gpkg", ".fgb"):
        write_vector(folder / f"a{suffix}")
    geoparquet(folder / "a.parquet", [HOLED, None], h=[1.0, 2.0])
    (folder / "a.wkt").write_text(f"{HOLED.wkt}\n{HOLED.wkb_hex}\n")
    (folder / "a.wkb").write_bytes(HOLED.wkb)
    (folder / "a.svg").write_text(SVG)
    (folder / "a.city.json").write_text(cityjson())
    (folder / "a.obj").write_text(GABLE + "".join(f"f {face}\n" for face in FACES))
    (folder / "a.ply").write_bytes(ply("binary_little_endian"))
    (folder / "ascii.ply").write_bytes(ply("ascii"))
    return Samples({path.name: path.read_bytes() for path in folder.iterdir()})


def sound_or_refused(path: Path) -> Scene | None:
    refusal = ""
    try:
        scene = load(path)
    except SceneError as error:
        refusal = str(error)
    if refusal:
        assert "\n" not in refusal
        assert path.name in refusal
        return None
    assert_sound(scene.polygons)
    return scene


NAMES = (
    *("a.geojson", "a.gpkg", "a.fgb", "a.parquet", "a.wkt", "a.wkb", "a.svg"),
    *("a.city.json", "a.obj", "a.ply", "ascii.ply"),
)


@pytest.mark.parametrize("name", NAMES)
@FUZZ
@given(seed=st.integers(0, 2**32), cuts=st.integers(0, 3), flips=st.integers(0, 6))
def test_damaged_files(samples, tmp_path, name, seed, cuts, flips):
    """Bytes flipped, pieces removed or doubled, the end cut off."""
    data, rng = bytearray(samples[name]), random.Random(seed)
    for _ in range(flips):
        data[rng.randrange(len(data))] = rng.randrange(256)
    for _ in range(cuts):
        at, length = rng.randrange(len(data)), rng.randrange(1, 40)
        piece = data[at : at + length]
        data[at : at + length] = piece * rng.randrange(3)
    if rng.random() < 0.3:
        data = data[: rng.randrange(len(data))]
    path = tmp_path / name
    path.write_bytes(data)
    sound_or_refused(path)


@pytest.mark.parametrize("name", NAMES)
def test_undamaged_samples_are_read(samples, tmp_path, name):
    path = tmp_path / name
    path.write_bytes(samples[name])
    assert sound_or_refused(path) is not None


@pytest.mark.parametrize("suffix", [".geojson", ".wkt", ".svg", ".obj", ".ply", ".json", ".wkb"])
@FUZZ
@given(data=st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
def test_arbitrary_bytes(tmp_path, suffix, data):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data)
    sound_or_refused(path)


number = st.integers(-10, 10) | st.floats(allow_nan=False, allow_infinity=False)
ring = st.lists(st.lists(number, min_size=2, max_size=3), max_size=8)
coordinates = st.lists(ring, max_size=3) | st.lists(st.lists(ring, max_size=3), max_size=3) | ring


@FUZZ
@given(
    st.lists(coordinates, max_size=4), st.sampled_from(["Polygon", "MultiPolygon", "LineString"])
)
def test_arbitrary_geojson(tmp_path, many, kind):
    collection = {"type": "FeatureCollection", "features": [feature(c, kind) for c in many]}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps(collection))
    sound_or_refused(path)


@FUZZ
@given(st.text(alphabet="MmLlHhVvCcQqAaSsTtZz0123456789.,- e", max_size=60))
def test_arbitrary_path_data(tmp_path, data):
    path = tmp_path / "a.svg"
    path.write_text(f'<svg><path d="{data}"/></svg>')
    sound_or_refused(path)


@pytest.mark.parametrize("size", [1e9, 1e-12, 1e-300])
def test_extreme_sizes(tmp_path, size):
    path = tmp_path / "a.wkt"
    path.write_text(shapely.box(0, 0, size, size).wkt)
    scene = sound_or_refused(path)
    assert (scene is None) == (size == 1e-300)


def test_a_condition_cannot_do_more_than_select(tmp_path):
    path = geoparquet(tmp_path / "a.parquet", [HOLED], h=[1.0])
    for condition in ("1); DROP TABLE features; --", "h = 1; SELECT 1", "load_extension('x')"):
        with pytest.raises(SceneError, match="is not valid"):
            load(path, where=condition)


@pytest.mark.parametrize("suffix", [".wkt", ".obj", ".geojson", ".gpkg", ".ply", ".svg", ".json"])
def test_a_gigabyte_of_nothing(tmp_path, suffix):
    path = tmp_path / f"huge{suffix}"
    with path.open("wb") as stream:  # a hole: it takes no room on the disk
        stream.truncate(2**30)
    assert sound_or_refused(path) is None
