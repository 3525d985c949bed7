"""Inputs of `harness run`: a stored run's plan, triangulators, and the interleaved baseline."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import typer

from harness import atomic
from harness.commands.options import PROFILES, is_given
from harness.errors import HarnessError, InputError, UsageError
from harness.frame import FIXED_VIEW_MESSAGE, FIXED_VIEWS, is_model_with_views
from harness.measuring.other_version import OtherVersion, open_other_version
from harness.measuring.plan import Plan
from harness.results.run_folder import STORED_PROFILE, read_run
from harness.triangulating.recipes import CALIBRATED, Recipe, parse, parse_all
from scenes.registry import is_tiled


@contextmanager
def open_baseline(
    reference: str | None, plan: Plan, resume: Path | None, *, twice: bool
) -> Iterator[OtherVersion | None]:
    """Yield the interleaved baseline that --beside or the resumed run names, or None."""
    stored = (read_run(resume).facts.get("beside") or {}) if resume else {}
    reference = reference or str(stored.get("base") or "")
    if not reference:
        if twice:
            raise UsageError("--draw-twice requires --beside")
        yield None
        return
    with open_other_version(reference, [recipe.base for recipe in plan.triangulators]) as baseline:
        yield replace(baseline, twice=twice or bool(stored.get("twice")))


def resolve_base_name(name: str | None, plan: Plan) -> str | None:
    """Return the full name of the triangulator that --base names, or None."""
    if not name:
        return None
    names = [str(recipe) for recipe in plan.triangulators]
    full_name = str(parse(name, seed=plan.seed))
    if full_name not in names:
        raise UsageError(f"--base {name}: not among --triangulators {','.join(names)}")
    return full_name


def parse_recipes(triangulators: Sequence[str], seed: int, file: Path | None) -> tuple[Recipe, ...]:
    """Parse --triangulators; read the coefficients of optimal:calibrated from a profile's file."""
    recipes = parse_all(triangulators, seed=seed)
    if not any(recipe.base.endswith(CALIBRATED) for recipe in recipes):
        return recipes
    if file is None:
        raise UsageError(
            "optimal:calibrated needs --profile FILE; make one: raster-harness profile"
        )
    from harness.profile.profile import read_coefficients

    return parse_all(triangulators, seed=seed, calibration=read_coefficients(file))


def find_profile_file(name: str | None, resume: Path | None) -> Path | None:
    """Return the file of --profile or, without --profile, the resumed run's profile, if any."""
    if name:
        from harness.profile.device_costs import find_profile

        return find_profile(name, PROFILES)
    stored = resume and resume / STORED_PROFILE
    return stored if stored and stored.is_file() else None


def read_profile_options(file: Path | None) -> dict[str, Any]:
    """Return the fields `profile` and `calibrate` of `RunOptions`, or {} if `file` is None."""
    if file is None:
        return {}
    from harness.profile.device_costs import minimise_slowest_stage, read_costs

    device = read_costs(file)
    has_stages = len(device.stages) > 1
    calibrate = partial(minimise_slowest_stage, device) if has_stages else None
    return {"profile": atomic.read(file), "calibrate": calibrate}


def refuse_another_view(context: typer.Context, scene: str) -> None:
    """Raise UsageError if view options are given for map tiles or a model, which define a view."""
    kind = "view" if is_model_with_views(scene) else "tile" if is_tiled(scene) else ""
    if kind and is_given(context, "resolution", "rotation", "fit"):
        raise UsageError(FIXED_VIEW_MESSAGE.format(FIXED_VIEWS[kind]))


def read_plan(folder: Path) -> Plan:
    """Return the plan of the run in a folder; raise InputError if the folder has none."""
    facts = read_run(folder).facts
    try:
        return Plan.from_json(facts.get("plan", {}))
    except HarnessError as error:
        raise InputError(f"{folder}: no plan to resume ({error})") from error
