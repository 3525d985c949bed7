"""Files and folders that appear whole or not at all: made under another name, then renamed."""

import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from harness.errors import StorageError, UsageError
from harness.machine import system

UNFINISHED = ".unfinished"
"""Suffix of the hidden folder, beside its place, in which a folder is made."""


def write(place: Path, content: bytes, *, forced: bool = False) -> None:
    """Write a file in an existing folder, whole or not at all.

    forced : it outlives a power cut, too

    Raises
    ------
    OSError
        if it cannot be written; what was there stays
    """
    descriptor, temporary = tempfile.mkstemp(dir=place.parent, prefix=f".{place.name}.")
    made = Path(temporary)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        made.chmod(0o666 & ~system.umask())
        move(made, place, forced=forced)
    except BaseException:
        made.unlink(missing_ok=True)
        raise


def read(file: Path) -> bytes:
    """Return the content of a file that was stored.

    Raises
    ------
    OSError
        if it cannot be read, or is a device, a pipe or a socket, which might never end
    """
    if file.exists() and not file.is_file():
        raise OSError(errno.EINVAL, f"{file.name} is no regular file")
    return file.read_bytes()


MAX_READ_BYTES = 2**31
"""Size of the largest file that is read into memory at once."""


def open_inside(folder: Path, name: str, flags: int = os.O_RDONLY) -> int:
    """Return a descriptor of the regular file `name` in a folder; no link below it is followed.

    name : "run.json" or "polygons/0123.npz"

    Raises
    ------
    OSError
        if there is none, or it is a link, lies outside, is too large or not a regular file; or, if
        it is to be written, has another name, too (a hard link)
    """
    parts = name.split("/")
    if not all(parts) or {".", ".."} & {*parts} or "\\" in name or "\0" in name:
        raise OSError(errno.EINVAL, "it lies outside of the folder", name)
    file = folder.joinpath(*parts)
    for inner in file.parents[: len(parts) - 1]:
        if inner.is_symlink():
            raise OSError(errno.ELOOP, "a link, which is not followed", str(inner))
    if file.is_symlink():
        raise OSError(errno.ELOOP, "a link, which is not followed", str(file))
    no_wait = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(file, flags | no_wait | system.BINARY, 0o666)
    info = os.fstat(descriptor)
    problem = ""
    if not stat.S_ISREG(info.st_mode):
        problem = "not a regular file"
    elif flags & os.O_WRONLY and info.st_nlink > 1:
        problem = "a hard link: other names of the file would change; copy the folder"
    elif info.st_size > MAX_READ_BYTES:
        problem = f"larger than {MAX_READ_BYTES >> 30} GiB"
    if problem:
        os.close(descriptor)
        raise OSError(errno.EINVAL, problem, str(file))
    return descriptor


def read_inside(folder: Path, name: str) -> bytes:
    """Return the content of a file of a folder; raises as `open_inside`."""
    with os.fdopen(open_inside(folder, name), "rb") as file:
        return file.read()


def move(made: Path, place: Path, *, forced: bool = False) -> None:
    """Rename a finished file to where it belongs, in the same file system.

    forced : first its content, then its name is forced to the disk, so that a name that is there
        after a power cut has all its content

    Raises
    ------
    OSError
        if the disk is full or gone, or `place` is a device, a pipe or a socket; nothing is there
        then but what was before
    """
    if place.exists() and not place.is_file() and not place.is_dir():
        raise FileExistsError(errno.EEXIST, "it is no regular file", str(place))
    if forced:
        with made.open("rb+") as file:
            os.fsync(file.fileno())
    made.replace(place)
    if forced and hasattr(os, "O_DIRECTORY"):  # Windows opens no folders
        descriptor = os.open(place.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def folder(place: Path, *, added: bool = False) -> Iterator[Path]:
    """Give a folder of the same name to make everything in; at the end it is at `place`.

    What a process that was killed has left is thrown away.

    added : if a folder is there already, the files are moved into it one by one, each whole, those
        of inner folders first

    Raises
    ------
    StorageError, UsageError
        if there is something at `place` already, or another process is making it
    OSError
        if it cannot be written; nothing is at `place` then
    """
    if place.is_dir() and not any(place.iterdir()):
        place.rmdir()
    added = added and place.is_dir()
    if not added and (place.exists() or place.is_symlink()):
        raise UsageError(f"{place} is there already: give a folder that is not there yet")
    around = place.with_name(f".{place.name}{UNFINISHED}")
    around.mkdir(parents=True, exist_ok=True)
    with (around / "lock").open("a") as lock:
        if not system.lock(lock.fileno(), wait=False):
            raise StorageError(f"{place} is in use: another process is making it")
        made = around / place.name
        shutil.rmtree(made, ignore_errors=True)
        try:
            made.mkdir()
            yield made
            if added:
                _add(made, place)
                return
            try:
                made.rename(place)
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
                raise StorageError(f"{place} is there already: another process made it") from error
        finally:
            shutil.rmtree(around, ignore_errors=True)


def _add(made: Path, place: Path) -> None:
    """Move all files below a folder to the same places below another; the outermost last."""
    files = [file for file in made.rglob("*") if file.is_file()]
    for file in sorted(files, key=lambda file: (-len(file.parts), file)):
        target = place / file.relative_to(made)
        target.parent.mkdir(parents=True, exist_ok=True)
        move(file, target)


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
        self._streams = ExitStack()
        self._finished: list[tuple[Path, Path]] = []

    def __enter__(self) -> "Output":
        parent = self.target.parent
        try:
            parent.mkdir(parents=True, exist_ok=True)
            prefix = f"{BEGUN}{self.target.stem[:40]}-"
            self._around = tempfile.TemporaryDirectory(dir=parent, prefix=prefix)
        except OSError as error:
            reason = error.strerror or error
            raise StorageError(
                f"{parent.resolve()} cannot be written: {reason}; give another -o"
            ) from error
        self._folder = Path(self._around.name)
        return self

    def __exit__(self, *_: object) -> None:
        self._streams.close()
        self._around.cleanup()

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
        self._streams.close()
        for made, final in self._finished:
            move(made, final, forced=self._forced)
        # the target itself first, then what lies beside it
        return sorted((final for _, final in self._finished), key=lambda path: len(path.name))

    def _opened(self, path: Path, mode: str) -> IO[Any]:
        encoding, newline = (None, None) if "b" in mode else ("utf-8", "\n")
        return self._streams.enter_context(path.open(mode, encoding=encoding, newline=newline))
