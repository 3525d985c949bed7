"""The program with damaged files and faulty plugins: it ends in time with a clear error."""

import contextlib
import copy
import csv
import json
import re
import resource
import sqlite3
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.results.run_folder import read_run
from scenes.readers.tile_archives import PMTiles
from scenes.tiles import FILE
from tests.endurance.programs import (
    SILENT_S,
    Outcome,
    damage_bytes,
    damage_json,
    find_problem,
    run,
    run_each,
)
from tests.models.build import join_glb, split_glb
from tests.models.various import MODELS
from tests.paths import ROOT
from tests.ports.languages import find_node
from tests.records import get_rows
from tests.scenes.test_tiles import Compression, three_archives


def test_tiles(scale_count, report_counts, tmp_path):
    tiles = PMTiles(FILE)
    names = tiles.list_tile_keys(16)[:2]
    content = {name: tiles.read(name) or b"" for name in names}
    archives = three_archives(tmp_path, content, Compression.NONE)
    data = {"mvt": content[names[0]]} | {
        kind: Path(archives[kind]).read_bytes() for kind in ("pmtiles", "mbtiles")
    }

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        kind = list(data)[number % 3]
        file = folder / f"tiles.{kind}"
        file.write_bytes(damage_bytes(data[kind], np.random.default_rng(number)))
        name = f"{file.name}:pixels=64"
        commands = (
            ["triangulate", name, "-o", "out.npz"],
            ["census", name, "-o", "census", "--triangulators", "ear-clipping,delaunay"],
            ["inspect", name, "--polygon", "0", "--out", "one.png"],
        )
        outcome = run(commands[number // 3 % 3], folder)
        table = folder / "census" / "census.csv"
        return outcome, find_problem(outcome) or find_lost_tiles(file, outcome, table)

    run_each(scale_count(900), run_one, report_counts, tmp_path)


def find_lost_tiles(file: Path, outcome: Outcome, table: Path) -> str:
    """Return a problem if a census neither includes nor names a tile of an MBTiles file, or ""."""
    if file.suffix != ".mbtiles" or outcome.code not in (0, 5) or not table.exists():
        return ""
    query = "SELECT zoom_level, tile_column, tile_row FROM tiles WHERE typeof(tile_data) = 'blob'"
    with contextlib.closing(sqlite3.connect(file)) as database:
        tiles = [row for row in database.execute(query) if all(type(n) is int for n in row)]
    with table.open() as stream:
        done = max((int(row["tiles"]) for row in csv.DictReader(stream)), default=0)
    named = sum(f"{z}/{x}/{2**z - 1 - y}" in outcome.output for z, x, y in tiles)
    return "" if done + named >= len(tiles) else f"{len(tiles)} tiles, {done} done, {named} named"


def test_models(scale_count, report_counts, tmp_path):
    """Half of the models have small damage, which may leave a valid model."""
    data = [MODELS[name](tmp_path / name).read_bytes() for name in ("plain.glb", "strip.glb")]
    text = (
        b"v 0 0 0\nv 2 -1 0\nv 9 0 0\nv 2 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n" * 3
    )

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        rng = np.random.default_rng(number)
        kind, model = number % 6, data[number // 6 % 2]
        file = folder / ("model.obj" if kind in (2, 5) else "model.glb")
        document, binary = split_glb(model)
        if kind == 0:
            file.write_bytes(damage_bytes(model, rng))
        elif kind == 1:
            file.write_bytes(join_glb(damage_json(document, rng), binary))
        elif kind == 2:
            file.write_bytes(damage_bytes(text, rng))
        elif kind == 3:
            file.write_bytes(join_glb(nudge_json(document, rng), binary))
        elif kind == 4:
            file.write_bytes(join_glb(document, change_byte(binary, rng)))
        else:
            file.write_bytes(change_byte(text, rng))
        commands = (
            ["triangulate", file.name, "--check"],
            ["triangulate", file.name, "-o", f"out{file.suffix}"],
            ["inspect", f"{file.name}:views=4", "--polygon", "0", "--out", "one.png"],
        )
        command = commands[number // 12 % 3]
        outcome = run(command, folder)
        lost = find_lost_triangles(file, outcome) if command[0] == "triangulate" else ""
        return outcome, find_problem(outcome) or lost

    codes = run_each(scale_count(1200), run_one, report_counts, tmp_path)
    assert codes[0] >= sum(codes.values()) // 4


def nudge_json(document: Any, rng: np.random.Generator) -> Any:
    """Return a copy with a scalar replaced by a similar one, or an element of a list repeated."""
    changed = copy.deepcopy(document)
    values = list(list_values(changed))
    lists = [parent[key] for parent, key in values if isinstance(parent[key], list) and parent[key]]
    if rng.random() < 0.2 and lists:
        selected = lists[int(rng.integers(len(lists)))]
        selected.append(copy.deepcopy(selected[int(rng.integers(len(selected)))]))
        return changed
    scalars = [pair for pair in values if isinstance(pair[0][pair[1]], int | float | str)]
    parent, key = scalars[int(rng.integers(len(scalars)))]
    candidates = [other[k] for other, k in scalars if type(other[k]) is type(parent[key])]
    parent[key] = candidates[int(rng.integers(len(candidates)))]
    if not isinstance(parent[key], str) and rng.random() < 0.5:
        parent[key] += int(rng.choice([-1, 1]))
    return changed


def list_values(parent: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the container and the key of each value, at all levels."""
    for key in parent if isinstance(parent, dict) else range(len(parent)):
        yield parent, key
        if isinstance(parent[key], dict | list):
            yield from list_values(parent[key])


def change_byte(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    changed[int(rng.integers(0, len(changed)))] = int(rng.choice(bytearray(b" -.0123456789/")))
    return bytes(changed)


def find_lost_triangles(file: Path, outcome: Outcome) -> str:
    """Return a problem if the program reports another number of triangles than the file, or ""."""
    if outcome.code or file.suffix != ".glb":
        return ""
    document, _ = split_glb(file.read_bytes())
    parts = [part for mesh in document.get("meshes", ()) for part in mesh["primitives"]]
    # Primitives that share all accessors count once.
    drawn = {(p.get("indices"), p["attributes"]["POSITION"], p.get("mode", 4)) for p in parts}
    expected = 0
    for indices, positions, mode in drawn:
        count = document["accessors"][positions if indices is None else indices]["count"]
        expected += {4: count // 3, 5: max(0, count - 2), 6: max(0, count - 2)}.get(mode, 0)
    match = re.search(r": ([\d,]+) triangles", outcome.output)
    reported = int(match[1].replace(",", "")) if match else 0
    return "" if reported == expected else f"{expected} triangles, {reported} reported"


def test_polygons(scale_count, report_counts, tmp_path):
    def feature(number: int) -> dict[str, Any]:
        east, north = 10.0 + 0.02 * number, 50.0
        ring = [[east, north], [east + 0.01, north], [east + 0.01, north + 0.01], [east, north]]
        kind = ("Polygon", "MultiPolygon")[number % 2]
        geometry = {"type": kind, "coordinates": [ring] if kind == "Polygon" else [[ring]]}
        properties = {"height": 3, "name": f"a {number}"}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    features = [feature(number) for number in range(12)]

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        rng = np.random.default_rng(number)
        file = folder / "polygons.geojson"
        collection = {"type": "FeatureCollection", "features": features}
        if number % 4:
            file.write_text(json.dumps({**collection, "features": damage_json(features, rng)}))
        else:
            file.write_bytes(damage_bytes(json.dumps(collection).encode(), rng))
        out = folder / ("out.glb" if number % 2 else "out.geojson")
        outcome = run(["triangulate", file.name, "-o", out.name], folder)
        lost = find_lost_features(file, outcome, out) if out.suffix == ".geojson" else ""
        return outcome, find_problem(outcome) or lost

    run_each(scale_count(300), run_one, report_counts, tmp_path)


def find_lost_features(file: Path, outcome: Outcome, output: Path) -> str:
    """Return a problem if a feature is neither in the output nor named in a message, or ""."""
    if outcome.code not in (0, 5) or not output.exists():
        return ""
    items = json.loads(file.read_bytes())["features"]
    features = [item for item in items if isinstance(item, dict) and item.get("type") == "Feature"]
    written = [item["properties"] or {} for item in json.loads(output.read_text())["features"]]
    done = {str(properties.get("name")) for properties in written}
    lost = []
    for number, feature in enumerate(features):
        properties = feature.get("properties")
        name = properties.get("name") if isinstance(properties, dict) else None
        named = re.search(rf"feature {number}\b", outcome.output)
        if isinstance(name, str) and name.startswith("a ") and name not in done and not named:
            lost.append(name)
    return f"neither written nor named: {', '.join(lost)}" if lost else ""


PLUGIN = """
import os, signal, sys, time
import numpy as np
from triangulators import triangulate

def right(polygon):
    return triangulate(polygon, "ear-clipping")

def cut(polygon):
    good = right(polygon)
    {action}
    return good
"""
ACTIONS = (
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
L_SHAPE = "POLYGON((0 0,9 0,9 3,3 3,3 9,0 9,0 0))\n"
BRIEF_RUN = ("run", "--quick", "-q", "--rasterisers", "reference", "--resolution", "64")
BRIEF_RUN += ("--budget", "0.02", "--out", "out")


def test_plugins(scale_count, report_counts, tmp_path):
    """Cases of other triangulators are never lost, and errors name the plugin."""

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        action = ACTIONS[number % len(ACTIONS)]
        (folder / "mine.py").write_text(PLUGIN.format(action=action))
        if number // len(ACTIONS) % 2:
            (folder / "l.wkt").write_text(f"{L_SHAPE}POLYGON((20 0,29 0,29 9,20 0))")
            command = ["triangulate", "l.wkt", "-o", "o.npz", "--triangulator", "mine:cut"]
            problem = find_problem(outcome := run(command, folder))
            return outcome, problem and f"{action}: {problem}"
        names = "mine:cut,delaunay,mine:right,fan"
        scene = ("--scene", "city:buildings=4", "--triangulators", names, "--timeout", "8")
        outcome = run([*BRIEF_RUN, *scene], folder)
        problem = find_problem(outcome)
        if not problem and outcome.code in (0, 5):
            records = {r["triangulator"]: r for r in get_rows(read_run(folder / "out"))}
            neighbours = {"mine:right", "delaunay"}
            lost = (neighbours | {"mine:cut"}) - set(records)
            bad = [name for name in neighbours - lost if records[name]["status"] != "ok"]
            problem = f"lost {lost}" if lost else f"neighbours failed: {bad}" if bad else ""
        elif not problem:
            problem = f"exit code {outcome.code}: {outcome.output[-200:]}"
        return outcome, problem and f"{action}: {problem}"

    run_each(scale_count(200), run_one, report_counts, tmp_path)


WRITERS = {
    "out": [*BRIEF_RUN, "--scene", "city:buildings=9"],
    "out.npz": ["triangulate", "city:buildings=99", "-o", "out.npz"],
    "table": ["census", "l.wkt", "-o", "table", "--triangulators", "ear-clipping,delaunay"],
}


def test_two_writers_of_the_same_output(scale_count, report_counts, tmp_path):
    """One command succeeds, the other is refused or succeeds, and the output is complete."""
    undisturbed: dict[str, bytes] = {}

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        output = list(WRITERS)[number % 3]
        (folder / "l.wkt").write_text(L_SHAPE * 9)
        with ThreadPoolExecutor(2) as pool:
            commands = [WRITERS[output]] * (1 if number < 3 else 2)
            outcomes = list(pool.map(run, commands, [folder] * 2))
        outcomes.sort(key=lambda outcome: outcome.code)
        codes = [outcome.code for outcome in outcomes]
        content = read_content(folder / output)
        files = {path.name for path in folder.iterdir()} - {"cache"}
        problem = next(filter(None, map(find_problem, outcomes)), "")
        if content != undisturbed.setdefault(output, content):
            problem = "the result differs from that of a single writer"
        if codes not in ([0], [0, 0], [0, 2]) or files != {"l.wkt", output}:
            problem = problem or f"ended with {codes} and left {files}"
        return outcomes[-1], problem and f"{output}: {problem}"

    # One thread, because the first run of each has a single writer.
    run_each(scale_count(60), run_one, report_counts, tmp_path, threads=1)


def read_content(path: Path) -> bytes:
    """Return the reproducible content of an output file or folder."""
    if path.suffix:
        with np.load(path) as arrays:
            return b"".join(arrays[name].tobytes() for name in sorted(arrays.files))
    if (table := path / "census.csv").exists():
        return table.read_bytes()
    counted = [(r["triangulator"], r["counters"]) for r in get_rows(read_run(path))]
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


def test_javascript_port(scale_count, report_counts, tmp_path):
    node = find_node()
    assert node, "Node.js is not installed; run: make setup-test"
    program = NODE.format(port=(ROOT / "ports" / "javascript" / "flip-triangles.js").as_uri())
    valid = [[0, 1, 2, 0, 2, 3], [0, 0, 2, -1, 9, 0, 2, 1], {"dimensions": 2, "by": "l1"}]

    def run_one(number: int, folder: Path) -> tuple[Outcome, str]:
        rng = np.random.default_rng(number)
        parts = copy.deepcopy(valid)
        if number % 5 == 0:
            parts[1][int(rng.integers(0, 8))] = "NaN"
        else:
            parts[number % 5 % 3] = damage_json(parts[number % 5 % 3], rng)
        command = (node, "--input-type=module", "-e", program, "--")
        outcome = run([json.dumps(parts)], folder, command)
        return outcome, find_problem(outcome)

    run_each(scale_count(300), run_one, report_counts, tmp_path)


def test_find_problem_reports_bad_outcomes(tmp_path):
    for program, word in (
        ("import os; os.abort()", "exit code -6"),
        ("raise ValueError", "exit code 1"),
        ("import sys; print('Traceback'); sys.exit(0)", "traceback"),
        ("import sys; sys.exit(2)", "without an error message"),
    ):
        assert word in find_problem(run(["-c", program], tmp_path, (sys.executable,)))
    assert "silent" in find_problem(Outcome(0, "", SILENT_S + 1))
    asleep = "import time; time.sleep(0.9)"
    assert run(["-c", asleep], tmp_path, (sys.executable,)).silent_s > 0.8


@pytest.fixture(autouse=True)
def _no_core_files():
    before = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_CORE, before)
