"""The command line: exit codes, one-line errors, no traceback."""

from importlib import import_module
from inspect import isfunction, signature
from pathlib import Path
from typing import get_args

import pytest
from shapely import box

from harness.commands.index import COMMANDS, load_command
from harness.frame import FIXED_VIEWS
from harness.results.run_folder import read_run
from harness.settings import CHOSEN_FITS, Fit
from tests.conftest import assert_one_line, assert_refused, require_ok, write_geojson
from tests.paths import ROOT, run_python

MOCK = ["--rasterisers", "tests.mock:MockRasteriser", "--quick", "--quiet"]


def test_a_run_prints_a_table_and_may_leave_the_report_to_a_later_command(harness, block):
    run = ("run", "--scene", str(block), "--out", "results", "--no-report", *MOCK)
    out, _ = require_ok(harness(*run))
    assert "optimal:half-perimeter" in out
    assert "vs ear-clipping" in out
    files = {str(path.relative_to("results")) for path in Path("results").rglob("*")}
    assert {"run.json", "cases.jsonl", "summary.csv"} <= files
    assert "report.html" not in files
    assert not Path("results/plots").exists()  # plots of a quick run are drawn on demand
    assert harness("report", "results")[0] == 0
    assert Path("results/report.html").exists()
    assert Path("results/plots/predicted-vs-measured.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        *(("", ["--scene"]), ("--resume nowhere", ["nowhere"])),
        ("--scene citty", ["citty", "city"]),
        ("--scene missing.geojson", ["missing.geojson"]),
        ("--scene city:bildings=3", ["bildings", "buildings"]),
        ("--scene city --triangulators delauney", ["delauney", "delaunay"]),
        ("--scene city --triangulators optimal:half", ["half", "half-perimeter"]),
        ("--scene city --rasterisers opngl", ["opngl", "opengl"]),
        ("--scene city --device lvmpipe", ["lvmpipe", "llvmpipe"]),
        ("--scene city --resolution big", ["--resolution", "big"]),
        ("--scene city --resolution 2", ["--resolution", "8 to 16384"]),
        ("--scene city --samples 3", ["samples", "3"]),
        ("--scene city --out /proc/none", ["/proc/none"]),
        ("--scene city --out a --resume b", ["--out", "--resume"]),
    ],
)
def test_bad_usage_is_one_line_with_exit_code_2(harness, arguments, parts):
    assert_refused(harness("run", *arguments.split()), *parts)


@pytest.mark.usefixtures("no_plots", "in_process")
def test_a_run_without_covered_pixels_measures_nothing(harness):
    """Two houses, a thousand kilometres apart; all counters are 0."""
    houses = [box(x, x, x + 90, x + 40) for x in (13_000, 1_013_000)]
    scene = str(write_geojson(Path("far.geojson"), houses))
    code, out, err = harness("run", "--scene", scene, "--rasterisers", "reference", "--quick")
    assert code == 4
    assert_one_line(err, "none of the measured cases covers", "exclude it by --where or --limit")
    assert "the polygons cover 0 pixels in all (at least 64 are needed)" in out


def test_help_lists_every_command_with_its_docstring_and_full_defaults(harness):
    assert len({name.partition(" ")[0] for name in COMMANDS}) <= 16
    listed = {
        group: " ".join(harness(*group.split(), "--help")[1].replace("│", " ").split())
        for group in ("", "study")
    }
    for name in COMMANDS:
        group, _, short_name = name.rpartition(" ")
        command = load_command(name)
        assert command.name == short_name
        assert f"{short_name} {command.help.partition(chr(10))[0]}" in listed[group]
        context = command.make_context(name, [], resilient_parsing=True)
        assert "…" not in command.get_help(context)


def test_the_table_has_every_command():
    """A command is a public function of `harness.commands` with options of Typer."""
    commands = set()
    for file in (ROOT / "harness" / "commands").glob("*.py"):
        module = import_module(f"harness.commands.{file.stem}")
        functions = {name: member for name, member in vars(module).items() if isfunction(member)}
        commands |= {
            f"{file.stem}:{name}"
            for name, function in functions.items()
            if function.__module__ == module.__name__ and not name.startswith("_")
            if "typer." in file.read_text() and "Annotated" in str(signature(function))
        }
    assert {entry.function for entry in COMMANDS.values()} >= commands


def test_fit_has_the_choices_of_a_view():
    assert (*get_args(CHOSEN_FITS), *FIXED_VIEWS) == get_args(Fit)


WITHOUT_HEAVY_LIBRARIES = [
    *("--help", "run --help", "no-command", "run --no-option", "study validate --no-option"),
    *("triangulate --no-option", "compare --no-option", "profile --no-option"),
    *("list nothing", "list triangulators", "list criteria", "list metrics"),
]


def test_help_and_wrong_options_need_no_heavy_library():
    """The import of any of these takes longer than such a command."""
    program = f"""
import contextlib, io, os, sys
from harness.cli import main
heavy = ("numba", "scipy", "matplotlib", "pandas", "jinja2", "moderngl", "trimesh")
for arguments in {WITHOUT_HEAVY_LIBRARIES!r}:
    sys.argv = ["harness", *arguments.split()]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        with contextlib.suppress(SystemExit):
            main()
    loaded = [name for name in heavy if name in sys.modules]
    if loaded:
        print(arguments, loaded)
        break
os.environ.update(_RASTER_HARNESS_COMPLETE="complete_bash")
os.environ.update(COMP_WORDS="raster-harness re", COMP_CWORD="1")
sys.argv = ["harness"]
with contextlib.suppress(SystemExit):
    main()
print([name for name in heavy if name in sys.modules])
"""
    done = run_python("-c", program)
    assert done.stdout.splitlines() == ["report", "[]"]


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        *(("run", "--seed", "-1"), ("run", "--repeats", "9" * 20), ("run", "--rotation", "inf")),
        *(("run", "--timeout", value) for value in ("nan", "inf", "0", "-1")),
        *(("run", "--budget", value) for value in ("nan", "inf", "0", "-1")),
        *(("run", "--precision", value) for value in ("nan", "-1", "0")),
        *(("run", option, "") for option in ("--resolution", "--rotation", "--order", "--out")),
        *(("census", option, "inf") for option in ("--cell", "--units-per-pixel")),
        *(("study validate", "--work", "-1"), ("study gains", "--bases", ",")),
        ("merge", "--out", ""),
    ],
)
def test_invalid_values_of_options_are_refused(harness, command, option, value):
    needed = {"census": ["x", "-o", "y"], "merge": ["a"], "study gains": ["a", "--out", "b"]}
    answer = harness(*command.split(), *needed.get(command, []), option, value)
    assert_refused(answer, f"Invalid value for '{option}'")
    assert not list(Path().iterdir())


def test_unused_options_are_refused(harness, block):
    answer = harness("run", "--scene", str(block), *MOCK, "--profile", "c.json")
    assert_refused(answer, "--profile c.json: neither a file nor a known name")
    assert_refused(harness("run", "--scene", "city", "--layer", "x"), "layer")
    assert_refused(harness("inspect", str(block), "--out", "a.foo"), ".png")
    assert_refused(harness("list", "scene"), "scenes")  # the nearest kind is suggested


def test_a_file_other_than_a_run_is_bad_input(harness):
    Path("README.md").write_text("# nothing\n")
    assert_refused(harness("compare", "README.md", "README.md"), "README.md", "no record of a run")


@pytest.mark.usefixtures("no_plots", "in_process")
def test_failed_triangulators_are_reported_with_exit_code_5(harness, block, monkeypatch):
    Path("mine.py").write_text(
        "def cut(polygon):\n    table = {}\n    return table['x' * 100_000]\n"
    )
    monkeypatch.syspath_prepend(Path.cwd())
    asked = ("--triangulators", "delaunay,mine:cut", "--out", "o", "--verbose")
    code, out, err = harness("run", "--scene", str(block), *MOCK, *asked)
    assert code == 5
    assert "delaunay" in out
    (error,) = [line for line in err.splitlines() if line.startswith("error:")]
    assert "1 of 2 cases failed (mine:cut); the others are in o" in error
    assert "mine.py:3" in err
    assert "return table['x' * 100_000]" in err
    assert "delaunay, tests.mock:MockRasteriser on scripted: ok, " in err
    (reason,) = (record.reason for record in read_run(Path("o")).records if not record.is_ok)
    assert "KeyError" in reason
    assert "mine.py:3" in reason
    assert len(reason) < 1000
