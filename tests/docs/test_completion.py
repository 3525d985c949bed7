"""Shell completion and --version, as the installed program gives them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.paths import ROOT

PROGRAM = "import sys; sys.argv[0] = 'raster-harness'; from harness.cli import main; main()"


def complete(words: str) -> list[str]:
    """Return what bash would offer after `words`."""
    environment = {
        **os.environ,
        "_RASTER_HARNESS_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("raster-harness re", "report"),
        ("raster-harness run --reso", "--resolution"),
        ("raster-harness run --fit ", "circle"),
    ],
)
def test_the_shell_is_told_how_a_word_goes_on(words, expected):
    assert expected in complete(words)


def test_version_names_the_drivers():
    done = subprocess.run(
        [sys.executable, "-m", "harness", "--version"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    first, *rest = done.stdout.splitlines()
    assert first.startswith("raster-harness ")
    assert any("Mesa" in line or "NVIDIA" in line for line in rest)
