"""Where a file's geometries go: in metres if they are in degrees, and flat; and a word on that."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.clean import Locate
from scenes.projection import Projection, is_geographic, system, units
from scenes.reader import Raw
from scenes.scene import SceneError

_DEGREES = "OGC:CRS84"


class Placing:
    """Places the chunks of one file: all on one map, which the first chunk with a geometry decides.

    name : the file, for messages
    project : None leaves it to the file's reference system, False keeps coordinates, True takes
        those without a known system as longitude and latitude
    units : of the placed coordinates
    crs : the reference system of the source's coordinates, None if they have none after all
    projection : the map, where the file's coordinates are longitude and latitude
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
        """From the map to the source's coordinates; None where nothing was projected."""
        return None if self.projection is None else self.projection.inverse

    def place(self, raw: Raw) -> tuple[NDArray[Any], tuple[str, ...]]:
        """The chunk's geometries, and notes on the file that no earlier chunk had.

        Raises SceneError where a projection is asked for that cannot be.
        """
        given = np.empty(len(raw.geometries), dtype=object)
        given[:] = raw.geometries
        notes = list(raw.notes)
        if shapely.has_z(given).any():
            notes.append("heights (Z) dropped")
        coordinates = shapely.get_coordinates(given)
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
            return [f"reference system {shown} is not known: coordinates as in the file"]
        if off:
            return [f"coordinates as in the file: they are no degrees, though it says {known.name}"]
        return [f"coordinates as in the file: {known.name}, {self.units}"]

    def _assumed(self, crs: str | None, coordinates: NDArray[Any]) -> str:
        """The system by which coordinates are projected only because the user says so."""
        known = system(crs)
        if known is not None and not known.is_geographic:
            raise SceneError(f"{self._name} is in {known.name} already: leave project=True out")
        if not is_geographic(_DEGREES, coordinates):
            raise SceneError(
                f"{self._name} holds coordinates that are no longitude and latitude: "
                "leave project=True out"
            )
        return _DEGREES
