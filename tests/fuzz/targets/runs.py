"""Run folders that were damaged: one clear line or an answer, and an exit code that says which."""

import atexit
import contextlib
import io
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st
from rich.console import Console

from harness.errors import BAD_INPUT, GOOD, INCONCLUSIVE, NOTHING_MEASURED, REGRESSION
from harness.measuring.plan import Plan
from harness.measuring.run import run
from harness.measuring.timing import TimingSettings
from harness.progress import Reporter
from harness.triangulating.recipes import parse_all
from tests.compare.runs import write_run
from tests.conftest import BLOCK, exit_code, write_geojson
from tests.fuzz.damage import byte_edit, edit_bytes, edit_values, value_edit
from tests.fuzz.target import target
from tests.inline import Inline

SILENT_S = 10.0
"""Seconds that a command may say nothing."""

COMPARED = (GOOD, REGRESSION, BAD_INPUT, NOTHING_MEASURED, INCONCLUSIVE)
RUNS, TABLES = ("base", "head"), ("run.json", "cases.jsonl")
FORMATS = ("table", "markdown", "json")


def damage_of(tables: list[str], folders: list[str]) -> st.SearchStrategy[Any]:
    """Draw edits of one or two files of JSON, or of every array in a folder."""
    in_bytes = st.lists(byte_edit, min_size=1, max_size=3)
    in_values = st.lists(value_edit, min_size=1, max_size=3)
    edits = st.tuples(st.sampled_from(tables), in_values | in_bytes)
    if folders:
        edits |= st.tuples(st.sampled_from(folders), in_bytes)
    return st.lists(edits, min_size=1, max_size=2, unique_by=lambda edit: edit[0])


class Heard(io.StringIO):
    """What a command writes, and the longest time that it was silent."""

    def __init__(self) -> None:
        super().__init__()
        self._last = time.monotonic()
        self.silent_s = 0.0

    def write(self, text: str) -> int:
        self.silent_s = max(self.silent_s, time.monotonic() - self._last)
        self._last = time.monotonic()
        return super().write(text)


class SilentError(AssertionError):
    """A command said nothing for too long."""


def command(*arguments: str) -> tuple[int, str]:
    """Run a command; return its exit code and what it wrote to standard error."""
    out, err = io.StringIO(), Heard()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = exit_code(*arguments)
    text = err.getvalue()
    err.write("")  # its end is heard, too
    if err.silent_s >= SILENT_S:
        raise SilentError(f"said nothing for {err.silent_s:.0f} s: {arguments}")
    return code, text


def spoil(place: Path, edits: list[dict[str, Any]]) -> None:
    """Damage a file, or each file in a folder."""
    edit = edit_values if "value" in edits[0] else edit_bytes
    for file in sorted(place.iterdir()) if place.is_dir() else [place]:
        edit(file, edits)


def assert_clear(code: int, err: str) -> None:
    """Bad input is one line that begins with "error:"."""
    assert "Traceback" not in err, err
    if code == BAD_INPUT:
        assert err.startswith("error: "), err
        assert err.count("\n") == 1, err


@target(
    "compare",
    st.fixed_dictionaries(
        {
            "damage": damage_of([f"{run}/{file}" for run in RUNS for file in TABLES], []),
            "gate": st.sampled_from(["counters", "time", "counters,time"]),
            "format": st.sampled_from(FORMATS),
        }
    ),
)
def check_compare(value: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name, seed in (("base", 1), ("head", 2)):
            write_run(place / name, seed=seed)
        for name, edits in value["damage"]:
            spoil(place / name, edits)
        files = [f"--{kind}={place / kind}" for kind in ("markdown", "junit", "json", "html")]
        options = ["--gate", value["gate"], "--format", value["format"], *files]
        code, err = command("compare", str(place / "base"), str(place / "head"), *options)
        assert code in COMPARED, (code, err)
        assert_clear(code, err)
        if code != BAD_INPUT:
            for kind in ("markdown", "junit", "json", "html"):
                assert (place / kind).stat().st_size > 0


@cache
def sound() -> Path:
    """Return a run of four footprints, made once."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-run-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    scene = write_geojson(folder / "block.geojson", BLOCK)
    plan = Plan(
        scene=str(scene),
        triangulators=parse_all(("ear-clipping", "delaunay", "optimal:half-perimeter")),
        rasterisers=("reference",),
        timing=TimingSettings(precision=0.5, budget_s=0.01, warm_up_s=0.0),
    )
    quiet = Reporter(quiet=True, console=Console(quiet=True))
    run(plan, folder / "run", quiet, open_worker=lambda *_: Inline())
    _settle(folder / "run")
    return folder / "run"


@contextmanager
def beside_a_run() -> Iterator[Path]:
    """Be in a folder of its own, with a copy of the run and its polygons; tasks are done here."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        home = Path(folder) / "a" / "b"
        home.mkdir(parents=True)
        patch.chdir(home)
        patch.setitem(run.__kwdefaults__, "open_worker", lambda *_: Inline())
        patch.setattr("harness.measuring.loading.Worker", lambda *_: Inline())
        patch.setattr("harness.report.plots.plot_run", lambda run: [])
        shutil.copytree(sound(), "RUN")
        shutil.copy(sound().with_name("block.geojson"), ".")
        yield home


def _settle(folder: Path) -> None:
    """Make a run's files the same wherever and whenever it was made: edits name places in them."""
    facts = json.loads((folder / "run.json").read_text())
    facts |= {"created": "2026-01-01T12:00:00+00:00", "warnings": [], "seconds": {"count": 1.5}}
    facts["environment"] = {"cpu": "a processor", "kernel": "a system", "harness": "0.1.0"}
    facts["plan"]["scene"] = "block.geojson"
    (folder / "run.json").write_text(json.dumps(facts, indent=2))
    lines = []
    for line in (folder / "cases.jsonl").read_text().splitlines():
        record = json.loads(line)
        samples = [1e-4 * (1 + k % 5) for k in range(12)]
        record["triangulate_s"] = 1e-3
        if record.get("time"):
            record["time"] |= {"samples_s": samples, "median_s": 3e-4, "ci95_s": [2e-4, 4e-4]}
            record["time"] |= {"repeats": 2, "epochs": [2] * 6, "warnings": []}
            record["time"] |= {"empty_s": samples, "reference_s": samples}
        lines.append(json.dumps(record))
    (folder / "cases.jsonl").write_text("\n".join(lines) + "\n")


READERS: dict[str, tuple[str, ...]] = {
    "report": ("report", "RUN"),
    "report of a file": ("report", "RUN/cases.jsonl", "-o", "OUT.html"),
    "compare as base": ("compare", "RUN", "SOUND", "--across-devices"),
    "compare as head": ("compare", "SOUND", "RUN", "--format", "json"),
    "history": ("history", "SOUND", "RUN", "--all", "--out", "OUT"),
    "gains": ("study", "gains", "RUN", "SOUND", "--out", "OUT", "--bases", "delaunay,ear-clipping"),
    "merge": ("merge", "RUN", "SOUND", "--out", "OUT"),
    "merge of hosts": ("merge", "RUN", "SOUND", "--hosts", "a,b", "--out", "OUT"),
    "page": ("page", "RUN", "--out", "OUT.html"),
    "import": ("import", "RUN", "--summary", "OUT.json"),
    "run --resume": ("run", "--resume", "RUN", "--quiet"),
    "run --resume --force": ("run", "--resume", "RUN", "--force", "--quiet"),
}
"""Every command that reads stored results."""

DEEP = "[" * 200_000
LINES = ("", "null", "[]", "3", DEEP, '{"key": "../../../victim"}', "\x00")


@target(
    "stored",
    st.fixed_dictionaries(
        {
            "command": st.sampled_from(sorted(READERS)),
            "damage": damage_of(["run.json", "cases.jsonl"], ["frames", "polygons"]),
            "line": st.none() | st.sampled_from(LINES),
        }
    ),
)
def check_stored(value: dict[str, Any]) -> str:
    """Each command over a damaged run ends well or with one line, and writes in its place alone."""
    with beside_a_run() as home:
        shutil.copytree(sound(), "SOUND")
        for name, edits in value["damage"]:
            spoil(Path("RUN") / name, edits)
        if value["line"] is not None:
            with Path("RUN/cases.jsonl").open("a") as stream:
                stream.write(value["line"] + "\n")
        code, err = command(*READERS[value["command"]])
        assert code in COMPARED, (code, err)
        assert Path("RUN/report.html").exists() == (value["command"] == "report" and code == GOOD)
        assert "Traceback" not in err, err
        errors = [line for line in err.splitlines() if line.startswith("error: ")]
        assert len(errors) == 1 if code == BAD_INPUT else len(errors) <= 1, err
        outside = {place.name for place in home.rglob("*") if ".unfinished" in place.name}
        assert not outside
        assert [place.name for place in home.parent.iterdir()] == ["b"]
        assert [place.name for place in home.parent.parent.iterdir()] == ["a"]
        return f"{value['command']}: exit {code}"
