"""`--debug` and `--log FILE`, as environment variables, so that worker processes inherit them."""

import logging
import os
import sys
import traceback
from pathlib import Path

from triangulators.compute.compiled_files import PACKAGES

DEBUG_VARIABLE = "RASTER_HARNESS_DEBUG"  # print the traceback of errors, unless empty or 0
LOG_VARIABLE = "RASTER_HARNESS_LOG"  # file for worker starts and ends, time limits, cache hits
LINE_FORMAT = "%(asctime)s.%(msecs)03d %(levelname)s [%(process)d] %(name)s: %(message)s"


def is_debugging() -> bool:
    """Return whether errors are printed with a traceback."""
    return os.environ.get(DEBUG_VARIABLE, "") not in ("", "0")


def start_log() -> None:
    """Append the log records of this process to the file of `LOG_VARIABLE`, if set."""
    loggers = [logging.getLogger(package) for package in PACKAGES]
    for logger in loggers:
        for handler in list(logger.handlers):
            if isinstance(handler, logging.FileHandler):
                logger.removeHandler(handler)
                handler.close()
    if not (name := os.environ.get(LOG_VARIABLE)):
        return
    log_file = logging.FileHandler(Path(name), encoding="utf-8")
    log_file.setFormatter(logging.Formatter(LINE_FORMAT, "%Y-%m-%dT%H:%M:%S"))
    for logger in loggers:
        logger.addHandler(log_file)
        logger.setLevel(logging.DEBUG)


def print_traceback(error: BaseException) -> None:
    """Print the traceback of an error and its causes, including causes in a worker process."""
    traceback.print_exception(error)
    cause: BaseException | None = error
    while cause is not None:
        if detail := getattr(cause, "detail", ""):
            print(f"In the worker process:\n{detail}", file=sys.stderr)
        cause = cause.__cause__ or cause.__context__
