"""Compilation of kernels, and the cache of compiled code; imports Numba."""

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
    cache_folder,
    compute_digest,
    find_module_name,
    is_trusted,
    is_trusted_folder,
    make_folder,
)


def make_dispatcher(source: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return a Numba dispatcher that stores a function's compiled code in `compiled_files`."""
    # Numba's C wrapper of a function is needed only to pass the function as an argument.
    compiled: Any = numba.njit(**{"no_cfunc_wrapper": True, **options})(source)
    compiled._cache = _Cache(source)
    compile_one = compiled.compile

    def compile_once(signature: Any) -> Any:
        with _lock_compilation(f"{compiled._cache.cache_path} {source.__qualname__} {signature}"):
            collects = gc.isenabled()
            gc.disable()  # garbage collection would take a tenth of the compile time
            try:
                return compile_one(signature)
            finally:
                if collects:
                    gc.enable()

    compiled.compile = compile_once
    return compiled


def compile_cfunc(signature: str, source: Callable[..., Any]) -> Any:
    """Compile a C function like `numba.cfunc`, and store the code in `compiled_files`."""
    callback: Any = CFunc(source, normalize_signature(signature), locals={}, options={})
    callback._cache = _Cache(source)
    callback.compile()
    return callback


class NotCompiledError(BaseException):
    """A kernel is not cached, and `forbid_compiling` is active."""


@contextmanager
def forbid_compiling() -> Iterator[None]:
    """In this context, calling a kernel that is not cached raises `NotCompiledError`."""
    _Files.forbid_compiling = True
    try:
        yield
    finally:
        _Files.forbid_compiling = False


@contextmanager
def _lock_compilation(key: str) -> Iterator[None]:
    """Let one process at a time compile a kernel: a second waits, then loads the cached code.

    The system unlocks when the process exits. If locking fails, both processes compile.
    """
    byte = int.from_bytes(hashlib.sha256(key.encode()).digest()[:4], "big") >> 1
    _set_lock("LOCK_EX", byte)
    try:
        yield
    finally:
        _set_lock("LOCK_UN", byte)


def _set_lock(operation: str, byte: int) -> None:
    if not _Files.forbid_compiling:
        with suppress(ImportError, OSError):
            import fcntl

            fcntl.lockf(_open_lock_file(), getattr(fcntl, operation), 1, byte)


@lru_cache(maxsize=1)
def _open_lock_file() -> IO[bytes]:
    """Return the lock file, which stays open: closing it would release all locks."""
    make_folder(cache_folder())
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    return os.fdopen(os.open(cache_folder().parent / "compiling.lock", flags, 0o644), "ab")


class _Cache(FunctionCache):
    """Numba's cache of a function, in a folder named by the module's digest."""

    def __init__(self, source: Callable[..., Any]) -> None:
        self._name = repr(source)
        self._py_func = source
        file = Path(source.__code__.co_filename).resolve()
        folder = cache_folder() / f"{find_module_name(file)}-{compute_digest(file)}"
        self._impl = self._impl_class.__new__(self._impl_class)
        # Numba needs a locator for the file's name in warnings; `save` makes the folder.
        self._impl._locator = SimpleNamespace(_py_file=str(file), ensure_cache_path=lambda: None)
        self._impl._lineno = source.__code__.co_firstlineno
        self._cache_path = str(folder)
        name = f"{source.__qualname__}-{self._impl._lineno}"
        self._cache_file = _Files(folder, name)  # type: ignore[assignment]
        self.enable()

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Load compiled code without initialising the compiler, which takes half a second."""
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            overload = self._load_overload(signature, target)
        if overload is None:
            resolve_kernels(self._py_func)
        return overload


def resolve_kernels(source: Callable[..., Any]) -> None:
    """Replace the kernels that a function uses, in its globals, by Numba's dispatchers."""
    names, codes = source.__globals__, [source.__code__]
    while codes:
        code = codes.pop()
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        for name in code.co_names:
            if hasattr(names.get(name), "compiled"):
                names[name] = names[name].compiled


class _Files:
    """The compiled overloads of a function, in files named by a digest of Numba's key."""

    forbid_compiling = False

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = re.sub(r"[<>]", "", name)

    def _get_path(self, key: Any) -> Path:
        short = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._name}.{short}.nbc"

    def load(self, key: Any) -> Any:
        """Return the data saved under `key`, or None if the file is missing or invalid."""
        try:
            descriptor = os.open(self._get_path(key), os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
            with os.fdopen(descriptor, "rb") as file:
                trusted = is_trusted(os.fstat(descriptor)) and is_trusted_folder(self._folder)
                if trusted and pickle.load(file) == repr(key):
                    return pickle.load(file)
        except (OSError, EOFError, pickle.UnpicklingError, ValueError, LookupError):
            pass
        except (AttributeError, ImportError):  # a pickle of another version of a package
            pass
        if self.forbid_compiling:
            raise NotCompiledError(self._name)
        return None

    def save(self, key: Any, data: Any) -> None:
        """Save `data` under `key`; if writing fails, the next process compiles again."""
        file = self._get_path(key)
        temporary = file.with_name(f"{file.name}.{uuid4().hex[:8]}")
        try:
            make_folder(self._folder)
            descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(pickle.dumps(repr(key)) + dumps(data))
            temporary.replace(file)
        except OSError:
            temporary.unlink(missing_ok=True)
