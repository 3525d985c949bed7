"""Records and `run.json` as JSON: parsing, validation and writing.

An invalid record, or an invalid part of `run.json`, is skipped; valid parts are used.
"""

import hashlib
import json
import math
import re
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar, cast, get_args

from harness.errors import UsageError
from harness.frame import View
from harness.rasterisers.base import Options
from harness.results.record import (
    HOST_MARK,
    CaseId,
    LeastQuads,
    Record,
    RunFacts,
    Status,
    Time,
    ViewCounters,
    split_name,
)

MAX_NUMBER = 2**63
"""Upper limit of the numbers of a record, because readers compute with 64 bits."""

_KEY = re.compile("[0-9a-f]{16}")
_STATUSES: tuple[str, ...] = get_args(Status)
_OPTIONS = {option.name for option in fields(Options)}

T = TypeVar("T")


class FieldError(ValueError):
    """A field of a record is invalid; the message is `<field>: <problem>`."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")


def parse_json(content: bytes) -> Any:
    """Parse JSON into values that can be written as JSON.

    NaN and infinite numbers become None, unpaired surrogates question marks.

    Raises
    ------
    ValueError
        if `content` is invalid JSON, or nested too deeply
    """
    try:
        value = json.loads(content, parse_float=_parse_finite, parse_constant=lambda _: None)
        # Only unpaired surrogates, written as escapes or as bytes from 0xED on, need a second pass.
        if b"\\u" not in content and b"\xed" not in content:
            return value
        return json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _parse_finite(text: str) -> float | None:
    value = float(text)
    return value if abs(value) < math.inf else None


class _Fields:
    """Typed access to the fields of a JSON object; each method raises `FieldError`.

    prefix : text before the names of fields in error messages
    """

    def __init__(self, values: Any, prefix: str = "") -> None:
        if not isinstance(values, Mapping):
            raise FieldError(prefix.rstrip("."), "is not an object")
        self._values, self._prefix = values, prefix

    def error(self, name: str, problem: str) -> FieldError:
        return FieldError(self._prefix + name, problem)

    def has(self, name: str) -> bool:
        return self._values.get(name) is not None

    def text(self, name: str) -> str:
        value = self._values.get(name)
        if not isinstance(value, str):
            raise self.error(name, "is missing" if value is None else "is not a text")
        return value

    def optional(self, name: str, read: Callable[[str], T]) -> T | None:
        return read(name) if self.has(name) else None

    def number(self, name: str) -> float:
        value: Any = self._values.get(name)
        if not _are_numbers([value]):
            raise self.error(name, "is missing" if value is None else "is not a number in range")
        number: float = value
        return number

    def integer(self, name: str) -> int:
        return self._parse_integer(name, self.number(name))

    def count(self, name: str) -> int:
        """Return an integer, 0 if absent."""
        return self.integer(name) if self.has(name) else 0

    def flag(self, name: str) -> bool:
        value = self._values.get(name)
        if not isinstance(value, bool):
            raise self.error(name, "is neither true nor false")
        return value

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return a list of numbers, () if absent."""
        values = self._values.get(name)
        if values is None:
            return ()
        if not isinstance(values, list) or not _are_numbers(values):
            raise self.error(name, "is not a list of numbers in range")
        return tuple(values)

    def integers(self, name: str) -> tuple[int, ...]:
        return tuple(self._parse_integer(name, value) for value in self.numbers(name))

    def texts(self, name: str) -> tuple[str, ...]:
        values = self._values.get(name)
        if values is None:
            return ()
        if not isinstance(values, list) or not all(isinstance(text, str) for text in values):
            raise self.error(name, "is not a list of texts")
        return tuple(values)

    def sums(self, name: str) -> dict[str, float]:
        """Return an object of numbers, {} if absent."""
        values = self._values.get(name)
        if values is None:
            return {}
        if not isinstance(values, Mapping) or not _are_numbers(values.values()):
            raise self.error(name, "is not an object of numbers in range")
        return dict(values)

    def integer_sums(self, name: str) -> dict[str, int]:
        sums = self.sums(name)
        return {key: self._parse_integer(name, value) for key, value in sums.items()}

    def part(self, name: str, parse: Callable[["_Fields"], T]) -> T | None:
        """Return `parse` of an inner object, or None if absent."""
        if not self.has(name):
            return None
        return parse(_Fields(self._values[name], f"{self._prefix}{name}."))

    def names(self) -> Iterable[str]:
        return self._values.keys()

    def _parse_integer(self, name: str, value: float) -> int:
        if not float(value).is_integer():
            raise self.error(name, "is not an integer")
        return int(value)


def _are_numbers(values: Iterable[Any]) -> bool:
    """Return whether all are numbers in range; without a Python loop: a record has thousands."""
    values = list(values)
    in_range = set(map(type, values)) <= {int, float}
    return in_range and max(map(abs, values), default=0) < MAX_NUMBER


def parse_record(values: Mapping[str, Any]) -> Record:
    """Return the record of a line of `cases.jsonl`.

    Unknown fields, which other versions write, are ignored. Names in the records of older versions,
    which contain a number, `@0` or a host, are split.

    Raises
    ------
    FieldError
        if a field is missing or invalid
    """
    fields = _Fields(values)
    key, status = fields.text("key"), fields.text("status")
    if not _KEY.fullmatch(key):
        raise FieldError("key", "is not 16 hexadecimal digits")
    if status not in _STATUSES:
        raise FieldError("status", f"is not one of {', '.join(_STATUSES)}")
    gap = fields.optional("largest_gap", fields.number)
    return Record(
        id=_parse_id(fields),
        status=status,  # type: ignore[arg-type]  # checked above
        reason=fields.optional("reason", fields.text),
        polygons=fields.count("polygons"),
        polygons_skipped=fields.count("polygons_skipped"),
        polygons_failed=fields.count("polygons_failed"),
        vertices=fields.optional("vertices", fields.integer),
        triangles=fields.optional("triangles", fields.integer),
        predicted=fields.sums("predicted"),
        counters=fields.integer_sums("counters"),
        triangulate_s=fields.optional("triangulate_s", fields.number),
        triangulate_samples_s=fields.numbers("triangulate_samples_s"),
        polygons_cached=fields.count("polygons_cached"),
        conforming=fields.optional("conforming", fields.flag),
        t_junctions=fields.optional("t_junctions", fields.integer),
        proven=fields.optional("proven", fields.integer),
        largest_gap=gap,
        coverage_error=fields.optional("coverage_error", fields.integer),
        outline_quads=fields.optional("outline_quads", fields.integer),
        least=fields.part("least", _parse_least),
        views=fields.part("views", _parse_views),
        time=fields.part("time", _parse_time),
        key=key,
    )


def _parse_id(fields: _Fields) -> CaseId:
    triangulator, number, upright = split_name(fields.text("triangulator"))
    device, host = fields.text("device"), fields.optional("host", fields.text) or ""
    options = fields.part("options", _parse_options) or Options()
    return CaseId(
        scene=fields.text("scene"),
        view=_parse_view(fields),
        triangulator=triangulator,
        rasteriser=fields.text("rasteriser"),
        device=device.removesuffix(f"{HOST_MARK}{host}") if host else device,
        options=options,
        number=fields.integer("number") if fields.has("number") else number,
        upright=upright or bool(fields.optional("upright", fields.flag)),
        host=host,
        scene_hash=fields.optional("scene_hash", fields.text) or "",
    )


def _parse_view(fields: _Fields) -> View:
    fit: Any = fields.text("fit") if fields.has("fit") else "box"
    try:
        return View(fields.integer("resolution"), float(fields.number("rotation")), fit)
    except UsageError as error:
        raise FieldError("view", str(error)) from None


def _parse_options(fields: _Fields) -> Options:
    for name in set(fields.names()) - _OPTIONS:
        raise fields.error(name, "is unknown")
    values: dict[str, Any] = {
        name: fields.text(name) if name == "order" else fields.integer(name)
        for name in fields.names()
        if fields.has(name)
    }
    try:
        return Options(**values)
    except UsageError as error:
        raise FieldError("options", str(error)) from None


def _parse_least(fields: _Fields) -> LeastQuads:
    return LeastQuads(*map(fields.integer, ("polygons", "quads", "shaded", "fragments")))


def _parse_views(fields: _Fields) -> ViewCounters:
    counters = {name: fields.numbers(name) for name in fields.names() if name != "names"}
    names = fields.texts("names")
    if len({len(column) for column in (*counters.values(), *([names] if names else []))}) > 1:
        raise FieldError("views", "has lists of different lengths")
    return ViewCounters(counters, names)


def _parse_time(fields: _Fields) -> Time:
    samples, reference = fields.numbers("samples_s"), fields.numbers("reference_s")
    if not samples:
        raise fields.error("samples_s", "is missing")
    epochs, ends = fields.integers("epochs"), fields.numbers("ci95_s")
    if min(epochs, default=1) < 1:
        raise fields.error("epochs", "has an epoch without a round")
    if len(ends) not in (0, 2):
        raise fields.error("ci95_s", "is not two numbers")
    median = fields.optional("median_s", fields.number)
    return Time(
        timer=fields.optional("timer", fields.text) or "",
        samples_s=samples,
        wall_s=fields.numbers("wall_s"),
        waited_s=fields.numbers("waited_s"),
        disturbed=fields.optional("disturbed", fields.integer),
        stolen_s=fields.optional("stolen_s", fields.number),
        others_s=fields.optional("others_s", fields.number),
        timing_s=fields.optional("timing_s", fields.number),
        median_s=statistics.median(samples) if median is None else median,
        ci95_s=(ends[0], ends[1]) if ends else None,
        repeats=fields.optional("repeats", fields.integer),
        epochs=epochs,
        processes=fields.integers("processes"),
        precision=fields.optional("precision", fields.number),
        precision_reached=fields.optional("precision_reached", fields.flag),
        empty_s=fields.numbers("empty_s"),
        reference_s=reference,
        round_group=fields.optional("round_group", fields.text) or identify_rounds(reference),
        warnings=fields.texts("warnings"),
    )


def identify_rounds(reference_s: Iterable[float]) -> str:
    """Return the `round_group` of cases timed with these reference draws, "" if there are none.

    It is a digest of the reference draws' times in s, so that records of older versions, which have
    no identifier, get one when read.
    """
    values = list(reference_s)
    if not values:
        return ""
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]


_OF_MEASURED = (
    *("polygons", "polygons_skipped", "polygons_failed", "vertices", "triangles", "predicted"),
    *("counters", "triangulate_s", "triangulate_samples_s", "polygons_cached", "conforming"),
    *("t_junctions", "proven", "largest_gap", "coverage_error", "outline_quads"),
)
_OPTIONAL = ("triangulate_samples_s", "proven", "largest_gap")
"""Fields of measured cases in the order of the file, and fields that are omitted if empty."""


def record_to_json(record: Record) -> dict[str, Any]:
    """Return the content of a record's line in `cases.jsonl`."""
    case = record.id
    values: dict[str, Any] = {"key": record.key, **asdict(case.view)}
    values |= {
        "scene": case.scene,
        "scene_hash": case.scene_hash,
        "triangulator": case.triangulator,
    }
    values |= {} if case.number is None else {"number": case.number}
    values |= {"upright": True} if case.upright else {}
    values |= {"rasteriser": case.rasteriser, "device": case.device}
    values |= {"host": case.host} if case.host else {}
    values |= {"options": case.options.to_json(), "status": record.status, "reason": record.reason}
    if record.status not in ("ok", "counted"):
        return values
    for name in _OF_MEASURED:
        value = getattr(record, name)
        if name not in _OPTIONAL or value not in (None, ()):
            values[name] = list(value) if isinstance(value, tuple) else value
    if record.proven is not None:
        values["largest_gap"] = record.largest_gap  # None: unknown bound
    if record.least is not None:
        values["least"] = asdict(record.least)
    if record.views is not None:
        names = {"names": list(record.views.names)} if record.views.names else {}
        lists = {name: list(sums) for name, sums in record.views.counters.items()}
        values["views"] = {**names, **lists}
    if record.time is not None:
        values["time"] = _time_to_json(record.time)
    return values


def _time_to_json(time: Time) -> dict[str, Any]:
    values = {name: value for name, value in vars(time).items() if value not in (None, (), "")}
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items()
    }


_OBJECTS = ("plan", "environment", "scene", "seconds", "beside", "state", "written", "devices")
_LISTS = ("frames", "resumed", "merged", "warnings")


def check_facts(facts: dict[str, Any], problems: list[str]) -> RunFacts:
    """Return the content of `run.json` without its invalid parts.

    problems : receives a line for each invalid part
    """
    usable: dict[str, Any] = {"environment": {}, "devices": {}, "warnings": []}
    for name, part in facts.items():
        if (problem := _find_problem(name, part)) is not None:
            problems.append(f"run.json: {name}: invalid ({problem}); ignored")
        elif part is not None:
            usable[name] = part
    return cast(RunFacts, usable)


def _find_problem(name: str, part: Any) -> str | None:
    """Return why a part of `run.json` is invalid, or None if it is valid."""
    if part is None or name not in (*_OBJECTS, *_LISTS):
        return None
    if name in _OBJECTS and not isinstance(part, Mapping):
        return "not an object"
    if name in _LISTS and not isinstance(part, list):
        return "not a list"
    try:
        match name:
            case "plan":
                fields = _Fields(part)
                fields.texts("triangulators")
                fields.count("seed")
                fields.sums("calibration")
            case "environment":
                for inner in ("git", "project", "packages"):
                    _Fields(part).part(inner, _Fields.names)
                _require_objects(part.get("gpus"), "gpus")
            case "devices":
                for label, values in part.items():
                    device = _Fields(values, f"{label}.")
                    for inner in ("details", "timer"):
                        device.part(inner, _Fields.names)
            case "warnings":
                _Fields({name: part}).texts(name)
    except FieldError as error:
        return str(error)
    return None


def _require_objects(values: Any, name: str) -> None:
    if values is not None and not (
        isinstance(values, list) and all(isinstance(value, Mapping) for value in values)
    ):
        raise FieldError(name, "is not a list of objects")
