"""Files that appear whole or not at all, with spool files for the parts that wait."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from harness.errors import UsageError
from harness.stored import atomic

BEGUN = ".raster-harness-"
"""What the names of folders begin with in which an output is being made; its name follows."""


class Output:
    """The folder an export is made in, beside its target; `publish` moves the results out.

    Use as a context manager: on an error everything is removed and the target stays as it was.

    forced : what is published outlives a power cut, too
    """

    def __init__(self, target: Path, *, forced: bool = False) -> None:
        self.target = target
        self._forced = forced
        self._stack = ExitStack()
        self._finished: list[tuple[Path, Path]] = []

    def __enter__(self) -> Output:
        parent = self.target.parent
        try:
            parent.mkdir(parents=True, exist_ok=True)
            prefix = f"{BEGUN}{self.target.stem[:40]}-"
            folder = tempfile.TemporaryDirectory(dir=parent, prefix=prefix)
        except OSError as error:
            reason = error.strerror or error
            raise UsageError(
                f"{parent.resolve()} cannot be written: {reason}; give another -o"
            ) from error
        self._folder = Path(self._stack.enter_context(folder))
        return self

    def __exit__(self, kind: Any, value: Any, trace: Any) -> None:
        self._stack.__exit__(kind, value, trace)

    def file(self, suffix: str = "", mode: str = "wb") -> IO[Any]:
        """Open the file that becomes the target, its name with `suffix` added, on `publish`."""
        final = self.target.with_name(self.target.name + suffix)
        made = self._folder / final.name
        self._finished.append((made, final))
        return self._opened(made, mode)

    def spool(self, name: str, mode: str = "w+b") -> IO[Any]:
        """Open a file for a part that waits until the rest is known."""
        return self._opened(self._folder / f"spool-{name}", mode)

    def path(self) -> Path:
        """Like `file`, for libraries that open files themselves."""
        made = self._folder / self.target.name
        self._finished.append((made, self.target))
        return made

    def publish(self) -> list[Path]:
        """Close everything and move the results to where they belong; returns their paths."""
        for stream in self._streams():
            stream.close()
        for made, final in self._finished:
            atomic.move(made, final, forced=self._forced)
        # the target itself first, then what lies beside it
        return sorted((final for _, final in self._finished), key=lambda path: len(path.name))

    def _opened(self, path: Path, mode: str) -> IO[Any]:
        encoding = None if "b" in mode else "utf-8"
        newline = None if "b" in mode else "\n"
        stream = path.open(mode, encoding=encoding, newline=newline)
        self._stack.callback(stream.close)
        self._open = [*self._streams(), stream]
        return stream

    def _streams(self) -> list[IO[Any]]:
        return getattr(self, "_open", [])
