"""How far the triangulations of a file are from the optimum."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import IO, Any

from numpy.typing import NDArray

from harness.export.mesh import Batch
from triangulators import TriangulationError, certify, parse
from triangulators.checking.evidence import as_claim

DEFAULT = "half-perimeter"
"""What is certified where a triangulator has no criterion of its own."""


@dataclass
class Certified:
    """Sums over the polygons of a file.

    polygons : those certified; proven : those whose triangulation is proven to be optimal
    cost, lower_bound : the criterion's sums, in the source's units
    largest_gap : the largest (cost - lower_bound) / cost of a polygon
    refused : polygons whose triangulation has T-junctions or does not cover them
    """

    criterion: str
    polygons: int = 0
    proven: int = 0
    cost: float = 0.0
    lower_bound: float = 0.0
    largest_gap: float = 0.0
    refused: int = 0

    @classmethod
    def of(cls, name: str) -> Certified:
        """Prepare for the triangulator `name`."""
        return cls(parse(name).criterion or DEFAULT)

    @classmethod
    def total(cls, parts: Iterable[Mapping[str, Any]]) -> Certified:
        """Sum up parts, each with the fields of a `Certified`; there is at least one."""
        found = [cls(**part) for part in parts]
        result = cls(found[0].criterion)
        for each in found:
            result.polygons += each.polygons
            result.proven += each.proven
            result.cost += each.cost
            result.lower_bound += each.lower_bound
            result.largest_gap = max(result.largest_gap, each.largest_gap)
            result.refused += each.refused
        return result

    def add(self, polygons: NDArray[Any], batch: Batch, evidence: IO[str] | None = None) -> None:
        """Certify the triangulations of a batch; write the proof of each to `evidence`, a line."""
        for number, polygon in enumerate(polygons):
            if number in batch.failed:
                continue
            triangles = batch.triangles[batch.starts[number] : batch.starts[number + 1]]
            try:
                found = certify(polygon, triangles, self.criterion, evidence=evidence is not None)
            except TriangulationError:
                self.refused += 1
                continue
            if evidence is not None:
                claim = as_claim(polygon, triangles, self.criterion, found)
                evidence.write(json.dumps(claim) + "\n")
            self.polygons += 1
            self.proven += found.proven
            self.cost += found.cost
            self.lower_bound += found.lower_bound
            self.largest_gap = max(self.largest_gap, found.gap)

    def __str__(self) -> str:
        """Return one line: cost, bound, gap and how many are proven."""
        gap = (self.cost - self.lower_bound) / self.cost if self.cost > 0.0 else 0.0
        text = (
            f"{self.criterion} {self.cost:.6g}, at least {self.lower_bound:.6g}, gap {gap:.2%} "
            f"(largest of a polygon {self.largest_gap:.2%}), "
            f"{self.proven:,} of {self.polygons:,} proven optimal"
        )
        return text + (f", {self.refused:,} with T-junctions not certified" if self.refused else "")
