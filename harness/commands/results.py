"""Where a command's results go, and how a command ends that measures."""

from __future__ import annotations

import os
import time
from pathlib import Path

import typer
from rich.console import Console

from harness.errors import INTERRUPTED, Inconclusive, NothingMeasured, UsageError
from harness.measuring.run import RunResult
from harness.stored.folder import file_stem
from scenes.spec import label


def folder_for(scene: str, out: Path | None, resume: Path | None, before: str = "") -> Path:
    """Return the folder that --out or --resume names, or else a new one.

    before : what the new one's name begins with; the scene's follows

    Raises
    ------
    UsageError
        if both are given
    """
    if out and resume:
        raise UsageError("--out and --resume name two folders; --resume writes to its own")
    return resume or out or default_folder(scene, before)


def default_folder(scene: str, before: str = "") -> Path:
    """Return a new folder under results/ for a run of `scene`; see `folder_for`."""
    name = before + file_stem(Path(label(scene)).stem)
    first = Path("results") / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder, number = first, 2
    while folder.exists():  # two short runs may begin within a second
        folder, number = first.with_name(f"{first.name}-{number}"), number + 1
    return folder


def require_finished(outcome: RunResult, console: Console, how: str) -> None:
    """Raise `NothingMeasured` if no case was measured.

    If the run was stopped, say how to go on instead, and end the process with `INTERRUPTED`.
    """
    if outcome.interrupted:
        console.print(f"stopped early; {how}", markup=False, soft_wrap=True)
        raise typer.Exit(INTERRUPTED)
    if not any(record["status"] == "ok" for record in outcome.records):
        where = os.path.relpath(outcome.path)
        raise NothingMeasured(
            f"nothing was measured: every case was skipped or failed (reasons: {where}/cases.jsonl)"
        )


def require_all(outcome: RunResult) -> None:
    """Raise `Inconclusive` if a case failed; what is skipped for a stated reason is no failure."""
    failed = [record for record in outcome.records if record["status"] == "failed"]
    if failed:
        named = ", ".join(dict.fromkeys(str(record["triangulator"]) for record in failed))
        raise Inconclusive(
            f"{len(failed)} of {len(outcome.records)} cases failed ({named}); what was measured is "
            f"in {os.path.relpath(outcome.path)}"
        )
