"""Random claims of optimality in the format of evidence, mostly false, and the truth about them.

A forgery begins with a genuine claim, with a claim that a worse triangulation is optimal, or with a
lie: evidence from a linear program that is valid for all empty triangles except those at an edge
that every cheaper triangulation needs. One to three changes follow: of the type or size of a value,
of fields, points, rings, numbers, or of the evidence.
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
from tests.endurance.brute_force import SmallPolygon, list_sides
from tests.endurance.programs import choose_value
from triangulators import TriangulationError, certify, criteria, triangulate
from triangulators.certificate.certify import make_certificate
from triangulators.checking.evidence import Evidence, make_claim
from triangulators.criteria.cost import make_cost
from triangulators.polygon import boundary, boundary_area
from triangulators.verify import verify

Claim = dict[str, Any]
NAMES = ("half-perimeter", "overdraw", "edge-length")
SIZES = (4.0, 8.0, 30.0, 1000.0, 2.0**20, 1e13, 1e13, 30.0 / 256.0)


def is_accepted_by_package(line: str) -> bool:
    try:
        claim = json.loads(line, object_pairs_hook=_reject_duplicates)
        if not _is_well_formed(claim):
            return False
        outline = boundary(polygon := _make_shape(claim["rings"]))
        triangles = np.array(claim["triangles"]).reshape(-1, 3)
        if not polygon.is_valid or not verify(polygon, triangles).conforming:
            return False
        edges, potentials = np.array(claim["edges"]).reshape(-1, 2), np.array(claim["potentials"])
        fields = (claim[name] for name in ("scale", "factor", "bits"))
        evidence = Evidence(*fields, edges, potentials, claim["lift"])
        criterion = criteria.find(claim["criterion"])
        cost = make_cost(criterion, boundary_area(outline), outline.expected_triangles)
        certificate = make_certificate(outline, outline.site[triangles], cost, evidence)
    except (TriangulationError, ValueError, LookupError, OverflowError, RecursionError):
        return False
    except shapely.GEOSException:
        return False
    return bool(
        claim["cost"] == certificate.cost
        and claim["lower_bound"] <= certificate.lower_bound
        and claim["gap"] >= certificate.gap
        and (certificate.proven or not claim["proven"])
    )


def _make_shape(rings: list[list[list[float]]]) -> shapely.Polygon:
    # Close the rings here: shapely treats a last vertex that repeats the first as closing.
    closed = [[*ring, ring[0]] for ring in rings]
    return shapely.Polygon(closed[0], closed[1:])


def is_accepted_by_file(line: str) -> bool:
    try:
        check_evidence.check_line(line)
    except check_evidence.EvidenceError:
        return False
    return True


CHECKERS = {"the package": is_accepted_by_package, "check_evidence.py": is_accepted_by_file}


def decide_truth(line: str) -> str:
    """Return "no claim", "true" or "false" for a line, by brute force."""
    try:
        claim = json.loads(line, object_pairs_hook=_reject_duplicates)
        if not _is_well_formed(claim) or not _make_shape(rings := claim["rings"]).is_valid:
            return "no claim"
    except (ValueError, OverflowError, RecursionError, shapely.GEOSException):
        return "no claim"
    polygon = _small(json.dumps(rings))
    if not all(0 <= v < len(polygon.vertex_of) for t in claim["triangles"] for v in t):
        return "false"
    triangles = [tuple(polygon.vertex_of[v] for v in t) for t in claim["triangles"]]
    if not polygon.covers(triangles):
        return "false"
    name, inexact = claim["criterion"], claim["criterion"] == "edge-length"
    total, best = sum(polygon.cost(t, name) for t in triangles), _optimum(polygon, name)
    tolerance = 2.0**-40 if inexact or _exceeds_doubles(rings, name) else 0.0
    gap = float((total - best) / total)
    is_true = (
        abs(claim["cost"] - float(total)) <= tolerance * total
        and claim["lower_bound"] <= best * (1 + int(inexact) * tolerance)
        and claim["gap"] >= max(0.0, gap - tolerance)
        and (not claim["proven"] or (gap <= claim["gap"] + tolerance if inexact else total == best))
    )
    return "true" if is_true else "false"


def _exceeds_doubles(rings: list[list[list[float]]], name: str) -> bool:
    values = [[Fraction(point[axis]) for ring in rings for point in ring] for axis in (0, 1)]
    denominator = max(value.denominator for coordinates in values for value in coordinates)
    extent = max(max(coordinates) - min(coordinates) for coordinates in values) * denominator
    return bool(extent >= (2**25 if name == "overdraw" else 2**51))


@lru_cache(maxsize=64)
def _small(rings: str) -> SmallPolygon:
    return SmallPolygon(json.loads(rings))


@lru_cache(maxsize=64)
def _optimum(small: SmallPolygon, name: str) -> Any:
    solution = small.optimum(name)
    assert solution is not None
    return solution[0]


def _reject_duplicates(fields: list[tuple[str, Any]]) -> Claim:
    if len({name for name, _ in fields}) < len(fields):
        raise ValueError("duplicate field")
    return dict(fields)


def _is_well_formed(claim: Any) -> bool:
    def is_integer(value: Any) -> bool:
        return type(value) is int

    def is_double(value: Any) -> bool:
        return type(value) in (int, float) and float(value) == value and abs(value) < 2**1024

    def is_table(value: Any, width: int | None, is_valid: Any) -> bool:
        return type(value) is list and all(
            type(row) is list and width in (None, len(row)) and all(map(is_valid, row))
            for row in value
        )

    def is_ring(value: Any) -> bool:
        return is_table(value, 2, is_double) and len(value) > 2

    field_checks = {
        "format": lambda value: value == "raster-harness evidence 1",
        "criterion": lambda value: type(value) is str and value in NAMES,
        "rings": lambda value: type(value) is list and len(value) > 0 and all(map(is_ring, value)),
        "triangles": lambda value: is_table(value, 3, is_integer),
        **dict.fromkeys(("cost", "lower_bound", "gap", "scale"), is_double),
        "proven": lambda value: type(value) is bool,
        **dict.fromkeys(("factor", "bits"), is_integer),
        "edges": lambda value: is_table(value, 2, is_integer),
        "potentials": lambda value: is_table([value], None, is_integer),
        "lift": is_integer,
    }
    if type(claim) is not dict or set(claim) != set(field_checks):
        return False
    return all(is_valid_field(claim[name]) for name, is_valid_field in field_checks.items())


def random_polygons(rng: np.random.Generator) -> Iterator[shapely.Polygon]:
    """Yield small polygons without end, every second one with a hole."""
    number = 0
    while True:
        size = float(rng.choice(SIZES))
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(4, 8))))
        radius = size * rng.uniform(0.5, 1.0, len(angles))
        step = 1.0 if size > 1.0 else 1.0 / 256.0
        outer = np.column_stack([np.cos(angles), np.sin(angles)]) * radius[:, None]
        hole = rng.uniform(-0.3, 0.3, (3, 2)) * size
        outer, hole = (np.rint(ring / step) * step for ring in (outer, hole))
        polygon = shapely.Polygon(outer, [hole] if number % 2 else [])
        if polygon.is_valid and polygon.area > 0.0:
            number += 1
            yield polygon


def make_genuine_claims(polygon: shapely.Polygon, name: str) -> list[Claim]:
    """Return true claims about triangulations of a polygon, the optimal one first."""
    claims = []
    for method in (f"optimal:{name}", f"worst:{name}", "ear-clipping", "greedy"):
        triangles = triangulate(polygon, method)
        try:
            claims.append(make_claim(polygon, triangles, name, certify(polygon, triangles, name)))
        except TriangulationError:
            continue  # not conforming
    return claims


def find_lie(rng: np.random.Generator, claims: list[Claim]) -> Claim | None:
    """Return a false claim whose evidence is valid except for the triangles at one or two edges.

    The claim: the best triangulation without these edges is optimal. Return None if it is true.
    """
    best = claims[0]
    small, name = _small(json.dumps(best["rings"])), best["criterion"]
    optimum = small.optimum(name)
    assert optimum is not None
    edges = sorted({tuple(sorted(side)) for t in optimum[1] for side in list_sides(t)})
    hidden = [frozenset(edges[k]) for k in rng.permutation(len(edges))[: rng.integers(1, 3)]]
    restricted = small.optimum(name, hidden)
    if restricted is None or restricted[0] <= optimum[0] * (1 + 1e-9):
        return None
    first = {vertex: index for index, vertex in reversed(list(enumerate(small.vertex_of)))}
    triangles = np.array([[first[v] for v in t] for t in restricted[1]])
    polygon = shapely.Polygon(best["rings"][0], best["rings"][1:])
    claim = make_claim(polygon, triangles, name, certify(polygon, triangles, name))
    if claim["potentials"] is None:
        return None
    try:
        parsed = check_evidence.Claim(claim)
    except check_evidence.EvidenceError:
        return None
    retained = [t for t in parsed.list_empty_triangles() if not _has_hidden_edge(t, hidden, small)]
    sides = sorted({tuple(sorted(side)) for t in retained for side in list_sides(t)})
    row = {side: k for k, side in enumerate(sides)}
    matrix = np.zeros((len(retained), len(sides) + 1))
    matrix[:, -1] = with_lift = rng.random() < 0.3  # the last column is the lift
    for k, t in enumerate(retained):
        for a, b in list_sides(t):
            matrix[k, row[min(a, b), max(a, b)]] += 1 if a < b else -1
    objective = np.zeros(len(sides) + 1)
    objective[-1] = with_lift * len(triangles)
    for a, b in parsed.boundary:
        objective[row[min(a, b), max(a, b)]] += 1 if a < b else -1
    weights = np.array([float(parsed.compute_weight(t)) for t in retained])
    size = weights.max() or 1.0
    solution = linprog(-objective, matrix, weights / size, bounds=(None, None))
    if solution.x is None:
        return None
    *potentials, lift = (int(y) for y in np.rint(solution.x * size))
    claim |= {"edges": [list(side) for side in sides], "proven": True, "gap": 0.0}
    claim |= {"potentials": potentials, "lift": lift, "lower_bound": claim["cost"]}
    if rng.random() < 0.3:  # add the hidden edges
        claim["edges"] += [sorted(first[v] for v in edge) for edge in hidden]
        potentials += [0] * len(hidden)
    return claim


def _has_hidden_edge(t: tuple[int, ...], hidden: list[frozenset[int]], small: SmallPolygon) -> bool:
    corners = {small.vertex_of[v] for v in t}
    return any(edge <= corners for edge in hidden)


def forge(rng: np.random.Generator, claims: list[Claim]) -> str:
    """Return a changed claim about the polygon of genuine claims, as a line of JSON."""
    best, selected = claims[0], claims[int(rng.integers(len(claims)))]
    choice = rng.random()
    lie = find_lie(rng, claims) if choice < 0.4 else None
    if lie is not None:
        claim = copy.deepcopy(lie)
    else:
        claim = copy.deepcopy((best, selected)[int(rng.integers(2))])
        if choice < 0.7:
            claim |= copy.deepcopy({field: selected[field] for field in ("triangles", "cost")})
            claim |= {"proven": True, "gap": 0.0, "lower_bound": selected["cost"]}
    for _ in range(int(rng.choice([0, 1, 1, 2] if lie else [1, 1, 1, 2, 3]))):
        change = (_change_evidence, _change_value, _change_fields, _change_rings, _change_numbers)
        try:
            change[int(rng.integers(len(change)))](rng, claim)
            if rng.random() < 0.3:
                _update_cost(rng, claim)
        except (AttributeError, LookupError, OverflowError, TypeError, ValueError):
            continue  # an earlier change has altered the type
    text = json.dumps(claim)
    for mark, literal in LITERALS.items():
        text = text.replace(f'"{mark}"', literal)
    if rng.random() < 0.05:  # a duplicate field
        field = str(rng.choice(list(claim)))
        value = json.dumps(_replace(rng, best.get(field)))
        text = f'{{"{field}": {value}, {text[1:]}' if rng.random() < 0.5 else text
        text = f'{text[:-1]}, "{field}": {value}}}' if rng.random() < 0.5 else text
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


def _replace(rng: np.random.Generator, value: Any) -> Any:
    values: list[Any] = [None, True, False, 0, 1, -1, 0.5, "", [], {}, 10**30, 2**53 + 1, 2**63]
    values += [float("nan"), float("inf"), *LITERALS, [value], {"value": value}, str(value)]
    if type(value) in (int, float):
        values += [-value, value + 1, value * 2, value / 3, value + 1e-9, value + 2**32, 1e-300]
        values += [*[str(value)] * 4, f"{value}.0", *[float(value)] * 2, int(value), value == 1]
    return values[int(rng.integers(len(values)))]


def _change_value(rng: np.random.Generator, claim: Claim) -> None:
    parent, key = choose_value(claim, rng)
    parent[key] = _replace(rng, parent[key])


def _change_fields(rng: np.random.Generator, claim: Claim) -> None:
    parent, first = choose_value(claim, rng)
    keys = list(parent) if isinstance(parent, dict) else range(len(parent))
    second = keys[int(rng.integers(len(keys)))]
    kind = int(rng.integers(4))
    if kind == 0:
        del parent[first]
    elif kind == 1:
        parent[first], parent[second] = parent[second], parent[first]
    elif isinstance(parent, dict):
        parent["more"] = copy.deepcopy(parent[first])
    elif kind == 2:
        parent.insert(int(rng.integers(len(parent) + 1)), copy.deepcopy(parent[first]))
    else:
        parent.reverse()


def _change_rings(rng: np.random.Generator, claim: Claim) -> None:  # noqa: C901 - one branch per kind
    """Change points or rings: number, length, order or contacts."""
    rings = claim["rings"]
    ring = rings[int(rng.integers(len(rings)))]
    index = int(rng.integers(len(ring)))
    corners = np.array(rings[0], dtype=float)
    t = claim["triangles"][int(rng.integers(len(claim["triangles"])))]
    points = [point for ring_of_points in rings for point in ring_of_points]
    weights = rng.dirichlet([1.0, 1.0, 1.0])
    inside = [float(x) for x in np.rint(weights @ np.array([points[v] for v in t], dtype=float))]
    edge = [float(x) for x in (corners[0] + corners[1]) / 2.0]
    kind = int(rng.integers(14))
    if kind in (0, 1):  # a vertex of no ring, appended to another point
        rings[-1][-1] += inside * kind if kind else inside
    elif kind == 2:
        ring[index] = ring[index] + [float(x) for x in rng.integers(0, 9, rng.integers(1, 4))]
    elif kind == 3:
        ring[index] = ring[index][:1]
    elif kind == 4:
        rings.append([inside] * int(rng.integers(1, 4)))
    elif kind == 5:
        rings.append(copy.deepcopy(rings[int(rng.integers(len(rings)))]))
    elif kind == 6:
        rings.reverse()
    elif kind == 7:
        ring.reverse()
    elif kind == 8:
        rings[-1].append(list(rings[-1][0]))
    elif kind == 9:
        rings.append([list(points[t[0]]), inside, edge])
    elif kind == 10:
        ring[index] = edge
    elif kind == 11:
        ring[index] = list(points[int(rng.integers(len(points)))])
    elif kind == 12:
        rings[-1].insert(int(rng.integers(len(rings[-1]) + 1)), inside)
    else:
        rings.append([list(points[v]) for v in t])


def _update_cost(rng: np.random.Generator, claim: Claim) -> None:
    polygon = SmallPolygon([[point[:2] for point in ring] for ring in claim["rings"]])
    triangles = [[polygon.vertex_of[v] for v in t] for t in claim["triangles"]]
    total = float(sum(polygon.cost((a, b, c), claim["criterion"]) for a, b, c in triangles))
    difference = round((claim["lower_bound"] - total) * claim["scale"] * claim["factor"])
    claim |= {"cost": total, "lower_bound": total, "gap": 0.0, "proven": True}
    if rng.random() < 0.7:  # a potential of the boundary, in either orientation
        side = claim["edges"].index([0, 1])
        claim["potentials"][side] += int(rng.choice([-1, 1])) * difference


def _change_numbers(rng: np.random.Generator, claim: Claim) -> None:
    name = str(rng.choice(["gap", "gap", "cost", "lower_bound"]))
    step = float(rng.choice([1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.5, 1.0]))
    if name == "gap":
        claim["gap"] = [-step, 0.0, claim["gap"] * (1.0 - step), -0.01][int(rng.integers(4))]
    else:
        factor = 1.0 + step if name == "lower_bound" else 1.0 - step
        claim[name] = claim[name] * factor
    claim["proven"] = bool(rng.random() < 0.5)


def _change_evidence(rng: np.random.Generator, claim: Claim) -> None:
    edges, potentials = claim["edges"], claim["potentials"]
    index, size = int(rng.integers(len(potentials))), int(rng.integers(1, 63))
    kind = int(rng.integers(8))
    if kind == 0:
        claim["scale"] *= 2.0 ** int(rng.choice([-1000, -60, -20, -4, -1, 1, 4, 20, 60]))
    elif kind == 1:
        claim["factor"] = int(rng.choice([1, 4, claim["factor"] * 2, claim["factor"] + 1, 2**60]))
    elif kind == 2:
        claim["bits"] = int(rng.choice([0, 1, 2, claim["bits"] + 1, 20, 63, -1]))
    elif kind == 3:
        claim["lift"] = int(rng.choice([1, -1])) << int(rng.choice([0, 10, 20, 40, 60, 70, 100]))
    elif kind == 4:
        potentials[index] += int(rng.choice([-1, 1])) << size
    elif kind == 5:  # larger potentials of the boundary give a higher bound
        for number, (a, b) in enumerate(edges):
            if abs(a - b) == 1 and number < len(potentials):
                potentials[number] += int(rng.choice([-1, 1])) << size
    elif kind == 6:
        removed = int(rng.integers(max(len(claim["triangles"]), 1)))
        claim["triangles"] = claim["triangles"][:removed] + claim["triangles"][removed + 1 :]
    else:
        edges[int(rng.integers(len(edges)))] = [int(v) for v in rng.integers(0, 12, 2)]
