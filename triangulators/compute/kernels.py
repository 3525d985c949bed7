"""Kernels: functions compiled by Numba, and kept on disk by what they were made of.

Numba keeps compiled code beside the source, or where NUMBA_CACHE_DIR says, and notices a change in
a function's own file. But what a function calls is compiled into it, and lies in other files. So
here the folder's name holds a digest of the module's source and of all modules of ours that it
imports, directly or not: one edit makes the modules anew that it reaches, and no others. Below
that, a file's name holds the types that it was compiled for and the processor, with its features.

Nothing is ever overwritten with something else, so several versions of the sources, and several
processes that compile at once, share one place: NUMBA_CACHE_DIR, or the user's cache folder, or
where neither can be written, the folder of this file. `harness cache clear` removes old code.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, overload
from uuid import uuid4

import numba
from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from platformdirs import user_cache_path

F = TypeVar("F", bound=Callable[..., Any])

SOURCES = Path(__file__).resolve().parents[2]
"""Where the packages lie beside each other."""

PACKAGES = ("triangulators", "harness", "scenes")

OLD_S = 30 * 24 * 3600.0
"""Seconds after which code of other sources that nobody loaded since counts as old."""

_IMPORT = re.compile(
    r"^\s*(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([\w.]+))", re.MULTILINE
)


@overload
def njit(function: F) -> F: ...


@overload
def njit(**options: Any) -> Callable[[F], F]: ...


def njit(function: Any = None, **options: Any) -> Any:
    """Compile as `numba.njit` does, and keep what was compiled; with or without options."""

    def decorate(source: Any) -> Any:
        dispatcher: Any = numba.njit(**options)(source)
        dispatcher._cache = _Kept(source)
        return dispatcher

    return decorate if function is None else decorate(function)


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile as `numba.cfunc` does, and keep what was compiled."""

    def decorate(source: Callable[..., Any]) -> Any:
        callback: Any = CFunc(source, normalize_signature(signature), locals={}, options={})
        callback._cache = _Kept(source)
        callback.compile()
        return callback

    return decorate


class NotKept(BaseException):
    """A kernel would have to be compiled within `only_kept`."""


@contextmanager
def only_kept() -> Iterator[None]:
    """Compile nothing inside: a kernel that is not on disk raises `NotKept`."""
    _Files.only_kept = True
    try:
        yield
    finally:
        _Files.only_kept = False


class _Locator:
    """Says nothing of where code is kept: `_Files` does."""

    def __init__(self, folder: Path, file: Path) -> None:
        self._folder = folder
        self._py_file = str(file)  # Numba's warnings name it

    def get_cache_path(self) -> str:
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder when something is written, not when a function is declared."""


class _Kept(FunctionCache):
    """Numba's cache of one function, in a folder of its module's digest."""

    def __init__(self, source: Callable[..., Any]) -> None:
        self._name = repr(source)
        self._py_func = source
        file = Path(source.__code__.co_filename).resolve()
        folder = place() / f"{_dotted(file)}-{digest(file)}"
        self._impl = self._impl_class.__new__(self._impl_class)
        self._impl._locator = _Locator(folder, file)
        self._impl._lineno = source.__code__.co_firstlineno
        self._cache_path = str(folder)
        self._cache_file = _Files(folder, f"{source.__qualname__}-{self._impl._lineno}")
        self.enable()


class _Files:
    """The compiled forms of one function: a file each, named by a digest of Numba's key."""

    only_kept = False

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = re.sub(r"[<>]", "", name)

    def _file(self, key: Any) -> Path:
        short = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._name}.{short}.nbc"

    def load(self, key: Any) -> Any:
        """Return what was saved under `key`; None if nothing, or what cannot be read."""
        try:
            with self._file(key).open("rb") as file:
                if pickle.load(file) == repr(key):
                    return pickle.load(file)
        except (OSError, EOFError, pickle.UnpicklingError, ValueError, LookupError):
            pass
        except (AttributeError, ImportError):  # damage may name anything
            pass
        if self.only_kept:
            raise NotKept(self._name)
        return None

    def save(self, key: Any, data: Any) -> None:
        """Keep `data`; where nothing can be written it is compiled again next time."""
        file = self._file(key)
        part = file.with_name(f"{file.name}.{uuid4().hex[:8]}")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(pickle.dumps(repr(key)) + dumps(data))
            part.replace(file)
        except OSError:
            part.unlink(missing_ok=True)

    def flush(self) -> None:
        """Forget nothing: other processes use it."""


@lru_cache(maxsize=1)
def place() -> Path:
    """Return the folder of all compiled code of this Numba and Python."""
    version = f"numba{numba.__version__}-{sys.implementation.cache_tag}"
    chosen = vars(config)["CACHE_DIR"]
    folders = (
        [Path(chosen)]
        if chosen
        else [user_cache_path("raster-harness", appauthor=False), Path(__file__).parent]
    )
    for folder in folders:
        try:
            (folder / "compiled" / version).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder / "compiled" / version, os.W_OK):
            return folder / "compiled" / version
    return folders[0] / "compiled" / version


@lru_cache(maxsize=1024)
def digest(file: Path) -> str:
    """Return a digest of a module's source and of all modules of ours that it imports."""
    found = hashlib.sha256()
    for each in sorted(reached(file)):
        found.update(f"{_dotted(each)}\n".encode() + _source(each) + b"\0")
    return found.hexdigest()[:16]


def reached(file: Path) -> set[Path]:
    """Return a module's file and those of all modules of ours that it imports."""
    found, new = set(), {file}
    while new:
        each = new.pop()
        found.add(each)
        new |= _imported(each) - found
    return found


@lru_cache(maxsize=1024)
def _source(file: Path) -> bytes:
    return file.read_bytes()


@lru_cache(maxsize=1024)
def _imported(file: Path) -> frozenset[Path]:
    """Return the files of the modules of ours that one names in its import statements."""
    found = set()
    for base, names, plain in _IMPORT.findall(_source(file).decode()):
        module = base or plain
        if module.partition(".")[0] in PACKAGES:
            parts = [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
            found |= {found_file for part in parts if (found_file := _file_of(part))}
    return frozenset(found)


@lru_cache(maxsize=4096)
def _file_of(module: str) -> Path | None:
    path = SOURCES.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def _dotted(file: Path) -> str:
    inside = file.relative_to(SOURCES) if file.is_relative_to(SOURCES) else Path(file.name)
    return ".".join(inside.with_suffix("").parts)


def is_kept(module: str) -> bool:
    """Whether there is compiled code of a module's kernels as they are now."""
    file = _file_of(module)
    return file is not None and (place() / f"{module}-{digest(file)}").is_dir()


class Kept(NamedTuple):
    """What compiled code takes on disk.

    old : folders of other sources than these, of no use since `OLD_S`
    """

    folder: Path
    files: int
    file_bytes: int
    old: tuple[Path, ...]


def kept() -> Kept:
    """Return what is kept of all Numbas and Pythons."""
    root = place().parent
    files = [file.stat().st_size for file in root.rglob("*.nbc")]
    return Kept(root, len(files), sum(files), tuple(_old(root)))


def remove_old() -> int:
    """Remove compiled code that is of no use any more; return how many folders it was."""
    old = kept().old
    for folder in old:
        shutil.rmtree(folder, ignore_errors=True)
    return len(old)


def _old(root: Path) -> Iterator[Path]:
    now = {f"{_dotted(f)}-{digest(f)}" for p in PACKAGES for f in (SOURCES / p).rglob("*.py")}
    for folder in root.glob("*/*"):
        current = folder.parent == place() and folder.name in now
        if not current and time.time() - _last_use(folder) > OLD_S:
            yield folder


def _last_use(folder: Path) -> float:
    """Return when the code in a folder was last read, or made where the system does not note it."""
    times = [max(info.st_atime, info.st_mtime) for f in folder.iterdir() for info in [f.stat()]]
    return max(times, default=0.0)
