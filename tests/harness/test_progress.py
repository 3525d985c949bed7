"""What is said of a run: bars on a terminal, lines now and then elsewhere."""

import io
from itertools import pairwise

import pytest
from rich.console import Console

from harness.progress import SILENT_S, Due, Rate, Reporter, Screen
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
        "counting: 5% after 3 s",
        "counting: 10% after 6 s, about 54 s left",
    ]
    assert said.lines[-1] == "counting: 95% after 57 s, about 3 s left"
    assert len(said.lines) == 20


def test_the_longer_a_stage_the_fewer_lines_but_never_long_silence():
    seconds = iter(range(4000))
    line = Due(lambda: next(seconds))
    told = [second for second in range(1, 4000) if line.now()]
    gaps = [later - sooner for sooner, later in pairwise([0, *told])]
    assert (gaps[0], gaps[-1]) == SILENT_S
    assert gaps == sorted(gaps)


def test_what_has_no_known_end_is_told_now_and_then_too():
    said = Said()
    with said.reporter.counting("looking") as tell:
        for done in range(1, 31):
            said.now += 1.0
            tell(done)
    assert said.lines[:2] == ["looking ...", "looking: 3 done, 3 s ..."]
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
    names = ("--triangulators", "ear-clipping,tests.broken:raises_no_exception")
    more = ("--verbose",) if verbose else ()
    mock = ("--rasterisers", "tests.mock:MockRasteriser")
    code, _, err = harness(*arguments, *names, *mock, *more)
    assert code == 5
    assert ("in raises_no_exception" in err) == verbose
    assert ("ear-clipping, tests.mock:MockRasteriser on scripted: ok, " in err) == verbose


def test_parts_say_their_rate_and_the_time_left():
    said = Said()
    with said.reporter.parts("triangulating", 40, 1_000_000, "footprints") as show:
        said.now += 30.0  # compiling, which is not the rate
        for part in range(1, 41):
            said.now += 2.0
            show(part, 25_000 * part)
    assert said.lines[:3] == [
        "triangulating ...",
        "triangulating: 1/40 parts",
        "triangulating: 3/40 parts",
    ]


def test_on_a_terminal_there_is_a_bar_and_one_for_parts(monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    said = Said(terminal=True)
    with said.reporter.stage("counting", 2) as stage:
        stage.advance()
    assert "counting" in said.text
    assert "100 %" in said.text
    with said.reporter.parts("triangulating", 4, 4, "parts") as show:
        for part in range(1, 5):
            said.now += 6.0
            show(part, part)
    assert "4/4 parts, 0.17 parts/s, 0:00:00 left" in said.text


def test_the_rate_is_that_of_late():
    now = 0.0
    rate = Rate(1000.0, lambda: now)
    assert rate.left_s() is None
    for amount in range(301):
        now += 1.0
        rate.add(float(amount))
    assert rate.per_second() == 1.0
    assert rate.left_s() == 700.0
    for amount in range(302, 701, 2):
        now += 1.0
        rate.add(float(amount))
    assert rate.per_second() == 2.0
    assert rate.left_s() == 150.0
