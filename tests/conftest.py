"""Fixtures that all tests share."""

import gc
import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from shapely.geometry import Polygon, box

from harness import style
from harness.cli import main
from harness.diagnostics import DEBUG_VARIABLE, LOG_VARIABLE
from harness.machine import system
from harness.measuring import tasks
from harness.measuring.run import run
from harness.measuring.timing import TimingSettings
from harness.rasterisers.base import Sample
from harness.rasterisers.reference import _Filling
from harness.stats.run_quality import QUIET, RunState
from harness.workers import serving
from tests.chromium import Chromium
from tests.inline import Inline
from triangulators.gpu import engine

# The same inputs every time, whatever the machine; tests/fuzz searches at random.
settings.load_profile("ci")

serving.PRELOADED = "tests.preloaded"

system.stolen_s = system.other_processes_s = lambda: 0.0
"""What the host or another program takes of a test's few milliseconds is not what it asks about."""

BRIEF = TimingSettings(precision=0.5, budget_s=0.02, warm_up_s=0.0)
"""In place of what `run --quick` takes."""


PRINTED_DPI = style.STYLE["savefig.dpi"]
style.STYLE["savefig.dpi"] = 50
"""Most tests ask only whether a picture is written; a paper's has sixteen times the pixels."""


def pytest_configure(config: pytest.Config) -> None:
    """Hear Ctrl-C, which tests send; compile before the workers of pytest-xdist start."""
    # A shell's background job, and what it starts, would ignore it.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        from tests.compiling import compile_everything

        compile_everything()
    # What imports and collecting the tests make stays until the end: a tenth of a worker's time
    # would go into walking over it.
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage again, but only what the tests themselves make."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than there are cores: many tests wait for a process that they started."""
    return min(len(os.sched_getaffinity(0)) + 1, 9)


IN_METRES = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3067"}}
BLOCK = [
    Polygon([(0, 0), (12, 0), (12, 4), (4, 4), (4, 10), (0, 10)]),
    box(20, 0, 36, 16).difference(box(24, 4, 32, 12)),
    box(0, 20, 8, 28),
]
"""Three footprints: an L, a courtyard, a square."""


def geojson(geometries: Iterable[Any], **members: Any) -> str:
    """A collection of features, numbered: shapes, geometries as JSON has them, or None."""
    features = [
        {"type": "Feature", "properties": {"id": number}, "geometry": shape}
        for number, shape in enumerate(
            getattr(each, "__geo_interface__", each) for each in geometries
        )
    ]
    return json.dumps({"type": "FeatureCollection", **members, "features": features})


def write_geojson(path: Path, polygons: list[Polygon]) -> Path:
    """Write polygons in metres to a GeoJSON file."""
    path.write_text(geojson(polygons, crs=IN_METRES))
    return path


def exit_code(*arguments: str) -> int:
    """Run the command line in this process; returns its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["harness", *arguments])
        for variable in (DEBUG_VARIABLE, LOG_VARIABLE):
            patch.setenv(variable, "")
        with pytest.raises(SystemExit) as end:
            main()
    return int(end.value.code or 0)


@pytest.fixture
def harness(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process, in an empty folder; returns (exit code, out, err)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    monkeypatch.setattr("harness.commands.run.QUICK", BRIEF)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = exit_code(*arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def ends_well(answer: tuple[int, str, str]) -> tuple[str, str]:
    """Require of a command's (exit code, out, err) that it did what it was to do: (out, err)."""
    code, out, err = answer
    assert code == 0, err
    return out, err


def assert_one_line(err: str, *parts: str) -> None:
    """Require one line of an error, with these parts, and no traceback."""
    lines = [line for line in err.strip().splitlines() if line.startswith("error:")]
    assert len(lines) == 1, err
    assert "Traceback" not in err
    for part in parts:
        assert part in lines[0]


def assert_refused(answer: tuple[int, str, str], *parts: str, code: int = 2) -> str:
    """Require of a command's answer that it is one line of an error, with these parts; err."""
    found, _, err = answer
    assert found == code, err
    assert_one_line(err, *parts)
    return err


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out plots of runs and studies, which are looked at in tests of their own."""
    monkeypatch.setattr("harness.report.plots.plot_run", lambda run: [])
    monkeypatch.setattr("harness.study.correlations.plot_study", lambda *_: [])


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a run's tasks in this process, for tests of what comes after."""
    briefly(monkeypatch)


_timer_tested_once = cache(tasks.choose_timer)


def briefly(patch: pytest.MonkeyPatch) -> None:
    """Run a run's tasks in this process, in few rounds; the reference draws once for a batch.

    The run is quiet whatever else the machine does, so that what follows from its times is there.
    """
    sample = _Filling.sample

    def once(drawing: _Filling, repeats: int) -> Sample:
        return Sample(wall=sample(drawing, 1).wall * repeats)

    patch.setitem(run.__kwdefaults__, "open_worker", lambda *_: Inline())
    patch.setattr("harness.measuring.run.judge_records", lambda *_: RunState(QUIET))
    patch.setattr("harness.measuring.tasks.choose_timer", _timer_tested_once)
    patch.setattr("harness.measuring.timing.MIN_ROUNDS", 6)
    patch.setattr(_Filling, "sample", once)


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many polygons compute shaders did, batch by batch; the CPU did the others."""
    counts: list[int] = []
    attempt = engine.attempt

    def counted(name: str, batch: engine.Batch, *how: Any) -> None:
        attempt(name, batch, *how)
        counts.append(int(batch.done.sum()))

    monkeypatch.setattr(engine, "attempt", counted)
    return counts


@pytest.fixture(scope="session")
def browser() -> Iterator[Chromium]:
    """One browser for all tests that look at a page; without one they fail, and say why."""
    chromium = Chromium()
    yield chromium
    chromium.close()


@pytest.fixture(scope="session", autouse=True)
def _signals_as_in_a_terminal() -> None:
    """Let signals do what they usually do, however the tests were started: nohup ignores SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def _own_model_database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep tests, and the programs they start, away from the user's model database."""
    with pytest.MonkeyPatch.context() as patch:
        place = tmp_path_factory.mktemp("cache") / "triangulations.sqlite"
        patch.setenv("RASTER_HARNESS_CACHE", str(place))
        yield


@pytest.fixture(autouse=True)
def _user_modules_of_one_test() -> Iterator[None]:
    """Restore the import path and forget modules that a test imported from a temporary folder."""
    path, modules = list(sys.path), set(sys.modules)
    yield
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        file = getattr(sys.modules[name], "__file__", None) or ""
        if Path(file).is_relative_to(tempfile.gettempdir()):
            del sys.modules[name]


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A GeoJSON file of three footprints: an L, a courtyard, a square."""
    return write_geojson(tmp_path / "block.geojson", BLOCK)
