"""What a record and a run's facts must be, checked once, where they are read.

A damaged run costs its damaged cases and no more: each thing that is left out is a problem of one
line.
"""

import statistics
from collections.abc import Mapping
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from harness.settings import Fit

MOST = 2**63
"""No number of a record is as large: what reads them computes with 64 bits."""

Number = Annotated[float, Field(gt=-MOST, lt=MOST, allow_inf_nan=False)]
FITS: tuple[Fit, ...] = get_args(Fit)


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", hide_input_in_errors=True)


class Options(_Part):
    """How a frame is drawn: `harness.rasterisers.Options`."""

    model_config = ConfigDict(extra="forbid")

    samples: int = 1
    work: int = 0
    order: str = "native"
    seed: int = 0


class Least(_Part):
    """Sums over the polygons whose fewest quads are known."""

    polygons: Number
    quads: Number
    shaded: Number
    fragments: Number


class Time(_Part):
    """Rounds in which a case was timed; sample r of each list is of round r."""

    samples_s: Annotated[list[Number], Field(min_length=1)]
    median_s: Number = 0.0
    reference_s: list[Number] = []
    empty_s: list[Number] = []
    wall_s: list[Number] = []
    waited_s: list[Number] = []
    ci95_s: Annotated[list[Number], Field(min_length=2, max_length=2)] = [0.0, 0.0]
    epochs: list[Annotated[int, Field(gt=0)]] = []


class Views(_Part):
    """Of a scene in several views: their names, and of each counter a list, one a view."""

    __pydantic_extra__: dict[str, list[Number]]

    names: list[str] | list[Number] = []

    @model_validator(mode="after")
    def _are_alike(self) -> "Views":
        if len({len(getattr(self, name)) for name in self.model_fields_set}) > 1:
            raise ValueError("lists of several lengths")
        return self


class Record(_Part):
    """One case. What is None was not measured; fields of other versions are let pass.

    docs/reference/files.md says what each holds.
    """

    key: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    scene: str
    triangulator: str
    rasteriser: str
    device: str
    status: str
    resolution: Number
    rotation: Number
    fit: Fit | None = None
    options: Options | None = None
    reason: str | None = None
    scene_hash: str | None = None
    host: str | None = None
    polygons: Number | None = None
    polygons_skipped: Number | None = None
    polygons_failed: Number | None = None
    polygons_cached: Number | None = None
    vertices: Number | None = None
    triangles: Number | None = None
    predicted: dict[str, Number] | None = None
    counters: dict[str, Number] | None = None
    triangulate_s: Number | None = None
    triangulate_samples_s: list[Number] | None = None
    t_junctions: Number | None = None
    proven: Number | None = None
    largest_gap: Number | None = None
    coverage_error: Number | None = None
    outline_quads: Number | None = None
    least: Least | None = None
    views: Views | None = None
    time: Time | None = None


class Plan(_Part):
    """What `harness.measuring.Plan.from_json` takes for granted; it checks the rest."""

    triangulators: list[str] | None = None
    seed: int = 0
    calibration: dict[str, Number] | None = None


class Environment(_Part):
    """The machine that a run was made on."""

    git: dict[str, Any] | None = None
    project: dict[str, Any] | None = None
    packages: dict[str, Any] | None = None
    gpus: list[dict[str, Any]] | None = None


_FACTS: dict[str, Any] = {
    "plan": Plan,
    "environment": Environment,
    "devices": dict[str, dict[str, dict[str, Any] | None]],
    "warnings": list[str],
    **dict.fromkeys(("scene", "seconds", "beside", "state", "written"), dict[str, Any]),
    **dict.fromkeys(("frames", "resumed", "merged"), list[Any]),
}
_FIELDS: Any = {name: (kind | None, None) for name, kind in _FACTS.items()}
Facts = create_model("Facts", **_FIELDS)
"""The content of run.json, as docs/reference/files.md has it."""


USUAL_OPTIONS = Options().model_dump()


def wrong_field(record: dict[str, Any]) -> str | None:
    """Return the name of the first field that is not what a record has there, else None."""
    try:
        Record.model_validate(record)
    except ValidationError as error:
        return str(error.errors(include_url=False)[0]["loc"][0])
    return None


def completed(record: dict[str, Any]) -> dict[str, Any]:
    """Return a good record with the usual values of what it does not say."""
    options = {**USUAL_OPTIONS, **(record.get("options") or {})}
    usual: dict[str, Any] = {"fit": record.get("fit") or FITS[0], "options": options}
    if record["status"] == "ok":
        usual |= {name: record.get(name) or {} for name in ("counters", "predicted")}
    time = record.get("time")
    if time and "samples_s" in time and "median_s" not in time:
        usual["time"] = {**time, "median_s": statistics.median(time["samples_s"])}
    return {**record, **usual}


def checked_facts(found: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return the content of run.json, of which each part that is there is what readers rely on.

    problems : gets a line for each part that is left out
    """
    wrong = set()
    try:
        Facts.model_validate(found)
    except ValidationError as error:
        wrong = {str(each["loc"][0]) for each in error.errors(include_url=False)}
        problems += [f"run.json: {name} is not usable; ignored" for name in sorted(wrong)]
    good = {name: part for name, part in found.items() if name not in wrong and part is not None}
    return {"environment": {}, "devices": {}, "warnings": [], **good}


def flat(values: Mapping[str, Any], between: str = ".") -> dict[str, Any]:
    """Write {"timing": {"precision": 1}} as {"timing.precision": 1}."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            inner = flat(value, between).items()
            found |= {f"{name}{between}{deeper}": each for deeper, each in inner}
        else:
            found[name] = value
    return found
