"""Every figure that a document cites is what its file of results says."""

from __future__ import annotations

import json

import pytest

from docs.generate import filled
from docs.held import ROOT, Block, Sentence, Table, differences, not_held, written
from docs.held.charts import CHARTS
from docs.held.documents import DOCUMENTS

NAMES = sorted(name for name, (held, _) in DOCUMENTS.items() if held)


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
def test_figures_are_those_of_their_files(name):
    """Of tables and blocks, which `make documents` writes, that they are there."""
    held, _ = DOCUMENTS[name]
    document = text_of(name)
    assert list(differences(document, [one for one in held if isinstance(one, Sentence)])) == []
    assert all(one.span(document) for one in held if isinstance(one, Table | Block))


@pytest.mark.parametrize("name", sorted(DOCUMENTS))
def test_no_figure_is_typed(name):
    held, definitions = DOCUMENTS[name]
    assert not_held(text_of(name), held, definitions) == []


def test_a_figure_that_is_changed_is_found_and_put_right():
    for name in NAMES:
        held, _ = DOCUMENTS[name]
        document = text_of(name)
        for each in (one for one in held if isinstance(one, Sentence)):
            found = each.find(document)
            assert found is not None, each.text
            start, end = found.span(1)
            other = document[:start] + document[start:end] + "1" + document[end:]
            assert list(differences(other, [each])), each.text
            assert written(other, [each]) == document


@pytest.mark.parametrize("name", ["commands", "names", "python"])
def test_what_is_made_from_code_is_committed_as_it_is_made(name):
    """It is read in the repository, too; `make documents` writes it."""
    page = text_of(f"docs/reference/{name}.md")
    assert page.count("<!-- generated:") > 0
    assert filled(page) == page


@pytest.mark.parametrize("name", sorted(CHARTS))
def test_charts_are_drawn_from_the_files_as_they_are(name):
    assert text_of(f"docs/images/{name}.svg") == CHARTS[name]()


def test_studies_are_of_one_commit_and_of_one_processor():
    files = sorted((ROOT / "results" / "reference").glob("*/*/run.json"))
    facts = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    assert len(files) > 50
    assert len({each["environment"]["git"]["commit"] for each in facts}) == 1
    assert not any(each["environment"]["git"]["dirty"] for each in facts)
    assert len({each["cpu"]["label"] for each in facts}) == 1


def test_a_typed_figure_is_found():
    assert not_held("It takes 0.85 of the time.", [], ()) == ["It takes 0.85 of the time."]
    between = "Where a <= b it takes 0.85, and b > a."  # no element of HTML
    assert not_held(between, [], ()) == [between]
    assert not_held("It has `0.85` and 12 px, <!-- 3 --> 7 %.", [], (r"\b12 px", r"7 %")) == []


def test_a_sentence_may_break_its_lines_anywhere():
    sentence = Sentence("takes {} of ear clipping's time", lambda: ["0.85"])
    document = "It takes 0.9 of\near clipping's time."
    assert list(differences(document, [sentence])) != []
    assert written(document, [sentence]) == "It takes 0.85 of\near clipping's time."
