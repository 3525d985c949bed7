"""How far a run is: bars on a terminal, lines now and then elsewhere, nothing with --quiet."""

import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from math import inf
from threading import Timer
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

UNKNOWN_WIDTH = 120
"""Columns of a file or a pipe, in which no table of ours is cut."""


class Screen(Console):
    """Where tables go; in a file or a pipe lines are not cut at 80, and do not end in spaces."""

    def __init__(self, **options: Any) -> None:
        super().__init__(emoji=False, **options)
        if not self.is_terminal and "COLUMNS" not in os.environ:
            self.width = UNKNOWN_WIDTH

    def _render_buffer(self, buffer: Iterable[Segment]) -> str:
        text = super()._render_buffer(buffer)
        return text if self.is_terminal else re.sub(r" +$", "", text, flags=re.MULTILINE)


def let_go_of_terminal() -> None:
    """Write to nowhere from now on what would go to a terminal that was closed."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        if os.isatty(number):
            os.dup2(nowhere, number)
    os.close(nowhere)


SILENT_S = 3.0, 10.0
"""Least and most seconds between two lines about one stage, where there is no terminal."""


class Stage:
    """One stage of a run, shown as a bar on a terminal; elsewhere `say` is given a line of it.

    unit : what its steps are, if their rate is to be told
    """

    def __init__(self, bars: Progress, task: Task, unit: str, say: Callable[[str], None]) -> None:
        self._bars = bars
        self._task = task
        self._unit = unit
        self._say = say
        self._said_s = 0.0

    def complete(self, steps: float) -> None:
        """Say that `steps` steps are done in all."""
        task = self._task
        share = f"{steps / task.total:.0%}" if task.total else f"{steps:,.0f} done"
        rate = ""
        if self._unit and (speed := task.speed):
            rate = f", {f'{speed:,.0f}' if speed >= 10 else f'{speed:.2g}'} {self._unit}/s"
        self._bars.update(task.id, completed=steps, said=share + rate)
        elapsed = task.elapsed or 0.0
        least, most = SILENT_S
        # As long as it lasts, the less often.
        due = elapsed - self._said_s >= min(most, max(least, elapsed / 20))
        if due and self._bars.disable and not task.finished:
            self._said_s = elapsed
            left = task.time_remaining
            rest = "" if left is None else f", about {timedelta(seconds=left)} left"
            self._say(f"{task.description}: {share} after {elapsed:.0f} s{rate}{rest}")

    def wait(self, _waited: float) -> None:
        """Say that it goes on; how long the step in progress has lasted does not matter."""
        self.complete(self._task.completed)

    def advance(self) -> None:
        """Say that one more step is done."""
        self.complete(self._task.completed + 1)


class Reporter:
    """Shows what a run does on standard error, so that standard output stays clean.

    Parameters
    ----------
    quiet : show nothing but warnings
    verbose : show details, too, whether quiet or not
    console : for tests; by default standard error
    clock : for tests; seconds
    """

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
        """Show one plain line."""
        if not self._quiet:
            self.console.print(message, markup=False, soft_wrap=True)

    def detail(self, message: str) -> None:
        """Show lines that only those want who asked for details."""
        if self._verbose and message:
            self.console.print(message.rstrip(), markup=False, style="dim", soft_wrap=True)

    def once(self, message: str, *, warn: bool = False) -> None:
        """Show one plain line, or a warning, unless it was shown before."""
        if message not in self._shown:
            self._shown.add(message)
            (self.warn if warn else self.say)(message)

    def warn(self, message: str) -> None:
        """Show one line that is shown with --quiet, too."""
        self.console.print(f"warning: {message}", markup=False, style="yellow", soft_wrap=True)

    @contextmanager
    def stage(self, title: str, total: float | None = None, unit: str = "") -> Iterator[Stage]:
        """Begin a stage of `total` steps, None where nobody knows how many; `unit` as in `Stage`.

        The time left is that of the rate since the first of its steps: what was done before, such
        as compiling, does not count.
        """
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description:<34}"),
            BarColumn(bar_width=20),
            TextColumn("{task.fields[said]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        settings: Any = {"get_time": self._clock, "speed_estimate_period": inf}
        bars = Progress(*columns, console=self.console, disable=not self._bars, **settings)
        if not self._bars:
            self.say(f"{title} ...")
        with bars:
            bars.add_task(title, total=total, said="")
            (task,) = bars.tasks
            stage = Stage(bars, task, unit, self.say)
            yield stage
            if total:
                stage.complete(total)
        self.detail(f"{title}: {task.elapsed:.1f} s")

    @contextmanager
    def if_long(self, message: str, seconds: float = 3.0) -> Iterator[Callable[[], None]]:
        """Show `message` if what follows takes long; gives a function that makes it needless."""
        timer = Timer(seconds, lambda: self.say(message))
        timer.daemon = True
        timer.start()
        try:
            yield timer.cancel
        finally:
            timer.cancel()
