from importlib.metadata import EntryPoint

import pytest
import shapely

from scenes import Scene, SceneError, UnknownScene, load, names, registry
from tests.scenes.conftest import SQUARE, assert_sound, feature


def test_names_have_entries_that_load():
    assert "city" in names()
    assert registry.entry("city").available() is None


def test_size_counts_polygons_vertices_and_holes():
    scene = load("city")
    polygons, vertices, holes = registry.entry("city").size()
    assert polygons == len(scene.polygons) == 500
    assert vertices == sum(
        len(ring.coords) - 1 for p in scene.polygons for ring in (p.exterior, *p.interiors)
    )
    assert holes == sum(len(p.interiors) for p in scene.polygons)


def test_parameters_in_the_name():
    scene = load("city:buildings=20,seed=3")
    assert scene.content_hash == load("city", buildings=20, seed=3).content_hash
    assert scene.parameters == {"buildings": 20, "seed": 3}


def test_limit_keeps_the_first():
    assert load("city:buildings=20,limit=5").polygons == load("city", buildings=20).polygons[:5]


def test_unknown_scene_suggests_the_nearest():
    with pytest.raises(UnknownScene, match="did you mean city"):
        load("ctiy")
    with pytest.raises(UnknownScene, match="there are: city"):
        load("qqqqq")
    assert issubclass(UnknownScene, SceneError)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("city:buildngs=5", "did you mean buildings"),
        ("city:buildings=many", "is not int"),
        ("city:limit=0", "give 1 or more"),
        ("city:seed=x", "is not int"),
    ],
)
def test_wrong_parameters_are_refused(spec, message):
    with pytest.raises(SceneError, match=message):
        load(spec)


def test_a_file_named_like_a_scene_needs_its_suffix(geojson, monkeypatch, tmp_path):
    geojson(feature([SQUARE]), name="town.geojson")
    monkeypatch.chdir(tmp_path)
    assert load("town.geojson").name == "town"
    assert load("./town.geojson:limit=1").polygons[0].area == 100


class Installed:
    """Stands for another package's module of scenes."""

    @staticmethod
    def bare(*, seed: int, size: float = 1.0) -> list[shapely.Polygon]:
        return [shapely.box(0, 0, size, seed + 1)]

    @staticmethod
    def nothing(*, seed: int) -> list[shapely.Polygon]:
        return []

    @staticmethod
    def wrong(*, seed: int) -> int:
        return seed


@pytest.fixture
def installed(monkeypatch):
    points = [
        EntryPoint(name, f"tests.scenes.test_registry:Installed.{name}", registry.GROUP)
        for name in ("bare", "nothing", "wrong")
    ]
    points.append(EntryPoint("broken", "no_such_module:f", registry.GROUP))
    monkeypatch.setattr(registry, "entry_points", lambda group: points)


@pytest.mark.usefixtures("installed")
class TestEntryPoints:
    def test_are_listed_and_loaded(self):
        assert "bare" in names()
        scene = load("bare:size=3", seed=1)
        assert isinstance(scene, Scene)
        assert_sound(scene.polygons)
        assert scene.polygons[0].area == 6

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("nothing", "holds no polygon"),
            ("wrong", "returned int"),
            ("broken", "cannot be imported"),
        ],
    )
    def test_failures_are_one_clear_line(self, name, message):
        with pytest.raises(SceneError, match=message) as caught:
            load(name)
        assert "\n" not in str(caught.value)
