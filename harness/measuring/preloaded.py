"""What the server of workers loads before it forks any; imported elsewhere, it loads nothing."""

from __future__ import annotations

import gc
import os
import warnings
from contextlib import suppress

from harness.machine import system
from harness.measuring import tasks  # noqa: F401 - for the workers
from harness.measuring.server import MARK
from harness.settings import DEFAULT_TRIANGULATORS
from harness.triangulating.frames import warm_up
from harness.triangulating.recipes import parse
from triangulators.batch import triangulate_many  # noqa: F401 - for the workers
from triangulators.compute.storing import NotKept, only_kept


def _load() -> None:
    """Load what the usual triangulators have compiled; on a new machine there is none yet."""
    with suppress(NotKept), only_kept():
        for name in DEFAULT_TRIANGULATORS:
            warm_up(parse(name))


if os.environ.pop(MARK, None):
    # In a group of its own: what a terminal sends to the command is not meant for the server,
    # which ends when the command does.
    system.lead_group()
    # What a task starts in a session of its own comes to the server when its worker ends.
    system.adopt()
    warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
    _load()
    # Workers collect only what they make: walking over what they share would copy its pages.
    gc.freeze()
