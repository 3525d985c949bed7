"""Projects a file's geometries if they are in degrees, drops heights, and notes what was done."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.clean import Locate
from scenes.cleaning.projection import Projection, is_geographic, off_globe, system, units
from scenes.readers.reader import Raw
from scenes.scene import SceneError

_DEGREES = "OGC:CRS84"
_OFF = "has a vertex off the globe, beyond 90 degrees of latitude or 360 of longitude"
_TORN = "crosses the 180th meridian, where a map of the whole globe ends: cut it there"


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

    def place(self, raw: Raw) -> tuple[Raw, tuple[str, ...]]:
        """The chunk with its geometries placed, and notes on the file that no earlier chunk had.

        Geometries that cannot be on the map are named and left out. Raises SceneError if the user
        wants a projection that is not possible.
        """
        given = np.empty(len(raw.geometries), dtype=object)
        given[:] = raw.geometries
        notes = list(raw.notes)
        if shapely.has_z(given).any():
            notes.append("heights (Z) dropped")
        coordinates, owner = shapely.get_coordinates(given, return_index=True)
        off = np.zeros(len(given), dtype=bool)
        off[owner[off_globe(coordinates)]] = True
        if not self._decided:
            self.crs = raw.crs
        if not self._decided and len(coordinates):
            self._decided = True
            # one bad vertex makes no plane of a file of degrees; GDAL gives EPSG:4326 to every
            # GeoJSON without `crs`, so where most features are off the globe, it is a plane
            most = 2 * off.sum() <= len(np.unique(owner))
            notes += self._decide(raw, given[~off], on_globe=bool(most))
        fresh = tuple(note for note in notes if note not in self._said)
        self._said.update(fresh)
        if self.projection is None:
            return replace(raw, geometries=given), fresh
        torn = self.projection.torn(given) & ~off
        dropped = [(raw.labels[i], _OFF) for i in np.flatnonzero(off)]
        dropped += [(raw.labels[i], _TORN) for i in np.flatnonzero(torn)]
        kept = raw.rows(np.flatnonzero(~off & ~torn))
        projected = self.projection.project(kept.geometries)
        return replace(kept, geometries=projected, dropped=raw.dropped + dropped), fresh

    def _decide(self, raw: Raw, given: NDArray[Any], *, on_globe: bool) -> list[str]:
        """Choose the map, by the geometries that are on the globe; returns notes."""
        known = system(raw.crs)
        geographic = is_geographic(raw.crs) and on_globe
        off = known is not None and known.is_geographic and not geographic
        self.crs = None if off else raw.crs
        self.units = units(self.crs) or raw.units if raw.units == "units" else raw.units
        if self._project or (geographic and self._project is None):
            self.crs = raw.crs if geographic and raw.crs else self._assumed(raw.crs, on_globe)
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

    def _assumed(self, crs: str | None, on_globe: bool) -> str:
        """The system to take for coordinates that are projected because the user says so."""
        known = system(crs)
        if known is not None and not known.is_geographic:
            raise SceneError(f"{self._name} is in {known.name} already: leave project=True out")
        if not on_globe:
            raise SceneError(
                f"the coordinates of {self._name} are not longitude and latitude: "
                "leave project=True out"
            )
        return _DEGREES
