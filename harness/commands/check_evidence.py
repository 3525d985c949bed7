"""`harness check-evidence`: check optimality proofs of triangulations."""

from pathlib import Path
from typing import Annotated

import typer

from harness.errors import InconclusiveError, InputError


def check_evidence(
    file: Annotated[Path, typer.Argument(help="Proofs by triangulate --certify --evidence FILE.")],
) -> None:
    """Check optimality proofs of triangulations in integer arithmetic; refuse invalid proofs.

    Prints a line for each polygon of FILE, and exits with 5 if a proof is refused. The program,
    harness/export/check_evidence.py, needs only Python and no other file of this project. It lists
    all triangles without a vertex inside: 60 vertices take seconds, 300 vertices take hours.
    """
    from harness.export.check_evidence import check_lines

    refused = checked = 0
    with file.open("rb") as lines:
        for label, verdict, holds in check_lines(lines):
            typer.echo(f"{label}: {verdict}")
            checked += 1
            refused += not holds
    if not checked:
        raise InputError(f"{file} has no proof: triangulate --certify --evidence writes proofs")
    if refused:
        raise InconclusiveError(f"{file}: {refused} of {checked} proofs are refused; see above")
