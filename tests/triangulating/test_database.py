import multiprocessing
import os
import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.errors import StorageError
from harness.machine.system import get_database_path
from harness.triangulating import database as model
from harness.triangulating.database import ModelDatabase, TimedTriangles
from triangulators.compute.compiled_files import is_trusted

EXAMPLE = TimedTriangles(np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), 0.25, 0.5, b"12345678")


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "folder" / "model.sqlite"


def make_key(number: int) -> bytes:
    return model.make_key("delaunay", {}, np.array([[number, 0.0], [1, 0], [0, 1]]), [0, 3])


def test_stored_entries_are_found_later(path):
    with ModelDatabase(path) as database:
        assert database.find([make_key(1)]) == {}
        database.store("delaunay", make_key(1), EXAMPLE)
        database.store("delaunay", make_key(2), TimedTriangles(EXAMPLE.triangles[:1], 0.5))
    with ModelDatabase(path) as database:
        entries = database.find([make_key(k) for k in range(1200)])
        assert {k: (v.triangles.tolist(), *v[1:]) for k, v in entries.items()} == {
            make_key(1): (EXAMPLE.triangles.tolist(), 0.25, 0.5, b"12345678"),
            make_key(2): (EXAMPLE.triangles[:1].tolist(), 0.5, None, bytes(8)),
        }
        assert database.count_entries() == {"delaunay": (2, 32 + 24 + 32 + 12)}
        assert database.clear() == 2
        assert database.count_entries() == {}


@pytest.mark.parametrize("mode", [0o602, 0o666])
@pytest.mark.parametrize("suffix", ["", ".lock", "folder"])
def test_a_database_that_other_users_may_write_is_refused(path, mode, suffix):
    ModelDatabase(path).close()
    file = path.parent if suffix == "folder" else path.with_name(path.name + suffix)
    file.chmod(mode | 0o100 * file.is_dir())
    with pytest.raises(StorageError, match="another user owns or may write to"):
        ModelDatabase(path)
    file.chmod(0o700)
    ModelDatabase(path).close()


@pytest.mark.parametrize(
    ("mode", "user", "group", "trusted"),
    [
        (0o100644, 12345, 12345, True),
        (0o100644, 0, 0, True),
        (0o100600, 54321, 12345, False),
        (0o100664, 12345, 54321, False),
        (0o100646, 12345, 12345, False),
        (0o041777, 0, 0, True),
        (0o041777, 54321, 0, False),
    ],
)
def test_trust_depends_on_owner_and_mode(monkeypatch, mode, user, group, trusted):
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    info = os.stat_result((mode, 0, 0, 1, user, group, 0, 0, 0, 0))
    assert is_trusted(info) == trusted


@pytest.mark.parametrize("kind", ["text", "other tables", "same table", "other application"])
def test_a_foreign_file_is_refused_and_unchanged(path, kind):
    path.parent.mkdir()
    if kind == "text":
        path.write_text("# notes, not a database\n" * 9)
    else:
        with sqlite3.connect(path) as database:
            database.execute("CREATE TABLE model (key, triangulator, value)")
            database.execute("INSERT INTO model VALUES (1, 2, 3)")
            if kind == "other tables":
                database.execute("ALTER TABLE model RENAME TO persons")
            if kind == "other application":
                database.execute("PRAGMA application_id=77")
        database.close()
    content = path.read_bytes()
    with pytest.raises(StorageError, match=r"not a model database.*set RASTER_HARNESS_CACHE"):
        ModelDatabase(path)
    assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("suffix", ["", "-wal", ".lock"])
def test_symbolic_links_are_refused(path, tmp_path, suffix):
    path.parent.mkdir()
    target = tmp_path / "target"
    target.write_text("somebody's")
    path.with_name(path.name + suffix).symlink_to(target)
    with pytest.raises(StorageError, match="not a regular file"):
        ModelDatabase(path)
    assert target.read_text() == "somebody's"


def test_a_foreign_lock_is_refused(path):
    path.parent.mkdir()
    lock = path.with_name(path.name + ".lock")
    lock.write_text("somebody's")
    with pytest.raises(StorageError, match="not a lock of raster-harness"):
        ModelDatabase(path)
    assert lock.read_text() == "somebody's"


def test_a_database_of_an_earlier_version_is_taken_over(path):
    """Such a database has no application_id."""
    with ModelDatabase(path) as database:
        database.store("delaunay", make_key(1), EXAMPLE)
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA application_id=0")
    database.close()
    path.with_name(path.name + ".lock").write_bytes(b"")
    with ModelDatabase(path) as database:
        assert [*database.find([make_key(1)])] == [make_key(1)]
    assert int.from_bytes(path.read_bytes()[68:72], "big") == model.APPLICATION_ID


@given(
    st.lists(st.tuples(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9)), min_size=3, max_size=6),
    st.integers(0, 5),
    st.sampled_from(["x", "seed"]),
)
def test_keys_differ_if_content_does(points, index, name):
    vertices = np.array(points)
    base = model.make_key("optimal:overdraw", {}, vertices, [0, len(vertices)])
    moved = vertices.copy()
    moved[index % len(moved), 0] = np.nextafter(moved[index % len(moved), 0], np.inf)
    other_keys = [
        model.make_key("optimal:half-perimeter", {}, vertices, [0, len(vertices)]),
        model.make_key("optimal:overdraw", {name: 1}, vertices, [0, len(vertices)]),
        model.make_key("optimal:overdraw", {}, moved, [0, len(vertices)]),
        model.make_key("optimal:overdraw", {}, vertices, [0, 1, len(vertices)]),
    ]
    assert base == model.make_key("optimal:overdraw", {}, vertices.copy(), [0, len(vertices)])
    assert len({base, *other_keys}) == 5


def assert_usable(database: ModelDatabase) -> None:
    database.store("delaunay", make_key(1), EXAMPLE)
    (entry,) = database.find([make_key(1)]).values()
    assert entry.triangles.tolist() == EXAMPLE.triangles.tolist()


class TestDamage:
    def put(self, path: Path) -> None:
        with ModelDatabase(path) as database:
            for k in range(500):
                database.store("delaunay", make_key(k), EXAMPLE)

    @pytest.mark.parametrize("damage", ["rubbish", "cut", "holes", "other schema", "no table"])
    def test_a_damaged_file_is_replaced(self, path, damage):
        self.put(path)
        data = bytearray(path.read_bytes())
        if damage == "rubbish":
            path.write_bytes(b"this is no database" * 50)
        elif damage == "cut":
            path.write_bytes(data[: len(data) // 2])
        elif damage == "holes":
            data[4096:] = bytes(len(data) - 4096)
            path.write_bytes(data)
        else:
            changes = {"other schema": "PRAGMA user_version=99", "no table": "DROP TABLE model"}
            with sqlite3.connect(path) as database:
                database.execute(changes[damage])
            database.close()
        warnings: list[str] = []
        with ModelDatabase(path, warnings.append) as database:
            database.find([make_key(k) for k in range(500)])
            assert_usable(database)
        if damage == "no table":  # an empty file lacks the table, too: no damage
            return
        assert len(warnings) == 1
        assert ": damaged (" in warnings[0]
        names = {file.name.removeprefix(path.name) for file in path.parent.iterdir()}
        assert names <= {"", "-wal", "-shm", ".lock"}, "nothing is kept of it"

    def test_damaged_entries_are_ignored(self, path):
        self.put(path)
        select = "SELECT value FROM model WHERE key=?"
        with sqlite3.connect(path) as database:
            (value,) = database.execute(select, [make_key(7)]).fetchone()
            # the last is intact, but of another polygon
            for number, wrong in enumerate((value[:-1] + b"\1", value[:-12], "text", b"", value)):
                row = [wrong, make_key(7 + number)]
                database.execute("UPDATE model SET value=? WHERE key=?", row)
        database.close()
        warnings: list[str] = []
        with ModelDatabase(path, warnings.append) as database:
            entries = database.find([make_key(k) for k in range(500)])
        assert [k for k in range(500) if make_key(k) not in entries] == [7, 8, 9, 10, 11]
        assert len(warnings) == 5
        assert all("damaged entry; computing it again" in line for line in warnings)

    def test_a_folder_that_cannot_be_written(self, tmp_path):
        (tmp_path / "file").write_text("x")
        with pytest.raises(StorageError, match="set RASTER_HARNESS_CACHE"):
            ModelDatabase(tmp_path / "file" / "model.sqlite")


def _work(path: Path, worker: int, damage: bool) -> int:
    """Write and read in one of several processes; one process damages the file."""
    wrong = 0
    keys = {make_key(k): k for k in range(60)}
    with ModelDatabase(path, lambda _: None) as database:
        for turn in range(40):
            number = (worker * 7 + turn) % 60
            entry = TimedTriangles(EXAMPLE.triangles + number, 0.5)
            database.store("delaunay", make_key(number), entry)
            if damage and turn == 20:
                with path.open("r+b") as stream:
                    stream.seek(0)
                    stream.write(b"\0" * 3000)
            for key, entry in database.find(list(keys)).items():
                wrong += entry.triangles.tolist() != (EXAMPLE.triangles + keys[key]).tolist()
    return wrong


@pytest.mark.parametrize("damage", [False, True])
def test_several_processes_share_the_file(path, damage):
    context = multiprocessing.get_context("spawn")
    with context.Pool(3) as pool:
        jobs = [(path, worker, damage and worker == 2) for worker in range(3)]
        assert pool.starmap_async(_work, jobs).get(timeout=60) == [0, 0, 0]
    with ModelDatabase(path, lambda _: None) as database:
        assert_usable(database)


def test_default_path(monkeypatch, tmp_path):
    monkeypatch.delenv("RASTER_HARNESS_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert get_database_path() == tmp_path / "raster-harness" / "triangulations.sqlite"
    monkeypatch.setenv("RASTER_HARNESS_CACHE", "/somewhere/else")
    assert get_database_path() == Path("/somewhere/else")
    for variable in ("RASTER_HARNESS_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(variable)
    monkeypatch.setattr("pwd.getpwuid", {}.__getitem__)  # no entry in passwd
    folder = Path(tempfile.gettempdir()) / f"raster-harness-{os.getuid()}"
    assert get_database_path() == folder / "triangulations.sqlite"
