"""How an extra is added to what is installed: a name on an index may be somebody else's."""

from __future__ import annotations

import json
import sys
from importlib import metadata
from pathlib import Path

import pytest

from scenes import spec
from tests.paths import ROOT


class Installed:
    def __init__(self, about: object) -> None:
        self._about = about

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self._about is None else json.dumps(self._about)


@pytest.mark.parametrize(
    ("about", "wanted"),
    [
        ({"url": ROOT.as_uri(), "dir_info": {"editable": True}}, '-e ".[tiles]"'),
        ({"url": "file:///src/a%20b", "dir_info": {"editable": True}}, '-e "/src/a b[tiles]"'),
        ({"url": "file:///src/harness", "dir_info": {}}, '"/src/harness[tiles]"'),
        (
            {"url": "https://host/us.git", "vcs_info": {"vcs": "git", "commit_id": "1a2b"}},
            '"raster-harness[tiles] @ git+https://host/us.git@1a2b"',
        ),
        (
            {"url": "file:///us-1-any.whl", "archive_info": {}},
            '"raster-harness[tiles] @ file:///us-1-any.whl"',
        ),
        (None, '"raster-harness[tiles]"'),
    ],
)
def test_the_command_is_that_of_how_it_was_installed(monkeypatch, about, wanted):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "executable", str(ROOT / ".venv/bin/python"))
    # the egg-info that building leaves in a checkout says nothing, and may be found first
    found = [Installed(None), Installed(about)]
    monkeypatch.setattr(metadata, "distributions", lambda name: found)
    assert spec.install("tiles") == f".venv/bin/python -m pip install {wanted}"


def test_a_checkout_that_is_not_installed_is_named(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(metadata, "distributions", lambda name: [])
    checkout = Path(spec.__file__).parents[1]
    assert spec.install("ply") == f'{sys.executable} -m pip install -e "{checkout}[ply]"'
