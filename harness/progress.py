"""How far a run is: bars on a terminal, lines now and then elsewhere, nothing with --quiet."""

import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Timer
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
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


class Due:
    """Says when the next line about a stage is due: as long as it lasts, the less often.

    clock : seconds
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._start = self._last = clock()

    def now(self) -> float:
        """Return how many seconds the stage has lasted if a line is due; otherwise 0."""
        now = self._clock()
        least, most = SILENT_S
        if now - self._last < min(most, max(least, (now - self._start) / 20)):
            return 0.0
        self._last = now
        return now - self._start


class Stage:
    """One stage of a run; `complete` says how many of its steps are done in all.

    show : called with that number
    """

    def __init__(self, show: Callable[[float], None]) -> None:
        self._show = show
        self._done = 0.0

    def complete(self, steps: float) -> None:
        """Say that `steps` steps are done in all."""
        self._done = steps
        self._show(steps)

    def wait(self, _waited: float) -> None:
        """Say that it goes on; how long the step in progress has lasted does not matter."""
        self._show(self._done)

    def advance(self) -> None:
        """Say that one more step is done."""
        self.complete(int(self._done) + 1)


Words = Callable[[float], str]
"""What to say of a stage that has lasted so many seconds."""

Parts = Callable[[int, float], None]
"""Told how many parts are done, and how much of the whole they hold."""


class Rate:
    """How fast something goes of late, and how long it still takes.

    What was done before the first part ended, such as compiling, does not count.

    total : how much there is to do
    clock : seconds
    """

    WINDOW_S = 120.0
    LEAST_S = 5.0

    def __init__(self, total: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._total = total
        self._clock = clock
        self._seen: deque[tuple[float, float]] = deque()

    def add(self, amount: float) -> None:
        """Say how much is done in all."""
        now = self._clock()
        self._seen.append((now, amount))
        while now - self._seen[0][0] > self.WINDOW_S and len(self._seen) > 2:
            self._seen.popleft()

    def per_second(self) -> float | None:
        """Return the rate, None where too little was seen to tell."""
        if not self._seen:
            return None
        (begun, before), (ended, after) = self._seen[0], self._seen[-1]
        return (after - before) / (ended - begun) if ended - begun >= self.LEAST_S else None

    def left_s(self) -> float | None:
        """Return the seconds left, None where the rate is not known."""
        rate = self.per_second()
        return max(0.0, self._total - self._seen[-1][1]) / rate if rate else None

    def text(self, done: int, count: int, unit: str) -> str:
        """Say all of it in one line."""
        line = f"{done:,}/{count:,} parts"
        rate, left = self.per_second(), self.left_s()
        if rate is None or left is None:
            return line
        minutes, seconds = divmod(round(left), 60)
        hours, minutes = divmod(minutes, 60)
        speed = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
        return f"{line}, {speed} {unit}/s, {hours}:{minutes:02}:{seconds:02} left"


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
    def _begun(
        self, title: str, total: float | None, *columns: ProgressColumn
    ) -> Iterator[Callable[[float, Words | None], None]]:
        """Begin what is shown as a bar with these columns, or as a line now and then.

        Gives a function that is told how much is done, and what to say of it if a line is due.
        """
        if not self._bars:
            self.say(f"{title} ...")
            line = Due(self._clock)

            def told(_done: float, words: Words | None) -> None:
                if words and (lasted := line.now()):
                    self.say(f"{title}: {words(lasted)}")

            yield told
            return
        shown = (SpinnerColumn(), TextColumn("{task.description:<34}"), *columns)
        with Progress(*shown, console=self.console) as bars:
            task = bars.add_task(title, total=total, said="")

            def drawn(done: float, words: Words | None) -> None:
                bars.update(task, completed=done, said=words(0.0) if words else "")

            yield drawn

    @contextmanager
    def counting(self, title: str) -> Iterator[Callable[[int], None]]:
        """Begin a stage of unknown length; gives a function that is told the count so far."""
        column = TextColumn("{task.completed:,.0f}")
        with self._begun(title, None, column, TimeElapsedColumn()) as show:
            yield lambda count: show(count, lambda lasted: f"{count:,} done, {lasted:.0f} s ...")

    @contextmanager
    def parts(self, title: str, count: int, total: float, unit: str) -> Iterator[Parts]:
        """Begin a stage of `count` parts that hold `total` of what `unit` names, e.g. footprints.

        One line says how many parts are done, the rate of late, and the time left by that rate.
        """
        rate = Rate(total, self._clock)
        said = TextColumn("{task.fields[said]}")
        with self._begun(title, total, BarColumn(bar_width=20), said) as show:

            def tell(done: int, amount: float) -> None:
                if done:
                    rate.add(amount)
                show(amount, lambda _: rate.text(done, count, unit))

            tell(0, 0.0)
            yield tell

    @contextmanager
    def stage(self, title: str, total: float) -> Iterator[Stage]:
        """Begin a stage of `total` steps: a bar with the time left, or lines now and then."""
        start = self._clock()
        rate = Rate(total, self._clock)
        columns = (
            BarColumn(bar_width=20),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )

        def tell(steps: float) -> None:
            def words(lasted: float) -> str:
                left = rate.left_s()
                told = "" if left is None else f", about {left:.0f} s left"
                return f"{steps / total:.0%} after {lasted:.0f} s{told}"

            if steps > 0:
                rate.add(steps)
            show(steps, words if steps < total else None)

        try:
            with self._begun(title, total, *columns) as show:
                yield Stage(tell)
                show(total, None)
        finally:
            self.detail(f"{title}: {self._clock() - start:.1f} s")

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
