"""What a page that profiles a device holds: what its draws cost, and sums for its advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from harness import __version__
from harness.measuring.processes import Bench
from harness.profile import law
from harness.profile.advice import BASE, CRITERIA, SCENES, terms_of
from harness.profile.counted import IN_PX, TERMS, counters
from harness.profile.design import DESIGN, Draw, draws, snapped
from harness.profile.law import COSTS, costs_of
from harness.profile.profile import fitted_of
from harness.profile.words import BY_SUM, BY_TERM

FORMAT = "raster-harness profile page"
VERSION = 1

STEPS = (1, 2, 4, 8, 16)
"""Grids that a browser's device may snap to, in 1/256 px; see `grid.js`."""

Content = dict[str, Any]


def content_of(bench: Bench, seed: int = 0) -> Content:
    """Return everything that the page holds, JSON-ready; it makes the draws itself."""
    made = draws(seed)
    fitted, plain = fitted_of(made)
    sums = {name: terms_of(bench, scene, (BASE, *CRITERIA)) for scene, name in SCENES.items()}
    return {
        "format": FORMAT,
        "version": VERSION,
        "harness": __version__,
        "design": DESIGN,
        "seed": seed,
        "draws": [_about(draw) for draw in made],
        "grids": {step: grid_of([snapped(draw, step) for draw in made]) for step in STEPS},
        "fitted": _groups(made, fitted, seed),
        "plain": _groups(made, plain, seed),
        "terms": {
            name: {**term._asdict(), "thin": BY_TERM.get(name, term.noun)}
            for name, term in TERMS.items()
        },
        "sums": {
            name: {"weights": [parts.get(term, 0) for term in TERMS], "words": BY_SUM[name]}
            for name, parts in law.SUMS.items()
        },
        "in_px": IN_PX,
        "costs": COSTS,
        "base": BASE,
        "criteria": CRITERIA,
        "scenes": {
            name: {each: _short(rows) for each, rows in found.items()}
            for name, found in sums.items()
            if found is not None
        },
    }


def grid_of(made: Sequence[Draw]) -> Content:
    """Return the checksum and the exact counters of each draw, and a criterion's terms of it."""
    counted = [counters(draw) for draw in made]
    predicted = costs_of([(draw.frame, draw.triangles) for draw in made])
    return {
        "checksums": [draw.checksum for draw in made],
        "counters": {name: [each[name] for each in counted] for name in counted[0]},
        "predicted": _short(predicted),
    }


def _about(draw: Draw) -> Content:
    about = asdict(draw)
    return {name: about[name] for name in ("kind", "name", "group", "work", "aspect", "area")}


def _groups(made: Sequence[Draw], places: list[int], seed: int) -> Content:
    """Return places among the draws, with the number of the group and of the fold of each."""
    labels = np.unique([made[place].group for place in places], return_inverse=True)[1]
    folds = law.folds_of(labels, seed).tolist()
    reach = [law.quantile(int(labels.max()) + 1, each) for each in (law.CONFIDENCE, law.OF_ALL)]
    return {"places": places, "labels": labels.tolist(), "folds": folds, "reach": reach}


def _short(rows: Any) -> list[list[float]]:
    """Return rows of numbers with digits enough for any fit."""
    return [[float(f"{value:.9g}") for value in row] for row in rows.tolist()]
