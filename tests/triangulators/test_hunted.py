"""Polygons on which something went wrong once, found by hunts at random."""

import csv
from pathlib import Path

import pytest
import shapely

from triangulators import certify, triangulate, vertices
from triangulators.certificate.certify import check_certificate
from triangulators.criteria import find
from triangulators.verify import verify

with Path(__file__).with_name("hunted.csv").open(encoding="utf-8") as file:
    FOUND = [(row["criterion"], shapely.from_wkt(row["wkt"])) for row in csv.DictReader(file)]


@pytest.mark.parametrize("number", range(len(FOUND)))
def test_what_was_found_is_optimal_and_proven(number):
    criterion, polygon = FOUND[number]
    best = triangulate(polygon, "optimal", criterion=criterion)
    certificate = certify(polygon, best, criterion)
    assert certificate.proven
    check_certificate(polygon, best, criterion, certificate)
    for name in (f"optimal:{criterion}", "greedy", "refined"):
        triangles = triangulate(polygon, name)
        assert verify(polygon, triangles).conforming
        cost = find(criterion).total(vertices(polygon), triangles)
        if name == f"optimal:{criterion}":
            assert cost == pytest.approx(certificate.cost, rel=1e-12)
        else:
            assert cost >= certificate.lower_bound
