"""Checker of optimality proofs for triangulations, in exact integer arithmetic.

    raster-harness check-evidence FILE
    python check_evidence.py FILE

`raster-harness triangulate --certify --evidence FILE` writes FILE: a line of JSON for each polygon
(docs/reference/files.md). This file needs only Python and shares no code with the program that
writes proofs. The fields of a line are not trusted: rings must be simple, the triangles must be
empty and cover the polygon once, and weights, cost, bound and gap are computed here. Half-perimeter
and overdraw are exact, and edge-length uses integer square roots: sums of doubles are accepted with
a relative error up to 2^-44. The exit code is 1 if a line is refused.

The proof is explained in docs/theory.md. In short: a triangle has a weight, its scaled cost plus a
little noise, and an edge has a potential y, negated for the opposite direction, so that for all
empty triangles y(ab) + y(bc) + y(ca) + lift <= weight(abc). In the sum over a triangulation, y
cancels along diagonals: the sum of y over the boundary, plus lift times the number of triangles, is
a bound.
"""

from __future__ import annotations

import json
import math
import sys
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    Edge = tuple[int, int]
    Triangle = tuple[int, int, int]

FORMAT = "raster-harness evidence 1"
ABOUT = {"format", "criterion", "rings", "triangles", "cost", "lower_bound", "gap", "proven"}
FIELDS = ABOUT | {"scale", "factor", "bits", "edges", "potentials", "lift"}
CRITERIA = ("half-perimeter", "overdraw", "edge-length")
COST_FACTOR = 1 + Fraction(1, 2**47)  # upper bound of a cost in doubles, relative to the exact cost
DOUBLE_ERROR = Fraction(1, 2**44)  # maximum relative error of sums of doubles


class EvidenceError(Exception):
    """An invalid proof; the message is the reason."""


def require(holds: Any, reason: str) -> None:
    """Raise EvidenceError with `reason` unless `holds`."""
    if not holds:
        raise EvidenceError(reason)


def require_int(value: Any) -> int:
    """Return an integer; refuse any other value."""
    require(type(value) is int, f"{value!r:.40} is not an integer")
    return int(value)


def require_double(value: Any) -> Fraction:
    """Return the exact value of a double of the file; refuse any other value."""
    # Integers that a double cannot hold are refused, too.
    is_double = type(value) in (int, float) and value == float(value)
    require(is_double, f"{value!r:.40} is not a double")
    return Fraction(value)


def require_list(value: Any, length: int | None = None) -> list[Any]:
    """Return a list of the required length; refuse any other value."""
    require(type(value) is list, f"{value!r:.40} is not a list")
    require(length in (None, len(value)), f"{value!r:.40} should have {length} entries")
    return list(value)


def list_directed_sides(t: Triangle) -> tuple[Edge, Edge, Edge]:
    """Return the directed sides of a triangle."""
    return (t[0], t[1]), (t[1], t[2]), (t[2], t[0])


class Claim:
    """A polygon with triangles and the proof that their cost is minimal.

    points : exact integer coordinates, the file's times 2^k
    site, sites : for each vertex, the first vertex at its position; all such first vertices, sorted
    boundary : directed edges with the interior on the left
    exact : True if doubles hold all costs exactly
    """

    def __init__(self, fields: Any) -> None:
        require(
            type(fields) is dict and fields.get("format") == FORMAT, f"the format is not {FORMAT}"
        )
        require(fields.get("potentials") is not None, "the line has no proof (no potentials)")
        require(fields.keys() == FIELDS, f"the fields differ from {', '.join(sorted(FIELDS))}")
        self.fields, self.criterion = fields, fields["criterion"]
        require(
            self.criterion in CRITERIA,
            f"{self.criterion}: unsupported criterion (supported: {', '.join(CRITERIA)})",
        )
        points = [
            require_list(point, 2)
            for ring in require_list(fields["rings"])
            for point in require_list(ring)
        ]
        coordinates = [require_double(x) for point in points for x in point]
        self.k = max(x.denominator.bit_length() - 1 for x in coordinates)
        while -16 < self.k <= 0 and all(x % 2 ** (1 - self.k) == 0 for x in coordinates):
            self.k -= 1
        values = [int(x * Fraction(2) ** self.k) for x in coordinates]
        first: dict[tuple[int, int], int] = {}
        self.points = list(zip(values[::2], values[1::2], strict=True))
        self.site = [first.setdefault(p, i) for i, p in enumerate(self.points)]
        self.sites = sorted(first.values())
        site = iter(self.site)
        self.boundary = self._list_boundary([[next(site) for _ in r] for r in fields["rings"]])
        triangles = [require_list(t, 3) for t in require_list(fields["triangles"])]
        require(all(require_int(v) >= 0 for t in triangles for v in t), "a negative vertex index")
        self.triangles = [tuple(self.site[v] for v in t) for t in triangles]
        require(
            all(self.orient(*t) > 0 for t in self.triangles), "a triangle is not counter-clockwise"
        )
        sides = [side for t in self.triangles for side in list_directed_sides(t)]
        require(len(set(sides)) == len(sides), "two triangles are on the same side of an edge")
        unpaired = set(sides) - {(b, a) for a, b in sides}
        require(unpaired == self.boundary, "the triangles do not cover the polygon once")
        self._compute_weight_parameters()

    def orient(self, a: int, b: int, c: int) -> int:
        """Return twice the signed area of triangle a, b, c: positive if counter-clockwise."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def is_between(self, v: int, a: int, b: int) -> bool:
        """Return whether vertex v lies on the segment a-b, between its ends."""
        p, q = sorted((self.points[a], self.points[b]))
        return p < self.points[v] < q and self.orient(a, b, v) == 0

    def is_crossing(self, a: int, b: int, c: int, d: int) -> bool:
        """Return whether two segments cross in a point inside both."""
        low, high = sorted((self.orient(a, b, c), self.orient(a, b, d)))
        lower, upper = sorted((self.orient(c, d, a), self.orient(c, d, b)))
        return low < 0 < high and lower < 0 < upper

    def _list_boundary(self, rings: list[list[int]]) -> set[Edge]:
        """Return the directed edges of the boundary, with the interior on the left.

        Each ring is simple. The triangles imply that holes are inside and disjoint: a point that k
        holes enclose is covered 1 - k times if the exterior encloses it, and never less than 0.
        """
        edges: list[Edge] = []
        pieces: list[Edge] = []
        for index, ring in enumerate(rings):
            sides = [(a, b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True) if a != b]
            require(len(sides) > 2, "a ring without area")
            meets_itself = len({a for a, _ in sides}) < len(sides)
            meets_itself |= any(self.is_between(v, *side) for side in sides for v, _ in sides)
            meets_itself |= any(self.is_crossing(*s, *t) for s, t in combinations(sides, 2))
            require(not meets_itself, "a ring intersects or touches itself")
            doubled_area = sum(self.orient(ring[0], a, b) for a, b in sides)
            edges += sides if (doubled_area > 0) == (index == 0) else [(b, a) for a, b in sides]
        for a, b in edges:  # if rings touch, an edge is split at the vertex on it
            splits = [v for v in self.sites if self.is_between(v, a, b)]
            splits.sort(key=self.points.__getitem__, reverse=self.points[a] > self.points[b])
            pieces += zip([a, *splits], [*splits, b], strict=True)
        require(len(set(pieces)) == len(pieces), "two rings share an edge")
        return set(pieces)

    def compute_cost(self, a: int, b: int, c: int) -> Fraction:
        """Return the cost of a triangle; for edge-length, up to 2^-80 steps too high per side."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        step = 1 / Fraction(2) ** self.k
        if self.criterion == "edge-length":
            sides = (bx - ax, by - ay), (cx - bx, cy - by), (ax - cx, ay - cy)
            roots = sum(1 + math.isqrt((x * x + y * y << 160) - 1) for x, y in sides)
            return step * Fraction(roots, 2**80)
        w, h = max(ax, bx, cx) - min(ax, bx, cx), max(ay, by, cy) - min(ay, by, cy)
        area = w * h - Fraction(abs(self.orient(a, b, c)), 2)
        return step * (w + h) if self.criterion == "half-perimeter" else step * step * area

    def _compute_weight_parameters(self) -> None:
        """Compute scale, factor and bits of triangle weights; refuse a proof with other values."""
        area, count = self.criterion == "overdraw", len(self.triangles)
        self.total = sum(self.compute_cost(*t) for t in self.triangles)
        steps = max(max(values) - min(values) for values in zip(*self.points, strict=True))
        max_steps = 4 * steps * steps if area else 2 * steps
        self.real = real = self.criterion == "edge-length"
        self.exact = not real and max_steps < 2**52 and (not area or steps < 2**25)
        scale = Fraction(2) ** (2 * self.k + 1 if area else max(self.k, 0))
        choices = [(b, 1 << (3 * count << b).bit_length()) for b in range(10, 1, -1)] + [(0, 1)]
        fit = [c for c in choices if self.exact and 4 * self.total * scale * c[1] < 2**61]
        large = self.k <= 0 and not real
        if fit:
            bits, factor = fit[0]
        else:
            exponent = (36 - math.frexp(float(self.total))[1]) // 4 * 4
            small = exponent >= 900 or not float(self.total)
            off = "large" * large or "small" * small
            require(not (off and self.fields["proven"]), f"too {off} to be proven")
            scale, self.exact = Fraction(2) ** max(-900, min(900, exponent)), False
            bits, factor = next(c for c in choices if c[1] << 38 < 2**61)
        self.scale, self.factor, self.bits = scale, factor, bits
        stated_scale = require_double(self.fields["scale"])
        stated = stated_scale, *(require_int(self.fields[name]) for name in ("factor", "bits"))
        reason = "scale, factor and bits do not follow from the polygon"
        require(stated == (scale, factor, bits), reason)

    def compute_noise(self, a: int, b: int) -> int:
        """Return the noise of an edge a < b: the upper bits of a hash (splitmix64)."""
        last = 2**64 - 1
        x = (a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03) & last
        x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & last
        x = (x ^ x >> 27) * 0x94D049BB133111EB & last
        return (x ^ x >> 31) >> (64 - self.bits)

    def compute_weight(self, t: Triangle) -> int:
        """Return a triangle's weight: floor(scale * cost) * factor, at most 2^59, plus noise."""
        units = math.floor(self.scale * self.compute_cost(*t) * (1 if self.exact else COST_FACTOR))
        units = min(units, 2**59 // self.factor)
        return units * self.factor + sum(
            self.compute_noise(*sorted(s)) for s in list_directed_sides(t)
        )

    def is_edge(self, a: int, b: int) -> bool:
        """Return whether the segment a-b is a boundary edge, or a diagonal inside the polygon."""
        if {(a, b), (b, a)} & self.boundary:
            return True
        met = any(self.is_between(v, a, b) for v in self.sites)
        if met or any(self.is_crossing(a, b, c, d) for c, d in self.boundary):
            return False
        (x, y), inside = map(sum, zip(self.points[a], self.points[b], strict=True)), False
        for c, d in self.boundary:  # does a ray from the midpoint of a-b, (x/2, y/2), meet c-d?
            (cx, cy), (dx, dy) = self.points[c], self.points[d]
            if (2 * cy > y) != (2 * dy > y):
                inside ^= ((dx - cx) * (y - 2 * cy) > (dy - cy) * (x - 2 * cx)) == (dy > cy)
        return inside

    def list_empty_triangles(self) -> list[Triangle]:
        """Return all triangles inside the polygon without a vertex inside, counter-clockwise."""
        edges, triangles = {e for e in combinations(self.sites, 2) if self.is_edge(*e)}, []
        for a, b, c in combinations(self.sites, 3):
            if {(a, b), (b, c), (a, c)} <= edges and self.orient(a, b, c) != 0:
                t = (a, b, c) if self.orient(a, b, c) > 0 else (a, c, b)
                outside = any((q, p) in self.boundary for p, q in list_directed_sides(t))
                inner = (
                    all(self.orient(p, q, v) > 0 for p, q in list_directed_sides(t))
                    for v in self.sites
                )
                if not outside and not any(inner):
                    triangles.append(t)
        return triangles

    def compute_bound(self, weights: dict[Triangle, int]) -> int:
        """Return the lower bound from the potentials, checked for all empty triangles."""
        pairs = [require_list(edge, 2) for edge in require_list(self.fields["edges"])]
        edges = [(require_int(a), require_int(b)) for a, b in pairs]
        is_ordered = all(0 <= a < b < len(self.site) for a, b in edges)
        require(is_ordered, "an edge is not (a, b) with a < b")
        require(len(set(edges)) == len(edges), "duplicate edge")
        potentials = require_list(self.fields["potentials"], len(edges))
        lift = require_int(self.fields["lift"])
        y = dict(zip(edges, map(require_int, potentials), strict=True))
        y |= {(b, a): -value for (a, b), value in y.items()}
        for t, weight in weights.items():
            total = sum(y.get(side, 0) for side in list_directed_sides(t))
            require(total + lift <= weight, f"the potentials exceed the weight of {t}")
        return sum(y.get(side, 0) for side in self.boundary) + lift * len(self.triangles)

    def check(self) -> str:
        """Return the proven statement; refuse if it is weaker than the claim."""
        empty = self.list_empty_triangles()
        lowest_first = {min(t, t[1:] + t[:1], t[2:] + t[:2]) for t in self.triangles}
        require(lowest_first <= set(empty), "a triangle has a vertex inside, or is outside")
        weights = {t: self.compute_weight(t) for t in empty}
        bound = self.compute_bound(weights) // self.factor / self.scale
        cost, low, gap = (
            require_double(self.fields[name]) for name in ("cost", "lower_bound", "gap")
        )
        off = 0 if self.exact else DOUBLE_ERROR
        require(bound <= self.total * (1 + off), "the bound is above the cost")
        near = abs(cost - Fraction(float(self.total))) <= self.total * off
        require(near, f"the stated cost differs from the cost, {float(self.total)}")
        require(low <= bound, f"the stated bound exceeds the proven one, {float(bound)}")
        # The relative gap from exact numbers, a lower bound of the stated gap.
        share = max(Fraction(0), (self.total - bound) / self.total if self.total else 0)
        require(
            gap >= 0 and gap >= Fraction(float(share)) - off,
            f"the stated gap is below {float(share)}",
        )
        require(type(self.fields["proven"]) is bool, "proven is neither true nor false")
        if not self.fields["proven"]:
            return f"at most {float(share):.3g} of the cost above the optimum"
        slack = 0 if self.exact else len(self.triangles) / self.scale + self.total * off
        require(self.total - bound <= slack, "optimality is not proven")
        return "optimal" if share == 0 else f"optimal, to a relative error of {float(share):.2g}"


def require_unique_fields(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of an object; refuse duplicate fields, which are ambiguous."""
    require(len(dict(fields)) == len(fields), "duplicate field")
    return dict(fields)


def check_line(line: str | bytes) -> str:
    """Return the statement that a line of JSON proves; raises `EvidenceError`."""
    try:
        return Claim(json.loads(line, object_pairs_hook=require_unique_fields)).check()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise EvidenceError(f"not a proof ({type(error).__name__} {error})") from error
    except RecursionError:
        raise EvidenceError("not a proof (nested too deeply)") from None


def check_lines(lines: Iterable[str | bytes]) -> Iterator[tuple[int, str, bool]]:
    """Yield for each line of a file the number, the result, and whether the proof holds."""
    for index, line in enumerate(lines, 1):
        try:
            yield index, check_line(line), True
        except EvidenceError as reason:
            yield index, f"refused: {reason}", False


if __name__ == "__main__":
    refused = []
    with Path(sys.argv[1]).open("rb") as file:
        for index, result, holds in check_lines(file):
            print(f"{index}: {result}")
            refused += [] if holds else [index]
    sys.exit(1 if refused else 0)
