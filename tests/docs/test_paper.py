"""The draft of a paper has the form of the Journal of Open Source Software."""

import re

import yaml

from docs.figures import without_comments
from tests.paths import ROOT

SECTIONS = ["Summary", "Statement of need", "State of the field", "Software design"]


def read_paper() -> tuple[dict, str]:
    _, metadata, text = (ROOT / "paper" / "paper.md").read_text().split("---\n", 2)
    return yaml.safe_load(metadata), without_comments(text)


def test_the_metadata_are_complete():
    metadata, _ = read_paper()
    indices = {affiliation["index"] for affiliation in metadata["affiliations"]}
    assert all(author["name"] for author in metadata["authors"])
    assert {author["affiliation"] for author in metadata["authors"]} == indices
    assert metadata["title"].startswith("raster-harness")
    assert re.fullmatch(r"\d{1,2} [A-Z][a-z]+ \d{4}", str(metadata["date"]))
    assert len(metadata["tags"]) >= 3
    assert (ROOT / "paper" / metadata["bibliography"]).exists()


def test_the_text_has_the_sections_and_the_length():
    _, text = read_paper()
    headings = re.findall(r"^# (.*)$", text, flags=re.MULTILINE)
    assert headings[: len(SECTIONS)] == SECTIONS
    assert headings[-1] == "References"
    assert 250 <= len(re.findall(r"[\w']+", text)) <= 1000


def test_every_reference_is_cited_and_every_citation_has_a_reference():
    _, text = read_paper()
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.MULTILINE)
    assert len(entries) == len(set(entries))
    assert set(re.findall(r"@(\w+)", text)) == set(entries)
