"""What a run does when it is told to stop: by Ctrl-C, by SIGTERM, or as its terminal closes."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from harness.machine import system
from harness.measuring.processes import Bench
from harness.progress import Reporter, let_go_of_terminal


@contextmanager
def stopped_in_order(bench: Bench, reporter: Reporter) -> Iterator[None]:
    """Let the first Ctrl-C finish the cases in flight.

    A second one, SIGTERM and SIGHUP, whose senders do not wait, raise KeyboardInterrupt.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread is told of signals
        return

    def stop(number: int, _: object) -> None:
        again, bench.stopping = bench.stopping, True
        if number == system.HANGUP:
            let_go_of_terminal()
        if again or number != signal.SIGINT:
            raise KeyboardInterrupt
        reporter.say("stopping after the case in flight; press Ctrl-C again to stop at once")

    wanted = [
        number
        for number in system.STOPPING
        if signal.getsignal(number) != signal.SIG_IGN  # as nohup has it
    ]
    before = {number: signal.signal(number, stop) for number in wanted}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
