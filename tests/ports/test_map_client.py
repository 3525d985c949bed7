"""A map client covers the pixels that the harness covers: tiles are drawn as maps draw them."""

import pytest

from scripts.studies.map_client import MODULES, alone, by_maplibre, by_the_harness, reasons
from tests.ports import languages


@pytest.mark.parametrize("name", ["14/9327/4742", "15/18654/9484"])
def test_maplibre_covers_the_same_pixels(name):
    if languages.node() is None or not (MODULES / "esbuild").exists():
        pytest.skip("the client is not here; with network: make setup-test")
    ours, theirs = by_the_harness(alone(name)), by_maplibre(name)
    assert 0.3 < ours.mean() < 0.95
    assert (ours != theirs).sum() == 0


@pytest.mark.parametrize(
    ("name", "cause"), [("14/9326/4741", "left_out"), ("15/18653/9484", "clipped")]
)
def test_it_is_known_why_a_pixel_differs(name, cause):
    if languages.node() is None or not (MODULES / "esbuild").exists():
        pytest.skip("the client is not here; with network: make setup-test")
    scene = alone(name)
    different = by_the_harness(scene) != by_maplibre(name)
    causes = reasons(name, scene, different)
    assert 0 < causes[cause] == different.sum() < 20
