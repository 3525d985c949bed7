"""Sums over polygons, for each of several triangulators, and the files that hold a part's.

A part's file holds sums and a histogram of the gains for each group of its polygons, and the sums
of each cell of a map. They are integers, but for the criteria, and small; so a country's are added
up in a moment.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.scaling.parts import Done, lasting
from harness.stored.atomic import Output
from harness.stored.folder import UNREADABLE

GAINED = (
    *("quads", "helper_lanes", "partial_quads", "blocks", "bbox_tests"),
    *("half_perimeter", "overdraw"),
)
"""Measures that a choice of triangulation changes: exact counters, then criteria in px and px^2."""

MEASURES = ("fragments", "triangles", *GAINED)
"""Sums over a footprint's triangles."""

BINS = 400
"""Bins of a gain, 0.5 % each, from -100 % to 100 %; what is beyond is in the first."""


Group = tuple[int | None, str]
"""Zoom and layer of polygons of map tiles; footprints are all of one group."""

FOOTPRINTS: Group = (None, "")

_COUNTS = ("footprints", "vertices", "tiles", "dropped", "repaired")


@dataclass
class Sums:
    """Sums over footprints, or polygons of map tiles, for t triangulators.

    tiles : that hold a polygon
    dropped, repaired : polygons of tiles that cannot be drawn, and that had to be mended
    totals : (t, len(MEASURES)) float64; integers but for the criteria
    bins : (t, len(GAINED), BINS) int64, footprints by what they gain
    cells : (column, row) to (t + 1,) float64: footprints, then each triangulator's helper lanes
    """

    footprints: int
    vertices: int
    totals: NDArray[np.float64]
    bins: NDArray[np.int64]
    cells: dict[tuple[int, int], NDArray[np.float64]]
    tiles: int = 0
    dropped: int = 0
    repaired: int = 0

    @classmethod
    def empty(cls, triangulators: int) -> "Sums":
        """Return those of no footprint."""
        totals = np.zeros((triangulators, len(MEASURES)))
        return cls(0, 0, totals, np.zeros((triangulators, len(GAINED), BINS), np.int64), {})

    def add(self, other: "Sums") -> None:
        """Add other footprints'."""
        for name in _COUNTS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.totals += other.totals
        self.bins += other.bins
        self.add_cells(other.cells)

    def add_cells(self, cells: Mapping[tuple[int, int], NDArray[np.float64]]) -> None:
        """Add what other footprints have in each cell."""
        for cell, values in cells.items():
            self.cells[cell] = self.cells[cell] + values if cell in self.cells else values

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file keeps."""
        cells = sorted(self.cells)
        width = len(self.totals) + 1
        return {
            "size": np.array([getattr(self, name) for name in _COUNTS], np.int64),
            "totals": self.totals,
            "bins": self.bins,
            "cells": np.array(cells, np.int64).reshape(-1, 2),
            "cell_sums": np.array([self.cells[cell] for cell in cells]).reshape(-1, width),
        }

    @classmethod
    def of_arrays(cls, kept: Mapping[str, NDArray[Any]]) -> "Sums":
        """Undo `arrays`."""
        counts = dict(zip(_COUNTS, kept["size"].tolist(), strict=True))
        places = map(tuple, kept["cells"].tolist())
        cells = dict(zip(places, kept["cell_sums"], strict=True))
        return cls(totals=kept["totals"], bins=kept["bins"], cells=cells, **counts)


def save(
    place: Path, done: Done, groups: Mapping[Group, Sums], more: Mapping[str, Any] | None = None
) -> None:
    """Write a part's file, whole or not at all; `more` is anything that JSON can hold."""
    told = {"told": lasting(done), "groups": list(groups), "more": dict(more or {})}
    arrays = {
        f"{number} {name}": array
        for number, sums in enumerate(groups.values())
        for name, array in sums.arrays().items()
    }
    with Output(place, forced=True) as output:
        with output.file() as file:
            texts = {name: np.array(json.dumps(value)) for name, value in told.items()}
            np.savez_compressed(file, allow_pickle=False, **texts, **arrays)
        output.publish()


def read_counted(file: Path) -> Done | None:
    """Return what a part's file says of itself; None where it is no such file, or is damaged."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return Done(**json.loads(str(arrays["told"])))
    except (*UNREADABLE, TypeError):
        return None


def groups_of(file: Path) -> tuple[dict[Group, Sums], dict[str, Any]]:
    """Return the sums that a part's file holds, and what else `save` was given."""
    with np.load(file, allow_pickle=False) as kept:
        names = [tuple(each) for each in json.loads(str(kept["groups"]))]
        own = (
            {name.partition(" ")[2]: kept[name] for name in kept if name.startswith(f"{number} ")}
            for number in range(len(names))
        )
        return dict(zip(names, map(Sums.of_arrays, own), strict=True)), json.loads(
            str(kept["more"])
        )


def total(folder: Path, keys: Iterable[str]) -> dict[Group, Sums]:
    """Add up the files of parts, group by group."""
    groups: dict[Group, Sums] = {}
    for key in keys:
        for group, sums in groups_of(folder / f"{key}.npz")[0].items():
            if group in groups:
                groups[group].add(sums)
            else:
                groups[group] = sums
    return groups


def whole(groups: Mapping[Group, Sums], triangulators: int) -> Sums:
    """Add up groups."""
    sums = Sums.empty(triangulators)
    for each in groups.values():
        sums.add(each)
    return sums
