"""Set-up of a process of this program: the log, and the import path with the user's modules.

A folder of data may contain an unrelated `numpy.py`. So the current folder is searched only if the
user gives a function in it as `module:function`, and then last.
"""

import logging
import os
import re
import sys
from contextlib import AbstractContextManager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from harness.errors import UsageError
from harness.machine import system

# File for worker starts and ends, time limits and cache hits; workers inherit this variable.
LOG_VARIABLE = "RASTER_HARNESS_LOG"
LINE_FORMAT = "%(asctime)s.%(msecs)03d %(levelname)s [%(process)d] %(name)s: %(message)s"

FUNCTION = re.compile(r"[^\W\d][\w.]*:[^\W\d][\w.]*(?=:|$)")
"""Pattern of `module:function`, perhaps followed by parameters after another colon."""


def start_log() -> None:
    """Append the log records of this process to the file of `LOG_VARIABLE`, if set."""
    from triangulators.compute.compiled_files import PACKAGES

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


def hide_working_folder() -> AbstractContextManager[None]:
    """Keep Python processes started in the block from importing from the current folder."""
    # `python -c`, by which multiprocessing starts helpers, searches that folder first.
    return system.set_variables({"PYTHONSAFEPATH": "1"})


def allow_user_module(reference: str) -> None:
    """Append the current folder to `sys.path` if `reference` is a "module:function" in that folder.

    Raises UsageError if this program's package or an installed module has the module's name.
    """
    from triangulators.compute.compiled_files import PACKAGES, SOURCES

    if FUNCTION.match(reference) is None:
        return
    name = reference.partition(":")[0].partition(".")[0]
    try:
        folder = Path.cwd()
    except FileNotFoundError:  # the folder was removed
        return
    files = [folder / f"{name}.py", folder / name / "__init__.py"]
    file = next((file for file in files if file.is_file()), None)
    if file is None and not (folder / name).is_dir():
        return
    if name in PACKAGES and file is not None and not file.is_relative_to(SOURCES / name):
        raise UsageError(
            f"{reference}: {file.relative_to(folder)} has the name of a package of raster-harness; "
            "rename the file"
        )
    if not {str(folder), "", os.curdir} & set(sys.path):
        for package in PACKAGES:  # before a user's file of the same name could be imported
            import_module(package)
        sys.path += [str(SOURCES), str(folder)]
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        spec = None
    if file is not None and spec is not None and spec.origin and not file.samefile(spec.origin):
        raise UsageError(
            f"{reference}: {file.relative_to(folder)} is hidden by the module {spec.origin}; "
            "rename the file, or set PYTHONPATH=. to import from this folder first"
        )
