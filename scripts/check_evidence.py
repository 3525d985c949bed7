"""Accept or refuse proofs of optimal triangulations, with nothing but whole numbers.

    python scripts/check_evidence.py FILE

FILE is what `harness triangulate --certify --evidence FILE` writes: a line of JSON for each polygon
(docs/reference/files.md). This program shares no code with the one that made it, and needs Python
alone. It takes each polygon to be valid, and knows three criteria: half-perimeter (H) and overdraw
(A) exactly, edge-length (E) between two whole-number square roots. It exits with 1 if it refuses
one. What follows is the proof, in the order in which it is checked.

 1. Coordinates are doubles, so 2^k times each is a whole number, for some k. Nothing is rounded.
 2. The triangles turn left, and each side of theirs is a piece of the boundary, with the interior
    on its left, or a side of another triangle run the other way. So they cover the polygon once.
 3. A triangle weighs factor * floor(scale * cost) plus a noise of less than 2^bits for each side.
    Units follow from the polygon and its triangles by a rule; the noise of all triangles is less
    than `factor`, so weight // factor is a cost in units, as low as it can be.
 4. A pair of vertices is an edge if the segment meets the boundary at its ends only and runs inside
    the polygon. Three edges round nothing are an empty triangle: triangulations consist of these.
 5. An edge may be excluded if every two empty triangles on its sides, of edges not excluded before,
    make a strictly convex quadrilateral whose other diagonal weighs less: no triangulation of
    least weight has it.
 6. Each edge has a potential y, the negative when it is run the other way, and for each empty
    triangle that is left y(ab) + y(bc) + y(ca) + lift <= weight. Add this up over a triangulation:
    y cancels along diagonals. So y summed over the boundary, plus lift times the number of
    triangles, which is the same for all triangulations, is a bound. With branches - once without
    a diagonal, once with it, when nothing that crosses it is left - the lower bound counts.
"""

import json
import math
import sys
from fractions import Fraction
from itertools import combinations
from pathlib import Path

INFLATED = 1 + Fraction(1, 2**47)  # what a cost in doubles may seem to be, at most, relative to it
ROOT_BITS = 80  # binary places of a square root


class Refused(Exception):  # noqa: N818 - says what became of the proof
    """What is wrong with a proof."""


def need(holds, reason):
    """Refuse unless something holds."""
    if not holds:
        raise Refused(reason)


def whole(value):
    """Return a whole number as it is; everything else is refused."""
    need(type(value) is int, f"{value!r:.40} is no whole number")
    return value


class Claim:
    """A polygon with triangles and the proof that they cost least."""

    def __init__(self, given):
        self.given, self.criterion = given, given["criterion"]
        known = ("half-perimeter", "overdraw", "edge-length")
        need(self.criterion in known, f"{self.criterion}: only {', '.join(known)} are checked here")
        corners = [Fraction(x) for ring in given["rings"] for point in ring for x in point]
        need(all(len(point) == 2 for ring in given["rings"] for point in ring), "no points x, y")
        self.k = max(x.denominator.bit_length() - 1 for x in corners)
        if self.k == 0:  # all whole: how often they can be halved
            while self.k > -16 and all(x * Fraction(2) ** (self.k - 1) % 1 == 0 for x in corners):
                self.k -= 1
        values = [int(x * Fraction(2) ** self.k) for x in corners]
        points = list(zip(values[::2], values[1::2], strict=True))
        first = {}
        self.site = [first.setdefault(p, i) for i, p in enumerate(points)]
        self.points, self.sites = points, sorted(first.values())
        self.boundary = self._boundary([len(ring) for ring in given["rings"]])
        self.triangles = [tuple(self.site[v] for v in self._corners(t)) for t in given["triangles"]]
        self._covers()
        self._units()

    def turn(self, a, b, c):
        """Return twice the signed area of three vertices: positive if they turn left."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def between(self, v, a, b):
        """Whether v lies inside the segment a-b."""
        if self.turn(a, b, v) != 0 or v in (a, b):
            return False
        (x, y), (ax, ay), (bx, by) = self.points[v], self.points[a], self.points[b]
        return min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by)

    def cross(self, a, b, c, d):
        """Whether two segments cross in a point inside both."""
        sides = self.turn(a, b, c), self.turn(a, b, d), self.turn(c, d, a), self.turn(c, d, b)
        return min(sides[:2]) < 0 < max(sides[:2]) and min(sides[2:]) < 0 < max(sides[2:])

    def _boundary(self, lengths):
        """Return the directed edges of the boundary, which have the interior on their left."""
        found, start = [], 0
        for number, length in enumerate(lengths):
            ring = self.site[start : start + length]
            start += length
            sides = [(a, b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True) if a != b]
            need(len(sides) > 2, "a ring without area")
            around = sum(self.turn(ring[0], a, b) for a, b in sides)
            found += sides if (around > 0) == (number == 0) else [(b, a) for a, b in sides]
        pieces = set()
        for a, b in found:  # where rings touch, an edge is split at the vertex that lies on it
            (ax, ay), on_it = self.points[a], [v for v in self.sites if self.between(v, a, b)]
            on_it.sort(key=lambda v: abs(self.points[v][0] - ax) + abs(self.points[v][1] - ay))
            pieces |= set(zip([a, *on_it], [*on_it, b], strict=True))
        return pieces

    def _corners(self, triangle):
        inside = len(triangle) == 3 and all(0 <= whole(v) < len(self.site) for v in triangle)
        need(inside, f"{triangle} is no triangle of vertices")
        return triangle

    def _covers(self):
        """Refuse triangles that do not cover the polygon exactly once (2)."""
        need(all(self.turn(*t) > 0 for t in self.triangles), "a triangle does not turn left")
        sides = [(t[i - 1], t[i]) for t in self.triangles for i in range(3)]
        need(len(set(sides)) == len(sides), "two triangles have a side in common, run one way")
        alone = {(a, b) for a, b in sides if (b, a) not in set(sides)}
        need(alone == self.boundary, "the triangles' outline is not the polygon's")

    def cost(self, a, b, c):
        """Return the cost of a triangle; for E at most 2^-80 of a step more for each side."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        step = Fraction(1, 2) ** self.k if self.k >= 0 else Fraction(2**-self.k)
        if self.criterion == "edge-length":
            squares = ((bx - ax) ** 2 + (by - ay) ** 2, (cx - bx) ** 2 + (cy - by) ** 2)
            squares += ((ax - cx) ** 2 + (ay - cy) ** 2,)
            roots = sum(1 + math.isqrt((s << 2 * ROOT_BITS) - 1) for s in squares)
            return step * Fraction(roots, 2**ROOT_BITS)
        w, h = max(ax, bx, cx) - min(ax, bx, cx), max(ay, by, cy) - min(ay, by, cy)
        if self.criterion == "half-perimeter":
            return step * (w + h)
        return step * step * (w * h - Fraction(abs(self.turn(a, b, c)), 2))

    def _units(self):
        """Work out scale, factor and bits by the rule, and refuse others (3)."""
        area, count = self.criterion == "overdraw", len(self.triangles)
        self.total = sum(self.cost(*t) for t in self.triangles)
        steps = max(max(values) - min(values) for values in zip(*self.points, strict=True))
        most = 4 * steps * steps if area else 2 * steps
        self.exact = most < 2**52 and (not area or steps < 2**25)
        self.exact &= self.criterion != "edge-length"
        exponent = 2 * self.k + 1 if area else max(self.k, 0)
        choices = [(b, 1 << (3 * count << b).bit_length()) for b in range(10, 1, -1)] + [(0, 1)]
        scale = Fraction(2) ** exponent
        fit = [c for c in choices if self.exact and 4 * self.total * scale * c[1] < 2**61]
        if fit:
            bits, factor = fit[0]
        elif self.k <= 0 and self.criterion != "edge-length" and len(self.given["rings"]) == 1:
            scale, bits, factor, self.exact = Fraction(2), 0, 1, True
        else:
            large = self.k <= 0 and self.criterion != "edge-length"
            need(not (large and self.given["proven"]), "too large to be proven")
            exponent, self.exact = 36 - math.frexp(float(self.total))[1], False
            scale = Fraction(2) ** max(-900, min(900, exponent // 4 * 4))
            bits, factor = next(c for c in choices if c[1] << 38 < 2**61)
        self.scale, self.factor, self.bits = scale, factor, bits
        said = Fraction(self.given["scale"]), whole(self.given["factor"]), whole(self.given["bits"])
        need(said == (scale, factor, bits), "the units are not those of the polygon")

    def noise(self, a, b):
        """Return the noise of an edge a < b: the upper bits of a mixed number (splitmix64)."""
        last = 2**64 - 1
        x = (a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03) & last
        x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & last
        x = (x ^ x >> 27) * 0x94D049BB133111EB & last
        return (x ^ x >> 31) >> (64 - self.bits)

    def weight(self, t):
        """Return the weight of a triangle (3); heavy ones count as 2^59, which is less."""
        units = math.floor(self.scale * self.cost(*t) * (1 if self.exact else INFLATED))
        if self.factor > 1:
            units = min(units, 2**59 // self.factor)
        return units * self.factor + sum(self.noise(*sorted((t[i - 1], t[i]))) for i in range(3))

    def is_edge(self, a, b):
        """Whether two vertices are an edge (4)."""
        if (a, b) in self.boundary or (b, a) in self.boundary:
            return True
        if any(self.between(v, a, b) for v in self.sites):
            return False
        if any(self.cross(a, b, c, d) for c, d in self.boundary):
            return False
        (ax, ay), (bx, by), inside = self.points[a], self.points[b], False
        for c, d in self.boundary:  # does a ray from the middle of a-b leave through c-d?
            (cx, cy), (dx, dy) = self.points[c], self.points[d]
            if (2 * cy > ay + by) != (2 * dy > ay + by):
                side = (2 * dx - 2 * cx) * (ay + by - 2 * cy) - (2 * dy - 2 * cy) * (
                    ax + bx - 2 * cx
                )
                inside ^= (side > 0) == (dy > cy)
        return inside

    def empty_triangles(self):
        """Return all empty triangles, counter-clockwise (4)."""
        near = {v: set() for v in self.sites}
        for a, b in combinations(self.sites, 2):
            if self.is_edge(a, b):
                near[a].add(b)
                near[b].add(a)
        found = []
        for a in self.sites:
            for b, c in combinations(sorted(v for v in near[a] if v > a), 2):
                if c in near[b] and self.turn(a, b, c) != 0:
                    t = (a, b, c) if self.turn(a, b, c) > 0 else (a, c, b)
                    outside = any((t[i], t[i - 1]) in self.boundary for i in range(3))
                    if not outside and not any(self.holds(t, v) for v in self.sites):
                        found.append(t)
        return found

    def holds(self, t, v):
        """Whether v is inside a triangle."""
        return all(self.turn(t[i - 1], t[i], v) > 0 for i in range(3))

    def exclude(self, left, weights):
        """Return the triangles that are left after the exclusions (5)."""
        edges = [tuple(map(whole, edge)) for edge in self.given["edges"]]
        need(
            all(len(e) == 2 and 0 <= e[0] < e[1] < len(self.site) for e in edges), "no edges a < b"
        )
        for number in self.given["excluded"]:
            need(0 <= whole(number) < len(edges), "an exclusion of no edge")
            a, b = edges[number]
            at = [t for t in left if a in t and b in t]
            need(not {(a, b), (b, a)} & self.boundary, f"{a}-{b} is boundary: not to be excluded")
            for one in (t for t in at if self.turn(a, b, sum(t) - a - b) > 0):
                for two in (t for t in at if self.turn(a, b, sum(t) - a - b) < 0):
                    c, d = sum(one) - a - b, sum(two) - a - b
                    convex = self.turn(c, d, b) > 0 and self.turn(d, c, a) > 0
                    other = self.weight((c, d, b)) + self.weight((d, c, a)) if convex else 0
                    lighter = convex and other < weights[one] + weights[two]
                    need(lighter, f"{a}-{b} is excluded, but may be in an optimum")
            left = [t for t in left if t not in set(at)]
        return edges, left

    def bound(self, node, edges, left, weights):
        """Return the bound that potentials or branches give (6)."""
        if "edge" in node:
            a, b = map(whole, node["edge"])
            need(a != b and {a, b} <= set(self.sites) and self.is_edge(a, b), f"{a}-{b}: no edge")
            need(not {(a, b), (b, a)} & self.boundary, f"{a}-{b} is boundary: no branch")
            without = [t for t in left if not (a in t and b in t)]
            within = [
                t for t in left if not any(self.cross(a, b, t[i - 1], t[i]) for i in range(3))
            ]
            cases = (node["without"], without), (node["within"], within)
            return min(self.bound(case, edges, some, weights) for case, some in cases)
        need(len(node["potentials"]) == len(edges), "potentials and edges differ in number")
        y = dict(zip(edges, map(whole, node["potentials"]), strict=True))
        y |= {(b, a): -value for (a, b), value in y.items()}
        lift = whole(node["lift"])
        for t in left:
            around = sum(y.get((t[i - 1], t[i]), 0) for i in range(3))
            need(around + lift <= weights[t], f"the potentials exceed the weight of {t}")
        return sum(y.get(side, 0) for side in self.boundary) + lift * len(self.triangles)

    def check(self):
        """Return what is proven, in words; refuse if it is less than what is claimed."""
        left = self.empty_triangles()
        weights = {t: self.weight(t) for t in left}
        edges, left = self.exclude(left, weights)
        least = self.bound(self.given["root"], edges, left, weights)
        bound, unit = Fraction(least // self.factor) / self.scale, 1 / self.scale
        cost, low, gap = (Fraction(self.given[name]) for name in ("cost", "lower_bound", "gap"))
        rounded = 0 if self.exact else self.total / 2**44
        need(bound <= self.total + rounded, "the bound is above the cost")
        fits = float(self.total) == cost if self.exact else abs(cost - self.total) <= rounded
        need(fits, f"the cost is {float(self.total)}, not {float(cost)}")
        need(low <= bound, f"the bound is {float(bound)}, not {float(low)}")
        share = (self.total - bound) / self.total if self.total else 0
        need(gap >= share * (1 - Fraction(1, 2**40)) - rounded, f"the gap is {float(share)}")
        if self.given["proven"] is not True:
            return f"costs at most {float(share):.3g} more than the optimum, relative to its cost"
        slack = 0 if self.exact else len(self.triangles) * unit + rounded
        need(self.total - bound <= slack, "it is not proven that nothing costs less")
        return "optimal" if share == 0 else f"optimal, to a relative error of {float(share):.2g}"


def check(given):
    """Return what one claim proves, in words; raises `Refused`."""
    try:
        return Claim(given).check()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise Refused(f"not the form of evidence: {type(error).__name__} {error}") from error


def main():
    """Check a file."""
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    refused = 0
    with Path(sys.argv[1]).open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                print(f"{number}: {check(json.loads(line))}")
            except (Refused, ValueError, RecursionError) as error:
                refused += 1
                print(f"{number}: refused: {error}")
    sys.exit(1 if refused else 0)


if __name__ == "__main__":
    main()
