"""The process that workers are forked from: it has imported everything once, and loads no driver.

A worker that starts from nothing takes two seconds for imports and compiled code; one that is
forked has both. Python's forkserver makes the server, which ends with the process that started it.
Where there is no safe fork (macOS, Windows) workers start from nothing.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path

MARK = "RASTER_HARNESS_SERVER"
"""Set in the environment of the server, so that `preloaded` knows where it is imported."""

PRELOADED = "harness.measuring.preloaded"

SOURCES = str(Path(__file__).resolve().parents[2])


def wake() -> None:
    """Let the server go on if something has stopped it; nothing could be started or ended else."""
    server = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGCONT)


def start() -> ForkServerContext | SpawnContext:
    """Start the server, if none runs, without waiting for it; return what makes processes."""
    if sys.platform != "linux" or not hasattr(os, "fork"):
        return multiprocessing.get_context("spawn")
    paths = (SOURCES, os.environ.get("PYTHONPATH", ""))
    own = {
        MARK: "1",
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "PYTHONSAFEPATH": "1",  # what lies in the current folder is not the server's
        # Libraries would start threads as they load, which a fork does not take along.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    before = {name: os.environ.get(name) for name in own}
    os.environ.update(own)
    try:
        multiprocessing.set_forkserver_preload([PRELOADED])
        wake()
        forkserver.ensure_running()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return multiprocessing.get_context("forkserver")
