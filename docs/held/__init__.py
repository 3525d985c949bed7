"""Figures that the documents cite, each held against the file of results that it comes from.

What is `Held` is a piece of a document's text, with what returns its figures from the files under
`results/`. `{}`, or `{:.2f}` and the like, stands for a figure; lines may break between any two
words, and `...` is any text within a paragraph. A text without a figure is the first line of a
table, or of a block that holds a file; all lines below it are returned.
`tests/docs/test_held.py` compares; `scripts/documents.py` writes the figures anew.

    lookups    one figure, or one row, of a file
    findings, flips, profiles, simulated, charts   the figures of each document
    documents  which document cites which; those of single pages, and of `raster-harness study all`
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent

NUMBER = r"[-+]?\d[\d,]*(?:\.\d+)?"
"""A figure as documents write it: 0.85, 1,002,538, -0.4."""

_CITED = re.compile(rf"(?<![\w.#-]){NUMBER}(?: ?%)?")
_CODE = re.compile(
    r"```.*?```|`[^`]*`|<!--.*?-->|\]\([^)]*\)|<[a-zA-Z/][^<>\n]*>|(?<=\n\n)(?: {4}[^\n]*\n+)+",
    re.DOTALL,
)

_FIELD = re.compile(r"\{:?(.*?)\}")
_ANY = r"(?:(?!\n\n)[\s\S])*?"

Span = tuple[int, int]
Held = Mapping[str, Callable[[], Iterable[object]]]


def shown(value: object, spec: str = "") -> str:
    """Write a figure as Python's format does, but -0 as 0, and a share in per cent without its
    sign; `%` alone gives it two figures where it is small.
    """
    if spec.endswith("%"):
        share = 100.0 * float(str(value))
        digits = spec[1:-1] or ("0" if abs(share) >= 9.95 else "1")
        return f"{share:z.{digits}f}"
    return format(value, f"z{spec}" if spec.endswith("f") else spec)


def spans(document: str, text: str) -> list[Span]:
    """Return where the figures of a text stand in a document, whatever they are.

    Raises `ValueError` if the text is not there, or a first line several times.
    """
    if "{" not in text:
        if document.count(text + "\n") != 1:
            raise ValueError(f"there is no such table, or several: {text}")
        # Below the first line of a table is one of dashes.
        start = document.index(text) + len(text) + 1
        start = document.index("\n", start) + 1 if text.startswith("|") else start
        return [(start, start + re.search(r"\n(?:\n|```|$)", document[start:]).start())]
    parts = _FIELD.split(text)[::2]
    words = [r"\s+".join(map(re.escape, part.split(" "))) for part in parts]
    whole = rf"({NUMBER})(?![.,]?\d)"  # or the words behind it might match within a figure
    pattern = whole.join(words).replace(r"\s+\.\.\.\s+", _ANY)
    found = re.search(pattern, document)
    if found is None:
        raise ValueError(f"not in the document: {text}")
    return [found.span(number) for number in range(1, len(parts))]


def figures(text: str, values: Iterable[object]) -> list[str]:
    """Return the figures of a text as its formats write them; of a first line, what is below it."""
    specs = _FIELD.split(text)[1::2]
    if specs:
        return [shown(value, spec) for value, spec in zip(values, specs, strict=True)]
    return ["\n".join(map(str, values))]


def differences(document: str, held: Held) -> Iterator[str]:
    """Yield a line for each text whose figures are not what their file says."""
    for text, values in held.items():
        there = [document[start:end] for start, end in spans(document, text)]
        if there != (expected := figures(text, values())):
            yield f"{text}: stands {there}, should be {expected}"


def written(document: str, held: Held) -> str:
    """Return the document with every figure as its file says."""
    for text, values in held.items():
        pairs = zip(spans(document, text), figures(text, values()), strict=True)
        for (start, end), figure in reversed(list(pairs)):
            document = document[:start] + figure + document[end:]
    return document


def not_held(document: str, held: Held, definitions: Iterable[str]) -> list[str]:
    """Return the figures of a document that nothing holds, each with the words around it.

    Code and links are passed over. `definitions` are patterns of what is no result of measuring:
    sizes that were chosen, years, numbers of a definition.
    """
    # Lines may break between any two words.
    patterns = [_CODE, *(re.compile(each.replace(" ", r"\s+")) for each in definitions)]
    passed = [match.span() for pattern in patterns for match in pattern.finditer(document)]
    passed += [span for text in held for span in spans(document, text)]
    return [
        document[max(0, cited.start() - 40) : cited.end() + 30].replace("\n", " ")
        for cited in _CITED.finditer(document)
        if not any(start <= cited.start() < end for start, end in passed)
    ]
