import io
import time
from itertools import pairwise

from rich.console import Console

from harness.progress import MAX_INTERVAL_S, MIN_INTERVAL_S, Reporter, Screen
from harness.style import make_plain_table
from tests.conftest import assert_refused


class ScriptedReporter:
    """A reporter with the test's clock and console."""

    def __init__(self, *, terminal: bool = False, **options: bool) -> None:
        self._file = io.StringIO()
        console = Console(file=self._file, width=120, force_terminal=terminal)
        self.now = 0.0
        self.reporter = Reporter(console=console, clock=lambda: self.now, **options)

    @property
    def lines(self) -> list[str]:
        return self._file.getvalue().splitlines()


def test_without_a_terminal_lines_are_printed_at_intervals():
    reporter = ScriptedReporter()
    with reporter.reporter.stage("counting", 60) as stage:
        for _ in range(60):
            reporter.now += 1.0
            stage.advance()
    assert reporter.lines[:3] == [
        "counting ...",
        "counting: 5% after 3 s, about 0:00:57 left",
        "counting: 10% after 6 s, about 0:00:54 left",
    ]
    assert reporter.lines[-1] == "counting: 95% after 57 s, about 0:00:03 left"
    assert len(reporter.lines) == 20


def test_intervals_grow_with_the_duration_up_to_a_maximum():
    reporter, times = ScriptedReporter(), [0]
    with reporter.reporter.stage("counting", 4000) as stage:
        for second in range(1, 4000):
            reporter.now, before = float(second), len(reporter.lines)
            stage.advance()
            times += [second] * (len(reporter.lines) > before)
    gaps = [later - sooner for sooner, later in pairwise(times)]
    assert (gaps[0], gaps[-1]) == (MIN_INTERVAL_S, MAX_INTERVAL_S)
    assert gaps == sorted(gaps)


def test_stages_of_unknown_length_are_reported():
    reporter = ScriptedReporter()
    with reporter.reporter.stage("looking") as stage:
        for done in range(1, 31):
            reporter.now += 1.0
            stage.complete(done)
    assert reporter.lines[:2] == ["looking ...", "looking: 3 done after 3 s"]
    assert len(reporter.lines) == 11


def test_tables_in_a_pipe_are_neither_cut_nor_padded(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    table = make_plain_table("a title", "name", "words")
    table.add_row("n" * 60, "as many words as a table may have")
    table.add_row("n", "few")
    for columns in (None, "50"):
        if columns:
            monkeypatch.setenv("COLUMNS", columns)
        pipe = io.StringIO()
        Screen(file=pipe).print(table)
        lines = pipe.getvalue().splitlines()
        assert not any(line.endswith(" ") for line in lines)
        assert any("as many words as a table may have" in line for line in lines) != bool(columns)
    screen = io.StringIO()
    Screen(file=screen, force_terminal=True, width=80, color_system=None).print(table)
    assert any(line.endswith(" ") for line in screen.getvalue().splitlines())


def test_names_between_colons_are_not_emoji(capsys, harness):
    named = "theirs:hole: failed"
    pipe = io.StringIO()
    Screen(file=pipe).print(named)
    Reporter().warn(named)
    assert pipe.getvalue().strip() == named
    assert capsys.readouterr().err.strip() == f"warning: {named}"
    output = harness("census", "city", "-o", "there", "--triangulators", "theirs:hole")
    assert_refused(output, "theirs:hole: give two or more")


def test_details_are_printed_in_verbose_mode_only():
    for verbose in (False, True):
        reporter = ScriptedReporter(verbose=verbose)
        reporter.reporter.detail("Traceback: ...")
        with reporter.reporter.stage("timing", 1.0):
            reporter.now += 2.5
        lines = ["Traceback: ...", "timing ...", "timing: 2.5 s"]
        assert reporter.lines == (lines if verbose else ["timing ..."])


def test_quiet_prints_only_warnings():
    reporter = ScriptedReporter(quiet=True)
    reporter.reporter.say("a")
    reporter.reporter.warn("b")
    with reporter.reporter.stage("timing", 1.0) as stage:
        reporter.now += 100.0
        stage.advance()
    assert reporter.lines == ["warning: b"]


def test_the_rate_excludes_work_before_the_first_step():
    reporter = ScriptedReporter()
    with reporter.reporter.stage("triangulating", 1_000_000, "footprints") as stage:
        reporter.now += 30.0  # time before the first step, such as compilation
        for part in range(1, 41):
            reporter.now += 2.0
            stage.complete(25_000 * part)
    assert reporter.lines[:3] == [
        "triangulating ...",
        "triangulating: 2% after 32 s",
        "triangulating: 8% after 36 s, 12,500 footprints/s, about 0:01:14 left",
    ]


def test_a_terminal_shows_a_bar(monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    reporter = ScriptedReporter(terminal=True)
    with reporter.reporter.stage("counting", 2) as stage:
        stage.advance()
    text = "\n".join(reporter.lines)
    assert "counting" in text
    assert "100%" in text
    with reporter.reporter.stage("triangulating", 4, "parts") as stage:
        for part in range(1, 5):
            reporter.now += 6.0
            stage.complete(part)
    assert "100%, 0.17 parts/s" in "\n".join(reporter.lines)


def test_notice_of_a_long_step_is_repeated_until_it_ends():
    reporter = ScriptedReporter()
    with reporter.reporter.say_if_long("still reading", 0.01):
        while len(reporter.lines) < 3:
            time.sleep(0.001)
    count = len(reporter.lines)
    assert all(line.startswith("still reading") for line in reporter.lines)
    with reporter.reporter.say_if_long("never", 0.01) as cancel:
        cancel()
        time.sleep(0.05)
    assert len(reporter.lines) == count
