"""Atomic output: files and folders are written under a temporary name, then renamed."""

import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any
from zlib import crc32

from harness.errors import StorageError, UsageError
from harness.machine import system

UNFINISHED = ".unfinished"  # suffix of the hidden temporary name next to the final one
LOCK = "lock"  # file in a temporary folder, locked while the folder is in use


def write(path: Path, content: bytes, *, forced: bool = False) -> None:
    """Write a file in an existing folder atomically; `forced` writes survive a power failure.

    After an OSError an existing file is unchanged.
    """
    temporary = path.with_name(f".{path.name}{UNFINISHED}")
    file = _open_locked(temporary)
    if file is None:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        file, temporary = os.fdopen(descriptor, "wb"), Path(name)
    try:
        with file:
            file.write(content)
            file.flush()
            temporary.chmod(0o666 & ~system.read_umask())
            if os.name != "nt":
                # Rename while the file is open and locked, so that no other process claims it.
                move(temporary, path, forced=forced)
        if os.name == "nt":  # Windows can only rename a file after it is closed
            move(temporary, path, forced=forced)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _open_locked(path: Path) -> IO[bytes] | None:
    """Open, lock and empty a file; None if in use, a link, another user's, or not lockable."""
    if os.name == "nt":  # an open file cannot be renamed
        return None
    with suppress(OSError):
        flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        file = os.fdopen(os.open(path, flags, 0o600), "wb")
        if system.lock_file(file.fileno(), wait=False, required=True):
            info = os.fstat(file.fileno())
            is_own = stat.S_ISREG(info.st_mode) and info.st_uid == os.geteuid()
            # Another process may have renamed or removed the file before this one locked it.
            if is_own and info.st_nlink == 1 and path.lstat().st_ino == info.st_ino:
                file.truncate(0)
                return file
        file.close()
    return None


def is_stream(file: Path) -> bool:
    """Return whether `file` is a pipe or this program's standard output."""
    try:
        return file.is_fifo() or os.path.samestat(file.stat(), os.fstat(1))
    except OSError:
        return False


def write_output(file: Path, text: str) -> None:
    """Replace `file` atomically, in a new folder if needed; write directly into a stream."""
    if is_stream(file):
        file.write_bytes(text.encode())
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    write(file, text.encode())


def read(file: Path) -> bytes:
    """Return a file's content; raise OSError for devices, pipes and sockets, possibly endless."""
    if file.exists() and not file.is_file():
        raise OSError(errno.EINVAL, f"{file.name} is not a regular file")
    return file.read_bytes()


MAX_READ_BYTES = 2**31  # maximum size of a file to read into memory


def open_inside(folder: Path, name: str, flags: int = os.O_RDONLY) -> int:
    """Open a regular file, for example "polygons/0123.npz", in a folder; return the descriptor.

    Raises OSError for links, paths outside the folder, large files and, if `flags` open the file
    for writing, hard links.
    """
    parts = name.split("/")
    if not all(parts) or {".", ".."} & {*parts} or "\\" in name or "\0" in name:
        raise OSError(errno.EINVAL, "outside the folder", name)
    file = folder.joinpath(*parts)
    for inner in file.parents[: len(parts) - 1]:
        if inner.is_symlink():
            raise OSError(errno.ELOOP, "a link; copy the target instead", str(inner))
    if file.is_symlink():
        raise OSError(errno.ELOOP, "a link; copy the target instead", str(file))
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
    """Return a file's content; raise as `open_inside` does."""
    with os.fdopen(open_inside(folder, name), "rb") as file:
        return file.read()


def move(source: Path, target: Path, *, forced: bool = False) -> None:
    """Rename a finished file within a file system.

    `forced` writes the content and then the name to the disk: after a power failure `target` is
    either the old or the new file, complete. After an OSError `target` is unchanged.
    """
    if target.exists() and not target.is_file() and not target.is_dir():
        raise FileExistsError(errno.EEXIST, "not a regular file", str(target))
    if forced:
        with source.open("rb+") as file:
            os.fsync(file.fileno())
    source.replace(target)
    if forced and hasattr(os, "O_DIRECTORY"):  # Windows cannot open folders
        descriptor = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def create_folder(path: Path, *, merge: bool = False) -> Iterator[Path]:
    """Yield a temporary folder that becomes `path` at the end of the block.

    After an exception the temporary folder is deleted. With `merge` the files are moved into an
    existing `path`, those in inner folders first.

    Raises UsageError if `path` exists (without `merge`), StorageError if another process is
    creating `path`.
    """
    if path.is_dir() and not any(path.iterdir()):
        path.rmdir()
    merge = merge and path.is_dir()
    if not merge and (path.exists() or path.is_symlink()):
        raise UsageError(f"{path}: already exists; give a new folder")
    parent = path.with_name(f".{path.name}{UNFINISHED}")
    parent.mkdir(parents=True, exist_ok=True)
    with (parent / LOCK).open("a") as lock:
        if not system.lock_file(lock.fileno(), wait=False):
            raise StorageError(
                f"{path}: another process is creating the folder; wait, or give a new folder"
            )
        temporary = parent / path.name
        shutil.rmtree(temporary, ignore_errors=True)
        try:
            temporary.mkdir()
            yield temporary
            if merge:
                _move_files(temporary, path)
                return
            try:
                temporary.rename(path)
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
                raise StorageError(
                    f"{path}: another process created the folder; give a new folder"
                ) from error
        finally:
            shutil.rmtree(parent, ignore_errors=True)


def _move_files(source: Path, target: Path) -> None:
    files = [file for file in source.rglob("*") if file.is_file()]
    for file in sorted(files, key=lambda file: (-len(file.parts), file)):
        moved = target / file.relative_to(source)
        moved.parent.mkdir(parents=True, exist_ok=True)
        move(file, moved)


TEMPORARY_PREFIX = ".raster-harness-"  # the target's name and a digest follow


def _remove_files(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.name != LOCK:
            path.unlink(missing_ok=True)


class Output:
    """Files of an export, written in a temporary folder next to `target`, the main file.

    Use as a context manager. Files that are not published by the end of the block are deleted.
    """

    def __init__(self, target: Path, *, forced: bool = False) -> None:
        self.target = target
        self._forced = forced
        self._streams = ExitStack()
        self._files: list[tuple[Path, Path]] = []

    def __enter__(self) -> "Output":
        parent = self.target.parent
        try:
            parent.mkdir(parents=True, exist_ok=True)
            self._folder = self._make_folder()
        except OSError as error:
            reason = error.strerror or error
            raise StorageError(
                f"{parent.resolve()}: cannot be written ({reason}); choose another -o"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._streams.close()
        _remove_files(self._folder)
        if self._lock:  # last, as the next process may then take the lock
            (self._folder / LOCK).unlink(missing_ok=True)
            self._lock.close()
        with suppress(OSError):
            self._folder.rmdir()

    def _make_folder(self) -> Path:
        name = self.target.name
        prefix = f"{TEMPORARY_PREFIX}{self.target.stem[:40]}-"
        folder = self.target.with_name(f"{prefix}{crc32(os.fsencode(name)):08x}")
        with suppress(FileExistsError):
            folder.mkdir(0o700)
        self._lock = None if folder.is_symlink() else _open_locked(folder / LOCK)
        if self._lock is None:
            return Path(tempfile.mkdtemp(dir=folder.parent, prefix=prefix))
        _remove_files(folder)
        return folder

    def open_published(self, suffix: str = "", mode: str = "wb") -> IO[Any]:
        """Open a temporary file that will be published as the target's path plus `suffix`."""
        target = self.target.with_name(self.target.name + suffix)
        temporary = self._folder / target.name
        self._files.append((temporary, target))
        return self._open(temporary, mode)

    def open_unpublished(self, name: str, mode: str = "w+b") -> IO[Any]:
        """Open a temporary file that is not published."""
        return self._open(self._folder / f"spool-{name}", mode)

    def make_published_path(self) -> Path:
        """Return a temporary path, published as the target, for libraries that open files."""
        temporary = self._folder / self.target.name
        self._files.append((temporary, self.target))
        return temporary

    def publish(self) -> list[Path]:
        """Close all files, move them to their final paths; return the paths, the target first."""
        self._streams.close()
        for temporary, target in self._files:
            move(temporary, target, forced=self._forced)
        return sorted((target for _, target in self._files), key=lambda path: len(path.name))

    def _open(self, path: Path, mode: str) -> IO[Any]:
        encoding, newline = (None, None) if "b" in mode else ("utf-8", "\n")
        return self._streams.enter_context(path.open(mode, encoding=encoding, newline=newline))
