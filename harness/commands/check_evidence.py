"""`harness check-evidence`: check the optimality proofs that `triangulate` wrote."""

from pathlib import Path
from typing import Annotated

import typer

from harness.errors import InconclusiveError, InputError


def check_evidence(
    file: Annotated[Path, typer.Argument(help="What triangulate --certify --evidence FILE wrote.")],
) -> None:
    """Check proofs that triangulations are optimal, in whole numbers; refuse what does not hold.

    It prints a line for each polygon of FILE, and exits with 5 if a proof is refused. The program
    behind it, harness/export/check_evidence.py, needs Python alone and no other file of ours. It
    lists all empty triangles: a polygon of 60 vertices takes seconds, one of 300 hours.
    """
    from harness.export.check_evidence import judge

    refused = checked = 0
    with file.open("rb") as lines:
        for label, verdict, holds in judge(lines):
            typer.echo(f"{label}: {verdict}")
            checked += 1
            refused += not holds
    if not checked:
        raise InputError(f"{file} has no evidence: triangulate --certify --evidence writes it")
    if refused:
        raise InconclusiveError(f"{file}: {refused} of {checked} proofs refused, see above")
