"""Entry point of `python -m harness` and `raster-harness`; imports little, as workers import it."""

import os
import signal
import sys
from pathlib import Path

INTERRUPTED = 130  # equal to harness.errors.INTERRUPTED, which may not be loaded yet


def main() -> None:
    """Load the command line and run it."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            # `_stop` exits; a library that is being imported might catch an exception.
            signal.signal(number, _stop)
    _remove_working_folder()
    from harness.supervisor import continue_in_child

    continue_in_child()
    from harness.cli import main as run

    try:
        run()
    except KeyboardInterrupt:  # raised before or after `run` can catch the exception
        _stop()


def _remove_working_folder() -> None:
    """Remove the current folder from `sys.path`: data may lie next to an unrelated `typer.py`.

    It stays if it is this program's checkout. See `harness.machine.process`.
    """
    if sys.flags.safe_path or not sys.path:
        return
    try:
        entry, current = Path(sys.path[0]).absolute(), Path.cwd()
    except FileNotFoundError:  # the current folder was removed
        return
    if entry == current and entry.resolve() != Path(__file__).resolve().parents[1]:
        del sys.path[0]


def _stop(*_: object) -> None:
    try:
        os.write(2, b"\nstopped\n")
    finally:
        os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
