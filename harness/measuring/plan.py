"""What a run is to do: the plan as the user gave it, and the cases it spells out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from harness.frame import View
from harness.measuring.timing import Settings
from harness.rasterisers.base import Options

DEFAULT_TRIANGULATORS = (
    "fan",
    "ear-clipping",
    "delaunay",
    "refined:half-perimeter",
    "optimal:overdraw",
    "optimal:half-perimeter",
)
DEFAULT_RASTERISERS = ("opengl",)


@dataclass(frozen=True)
class Plan:
    """Everything that decides what a run measures; two runs of equal plans are comparable.

    devices : () lets every rasteriser choose its best device
    timeout_s : longest that one triangulation, count or timing task may take
    calibration : a device's coefficients, which optimal:calibrated minimises
    """

    scene: str
    seed: int = 0
    triangulators: tuple[str, ...] = DEFAULT_TRIANGULATORS
    rasterisers: tuple[str, ...] = DEFAULT_RASTERISERS
    devices: tuple[str, ...] = ()
    views: tuple[View, ...] = (View(),)
    options: tuple[Options, ...] = (Options(),)
    timing: Settings = field(default_factory=Settings)
    timeout_s: float = 600.0
    calibration: Mapping[str, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the plan as JSON-ready values."""
        return json.loads(json.dumps(asdict(self)))

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Plan:
        """Build the plan that `to_json` gave."""
        parts = dict(values)
        return cls(
            **{
                **parts,
                "triangulators": tuple(parts["triangulators"]),
                "rasterisers": tuple(parts["rasterisers"]),
                "devices": tuple(parts["devices"]),
                "views": tuple(View(**view) for view in parts["views"]),
                "options": tuple(Options(**options) for options in parts["options"]),
                "timing": Settings(**parts["timing"]),
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
