"""`harness cache`: show or empty the model database of triangulations."""

from typing import Annotated

import typer

from harness.errors import UsageError
from harness.progress import Reporter


def cache(
    action: Annotated[
        str, typer.Argument(help="info: size of the database; clear: delete its content.")
    ] = "info",
) -> None:
    """Show or empty the model database of triangulations."""
    from harness.triangulating.database import ModelDatabase
    from triangulators.compute import compiled_files

    if action not in ("info", "clear"):
        raise UsageError(f"cache {action}: unknown action (choose from info, clear)")
    with ModelDatabase(warn=Reporter().warn) as database:
        if action == "clear":
            count, old = database.clear(), compiled_files.remove_old_code()
            typer.echo(f"deleted {count:,} triangulations in {database.path}")
            typer.echo(f"removed compiled code of {old:,} old modules")
            return
        kinds = database.count_entries()
    compiled = compiled_files.measure_cache()
    typer.echo(
        f"{compiled.folder}: compiled code, {compiled.file_bytes:,} bytes, "
        f"{len(compiled.old):,} old modules"
    )
    entries, file_bytes = sum(count for count, _ in kinds.values()), database.path.stat().st_size
    typer.echo(f"{database.path}: {entries:,} triangulations, {file_bytes:,} bytes")
    for name, (count, size) in kinds.items():
        typer.echo(f"  {name}: {count:,}, {size:,} bytes")
