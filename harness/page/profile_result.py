"""Import of a profiling page's times, if the draws, counters and law that it states are right."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, StringConstraints
from pydantic import model_validator as validator

from harness.errors import IncompatibleRunsError, InputError
from harness.measuring.timing import EMPTY, Times
from harness.metrics.statistics import MIN_EPOCHS
from harness.page import saved
from harness.page.saved import Count, Finite, NonNegative, SavedModel, Text, check_rounds
from harness.profile import design, measured
from harness.profile.cost_terms import TERMS, Design, count_draw, make_design_rows
from harness.profile.design import DESIGN_VERSION
from harness.profile.law import FORMS, fit_form, predict_times
from harness.profile.measured import CONTROL, DrawTimes
from harness.profile.placing import Draw
from harness.profile.profile import check_profile, make_profile, select_draws_to_fit
from triangulators.gpu import is_software

FORMAT = "raster-harness device profile"
NEW_PAGE = "create the page again (raster-harness page --profile) and measure again"

# Tolerated relative difference of a draw's times by the page's law and by a new fit: both fits stop
# once an iteration changes no time by more than 1e-4, so they differ slightly.
LAW_TOLERANCE = 0.02


class _Page(SavedModel):
    harness: Text
    design: Count
    seed: Annotated[int, Field(ge=0, lt=2**53)]


class _Draw(SavedModel):
    checksum: Count
    fragments: Count
    quads: Count


class _Law(SavedModel):
    form: Annotated[str, StringConstraints(max_length=50)]
    seconds: dict[Annotated[str, StringConstraints(max_length=50)], NonNegative]
    r2_over: Finite
    r2_within: Finite


class Result(saved.Measured):
    """Result of a page that profiled its device."""

    format: Literal["raster-harness device profile"]
    page: _Page
    draws: Annotated[list[_Draw], Field(min_length=1, max_length=1000)]
    differing: Count
    limited: bool
    times: dict[Annotated[str, StringConstraints(max_length=20)], saved.Times] | None
    epochs: Annotated[list[Count], Field(max_length=10_000)]
    law: _Law | None

    @validator(mode="after")
    def _check_consistency(self) -> Self:
        if any(not draw.fragments / 4 <= draw.quads <= draw.fragments for draw in self.draws):
            raise ValueError("quads of fewer than one pixel, or more than four")
        check_rounds(self.times or {}, self.epochs)
        return self


def import_profile(file: Path, result: Result, name: str) -> tuple[dict[str, Any], str, list[str]]:
    """Return a profile without advice, the reason why its times are unreliable, and warnings.

    Raises IncompatibleRunsError or InputError if the result contradicts itself, or is incomplete.
    """
    page = result.page
    if page.design != DESIGN_VERSION:
        raise IncompatibleRunsError(
            f"{file}: measured with version {page.design} of the profile page's draws, expected "
            f"{DESIGN_VERSION}; {NEW_PAGE}"
        )
    step = result.device.step or 1
    draws = [design.snap_draw(draw, step) for draw in design.make_draws(page.seed)]
    exact = [count_draw(draw) for draw in draws]
    _check_draws(file, result, draws, exact)
    epochs = [rounds for rounds in result.epochs if rounds]
    names = [str(number) for number in range(len(draws))]
    if result.timer is None or not result.times or len(epochs) < MIN_EPOCHS:
        raise InputError(
            f"{file}: the page was ended after {len(epochs)} of at least {MIN_EPOCHS} epochs, "
            "too few for a fit; measure again"
        )
    if set(result.times) != {*names, EMPTY, CONTROL}:
        raise InputError(
            f"{file}: the timed draws are not the {len(draws)} draws of the design; measure again"
        )
    times = {
        name: Times(drawn.repeats, drawn.samples_s, epochs) for name, drawn in result.times.items()
    }
    measurement = measured.normalise_times(times, names)
    _check_law(file, result, draws, make_design_rows(exact), measurement)
    content = make_profile(draws, exact, measurement, _make_facts(result, name), page.seed)
    try:
        if not content["refused"]:
            check_profile(content)
    except ValueError as error:
        raise InputError(f"{file}: {error}") from error
    warnings = []
    if result.limited:
        warnings.append("the device is slow: epochs were skipped at the page's time limit")
    if result.differing:
        warnings.append(f"counters differ from the exact reference in {result.differing} draws")
    return content, measurement.unreliable_reason, saved.list_warnings(result, warnings, "draws")


def _check_draws(
    file: Path, result: Result, draws: list[Draw], exact: list[dict[str, int]]
) -> None:
    """Raise InputError for draws of another design, or if `result.differing` is wrong."""
    actual = [draw.checksum for draw in result.draws]
    expected = [draw.checksum for draw in draws]
    if actual != expected[: len(actual)] or (result.times and len(actual) != len(expected)):
        raise InputError(
            f"{file}: the draws differ from the draws of seed {result.page.seed}; measure again"
        )
    differing = sum(
        (draw.fragments, draw.quads) != (counted["fragments"], counted["quads"])
        for draw, counted in zip(result.draws, exact[: len(actual)], strict=True)
    )
    if differing != result.differing:
        raise InputError(
            f"{file}: counters differ from the exact reference in {differing} draws, not in "
            f"{result.differing}, as the file states; measure again"
        )


def _check_law(
    file: Path, result: Result, draws: list[Draw], rows: Design, measurement: DrawTimes
) -> None:
    if result.law is None:
        return
    if list(result.law.seconds) != list(TERMS) or result.law.form not in FORMS:
        raise InputError(f"{file}: the cost model has unknown terms or form; {NEW_PAGE}")
    form = result.law.form
    fitted, _ = select_draws_to_fit(draws)
    labels = np.unique([draws[n].group for n in fitted], return_inverse=True)[1]
    costs, _ = fit_form(rows[fitted], measurement.times[fitted], labels, form)
    stated = predict_times(rows, np.array(list(result.law.seconds.values())), form)
    if (np.abs(stated / predict_times(rows, costs, form) - 1.0) > LAW_TOLERANCE).any():
        raise InputError(f"{file}: the cost model does not follow from the times; measure again")


def _make_facts(result: Result, name: str) -> dict[str, Any]:
    device = result.device
    assert result.timer is not None
    return {
        "rasteriser": "webgpu",
        "name": name,
        "software": device.fallback or is_software(f"{device.architecture} {device.description}"),
        "cpu": "",
        "browser": result.browser,
        "created": result.started,
        "details": device.model_dump(),
        "timer": result.timer.model_dump(),
    }
