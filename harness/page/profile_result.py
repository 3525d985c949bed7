"""Reads what a profiling page saved, and computes anew what the page computed.

Its draws are made again, and their counters counted again; the law is fitted to the samples that
it saved. So nothing of it is believed but the times, and what contradicts them is refused.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, StringConstraints
from pydantic import model_validator as validator

from harness.errors import IncompatibleRunsError, InputError
from harness.measuring.timing import EMPTY, Times
from harness.page import saved
from harness.page.saved import Finite, Part, Share, Text, Whole, check_rounds
from harness.profile import design, measured
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.design import DESIGN, Draw
from harness.profile.law import solve
from harness.profile.measured import CONTROL, Measured
from harness.profile.profile import check_profile, profile, select_fitted
from harness.stats.intervals import FEWEST_EPOCHS
from triangulators.devices import is_software

FORMAT = "raster-harness device profile"

LIKE = 0.02
"""By which what the page's law says of a draw and what ours says may differ: both fit until no
time changes by 1e-4."""

Counted = Mapping[str, int]


class _Page(Part):
    harness: Text
    design: Whole
    seed: Annotated[int, Field(ge=0, lt=2**53)]


class _Draw(Part):
    checksum: Whole
    fragments: Whole
    quads: Whole


class _Law(Part):
    seconds: dict[Annotated[str, StringConstraints(max_length=50)], Share]
    r2_over: Finite
    r2_within: Finite


class Result(saved.Measured):
    """What a page saved that profiled its device."""

    format: Literal["raster-harness device profile"]
    page: _Page
    draws: Annotated[list[_Draw], Field(min_length=1, max_length=1000)]
    differing: Whole
    limited: bool
    times: dict[Annotated[str, StringConstraints(max_length=20)], saved.Times] | None
    epochs: Annotated[list[Whole], Field(max_length=10_000)]
    law: _Law | None

    @validator(mode="after")
    def _agrees(self) -> Self:
        """Whether all were timed in the same rounds."""
        if any(not each.fragments / 4 <= each.quads <= each.fragments for each in self.draws):
            raise ValueError("quads of fewer than one pixel, or more than four")
        check_rounds(self.times or {}, self.epochs)
        return self


def import_profile(file: Path, result: Result, name: str) -> tuple[dict[str, Any], str, list[str]]:
    """Return the profile that a page's result tells, computed anew, but for its advice.

    And why its times cannot be trusted, or "", and warnings.

    name : of the device

    Raises
    ------
    IncompatibleRunsError, InputError
        if the result contradicts itself, or tells too little
    """
    page = result.page
    if page.design != DESIGN:
        raise IncompatibleRunsError(
            f"{file}: its draws are of design {page.design}, and here it is {DESIGN}: make the "
            "page anew"
        )
    step = result.device.step or 1
    draws = [design.snap(draw, step) for draw in design.make_draws(page.seed)]
    exact = [counters(draw) for draw in draws]
    _refuse_other_draws(file, result, draws, exact)
    epochs = [rounds for rounds in result.epochs if rounds]
    names = [str(number) for number in range(len(draws))]
    if result.timer is None or not result.times or len(epochs) < FEWEST_EPOCHS:
        raise InputError(
            f"{file}: the page was ended after {len(epochs)} of at least {FEWEST_EPOCHS} epochs, "
            "which tell no law; measure again"
        )
    if set(result.times) != {*names, EMPTY, CONTROL}:
        raise InputError(f"{file}: not all of its {len(draws)} draws were timed, or others were")
    times = {
        each: Times(told.repeats, told.samples_s, epochs) for each, told in result.times.items()
    }
    found = measured.normalise_times(times, names)
    _refuse_other_law(file, result, draws, exact, found)
    content = profile(draws, exact, found, _facts(result, name), page.seed)
    try:
        if not content["refused"]:
            check_profile(content)
    except ValueError as error:
        raise InputError(f"{file}: {error}") from error
    warnings = []
    if result.limited:
        warnings.append("the device is slow: the page's time limit left epochs out")
    if result.differing:
        warnings.append(f"counters differ from the exact reference in {result.differing} draws")
    return content, found.trouble, saved.warnings_of(result, warnings, "draws")


def _refuse_other_draws(
    file: Path, result: Result, draws: list[Draw], exact: Sequence[Counted]
) -> None:
    """What was drawn and counted must be the design's, and differ from it as the page says."""
    told = [each.checksum for each in result.draws]
    own = [draw.checksum for draw in draws]
    if told != own[: len(told)] or (result.times and len(told) != len(own)):
        raise InputError(f"{file}: its draws are not those of seed {result.page.seed}")
    differing = sum(
        (each.fragments, each.quads) != (known["fragments"], known["quads"])
        for each, known in zip(result.draws, exact[: len(told)], strict=True)
    )
    if differing != result.differing:
        raise InputError(
            f"{file}: its counters differ from the exact reference in {differing} draws, not in "
            f"{result.differing}, as it says"
        )


def _refuse_other_law(
    file: Path, result: Result, draws: list[Draw], exact: Sequence[Counted], found: Measured
) -> None:
    """The law that the page showed must say the same of each draw as the one of its times."""
    if result.law is None:
        return
    if list(result.law.seconds) != list(TERMS):
        raise InputError(f"{file}: its law has other terms")
    rows = design_of(exact)
    fitted, _ = select_fitted(draws)
    seconds = solve(rows[fitted], found.times[fitted], [draws[n].group for n in fitted])
    shown = rows @ np.array(list(result.law.seconds.values()))
    if (np.abs(shown / np.maximum(rows @ seconds, 1e-12) - 1.0) > LIKE).any():
        raise InputError(f"{file}: the law that it shows is not that of its times")


def _facts(result: Result, name: str) -> dict[str, Any]:
    told = result.device
    assert result.timer is not None
    return {
        "rasteriser": "webgpu",
        "name": name,
        "software": told.fallback or is_software(f"{told.architecture} {told.description}"),
        "cpu": "",
        "browser": result.browser,
        "created": result.started,
        "details": told.model_dump(),
        "timer": result.timer.model_dump(),
    }
