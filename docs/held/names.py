"""How documents call scenes, triangulators and other rows, by `labels.toml`."""

import tomllib
from pathlib import Path

BEST_FOR_H = "optimal:half-perimeter"
BEST_FOR_Q = "optimal:expected-quads"
BEST_FOR_A = "optimal:overdraw"
REFINED = "refined:half-perimeter"

CALLED = tomllib.loads(Path(__file__).with_name("labels.toml").read_text(encoding="utf-8"))
NAMES: dict[str, str] = CALLED["triangulators"]


def scenes(*keys: str) -> dict[str, str]:
    """Return what some scenes are called, in this order."""
    return {key: CALLED["scenes"][key] for key in keys}
