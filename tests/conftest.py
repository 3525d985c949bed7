import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from shapely.geometry import Polygon, box

from harness import serving, style
from harness.cli import DEBUG_VARIABLE, main
from harness.machine import system
from harness.machine.process import LOG_VARIABLE
from harness.measuring import tasks
from harness.measuring.run import run
from harness.measuring.timing import TimingSettings
from harness.metrics.run_quality import QUIET, RunState
from harness.rasterisers.base import Sample
from harness.rasterisers.reference import _FillDrawing
from tests.chromium import WEBGPU_FLAGS, Chromium
from tests.inline import InlineWorker
from triangulators.gpu import engine

# Reproducible inputs on all machines; tests/fuzz searches at random.
settings.load_profile("ci")

serving.PRELOADED = "tests.preloaded"

MEASURED_STOLEN_S, MEASURED_OTHERS_S = system.read_steal_time_s, system.read_other_processes_s
system.read_steal_time_s = system.read_other_processes_s = lambda: 0.0
"""Ignore steal time and other programs, which would disturb the milliseconds of a test's run."""

BRIEF_TIMING = TimingSettings(precision=0.5, budget_s=0.02, warm_up_s=0.0)
"""Replaces the settings of `run --quick`."""


PRINTED_DPI = style.STYLE["savefig.dpi"]
style.STYLE["savefig.dpi"] = 50
"""Most tests only check that a picture is written; printed pictures have 16 times the pixels."""


def pytest_configure(config: pytest.Config) -> None:
    """Enable Ctrl-C, which tests send; compile before the workers of pytest-xdist start."""
    # Background jobs of a shell and their children ignore SIGINT.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        from tests.compiling import compile_everything

        compile_everything()
    # Objects from imports and test collection live until the end; scanning them would take 10 % of
    # a worker's time.
    gc.disable()


def pytest_collection_finish() -> None:
    """Enable garbage collection, but only of objects that tests create."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """Return the number of cores plus one, because many tests wait for a child process."""
    return min(len(os.sched_getaffinity(0)) + 1, 9)


IN_METRES = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3067"}}
BLOCK = [
    Polygon([(0, 0), (12, 0), (12, 4), (4, 4), (4, 10), (0, 10)]),
    box(20, 0, 36, 16).difference(box(24, 4, 32, 12)),
    box(0, 20, 8, 28),
]
"""Three footprints: an L, a courtyard, a square."""


def make_geojson(geometries: Iterable[Any], **members: Any) -> str:
    """Return a FeatureCollection of numbered shapes, GeoJSON geometries or None."""
    features = [
        {"type": "Feature", "properties": {"id": number}, "geometry": shape}
        for number, shape in enumerate(
            getattr(geometry, "__geo_interface__", geometry) for geometry in geometries
        )
    ]
    return json.dumps({"type": "FeatureCollection", **members, "features": features})


def write_geojson(path: Path, polygons: list[Polygon]) -> Path:
    path.write_text(make_geojson(polygons, crs=IN_METRES))
    return path


def run_command(*arguments: str) -> int:
    """Run the command line in this process; return the exit code."""
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
    """Return a function that runs a command in an empty folder: (exit code, out, err)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    monkeypatch.setattr("harness.commands.run.QUICK", BRIEF_TIMING)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = run_command(*arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def require_ok(result: tuple[int, str, str]) -> tuple[str, str]:
    """Require exit code 0 of a command's (exit code, out, err); return (out, err)."""
    code, out, err = result
    assert code == 0, err
    return out, err


def assert_one_line(err: str, *parts: str) -> None:
    """Require a single error line that contains the parts, and no traceback."""
    lines = [line for line in err.strip().splitlines() if line.startswith("error:")]
    assert len(lines) == 1, err
    assert "Traceback" not in err
    for part in parts:
        assert part in lines[0]


def assert_refused(result: tuple[int, str, str], *parts: str, code: int = 2) -> str:
    """Require an exit code and a single error line that contains the parts; return err."""
    exit_code, _, err = result
    assert exit_code == code, err
    assert_one_line(err, *parts)
    return err


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip plots of runs and studies, which have separate tests."""
    monkeypatch.setattr("harness.report.plots.plot_run", lambda run: [])
    monkeypatch.setattr("harness.study.correlations.plot_study", lambda *_: [])


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Execute the tasks of runs in this process, for tests of later steps."""
    shorten_runs(monkeypatch)


_choose_timer_once = cache(tasks.select_device_timer)


def shorten_runs(patch: pytest.MonkeyPatch) -> None:
    """Execute the tasks of runs in this process, in few rounds, with one reference draw per batch.

    The run counts as quiet whatever else runs on the machine, so that its times are evaluated.
    """
    sample = _FillDrawing.sample

    def sample_once(drawing: _FillDrawing, repeats: int) -> Sample:
        return Sample(wall=sample(drawing, 1).wall * repeats)

    patch.setitem(run.__kwdefaults__, "open_worker", lambda *_: InlineWorker())
    patch.setattr("harness.measuring.run.assess_records", lambda *_: RunState(QUIET))
    patch.setattr("harness.measuring.tasks.select_device_timer", _choose_timer_once)
    patch.setattr("harness.measuring.timing.MIN_ROUNDS", 6)
    patch.setattr(_FillDrawing, "sample", sample_once)


@pytest.fixture
def device_counts(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the numbers of polygons solved by compute shaders, per batch."""
    counts: list[int] = []
    original = engine.solve_on_device

    def record_counts(name: str, batch: engine.Batch, *arguments: Any) -> None:
        original(name, batch, *arguments)
        counts.append(int(batch.done.sum()))

    monkeypatch.setattr(engine, "solve_on_device", record_counts)
    return counts


@pytest.fixture(scope="session")
def browser() -> Iterator[Chromium]:
    """Yield a browser for all tests of pages; they fail with a hint if it is not installed."""
    chromium = Chromium()
    yield chromium
    chromium.close()


@pytest.fixture(scope="session")
def gpu_browser() -> Iterator[Chromium]:
    """Yield a browser with WebGPU and WebGL 2 on the CPU."""
    chromium = Chromium(WEBGPU_FLAGS)
    yield chromium
    chromium.close()


@pytest.fixture(scope="session", autouse=True)
def _restore_default_signals() -> None:
    """Restore the default effect of signals; nohup, for example, ignores SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def _use_temporary_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Use a temporary triangulation cache in tests and their child processes."""
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("cache") / "triangulations.sqlite"
        patch.setenv("RASTER_HARNESS_CACHE", str(path))
        yield


@pytest.fixture(autouse=True)
def _forget_user_modules(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Forget the modules and import paths of earlier tests' folders, and a variable of Dask's."""
    folder = str(tmp_path_factory.getbasetemp())
    sys.path[:] = [path for path in sys.path if not path.startswith(folder)]
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(folder):
            del sys.modules[name]
    # Dask's nanny leaves it behind, and programs that tests start would not find the tests.
    os.environ.pop("PYTHONSAFEPATH", None)


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """Return a GeoJSON file of three footprints: an L, a courtyard, a square."""
    return write_geojson(tmp_path / "block.geojson", BLOCK)
