"""Every figure that a document cites is what its file of results says."""

import json

import pytest

from docs.generate import filled
from docs.held import ROOT, Held, differences, not_held, spans, written
from docs.held.charts import CHARTS, svg
from docs.held.documents import DOCUMENTS, not_measured

NAMES = sorted(DOCUMENTS)


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def sentences(name: str) -> Held:
    return {text: figures for text, figures in DOCUMENTS[name].items() if "{" in text}


@pytest.mark.parametrize("name", NAMES)
def test_figures_are_those_of_their_files(name):
    """Tables are written by `make documents`; that they are there is tested below."""
    assert list(differences(text_of(name), sentences(name))) == []


@pytest.mark.parametrize("name", NAMES)
def test_no_figure_is_typed(name):
    assert not_held(text_of(name), DOCUMENTS[name], not_measured(name)) == []


def test_a_figure_that_is_changed_is_found_and_put_right():
    for name in NAMES:
        document = text_of(name)
        for text, figures in sentences(name).items():
            _, end = spans(document, text)[0]
            other = document[:end] + "1" + document[end:]
            assert list(differences(other, {text: figures})), text
            assert written(other, {text: figures}) == document


@pytest.mark.parametrize("name", ["commands", "names", "python"])
def test_what_is_made_from_code_is_committed_as_it_is_made(name):
    """It is read in the repository, too; `make documents` writes it."""
    page = text_of(f"docs/reference/{name}.md")
    assert page.count("<!-- generated:") > 0
    assert filled(page) == page


@pytest.mark.parametrize("name", sorted(CHARTS))
def test_charts_are_drawn_from_the_files_as_they_are(name):
    assert text_of(f"docs/images/{name}.svg") == svg(CHARTS[name])


def test_studies_but_a_gpus_are_of_one_commit_and_of_one_processor():
    files = (ROOT / "results" / "reference").glob("*/*/run.json")
    files = sorted(file for file in files if file.parts[-3] != "h200")
    facts = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    assert len(files) > 50
    assert len({each["environment"]["git"]["commit"] for each in facts}) == 1
    assert not any(each["environment"]["git"]["dirty"] for each in facts)
    assert len({each["cpu"]["label"] for each in facts}) == 1


def test_a_typed_figure_is_found():
    assert not_held("It takes 0.85 of the time.", {}, ()) == ["It takes 0.85 of the time."]
    between = "Where a <= b it takes 0.85, and b > a."  # no element of HTML
    assert not_held(between, {}, ()) == [between]
    assert not_held("It has `0.85` and 12 px, <!-- 3 --> 7 %.", {}, (r"\b12 px", r"7 %")) == []


def test_a_sentence_may_break_its_lines_anywhere():
    held: Held = {"takes {:.2f} of ear clipping's time": lambda: [0.85]}
    document = "It takes 0.9 of\near clipping's time."
    assert list(differences(document, held)) != []
    assert written(document, held) == "It takes 0.85 of\near clipping's time."


def test_the_words_between_figures_may_be_left_out_within_a_paragraph():
    held: Held = {"by {:.1%} % ... and {:%} % of all": lambda: [-0.0001, 0.0512]}
    document = "Less by 3 %, one thinks,\nand 4 % of all."
    assert written(document, held) == "Less by 0.0 %, one thinks,\nand 5.1 % of all."
    with pytest.raises(ValueError, match="not in the document"):
        spans(document.replace("\n", "\n\n"), "by {:.1%} % ... and {:%} % of all")


def test_a_figure_is_taken_whole():
    """The full stop behind it is none within another figure."""
    held: Held = {"rises to {:.2f}.": lambda: [0.75]}
    document = "It rises to 0.99 at worst. That one rises to 0.5."
    assert written(document, held) == document.replace("0.5", "0.75")
    with pytest.raises(ValueError, match="not in the document"):
        spans("It rises to 0.99 at worst.", "rises to {:.2f}.")


def test_what_is_below_a_first_line_is_written():
    held: Held = {"| a | b |": lambda: ["| 1 | 2 |"], "it says": lambda: ["7", "8"]}
    document = "| a | b |\n|---|---|\n| 3 | 4 |\n\n```text\nit says\n9\n```\n"
    expected = document.replace("| 3 | 4 |", "| 1 | 2 |").replace("9", "7\n8")
    assert written(document, held) == expected
    with pytest.raises(ValueError, match="several"):
        spans(2 * document, "| a | b |")
