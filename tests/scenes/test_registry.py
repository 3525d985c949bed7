import sys
from importlib.metadata import EntryPoint

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from scenes import Scene, SceneError, UnknownSceneError, load, names, registry, spec
from tests.scenes.conftest import SQUARE, assert_valid_polygons, feature, require_error


@pytest.mark.parametrize("name", list(registry.ENTRIES))
def test_registered_sizes_are_correct(name):
    entry = registry.find_entry(name)
    if (missing := entry.find_install_command()) is not None:
        pytest.skip(missing)
    polygons = load(name).polygons
    assert_valid_polygons(polygons)
    rings = [ring for p in polygons for ring in (p.exterior, *p.interiors)]
    corners = sum(len(ring.coords) - 1 for ring in rings)
    assert entry.size == (len(polygons), corners, len(rings) - len(polygons))


def test_parameters_in_the_name():
    scene = load("city:buildings=20,seed=3")
    assert scene.content_hash == load("city", buildings=20, seed=3).content_hash
    assert scene.parameters == {"buildings": 20, "seed": 3}


def test_limit_selects_the_first_polygons():
    assert load("city:buildings=20,limit=5").polygons == load("city", buildings=20).polygons[:5]


def test_unknown_scene_suggests_the_nearest():
    with pytest.raises(UnknownSceneError, match="did you mean city"):
        load("ctiy")
    with pytest.raises(UnknownSceneError, match="there are: city"):
        load("qqqqq")
    assert issubclass(UnknownSceneError, SceneError)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("city:buildngs=5", "did you mean buildings"),
        ("city:buildings=many", "is not int"),
        ("city:limit=0", "give 1 or more"),
        ("city:seed=x", "is not int"),
        ("city:seed=-1", "seed=-1 is out of range: give 0 or more"),
    ],
)
def test_wrong_parameters_are_refused(spec, message):
    require_error(message, spec)


def test_a_folder_named_like_a_scene_does_not_hide_it(monkeypatch, tmp_path):
    (tmp_path / "paper").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(load("paper").polygons) == 1
    assert registry.split_parameters("paper")[2] is False


def test_a_file_named_like_a_scene_needs_its_suffix(geojson, monkeypatch, tmp_path):
    geojson(feature([SQUARE]), feature([SQUARE]), name="town.geojson")
    monkeypatch.chdir(tmp_path)
    assert load("town.geojson").name == "town"
    assert [polygon.area for polygon in load("./town.geojson:limit=1").polygons] == [100]


class Installed:
    """Scenes of another package."""

    @staticmethod
    def bare(*, seed: int, size: float = 1.0) -> list[shapely.Polygon]:
        return [shapely.box(0, 0, size, seed + 1)]


def test_scenes_of_other_packages_are_listed_and_loaded(monkeypatch):
    builders = {"bare": "tests.scenes.test_registry:Installed.bare", "broken": "no_such_module:f"}
    points = [EntryPoint(name, value, registry.GROUP) for name, value in builders.items()]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    assert "bare" in names()
    scene = load("bare:size=3", seed=1)
    assert isinstance(scene, Scene)
    assert_valid_polygons(scene.polygons)
    assert scene.polygons[0].area == 6
    require_error("cannot be imported", "broken")


MODULE = """
import sys
from shapely import box
from scenes import Scene

def grid(*, seed, count: int = 4):
    return [box(2 * i, seed, 2 * i + 1, seed + 1) for i in range(count)]

def unseeded(count: int = 2):
    for i in range(count):
        yield box(2 * i, 0, 2 * i + 1, 1)

def full():
    return Scene("theirs", [box(0, 0, 1, 1)], "mm", credit="them")

def typed(*, count: "Missing" = 1):
    return [box(0, 0, 1, 1)]

def fails(): raise ValueError("no\\nluck")
def ends(): sys.exit(0)
def wrong(): return 3
def words(): return ["a"]
def empty(): return []
number = 3
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "own_scenes.py").write_text(MODULE)
    (tmp_path / "ends_at_once.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "own_scenes"
    sys.modules.pop("own_scenes", None)


class TestFunctions:
    """A scene given as module:function."""

    def test_polygons_become_a_scene(self, module):
        scene = load(f"{module}:grid:count=3", seed=5)
        assert [p.bounds for p in scene.polygons] == [(0, 5, 1, 6), (2, 5, 3, 6), (4, 5, 5, 6)]
        assert scene.name == f"{module}:grid"
        assert scene.parameters == {"count": "3", "seed": 5}
        assert len(load(f"{module}:unseeded").polygons) == 2
        assert len(load(f"{module}:unseeded:count=5,limit=4").polygons) == 4
        assert len(load(f"{module}:typed").polygons) == 1
        complete = load(f"{module}:full")
        assert (complete.name, complete.units, complete.credit) == ("theirs", "mm", "them")

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("own_scenes:fails", "failed: no luck"),
            ("own_scenes:ends", r"failed: it raised SystemExit\(0\)"),
            ("own_scenes:wrong", "returned int, not a Scene or a list of polygons"),
            ("own_scenes:words", "returned something other than polygons"),
            ("own_scenes:empty", "holds no polygon"),
            ("own_scenes:number", "is not a function"),
            ("own_scenes:nowhere", "has no attribute 'nowhere'"),
            ("own_scenes:grid:coun=3", "did you mean count"),
            ("own_scenes:full:count=3", "it has none"),
            ("no_such_module:f", "No module named 'no_such_module'"),
            ("ends_at_once:f", r"cannot be imported: it raised SystemExit\(0\)"),
            ("city:buildings", "give city:NAME=buildings"),
        ],
    )
    def test_failures_are_reported_in_one_line(self, module, name, message):
        require_error(message, name)


class TestSpec:
    @pytest.mark.parametrize(
        ("text", "name", "parameters"),
        [
            ("city", "city", {}),
            ("a.gpkg:layer=b,where=c = 1", "a.gpkg", {"layer": "b", "where": "c = 1"}),
            ("a.gpkg:where=k IN ('x', y=1),limit=3", "a.gpkg", None),
            ("a.gpkg:where=k = 'x,y=1',limit=3", "a.gpkg", None),
            ("a.gpkg:where=f(g('(', 2), h=3) > 1,limit=3", "a.gpkg", None),
            ("glyphs:text=don't,steps=4", "glyphs", {"text": "don't", "steps": "4"}),
            ("glyphs:text=:(,steps=4", "glyphs", {"text": ":(", "steps": "4"}),
            ("my.module:f:n=2", "my.module:f", {"n": "2"}),
        ],
    )
    def test_parse_name(self, text, name, parameters):
        if parameters is None:  # the condition is between where= and limit
            condition = text.partition("where=")[2].removesuffix(",limit=3")
            parameters = {"where": condition, "limit": "3"}
        assert spec.parse_name(text) == (name, parameters)

    @given(
        st.sampled_from(["city", "a.gpkg", "a.gpkg:layer=b", "m:f"]),
        st.none() | st.integers(1, 99),
        st.none() | st.text(alphabet="ab=,'\"() 1", min_size=1),
    )
    def test_joined_name_is_parsed_to_the_same_parameters_or_refused(self, name, limit, where):
        base, old = spec.parse_name(name)
        parameters = {"limit": limit, "where": where}
        try:
            text = spec.join_name(name, **parameters)
        except SceneError:
            assert where is not None
            assert "," in where
            return
        added = {key: str(value) for key, value in parameters.items() if value is not None}
        assert spec.parse_name(text) == (base, old | added)

    def test_label_does_not_contain_the_folder(self):
        assert spec.format_label("/a/b.gpkg:where=h/2 > 3") == "b.gpkg:where=h/2 > 3"
        assert spec.format_label("b.gpkg") == spec.format_label("x/b.gpkg") == "b.gpkg"
        assert spec.format_label("city:buildings=3") == "city:buildings=3"
        assert spec.format_label("my.module:f") == "my.module:f"
