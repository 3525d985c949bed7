"""Reads the commands and files out of a Markdown page, and runs them in order.

A fenced `sh` block holds commands. A comment right before a block says what is special about it:
`<!-- file: NAME -->` the block is written to that file; `<!-- slow: why -->` it is run by
`make docs-full` only; `<!-- not run: why -->` never; `<!-- exit: N -->` it must end with that code.
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
    """A fenced block: its language, its content, and what the comment before it says."""

    language: str
    content: str
    kind: str
    note: str

    @property
    def lines(self) -> list[str]:
        """The commands of a `sh` block."""
        return [line for line in self.content.splitlines() if line.strip()]

    @property
    def exit_code(self) -> int:
        """What the block's last command must end with."""
        return int(self.note) if self.kind == "exit" else 0


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page in order."""
    for found in FENCE.finditer(page.read_text()):
        yield Block(found["language"], found["content"], found["kind"] or "", found["note"] or "")


def pages() -> list[Path]:
    """Return every page a reader may follow."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
