"""Figures that the documents cite, each held against the file of results that it comes from.

A `Sentence` is a piece of a document's text in which `{}` stands for a figure; a `Table` is a table
of a document, named by its first line; a `Block` is the text of a file. All say how their figures
follow from the files under `results/`. `tests/docs/test_held.py` compares; `scripts/documents.py`
writes the figures anew.

    lookups    one figure, or one row, of a file
    findings, readme, others, profiles   the figures of each document
    claims     those that `raster-harness study all` sets beside what it finds
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent

NUMBER = r"[-+]?\d[\d,]*(?:\.\d+)?"
"""A figure as documents write it: 0.85, 1,002,538, -0.4."""

_CITED = re.compile(rf"(?<![\w.#-]){NUMBER}(?: ?%)?")
_CODE = re.compile(
    r"```.*?```|`[^`]*`|<!--.*?-->|\]\([^)]*\)|<[a-zA-Z/][^<>\n]*>|(?<=\n\n)(?: {4}[^\n]*\n+)+",
    re.DOTALL,
)


@dataclass(frozen=True)
class Sentence:
    """Text with `{}` for each figure, and the figures; line breaks may lie anywhere."""

    text: str
    figures: Callable[[], Sequence[str]]

    def find(self, document: str) -> re.Match[str] | None:
        """Return where the text stands in a document, whatever its figures are."""
        words = [re.escape(word) for word in self.text.split()]
        return re.search(r"\s+".join(words).replace(r"\{\}", f"({NUMBER})"), document)


@dataclass(frozen=True)
class Table:
    """A table by its first line; `rows` are all lines below the line of dashes."""

    header: str
    rows: Callable[[], Sequence[str]]

    def span(self, document: str) -> tuple[int, int]:
        """Return where its rows begin and end; raises `ValueError` if it is not there once."""
        if document.count(self.header + "\n") != 1:
            raise ValueError(f"there is no such table, or several: {self.header}")
        start = document.index(self.header)
        for _ in range(2):
            start = document.index("\n", start) + 1
        end = document.find("\n\n", start)
        return start, len(document) - 1 if end < 0 else end


@dataclass(frozen=True)
class Block:
    """A fenced block that holds a file of `results/reference`, by how it begins."""

    start: str
    file: str

    def span(self, document: str) -> tuple[int, int]:
        """Return where its text begins and ends; raises `ValueError` if it is not there once."""
        if document.count(f"```text\n{self.start}") != 1:
            raise ValueError(f"there is no such block, or several: {self.start}")
        start = document.index(f"```text\n{self.start}") + len("```text\n")
        return start, document.index("```", start)

    def rows(self) -> list[str]:
        """Return the file's lines, and what ends the last one."""
        file = ROOT / "results" / "reference" / self.file
        return file.read_text(encoding="utf-8").split("\n")


Held = Sentence | Table | Block


def differences(document: str, held: Sequence[Held]) -> Iterator[str]:
    """Yield a line for each figure that is not what its file says, and for each missing text."""
    for each in held:
        if isinstance(each, Table | Block):
            start, end = each.span(document)
            there = document[start:end].split("\n")
            expected = list(each.rows())
            yield from (f"stands: {row}" for row in there if row not in expected)
            yield from (f"should: {row}" for row in expected if row not in there)
            continue
        found = each.find(document)
        if found is None:
            yield f"not in the document: {each.text}"
        elif (figures := list(each.figures())) != list(found.groups()):
            yield f"{each.text}: stands {found.groups()}, should be {figures}"


def written(document: str, held: Sequence[Held]) -> str:
    """Return the document with every figure as its file says."""
    for each in held:
        if isinstance(each, Table | Block):
            start, end = each.span(document)
            document = document[:start] + "\n".join(each.rows()) + document[end:]
        elif found := each.find(document):
            for number, figure in reversed(list(enumerate(each.figures(), start=1))):
                start, end = found.span(number)
                document = document[:start] + figure + document[end:]
    return document


def not_held(document: str, held: Sequence[Held], definitions: Sequence[str]) -> list[str]:
    """Return the figures of a document that nothing holds, each with the words around it.

    Code and links are passed over. `definitions` are patterns of what is no result of measuring:
    sizes that were chosen, years, numbers of a definition.
    """
    spans = [match.span() for match in _CODE.finditer(document)]
    for pattern in definitions:
        anywhere = pattern.replace(" ", r"\s+")  # lines may break between any two words
        spans += [match.span() for match in re.finditer(anywhere, document)]
    for each in held:
        if isinstance(each, Table | Block):
            spans.append(each.span(document))
        elif found := each.find(document):
            spans += [found.span(number) for number in range(1, len(found.groups()) + 1)]
    return [
        document[max(0, cited.start() - 40) : cited.end() + 30].replace("\n", " ")
        for cited in _CITED.finditer(document)
        if not any(start <= cited.start() < end for start, end in spans)
    ]
