"""The commands by name. `--help` shows them from this table and imports none: a test compares both.

The order is that of `--help`, in which the everyday ones come first.
"""

from importlib import import_module
from inspect import getdoc
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, cast

import typer

PROGRAM = "raster-harness"
RUN = "results/city-20260101-120000"
LATER = "results/city-20260102-120000"


class Entry(NamedTuple):
    """A command.

    panel : the heading under which `--help` lists it
    function : where it is, "module:function" in `harness.commands`
    summary : the first paragraph of the function's docstring
    examples : shown by its `--help`; a test runs each of them
    """

    panel: str
    function: str
    summary: str
    examples: tuple[str, ...]


MEASURE, COMPARE, STUDY = "Measure", "Compare", "Study"
GEOMETRY, MACHINE = "Geometry", "Machine"

COMMANDS = {
    "run": Entry(
        MEASURE,
        "run:run",
        "Measure triangulators on a scene, with exact counters and repeated times; store it all.",
        (
            "run --scene city",
            "run --scene buildings.geojson --triangulators delaunay,optimal:half-perimeter",
            "run --scene city:buildings=50 --resolution 256,512 --rotation 0,30 --quick",
        ),
    ),
    "report": Entry(
        MEASURE,
        "page:report",
        "Write the report of a run: one HTML file, which needs no network.",
        (
            f"report {RUN}",
            f"report {RUN} --out city.html",
        ),
    ),
    "profile": Entry(
        MEASURE,
        "profile:profile",
        "Say what a triangle, a pixel and a helper lane cost on a device; how to triangulate "
        "there.",
        ("profile --budget 0.05",),
    ),
    "page": Entry(
        MEASURE,
        "page:page",
        "Write a page that measures a run's triangulations in any browser that has WebGPU.",
        (f"page {RUN} --out city.html", "page --profile --out triangle.html"),
    ),
    "import": Entry(
        MEASURE,
        "page:import_",
        "Make a run folder, or a profile, of what a measuring page saved.",
        ("import saved-by-the-page.json --out results/phone",),
    ),
    "merge": Entry(
        MEASURE,
        "page:merge",
        "Merge runs into one, by case; the order in which they are given does not matter.",
        (f"merge {RUN} {LATER} --hosts first,second --out results/merged",),
    ),
    "compare": Entry(
        COMPARE,
        "compare:compare",
        "Say what changed from BASE to HEAD; exit with 1 if something became slower or costs more.",
        (
            f"compare {RUN} {LATER}",
            f"compare {RUN} {LATER} --gate counters --html comparison.html",
            f"compare {RUN} {RUN} --repeat",
        ),
    ),
    "history": Entry(
        COMPARE,
        "compare:history",
        "Show what changed over runs, in the order they were made.",
        ("history results",),
    ),
    "study validate": Entry(
        STUDY,
        "study:validate",
        "Say how well each criterion predicts the measured cost, within single polygons.",
        ("study validate --scene city --quick",),
    ),
    "study gains": Entry(
        STUDY,
        "study:gains",
        "Compare each triangulator's time with the bases', in all views; say which one was faster.",
        (f"study gains {RUN} --out results/gains",),
    ),
    "study pareto": Entry(
        STUDY,
        "study:pareto",
        "Measure the Pareto front of the paper's A and D, and the sweep of their weights.",
        (
            "study pareto --scene paper",
            "study pareto --scene city --polygons 4 --budget 0.2",
        ),
    ),
    "study all": Entry(
        STUDY,
        "study:study",
        "Say which of our findings hold on your data: validation, gains, regret and rotation, "
        "bundled.",
        ("study all buildings.geojson --out results/study --quick",),
    ),
    "census": Entry(
        STUDY,
        "census:census",
        "Say what each triangulator gains on every footprint of a data set, by exact counting.",
        (
            "census buildings.geojson --out results/census",
            "census berlin.pmtiles:zoom=14 --out results/map",
        ),
    ),
    "triangulate": Entry(
        GEOMETRY,
        "export:triangulate",
        "Triangulate a file of polygons and write the triangles.",
        (
            "triangulate buildings.geojson --criterion overdraw -o buildings.glb",
            "triangulate paper -o paper.glb --certify --evidence proofs.jsonl",
        ),
    ),
    "check-evidence": Entry(
        GEOMETRY,
        "export:check_evidence",
        "Check proofs that triangulations are optimal, in whole numbers; refuse what does not "
        "hold.",
        ("check-evidence proofs.jsonl",),
    ),
    "inspect": Entry(
        GEOMETRY,
        "inspect:inspect",
        "Show where one polygon's triangulations cost, or whether the choice matters for a file.",
        (
            "inspect city --polygon 3 --out polygon-3.png",
            "inspect buildings.geojson --sizes 16-1024",
            "inspect paper --every paper",
        ),
    ),
    "list": Entry(
        MACHINE,
        "catalogue:catalogue",
        "List scenes, triangulators, rasterisers, criteria and metrics, or one kind of these.",
        ("list", "list triangulators"),
    ),
    "doctor": Entry(
        MACHINE,
        "catalogue:doctor",
        "Check devices, drivers, extensions and timers; say how to repair what does not work.",
        ("doctor",),
    ),
    "cache": Entry(
        MACHINE,
        "export:cache",
        "Show or empty the model database of triangulations.",
        ("cache info",),
    ),
}

GROUPS = {
    "study": Entry(
        STUDY,
        "",
        "Study criteria and choices: validate, gains and pareto; all of them on your data.",
        (),
    ),
}
"""Commands that have commands of their own: in `COMMANDS`, their names come after this one."""


def load(name: str) -> Any:
    """Import a command and return it as click has it, its examples below its help."""
    if name in GROUPS:
        return CommandGroup(
            before=f"{name} ", name=name, help=GROUPS[name].summary, no_args_is_help=True
        )
    module, _, attribute = COMMANDS[name].function.partition(":")
    function = getattr(import_module(f"harness.commands.{module}"), attribute)
    # Paragraphs wrap at any width.
    paragraphs = [" ".join(part.split()) for part in (getdoc(function) or "").split("\n\n")]
    lines = [f"{PROGRAM} {line}" for line in COMMANDS[name].examples]
    # In plain text: Rich's table of options would cut long defaults off.
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(
        name.rpartition(" ")[2],
        cls=CheckedCommand,
        help="\n\n".join(paragraphs),
        epilog="\n\n".join(["Examples:", *lines]),
    )(function)
    return typer.main.get_command(alone)


class CheckedCommand(typer.core.TyperCommand):
    """A command whose given values are names, places and numbers: none empty, none infinite."""

    def invoke(self, ctx: Any) -> Any:
        """Check what the user gave, and call the function."""
        for parameter in self.params:
            source = ctx.get_parameter_source(parameter.name)
            value = ctx.params.get(parameter.name)
            if getattr(source, "name", "") == "COMMANDLINE" and (wrong := _wrong(value)):
                raise typer.BadParameter(wrong, ctx=ctx, param=cast("Any", parameter))
        return super().invoke(ctx)


def _wrong(value: Any) -> str:
    """Return why a value cannot be meant, "" where it can."""
    if isinstance(value, list):
        return next(filter(None, map(_wrong, value)), "")
    if isinstance(value, float) and not isfinite(value):
        return f"{value} is not a number that can be used"
    # The path of an empty text is "."; nobody means this folder by it.
    if isinstance(value, str | Path) and (value == Path() or not str(value).strip()):
        return "it is empty"
    return "it holds a null" if "\0" in str(value) else ""


class CommandGroup(typer.core.TyperGroup):
    """A group of commands: each is imported when it is called, not when it is listed.

    before : what the names of its commands begin with in `COMMANDS`; "" for the group of all
    """

    def __init__(self, before: str = "", **settings: Any) -> None:
        super().__init__(**settings)
        self._before = before
        for name, entry in ({} if before else GROUPS | COMMANDS).items() or COMMANDS.items():
            own = name.removeprefix(before)
            if name.startswith(before) and " " not in own:
                self.commands[own] = typer.core.TyperCommand(
                    own, help=entry.summary, rich_help_panel=entry.panel
                )

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return what `args` call, imported."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, load(self._before + name) if name and command else command, rest
