"""Progress of a command: bars on a terminal, lines elsewhere, no output with --quiet."""

import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from math import inf
from threading import Event, Thread
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment

UNKNOWN_WIDTH = 120  # columns of a file or a pipe; wide enough for all tables


class Screen(Console):
    """Console for tables: in files and pipes lines are `UNKNOWN_WIDTH` wide and not padded."""

    def __init__(self, **options: Any) -> None:
        super().__init__(emoji=False, **options)
        if not self.is_terminal and "COLUMNS" not in os.environ:
            self.width = UNKNOWN_WIDTH

    def _render_buffer(self, buffer: Iterable[Segment]) -> str:
        text = super()._render_buffer(buffer)
        return text if self.is_terminal else re.sub(r" +$", "", text, flags=re.MULTILINE)


def detach_terminal() -> None:
    """Discard further output to the terminal, which was closed."""
    null = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        if os.isatty(number):
            os.dup2(null, number)
    os.close(null)


MIN_INTERVAL_S, MAX_INTERVAL_S = 3.0, 10.0  # between lines about a stage, without a terminal


class Stage:
    """Progress of a stage: a bar on a terminal, otherwise lines; with a rate if it has a `unit`."""

    def __init__(self, bars: Progress, task: Task, unit: str, say: Callable[[str], None]) -> None:
        self._bars = bars
        self._task = task
        self._unit = unit
        self._say = say
        self._printed_s = 0.0

    def complete(self, steps: float) -> None:
        """Set the number of finished steps."""
        task = self._task
        share = f"{steps / task.total:.0%}" if task.total else f"{steps:,.0f} done"
        rate = ""
        if self._unit and (speed := task.speed):
            rate = f", {f'{speed:,.0f}' if speed >= 10 else f'{speed:.2g}'} {self._unit}/s"
        self._bars.update(task.id, completed=steps, status=share + rate)
        elapsed = task.elapsed or 0.0
        # The interval between lines grows with the duration, as long stages change slowly.
        interval_s = min(MAX_INTERVAL_S, max(MIN_INTERVAL_S, elapsed / 20))
        is_due = elapsed - self._printed_s >= interval_s
        if is_due and self._bars.disable and not task.finished:
            self._printed_s = elapsed
            seconds = task.time_remaining
            remaining = "" if seconds is None else f", about {timedelta(seconds=seconds)} left"
            self._say(f"{task.description}: {share} after {elapsed:.0f} s{rate}{remaining}")

    def refresh(self, _waited: float) -> None:
        """Show the elapsed time again during a long step; workers call this periodically."""
        self.complete(self._task.completed)

    def advance(self) -> None:
        """Count one more finished step."""
        self.complete(self._task.completed + 1)


class Reporter:
    """Prints progress, details (if `verbose`, even if `quiet`) and warnings to standard error."""

    def __init__(
        self,
        *,
        quiet: bool = False,
        verbose: bool = False,
        console: Console | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.console = console or Console(stderr=True, highlight=False, emoji=False)
        self._quiet = quiet
        self._verbose = verbose
        self._clock = clock
        self._shown: set[str] = set()
        self._bars = self.console.is_terminal and not os.environ.get("CI") and not quiet

    def say(self, message: str) -> None:
        """Print one line, unless quiet."""
        if not self._quiet:
            self.console.print(message, markup=False, soft_wrap=True)

    def detail(self, message: str) -> None:
        """Print lines, in verbose mode only."""
        if self._verbose and message:
            self.console.print(message.rstrip(), markup=False, style="dim", soft_wrap=True)

    def say_once(self, message: str, *, warn: bool = False) -> None:
        """Print a line or a warning, unless printed before."""
        if message not in self._shown:
            self._shown.add(message)
            (self.warn if warn else self.say)(message)

    def warn(self, message: str) -> None:
        """Print one warning, even if quiet."""
        self.console.print(f"warning: {message}", markup=False, style="yellow", soft_wrap=True)

    @contextmanager
    def stage(self, title: str, total: float | None = None, unit: str = "") -> Iterator[Stage]:
        """Show the progress of a stage of `total` steps, if known, during the block.

        The remaining time is estimated from the rate since the first finished step, so that work
        before, such as compiling, does not count.
        """
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description:<34}"),
            BarColumn(bar_width=20),
            TextColumn("{task.fields[status]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        settings: Any = {"get_time": self._clock, "speed_estimate_period": inf}
        bars = Progress(*columns, console=self.console, disable=not self._bars, **settings)
        if not self._bars:
            self.say(f"{title} ...")
        with bars:
            bars.add_task(title, total=total, status="")
            (task,) = bars.tasks
            stage = Stage(bars, task, unit, self.say)
            yield stage
            if total:
                stage.complete(total)
        self.detail(f"{title}: {task.elapsed:.1f} s")

    @contextmanager
    def say_if_long(self, message: str, seconds: float = 3.0) -> Iterator[Callable[[], None]]:
        """Print `message` after `seconds`, and after each doubling; yield a function to cancel."""
        ended = Event()

        def report() -> None:
            waited = 0.0
            while not ended.wait(max(seconds, waited)):
                waited += max(seconds, waited)
                self.say(f"{message} ({waited:.0f} s)" if waited > seconds else message)

        Thread(target=report, daemon=True).start()
        try:
            yield ended.set
        finally:
            ended.set()
