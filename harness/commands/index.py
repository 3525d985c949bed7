"""Commands by name, in the order of `--help`, frequent commands first."""

from inspect import getdoc
from math import isfinite
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple, cast

import typer

PROGRAM = "raster-harness"
RUN = "results/city-20260101-120000"
LATER = "results/city-20260102-120000"


class Entry(NamedTuple):
    """Description of a command for `load_command` and for the documents."""

    panel: str  # heading of `--help` that lists the command
    function: str  # "module:function" in `harness.commands`
    examples: tuple[str, ...]  # shown by the command's `--help`; a test runs each example


MEASURE, COMPARE, STUDY = "Measure", "Compare", "Study"
GEOMETRY, MACHINE = "Geometry", "Machine"

COMMANDS = {
    "run": Entry(
        MEASURE,
        "run:run",
        (
            "run --scene city",
            "run --scene buildings.geojson --triangulators delaunay,optimal:half-perimeter",
            "run --scene city:buildings=50 --resolution 256,512 --rotation 0,30 --quick",
        ),
    ),
    "report": Entry(
        MEASURE,
        "report:report",
        (f"report {RUN}", f"report {RUN} --out city.html", f"report {RUN} --out city.tex"),
    ),
    "profile": Entry(MEASURE, "profile:profile", ("profile --budget 0.05",)),
    "page": Entry(
        MEASURE,
        "page:page",
        (f"page {RUN} --out city.html", "page --profile --out triangle.html"),
    ),
    "import": Entry(
        MEASURE, "import_:import_", ("import saved-by-the-page.json --out results/phone",)
    ),
    "merge": Entry(
        MEASURE,
        "merge:merge",
        (f"merge {RUN} {LATER} --hosts first,second --out results/merged",),
    ),
    "compare": Entry(
        COMPARE,
        "compare:compare",
        (
            f"compare {RUN} {LATER}",
            f"compare {RUN} {LATER} --gate counters --html comparison.html",
        ),
    ),
    "history": Entry(COMPARE, "history:history", ("history results",)),
    "study validate": Entry(
        STUDY, "study_validate:study_validate", ("study validate --scene city --quick",)
    ),
    "study gains": Entry(
        STUDY, "study_gains:study_gains", (f"study gains {RUN} --out results/gains",)
    ),
    "study pareto": Entry(
        STUDY,
        "study_pareto:study_pareto",
        ("study pareto --scene paper", "study pareto --scene city --polygons 4 --budget 0.2"),
    ),
    "study all": Entry(
        STUDY, "study_all:study_all", ("study all buildings.geojson --out results/study --quick",)
    ),
    "census": Entry(
        STUDY,
        "census:census",
        (
            "census buildings.geojson --out results/census",
            "census berlin.pmtiles:zoom=14 --out results/map",
        ),
    ),
    "triangulate": Entry(
        GEOMETRY,
        "triangulate:triangulate",
        (
            "triangulate buildings.geojson --criterion overdraw -o buildings.glb",
            "triangulate paper -o paper.glb --certify --evidence proofs.jsonl",
        ),
    ),
    "check-evidence": Entry(
        GEOMETRY, "check_evidence:check_evidence", ("check-evidence proofs.jsonl",)
    ),
    "inspect": Entry(
        GEOMETRY,
        "inspect:inspect",
        (
            "inspect city --polygon 3 --out polygon-3.png",
            "inspect buildings.geojson --sizes 16-1024",
            "inspect paper --every paper",
        ),
    ),
    "list": Entry(MACHINE, "list_:list_", ("list", "list triangulators")),
    "doctor": Entry(MACHINE, "doctor:doctor", ("doctor",)),
    "cache": Entry(MACHINE, "cache:cache", ("cache info",)),
}

GROUPS = {"study": "Study criteria and choices: validate, gains and pareto, or all on your data."}
"""Help of command groups; names of their commands in `COMMANDS` begin with the group's name."""


def load_command(name: str) -> Any:
    """Import a command and return it as a click command, with its examples below its help."""
    if name in GROUPS:
        settings: Any = {"name": name, "help": GROUPS[name], "rich_help_panel": STUDY}
        return CommandGroup(before=f"{name} ", no_args_is_help=True, **settings)
    entry = COMMANDS[name]
    function = resolve_name(f"harness.commands.{entry.function}")
    # Unwrap paragraphs, which click wraps at the terminal's width.
    paragraphs = [" ".join(part.split()) for part in (getdoc(function) or "").split("\n\n")]
    # No Rich markup: its table of options would cut long defaults.
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(
        name.rpartition(" ")[2],
        cls=CheckedCommand,
        help="\n\n".join(paragraphs),
        epilog="\n\n".join(["Examples:", *(f"{PROGRAM} {line}" for line in entry.examples)]),
        rich_help_panel=entry.panel,
    )(function)
    return typer.main.get_command(app)


class CheckedCommand(typer.core.TyperCommand):
    """A command that rejects empty texts, NUL bytes and numbers that are not finite."""

    def invoke(self, ctx: Any) -> Any:
        """Check the values on the command line, and call the function."""
        for parameter in self.params:
            source = ctx.get_parameter_source(parameter.name)
            value = ctx.params.get(parameter.name)
            if getattr(source, "name", "") == "COMMANDLINE" and (wrong := _find_problem(value)):
                raise typer.BadParameter(wrong, ctx=ctx, param=cast("Any", parameter))
        return super().invoke(ctx)


def _find_problem(value: Any) -> str:
    if isinstance(value, list):
        return next(filter(None, map(_find_problem, value)), "")
    if isinstance(value, float) and not isfinite(value):
        return f"{value} is not a finite number"
    # Path("") is ".", which the user hardly meant.
    if isinstance(value, str | Path) and (value == Path() or not str(value).strip()):
        return "is empty"
    return "contains a NUL byte" if "\0" in str(value) else ""


class CommandGroup(typer.core.TyperGroup):
    """A group of commands, imported when called or listed; `before` is their names' prefix."""

    def __init__(self, before: str = "", **settings: Any) -> None:
        super().__init__(**settings)
        self._before = before
        names = (name.removeprefix(before) for name in COMMANDS if name.startswith(before))
        self.commands = dict.fromkeys((name.partition(" ")[0] for name in names), cast("Any", None))

    def get_command(self, _ctx: Any, cmd_name: str) -> Any:
        """Import a command; return None if the name is unknown."""
        return load_command(self._before + cmd_name) if cmd_name in self.commands else None
