"""Imports and compiled code that the fork server loads once for all workers."""

import gc
import os
import signal
import warnings
from contextlib import suppress

from harness.machine import system
from harness.serving import MARK


def preload() -> None:
    """Load the modules and compiled code of workers; runs in the fork server."""
    # In a separate process group the server does not get the terminal's signals; it ends with the
    # command, which gets them.
    system.start_process_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Processes that a task starts in a new session become the server's children when the worker
    # ends.
    system.become_subreaper()
    warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
    from harness.measuring import tasks  # noqa: F401 - for the workers
    from harness.settings import DEFAULT_TRIANGULATORS
    from harness.triangulating.recipes import parse
    from harness.triangulating.triangulate import warm_up
    from triangulators import many  # noqa: F401 - for the workers
    from triangulators.compute.storing import NotCompiledError, forbid_compiling

    with suppress(NotCompiledError), forbid_compiling():  # on a new machine nothing is compiled yet
        for name in DEFAULT_TRIANGULATORS:
            warm_up(parse(name))
    # Exclude shared objects from the workers' garbage collection, which would copy their pages.
    gc.freeze()


if os.environ.pop(MARK, None):
    preload()
