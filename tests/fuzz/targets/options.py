"""Every option of every command with values that cannot be meant: one line, and an exit code."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from harness.commands.index import COMMANDS, load
from tests.endurance.programs import run
from tests.fuzz.target import target
from tests.fuzz.targets import runs
from tests.fuzz.targets.runs import SilentError, beside_a_run, command

VALUES = (
    *("", " ", "-1", "0", "nan", "inf", "-inf", "1e999", "1e300", "99999999999999999999"),
    *("x", "a,b", ",", "0x10", "1,,2", "../../up", "/dev/null/x", "\u2028", "[", "--help-me"),
)
"""Twenty that are bad for most options. What an option takes all the same has to work."""

LEAST: dict[str, tuple[str, ...]] = {
    "run": ("--scene", "block.geojson", "--rasterisers", "reference", "--quick"),
    "study validate": ("--scene", "block.geojson", "--rasterisers", "reference", "--quick"),
    "study pareto": ("--scene", "block.geojson", "--rasterisers", "reference"),
    "profile": ("--rasteriser", "none"),
    "compare": ("RUN", "RUN"),
    "history": ("RUN",),
    "report": ("RUN",),
    "inspect": ("block.geojson",),
    "check-evidence": ("block.geojson",),
    "triangulate": ("block.geojson", "-o", "out.obj"),
    "study gains": ("RUN", "--out", "gains"),
    "study all": ("none.geojson", "--out", "study", "--quick"),
    "page": ("RUN",),
    "import": ("RUN", "--summary", "summary.json"),
    "census": ("block.geojson", "--out", "census"),
    "merge": ("RUN", "--out", "merged"),
    "doctor": (),
    "list": (),
    "cache": ("info",),
}
"""What each command needs, as small as can be."""

SKIPPED = {("run", "--dask"), ("triangulate", "--dask"), ("census", "--dask")}
"""Those that wait for another program, which tests/scaling looks at."""

FLAGS = ("--help", "--install-completion", "--show-completion")


@cache
def options() -> tuple[tuple[str, str], ...]:
    """Return every command with every option of it that takes a value."""
    found = []
    for name in COMMANDS:
        for parameter in load(name).params:
            if parameter.param_type_name == "argument" or not getattr(parameter, "is_flag", False):
                place = next((text for text in parameter.opts if text.startswith("--")), "")
                found.append((name, place or parameter.name))
    return tuple(each for each in found if each not in SKIPPED and each[1] not in FLAGS)


def every() -> Iterator[dict[str, str]]:
    """Yield each option with each bad value."""
    for name, option in options():
        for value in VALUES:
            yield {"command": name, "option": option, "value": value}


def start(*arguments: str) -> tuple[int, str]:
    """Start the program as a user does; returns its exit code and what it says."""
    ended = run(list(arguments), Path())
    if ended.silent_s >= runs.SILENT_S:
        raise SilentError(f"said nothing for {ended.silent_s:.0f} s: {arguments}")
    return ended.code, ended.said


@target(
    "options",
    st.tuples(st.sampled_from(range(10**6)), st.sampled_from(VALUES) | st.text(max_size=8)).map(
        lambda drawn: {"place": drawn[0], "value": drawn[1].replace("\0", "")}
    ),
)
def check_option(value: dict[str, Any]) -> str:
    """Give a command one option more; whatever it makes of it, it says.

    Where workers run in this very process, they cannot say how far they are. So a command that is
    silent here is started as a user does.
    """
    try:
        return _checked(value)
    except SilentError:
        if "started" in value:
            raise
        return _checked(value | {"started": True})


def _checked(value: dict[str, Any]) -> str:
    known = options()
    name, option = (
        (value["command"], value["option"])
        if "option" in value
        else known[value["place"] % len(known)]
    )
    with beside_a_run():
        before = sorted(map(str, Path().rglob("*")))
        given = list(LEAST[name])
        if option.startswith("--"):
            given += [option, value["value"]]
        elif given and not given[0].startswith("--"):
            given[0] = value["value"]
        else:
            given.insert(0, value["value"])
        code, err = (start if "started" in value else command)(*name.split(), *given)
        assert code in (0, 1, 2, 3, 4, 5), (code, given, err)
        assert "Traceback" not in err, err
        if code == 2:
            errors = [line for line in err.splitlines() if line.startswith("error: ")]
            assert len(errors) == 1, err
            if "Invalid value" in errors[0]:
                assert sorted(map(str, Path().rglob("*"))) == before, "made before it was refused"
    return f"{name} {option}: exit {code}"
