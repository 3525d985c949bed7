"""Claims of optimality from a grammar of their format, most of them false, and what is true.

A forgery starts from a genuine claim, from one that says of a dear triangulation that it is
optimal, or from a lie: evidence, found by a linear program, that holds for all empty triangles but
those of one edge, which every cheaper triangulation has. One to three changes follow: of any value
to one of another type or size, of fields, of points and rings, of figures, of the evidence.
"""

import copy
import json
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import shapely
from scipy.optimize import linprog

from harness.export import check_evidence
from tests.endurance.brute_force import Small, sides_of
from triangulators import TriangulationError, certify, criteria, triangulate
from triangulators.certificate.certify import certificate_of
from triangulators.checking.evidence import Evidence, as_claim
from triangulators.criteria.cost import cost_of
from triangulators.polygon import boundary, boundary_area
from triangulators.verify import verify

Claim = dict[str, Any]
NAMES = ("half-perimeter", "overdraw", "edge-length")
SIZES = (4.0, 8.0, 30.0, 1000.0, 2.0**20, 1e13, 1e13, 30.0 / 256.0)


def accepted_by_package(line: str) -> bool:
    """Whether the package's checker finds from the evidence of a claim what the claim says."""
    try:
        claim = json.loads(line, object_pairs_hook=_once)
        if not _well_formed(claim):
            return False
        # Closed here: shapely would take a last vertex that repeats the first for the closing one.
        rings = [[*ring, ring[0]] for ring in claim["rings"]]
        outline = boundary(polygon := shapely.Polygon(rings[0], rings[1:]))
        triangles = np.array(claim["triangles"]).reshape(-1, 3)
        if not polygon.is_valid or not verify(polygon, triangles).conforming:
            return False
        edges, potentials = np.array(claim["edges"]).reshape(-1, 2), np.array(claim["potentials"])
        named = (claim[name] for name in ("scale", "factor", "bits"))
        evidence = Evidence(*named, edges, potentials, claim["lift"])
        criterion = criteria.find(claim["criterion"])
        cost = cost_of(criterion, boundary_area(outline), outline.expected_triangles)
        true = certificate_of(outline, outline.site[triangles], cost, evidence)
    except (TriangulationError, ValueError, LookupError, OverflowError, RecursionError):
        return False
    except shapely.GEOSException:
        return False
    return bool(
        claim["cost"] == true.cost
        and claim["lower_bound"] <= true.lower_bound
        and claim["gap"] >= true.gap
        and (true.proven or not claim["proven"])
    )


def accepted_by_file(line: str) -> bool:
    """Whether the checker that stands alone accepts a claim."""
    try:
        check_evidence.check(line)
    except check_evidence.EvidenceError:
        return False
    return True


JUDGES = {"the package": accepted_by_package, "check_evidence.py": accepted_by_file}


def truth(line: str) -> str:
    """Say of a line, by brute force, whether it is a claim at all, and whether it is true."""
    try:
        claim = json.loads(line, object_pairs_hook=_once)
        if not _well_formed(claim):
            return "no claim"
        rings = claim["rings"]
        shape = shapely.Polygon([*rings[0], rings[0][0]], [[*r, r[0]] for r in rings[1:]])
        if not shape.is_valid:
            return "no claim"
    except (ValueError, OverflowError, RecursionError, shapely.errors.GEOSException):
        return "no claim"
    small = _small(json.dumps(rings))
    if not all(0 <= v < len(small.vertex) for t in claim["triangles"] for v in t):
        return "false"
    triangles = [tuple(small.vertex[v] for v in t) for t in claim["triangles"]]
    if not small.covers(triangles):
        return "false"
    name, real = claim["criterion"], claim["criterion"] == "edge-length"
    total, best = sum(small.cost(t, name) for t in triangles), _optimum(small, name)
    off = 2.0**-40 if real or _beyond_doubles(rings, name) else 0.0
    share = float((total - best) / total)
    holds = (
        abs(claim["cost"] - float(total)) <= off * total
        and claim["lower_bound"] <= best * (1 + int(real) * off)
        and claim["gap"] >= max(0.0, share - off)
        and (not claim["proven"] or (share <= claim["gap"] + off if real else total == best))
    )
    return "true" if holds else "false"


def _beyond_doubles(rings: list[list[list[float]]], name: str) -> bool:
    """Whether doubles do not compute each cost exactly, so that the maker's sum is rounded."""
    values = [[Fraction(point[axis]) for ring in rings for point in ring] for axis in (0, 1)]
    fine = max(value.denominator for each in values for value in each)
    steps = max(max(each) - min(each) for each in values) * fine
    return bool(steps >= (2**25 if name == "overdraw" else 2**51))


@lru_cache(maxsize=64)
def _small(rings: str) -> Small:
    return Small(json.loads(rings))


@lru_cache(maxsize=64)
def _optimum(small: Small, name: str) -> Any:
    found = small.optimum(name)
    assert found is not None
    return found[0]


def _once(fields: list[tuple[str, Any]]) -> Claim:
    if len({name for name, _ in fields}) < len(fields):
        raise ValueError("doubled")
    return dict(fields)


def _well_formed(claim: Any) -> bool:
    """Whether a claim has the fields of the format, with values of their types."""

    def whole(value: Any) -> bool:
        return type(value) is int

    def double(value: Any) -> bool:
        return type(value) in (int, float) and float(value) == value and abs(value) < 2**1024

    def rows(value: Any, width: int | None, of: Any) -> bool:
        return type(value) is list and all(
            type(row) is list and width in (None, len(row)) and all(map(of, row)) for row in value
        )

    def ring(value: Any) -> bool:
        return rows(value, 2, double) and len(value) > 2

    of_field = {
        "format": lambda value: value == "raster-harness evidence 1",
        "criterion": lambda value: type(value) is str and value in NAMES,
        "rings": lambda value: type(value) is list and len(value) > 0 and all(map(ring, value)),
        "triangles": lambda value: rows(value, 3, whole),
        **dict.fromkeys(("cost", "lower_bound", "gap", "scale"), double),
        "proven": lambda value: type(value) is bool,
        **dict.fromkeys(("factor", "bits"), whole),
        "edges": lambda value: rows(value, 2, whole),
        "potentials": lambda value: rows([value], None, whole),
        "lift": whole,
    }
    if type(claim) is not dict or set(claim) != set(of_field):
        return False
    return all(holds(claim[name]) for name, holds in of_field.items())


def polygons(rng: np.random.Generator) -> Iterator[shapely.Polygon]:
    """Yield small polygons for ever, every second one with a hole."""
    number = 0
    while True:
        size = float(rng.choice(SIZES))
        turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(4, 8))))
        radius = size * rng.uniform(0.5, 1.0, len(turns))
        step = 1.0 if size > 1.0 else 1.0 / 256.0
        outer = np.column_stack([np.cos(turns), np.sin(turns)]) * radius[:, None]
        hole = rng.uniform(-0.3, 0.3, (3, 2)) * size
        outer, hole = (np.rint(ring / step) * step for ring in (outer, hole))
        polygon = shapely.Polygon(outer, [hole] if number % 2 else [])
        if polygon.is_valid and polygon.area > 0.0:
            number += 1
            yield polygon


def genuine_claims(polygon: shapely.Polygon, name: str) -> list[Claim]:
    """Return true claims about the optimum, the first, and other triangulations of a polygon."""
    found = []
    for method in (f"optimal:{name}", f"worst:{name}", "ear-clipping", "greedy"):
        triangles = triangulate(polygon, method)
        try:
            found.append(as_claim(polygon, triangles, name, certify(polygon, triangles, name)))
        except TriangulationError:
            continue  # not conforming
    return found


def lies(rng: np.random.Generator, claims: list[Claim]) -> Claim | None:
    """Return a claim whose evidence holds but for the triangles of one edge or two.

    Without these some other triangulation is the best: the claim is that it is the best of all.
    None where nothing is cheaper.
    """
    best = claims[0]
    small, name = _small(json.dumps(best["rings"])), best["criterion"]
    optimum = small.optimum(name)
    assert optimum is not None
    edges = sorted({tuple(sorted(side)) for t in optimum[1] for side in sides_of(t)})
    hidden = [frozenset(edges[k]) for k in rng.permutation(len(edges))[: rng.integers(1, 3)]]
    other = small.optimum(name, hidden)
    if other is None or other[0] <= optimum[0] * (1 + 1e-9):
        return None
    first = {number: place for place, number in reversed(list(enumerate(small.vertex)))}
    triangles = np.array([[first[v] for v in t] for t in other[1]])
    polygon = shapely.Polygon(best["rings"][0], best["rings"][1:])
    claim = as_claim(polygon, triangles, name, certify(polygon, triangles, name))
    if claim["potentials"] is None:
        return None
    try:
        checked = check_evidence.Claim(claim)
    except check_evidence.EvidenceError:
        return None
    left = [t for t in checked.empty_triangles() if not _hidden(t, hidden, small)]
    sides = sorted({tuple(sorted(side)) for t in left for side in sides_of(t)})
    row = {side: k for k, side in enumerate(sides)}
    matrix = np.zeros((len(left), len(sides) + 1))
    matrix[:, -1] = lifted = rng.random() < 0.3  # the last column is the lift
    for k, t in enumerate(left):
        for a, b in sides_of(t):
            matrix[k, row[min(a, b), max(a, b)]] += 1 if a < b else -1
    gains = np.zeros(len(sides) + 1)
    gains[-1] = lifted * len(triangles)
    for a, b in checked.boundary:
        gains[row[min(a, b), max(a, b)]] += 1 if a < b else -1
    weights = np.array([float(checked.weight(t)) for t in left])
    size = weights.max() or 1.0
    found = linprog(-gains, matrix, weights / size, bounds=(None, None))
    if found.x is None:
        return None
    *potentials, lift = (int(y) for y in np.rint(found.x * size))
    claim |= {"edges": [list(side) for side in sides], "proven": True, "gap": 0.0}
    claim |= {"potentials": potentials, "lift": lift, "lower_bound": claim["cost"]}
    if rng.random() < 0.3:  # name what was left out
        claim["edges"] += [sorted(first[v] for v in edge) for edge in hidden]
        potentials += [0] * len(hidden)
    return claim


def _hidden(t: tuple[int, ...], hidden: list[frozenset[int]], small: Small) -> bool:
    corners = {small.vertex[v] for v in t}
    return any(edge <= corners for edge in hidden)


def forgery(rng: np.random.Generator, claims: list[Claim]) -> str:
    """Return a changed claim about the polygon of genuine ones, as a line of JSON."""
    best, about = claims[0], claims[int(rng.integers(len(claims)))]
    start = rng.random()
    lie = lies(rng, claims) if start < 0.4 else None
    if lie is not None:
        claim = copy.deepcopy(lie)
    else:
        claim = copy.deepcopy((best, about)[int(rng.integers(2))])
        if start < 0.7:
            claim |= copy.deepcopy({key: about[key] for key in ("triangles", "cost")})
            claim |= {"proven": True, "gap": 0.0, "lower_bound": about["cost"]}
    for _ in range(int(rng.choice([0, 1, 1, 2] if lie else [1, 1, 1, 2, 3]))):
        change = (_change_evidence, _change_value, _change_fields, _change_rings, _change_figures)
        try:
            change[int(rng.integers(len(change)))](rng, claim)
            if rng.random() < 0.3:
                _sum_up(rng, claim)
        except (AttributeError, LookupError, OverflowError, TypeError, ValueError):
            continue  # what it would change is no more what it was
    text = json.dumps(claim)
    for mark, literal in LITERALS.items():
        text = text.replace(f'"{mark}"', literal)
    if rng.random() < 0.05:  # a field twice: which one is meant?
        key = str(rng.choice(list(claim)))
        other = json.dumps(_other(rng, best.get(key)))
        text = f'{{"{key}": {other}, {text[1:]}' if rng.random() < 0.5 else text
        text = f'{text[:-1]}, "{key}": {other}}}' if rng.random() < 0.5 else text
    return text


LITERALS = {
    "@deep": "[" * 1500 + "]" * 1500,
    "@deeper": '{"lift": ' * 1500 + "0" + "}" * 1500,
    "@large": "1" + "0" * 400,
    "@digits": "9" * 5000,
    "@fine": "0.1000000000000000055511151231257827021181583404541015625001",
    "@beyond": "1e400",
    "@zero": "-0",
}


def _other(rng: np.random.Generator, value: Any) -> Any:
    """Return something else in a value's place."""
    kinds: list[Any] = [None, True, False, 0, 1, -1, 0.5, "", [], {}, 10**30, 2**53 + 1, 2**63]
    kinds += [float("nan"), float("inf"), *LITERALS, [value], {"value": value}, str(value)]
    if type(value) in (int, float):
        kinds += [-value, value + 1, value * 2, value / 3, value + 1e-9, value + 2**32, 1e-300]
        kinds += [*[str(value)] * 4, f"{value}.0", *[float(value)] * 2, int(value), value == 1]
    return kinds[int(rng.integers(len(kinds)))]


def _change_value(rng: np.random.Generator, claim: Claim) -> None:
    """Put something else in the place of any value, however deep it lies."""
    holder: Any = claim
    while True:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        key = keys[int(rng.integers(len(keys)))]
        if not isinstance(holder[key], dict | list) or not holder[key] or rng.random() < 0.15:
            holder[key] = _other(rng, holder[key])
            return
        holder = holder[key]


def _change_fields(rng: np.random.Generator, claim: Claim) -> None:
    """Take a field or an entry away, give one more, or exchange two."""
    holder: Any = claim
    while rng.random() < 0.7:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        inner = [key for key in keys if isinstance(holder[key], dict | list) and holder[key]]
        if not inner:
            break
        holder = holder[inner[int(rng.integers(len(inner)))]]
    keys = list(holder) if isinstance(holder, dict) else range(len(holder))
    one, two = (keys[int(k)] for k in rng.integers(len(keys), size=2))
    way = int(rng.integers(4))
    if way == 0:
        del holder[one]
    elif way == 1:
        holder[one], holder[two] = holder[two], holder[one]
    elif isinstance(holder, dict):
        holder["more"] = copy.deepcopy(holder[one])
    elif way == 2:
        holder.insert(int(rng.integers(len(holder) + 1)), copy.deepcopy(holder[one]))
    else:
        holder.reverse()


def _change_rings(rng: np.random.Generator, claim: Claim) -> None:  # noqa: C901 - a way each
    """Change points or rings: their number, length, order, or where they touch."""
    rings = claim["rings"]
    ring = rings[int(rng.integers(len(rings)))]
    place = int(rng.integers(len(ring)))
    corners = np.array(rings[0], dtype=float)
    t = claim["triangles"][int(rng.integers(len(claim["triangles"])))]
    points = [point for each in rings for point in each]
    weights = rng.dirichlet([1.0, 1.0, 1.0])
    inside = [float(x) for x in np.rint(weights @ np.array([points[v] for v in t], dtype=float))]
    edge = [float(x) for x in (corners[0] + corners[1]) / 2.0]
    way = int(rng.integers(14))
    if way in (0, 1):  # a vertex that no ring has, behind another point
        rings[-1][-1] += inside * way if way else inside
    elif way == 2:
        ring[place] = ring[place] + [float(x) for x in rng.integers(0, 9, rng.integers(1, 4))]
    elif way == 3:
        ring[place] = ring[place][:1]
    elif way == 4:
        rings.append([inside] * int(rng.integers(1, 4)))
    elif way == 5:
        rings.append(copy.deepcopy(rings[int(rng.integers(len(rings)))]))
    elif way == 6:
        rings.reverse()
    elif way == 7:
        ring.reverse()
    elif way == 8:
        rings[-1].append(list(rings[-1][0]))
    elif way == 9:
        rings.append([list(points[t[0]]), inside, edge])
    elif way == 10:
        ring[place] = edge
    elif way == 11:
        ring[place] = list(points[int(rng.integers(len(points)))])
    elif way == 12:
        rings[-1].insert(int(rng.integers(len(rings[-1]) + 1)), inside)
    else:
        rings.append([list(points[v]) for v in t])


def _sum_up(rng: np.random.Generator, claim: Claim) -> None:
    """Make the cost that of the triangles that are there, and the bound the same."""
    small = Small([[point[:2] for point in ring] for ring in claim["rings"]])
    triangles = [[small.vertex[v] for v in t] for t in claim["triangles"]]
    total = float(sum(small.cost((a, b, c), claim["criterion"]) for a, b, c in triangles))
    less = round((claim["lower_bound"] - total) * claim["scale"] * claim["factor"])
    claim |= {"cost": total, "lower_bound": total, "gap": 0.0, "proven": True}
    if rng.random() < 0.7:  # a potential of the boundary, whichever way the exterior runs
        side = claim["edges"].index([0, 1])
        claim["potentials"][side] += int(rng.choice([-1, 1])) * less


def _change_figures(rng: np.random.Generator, claim: Claim) -> None:
    """Say less of cost or gap, or more of the bound, by little or by much."""
    name = str(rng.choice(["gap", "gap", "cost", "lower_bound"]))
    little = float(rng.choice([1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.5, 1.0]))
    if name == "gap":
        claim["gap"] = [-little, 0.0, claim["gap"] * (1.0 - little), -0.01][int(rng.integers(4))]
    else:
        more = 1.0 + little if name == "lower_bound" else 1.0 - little
        claim[name] = claim[name] * more
    claim["proven"] = bool(rng.random() < 0.5)


def _change_evidence(rng: np.random.Generator, claim: Claim) -> None:
    """Change one place of the evidence."""
    edges, potentials = claim["edges"], claim["potentials"]
    place, size = int(rng.integers(len(potentials))), int(rng.integers(1, 63))
    way = int(rng.integers(8))
    if way == 0:
        claim["scale"] *= 2.0 ** int(rng.choice([-1000, -60, -20, -4, -1, 1, 4, 20, 60]))
    elif way == 1:
        claim["factor"] = int(rng.choice([1, 4, claim["factor"] * 2, claim["factor"] + 1, 2**60]))
    elif way == 2:
        claim["bits"] = int(rng.choice([0, 1, 2, claim["bits"] + 1, 20, 63, -1]))
    elif way == 3:
        claim["lift"] = int(rng.choice([1, -1])) << int(rng.choice([0, 10, 20, 40, 60, 70, 100]))
    elif way == 4:
        potentials[place] += int(rng.choice([-1, 1])) << size
    elif way == 5:  # what the boundary has more makes a higher bound
        for number, (a, b) in enumerate(edges):
            if abs(a - b) == 1 and number < len(potentials):
                potentials[number] += int(rng.choice([-1, 1])) << size
    elif way == 6:
        keep = int(rng.integers(max(len(claim["triangles"]), 1)))
        claim["triangles"] = claim["triangles"][:keep] + claim["triangles"][keep + 1 :]
    else:
        edges[int(rng.integers(len(edges)))] = [int(v) for v in rng.integers(0, 12, 2)]
