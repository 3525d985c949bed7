"""Sums over polygons for each triangulator, and the small files of a part's sums."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.atomic import Output
from harness.results.run_folder import UNREADABLE
from harness.scaling.dataset import PartResult

GAINED = (  # depend on the triangulation: exact counters, then criteria in px and px^2
    *("quads", "helper_lanes", "partial_quads", "blocks", "bbox_tests"),
    *("half_perimeter", "overdraw"),
)

MEASURES = ("fragments", "triangles", *GAINED)  # sums over a footprint's triangles
BINS = 400  # of a gain's histogram, 0.5 % each, from -100 % (or less) to 100 %

COUNTS = ("polygons", "vertices", "tiles", "dropped", "repaired")
"""Counts of `Sums`: tiles with a polygon, dropped (undrawable) and repaired (invalid) polygons."""

Group = tuple[int | None, str]  # zoom and layer of polygons of map tiles
FOOTPRINTS: Group = (None, "")  # the group of all footprints


class Sums(NamedTuple):
    """Sums over footprints, or polygons of map tiles, for t triangulators."""

    counts: NDArray[np.int64]  # (len(COUNTS),)
    totals: NDArray[np.float64]  # (t, len(MEASURES)), integers except the criteria
    bins: NDArray[np.int64]  # (t, len(GAINED), BINS), number of polygons by gain

    @classmethod
    def empty(cls, triangulators: int, **counts: int) -> "Sums":
        """Return sums of 0 for t triangulators, with the given counts."""
        totals = np.zeros((triangulators, len(MEASURES)))
        bins = np.zeros((triangulators, len(GAINED), BINS), np.int64)
        return cls(np.array([counts.get(name, 0) for name in COUNTS], np.int64), totals, bins)

    def get_count(self, name: str) -> int:
        """Return a count by its name in `COUNTS`."""
        return int(self.counts[COUNTS.index(name)])

    def get_total(self, measure: str) -> NDArray[np.float64]:
        """Return a measure's sum for each triangulator, (t,)."""
        return self.totals[:, MEASURES.index(measure)]


@dataclass
class CensusCounts:
    """Counts of one or more parts."""

    groups: dict[Group, Sums] = field(default_factory=dict)
    cells: list[pd.DataFrame] = field(default_factory=list)  # x, y, footprints, helper lanes
    damaged: list[tuple[str, str]] = field(default_factory=list)  # (tile, reason)
    layers: set[str] = field(default_factory=set)  # names

    def add(self, group: Group, sums: Sums) -> None:
        """Add sums to a group."""
        old = self.groups.get(group)
        self.groups[group] = sums if old is None else Sums(*map(np.add, old, sums))

    def sum_groups(self) -> Sums:
        """Return the sum of all groups, of which there is at least one."""
        return Sums(*(sum(values) for values in zip(*self.groups.values(), strict=True)))

    def save(self, path: Path, done: PartResult) -> None:
        """Write a part's file, with these counts and the part's result, atomically."""
        cells = [_sum_cells(self.cells)] if self.cells else []
        content = {
            "done": asdict(done),
            "groups": list(self.groups),
            "cells": [list(frame) for frame in cells],
            "damaged": self.damaged,
            "known": sorted(self.layers),
        }
        arrays = {
            name: np.array([getattr(sums, name) for sums in self.groups.values()])
            for name in Sums._fields
        } | {"cells": np.array(cells, np.int64)}
        with Output(path, forced=True) as output:
            with output.open_published() as file:
                np.savez_compressed(file, allow_pickle=False, content=json.dumps(content), **arrays)
            output.publish()

    @classmethod
    def read(cls, files: Iterable[Path]) -> "CensusCounts":
        """Read and sum the files of parts."""
        result = cls()
        for file in files:
            with np.load(file, allow_pickle=False) as stored:
                content = json.loads(str(stored["content"]))
                arrays = zip(*(stored[name] for name in Sums._fields), strict=True)
                for (zoom, layer), sums in zip(content["groups"], arrays, strict=True):
                    result.add((zoom, layer), Sums(*sums))
                for rows, columns in zip(stored["cells"], content["cells"], strict=True):
                    result.cells.append(pd.DataFrame(rows, columns=columns))
            result.damaged += map(tuple, content["damaged"])
            result.layers.update(content["known"])
        if result.cells:
            result.cells = [_sum_cells(result.cells)]
        return result


def _sum_cells(cells: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(cells).groupby(["x", "y"], as_index=False).sum()


def read_part_result(file: Path) -> PartResult | None:
    """Return the result in a part's file, or None if the file is invalid."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return PartResult(**json.loads(str(arrays["content"]))["done"])
    except (*UNREADABLE, TypeError):
        return None
