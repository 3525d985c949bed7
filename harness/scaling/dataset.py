"""A data set of many files, worked through part by part into a folder of results.

A part is a run of rows that is read and dealt with by itself. The folder alone says what is done: a
part's file has its name, a content key, only once it is whole and on the disk. `manifest.json` is
made of the files, and can be thrown away.
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
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from harness import atomic
from harness.atomic import BEGUN
from harness.errors import UsageError, of_system
from harness.machine import environment
from harness.progress import Reporter
from harness.results.run_folder import clear_errors
from harness.scaling.crew import Crew
from scenes import SceneError
from scenes.slices import Slices, is_folder

MANIFEST = "manifest.json"
LEFT_OUT = "left_out.csv"
VERSION = 1

AT_A_TIME = 12_500
"""Rows that are in memory at a time; a process has 450 MB with them."""

BESIDE = {".shx", ".dbf", ".prj", ".cpg", ".qpj", ".sbn", ".sbx", ".qix"}
"""Parts of a Shapefile, which is read by its .shp."""

_code_version = cache(environment.code_version)


@dataclass(frozen=True)
class Part:
    """Rows of a file.

    path : the file, absolute
    rows : the first and the one after the last; None for all of them
    size : how many; 0 where that is not known
    about : what its result depends on: the file's name (`source`) and content (`identity`), rows,
        options and code; and its `key`, 16 hexadecimal digits of these
    """

    path: str
    rows: tuple[int, int] | None
    size: int
    about: dict[str, Any]

    @property
    def key(self) -> str:
        """Name of its file."""
        return str(self.about["key"])

    @property
    def label(self) -> str:
        """Name for messages."""
        if self.rows is None:
            return self.path
        return f"{self.path}, rows {self.rows[0]} to {self.rows[1] - 1}"


@dataclass(frozen=True)
class Done:
    """A part that is in the folder.

    counts : [kind, reason, polygons] of what was dropped, repaired or failed
    proven : polygons whose optimum is proven
    certified : fields of `Certified`, where that was asked for
    about : that of the part
    notes : what was done to the file as a whole
    left_out : (kind, which, reason) of what was dropped or failed, the first of each
    seconds : what it took; None where the file was there already
    """

    polygons: int
    triangles: int
    proven: int
    counts: list[list[Any]]
    certified: dict[str, Any] | None
    about: dict[str, Any]
    notes: list[str] = field(default_factory=list)
    left_out: list[tuple[str, str, str]] = field(default_factory=list)
    seconds: float | None = None


@dataclass(frozen=True)
class Work:
    """What is made of each part; the fields of others are what the results depend on.

    title : of what goes on, for people
    unit : what the sizes of parts count
    suffix : of a part's file
    """

    title: ClassVar[str]
    unit: ClassVar[str] = "footprints"
    suffix: ClassVar[str]

    def cut(self, path: str) -> Slices:
        """Cut a file into slices; raises SceneError or OSError where it cannot be read."""
        raise NotImplementedError

    def make(self, part: Part, place: Path, threads: int | None) -> Done:
        """Write a part's file, whole or not at all; what it says holds no times."""
        raise NotImplementedError

    @staticmethod
    def read(file: Path) -> Done | None:
        """Return what a part's file says of itself; None where it is none, or is damaged."""
        raise NotImplementedError

    def do(self, part: Part, out: str, threads: int | None = 1) -> Done:
        """Make a part's file in the folder `out`, unless it is there; returns what it says.

        threads : one for each core if None

        Raises
        ------
        UsageError
            if the part cannot be read or the file cannot be written, or this process has other code
        """
        begun = time.perf_counter()
        own, code = _code_version(), part.about["code"]
        if own != code:
            raise UsageError(
                f"this worker has another version of raster-harness ({own}, not {code}): "
                "install the same on all machines"
            )
        place = Path(out) / f"{part.key}{self.suffix}"
        if (there := self.read(place)) is not None:
            return there
        try:
            done = self.make(part, place, threads)
        except SceneError as error:
            raise UsageError(str(error)) from error
        except OSError as error:
            if (there := self.read(place)) is not None:  # somebody else has made it meanwhile
                return there
            raise UsageError(of_system(error)) from error
        _release()
        return replace(done, seconds=time.perf_counter() - begun)


def _release() -> None:
    """Give memory back to the system that libraries keep for later."""
    with contextlib.suppress(ImportError):
        import pyarrow as pa

        pa.default_memory_pool().release_unused()
    with contextlib.suppress(OSError, AttributeError):  # glibc alone has it
        ctypes.CDLL(None).malloc_trim(0)


def files(pattern: str) -> list[Path]:
    """Return the files that a name, a folder or a pattern such as 'parts/*.parquet' stands for.

    A folder of map tiles is one. Raises UsageError if there is none.
    """
    place = Path(pattern)
    if place.is_dir() and not place.suffix and not is_folder(pattern):
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


@dataclass
class Summary:
    """What is in the folder of what was asked for.

    parts, parts_done : all, and those that are there
    fresh : parts that were made now
    counts : (kind, reason) to polygons dropped, repaired or failed
    set_aside : file or rows of a file to the reason why there is no result
    pruned : rows left out because their row group's statistics exclude the condition
    seconds : wall time of this command
    left_out : (file, kind, which, reason) of what was dropped or failed, the first of each part
    """

    parts: int
    parts_done: int
    fresh: int
    polygons: int
    triangles: int
    proven: int
    counts: Counter[tuple[str, str]]
    set_aside: dict[str, str]
    pruned: int
    seconds: float
    certified: list[dict[str, Any]]
    left_out: list[tuple[str, str, str, str]]


class Dataset:
    """The files, cut into parts, and the folder for what is made of them.

    pattern : a file, a folder of files, or a pattern
    work : what is made, and with which options

    parts : in the order of the files and of their rows; done : by key, those that are there

    Raises
    ------
    UsageError
        if there is no file, or the folder cannot be written or holds other results
    """

    def __init__(self, pattern: str, out: Path, work: Work) -> None:
        self.out = out.absolute()
        self.work = work
        self.parts: list[Part] = []
        self.done: dict[str, Done] = {}
        self._about = {
            "options": json.loads(json.dumps(asdict(work))),
            "code": environment.code_version(),
        }
        self._unreadable: dict[str, str] = {}
        self._pruned = 0
        found = files(pattern)
        with clear_errors(self.out, "give the same command again"):
            self.out.mkdir(parents=True, exist_ok=True)
        self._cut(found)
        if not self.parts and self._unreadable:
            raise UsageError(next(iter(self._unreadable.values())))
        self._look({part.key for part in self.parts})

    def _cut(self, found: Iterable[Path]) -> None:
        """Cut files into parts; one that cannot be read is named, and the others go on."""
        seen: Counter[str] = Counter()
        for file in found:
            try:
                slices = self.work.cut(str(file))
            except (SceneError, OSError) as error:
                self._unreadable[str(file)] = str(error)
                continue
            self._pruned += slices.pruned
            for rows, size in zip(slices.rows, slices.sizes, strict=True):
                content = json.dumps([slices.identity, rows, self._about], sort_keys=True)
                # the same file twice gives the same part twice, not one
                again = seen[content]
                seen[content] += 1
                own = {
                    "key": hashlib.sha256(f"{content} {again}".encode()).hexdigest()[:16],
                    "source": file.name,
                    "identity": slices.identity,
                    "rows": None if rows is None else list(rows),
                }
                self.parts.append(Part(str(file), rows, size, own | self._about))

    def _look(self, wanted: set[str]) -> None:
        """Find what is there; refuse a folder in which there is something else."""
        identities: dict[str, set[str]] = {}
        for part in self.parts:
            identities.setdefault(part.about["source"], set()).add(part.about["identity"])
        for file in sorted(self.out.glob(f"*{self.work.suffix}")):
            done = self.work.read(file)
            if done is None and file.stem in wanted:
                continue  # damaged: it is made again
            if done is None:
                raise UsageError(f"{file} is not of this command: give a folder of its own with -o")
            told = done.about
            for what, own in self._about.items():
                if told[what] != own:
                    raise UsageError(
                        f"{self.out} holds parts that were made with other {what}: give another -o"
                    )
            if told["identity"] not in identities.get(told["source"], {told["identity"]}):
                raise UsageError(
                    f"{self.out} holds parts of {told['source']} as it was before it changed: "
                    "give another -o"
                )
            if told["key"] in wanted:
                self.done[told["key"]] = done

    @property
    def missing(self) -> list[Part]:
        """Parts that have no file yet."""
        return [part for part in self.parts if part.key not in self.done]

    @property
    def keys_done(self) -> list[str]:
        """Keys of the parts that are there."""
        return [part.key for part in self.parts if part.key in self.done]

    def complete(
        self, crew: Crew, reporter: Reporter, begun_well: Callable[[], None] = lambda: None
    ) -> Summary:
        """Make what is missing, write the manifest, and say what is there.

        begun_well : told when a part has ended well

        A part that fails time and again is set aside; the others go on. The manifest is written
        whatever happens.
        """
        begun, before = time.perf_counter(), len(self.done)
        missing = {part.key: part for part in self.missing}
        threads = crew.threads_each
        tasks = {
            key: (self.work.do, (part, str(self.out), threads)) for key, part in missing.items()
        }
        total = sum(part.size or 1 for part in missing.values())
        unit = self.work.unit if all(part.size for part in missing.values()) else "parts"
        aside: dict[str, str] = {}
        amount = 0
        try:
            if missing:
                with reporter.stage(self.work.title, total, unit) as stage:
                    for key, answer in crew.answers(tasks):
                        if answer.failed:
                            aside[missing[key].label] = answer.failed
                            continue
                        begun_well()
                        self.done[key] = answer.value
                        amount += missing[key].size or 1
                        for note in answer.value.notes:
                            reporter.once(note)
                        stage.complete(amount)
        finally:
            summary = self._summary(len(self.done) - before, aside, begun)
            try:
                self._write_manifest(summary)
            except UsageError as error:  # the parts are there all the same
                summary.set_aside[str(self.out / MANIFEST)] = str(error)
        self._tidy()
        return summary

    def _summary(self, fresh: int, aside: dict[str, str], begun: float) -> Summary:
        done = [self.done[key] for key in self.keys_done]
        counts: Counter[tuple[str, str]] = Counter()
        for kind, reason, count in (each for part in done for each in part.counts):
            counts[kind, reason] += count
        return Summary(
            parts=len(self.parts),
            parts_done=len(done),
            fresh=fresh,
            polygons=sum(part.polygons for part in done),
            triangles=sum(part.triangles for part in done),
            proven=sum(part.proven for part in done),
            counts=counts,
            set_aside=self._unreadable | aside,
            pruned=self._pruned,
            seconds=time.perf_counter() - begun,
            certified=[part.certified for part in done if part.certified is not None],
            left_out=[(part.about["source"], *each) for part in done for each in part.left_out],
        )

    def _write_manifest(self, summary: Summary) -> None:
        told = ("polygons", "triangles", "proven", "counts", "seconds")
        parts = [
            {"file": f"{key}{self.work.suffix}"}
            | {name: self.done[key].about[name] for name in ("key", "source", "rows")}
            | {name: getattr(self.done[key], name) for name in told}
            for key in self.keys_done
        ]
        of_all = ("parts", "parts_done", *told[:3], "set_aside", "pruned")
        counts = [[*which, count] for which, count in sorted(summary.counts.items())]
        content = {"schema_version": VERSION, **self._about, "parts": parts} | {
            "summary": {name: getattr(summary, name) for name in of_all} | {"counts": counts}
        }
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        with clear_errors(self.out, "give the same command again"):
            atomic.write(self.out / MANIFEST, text.encode(), forced=True)
            if summary.left_out:
                table = pd.DataFrame(summary.left_out, columns=["file", "kind", "which", "reason"])
                rows = table.to_csv(index=False, lineterminator="\n")
                atomic.write(self.out / LEFT_OUT, rows.encode(), forced=True)

    def _tidy(self) -> None:
        """Remove what processes that were killed have left of parts that are there by now.

        What is left of others may be another command's, which is still at it.
        """
        for folder in self.out.glob(f"{BEGUN}*"):
            if folder.name.removeprefix(BEGUN).partition("-")[0] in self.done:
                shutil.rmtree(folder, ignore_errors=True)
