"""Says where a device counts differently from the reference, and with which polygon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.frame import Frame
from harness.rasterisers.base import Counters


@dataclass(frozen=True)
class Disagreement:
    """One counter in which a device differs from the reference.

    differing : number of polygons that differ, of `polygons`
    polygon : the first of them, as numbered in the scene
    drawn, expected : its count on the device and by the reference
    """

    counter: str
    differing: int
    polygons: int
    polygon: int
    drawn: int
    expected: int

    def __str__(self) -> str:
        return (
            f"{self.counter} differ in {self.differing} of {self.polygons} polygons; "
            f"polygon {self.polygon}: {self.drawn} instead of {self.expected}"
        )


def disagreements(frame: Frame, drawn: Counters, expected: Counters) -> list[Disagreement]:
    """Compare the counters that both have for each polygon of the frame."""
    found = []
    for name in expected:
        if name not in drawn or drawn[name].shape != expected[name].shape:
            continue
        differing = np.flatnonzero(drawn[name] != expected[name])
        if len(differing):
            first = int(differing[0])
            found.append(
                Disagreement(
                    counter=name,
                    differing=len(differing),
                    polygons=len(expected[name]),
                    polygon=int(frame.source[first]),
                    drawn=int(drawn[name][first]),
                    expected=int(expected[name][first]),
                )
            )
    return found
