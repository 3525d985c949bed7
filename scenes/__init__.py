"""Polygons from named scenes and from files.

>>> from scenes import load
>>> city = load("city", buildings=200)
>>> len(city.polygons), city.units
(200, 'm')
"""

from scenes.registry import load, names
from scenes.scene import Scene, SceneError, UnknownSceneError

__version__ = "1.0.0"

__all__ = ["Scene", "SceneError", "UnknownSceneError", "load", "names"]
