"""Commands on damaged run folders: a result or a single error line, with the right exit code."""

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

from harness.errors import BAD_INPUT, GOOD, INCONCLUSIVE, NOTHING_MEASURED, REGRESSION
from harness.measuring.run import run
from tests.compare.runs import write_run
from tests.conftest import BLOCK, run_command, write_geojson
from tests.fuzz.damage import byte_edits, edit_file_bytes, edit_file_values, value_edits
from tests.fuzz.target import target
from tests.inline import InlineWorker
from tests.measuring.test_run import make_plan, measure

SILENT_S = 10.0
"""Maximum time without output of a command."""

EXPECTED_CODES = (GOOD, REGRESSION, BAD_INPUT, NOTHING_MEASURED, INCONCLUSIVE)
RUNS, RECORD_FILES = ("base", "head"), ("run.json", "cases.jsonl")
FORMATS = ("table", "markdown", "json")


def draw_damage(files: list[str], folders: list[str]) -> st.SearchStrategy[Any]:
    """Draw edits of one or two JSON files, or of every array in a folder."""
    in_bytes = st.lists(byte_edits, min_size=1, max_size=3)
    in_values = st.lists(value_edits, min_size=1, max_size=3)
    edits = st.tuples(st.sampled_from(files), in_values | in_bytes)
    if folders:
        edits |= st.tuples(st.sampled_from(folders), in_bytes)
    return st.lists(edits, min_size=1, max_size=2, unique_by=lambda edit: edit[0])


class TimedOutput(io.StringIO):
    """The output of a command, with its longest time without output."""

    def __init__(self) -> None:
        super().__init__()
        self._last = time.monotonic()
        self.silent_s = 0.0

    def write(self, text: str) -> int:
        self.silent_s = max(self.silent_s, time.monotonic() - self._last)
        self._last = time.monotonic()
        return super().write(text)


class SilentError(AssertionError):
    """A command was silent for too long."""


def call_command(*arguments: str) -> tuple[int, str]:
    """Run a command in this process; return the exit code and standard error."""
    out, err = io.StringIO(), TimedOutput()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_command(*arguments)
    text = err.getvalue()
    err.write("")  # end of the last interval
    if err.silent_s >= SILENT_S:
        raise SilentError(f"no output for {err.silent_s:.0f} s: {arguments}")
    return code, text


def damage_path(path: Path, edits: list[dict[str, Any]]) -> None:
    edit = edit_file_values if "value" in edits[0] else edit_file_bytes
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        edit(file, edits)


@target(
    "compare",
    st.fixed_dictionaries(
        {
            "damage": draw_damage([f"{run}/{file}" for run in RUNS for file in RECORD_FILES], []),
            "gate": st.sampled_from(["counters", "time", "counters,time"]),
            "format": st.sampled_from(FORMATS),
        }
    ),
)
def check_compare(value: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        for name, seed in (("base", 1), ("head", 2)):
            write_run(path / name, seed=seed)
        for name, edits in value["damage"]:
            damage_path(path / name, edits)
        kinds = ("markdown", "junit", "json", "html")
        files = [f"--{kind}={path / kind}" for kind in kinds]
        options = ["--gate", value["gate"], "--format", value["format"], *files]
        code, err = call_command("compare", str(path / "base"), str(path / "head"), *options)
        assert code in EXPECTED_CODES, (code, err)
        assert "Traceback" not in err, err
        if code == BAD_INPUT:
            assert err.startswith("error: "), err
            assert err.count("\n") == 1, err
        else:
            assert all((path / kind).stat().st_size > 0 for kind in kinds)


@cache
def make_sample_run() -> Path:
    """Return a run of four footprints, measured once."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-run-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    scene = write_geojson(folder / "block.geojson", BLOCK)
    names = ("ear-clipping", "delaunay", "optimal:half-perimeter")
    measure(make_plan(scene, triangulators=names, rasterisers=("reference",)), folder / "run")
    _make_reproducible(folder / "run")
    return folder / "run"


@contextmanager
def enter_workspace() -> Iterator[Path]:
    """Change to a new folder with a copy of the run and its polygons; execute tasks in process."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        workspace = Path(folder) / "a" / "b"
        workspace.mkdir(parents=True)
        patch.chdir(workspace)
        patch.setitem(run.__kwdefaults__, "open_worker", lambda *_: InlineWorker())
        patch.setattr("harness.measuring.plan.Worker", lambda *_: InlineWorker())
        patch.setattr("harness.report.plots.plot_run", lambda run: [])
        shutil.copytree(make_sample_run(), "RUN")
        shutil.copy(make_sample_run().with_name("block.geojson"), ".")
        yield workspace


def _make_reproducible(folder: Path) -> None:
    """Remove what depends on time and machine from the files of a run, so that edits reproduce."""
    run_facts = json.loads((folder / "run.json").read_text())
    run_facts |= {"created": "2026-01-01T12:00:00+00:00", "warnings": [], "seconds": {"count": 1.5}}
    run_facts["environment"] = {"cpu": "a processor", "kernel": "a system", "harness": "0.1.0"}
    run_facts["plan"]["scene"] = "block.geojson"
    (folder / "run.json").write_text(json.dumps(run_facts, indent=2))
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


COMMANDS: dict[str, tuple[str, ...]] = {
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
"""All commands that read stored results."""

NESTED = "[" * 200_000
LINES = ("", "null", "[]", "3", NESTED, '{"key": "../../../victim"}', "\x00")


@target(
    "stored",
    st.fixed_dictionaries(
        {
            "command": st.sampled_from(sorted(COMMANDS)),
            "damage": draw_damage(["run.json", "cases.jsonl"], ["frames", "polygons"]),
            "line": st.none() | st.sampled_from(LINES),
        }
    ),
)
def check_stored(value: dict[str, Any]) -> str:
    """A command on a damaged run succeeds or prints one error, and writes only its output."""
    with enter_workspace() as workspace:
        shutil.copytree(make_sample_run(), "SOUND")
        for name, edits in value["damage"]:
            damage_path(Path("RUN") / name, edits)
        if value["line"] is not None:
            with Path("RUN/cases.jsonl").open("a") as stream:
                stream.write(value["line"] + "\n")
        code, err = call_command(*COMMANDS[value["command"]])
        assert code in EXPECTED_CODES, (code, err)
        has_report, name = Path("RUN/report.html").exists(), value["command"]
        if name == "report":
            assert has_report == (code == GOOD)
        else:
            assert not has_report or (name.startswith("run ") and code != BAD_INPUT)
        assert "Traceback" not in err, err
        errors = [line for line in err.splitlines() if line.startswith("error: ")]
        assert len(errors) == 1 if code == BAD_INPUT else len(errors) <= 1, err
        unfinished = {path.name for path in workspace.rglob("*") if ".unfinished" in path.name}
        assert not unfinished
        assert [path.name for path in workspace.parent.iterdir()] == ["b"]
        assert [path.name for path in workspace.parent.parent.iterdir()] == ["a"]
        return f"{value['command']}: exit {code}"
