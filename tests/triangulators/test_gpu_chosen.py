"""Which device does a batch where none is named, and `triangulate --device`."""

import json

import numpy as np
import pytest

from tests.triangulators.cases import star
from triangulators import UnknownName, measure_device, triangulate_many, vertices
from triangulators.batch import device_times
from triangulators.gpu import engine, known_devices
from triangulators.gpu.known_devices import Choice, Measured, Pace, choose, recall, remember

FASTER, SLOWER = Pace(1e-3, 1e-7, 1e-6), Pace(1e-3, 1e-6, 1e-6)


def measured(small=FASTER, large=SLOWER, equal=True):
    return Measured("llvmpipe (LLVM)", "4.5 Mesa", equal, small, large)


@pytest.fixture(autouse=True)
def _own_file(monkeypatch, tmp_path):
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "folder" / "models.sqlite"))
    yield
    engine.close_all()


@pytest.fixture
def named(monkeypatch):
    """The devices that batches were given to, with how many polygons were wanted of them."""
    asked = []
    attempt = engine.attempt

    def told(name, task, threads):
        asked.append((name, int(task.wanted.sum())))
        attempt(name, task, threads)

    monkeypatch.setattr(engine, "attempt", told)
    return asked


def test_a_device_gains_where_it_makes_up_for_what_it_costs_once():
    # 1 ms + 0.1 us a polygon against 0.8 of 1 us a polygon: more than 1,428 polygons.
    assert not FASTER.gains(1428)
    assert FASTER.gains(1430)
    assert not SLOWER.gains(1e9)
    assert not FASTER.gains(0)


def test_small_and_large_rings_are_judged_apart():
    remember("llvmpipe", measured())
    assert choose(2000, 0.0) == Choice("llvmpipe", True, False)
    assert choose(100, 1e9) is None
    remember("gpu0", measured(SLOWER, FASTER))
    assert choose(2000, 1e9).device == "llvmpipe"
    assert choose(0, 1e9) == Choice("gpu0", False, True)
    remember("llvmpipe", measured(equal=False))
    assert choose(2000, 0.0) is None


def test_what_is_remembered_is_read_back():
    assert recall() == {}
    remember("gpu0", measured(equal=False))
    remember("llvmpipe", measured(SLOWER))
    assert recall() == {"gpu0": measured(equal=False), "llvmpipe": measured(SLOWER)}
    assert known_devices.path().parent.name == "folder"
    assert [file.name for file in known_devices.path().parent.iterdir()] == ["devices.json"]


@pytest.mark.parametrize("key", ["machine", "cores", "numba", "version", "schema"])
def test_another_machine_or_version_does_not_count(key):
    remember("llvmpipe", measured())
    content = json.loads(known_devices.path().read_text())
    content[key] = "another"
    known_devices.path().write_text(json.dumps(content))
    assert recall() == {}


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"schema": 1}', '"x"', "null"])
def test_a_damaged_file_is_no_file(damage):
    remember("llvmpipe", measured())
    known_devices.path().write_text(damage)
    assert recall() == {}
    remember("llvmpipe", measured())
    assert recall() == {"llvmpipe": measured()}


@pytest.mark.parametrize(
    "change", [{"small": [1.0]}, {"large": "x"}, {"renderer": None, "small": 3}]
)
def test_a_damaged_entry_is_no_entry(change):
    remember("llvmpipe", measured())
    content = json.loads(known_devices.path().read_text())
    content["devices"]["llvmpipe"].update(change)
    known_devices.path().write_text(json.dumps(content))
    assert recall() == {}


def test_a_folder_that_cannot_be_written_is_no_error(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "file" / "models.sqlite"))
    remember("llvmpipe", measured())
    assert recall() == {}


def test_nothing_is_chosen_unless_it_was_measured_to_be_faster(named):
    polygons = [star(6)] * 3000
    expected = triangulate_many(polygons)
    assert named == []
    remember("llvmpipe", measured(SLOWER))
    triangulate_many(polygons)
    assert named == []
    remember("llvmpipe", measured())
    triangulate_many(polygons[:1000])
    triangulate_many(polygons, device="cpu")
    triangulate_many(polygons, "optimal:overdraw")
    assert named == []
    found = triangulate_many([*polygons, star(70)])
    assert named == [("llvmpipe", 3000)]  # the large one stays where it is done faster
    assert np.array_equal(found.triangles[: len(expected.triangles)], expected.triangles)


def test_a_device_that_failed_unasked_is_not_asked_again(named, monkeypatch, caplog):
    def lost(name):
        raise OSError("no driver")

    remember("llvmpipe", measured())
    monkeypatch.setattr(engine, "open_context", lost)
    polygons = [star(6)] * 3000
    for _ in range(3):
        assert triangulate_many(polygons).failed == {}
    assert len(named) == 1
    assert len(caplog.records) == 1


def test_a_device_is_measured_once(monkeypatch):
    monkeypatch.setattr(device_times, "COMPARED", 6)
    monkeypatch.setattr(device_times, "FIRST_FOOTPRINTS", 40)
    monkeypatch.setattr(device_times, "MOST_FOOTPRINTS", 80)
    monkeypatch.setattr(device_times, "MOST_LARGE", 2)
    monkeypatch.setattr(device_times, "LARGE_CORNERS", 66)
    calls = []
    run = device_times.triangulate_many

    def counted(arrays, device):
        calls.append((device, len(arrays.polygon_ends)))
        return run(arrays, device=device)

    monkeypatch.setattr(device_times, "triangulate_many", counted)
    found = measure_device("llvmpipe")
    assert found.equal
    assert "llvmpipe" in found.renderer
    assert min(*found.small, *found.large) > 0.0
    assert {device for device, _ in calls} == {"llvmpipe", "cpu"}
    assert calls[-1] == ("cpu", 2)
    assert recall() == {"llvmpipe": found}
    made = len(calls)
    assert measure_device("llvmpipe") == found
    assert len(calls) == made
    measure_device("llvmpipe", again=True)
    assert len(calls) > made
    remember("llvmpipe", found._replace(version="another driver"))
    made = len(calls)
    assert measure_device("llvmpipe").version == found.version
    assert len(calls) > made


def test_the_cpu_is_not_measured_against_itself():
    with pytest.raises(UnknownName, match="measured against"):
        measure_device("cpu")


def test_a_device_whose_results_differ_is_never_chosen(monkeypatch):
    monkeypatch.setattr(device_times, "_pace", lambda *_: FASTER)
    monkeypatch.setattr(device_times, "triangulate_many", lambda arrays, device: differing(device))
    assert not measure_device("llvmpipe").equal
    assert choose(10**6, 0.0) is None


def differing(device):
    found = triangulate_many([star(5)], device="cpu")
    if device == "llvmpipe":
        found.triangles[0] = found.triangles[1]
    return found


def square_file(folder):
    """A GeoJSON of polygons on the grid, and one that is not."""
    rings = [vertices(star(n)) for n in (5, 12, 70)] + [vertices(star(9)) / 3]
    features = [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]},
        }
        for ring in rings
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3067"}}
    content = {"type": "FeatureCollection", "crs": crs, "features": features}
    path = folder / "stars.geojson"
    path.write_text(json.dumps(content))
    return path


def test_the_command_line_gives_the_same_file_on_every_device(harness, tmp_path, named):
    remember("llvmpipe", measured()._replace(**driver()))
    source = square_file(tmp_path)
    for device in ("llvmpipe", "cpu"):
        given = ["triangulate", str(source), "--device", device]
        code, out, err = harness(*given, "-o", f"{device}.npz")
        assert (code, "4 polygons" in out) == (0, True), err
    assert named == [("llvmpipe", 4)]
    with np.load("llvmpipe.npz") as ours, np.load("cpu.npz") as theirs:
        assert set(ours) == set(theirs)
        for key in ours:
            assert np.array_equal(ours[key], theirs[key]), key


def driver():
    return dict(zip(("renderer", "version"), engine.describe("llvmpipe"), strict=True))


def test_the_command_line_says_what_it_cannot_use(harness, tmp_path):
    source = square_file(tmp_path)
    code, out, err = harness("triangulate", str(source), "-o", "x.npz", "--device", "gpu31")
    assert code == 0
    assert "4 polygons" in out
    assert err.count("there is no gpu31 with compute shaders here") == 1
    code, _, err = harness("triangulate", str(source), "-o", "y.npz", "--device", "cuda")
    assert code == 2
    assert "unknown device 'cuda'" in err
    assert not (tmp_path / "y.npz").exists()


def test_the_command_line_measures_a_device_it_does_not_know(harness, tmp_path, monkeypatch):
    monkeypatch.setattr(device_times, "_pace", lambda *_: SLOWER)
    source = square_file(tmp_path)
    given = ["triangulate", str(source), "-o", "x.npz", "--device", "llvmpipe", "--quiet"]
    assert harness(*given)[0] == 0
    assert recall()["llvmpipe"].equal
    assert recall()["llvmpipe"].small == SLOWER
