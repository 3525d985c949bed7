"""What is said of a run: bars on a terminal, lines now and then elsewhere."""

import io
import time
from itertools import pairwise

import pytest
from rich.console import Console

from harness.progress import MAX_INTERVAL_S, MIN_INTERVAL_S, Reporter, Screen
from harness.style import plain_table
from tests.conftest import assert_refused


class Said:
    """A reporter whose clock and console are the test's."""

    def __init__(self, *, terminal: bool = False, **options: bool) -> None:
        self._file = io.StringIO()
        console = Console(file=self._file, width=120, force_terminal=terminal)
        self.now = 0.0
        self.reporter = Reporter(console=console, clock=lambda: self.now, **options)

    @property
    def text(self) -> str:
        return self._file.getvalue()

    @property
    def lines(self) -> list[str]:
        return self._file.getvalue().splitlines()


def test_without_a_terminal_there_are_lines_now_and_then():
    said = Said()
    with said.reporter.stage("counting", 60) as stage:
        for _ in range(60):
            said.now += 1.0
            stage.advance()
    assert said.lines[:3] == [
        "counting ...",
        "counting: 5% after 3 s, about 0:00:57 left",
        "counting: 10% after 6 s, about 0:00:54 left",
    ]
    assert said.lines[-1] == "counting: 95% after 57 s, about 0:00:03 left"
    assert len(said.lines) == 20


def test_the_longer_a_stage_the_fewer_lines_but_never_long_silence():
    said, told = Said(), [0]
    with said.reporter.stage("counting", 4000) as stage:
        for second in range(1, 4000):
            said.now, before = float(second), len(said.lines)
            stage.advance()
            told += [second] * (len(said.lines) > before)
    gaps = [later - sooner for sooner, later in pairwise(told)]
    assert (gaps[0], gaps[-1]) == (MIN_INTERVAL_S, MAX_INTERVAL_S)
    assert gaps == sorted(gaps)


def test_what_has_no_known_end_is_told_now_and_then_too():
    said = Said()
    with said.reporter.stage("looking") as stage:
        for done in range(1, 31):
            said.now += 1.0
            stage.complete(done)
    assert said.lines[:2] == ["looking ...", "looking: 3 done after 3 s"]
    assert len(said.lines) == 11


def test_tables_in_a_pipe_are_not_cut_and_not_padded(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    table = plain_table("a title", "name", "words")
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


def test_names_between_colons_are_no_pictures(capsys, harness):
    named = "theirs:hole: failed"
    pipe = io.StringIO()
    Screen(file=pipe).print(named)
    Reporter().warn(named)
    assert [pipe.getvalue().strip(), capsys.readouterr().err.strip()] == [
        named,
        f"warning: {named}",
    ]
    told = harness("census", "city", "-o", "there", "--triangulators", "theirs:hole")
    assert_refused(told, "theirs:hole: give two or more")


def test_details_are_for_those_who_ask():
    for verbose in (False, True):
        said = Said(verbose=verbose)
        said.reporter.detail("Traceback: ...")
        with said.reporter.stage("timing", 1.0):
            said.now += 2.5
        assert said.lines == (
            ["Traceback: ...", "timing ...", "timing: 2.5 s"] if verbose else ["timing ..."]
        )


def test_quiet_says_nothing_but_warnings():
    said = Said(quiet=True)
    said.reporter.say("a")
    said.reporter.warn("b")
    with said.reporter.stage("timing", 1.0) as stage:
        said.now += 100.0
        stage.advance()
    assert said.lines == ["warning: b"]


@pytest.mark.parametrize("verbose", [False, True])
def test_verbose_shows_each_case_and_where_a_plugin_went_wrong(harness, block, no_plots, verbose):
    arguments = ("run", "--scene", str(block), "--out", "out", "--quick", "-q")
    names = ("--triangulators", "ear-clipping,tests.broken:raise_base_exception")
    more = ("--verbose",) if verbose else ()
    mock = ("--rasterisers", "tests.mock:MockRasteriser")
    code, _, err = harness(*arguments, *names, *mock, *more)
    assert code == 5
    assert ("in raise_base_exception" in err) == verbose
    assert ("ear-clipping, tests.mock:MockRasteriser on scripted: ok, " in err) == verbose


def test_the_rate_is_told_and_what_was_done_before_the_first_step_is_not_in_it():
    said = Said()
    with said.reporter.stage("triangulating", 1_000_000, "footprints") as stage:
        said.now += 30.0  # compiling
        for part in range(1, 41):
            said.now += 2.0
            stage.complete(25_000 * part)
    assert said.lines[:3] == [
        "triangulating ...",
        "triangulating: 2% after 32 s",
        "triangulating: 8% after 36 s, 12,500 footprints/s, about 0:01:14 left",
    ]


def test_on_a_terminal_there_is_a_bar(monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    said = Said(terminal=True)
    with said.reporter.stage("counting", 2) as stage:
        stage.advance()
    assert "counting" in said.text
    assert "100%" in said.text
    with said.reporter.stage("triangulating", 4, "parts") as stage:
        for part in range(1, 5):
            said.now += 6.0
            stage.complete(part)
    assert "100%, 0.17 parts/s" in said.text


def test_notice_of_a_long_step_is_repeated_until_it_ends():
    said = Said()
    with said.reporter.if_long("still reading", 0.01):
        while len(said.lines) < 3:
            time.sleep(0.001)
    count = len(said.lines)
    assert all(line.startswith("still reading") for line in said.lines)
    with said.reporter.if_long("never", 0.01) as cancel:
        cancel()
        time.sleep(0.05)
    assert len(said.lines) == count
