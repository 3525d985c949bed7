"""Outputs of all scenarios as text, and of four scenarios in all formats, equal the golden files.

Update: UPDATE_GOLDEN=1 python -m pytest tests/compare/test_golden.py, then review the difference.
"""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from tests.compare.runs import SCENARIOS

GOLDEN = Path(__file__).parent / "golden"
TEXT_FORMATS = {"table": "txt", "markdown": "md"}
JSON_FORMAT = {"json": "json"}
# A regression, no baseline, missing cases and a failure cover all parts of a format.
SCENARIOS_IN_ALL_FORMATS = ("missing-cases", "no-baseline", "now-failing", "real-regression")


@pytest.mark.parametrize("name", SCENARIOS)
def test_outputs(harness, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    scenario = SCENARIOS[name]
    scenario.make()
    in_all_formats = name in SCENARIOS_IN_ALL_FORMATS
    files = [part for form in ("junit", "html", "markdown", "json") for part in (f"--{form}", form)]
    outputs = {}
    for form, suffix in (TEXT_FORMATS | JSON_FORMAT if in_all_formats else TEXT_FORMATS).items():
        extra = (*scenario.options, *(files if in_all_formats and form == "table" else ()))
        code, out, err = harness("compare", "base", "head", "--format", form, *extra)
        assert (code, err) == (scenario.exit_code, "")
        outputs[suffix] = out
    if in_all_formats:
        outputs["xml"] = Path("junit").read_text()
        outputs["html"] = remove_plots(Path("html").read_text())
        assert Path("markdown").read_text() == outputs["md"]
        assert json.loads(Path("json").read_text()) == json.loads(outputs["json"])
    for suffix, text in outputs.items():
        check(GOLDEN / f"{name}.{suffix}", text)


def test_every_golden_file_is_used():
    files = {file.name for file in GOLDEN.iterdir()}
    suffixes = (*TEXT_FORMATS.values(), *JSON_FORMAT.values(), "xml", "html")
    for name in SCENARIOS:
        count = len(suffixes if name in SCENARIOS_IN_ALL_FORMATS else TEXT_FORMATS)
        files -= {f"{name}.{suffix}" for suffix in suffixes[:count]}
    assert files == set()


def check(file: Path, text: str) -> None:
    if os.environ.get("UPDATE_GOLDEN"):
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    if file.suffix == ".json":
        assert parse_rounded(text) == parse_rounded(file.read_text()), file.name
    else:
        assert text == file.read_text(), file.name


def parse_rounded(text: str) -> Any:
    """Round numbers, because versions of SciPy sum in different orders."""
    return json.loads(text, parse_float=lambda digits: f"{float(digits):.6g}")


def remove_plots(page: str) -> str:
    """Remove plots, which depend on the version of Matplotlib, and the style sheet."""
    page = re.sub(r"<style>.*?</style>", "<style/>", page, flags=re.DOTALL)
    return re.sub(r"<svg.*?</svg>", "<svg/>", page, flags=re.DOTALL)
