"""A data set of many files, processed part by part into a folder of results.

A part is a range of rows that is processed independently. The folder records which parts are done:
a part's file is renamed to a content key when the file is complete and on the disk.
`manifest.json` is derived from these files.
"""

import contextlib
import ctypes
import glob
import hashlib
import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from harness import atomic
from harness.atomic import TEMPORARY_PREFIX
from harness.errors import (
    HarnessError,
    IncompatibleRunsError,
    InputError,
    StorageError,
    UsageError,
    format_os_error,
)
from harness.machine import environment
from harness.progress import Reporter
from harness.results.run_folder import translate_errors
from harness.scaling.executors import Executor
from scenes import SceneError
from scenes.slices import Slices, is_tile_folder

MANIFEST = "manifest.json"
LEFT_OUT = "left_out.csv"
VERSION = 1

CHUNK_ROWS = 12_500  # in memory at a time, for which a process takes 450 MB
SHAPEFILE_PARTS = (
    *(".shx", ".dbf", ".prj", ".cpg", ".qpj", ".sbn", ".sbx", ".qix"),
    *(".shp.xml", ".qmd"),  # descriptions by ArcGIS and QGIS
)
"""Suffixes of a Shapefile's files other than .shp."""

_code_version = cache(environment.hash_code)


@dataclass(frozen=True)
class FilePart:
    """A range of rows of a file.

    about : the file's name (`source`), a digest of its content (`identity`), `rows`, `options` and
    `code`; and `key`, 16 hexadecimal digits of a hash of all of these except the name
    """

    path: str  # absolute
    rows: tuple[int, int] | None  # (first, last + 1), or None for all rows
    size: int  # number of rows, or 0 if unknown
    about: dict[str, Any]

    @property
    def key(self) -> str:
        """Content key, and name of the part's file."""
        return str(self.about["key"])

    @property
    def label(self) -> str:
        """Name for messages."""
        if self.rows is None:
            return self.path
        return f"{self.path}, rows {self.rows[0]} to {self.rows[1] - 1}"


@dataclass(frozen=True)
class PartResult:
    """Result of a part whose file is in the folder."""

    polygons: int
    triangles: int
    proven: int  # number of polygons with a proven optimum
    counts: list[list[Any]]  # [kind, reason, number] of dropped, repaired and failed polygons
    certified: dict[str, Any] | None  # fields of `Certified`, or None if not requested
    about: dict[str, Any]  # identity of the part, as in `FilePart`
    notes: list[str] = field(default_factory=list)  # messages about the file
    left_out: list[tuple[str, str, str]] = field(default_factory=list)  # (kind, polygon, reason)
    seconds: float | None = None  # None if the file existed already


@dataclass(frozen=True)
class PartWork:
    """Processing of a part of a data set; a subclass's fields are options that affect results."""

    title: ClassVar[str]
    unit: ClassVar[str] = "footprints"
    suffix: ClassVar[str]

    def list_slices(self, path: str) -> Slices:
        """Return the slices of a file; raise SceneError or OSError if the file is unreadable."""
        raise NotImplementedError

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Write a part's file atomically; a repetition must give the same content."""
        raise NotImplementedError

    @staticmethod
    def read_result(file: Path) -> PartResult | None:
        """Return the result in a part's file, or None if invalid."""
        raise NotImplementedError

    def process(self, part: FilePart, out: str, threads: int | None = 1) -> PartResult:
        """Write a part's file into the folder `out`, unless the file exists; return the result."""
        begun = time.perf_counter()
        version, code = _code_version(), part.about["code"]
        if version != code:
            raise IncompatibleRunsError(
                f"this worker has another version of raster-harness ({version}, not {code}): "
                "install the same version on all machines"
            )
        path = Path(out) / f"{part.key}{self.suffix}"
        if (existing := self.read_result(path)) is not None:
            return existing
        try:
            done = self.write_part(part, path, threads)
        except SceneError as error:
            raise InputError(str(error)) from error
        except OSError as error:
            if (existing := self.read_result(path)) is not None:  # written by another process
                return existing
            raise StorageError(format_os_error(error)) from error
        _release_memory()
        return replace(done, seconds=time.perf_counter() - begun)


def _release_memory() -> None:
    with contextlib.suppress(ImportError):
        import pyarrow as pa

        pa.default_memory_pool().release_unused()
    with contextlib.suppress(OSError, AttributeError):  # only glibc has `malloc_trim`
        ctypes.CDLL(None).malloc_trim(0)


def list_files(pattern: str) -> list[Path]:
    """Return the absolute paths of a file, a folder's files, or a pattern's (parts/*.parquet).

    A folder of map tiles counts as one file. Raises UsageError if no file matches.
    """
    path = Path(pattern)
    if path.is_dir() and not path.suffix and not is_tile_folder(pattern):
        paths = sorted(file for file in path.iterdir() if not file.name.startswith("."))
        shapes = {file.stem.lower() for file in paths if file.suffix.lower() == ".shp"}
        parts = {f"{stem}{suffix}" for stem in shapes for suffix in SHAPEFILE_PARTS}
        paths = [file for file in paths if file.name.lower() not in parts]
    elif path.exists():
        paths = [path]
    else:
        # `Path.glob` raises an error for an absolute pattern
        paths = sorted(map(Path, glob.glob(pattern, recursive=True)))  # noqa: PTH207
    if not paths:
        raise UsageError(f"{pattern}: no such file; check the path, and quote a pattern")
    return [path.absolute() for path in paths]


@dataclass
class Summary:
    """State of the folder after a command."""

    parts: int
    parts_done: int  # number of parts with a result
    fresh: int  # parts that this command processed
    polygons: int
    triangles: int
    proven: int
    counts: Counter[tuple[str, str]]  # dropped, repaired and failed polygons by (kind, reason)
    set_aside: dict[str, str]  # reason by file or part that has no result
    pruned: int  # rows skipped because the row group's statistics exclude the condition
    seconds: float  # wall time of this command
    certified: list[dict[str, Any]]  # fields of `Certified` of each part that has them
    left_out: list[tuple[str, str, str, str]]  # file, kind, polygon, reason: first of each part


class Dataset:
    """Files, cut into parts, and the folder of results, made if missing.

    parts : in the order of files and rows; done : results in the folder, by the part's key

    Raises HarnessError if no file can be read, or the folder is unusable or has other results.
    """

    def __init__(self, pattern: str, out: Path, work: PartWork) -> None:
        self.out = out.absolute()
        self.work = work
        self.parts: list[FilePart] = []
        self.done: dict[str, PartResult] = {}
        self._about = {
            "options": json.loads(json.dumps(asdict(work))),
            "code": environment.hash_code(),
        }
        self._unreadable: dict[str, str] = {}
        self._pruned = 0
        paths = list_files(pattern)
        with translate_errors(self.out, "run the same command again"):
            self.out.mkdir(parents=True, exist_ok=True)
        self._cut_files(paths)
        if not self.parts and self._unreadable:
            raise InputError(next(iter(self._unreadable.values())))
        self._read_results({part.key for part in self.parts})

    def _cut_files(self, paths: Iterable[Path]) -> None:
        seen: Counter[str] = Counter()
        for file in paths:
            try:
                slices = self.work.list_slices(str(file))
            except (SceneError, OSError) as error:
                self._unreadable[str(file)] = str(error)
                continue
            self._pruned += slices.pruned
            for rows, size in zip(slices.rows, slices.sizes, strict=True):
                content = json.dumps([slices.identity, rows, self._about], sort_keys=True)
                # Equal parts, as of a copied file, need different keys.
                repetition = seen[content]
                seen[content] += 1
                about = {
                    "key": hashlib.sha256(f"{content} {repetition}".encode()).hexdigest()[:16],
                    "source": file.name,
                    "identity": slices.identity,
                    "rows": None if rows is None else list(rows),
                }
                self.parts.append(FilePart(str(file), rows, size, about | self._about))

    def _read_results(self, part_keys: set[str]) -> None:
        identities: dict[str, set[str]] = {}
        for part in self.parts:
            identities.setdefault(part.about["source"], set()).add(part.about["identity"])
        for file in sorted(self.out.glob(f"*{self.work.suffix}")):
            done = self.work.read_result(file)
            if done is None and file.stem in part_keys:
                continue  # damaged: processed again
            if done is None:
                raise UsageError(
                    f"{file} was not written by this command: give another folder with -o"
                )
            about = done.about
            problem = ""
            if about["options"] != self._about["options"]:
                problem = "written with other options"
            elif about["code"] != self._about["code"]:
                problem = "written by another version of this program"
            elif about["identity"] not in identities.get(about["source"], {about["identity"]}):
                problem = f"of an older version of {about['source']}"
            if problem:
                raise IncompatibleRunsError(
                    f"{self.out} has results {problem}; give another folder with -o"
                )
            if about["key"] in part_keys:
                self.done[about["key"]] = done

    @property
    def missing(self) -> list[FilePart]:
        """Parts without a result."""
        return [part for part in self.parts if part.key not in self.done]

    @property
    def keys_done(self) -> list[str]:
        """Keys of the parts with a result."""
        return [part.key for part in self.parts if part.key in self.done]

    def complete(
        self, executor: Executor, reporter: Reporter, on_success: Callable[[], None] = lambda: None
    ) -> Summary:
        """Process the missing parts, write the manifest, and return a summary.

        The manifest is written even if parts fail or the command is interrupted.
        """
        begun, before = time.perf_counter(), len(self.done)
        missing = {part.key: part for part in self.missing}
        arguments = str(self.out), executor.threads_per_task
        tasks = {key: partial(self.work.process, part, *arguments) for key, part in missing.items()}
        total = sum(part.size or 1 for part in missing.values())
        unit = self.work.unit if all(part.size for part in missing.values()) else "parts"
        set_aside: dict[str, str] = {}
        amount = 0
        try:
            if missing:
                with reporter.stage(self.work.title, total, unit) as stage:
                    for key, answer in executor.run_all(tasks):
                        if answer.failed:
                            set_aside[missing[key].label] = answer.failed
                            continue
                        on_success()
                        self.done[key] = answer.value
                        amount += missing[key].size or 1
                        for note in answer.value.notes:
                            reporter.say_once(note)
                        stage.complete(amount)
        finally:
            summary = self._make_summary(len(self.done) - before, set_aside, begun)
            try:
                self._write_manifest(summary)
            except HarnessError as error:  # parts are usable without the manifest
                summary.set_aside[str(self.out / MANIFEST)] = str(error)
        self._remove_temporary_folders()
        return summary

    def _make_summary(self, fresh: int, set_aside: dict[str, str], begun: float) -> Summary:
        done = [self.done[key] for key in self.keys_done]
        counts: Counter[tuple[str, str]] = Counter()
        for kind, reason, count in (entry for part in done for entry in part.counts):
            counts[kind, reason] += count
        return Summary(
            parts=len(self.parts),
            parts_done=len(done),
            fresh=fresh,
            polygons=sum(part.polygons for part in done),
            triangles=sum(part.triangles for part in done),
            proven=sum(part.proven for part in done),
            counts=counts,
            set_aside=self._unreadable | set_aside,
            pruned=self._pruned,
            seconds=time.perf_counter() - begun,
            certified=[part.certified for part in done if part.certified is not None],
            left_out=[(part.about["source"], *entry) for part in done for entry in part.left_out],
        )

    def _write_manifest(self, summary: Summary) -> None:
        fields = ("polygons", "triangles", "proven", "counts", "seconds")
        parts = [
            {"file": f"{key}{self.work.suffix}"}
            | {name: self.done[key].about[name] for name in ("key", "source", "rows")}
            | {name: getattr(self.done[key], name) for name in fields}
            for key in self.keys_done
        ]
        totals = ("parts", "parts_done", *fields[:3], "set_aside", "pruned")
        counts = [[*which, count] for which, count in sorted(summary.counts.items())]
        content = {"schema_version": VERSION, **self._about, "parts": parts} | {
            "summary": {name: getattr(summary, name) for name in totals} | {"counts": counts}
        }
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        with translate_errors(self.out, "run the same command again"):
            atomic.write(self.out / MANIFEST, text.encode(), forced=True)
            if summary.left_out:
                table = pd.DataFrame(summary.left_out, columns=["file", "kind", "which", "reason"])
                rows = table.to_csv(index=False, lineterminator="\n")
                atomic.write(self.out / LEFT_OUT, rows.encode(), forced=True)
            else:  # of a file that the data set no longer has
                (self.out / LEFT_OUT).unlink(missing_ok=True)

    def _remove_temporary_folders(self) -> None:
        """Remove temporary folders of finished parts; others may belong to a running command."""
        for folder in self.out.glob(f"{TEMPORARY_PREFIX}*"):
            if folder.name.removeprefix(TEMPORARY_PREFIX).partition("-")[0] in self.done:
                shutil.rmtree(folder, ignore_errors=True)
