"""Write a PMTiles file of very many polygons: a folder's tiles, again and again, elsewhere.

    PYTHONPATH=. python scripts/studies/many_tiles.py FOLDER OUT.pmtiles --polygons 1000000

Tiles keep their zoom. Each has bytes of its own, by gzip's time stamp, for an archive keeps equal
tiles once. So a census reads and triangulates every one.
"""

from __future__ import annotations

import argparse
import gzip
import sys
from pathlib import Path

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from scenes.tiles.archive import Folder
from scenes.tiles.vector_tile import decode


def main() -> None:
    """Read the command line, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--polygons", type=int, default=1_000_000)
    given = parser.parse_args()
    archive = Folder(given.folder)
    (zoom,) = archive.zooms
    tiles = [archive.read(name) or b"" for name in archive.names(zoom)]
    each = sum(len(layer.polygons) for tile in tiles for layer in decode(tile))
    count = len(tiles) * -(-given.polygons // each)
    side = int(count**0.5) + 1
    places = sorted(zxy_to_tileid(zoom, k % side, k // side) for k in range(count))
    with write(str(given.out)) as writer:
        for number, place in enumerate(places):
            tile = tiles[number % len(tiles)]
            writer.write_tile(place, gzip.compress(tile, 9, mtime=number))
        bounds = {"min_lon_e7": -1800000000, "max_lon_e7": 1800000000}
        bounds |= {"min_lat_e7": -850000000, "max_lat_e7": 850000000}
        header = {"tile_type": TileType.MVT, "tile_compression": Compression.GZIP, **bounds}
        writer.finalize(header, {"vector_layers": []})
    sys.stdout.write(f"{given.out}: {count} tiles, {count // len(tiles) * each} polygons\n")


if __name__ == "__main__":
    main()
