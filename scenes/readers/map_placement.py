"""Projects a file's geometries if they are in degrees, drops heights, and notes what was done."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.clean import Locate
from scenes.cleaning.projection import Projection, is_geographic, system, units
from scenes.readers.reader import Raw
from scenes.scene import SceneError

_DEGREES = "OGC:CRS84"


class Placing:
    """Puts all chunks of one file on the same map, which the first chunk with a geometry decides.

    name : the file, for messages
    project : None: the file's reference system decides; False: never; True: coordinates without a
        known system are longitude and latitude
    units : those of the geometries that `place` returns
    crs : the reference system of the file's coordinates; None if they have none
    projection : the map, if the file's coordinates are longitude and latitude
    """

    def __init__(self, name: str, project: bool | None = None) -> None:
        self.units = "units"
        self.crs: str | None = None
        self.projection: Projection | None = None
        self._name = name
        self._project = project
        self._decided = False
        self._said: set[str] = set()

    @property
    def back(self) -> Locate | None:
        """From the map to the file's coordinates; None if nothing was projected."""
        return None if self.projection is None else self.projection.inverse

    def place(self, raw: Raw) -> tuple[NDArray[Any], tuple[str, ...]]:
        """The chunk's geometries, and notes on the file that no earlier chunk had.

        Raises SceneError if the user wants a projection that is not possible.
        """
        given = np.empty(len(raw.geometries), dtype=object)
        given[:] = raw.geometries
        notes = list(raw.notes)
        if shapely.has_z(given).any():
            notes.append("heights (Z) dropped")
        coordinates = shapely.get_coordinates(given)
        if not self._decided:
            self.crs = raw.crs
        if not self._decided and len(coordinates):
            self._decided = True
            notes += self._decide(raw, given, coordinates)
        if self.projection is not None:
            given = self.projection.project(given)
        fresh = tuple(note for note in notes if note not in self._said)
        self._said.update(fresh)
        return given, fresh

    def _decide(self, raw: Raw, given: NDArray[Any], coordinates: NDArray[Any]) -> list[str]:
        known = system(raw.crs)
        geographic = is_geographic(raw.crs, coordinates)
        off = known is not None and known.is_geographic and not geographic
        self.crs = None if off else raw.crs
        self.units = units(self.crs) or raw.units if raw.units == "units" else raw.units
        if self._project or (geographic and self._project is None):
            self.crs = raw.crs if geographic and raw.crs else self._assumed(raw.crs, coordinates)
            self.projection = Projection.of(self.crs, given)
            self.units = "m"
            name = known.name if geographic and known is not None else "taken as WGS 84"
            return [f"longitude and latitude ({name}) projected to metres, {self.projection}"]
        if raw.crs is None:
            return []
        if known is None:
            shown = raw.crs if len(raw.crs) <= 40 else f"{raw.crs[:40]}..."
            return [f"the reference system {shown} is not known, coordinates used as they are"]
        if off:
            return [f"coordinates are not degrees as in {known.name}, used as they are"]
        return [f"coordinates in {known.name}, {self.units}"]

    def _assumed(self, crs: str | None, coordinates: NDArray[Any]) -> str:
        """The system to take for coordinates that are projected because the user says so."""
        known = system(crs)
        if known is not None and not known.is_geographic:
            raise SceneError(f"{self._name} is in {known.name} already: leave project=True out")
        if not is_geographic(_DEGREES, coordinates):
            raise SceneError(
                f"the coordinates of {self._name} are not longitude and latitude: "
                "leave project=True out"
            )
        return _DEGREES
