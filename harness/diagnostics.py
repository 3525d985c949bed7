"""Diagnostics of a command and its workers: `--debug` for tracebacks, `--log FILE` for events.

Both are environment variables, so that worker processes inherit them.
"""

import logging
import os
import sys
import traceback
from pathlib import Path

DEBUG_VARIABLE = "RASTER_HARNESS_DEBUG"
"""Every error is printed with its traceback, unless the variable is empty or 0."""

LOG_VARIABLE = "RASTER_HARNESS_LOG"
"""File to which events are appended: worker starts and ends, time limits, retries, cache hits."""

PACKAGES = ("harness", "scenes", "triangulators")

LINE_FORMAT = "%(asctime)s.%(msecs)03d %(levelname)s [%(process)d] %(name)s: %(message)s"


def is_debugging() -> bool:
    """Return whether errors are printed with their traceback."""
    return os.environ.get(DEBUG_VARIABLE, "") not in ("", "0")


def start_log() -> None:
    """Append the log records of this process to the file of `LOG_VARIABLE`, if it is set.

    Raises
    ------
    OSError
        if the file cannot be written
    """
    loggers = [logging.getLogger(package) for package in PACKAGES]
    for logger in loggers:
        for old in [each for each in logger.handlers if isinstance(each, logging.FileHandler)]:
            logger.removeHandler(old)
            old.close()
    if not (name := os.environ.get(LOG_VARIABLE)):
        return
    handler = logging.FileHandler(Path(name), encoding="utf-8")
    handler.setFormatter(logging.Formatter(LINE_FORMAT, "%Y-%m-%dT%H:%M:%S"))
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)


def print_traceback(error: BaseException) -> None:
    """Print the traceback of an error and of its causes, also of those in a worker process."""
    traceback.print_exception(error)
    cause: BaseException | None = error
    while cause is not None:
        if detail := getattr(cause, "detail", ""):
            print(f"In the worker process:\n{detail}", file=sys.stderr)
        cause = cause.__cause__ or cause.__context__
