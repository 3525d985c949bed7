"""A data set of many files triangulated into a folder: what is there, what is missing, what failed.

The folder alone says what is done: a part's file has its name only once it is whole and on the
disk. `manifest.json` is made of the files, and can be thrown away.
"""

import csv
import io
import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.machine import environment
from harness.progress import Reporter
from harness.scaling.parts import Cut, Done, Part, by_rows, cut_all, files
from harness.scaling.task_queue import Crew, work_through
from harness.stored import atomic
from harness.stored.atomic import BEGUN
from harness.stored.folder import clear_errors
from scenes.slices import Slices

MANIFEST = "manifest.json"
LEFT_OUT = "left_out.csv"
VERSION = 1
TIMES = ("seconds", "cpu_seconds")


@dataclass
class Summary:
    """What is in the folder of what was asked for.

    parts, parts_done : all, and those that are there
    fresh : parts that were made now
    counts : (kind, reason) to polygons dropped, repaired or failed
    set_aside : file or rows of a file to the reason why there is no result
    pruned : rows left out because their row group's statistics exclude the condition
    seconds : wall time of this command; worker_seconds : of the parts whose time is known
    timed, timed_polygons : how many these are, and what they hold
    peak_bytes : the most memory that a process had which made a part now
    left_out : (file, kind, which, reason) of what was dropped or failed, the first of each part
    """

    parts: int = 0
    parts_done: int = 0
    fresh: int = 0
    polygons: int = 0
    vertices: int = 0
    triangles: int = 0
    proven: int = 0
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    set_aside: dict[str, str] = field(default_factory=dict)
    pruned: int = 0
    seconds: float = 0.0
    worker_seconds: float = 0.0
    timed: int = 0
    timed_polygons: int = 0
    peak_bytes: int = 0
    certified: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[tuple[str, str, str, str]] = field(default_factory=list)

    def add(self, done: Done) -> None:
        """Add a part that is there."""
        self.parts_done += 1
        for name in ("polygons", "vertices", "triangles", "proven"):
            setattr(self, name, getattr(self, name) + getattr(done, name))
        self.counts += done.counted()
        self.left_out += [
            (done.about["source"], kind, which, why) for kind, which, why in done.left_out
        ]
        self.peak_bytes = max(self.peak_bytes, done.peak_bytes or 0)
        if done.seconds is not None:
            self.worker_seconds += done.seconds
            self.timed += 1
            self.timed_polygons += done.polygons
        if done.certified is not None:
            self.certified.append(done.certified)

    @property
    def worker_rate(self) -> float:
        """Polygons that a worker does in a second, by the parts whose time is known; 0 if none."""
        return self.timed_polygons / self.worker_seconds if self.worker_seconds else 0.0

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON-ready values, without what only this command knows."""
        left_out = ("seconds", "peak_bytes", "fresh", "certified", "notes", "left_out")
        values = {name: value for name, value in asdict(self).items() if name not in left_out}
        values["counts"] = [[*which, count] for which, count in sorted(self.counts.items())]
        return values


@dataclass(frozen=True)
class Kind:
    """What is made of a part.

    title : of what goes on, for people
    suffix : of a part's file
    do : makes it: (part, options, folder, code, threads) -> Done
    read : what a file says of itself; None where it is no such file, or is damaged
    unit : what the sizes of parts count
    cut : a file into slices, by its name and the options
    files : those that a name or a pattern stands for
    """

    title: str
    suffix: str
    do: Callable[..., Done]
    read: Callable[[Path], Done | None]
    unit: str = "footprints"
    cut: Callable[[str, Mapping[str, Any]], Slices] = by_rows
    files: Callable[[str], list[Path]] = files


class Dataset:
    """The files, cut into parts, and the folder for what is made of them.

    pattern : a file, a folder of files, or a pattern
    options : what the results depend on beside the input, a dataclass with `layer` and `where`
    kind : what is made

    Raises
    ------
    UsageError
        if there is no file, or the folder cannot be written or holds other results
    """

    def __init__(self, pattern: str, out: Path, options: Any, kind: Kind) -> None:
        self.out = out.absolute()
        self.options = options
        self.kind = kind
        self._told_options = json.loads(json.dumps(asdict(options)))
        self.code = environment.code_version()
        found = self.kind.files(pattern)
        with clear_errors(self.out, "give the same command again"):
            self.out.mkdir(parents=True, exist_ok=True)
        self.cut: Cut = cut_all(found, self._told_options, self.code, self.kind.cut)
        if not self.cut.parts and self.cut.unreadable:
            raise UsageError(next(iter(self.cut.unreadable.values())))
        self.done: dict[str, Done] = {}
        self._took = self._known_times()
        self._look({part.key for part in self.cut.parts})

    @property
    def missing(self) -> list[Part]:
        """Parts that have no file yet."""
        return [part for part in self.cut.parts if part.key not in self.done]

    @property
    def keys_done(self) -> list[str]:
        """Keys of the parts that are there."""
        return [part.key for part in self.cut.parts if part.key in self.done]

    def complete(
        self, crew: Crew, reporter: Reporter, begun_well: Callable[[], None] = lambda: None
    ) -> Summary:
        """Make what is missing, write the manifest, and say what is there.

        begun_well : told when a part has ended well

        A part that fails time and again is set aside; the others go on. The manifest is written
        whatever happens.
        """
        begun = time.perf_counter()
        missing = self.missing
        threads = crew.threads_each
        out = str(self.out)
        tasks = {
            part.key: (self.kind.do, (part, self.options, out, self.code, threads))
            for part in missing
        }
        sizes = {part.key: part.size or 1 for part in missing}
        unit = self.kind.unit if all(part.size for part in missing) else "parts"
        aside: dict[str, str] = {}
        fresh = 0
        amount = 0.0
        show: Callable[[float], object] = lambda _: None  # noqa: E731 - until there is something to show

        def ended(key: str, done: Done) -> None:
            nonlocal fresh, amount
            begun_well()
            self.done[key] = done
            fresh, amount = fresh + 1, amount + sizes[key]
            for note in done.notes:
                reporter.once(note)
            show(amount)

        try:
            if missing:
                total = sum(sizes.values())
                with reporter.stage(self.kind.title, total, unit) as stage:
                    show = stage.complete
                    aside = work_through(tasks, crew, ended)
        finally:
            summary = self._summary(aside)
            summary.fresh = fresh
            summary.seconds = time.perf_counter() - begun
            try:
                self._write_manifest(summary)
            except UsageError as error:  # the parts are there all the same
                summary.set_aside[str(self.out / MANIFEST)] = str(error)
        self._tidy()
        return summary

    def _look(self, wanted: set[str]) -> None:
        """Find what is there; refuse a folder in which there is something else."""
        identities: dict[str, set[str]] = {}
        for part in self.cut.parts:
            identities.setdefault(part.source, set()).add(part.identity)
        for file in sorted(self.out.glob(f"*{self.kind.suffix}")):
            done = self.kind.read(file)
            if done is None and file.stem in wanted:
                continue  # damaged: it is made again
            if done is None:
                raise UsageError(f"{file} is not of this command: give a folder of its own with -o")
            key, told = str(done.about["key"]), done.about
            if told["options"] != self._told_options or told["code"] != self.code:
                what = "options" if told["code"] == self.code else "code"
                raise UsageError(
                    f"{self.out} holds parts that were made with other {what}: give another -o"
                )
            known = identities.get(told["source"])
            if known is not None and told["identity"] not in known:
                raise UsageError(
                    f"{self.out} holds parts of {told['source']} as it was before it changed: "
                    "give another -o"
                )
            if key in wanted:
                self.done[key] = replace(done, **self._took.get(key, {}))

    def _summary(self, aside: dict[str, str]) -> Summary:
        summary = Summary(parts=len(self.cut.parts), pruned=self.cut.pruned)
        labels = {part.key: part.label for part in self.cut.parts}
        for part in self.cut.parts:
            if part.key in self.done:
                summary.add(self.done[part.key])
        summary.set_aside = {
            **self.cut.unreadable,
            **{labels[key]: why for key, why in aside.items()},
        }
        return summary

    def _known_times(self) -> dict[str, dict[str, Any]]:
        """What an earlier manifest says of how long each part took."""
        try:
            told = json.loads((self.out / MANIFEST).read_text())["parts"]
            return {part["key"]: {name: part[name] for name in TIMES} for part in told}
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def _write_manifest(self, summary: Summary) -> None:
        content = {
            "schema_version": VERSION,
            "options": self._told_options,
            "code": self.code,
            "parts": list(self._told()),
            "summary": summary.to_json(),
        }
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        with clear_errors(self.out, "give the same command again"):
            atomic.write(self.out / MANIFEST, text.encode(), forced=True)
            if summary.left_out:
                rows = io.StringIO(newline="")
                csv.writer(rows, lineterminator="\n").writerows(
                    [("file", "kind", "which", "reason"), *summary.left_out]
                )
                atomic.write(self.out / LEFT_OUT, rows.getvalue().encode(), forced=True)

    def _told(self) -> Iterable[dict[str, Any]]:
        for part in self.cut.parts:
            done = self.done.get(part.key)
            if done is not None:
                name = f"{part.key}{self.kind.suffix}"
                place = {"file": name, "key": part.key, "source": part.source}
                told = ("polygons", "triangles", "proven", "counts", *TIMES)
                yield {**place, "rows": done.about["rows"]} | {n: getattr(done, n) for n in told}

    def _tidy(self) -> None:
        """Remove what processes that were killed have left of parts that are there by now.

        What is left of others may be another command's, which is still at it.
        """
        for folder in self.out.glob(f"{BEGUN}*"):
            if folder.name.removeprefix(BEGUN).partition("-")[0] in self.done:
                shutil.rmtree(folder, ignore_errors=True)
