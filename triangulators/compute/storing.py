"""How kernels are compiled, and how what was compiled is written and read; this imports Numba."""

import gc
import hashlib
import os
import pickle
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import CodeType, SimpleNamespace
from typing import IO, Any
from uuid import uuid4

import numba
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from triangulators.compute.compiled_files import (
    digest,
    dotted,
    is_trusted,
    is_trusted_folder,
    make_folder,
    place,
)


def dispatcher(source: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return what `numba.njit` makes of a function, and keep what it compiles."""
    # Nobody passes one as a function to another, for which Numba would make a third entry to each.
    made: Any = numba.njit(**{"no_cfunc_wrapper": True, **options})(source)
    made._cache = _Kept(source)
    compile_one = made.compile

    def compile_once(signature: Any) -> Any:
        with _alone(f"{made._cache.cache_path} {source.__qualname__} {signature}"):
            collects = gc.isenabled()
            gc.disable()  # it would go through all that is being made, for a tenth of the time
            try:
                return compile_one(signature)
            finally:
                if collects:
                    gc.enable()

    made.compile = compile_once
    return made


def cfunc(signature: str, source: Callable[..., Any]) -> Any:
    """Compile as `numba.cfunc` does, and keep what was compiled."""
    callback: Any = CFunc(source, normalize_signature(signature), locals={}, options={})
    callback._cache = _Kept(source)
    callback.compile()
    return callback


class NotCompiledError(BaseException):
    """A kernel would have to be compiled within `only_kept`."""


@contextmanager
def only_kept() -> Iterator[None]:
    """Compile nothing inside: a kernel that is not on disk raises `NotCompiledError`."""
    _Files.only_kept = True
    try:
        yield
    finally:
        _Files.only_kept = False


@contextmanager
def _alone(what: str) -> Iterator[None]:
    """Let no other process compile the same: who comes second waits, and loads it.

    A lock on one byte of a file, which the system takes from a process that ends. Where it cannot
    be had, both compile.
    """
    byte = int.from_bytes(hashlib.sha256(what.encode()).digest()[:4], "big") >> 1
    _lock("LOCK_EX", byte)
    try:
        yield
    finally:
        _lock("LOCK_UN", byte)


def _lock(way: str, byte: int) -> None:
    if not _Files.only_kept:
        with suppress(ImportError, OSError):
            import fcntl

            fcntl.lockf(_lock_file(), getattr(fcntl, way), 1, byte)


@lru_cache(maxsize=1)
def _lock_file() -> IO[bytes]:
    """Stays open: closing it would give up all its locks."""
    make_folder(place())
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    return os.fdopen(os.open(place().parent / "compiling.lock", flags, 0o644), "ab")


class _Kept(FunctionCache):
    """Numba's cache of one function, in a folder of its module's digest."""

    def __init__(self, source: Callable[..., Any]) -> None:
        self._name = repr(source)
        self._py_func = source
        file = Path(source.__code__.co_filename).resolve()
        folder = place() / f"{dotted(file)}-{digest(file)}"
        self._impl = self._impl_class.__new__(self._impl_class)
        # Numba's warnings name the file; the folder is made when something is written.
        self._impl._locator = SimpleNamespace(_py_file=str(file), ensure_cache_path=lambda: None)
        self._impl._lineno = source.__code__.co_firstlineno
        self._cache_path = str(folder)
        name = f"{source.__qualname__}-{self._impl._lineno}"
        self._cache_file = _Files(folder, name)  # type: ignore[assignment]
        self.enable()

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Load compiled code, which needs Numba's runtime, but none of what compiling needs.

        That would be another half second, of which SciPy is a part.
        """
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(signature, target)
        if found is None:
            name_compiled(self._py_func)
        return found


def name_compiled(source: Callable[..., Any]) -> None:
    """Let the names of kernels in a function, which is to be compiled, mean what Numba knows."""
    names, codes = source.__globals__, [source.__code__]
    while codes:
        code = codes.pop()
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
        for name in code.co_names:
            if hasattr(names.get(name), "compiled"):
                names[name] = names[name].compiled


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
            descriptor = os.open(self._file(key), os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
            with os.fdopen(descriptor, "rb") as file:
                trusted = is_trusted(os.fstat(descriptor)) and is_trusted_folder(self._folder)
                if trusted and pickle.load(file) == repr(key):
                    return pickle.load(file)
        except (OSError, EOFError, pickle.UnpicklingError, ValueError, LookupError):
            pass
        except (AttributeError, ImportError):  # damage may name anything
            pass
        if self.only_kept:
            raise NotCompiledError(self._name)
        return None

    def save(self, key: Any, data: Any) -> None:
        """Keep `data`; where nothing can be written it is compiled again next time."""
        file = self._file(key)
        part = file.with_name(f"{file.name}.{uuid4().hex[:8]}")
        try:
            make_folder(self._folder)
            descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(pickle.dumps(repr(key)) + dumps(data))
            part.replace(file)
        except OSError:
            part.unlink(missing_ok=True)
