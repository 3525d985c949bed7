"""Compiled code on disk: a folder for each module, named by a digest of the sources.

Numba itself detects changes only in the file of a function. But compiled code contains all called
functions, also those of imported files. So the name of a folder contains a digest of the module's
source and of all modules of this project that it imports, directly or indirectly: an edit
recompiles exactly the edited module and those that import it. The name of a file in the folder
contains the function, and a digest of the argument types and the processor with its features.

No file is ever overwritten with different content, so several versions of the sources, and several
processes, share one folder: NUMBA_CACHE_DIR, or the user's cache folder.
"""

import hashlib
import os
import re
import shutil
import stat
import sys
import time
import warnings
from collections.abc import Iterator
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from platformdirs import user_cache_path

SOURCES = Path(__file__).resolve().parents[2]  # the folder with the project's packages
PACKAGES = ("triangulators", "harness", "scenes")  # packages whose imports a digest includes
MAX_UNUSED_S = 30 * 24 * 3600.0  # unused for longer, code of earlier sources counts as old
_FOLDER = re.compile(r"[\w.]+-[0-9a-f]{16}")  # name of a folder of compiled code: module and digest

_IMPORT = re.compile(
    r"^\s*(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([\w.]+))", re.MULTILINE
)


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Return the folder of the compiled code of this Numba and Python."""
    override = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(override) if override else user_cache_path("raster-harness", appauthor=False)
    return folder / "compiled" / f"numba{version('numba')}-{sys.implementation.cache_tag}"


def is_trusted(info: os.stat_result) -> bool:
    """Whether a file or folder is owned and writable by this user or the administrator only.

    Loading code runs it. In a sticky folder, such as /tmp, each file is checked as well.
    """
    if os.name != "posix":
        return True
    user, mode = os.geteuid(), info.st_mode
    if info.st_uid not in (user, 0):
        return False
    if stat.S_ISDIR(mode) and mode & stat.S_ISVTX:
        return True
    by_group = mode & stat.S_IWGRP and info.st_gid != 0 and not _is_private_group(info.st_gid)
    return not (mode & stat.S_IWOTH or by_group)


@lru_cache(maxsize=64)
def _is_private_group(number: int) -> bool:
    """Whether a group has the user's name and no further members."""
    import grp
    import pwd

    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(number)
    except KeyError:
        return False
    return group.gr_name == user.pw_name and not {*group.gr_mem} - {user.pw_name}


def make_folder(folder: Path) -> None:
    """Make a folder and missing parents, writable by the user only, with any umask."""
    for missing in reversed([folder, *folder.parents]):
        if not missing.is_dir():
            missing.mkdir(mode=0o755, exist_ok=True)


@lru_cache(maxsize=1024)
def is_trusted_folder(folder: Path) -> bool:
    """Whether compiled code in a folder may be loaded; warn with the reason if not."""
    root = cache_folder().parents[1]
    try:
        untrusted = [
            parent
            for parent in (folder, *folder.parents)
            if parent.is_relative_to(root)
            and (parent.is_symlink() or not is_trusted(parent.stat()))
        ]
    except FileNotFoundError:
        return True  # `make_folder` will create the folder for this user only
    if untrusted:
        warnings.warn(
            f"{untrusted[-1]}: compiled code in this folder is not loaded (it is a symbolic link, "
            "or another user owns or may write it); set NUMBA_CACHE_DIR to a folder of yours",
            stacklevel=2,
        )
    return not untrusted


@lru_cache(maxsize=1024)
def compute_digest(file: Path) -> str:
    """Return a digest of the sources of a module's file and of all modules that it imports."""
    sha = hashlib.sha256()
    for source in sorted(find_sources(file)):
        sha.update(f"{find_module_name(source)}\n".encode() + _read_source(source) + b"\0")
    return sha.hexdigest()[:16]


def find_sources(file: Path) -> set[Path]:
    """Return a module's file and those of all modules of the project that it imports."""
    sources, pending = set(), {file}
    while pending:
        source = pending.pop()
        sources.add(source)
        pending |= _find_imports(source) - sources
    return sources


@lru_cache(maxsize=1024)
def _read_source(file: Path) -> bytes:
    return file.read_bytes()


@lru_cache(maxsize=1024)
def _find_imports(file: Path) -> frozenset[Path]:
    sources = set()
    for base, names, plain in _IMPORT.findall(_read_source(file).decode()):
        module = base or plain
        if module.partition(".")[0] in PACKAGES:
            parts = [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
            sources |= {source for part in parts if (source := _find_file(part))}
    return frozenset(sources)


@lru_cache(maxsize=4096)
def _find_file(module: str) -> Path | None:
    path = SOURCES.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def find_module_name(file: Path) -> str:
    """Return the dotted name of the module in a file."""
    path = file.relative_to(SOURCES) if file.is_relative_to(SOURCES) else Path(file.name)
    return ".".join(path.with_suffix("").parts)


def is_cached(module: str) -> bool:
    """Whether compiled code of a module's current source is cached."""
    file = _find_file(module)
    return file is not None and (cache_folder() / f"{module}-{compute_digest(file)}").is_dir()


class CacheUsage(NamedTuple):
    """Disk usage of compiled code in a folder."""

    folder: Path
    files: int
    file_bytes: int
    old: tuple[Path, ...]  # folders of earlier sources, unused for `MAX_UNUSED_S`


def measure_cache() -> CacheUsage:
    """Return the disk usage of compiled code of all versions of Numba and Python."""
    root = cache_folder().parent
    files = [file.stat().st_size for file in root.rglob("*.nbc")]
    return CacheUsage(root, len(files), sum(files), tuple(_find_old_folders(root)))


def remove_old_code() -> int:
    """Remove the folders of `CacheUsage.old`; return their number."""
    old = measure_cache().old
    for folder in old:
        shutil.rmtree(folder, ignore_errors=True)
    return len(old)


def _find_old_folders(root: Path) -> Iterator[Path]:
    current_names = {
        f"{find_module_name(f)}-{compute_digest(f)}"
        for p in PACKAGES
        for f in (SOURCES / p).rglob("*.py")
    }
    for folder in root.glob("numba*/*"):
        files = folder.iterdir() if _FOLDER.fullmatch(folder.name) else ()
        if not files or any(".nbc" not in file.name for file in files):
            continue  # created by another program
        current = folder.parent == cache_folder() and folder.name in current_names
        if not current and time.time() - _find_last_use(folder) > MAX_UNUSED_S:
            yield folder


def _find_last_use(folder: Path) -> float:
    times = [max(info.st_atime, info.st_mtime) for f in folder.iterdir() for info in [f.stat()]]
    return max(times, default=0.0)
