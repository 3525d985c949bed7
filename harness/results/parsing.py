"""Records and `run.json` as JSON: parsing, validation by pydantic, and writing.

An invalid record, or an invalid part of `run.json`, is skipped; valid parts are used.
"""

import hashlib
import json
import math
import re
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from typing import Any, cast

from harness.errors import UsageError
from harness.frame import View
from harness.rasterisers.base import Options
from harness.results.record import HOST_MARK, CaseId, Number, Record, RunFacts, split_name

_KEY = re.compile("[0-9a-f]{16}")


class FieldError(ValueError):
    """A field of a record is invalid; the message is `<field>: <problem>`."""


def parse_json(content: bytes) -> Any:
    """Parse JSON into values that can be written as JSON; raise ValueError if it is invalid.

    NaN and infinite numbers become None, unpaired surrogates question marks.
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


def parse_record(values: Mapping[str, Any]) -> Record:
    """Return the record of a line of `cases.jsonl`; raise FieldError if a field is invalid.

    Unknown fields, which other versions write, are ignored. In older records a triangulator's name
    ends with its number and `@0`, and a device's with its host; these become separate fields.
    """
    if not _KEY.fullmatch(str(values.get("key"))):
        raise FieldError("key: is not 16 hexadecimal digits")
    try:
        record: Record = validate_json(Record, _arrange_fields(_drop_nulls(values)))
    except UsageError as error:  # raised by View and Options
        raise FieldError(str(error)) from None
    except RecursionError:
        raise FieldError("nested too deeply") from None
    if (views := record.views) is not None:
        columns = [*views.counters.values(), *filter(None, [views.names])]
        if len(set(map(len, columns))) > 1:
            raise FieldError("views: has lists of different lengths")
    if (time := record.time) is None:
        return record
    if not time.samples_s:
        raise FieldError("time.samples_s: is missing")
    median = statistics.median(time.samples_s) if time.median_s is None else time.median_s
    group = time.round_group or identify_rounds(time.reference_s)
    return replace(record, time=replace(time, median_s=median, round_group=group))


def _arrange_fields(line: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a line, nested as in a `Record`: `id` holds `view` and `options`."""
    for name in ("resolution", "rotation"):  # View has defaults
        if name not in line:
            raise FieldError(f"{name}: is missing")
    view = _select_fields(View, line)
    case = _select_fields(CaseId, line) | {"view": view, "options": line.get("options", {})}
    if isinstance(case["options"], dict):
        for name in case["options"].keys() - _select_fields(Options, case["options"]).keys():
            raise FieldError(f"options.{name}: is unknown")
    if isinstance(case.get("triangulator"), str):
        case["triangulator"], number, upright = split_name(case["triangulator"])
        case = ({} if number is None else {"number": number}) | {"upright": upright} | case
    if isinstance(case.get("device"), str) and "host" in case:
        case["device"] = case["device"].removesuffix(f"{HOST_MARK}{case['host']}")
    record = _select_fields(Record, line) | {"id": case}
    if isinstance(views := line.get("views"), dict):
        counters = {name: column for name, column in views.items() if name != "names"}
        record["views"] = {"names": views.get("names", []), "counters": counters}
    return record


def _select_fields(kind: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in fields(kind) if field.name in values}


def _drop_nulls(value: Any) -> Any:
    """Return JSON without the fields that are null, which means absent."""
    if not isinstance(value, Mapping):
        return value
    return {name: _drop_nulls(part) for name, part in value.items() if part is not None}


def validate_json(kind: Any, values: Any) -> Any:
    """Return JSON values as type `kind` without conversions; raise FieldError if invalid."""
    from pydantic import ValidationError  # slow to import, and a measurement reads no record

    try:
        return _get_adapter(kind).validate_json(json.dumps(values), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        path = ".".join(str(part) for part in first["loc"] if part not in ("id", "view"))
        raise FieldError(f"{path}: {first['msg']}".removeprefix(": ")) from None


@cache
def _get_adapter(kind: Any) -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def identify_rounds(reference_s: Iterable[float]) -> str:
    """Return the `round_group`, a digest, of cases timed with these reference draws; "" if none."""
    values = list(reference_s)
    if not values:
        return ""
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]


_MEASURED_FIELDS = (  # in the order of the file
    *("polygons", "polygons_skipped", "polygons_failed", "vertices", "triangles", "predicted"),
    *("counters", "triangulate_s", "triangulate_samples_s", "polygons_cached", "conforming"),
    *("t_junctions", "proven", "largest_gap", "coverage_error", "outline_quads"),
)
_OPTIONAL_FIELDS = ("triangulate_samples_s", "proven", "largest_gap")  # omitted if empty


def record_to_json(record: Record) -> dict[str, Any]:
    """Return the content of a record's line in `cases.jsonl`."""
    case = record.id
    values: dict[str, Any] = {"key": record.key, **asdict(case.view)}
    values |= {name: getattr(case, name) for name in ("scene", "scene_hash", "triangulator")}
    values |= {} if case.number is None else {"number": case.number}
    values |= {"upright": True} if case.upright else {}
    values |= {"rasteriser": case.rasteriser, "device": case.device}
    values |= {"host": case.host} if case.host else {}
    values |= {"options": case.options.to_json(), "status": record.status, "reason": record.reason}
    if record.status not in ("ok", "counted"):
        return values
    for name in _MEASURED_FIELDS:
        value = getattr(record, name)
        if name not in _OPTIONAL_FIELDS or value not in (None, ()):
            values[name] = value
    if record.proven is not None:
        values["largest_gap"] = record.largest_gap  # also None, for an unknown bound
    if record.least is not None:
        values["least"] = asdict(record.least)
    if record.views is not None:
        names = {"names": record.views.names} if record.views.names else {}
        values["views"] = {**names, **record.views.counters}
    if record.time is not None:
        items = vars(record.time).items()
        values["time"] = {name: value for name, value in items if value not in (None, (), "")}
    return values


@dataclass(frozen=True)
class _Plan:
    triangulators: list[str] = field(default_factory=list)
    seed: int = 0
    calibration: dict[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class _Environment:
    git: dict[str, Any] = field(default_factory=dict)
    project: dict[str, Any] = field(default_factory=dict)
    packages: dict[str, Any] = field(default_factory=dict)
    gpus: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class _Device:
    details: dict[str, Any] = field(default_factory=dict)
    timer: dict[str, Any] = field(default_factory=dict)


_PARTS: dict[str, Any] = {  # parts of `run.json` that are read; others are not checked
    "plan": _Plan,
    "environment": _Environment,
    "devices": dict[str, _Device],
    "warnings": list[str],
    **dict.fromkeys(("scene", "seconds", "beside", "state", "written"), dict[str, Any]),
    **dict.fromkeys(("frames", "resumed", "merged"), list[Any]),
}


def select_valid_facts(facts: dict[str, Any], problems: list[str]) -> RunFacts:
    """Return `run.json` without its invalid parts, each of which adds a line to `problems`."""
    usable: dict[str, Any] = {"environment": {}, "devices": {}, "warnings": []}
    for name, part in facts.items():
        try:
            if part is not None and name in _PARTS:
                validate_json(_PARTS[name], _drop_nulls(part))
        except (FieldError, RecursionError) as error:
            problems.append(f"run.json: {name}: invalid ({error}); ignored")
            continue
        if part is not None:
            usable[name] = part
    usable["devices"] = {k: device for k, device in usable["devices"].items() if device is not None}
    return cast(RunFacts, usable)
