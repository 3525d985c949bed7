"""What measuring pages save, as far as it is the same: the digest, the device, timers and times.

The files come from anywhere, so nothing in them is believed before it is checked.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from harness.errors import InputError
from harness.grid import SUBPIXEL
from harness.measuring.timing import EMPTY
from harness.page.device_summaries import browser
from harness.results.parsing import MAX_NUMBER as MOST
from harness.results.run_folder import file_stem

VERSION = 1
MOST_BYTES = 256 * 2**20

Text = Annotated[str, StringConstraints(max_length=500, pattern=r"^[^\x00-\x1f\x7f]*$")]
Long = Annotated[str, StringConstraints(max_length=10_000)]
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f]+$")]
Whole = Annotated[int, Field(ge=0, le=2**53)]
Share = Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]
Finite = Annotated[float, Field(gt=-MOST, lt=MOST, allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)]


class Part(BaseModel):
    """A part of a result, of which no field may lack or be another."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class Device(Part):
    """What a browser tells of its GPU; step : of its grid, in 1/256 px; limits : by their names."""

    vendor: Text
    architecture: Text
    device: Text
    description: Text
    timer: bool
    step: Literal[1, 2, 4, 8, 16] | None
    fallback: bool
    limits: Annotated[dict[Name, Whole], Field(min_length=1, max_length=100)]


class Timer(Part):
    """What the self-test of `timing.js` found."""

    timer: Literal["gpu", "wall"]
    asking_s: Share
    wall_s: Seconds
    gpu_s: Share | None
    resolution_s: Seconds
    reason: Text


class Times(Part):
    """Seconds of one draw, one a round."""

    repeats: Annotated[int, Field(ge=1, le=2**20)]
    samples_s: list[Annotated[float, Field(ge=0.0, le=1e5, allow_inf_nan=False)]]


def check_rounds(times: Mapping[str, Times], epochs: Sequence[int]) -> None:
    """Raise ValueError unless all were timed in the same rounds, and each draw took some time."""
    if {len(each.samples_s) for each in times.values()} - {sum(epochs)}:
        raise ValueError("its times are not of the same rounds")
    if any(0.0 in each.samples_s for name, each in times.items() if name != EMPTY):
        raise ValueError("a draw took no time")


class Measured(Part):
    """What all results have."""

    version: Literal[1]
    started: Text
    ended: Text
    browser: Text
    device: Device
    timer: Timer | None
    budget_s: Seconds
    complete: bool
    problem: Long | None
    hidden: bool


class _File(BaseModel):
    """What a page saves: a result as text, and the digest of that."""

    format: str
    version: int
    sha256: str = ""
    result: str = ""


Result = TypeVar("Result", bound=Measured)


def read_saved(file: Path, kinds: Mapping[str, type[Result]]) -> Result:
    """Return the result in a file that a page saved; kinds : what it is, by the file's format.

    Raises
    ------
    InputError
        if it cannot be read, is damaged, or is not what a page saves
    """
    try:
        if file.exists() and not file.is_file():
            raise InputError(f"{file}: a folder, pipe or device, not a file that a page saved")
        if file.stat().st_size > MOST_BYTES:
            raise InputError(f"{file}: larger than any page saves ({MOST_BYTES >> 20} MiB)")
        outer = _File.model_validate_json(file.read_bytes())
        kind = kinds[outer.format]
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}") from error
    except (ValueError, KeyError) as error:
        raise InputError(f"{file}: not a file that a measuring page saved") from error
    if outer.version != VERSION:
        raise InputError(f"{file}: saved by another version of the page; update raster-harness")
    content = outer.result.encode()
    if hashlib.sha256(content).hexdigest() != outer.sha256:
        raise InputError(f"{file}: damaged since the page saved it; save or copy it again")
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        what = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{file}: {where or 'result'}: {what}") from error


def device_name(result: Measured) -> str:
    """Return a name for the device, such as apple-metal-3-safari, of what the browser told."""
    told = result.device
    words = told.description or " ".join(filter(None, [told.vendor, told.architecture]))
    name = file_stem(words.lower()).strip("-._") or "unnamed-gpu"
    return f"{name}-{browser(result.browser)[0]}"


def warnings_of(result: Measured, more: Iterable[str], moved: str) -> list[str]:
    """Return what went wrong on the page, `more`, and what is unlike ours in how its device draws.

    moved : what is drawn elsewhere where the device's grid is coarser
    """
    problem = " ".join((result.problem or "").split())
    step = result.device.step
    grid = step or 1
    told = {
        f"the page told of a problem: {problem}": problem != "",
        "the page was stopped before it had measured everything": not result.complete,
        "the page was hidden for a while, in which browsers slow it down": result.hidden,
        **dict.fromkeys(more, True),
        "the device rasterises by another rule than ours, on any grid": step is None,
        f"the device snaps to 1/{SUBPIXEL // grid} px: {moved} were moved there": grid > 1,
    }
    return [words for words, so in told.items() if so]
