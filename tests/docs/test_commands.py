"""The commands in README and docs succeed, run in the order of each page."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from harness.commands.index import COMMANDS, LATER, PROGRAM, RUN, load_command
from harness.errors import BAD_INPUT, GOOD, INCONCLUSIVE, REGRESSION
from harness.results.run_folder import read_run
from tests.docs.blocks import blocks, pages
from tests.docs.conftest import FULL, Reader
from tests.page.conftest import make_result, write_saved
from tests.paths import ROOT, run_python

FOLLOWED = [page for page in pages() if any(block.language == "sh" for block in blocks(page))]
COUNTERS = "--gate counters"
LONG = (
    *("study all", "study validate", "study pareto", "profile", "page --profile", "doctor"),
    *("list scenes", "run --scene city", "inspect city"),
)


@pytest.mark.parametrize("page", FOLLOWED, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_can_be_followed(page: Path, reader: Reader):
    for block in blocks(page):
        reader.follow(block)


def test_commands_are_only_in_sh_blocks_and_not_run_for_a_reason():
    for page in pages():
        for block in blocks(page):
            if block.kind in ("slow", "not run"):
                assert len(block.note.split()) > 3, (page, block.content)
            if block.language != "sh":
                assert "-m harness" not in block.content, (page, block.language)


def test_each_command_has_an_example():
    for name in COMMANDS:
        assert f"{PROGRAM} {name}" in load_command(name).epilog


def test_the_examples_of_the_help_work(reader: Reader):
    for folder in (RUN, LATER):
        prepare = f"run --scene buildings.geojson --quick --out {folder}"
        assert reader.run(f".venv/bin/python -m harness {prepare}") == 0
        file = reader.folder / folder / "run.json"
        facts = json.loads(file.read_text())
        facts["state"] |= {"state": "quiet", "why": []}  # also if other programs disturb the run
        file.write_text(json.dumps(facts))
    result = make_result(read_run(reader.folder / RUN))
    write_saved(result, reader.folder / "saved-by-the-page.json")
    for line in (line for entry in COMMANDS.values() for line in entry.examples):
        if not FULL and line.startswith(LONG):
            continue
        quick = " --quick" if line.startswith("run") and not FULL and "--quick" not in line else ""
        # On a busy machine the times of two short runs may differ or be inconclusive.
        compares_times = line.startswith("compare") and COUNTERS not in line
        allowed = (GOOD, REGRESSION, INCONCLUSIVE) if compares_times else (GOOD,)
        assert reader.run(f".venv/bin/python -m harness {line}{quick}") in allowed, line


STARTED = "import sys; sys.argv[0] = 'raster-harness'; from harness.cli import main; main()"


def complete(words: str) -> list[str]:
    """Return the completions that bash offers after `words`."""
    environment = {
        "_RASTER_HARNESS_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    return run_python("-c", STARTED, env=environment).stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("raster-harness re", "report"),
        ("raster-harness run --reso", "--resolution"),
        ("raster-harness run --fit ", "circle"),
    ],
)
def test_the_shell_completes_words(words, expected):
    assert expected in complete(words)


def test_completion_is_printed_and_refused_for_an_unknown_shell():
    named = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    shown = run_python("-c", STARTED, "--show-completion", "bash", env=named)
    assert (shown.returncode, shown.stderr) == (GOOD, "")
    assert "complete -o default" in shown.stdout
    # Without exec, so that sh is the parent process.
    command = ["sh", "-c", '"$0" -c "$1" --show-completion; exit $?', sys.executable, STARTED]
    refused = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (refused.returncode, refused.stderr) == (BAD_INPUT, "Shell sh not supported.\n")


def test_version_names_the_drivers():
    first, *rest = run_python("-m", "harness", "--version", check=True).stdout.splitlines()
    assert first.startswith("raster-harness ")
    assert any("Mesa" in line or "NVIDIA" in line for line in rest)
