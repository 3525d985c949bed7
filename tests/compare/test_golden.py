"""What every scenario prints, and four write in every form, is what was looked at and committed.

After a wanted change: UPDATE_GOLDEN=1 python -m pytest tests/compare/test_golden.py, then look.
"""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from tests.compare.runs import SCENARIOS

GOLDEN = Path(__file__).parent / "golden"
PRINTED = {"table": "txt", "markdown": "md"}
WRITTEN = {"json": "json"}
# One regresses, one has no baseline, one has cases missing, one fails: all that a form may say.
EVERY_FORM = ("missing-cases", "no-baseline", "now-failing", "real-regression")


@pytest.mark.parametrize("name", SCENARIOS)
def test_outputs(harness, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    scenario = SCENARIOS[name]
    scenario.make()
    whole = name in EVERY_FORM
    files = ("--junit", "junit.xml", "--html", "page.html")
    outputs = {}
    for form, suffix in (PRINTED | WRITTEN if whole else PRINTED).items():
        extra = files if whole and form == "table" else ()
        code, out, err = harness(
            "compare", "base", "head", "--format", form, *extra, *scenario.options
        )
        assert code == scenario.exit_code
        assert err == ""
        outputs[suffix] = out
    if whole:
        outputs["xml"] = Path("junit.xml").read_text()
        outputs["html"] = without_plots(Path("page.html").read_text())
    for suffix, text in outputs.items():
        check(GOLDEN / f"{name}.{suffix}", text)


def test_no_golden_file_is_left_over():
    kept = {file.name for file in GOLDEN.iterdir()}
    suffixes = (*PRINTED.values(), *WRITTEN.values(), "xml", "html")
    for name in SCENARIOS:
        kept -= {f"{name}.{suffix}" for suffix in suffixes[: None if name in EVERY_FORM else 2]}
    assert kept == set()


def check(file: Path, text: str) -> None:
    if os.environ.get("UPDATE_GOLDEN"):
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    if file.suffix == ".json":
        assert rounded(json.loads(text)) == rounded(json.loads(file.read_text())), file.name
    else:
        assert text == file.read_text(), file.name


def rounded(value: Any) -> Any:
    """Round so that another version of SciPy may sum in another order."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return value


def without_plots(page: str) -> str:
    """Leave out what Matplotlib drew, which differs with its version, and the style.

    A browser opens the page in test_browser.py.
    """
    page = re.sub(r"<style>.*?</style>", "<style/>", page, flags=re.DOTALL)
    return re.sub(r"<svg.*?</svg>", "<svg/>", page, flags=re.DOTALL)
