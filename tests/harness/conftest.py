"""The command line as a fixture."""

from __future__ import annotations

import sys

import pytest

from harness.cli import main


@pytest.fixture
def harness(monkeypatch, capsys, tmp_path):
    """Run the command line in this process, in an empty folder; returns (exit code, out, err)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["harness", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return int(end.value.code or 0), captured.out, captured.err

    return call
