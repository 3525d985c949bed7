"""Every option of every command with invalid values: one error line and a documented exit code."""

from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from harness.commands.index import COMMANDS, load_command
from tests.endurance.programs import run
from tests.fuzz.target import target
from tests.fuzz.targets import runs
from tests.fuzz.targets.runs import SilentError, call_command, enter_workspace

VALUES = (
    *("", " ", "-1", "0", "nan", "inf", "-inf", "1e999", "1e300", "99999999999999999999"),
    *("x", "a,b", ",", "0x10", "1,,2", "../../up", "/dev/null/x", "\u2028", "[", "--help-me"),
)
"""Twenty values that most options must refuse; a value that an option accepts has to work."""

MINIMAL_ARGUMENTS: dict[str, tuple[str, ...]] = {
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
"""Minimal arguments of each command."""

SKIPPED = {("run", "--dask"), ("triangulate", "--dask"), ("census", "--dask")}
"""Options that wait for another program; tests/scaling tests them."""

FLAGS = ("--help", "--install-completion", "--show-completion")


@cache
def list_options() -> list[tuple[str, str]]:
    pairs = []
    for name in COMMANDS:
        for parameter in load_command(name).params:
            if parameter.param_type_name == "argument" or not getattr(parameter, "is_flag", False):
                flag = next((text for text in parameter.opts if text.startswith("--")), "")
                pairs.append((name, flag or parameter.name))
    return [pair for pair in pairs if pair not in SKIPPED and pair[1] not in FLAGS]


def list_bad_values() -> list[dict[str, str]]:
    pairs = product(list_options(), VALUES)
    return [{"command": name, "option": option, "value": text} for (name, option), text in pairs]


def run_program(*arguments: str) -> tuple[int, str]:
    result = run(list(arguments), Path())
    if result.silent_s >= runs.SILENT_S:
        raise SilentError(f"no output for {result.silent_s:.0f} s: {arguments}")
    return result.code, result.output


@target(
    "options",
    st.tuples(st.sampled_from(range(10**6)), st.sampled_from(VALUES) | st.text(max_size=8)).map(
        lambda draw: {"position": draw[0], "value": draw[1].replace("\0", "")}
    ),
)
def check_option(value: dict[str, Any]) -> str:
    """Add an option to a command and check the exit code, the message and the output.

    Workers in this process cannot report progress, so a command that is silent in this process is
    tried again in a new process.
    """
    try:
        return _check(value)
    except SilentError:
        if "started" in value:
            raise
        return _check(value | {"started": True})


def _check(value: dict[str, Any]) -> str:
    pairs = list_options()
    name, option = value.get("command"), value.get("option")
    if option is None:
        name, option = pairs[value["position"] % len(pairs)]
    with enter_workspace():
        before = sorted(map(str, Path().rglob("*")))
        arguments = list(MINIMAL_ARGUMENTS[name])
        if option.startswith("--"):
            arguments += [option, value["value"]]
        elif arguments and not arguments[0].startswith("--"):
            arguments[0] = value["value"]
        else:
            arguments.insert(0, value["value"])
        code, err = (run_program if "started" in value else call_command)(*name.split(), *arguments)
        assert code in (0, 1, 2, 3, 4, 5), (code, arguments, err)
        assert "Traceback" not in err, err
        if code == 2:
            errors = [line for line in err.splitlines() if line.startswith("error: ")]
            assert len(errors) == 1, err
            if "Invalid value" in errors[0]:
                assert sorted(map(str, Path().rglob("*"))) == before, "files written"
    return f"{name} {option}: exit {code}"
