"""The commands by name. `--help` shows them from this table and imports none: a test compares both.

The order is that of `--help`, in which the everyday ones come first.
"""

from __future__ import annotations

from importlib import import_module
from inspect import getdoc
from typing import Any, NamedTuple

import typer

from harness.commands.examples import EXAMPLES, PROGRAM


class Entry(NamedTuple):
    """A command.

    panel : the heading under which `--help` lists it
    function : where it is, "module:function" in `harness.commands`
    summary : the first paragraph of the function's docstring
    """

    panel: str
    function: str
    summary: str


MEASURE, COMPARE, STUDY = "Measure", "Compare", "Study"
GEOMETRY, MACHINE = "Geometry", "Machine"

COMMANDS = {
    "run": Entry(
        MEASURE,
        "run:run",
        "Measure triangulators on a scene, with exact counters and repeated times; store it all.",
    ),
    "report": Entry(
        MEASURE,
        "report:report",
        "Write the report of a run: one HTML file, which needs no network.",
    ),
    "page": Entry(
        MEASURE,
        "page:page",
        "Write a page that measures a run's triangulations in any browser that has WebGPU.",
    ),
    "import": Entry(
        MEASURE,
        "page:import_",
        "Make a run folder of what a measuring page saved.",
    ),
    "merge": Entry(
        MEASURE,
        "merge:merge",
        "Merge runs into one, by case; the order in which they are given does not matter.",
    ),
    "compare": Entry(
        COMPARE,
        "compare:compare",
        "Say what changed from BASE to HEAD; exit with 1 if something became slower or costs more.",
    ),
    "history": Entry(
        COMPARE,
        "history:history",
        "Show what changed over runs, in the order they were made.",
    ),
    "gains": Entry(
        COMPARE,
        "gains:gains",
        "Compare each triangulator's time with the bases', in all views; say which one was faster.",
    ),
    "repeat": Entry(
        COMPARE,
        "repeat:repeat",
        "Check that two runs of one plan have equal counters, and say how often verdicts agree.",
    ),
    "validate": Entry(
        STUDY,
        "validate:validate",
        "Say how well each criterion predicts the measured cost, within single polygons.",
    ),
    "study": Entry(
        STUDY,
        "study:study",
        "Say which of our findings hold on your data: validation, gains, regret and rotation, "
        "bundled.",
    ),
    "calibrate": Entry(
        STUDY,
        "calibrate:calibrate",
        "Fit a model of a device's draw time, and test it on polygons that it has not seen.",
    ),
    "pareto": Entry(
        STUDY,
        "pareto:pareto",
        "Measure the Pareto front of the paper's A and D, and the sweep of their weights.",
    ),
    "census": Entry(
        STUDY,
        "census:census",
        "Say what each triangulator gains on every footprint of a data set, by exact counting.",
    ),
    "triangulate": Entry(
        GEOMETRY,
        "export:triangulate",
        "Triangulate a file of polygons and write the triangles.",
    ),
    "inspect": Entry(
        GEOMETRY,
        "inspect:inspect",
        "Draw overdraw and helper lanes of one polygon, side by side for several triangulators.",
    ),
    "enumerate": Entry(
        GEOMETRY,
        "enumeration:enumerate_",
        "List every triangulation of a polygon with its criteria; draw shape against overdraw.",
    ),
    "list": Entry(
        MACHINE,
        "catalogue:catalogue",
        "List scenes, triangulators, rasterisers, criteria or metrics.",
    ),
    "doctor": Entry(
        MACHINE,
        "doctor:doctor",
        "Check devices, drivers, extensions and timers; say how to repair what does not work.",
    ),
    "cache": Entry(
        MACHINE,
        "export:cache",
        "Show or empty the model database of triangulations.",
    ),
}


def load(name: str) -> Any:
    """Import a command and return it as click has it, its examples below its help."""
    module, _, attribute = COMMANDS[name].function.partition(":")
    function = getattr(import_module(f"harness.commands.{module}"), attribute)
    # Paragraphs wrap at any width.
    paragraphs = [" ".join(part.split()) for part in (getdoc(function) or "").split("\n\n")]
    lines = [f"{PROGRAM} {line}" for line in EXAMPLES.get(name, ())]
    alone = typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich"
    )
    alone.command(
        name,
        help="\n\n".join(paragraphs),
        epilog="\n\n".join(["Examples:", *lines]) if lines else None,
    )(function)
    return typer.main.get_command(alone)


class CommandGroup(typer.core.TyperGroup):
    """The group of all commands: each is imported when it is called, not when it is listed."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = {
            name: typer.core.TyperCommand(name, help=entry.summary, rich_help_panel=entry.panel)
            for name, entry in COMMANDS.items()
        }

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return what `args` call, imported."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, load(name) if name and command else command, rest
