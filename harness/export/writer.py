"""What all writers share: output appears whole or not at all, and parts wait in spool files."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.export.indexed_mesh import Mesh
from harness.stored import atomic

BEGUN = ".raster-harness-"
"""What the names of folders begin with in which an output is being made; its name follows."""


@dataclass(frozen=True)
class About:
    """What a writer may say of the whole: units, origin of the polygons, and how to place them.

    crs : the reference system of the source's coordinates, as pyogrio names it, or None
    to_source : (n, 2) mesh coordinates to the source's own, where the polygons were projected
    """

    units: str
    triangulator: str
    credit: str = ""
    crs: str | None = None
    to_source: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None

    def in_source(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vertices in the source's coordinates, z as it is."""
        if self.to_source is None:
            return vertices
        return np.column_stack([self.to_source(vertices[:, :2]), vertices[:, 2:]])


class Writer(Protocol):
    """Takes the meshes of one export after another, then finishes the file."""

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""

    def finish(self) -> None:
        """Write what only the end knows; nothing is added after that."""


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


def append(target: IO[bytes], spool: IO[bytes]) -> None:
    """Copy a spooled part to the end of a file."""
    spool.seek(0)
    shutil.copyfileobj(spool, target, 1 << 20)


class AttributeTable:
    """Attributes beside a format that holds none: NAME.attributes.csv, one row per polygon."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._stream: IO[str] | None = None
        self._rows = 0

    def add(self, attributes: pd.DataFrame) -> None:
        """Append rows; `feature` numbers them through all batches."""
        if attributes.shape[1] == 0:
            return
        numbers = range(self._rows, self._rows + len(attributes))
        table = attributes.set_index(pd.Index(numbers, name="feature"))
        first = self._stream is None
        if self._stream is None:
            self._stream = self._output.file(".attributes.csv", "w")
        table.to_csv(self._stream, header=first)
        self._rows += len(attributes)


def plain(value: Any) -> Any:
    """A value that JSON can hold: numbers, text, booleans, None; NaN becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(each) for each in value]
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    return None if value is pd.NA or value is pd.NaT else str(value)
