"""Projection of longitude (x) and latitude (y) to metres, on a map that fits the data, by PROJ."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.spec import import_optional

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

MAX_DISTANCE_DEG = 90.0  # from the centre of an azimuthal map; larger shapes would overlap there
MAX_EDGE_DEG = 90.0  # of longitude; longer edges are meant as lines in longitude and latitude
_POLE_LATITUDE = 89.999  # degrees; at a pole, edges of any longitude difference are allowed


@cache
def find_system(crs: str | None) -> "CRS | None":
    """Return the horizontal part of a system given by name, code, WKT or PROJJSON; None if unknown.

    >>> find_system("EPSG:7844").name
    'GDA2020'
    >>> find_system("EPSG:999999") is None
    True
    """
    if not crs:
        return None
    pyproj = import_optional("pyproj", f"reference system {crs[:40]!r}", "gis")
    try:
        horizontal: CRS = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        return None
    if horizontal.is_bound and horizontal.source_crs is not None:
        horizontal = horizontal.source_crs
    if horizontal.is_compound:
        horizontal = horizontal.sub_crs_list[0]
    return horizontal.to_2d() if horizontal.is_geographic else horizontal


def is_geographic(crs: str | None) -> bool:
    """Whether a reference system known to PROJ has longitude and latitude, in degrees.

    >>> is_geographic("EPSG:6318"), is_geographic("EPSG:3067"), is_geographic(None)
    (True, False, False)
    """
    datum = find_system(crs)
    if datum is None or not datum.is_geographic:
        return False
    # Geographic systems in grads, 400 per revolution, most of them French, are not in degrees.
    return bool(abs(datum.axis_info[0].unit_conversion_factor - np.radians(1.0)) < 1e-9)


@dataclass(frozen=True)
class Projection:
    """A projection of a data set to an equal-area map, in metres.

    `crs` is the geographic system of the data, whose datum the map uses. `centre` is the longitude
    and latitude of the centre of Lambert's azimuthal equal-area projection, whose lengths are right
    to 0.1 % within 500 km. If `centre` is None, the map is Lambert's cylindrical equal-area
    projection of the full globe, on which shapes do not overlap themselves.
    """

    crs: str
    centre: tuple[float, float] | None

    @classmethod
    def fit(cls, crs: str, geometries: Any) -> "Projection":
        """Return the projection for geometries in degrees: azimuthal if they fit on that map."""
        degrees = shapely.get_coordinates(geometries)
        lon, lat = np.radians(degrees[np.isfinite(degrees).all(axis=1)]).T
        # The mean of the unit vectors is right also for points on both sides of 180 degrees.
        x, y = (np.cos(lat) * np.cos(lon)).mean(), (np.cos(lat) * np.sin(lon)).mean()
        z = np.sin(lat).mean()
        lon0, lat0 = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]).tolist()
        centre = (lon0, lat0)
        lon, lat = np.radians(degrees).T
        lon0, lat0 = np.radians(centre)
        cosine = np.sin(lat0) * np.sin(lat) + np.cos(lat0) * np.cos(lat) * np.cos(lon - lon0)
        fits = np.nanmin(cosine, initial=1.0) >= np.cos(np.radians(MAX_DISTANCE_DEG))
        if fits:
            step, middle, _ = _measure_edge_longitudes(geometries)
            step = np.abs(step)
            long = ((step > MAX_EDGE_DEG) & (step <= 180.0)) | (np.abs(step - 360.0) < 1e-9)
            fits = not (long & (np.abs(middle) < _POLE_LATITUDE)).any()
        return cls(crs, centre if fits else None)

    def __str__(self) -> str:
        if self.centre is None:
            return "Lambert cylindrical equal-area"
        lon, lat = (round(degrees, 2) + 0.0 for degrees in self.centre)
        return f"Lambert azimuthal equal-area about {lon:g}, {lat:g}"

    @cached_property
    def _to_metres(self) -> "Transformer":
        pyproj = import_optional("pyproj", "projections", "gis")
        datum = find_system(self.crs) or pyproj.CRS("OGC:CRS84")
        base = datum.source_crs if datum.is_derived and datum.source_crs is not None else datum
        operations = pyproj.crs.coordinate_operation
        conversion = (
            operations.LambertCylindricalEqualAreaConversion()
            if self.centre is None
            else operations.LambertAzimuthalEqualAreaConversion(self.centre[1], self.centre[0])
        )
        # The map uses the datum of the data, because a change of datum would shift coordinates.
        system = pyproj.crs.ProjectedCRS(conversion, geodetic_crs=base)
        transformer: Transformer = pyproj.Transformer.from_crs(datum, system, always_xy=True)
        return transformer

    def forward(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return coordinates on the map (n, 2) in metres, or infinite, given in degrees (n, 2).

        >>> helsinki = Projection("EPSG:4326", (25.0, 60.0))
        >>> helsinki.forward(np.array([[25.0, 60.0], [25.0, 60.1]])).round(2).tolist()
        [[0.0, 0.0], [0.0, 11141.3]]
        """
        if self.centre is not None:
            # -180 and 180 are the same meridian, and all longitudes at a pole the same point.
            # Equal numbers give equal points, so that a ring around a pole is closed.
            lon, lat = coordinates.T
            lon = np.where(lon == -180.0, 180.0, lon)
            lon = np.where(np.abs(lat) == 90.0, 0.0, lon)
            return np.column_stack(self._to_metres.transform(lon, lat))
        # Longitudes beyond 180 are right of the map: PROJ would wrap them to -180..180.
        revolutions = np.round(coordinates[:, 0] / 360.0)
        lon = coordinates[:, 0] - revolutions * 360.0
        x, y = self._to_metres.transform(lon, coordinates[:, 1])
        return np.column_stack([x + revolutions * self._width, y])

    def inverse(self, metres: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return longitude and latitude (n, 2), right to about 1e-11 degrees, of metres (n, 2)."""
        if self.centre is None:
            metres = metres - np.round(metres[:, :1] / self._width) * [self._width, 0.0]
        x, y = metres.T
        lon, lat = self._to_metres.transform(x, y, direction="INVERSE")
        # PROJ's inverse is accurate to some millimetres; one step of Newton's method, with finite
        # differences as derivatives, restores the source's coordinates.
        dlon, dlat = (np.copysign(1e-5, -angle) for angle in (lon, lat))
        projected = np.array(self._to_metres.transform(lon, lat))
        with np.errstate(all="ignore"):
            along = (np.array(self._to_metres.transform(lon + dlon, lat)) - projected) / dlon
            up = (np.array(self._to_metres.transform(lon, lat + dlat)) - projected) / dlat
            residual = np.array([x, y]) - projected
            steps = np.array(
                [_compute_cross_products(residual, up), _compute_cross_products(along, residual)]
            ) / _compute_cross_products(along, up)
            # At a pole the longitude is undefined, so that the step is too large: it is not made.
            steps[:, ~(np.abs(steps).max(axis=0) < 1e-4)] = 0.0
        return np.column_stack([lon + steps[0], lat + steps[1]])

    @cached_property
    def _width(self) -> float:
        east, _ = self._to_metres.transform(np.array([180.0]), np.zeros(1))
        return 2.0 * float(east[0])

    def project(self, geometries: Any) -> NDArray[Any]:
        """Return shapely geometries, or None, on the map: two-dimensional, in metres."""
        inputs = np.array(geometries, dtype=object)
        projected: NDArray[Any] = shapely.transform(inputs, self.forward)
        return projected

    def find_torn_geometries(self, geometries: NDArray[Any]) -> NDArray[np.bool_]:
        """Return flags (k,) of geometries with an edge across the end of a cylindrical map."""
        torn = np.zeros(len(geometries), dtype=bool)
        if self.centre is None:
            step, _, owner = _measure_edge_longitudes(geometries)
            torn[owner[(np.abs(step) > 180.0) & (np.abs(step) < 360.0 * (1 - 1e-12))]] = True
        return torn


def _compute_cross_products(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = a[0] * b[1] - a[1] * b[0]
    return product


def _measure_edge_longitudes(
    geometries: Any,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return longitude difference, mean latitude and geometry index (e,) of all edges of rings."""
    parts, owner = shapely.get_parts(np.asarray(geometries, dtype=object), return_index=True)
    parts, inner = shapely.get_parts(parts, return_index=True)
    polygonal = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    rings, part = shapely.get_rings(parts[polygonal], return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    middle = (xy[1:, 1] + xy[:-1, 1]) / 2
    return np.diff(xy[:, 0])[same], middle[same], owner[inner][polygonal][part][ring[1:]][same]
