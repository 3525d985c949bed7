"""Many files as parts: runs of rows that are read and dealt with apart, each with a content key."""

import contextlib
import ctypes
import glob
import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import psutil

from harness.errors import UsageError, of_system
from harness.machine import environment
from scenes import SceneError
from scenes.slices import Slices, cut


@dataclass(frozen=True)
class Part:
    """Rows of a file.

    key : 16 hexadecimal digits of what its result depends on: input, rows, options and code
    path : the file, absolute
    identity : 16 hexadecimal digits of the file's content
    rows : the first and the one after the last; None for all of them
    size : how many; 0 where that is not known
    """

    key: str
    path: str
    identity: str
    rows: tuple[int, int] | None
    size: int

    @property
    def source(self) -> str:
        """The file's name."""
        return Path(self.path).name

    @property
    def label(self) -> str:
        """Name for messages."""
        if self.rows is None:
            return self.path
        return f"{self.path}, rows {self.rows[0]} to {self.rows[1] - 1}"


@dataclass
class Cut:
    """What is to be done.

    parts : in the order of the files and of their rows
    unreadable : file to reason
    pruned : rows that are left out because no row of their row group meets the condition
    repeated : a file to an earlier one that has the same content
    """

    parts: list[Part] = field(default_factory=list)
    unreadable: dict[str, str] = field(default_factory=dict)
    pruned: int = 0
    repeated: dict[str, str] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Rows of all parts; 0 where that is not known."""
        sizes = [part.size for part in self.parts]
        return sum(sizes) if all(sizes) else 0


BESIDE = {".shx", ".dbf", ".prj", ".cpg", ".qpj", ".sbn", ".sbx", ".qix"}
"""Parts of a Shapefile, which is read by its .shp."""


def files(pattern: str) -> list[Path]:
    """Return the files that a name, a folder or a pattern such as 'parts/*.parquet' stands for.

    Raises
    ------
    UsageError
        if there is none
    """
    place = Path(pattern)
    if place.is_dir() and not place.suffix:
        found = sorted(each for each in place.iterdir() if not each.name.startswith("."))
        shapes = {each.stem for each in found if each.suffix.lower() == ".shp"}
        found = [
            each for each in found if each.suffix.lower() not in BESIDE or each.stem not in shapes
        ]
    elif place.exists():
        found = [place]
    else:
        # Path.glob takes no absolute pattern
        found = sorted(map(Path, glob.glob(pattern, recursive=True)))  # noqa: PTH207
    if not found:
        raise UsageError(f"there is no file {pattern}: check the path, and quote a pattern")
    return [each.absolute() for each in found]


def by_rows(path: str, options: Mapping[str, Any]) -> Slices:
    """Cut a file of polygons; `layer` and `where` of the options are those of the file."""
    return cut(path, options.get("layer"), options.get("where"))


def cut_all(
    found: Sequence[Path],
    options: Mapping[str, Any],
    code: str,
    by: Callable[[str, Mapping[str, Any]], Slices] = by_rows,
) -> Cut:
    """Cut files into parts; one that cannot be read is named, and the others go on.

    options : what a result depends on beside the input
    code : the version of the code
    by : cuts a file; raises SceneError or OSError where it cannot be read
    """
    result = Cut(repeated=_repeated(found))
    seen: Counter[str] = Counter()
    for file in found:
        try:
            slices = by(str(file), options)
        except (SceneError, OSError) as error:
            result.unreadable[str(file)] = str(error)
            continue
        result.pruned += slices.pruned
        for rows, size in zip(slices.rows, slices.sizes, strict=True):
            content = json.dumps([slices.identity, rows, dict(options), code], sort_keys=True)
            # the same file twice gives the same part twice, not one
            again = seen[content]
            seen[content] += 1
            key = hashlib.sha256(f"{content} {again}".encode()).hexdigest()[:16]
            result.parts.append(Part(key, str(file), slices.identity, rows, size))
    return result


def _repeated(found: Sequence[Path]) -> dict[str, str]:
    """Return files with the content of an earlier one; only those of one size are read for it."""
    sizes = {file: file.stat().st_size for file in found if file.is_file()}
    often = Counter(sizes.values())
    first: dict[str, str] = {}
    repeated = {}
    for file, size in sizes.items():
        if often[size] > 1 and os.access(file, os.R_OK):
            with file.open("rb") as content:
                digest = hashlib.file_digest(content, "sha256").hexdigest()
            earlier = first.setdefault(digest, str(file))
            if earlier != str(file):
                repeated[str(file)] = earlier
    return repeated


_code_version = cache(environment.code_version)

AT_A_TIME = 12_500
"""Rows that are in memory at a time; a process has 450 MB with them."""


@dataclass(frozen=True)
class Done:
    """A part that is in the folder.

    counts : [kind, reason, polygons] of what was dropped, repaired or failed
    proven : polygons whose optimum is proven
    certified : fields of `Certified`, where that was asked for
    about : the part's key, input and options, and the code's version
    seconds, cpu_seconds, peak_bytes : what it took, by the clock and of the cores, and the most
        memory its process had; None where the file was there already
    notes : what was done to the file as a whole
    left_out : (kind, which, reason) of what was dropped or failed, the first of each
    """

    polygons: int
    vertices: int
    triangles: int
    proven: int
    counts: list[list[Any]]
    certified: dict[str, Any] | None
    about: dict[str, Any]
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_bytes: int | None = None
    notes: list[str] = field(default_factory=list)
    left_out: list[tuple[str, str, str]] = field(default_factory=list)

    def counted(self) -> Counter[tuple[str, str]]:
        """Return `counts` by kind and reason."""
        return Counter({(kind, reason): count for kind, reason, count in self.counts})


def about(part: Part, options: Mapping[str, Any], code: str) -> dict[str, Any]:
    """Return what a part's file says of where it comes from."""
    rows = None if part.rows is None else list(part.rows)
    return {
        "key": part.key,
        "source": part.source,
        "identity": part.identity,
        "rows": rows,
        "options": dict(options),
        "code": code,
    }


def lasting(done: Done) -> dict[str, Any]:
    """Return what the file says: nothing that differs from one execution to the next."""
    passing = ("seconds", "cpu_seconds", "peak_bytes")
    return {name: value for name, value in asdict(done).items() if name not in passing}


def make_part(
    place: Path, code: str, read: Callable[[Path], Done | None], make: Callable[[], Done]
) -> Done:
    """Make a part's file at `place`, unless it is there; returns what it says, and what it took.

    read : what a file says of itself; None where it is no such file, or is damaged
    make : makes the file

    Raises
    ------
    UsageError
        if the part cannot be read or the file cannot be written, or this process has other code
    """
    begun, used = time.perf_counter(), time.process_time()
    require_code(code)
    if (there := read(place)) is not None:
        return there
    try:
        done = make()
    except SceneError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        if (there := read(place)) is not None:  # somebody else has made it meanwhile
            return there
        raise UsageError(of_system(error)) from error
    release()
    seconds, cpu_seconds = time.perf_counter() - begun, time.process_time() - used
    return replace(done, seconds=seconds, cpu_seconds=cpu_seconds, peak_bytes=peak())


def require_code(code: str) -> None:
    """Raise UsageError if this process has other code than whoever gave the task."""
    own = _code_version()
    if own != code:
        raise UsageError(
            f"this worker has another version of raster-harness ({own}, not {code}): "
            "install the same on all machines"
        )


def release() -> None:
    """Give memory back to the system that libraries keep for later."""
    with contextlib.suppress(ImportError):
        import pyarrow as pa

        pa.default_memory_pool().release_unused()
    with contextlib.suppress(OSError, AttributeError):  # glibc alone has it
        ctypes.CDLL(None).malloc_trim(0)


def peak() -> int:
    """Return the most memory in bytes that this process ever had."""
    used = psutil.Process().memory_info()
    try:
        import resource
    except ImportError:  # Windows
        return int(getattr(used, "peak_wset", used.rss))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
