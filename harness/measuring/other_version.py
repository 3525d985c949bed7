"""Triangulates by another version of the code, in an interpreter of its own.

What the other version must offer is the contract of its packages alone:
`triangulators.triangulate`, or a function of its own from a polygon to triangles.
`other_version_script.py` asks it for that, and what it answers is checked here, as every
triangulation is.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from harness.measuring.worker import TaskFailed
from harness.triangulating.frames import FrameTriangulation, check, small_polygons
from harness.triangulating.recipes import Recipe
from triangulators.errors import shortened

SCRIPT = Path(__file__).with_name("other_version_script.py")


@dataclass(frozen=True)
class Place:
    """Where another version of the code is.

    name : as the user gave it
    commit : of that version, "" where it is not known
    folder : its top; a folder's or an environment's
    instead_of : the folder whose code must not be found there, "" for none
    cwd, path, python : current folder, entries of PYTHONPATH and interpreter to run it with
    """

    name: str
    commit: str
    folder: str
    instead_of: str
    cwd: str
    path: tuple[str, ...]
    python: str = sys.executable


def triangulate_elsewhere(
    recipe: Recipe, polygons: Sequence[Polygon], place: Place
) -> FrameTriangulation:
    """Run the triangulator of `place` over polygons in px.

    Raises
    ------
    TaskFailed
        if it cannot be found or run there, or if what would run is the code of here
    """
    answer = _ask(
        place,
        {
            "triangulator": recipe.base,
            "parameters": recipe.parameters,
            "polygons": shapely.to_wkb(list(polygons)).tolist(),
            "warm_up": shapely.to_wkb(list(small_polygons())).tolist(),
        },
    )
    _refuse_own_code(place, recipe.base, answer["file"])
    result = FrameTriangulation(seconds=float(answer["seconds"]))
    for number, (polygon, (kind, value)) in enumerate(
        zip(polygons, answer["results"], strict=True)
    ):
        part, junctions, problem = None, 0, ""
        if kind == "triangles":
            part = np.asarray(value)
            junctions, problem = check(polygon, part)
            part = None if problem else part
        elif kind == "skipped":
            result.skipped.append((number, shortened(value)))
        else:
            problem = shortened(value)
        if problem:
            result.failed.append((number, problem))
        result.parts.append(part)
        result.t_junctions.append(junctions)
    return result


def package_of(place: Place) -> Path | None:
    """Return the folder of the package `triangulators` that code at `place` imports."""
    found = _ask(place, {"triangulator": None})["file"]
    return Path(found).parent if found else None


def _ask(place: Place, question: Mapping[str, Any]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="harness-beside-") as folder:
        asked, answered = Path(folder, "question"), Path(folder, "answer")
        asked.write_bytes(pickle.dumps(question))
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(place.path)}
        command = [place.python, "-P", str(SCRIPT), str(asked), str(answered)]
        done = subprocess.run(command, cwd=place.cwd, env=environment, stdout=2, check=False)
        if done.returncode or not answered.exists():
            raise TaskFailed(f"{place.name}: its code ended with exit code {done.returncode}")
        answer: dict[str, Any] = pickle.loads(answered.read_bytes())
    if "error" in answer:
        raise TaskFailed(f"{place.name}: {shortened(answer['error'])}")
    return answer


def _refuse_own_code(place: Place, name: str, file: str | None) -> None:
    """Nothing would be compared if the other version's name led to the code of here."""
    if not file or not place.instead_of:
        return
    found = Path(file).resolve()
    inside = found.is_relative_to(place.instead_of)
    if inside and not found.is_relative_to(place.folder) and "site-packages" not in found.parts:
        raise TaskFailed(
            f"{place.name}: {name} is found in {found}, which is HEAD's; an editable install hides "
            "BASE's code: put its folder into PYTHONPATH"
        )
