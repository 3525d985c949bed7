"""Every figure that a document cites is what its file of results says."""

from __future__ import annotations

import json
import re
from functools import cache

import pytest

from docs.held import NUMBER, ROOT, Block, Sentence, Table, differences, not_held, written
from docs.held.charts import CHARTS
from docs.held.documents import DOCUMENTS

NAMES = sorted(name for name, (held, _) in DOCUMENTS.items() if held)


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
def test_figures_are_those_of_their_files(name):
    held, _ = DOCUMENTS[name]
    assert list(differences(text_of(name), held)) == []


@pytest.mark.parametrize("name", sorted(DOCUMENTS))
def test_no_figure_is_typed(name):
    held, definitions = DOCUMENTS[name]
    assert not_held(text_of(name), held, definitions) == []


@pytest.mark.parametrize("name", NAMES)
def test_any_figure_that_is_changed_is_found(name):
    held, _ = DOCUMENTS[name]
    document = text_of(name)
    for each in held:
        spans = []
        if isinstance(each, Table | Block):
            start, end = each.span(document)
            spans = [
                (start + cell.start(), start + cell.end())
                for cell in re.finditer(rf"(?<=\s){NUMBER}(?=[\s|])", document[start:end])
            ]
        elif isinstance(each, Sentence):
            found = each.find(document)
            assert found is not None, each.text
            spans = [found.span(number) for number in range(1, len(found.groups()) + 1)]
        assert spans, each
        for start, end in spans[:: max(1, len(spans) // 4)]:
            other = document[:start] + document[start:end] + "1" + document[end:]
            assert list(differences(other, [each])), document[start - 30 : end + 10]
            assert written(other, [each]) == document


def test_a_figure_follows_its_file(monkeypatch):
    """With every number of the files doubled, no measured figure stays as it is."""
    from docs.held import findings, lookups

    real = lookups.rows

    @cache
    def doubled(file: str) -> list[lookups.Row]:
        return [
            {
                name: str(2 * float(cell)) if re.fullmatch(r"-?\d+\.\d+(e-?\d+)?", cell) else cell
                for name, cell in row.items()
            }
            for row in real(file)
        ]

    before = {table: table.rows() for table in findings.TABLES if isinstance(table, Table)}
    lookups._some.cache_clear()
    monkeypatch.setattr(lookups, "rows", doubled)
    changed = [table.header for table in before if table.rows() != before[table]]
    lookups._some.cache_clear()
    from_json = {"| terms |", "| | best for H | refined | best for Q |", "| processor |"}
    from_json |= {"| device | triangle |", "| device, area |"}
    kept = [header for table in before if (header := table.header) not in changed]
    assert all(any(header.startswith(start) for start in from_json) for header in kept), kept


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
