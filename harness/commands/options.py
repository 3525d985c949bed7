"""Options that several commands share: type, help, and validation before any slow import."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.errors import UsageError
from harness.settings import MAX_LOOKUPS, MAX_S, MAX_SEED, MAX_WORK, ORDERS, RESOLUTIONS, SAMPLES

PROFILES = Path("results") / "profiles"  # default folder of `profile`

MIN_S = 1e-9

Read = Callable[[str], Any]


class ValueList(tuple[Any, ...]):
    """Comma-separated values of an option."""

    def __str__(self) -> str:
        return ",".join(f"{value:g}" if isinstance(value, float) else str(value) for value in self)


def make_list_parser(read: Read = str) -> Callable[[Any], ValueList]:
    """Return a parser of comma-separated values, each parsed by `read`."""

    def parse(value: Any) -> ValueList:
        if isinstance(value, ValueList):  # a default
            return value
        # Keep commas within a name's parameters (`name:a=1,b=2`).
        parts = [part.strip() for part in re.split(r",(?![a-z_]+=)", value) if part.strip()]
        if not parts:
            raise typer.BadParameter("give one or more values, comma-separated")
        return ValueList(map(read, parts))

    return parse


def make_number_parser(
    kind: type[int] | type[float], low: float, high: float, unit: str = ""
) -> Read:
    """Return a parser of numbers from `low` to `high`."""

    def read(text: str) -> int | float:
        try:
            value = kind(text)
        except ValueError:
            value = kind(low) - 1  # refused below
        if not low <= value <= high:
            noun = "a whole number" if kind is int else "a number"
            raise typer.BadParameter(f"{text!r} is not {noun} from {low:g} to {high:g}{unit}")
        return value

    return read


def make_choice_parser(*choices: Any) -> Read:
    """Return a parser of one of the `choices`."""

    def read(text: str) -> Any:
        for value in choices:
            if str(value) == text:
                return value
        raise typer.BadParameter(
            f"{text!r} is unknown (choose from {', '.join(map(str, choices))})"
        )

    return read


SceneName = Annotated[str, typer.Option(help="A scene's name or a file.")]
Seed = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of all random numbers.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", "-v", help="Also show each step's duration, and each case's result or failure."
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Resume even if the plan, scene, code or machine differs.")
]
Resume = Annotated[
    Path | None,
    typer.Option(help="Continue the run in this folder; failed cases are measured again."),
]
StudyFolder = Annotated[
    Path | None,
    typer.Option(help="Folder for the study; results/<study>-<scene>-<time> if absent."),
]
Quick = Annotated[
    bool,
    typer.Option(
        "--quick",
        help="For a first look: measure with low precision and, in a study, few polygons.",
    ),
]
Base = Annotated[
    str | None,
    typer.Option(
        help="Triangulator to compare the others with; by default ear-clipping, or original for a "
        "model's views; if that was not measured, the triangulator that drew the most polygons.",
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Write JSON to standard output, for other programs.")
]
Layer = Annotated[str | None, typer.Option(help="Layer to read, if the file has several.")]
Condition = Annotated[
    str | None,
    typer.Option("--where", help="Condition on the polygons to read, as in SQL: height > 10."),
]
Limit = Annotated[int | None, typer.Option(min=1, help="Maximum number of polygons to read.")]
Dask = Annotated[
    str | None,
    typer.Option(
        help="Distribute the work: local for a process on each core, local:N for N processes, or "
        "the address of a Dask scheduler.",
    ),
]


def _make_list_option(metavar: str, read: Read, text: str) -> Any:
    return typer.Option(
        parser=make_list_parser(read), metavar=metavar, help=f"{text}; comma-separated."
    )


_SIZE = make_number_parser(int, *RESOLUTIONS, " pixels")
_DEGREES = make_number_parser(float, -1e6, 1e6, " degrees")
Triangulators = Annotated[
    ValueList,
    _make_list_option("NAME,...", str, "Triangulators, see: raster-harness list triangulators"),
]
Rasterisers = Annotated[
    ValueList | None,
    _make_list_option(
        "NAME,...",
        str,
        "By default opengl, or webgpu if EGL is missing. See: raster-harness list rasterisers",
    ),
]
Devices = Annotated[
    ValueList | None, _make_list_option("NAME,...", str, "Devices; the best device by default")
]
Resolutions = Annotated[
    ValueList, _make_list_option("PX,...", _SIZE, "Width and height of the viewport")
]
Resolution = Annotated[
    int,
    typer.Option(
        min=RESOLUTIONS[0], max=RESOLUTIONS[1], help="Width and height of the viewport in pixels."
    ),
]
Rotations = Annotated[
    ValueList,
    _make_list_option(
        "DEGREES,...", _DEGREES, "Counter-clockwise rotation of the scene in degrees"
    ),
]
Rotation = Annotated[
    float,
    typer.Option(parser=_DEGREES, metavar="DEGREES", help="Counter-clockwise rotation."),
]
Samples = Annotated[
    ValueList, _make_list_option("1|4|8,...", make_choice_parser(*SAMPLES), "Samples per pixel")
]
Works = Annotated[
    ValueList,
    _make_list_option(
        "N,...", make_number_parser(int, 0, MAX_WORK), "Iterations of arithmetic per fragment"
    ),
]
Textures = Annotated[
    ValueList,
    _make_list_option(
        "N,...",
        make_number_parser(int, 0, MAX_LOOKUPS),
        "Texture lookups per fragment, opengl only",
    ),
]
Orders = Annotated[
    ValueList,
    _make_list_option(
        "ORDER,...",
        make_choice_parser(*ORDERS),
        "Orders of the triangles in a draw: native (the triangulator's), walk, vertex-cache, "
        "morton, shuffled",
    ),
]
Budget = Annotated[
    float,
    typer.Option(
        min=MIN_S,
        max=MAX_S,
        metavar="SECONDS",
        help="Seconds of drawing per case, on average.",
    ),
]
Timeout = Annotated[
    float | None,
    typer.Option(
        min=MIN_S,
        max=MAX_S,
        metavar="SECONDS",
        help="Seconds after which a triangulator or device is stopped; by default 600, or 60 with "
        "--quick.",
    ),
]
OneDevice = Annotated[
    str | None, typer.Option(help="Device that draws; the best device by default.")
]

OneRasteriser = Annotated[
    str | None,
    typer.Option(help="Rasteriser that draws; by default opengl, or webgpu without EGL."),
]

Precision = Annotated[
    float,
    typer.Option(
        min=1e-9,
        max=1.0,
        metavar="SHARE",
        help="Target half-width of the 95 % confidence interval of a time, or of a ratio of times, "
        "as a share of the value: 0.01 is 1 %.",
    ),
]


def choose_rasterisers(names: tuple[str, ...] | None, *with_opengl: str) -> tuple[str, ...]:
    """Return `names`, or the default here: opengl with `with_opengl`, or another rasteriser."""
    if names:
        return tuple(names)
    from harness.rasterisers import choose_default_rasteriser

    first = choose_default_rasteriser()
    if first != "opengl":
        typer.echo(
            f"warning: opengl: no device works here; measuring with {first} instead (see: "
            "raster-harness doctor)",
            err=True,
        )
    return (first, *with_opengl) if first == "opengl" else (first,)


def refuse_given(values: Mapping[str, object], reason: str) -> None:
    """Raise UsageError for the first option in `values` that was given: "OPTION reason"."""
    for option, value in values.items():
        if value not in (None, False):
            raise UsageError(f"{option} {reason}")


def refuse_overwriting_input(source: str, out: Path | None, option: str = "-o") -> None:
    """Raise UsageError if the output, the value of `option`, would overwrite the input."""
    from scenes.spec import parse_name

    file = Path(parse_name(source)[0])
    if out is not None and out.is_file() and file.is_file() and out.samefile(file):
        raise UsageError(f"{option} {out}: would overwrite the input; give another name")


def is_given(context: typer.Context, *names: str) -> bool:
    """Return whether the command line has any of the options."""
    sources = map(context.get_parameter_source, names)
    return any(getattr(source, "name", "") == "COMMANDLINE" for source in sources)
