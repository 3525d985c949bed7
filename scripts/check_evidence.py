"""Accept or refuse proofs of optimal triangulations, with nothing but whole numbers.

    python scripts/check_evidence.py FILE

FILE is what `harness triangulate --certify --evidence FILE` writes: a line of JSON for each polygon
(docs/reference/files.md). This program shares no code with the one that made it. It takes polygons
to be valid, and knows half-perimeter and overdraw exactly, and edge-length by whole-number square
roots. It exits with 1 if it refuses a line. Why what it checks is a proof is in docs/theory.md. In
short: triangulations consist of empty triangles. Each has a weight, its cost in units and a little
noise, and each edge a potential y, the negative when it is run the other way, so that, for all,
y(ab) + y(bc) + y(ca) + lift <= weight(abc). In the sum over a triangulation y cancels along
diagonals: y over the boundary, plus lift times the number of triangles, is a bound.
"""

import json
import math
import sys
from fractions import Fraction
from itertools import combinations
from pathlib import Path

KNOWN = ("half-perimeter", "overdraw", "edge-length")
INFLATED = 1 + Fraction(1, 2**47)  # what a cost in doubles may seem to be, at most, relative to it


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


def sides_of(t):
    """Return the directed sides of a triangle."""
    return (t[0], t[1]), (t[1], t[2]), (t[2], t[0])


class Claim:
    """A polygon with triangles and the proof that they cost least."""

    def __init__(self, given):
        self.given, self.criterion = given, given["criterion"]
        need(self.criterion in KNOWN, f"{self.criterion}: only {', '.join(KNOWN)} are checked here")
        corners = [Fraction(x) for ring in given["rings"] for point in ring for x in point]
        self.k = max(x.denominator.bit_length() - 1 for x in corners)
        while -16 < self.k <= 0 and all(x % 2 ** (1 - self.k) == 0 for x in corners):
            self.k -= 1
        values, first = [int(x * Fraction(2) ** self.k) for x in corners], {}
        self.points = list(zip(values[::2], values[1::2], strict=True))
        self.site = [first.setdefault(p, i) for i, p in enumerate(self.points)]
        self.sites = sorted(first.values())
        site = iter(self.site)
        self.boundary = self._boundary([[next(site) for _ in r] for r in given["rings"]])
        need(all(whole(v) >= 0 for t in given["triangles"] for v in t), "a vertex below 0")
        self.triangles = [tuple(self.site[v] for v in t) for t in given["triangles"]]
        need(all(self.turn(*t) > 0 for t in self.triangles), "a triangle does not turn left")
        sides = [side for t in self.triangles for side in sides_of(t)]
        need(len(set(sides)) == len(sides), "two triangles have a side in common, run one way")
        alone = set(sides) - {(b, a) for a, b in sides}
        need(alone == self.boundary, "the triangles do not cover the polygon once")
        self._units()

    def turn(self, a, b, c):
        """Return twice the signed area of three vertices: positive if they turn left."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def between(self, v, a, b):
        """Whether v lies inside the segment a-b: in line with it, and between its ends."""
        p, q = sorted((self.points[a], self.points[b]))
        return p < self.points[v] < q and self.turn(a, b, v) == 0

    def cross(self, a, b, c, d):
        """Whether two segments cross in a point inside both."""
        sides = self.turn(a, b, c), self.turn(a, b, d), self.turn(c, d, a), self.turn(c, d, b)
        return min(sides[:2]) < 0 < max(sides[:2]) and min(sides[2:]) < 0 < max(sides[2:])

    def _boundary(self, rings):
        """Return the directed edges of the boundary, which have the interior on their left."""
        found, pieces = [], set()
        for number, ring in enumerate(rings):
            sides = [(a, b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True) if a != b]
            need(len(sides) > 2, "a ring without area")
            around = sum(self.turn(ring[0], a, b) for a, b in sides)
            found += sides if (around > 0) == (number == 0) else [(b, a) for a, b in sides]
        for a, b in found:  # where rings touch, an edge is split at the vertex that lies on it
            on_it = [v for v in self.sites if self.between(v, a, b)]
            on_it.sort(key=self.points.__getitem__, reverse=self.points[a] > self.points[b])
            pieces |= set(zip([a, *on_it], [*on_it, b], strict=True))
        return pieces

    def cost(self, a, b, c):
        """Return the cost of a triangle; for E at most 2^-80 of a step more for each side."""
        (ax, ay), (bx, by), (cx, cy) = self.points[a], self.points[b], self.points[c]
        step = 1 / Fraction(2) ** self.k
        if self.criterion == "edge-length":
            sides = (bx - ax, by - ay), (cx - bx, cy - by), (ax - cx, ay - cy)
            roots = sum(1 + math.isqrt((x * x + y * y << 160) - 1) for x, y in sides)
            return step * Fraction(roots, 2**80)
        w, h = max(ax, bx, cx) - min(ax, bx, cx), max(ay, by, cy) - min(ay, by, cy)
        area = w * h - Fraction(abs(self.turn(a, b, c)), 2)
        return step * (w + h) if self.criterion == "half-perimeter" else step * step * area

    def _units(self):
        """Work out scale, factor and bits by the rule, and refuse others."""
        area, count = self.criterion == "overdraw", len(self.triangles)
        self.total = sum(self.cost(*t) for t in self.triangles)
        steps = max(max(values) - min(values) for values in zip(*self.points, strict=True))
        most = 4 * steps * steps if area else 2 * steps
        real = self.criterion == "edge-length"
        self.exact = not real and most < 2**52 and (not area or steps < 2**25)
        scale = Fraction(2) ** (2 * self.k + 1 if area else max(self.k, 0))
        choices = [(b, 1 << (3 * count << b).bit_length()) for b in range(10, 1, -1)] + [(0, 1)]
        fit = [c for c in choices if self.exact and 4 * self.total * scale * c[1] < 2**61]
        large = self.k <= 0 and not real
        if fit:
            bits, factor = fit[0]
        elif large and len(self.given["rings"]) == 1 and len(self.boundary) <= 200:
            scale, bits, factor, self.exact = Fraction(2), 0, 1, True
        else:
            need(not (large and self.given["proven"]), "too large to be proven")
            exponent, self.exact = 36 - math.frexp(float(self.total))[1], False
            scale = Fraction(2) ** max(-900, min(900, exponent // 4 * 4))
            bits, factor = next(c for c in choices if c[1] << 38 < 2**61)
        self.scale, self.factor, self.bits = scale, factor, bits
        said = [self.given[name] for name in ("scale", "factor", "bits")]
        need(said == [scale, factor, bits], "the units are not those of the polygon")

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
        units = units if self.factor == 1 else min(units, 2**59 // self.factor)
        return units * self.factor + sum(self.noise(*sorted(s)) for s in sides_of(t))

    def is_edge(self, a, b):
        """Whether two vertices are an edge."""
        if {(a, b), (b, a)} & self.boundary:
            return True
        met = any(self.between(v, a, b) for v in self.sites)
        if met or any(self.cross(a, b, c, d) for c, d in self.boundary):
            return False
        (x, y), inside = map(sum, zip(self.points[a], self.points[b], strict=True)), False
        for c, d in self.boundary:  # does a ray from the middle of a-b, x/2 and y/2, meet c-d?
            (cx, cy), (dx, dy) = self.points[c], self.points[d]
            if (2 * cy > y) != (2 * dy > y):
                inside ^= ((dx - cx) * (y - 2 * cy) > (dy - cy) * (x - 2 * cx)) == (dy > cy)
        return inside

    def empty_triangles(self):
        """Return all empty triangles, counter-clockwise."""
        edges, found = {e for e in combinations(self.sites, 2) if self.is_edge(*e)}, []
        for a, b, c in combinations(self.sites, 3):
            if (a, b) in edges and (b, c) in edges and (a, c) in edges and self.turn(a, b, c) != 0:
                t = (a, b, c) if self.turn(a, b, c) > 0 else (a, c, b)
                outside = any((q, p) in self.boundary for p, q in sides_of(t))
                inner = (all(self.turn(p, q, v) > 0 for p, q in sides_of(t)) for v in self.sites)
                if not outside and not any(inner):
                    found.append(t)
        return found

    def exclude(self, left, weights):
        """Return the triangles that are left after the exclusions."""
        edges = [(whole(a), whole(b)) for a, b in self.given["edges"]]
        need(all(0 <= a < b < len(self.site) for a, b in edges), "no edges a < b")
        for number in self.given["excluded"]:
            need(0 <= whole(number) < len(edges), "an exclusion of no edge")
            a, b = edges[number]
            at = [t for t in left if {a, b} <= set(t)]
            need(not {(a, b), (b, a)} & self.boundary, f"{a}-{b}, a side, is excluded")
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
        """Return the bound that potentials or branches give."""
        if "edge" in node:
            a, b = map(whole, node["edge"])
            diagonal = a != b and {a, b} <= set(self.sites) and self.is_edge(a, b)
            need(diagonal and not {(a, b), (b, a)} & self.boundary, f"{a}-{b} is no diagonal")
            without = [t for t in left if not {a, b} <= set(t)]
            within = [t for t in left if not any(self.cross(a, b, *s) for s in sides_of(t))]
            low = self.bound(node["without"], edges, without, weights)
            return min(low, self.bound(node["within"], edges, within, weights))
        y, lift = dict(zip(edges, map(whole, node["potentials"]), strict=True)), whole(node["lift"])
        y |= {(b, a): -value for (a, b), value in y.items()}
        for t in left:
            around = sum(y.get(side, 0) for side in sides_of(t))
            need(around + lift <= weights[t], f"the potentials exceed the weight of {t}")
        return sum(y.get(side, 0) for side in self.boundary) + lift * len(self.triangles)

    def check(self):
        """Return what is proven, in words; refuse if it is less than what is claimed."""
        left = self.empty_triangles()
        weights = {t: self.weight(t) for t in left}
        edges, left = self.exclude(left, weights)
        bound = self.bound(self.given["root"], edges, left, weights) // self.factor / self.scale
        cost, low, gap = (Fraction(self.given[name]) for name in ("cost", "lower_bound", "gap"))
        rounded = 0 if self.exact else self.total / 2**44
        need(bound <= self.total + rounded, "the bound is above the cost")
        need(abs(cost - Fraction(float(self.total))) <= rounded, f"the cost is {self.total}")
        need(low <= bound, f"the bound is {float(bound)}")
        share = (self.total - bound) / self.total if self.total else Fraction(0)
        need(gap >= share * (1 - Fraction(1, 2**40)) - rounded, f"the gap is {float(share)}")
        if self.given["proven"] is not True:
            return f"costs at most {float(share):.3g} more than the optimum, relative to its cost"
        slack = 0 if self.exact else len(self.triangles) / self.scale + rounded
        need(self.total - bound <= slack, "it is not proven that nothing costs less")
        return "optimal" if share == 0 else f"optimal, to a relative error of {float(share):.2g}"


def check(given):
    """Return what one claim proves, in words; raises `Refused`."""
    try:
        return Claim(given).check()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise Refused(f"this is no evidence: {type(error).__name__} {error}") from error


if __name__ == "__main__":
    refused = 0
    for number, line in enumerate(Path(sys.argv[1]).read_text(encoding="utf-8").splitlines(), 1):
        try:
            print(f"{number}: {check(json.loads(line))}")
        except (Refused, ValueError, RecursionError) as error:
            refused += 1
            print(f"{number}: refused: {error}")
    sys.exit(1 if refused else 0)
