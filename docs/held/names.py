"""How documents call scenes and triangulators."""

from __future__ import annotations

BEST_FOR_H = "optimal:half-perimeter"
BEST_FOR_Q = "optimal:expected-quads"
BEST_FOR_A = "optimal:overdraw"
REFINED = "refined:half-perimeter"

SCENE_NAMES = {
    "city": "city",
    "helsinki": "Helsinki",
    "glyphs": "letters",
    "counties:level=state": "U.S. states",
    "counties": "counties",
    "cad": "cad",
    "stress": "stress",
}
NAMES = {
    BEST_FOR_H: "best for H",
    REFINED: "`refined`",
    "greedy": "greedy",
    BEST_FOR_Q: "best for Q",
    BEST_FOR_A: "best for A",
    "delaunay": "Delaunay",
    "earcut-refine": "`earcut-refine`",
    "flips:l1": "`flips:l1`",
}


def scenes(*keys: str) -> dict[str, str]:
    """Return what some scenes are called, in this order."""
    return {key: SCENE_NAMES[key] for key in keys}
