"""Compiled code on disk: a folder for each module, named by what it was made of.

Numba keeps compiled code beside the source, or where NUMBA_CACHE_DIR says, and notices a change in
a function's own file. But what a function calls is compiled into it, and lies in other files. So
here the folder's name holds a digest of the module's source and of all modules of ours that it
imports, directly or not: one edit makes the modules anew that it reaches, and no others. Below
that, a file's name holds the types that it was compiled for and the processor, with its features.

Nothing is ever overwritten with something else, so several versions of the sources, and several
processes that compile at once, share one place: NUMBA_CACHE_DIR, or the user's cache folder.
`raster-harness cache clear` removes old code.
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

SOURCES = Path(__file__).resolve().parents[2]
"""Where the packages lie beside each other."""

PACKAGES = ("triangulators", "harness", "scenes")

OLD_S = 30 * 24 * 3600.0
"""Seconds after which code of other sources that nobody loaded since counts as old."""

_FOLDER = re.compile(r"[\w.]+-[0-9a-f]{16}")
"""Name of a folder of compiled code: module and digest."""

_IMPORT = re.compile(
    r"^\s*(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([\w.]+))", re.MULTILINE
)


@lru_cache(maxsize=1)
def place() -> Path:
    """Return the folder of all compiled code of this Numba and Python."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else user_cache_path("raster-harness", appauthor=False)
    return folder / "compiled" / f"numba{version('numba')}-{sys.implementation.cache_tag}"


def is_trusted(info: os.stat_result) -> bool:
    """Whether only this user and the administrator own and may write a file or folder.

    Loading compiled code runs it. A folder such as /tmp, in which everybody may make files but
    change only their own, is trusted: each file in it is checked, too.
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
    """Whether a group is the user's own, of the same name and without other members."""
    import grp
    import pwd

    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(number)
    except KeyError:
        return False
    return group.gr_name == user.pw_name and not {*group.gr_mem} - {user.pw_name}


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, which others may not write whatever the umask is."""
    for missing in reversed([folder, *folder.parents]):
        if not missing.is_dir():
            missing.mkdir(mode=0o755, exist_ok=True)


@lru_cache(maxsize=1024)
def is_trusted_folder(folder: Path) -> bool:
    """Whether compiled code in a folder may be loaded; a warning says why not."""
    root = place().parents[1]
    try:
        untrusted = [
            each
            for each in (folder, *folder.parents)
            if each.is_relative_to(root) and (each.is_symlink() or not is_trusted(each.stat()))
        ]
    except FileNotFoundError:
        return True  # it will be made
    if untrusted:
        warnings.warn(
            f"{untrusted[-1]}: compiled code is not loaded (another user owns or may write the "
            "folder); set NUMBA_CACHE_DIR to a folder of yours",
            stacklevel=2,
        )
    return not untrusted


@lru_cache(maxsize=1024)
def digest(file: Path) -> str:
    """Return a digest of a module's source and of all modules of ours that it imports."""
    found = hashlib.sha256()
    for each in sorted(reached(file)):
        found.update(f"{dotted(each)}\n".encode() + _source(each) + b"\0")
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


def dotted(file: Path) -> str:
    """Return a module's name."""
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
    now = {f"{dotted(f)}-{digest(f)}" for p in PACKAGES for f in (SOURCES / p).rglob("*.py")}
    for folder in root.glob("numba*/*"):
        files = folder.iterdir() if _FOLDER.fullmatch(folder.name) else ()
        if not files or any(".nbc" not in file.name for file in files):
            continue  # somebody else's
        current = folder.parent == place() and folder.name in now
        if not current and time.time() - _last_use(folder) > OLD_S:
            yield folder


def _last_use(folder: Path) -> float:
    """Return when the code in a folder was last read, or made where the system does not note it."""
    times = [max(info.st_atime, info.st_mtime) for f in folder.iterdir() for info in [f.stat()]]
    return max(times, default=0.0)
