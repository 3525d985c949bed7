"""What a run is to do: the plan as the user gave it, and the cases it spells out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from harness.frame import View
from harness.measuring.settings import DEFAULT_TRIANGULATORS, TIMEOUT_S, TimingSettings
from harness.rasterisers.base import Options
from harness.triangulating.names import Recipe, parse_all


@dataclass(frozen=True)
class Plan:
    """Everything that decides what a run measures; two runs of equal plans are comparable.

    devices : () lets every rasteriser choose its best device
    timeout_s : longest that one triangulation, count or timing task may take
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
        """Return the plan as JSON-ready values: triangulators by name, calibration apart."""
        calibrations = [recipe.calibration for recipe in self.triangulators]
        calibration = next((terms for terms in calibrations if terms is not None), None)
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        values |= {
            "triangulators": [str(recipe) for recipe in self.triangulators],
            "views": [asdict(view) for view in self.views],
            "options": [asdict(options) for options in self.options],
            "timing": asdict(self.timing),
            "calibration": None if calibration is None else dict(calibration),
        }
        return json.loads(json.dumps(values))

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Plan:
        """Build the plan that `to_json` gave."""
        parts = dict(values)
        calibration = parts.pop("calibration", None)
        return cls(
            **{
                **parts,
                "triangulators": parse_all(
                    parts["triangulators"], seed=parts.get("seed", 0), calibration=calibration
                ),
                "rasterisers": tuple(parts["rasterisers"]),
                "devices": tuple(parts["devices"]),
                "views": tuple(View(**view) for view in parts["views"]),
                "options": tuple(Options(**options) for options in parts["options"]),
                "timing": TimingSettings(**parts["timing"]),
            }
        )


@dataclass(frozen=True)
class Case:
    """The unit that is run, stored, resumed and compared."""

    scene: str
    scene_hash: str
    view: View
    triangulator: str
    rasteriser: str
    device: str
    options: Options

    @property
    def key(self) -> str:
        """16 hexadecimal digits that stand for the content of the case."""
        content = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:16]

    def identity(self) -> dict[str, Any]:
        """Return the fields a record of this case begins with."""
        return {
            "key": self.key,
            "scene": self.scene,
            "scene_hash": self.scene_hash,
            "triangulator": self.triangulator,
            "rasteriser": self.rasteriser,
            "device": self.device,
            "resolution": self.view.resolution,
            "rotation": self.view.rotation,
            "fit": self.view.fit,
            "options": asdict(self.options),
        }
