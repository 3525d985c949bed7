"""Make false claims of optimality, and see that neither checker accepts one.

    PYTHONPATH=. python scripts/false_claims.py [--claims 100000] [--seed 0]

A claim is made of small random polygons, half of them with holes: a true one, which both checkers
must accept, then false ones. Each is about a triangulation that is not optimal and says it is,
with evidence of the optimum, of its own, or of another criterion, that is changed in one to three
places: scale, factor, bits, lift, potentials, exclusions and their order, branches, triangles,
bound. What is claimed is false whatever the evidence says, so an acceptance is an error. The first
checker is the package's, the second scripts/check_evidence.py, which shares no code with it.
"""

from __future__ import annotations

import argparse
import copy
import importlib.util
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from triangulators import certify, triangulate
from triangulators.certificate.certify import check_certificate
from triangulators.checking.claims import as_claim, from_claim
from triangulators.errors import TriangulationError

Claim = dict[str, Any]
NAMES = ("half-perimeter", "overdraw", "edge-length")
_FILE = Path(__file__).with_name("check_evidence.py")


def plain_checker() -> Any:
    """Return scripts/check_evidence.py as a module."""
    spec = importlib.util.spec_from_file_location("check_evidence", _FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PLAIN = plain_checker()


def accepted_by_ours(claim: Claim) -> bool:
    """Whether the package's checker accepts a claim."""
    try:
        polygon, triangles, certificate = from_claim(claim)
        check_certificate(polygon, triangles, claim["criterion"], certificate)
    except (TriangulationError, ValueError, TypeError, OverflowError):
        return False
    return True


def accepted_by_plain(claim: Claim) -> bool:
    """Whether scripts/check_evidence.py accepts a claim."""
    try:
        PLAIN.check(claim)
    except PLAIN.Refused:
        return False
    return True


def polygons(rng: np.random.Generator) -> Iterator[shapely.Polygon]:
    """Yield small polygons for ever, every second one with a hole."""
    number = 0
    while True:
        size = int(rng.choice([8, 30, 1000]))
        turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(4, 8))))
        radius = size * rng.uniform(0.6, 1.0, len(turns))
        outer = np.rint(np.column_stack([np.cos(turns), np.sin(turns)]) * radius[:, None])
        hole = np.rint(rng.uniform(-0.3, 0.3, (3, 2)) * size)
        polygon = shapely.Polygon(outer, [hole] if number % 2 else [])
        if polygon.is_valid and polygon.area > 0.0:
            number += 1
            yield polygon


def true_claims(polygon: shapely.Polygon, name: str) -> list[Claim]:
    """Return true claims about the optimum and other triangulations of a polygon."""
    found = []
    for method in ("optimal", "worst", "ear-clipping", "greedy"):
        if method in ("optimal", "worst"):
            triangles = triangulate(polygon, method, criterion=name)
        else:
            triangles = triangulate(polygon, method, repair=True)
        try:
            found.append(as_claim(polygon, triangles, name, certify(polygon, triangles, name)))
        except TriangulationError:
            continue  # not conforming
    return found


def false_claim(rng: np.random.Generator, claims: list[Claim]) -> Claim | None:
    """Return a false claim made of true ones about one polygon; None where all are optimal."""
    best = claims[0]
    worse = [claim for claim in claims if claim["cost"] > best["cost"] * (1.0 + 1e-9)]
    if not worse:
        return None
    about = worse[int(rng.integers(len(worse)))]
    source = (best, about)[int(rng.integers(2))]
    claim = copy.deepcopy(source)
    for key in ("triangles", "cost"):
        claim[key] = copy.deepcopy(about[key])
    claim["proven"], claim["gap"] = True, 0.0
    if rng.random() < 0.8:
        claim["lower_bound"] = about["cost"]
    for _ in range(int(rng.integers(1, 4))):
        _change(rng, claim)
    return claim


def _change(rng: np.random.Generator, claim: Claim) -> None:  # noqa: C901 - a way each
    """Change one place of a claim's evidence."""
    root, edges = claim["root"], claim["edges"]
    if "potentials" not in root:
        root = root["within"] if rng.random() < 0.5 and "potentials" in root["within"] else {}
    potentials = root.get("potentials", [0])
    place, size = int(rng.integers(len(potentials))), int(rng.integers(1, 63))
    way = int(rng.integers(10))
    if way == 0:
        claim["scale"] *= 2.0 ** int(rng.choice([-1000, -60, -20, -4, -1, 1, 4, 20, 60]))
    elif way == 1:
        claim["factor"] = int(rng.choice([1, 4, claim["factor"] * 2, claim["factor"] + 1, 2**60]))
    elif way == 2:
        claim["bits"] = int(rng.choice([0, 1, 2, claim["bits"] + 1, 20, 63, -1]))
    elif way == 3:
        root["lift"] = int(rng.choice([1, -1])) << int(rng.choice([0, 10, 20, 40, 60, 70, 100]))
    elif way == 4:
        potentials[place] += int(rng.choice([-1, 1])) << size
    elif way == 5:  # what the boundary has more makes a higher bound
        for number, (a, b) in enumerate(edges):
            if abs(a - b) == 1 and number < len(potentials):
                potentials[number] += int(rng.choice([-1, 1])) << size
    elif way == 6:
        claim["excluded"] = [int(e) for e in rng.permutation(len(edges))[: rng.integers(1, 9)]]
    elif way == 7:
        a, b = (int(v) for v in edges[int(rng.integers(len(edges)))])
        claim["root"] = {"edge": [a, b], "without": claim["root"], "within": claim["root"]}
    elif way == 8:
        keep = int(rng.integers(max(len(claim["triangles"]), 1)))
        claim["triangles"] = claim["triangles"][:keep] + claim["triangles"][keep + 1 :]
    else:
        edges[int(rng.integers(len(edges)))] = [int(v) for v in rng.integers(0, 12, 2)]


def main() -> None:
    """Make claims, judge them and print what became of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--claims", type=int, default=100_000)
    parser.add_argument("--each", type=int, default=60, help="false claims of a polygon")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    counts: Counter[str] = Counter()
    for number, polygon in enumerate(polygons(rng)):
        claims = true_claims(polygon, NAMES[number % 3])
        for claim in claims:
            counts["true claims"] += 1
            counts["true claims accepted by the package"] += accepted_by_ours(claim)
            counts["true claims accepted by check_evidence.py"] += accepted_by_plain(claim)
        for _ in range(given.each):
            false = false_claim(rng, claims)
            if false is None:
                break
            counts["false claims"] += 1
            for judge, accepts in (
                ("the package", accepted_by_ours),
                ("check_evidence.py", accepted_by_plain),
            ):
                if accepts(false):
                    counts[f"false claims accepted by {judge}"] += 1
                    print(f"accepted by {judge}: {false}")
        if counts["false claims"] >= given.claims:
            break
    for name in (
        "true claims",
        "true claims accepted by the package",
        "true claims accepted by check_evidence.py",
        "false claims",
        "false claims accepted by the package",
        "false claims accepted by check_evidence.py",
    ):
        print(f"{counts[name]:>8,} {name}")


if __name__ == "__main__":
    main()
