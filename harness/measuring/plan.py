"""The plan of a run: the cases to measure, and how."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from harness.errors import InputError
from harness.frame import View
from harness.rasterisers.base import Options
from harness.results.parsing import FieldError, validate_json
from harness.settings import DEFAULT_TRIANGULATORS, TIMEOUT_S, TimingSettings
from harness.triangulating.recipes import Recipe, parse_all


@dataclass(frozen=True)
class Plan:
    """The experiment of a run; two runs of equal plans are comparable.

    Parameters
    ----------
    scene : str
        Name of a scene or path of a file, optionally with parameters, e.g. "city:limit=100".
    seed : int
        Seed of the scene, of random triangulators and of the order of timing.
    triangulators : tuple of Recipe
        Triangulators, see `harness.triangulating.recipes.parse_all`.
    rasterisers, devices : tuple of str
        Names of rasterisers and devices; if `devices` is empty, each rasteriser's best device.
    views : tuple of View
        Mappings of the scene to the viewport.
    options : tuple of Options
        Options of drawing; all cases are measured with each.
    timing : TimingSettings
        Precision and limits of timing.
    timeout_s : float
        Time limit of a triangulation, count or timing task.
    """

    scene: str
    seed: int = 0
    triangulators: tuple[Recipe, ...] = field(
        default_factory=lambda: parse_all(DEFAULT_TRIANGULATORS)
    )
    rasterisers: tuple[str, ...] = ("opengl",)
    devices: tuple[str, ...] = ()
    views: tuple[View, ...] = (View(),)
    options: tuple[Options, ...] = (Options(),)
    timing: TimingSettings = field(default_factory=TimingSettings)
    timeout_s: float = TIMEOUT_S

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values: triangulators by name, coefficients in "calibration"."""
        calibrations = [recipe.calibration for recipe in self.triangulators]
        calibration = next((terms for terms in calibrations if terms is not None), None)
        values = asdict(self)
        timing = values["timing"]
        # Omit fields that older records do not have, if they have the default value.
        if self.timing.processes == 1:
            del timing["processes"]
        if self.timing.limit_s is None:
            del timing["limit_s"]
        values |= {
            "triangulators": [str(recipe) for recipe in self.triangulators],
            "options": [options.to_json() for options in self.options],
            "calibration": None if calibration is None else dict(calibration),
        }
        document: dict[str, Any] = json.loads(json.dumps(values))
        return document

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Plan":
        """Return the plan from the values that `to_json` returned."""
        recipes = parse_all(
            values.get("triangulators") or (),
            seed=values.get("seed", 0),
            calibration=values.get("calibration"),
        )
        content = {**values, "triangulators": [asdict(recipe) for recipe in recipes]}
        try:
            plan: Plan = validate_json(cls, content)
        except FieldError as error:
            raise InputError(f"plan: {error}") from None
        return plan
