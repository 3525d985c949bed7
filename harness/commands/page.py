"""`harness page`: a page that measures in a browser."""

import os
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from harness import atomic
from harness.errors import UsageError
from harness.progress import Reporter
from harness.settings import TIMEOUT_S


def page(
    run: Annotated[
        Path | None, typer.Argument(help="Folder of a run; leave out with --profile.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write.")] = Path("page.html"),
    profile: Annotated[
        bool,
        typer.Option("--profile", help="Without a run: a page that measures a triangle's costs."),
    ] = False,
) -> None:
    """Write a page that measures a run's triangulations in any browser that has WebGPU.

    With --profile, no run is needed: the page measures the costs of a triangle, a pixel and a
    helper lane on the device that opens the page, as the command profile does. The page is one
    file, needs no network and sends no data. Open it on a phone, a Mac or a Windows machine; it
    counts, times and saves a file for `raster-harness import`.
    """
    from harness.measuring.pool import MeasuringPool
    from harness.page.page_data import (
        PageContent,
        ProfileContent,
        make_page_content,
        make_profile_content,
        write_page,
    )
    from harness.results.run_folder import read_latest
    from harness.worker import Worker

    if profile == (run is not None):
        raise UsageError("give either RUN, the folder of a run, or --profile")
    content: PageContent | ProfileContent
    if run is None:
        with closing(MeasuringPool(Worker, timeout_s=TIMEOUT_S)) as pool:
            content = make_profile_content(pool)
    else:
        content = make_page_content(read_latest(run, Reporter().warn))
    write_page(content, out)
    message = f"page: {os.path.relpath(out)}; open it in a browser with WebGPU"
    typer.echo(message, err=atomic.is_stream(out))
