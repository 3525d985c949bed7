"""Fenced blocks of Markdown pages: commands to run, and files to write.

A block of the language `sh` has commands. A comment in the line before a block changes its use:
`<!-- file: NAME -->` write the block to that file; `<!-- slow: why -->` run it in `make docs-full`
only; `<!-- not run: why -->` never run it; `<!-- exit: N -->` require exit code N.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.paths import ROOT

FENCE = re.compile(
    r"(?:^<!-- (?P<kind>file|slow|not run|exit): (?P<note>.*?) -->\n)?"
    r"^```(?P<language>\w+)\n(?P<content>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
COMMAND = re.compile(
    r"^(?:PYTHONPATH=\. )?\.venv/bin/(?:python -m harness|raster-harness) (?P<arguments>.*)$"
)


@dataclass(frozen=True)
class Block:
    """A fenced block, with the kind and note of the comment before it ("" without a comment)."""

    language: str
    content: str
    kind: str
    note: str

    @property
    def lines(self) -> list[str]:
        """The commands of a `sh` block, without empty lines."""
        return [line for line in self.content.splitlines() if line.strip()]

    @property
    def exit_code(self) -> int:
        return int(self.note) if self.kind == "exit" else 0


def blocks(page: Path) -> Iterator[Block]:
    for found in FENCE.finditer(page.read_text()):
        yield Block(found["language"], found["content"], found["kind"] or "", found["note"] or "")


def pages() -> list[Path]:
    """Return the pages whose commands are tested."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
