"""Reading of the untrusted files that measuring and profiling pages saved; common fields."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from harness.errors import InputError
from harness.grid import SUBPIXEL
from harness.measuring.timing import EMPTY
from harness.page.device_summaries import identify_browser
from harness.results.record import MAX_NUMBER
from harness.results.run_folder import make_file_stem

VERSION = 1
MAX_BYTES = 256 * 2**20

Text = Annotated[str, StringConstraints(max_length=500, pattern=r"^[^\x00-\x1f\x7f]*$")]
Long = Annotated[str, StringConstraints(max_length=10_000)]
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f]+$")]
Count = Annotated[int, Field(ge=0, le=2**53)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]
Finite = Annotated[float, Field(gt=-MAX_NUMBER, lt=MAX_NUMBER, allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)]


class SavedModel(BaseModel):
    """A part of a result; missing and unknown fields are invalid."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class SavedDevice(SavedModel):
    """GPU as reported by a browser; `step` of its vertex grid in 1/256 px, None if none fits."""

    vendor: Text
    architecture: Text
    device: Text
    description: Text
    timer: bool
    step: Literal[1, 2, 4, 8, 16] | None
    fallback: bool
    limits: Annotated[dict[Name, Count], Field(min_length=1, max_length=100)]


class Timer(SavedModel):
    """Result of the self-test of `timing.js`; `asking_s` is the wall time of an empty request."""

    timer: Literal["gpu", "wall"]
    asking_s: NonNegative
    wall_s: Seconds
    gpu_s: NonNegative | None
    resolution_s: Seconds
    reason: Text


class Times(SavedModel):
    """Seconds of one draw in each round."""

    repeats: Annotated[int, Field(ge=1, le=2**20)]
    samples_s: list[Annotated[float, Field(ge=0.0, le=1e5, allow_inf_nan=False)]]


def check_rounds(times: Mapping[str, Times], epochs: Sequence[int]) -> None:
    """Raise ValueError if numbers of rounds differ, or a draw other than the empty one took 0 s."""
    if {len(draw.samples_s) for draw in times.values()} - {sum(epochs)}:
        raise ValueError("draws have different numbers of rounds")
    if any(0.0 in draw.samples_s for name, draw in times.items() if name != EMPTY):
        raise ValueError("a draw took no time")


class Measured(SavedModel):
    """Fields that the results of measuring pages and of profiling pages have."""

    version: Literal[1]
    started: Text
    ended: Text
    browser: Text
    device: SavedDevice
    timer: Timer | None
    budget_s: Seconds
    complete: bool
    problem: Long | None
    hidden: bool


class _File(BaseModel):
    format: str
    version: int
    sha256: str = ""
    result: str = ""


Result = TypeVar("Result", bound=Measured)


def read_saved(file: Path, kinds: Mapping[str, type[Result]]) -> Result:
    """Return the result that a page saved in a file; raise InputError for other files."""
    try:
        if file.exists() and not file.is_file():
            raise InputError(f"{file}: not a regular file; give the file that the page saved")
        if file.stat().st_size > MAX_BYTES:
            raise InputError(
                f"{file}: too large for a saved result (over {MAX_BYTES >> 20} MiB); give the file "
                "that the page saved"
            )
        outer = _File.model_validate_json(file.read_bytes())
        kind = kinds[outer.format]
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}") from error
    except (ValueError, KeyError) as error:
        raise InputError(
            f"{file}: not a file saved by a measuring page; save or copy the file again"
        ) from error
    if outer.version != VERSION:
        raise InputError(f"{file}: saved by another version of the page; update raster-harness")
    content = outer.result.encode()
    if hashlib.sha256(content).hexdigest() != outer.sha256:
        raise InputError(
            f"{file}: modified after saving (checksum mismatch); save or copy the file again"
        )
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"])) or "result"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{file}: {field}: {problem}; measure again") from error


def make_device_name(result: Measured) -> str:
    """Return a name for the device, such as apple-metal-3-safari."""
    device = result.device
    text = device.description or " ".join(filter(None, [device.vendor, device.architecture]))
    name = make_file_stem(text.lower()).strip("-._") or "unnamed-gpu"
    return f"{name}-{identify_browser(result.browser)[0]}"


def list_warnings(result: Measured, warnings: Iterable[str], moved: str) -> list[str]:
    """Return the page's problems, `warnings`, and deviations of the device's coverage.

    moved : "draws" or "polygons", which a coarser grid moves
    """
    problem = " ".join((result.problem or "").split())
    step = result.device.step
    grid = step or 1
    conditions = {
        f"the page reported a problem: {problem}": problem != "",
        "the page was stopped before all measurements were done": not result.complete,
        "the page was hidden for some time, in which browsers throttle it": result.hidden,
        **dict.fromkeys(warnings, True),
        "the device's coverage rule differs from the reference on every grid": step is None,
        f"the device snaps to 1/{SUBPIXEL // grid} px: {moved} were moved to its grid": grid > 1,
    }
    return [warning for warning, applies in conditions.items() if applies]
