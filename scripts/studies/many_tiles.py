"""Write PMTiles files of many polygons, and say what a census of each takes.

    PYTHONPATH=. python scripts/studies/many_tiles.py TILES FOLDER --out many.csv

TILES is a folder of one zoom: its tiles are written again and again at other places. Each has bytes
of its own, by gzip's time stamp, for an archive keeps equal tiles once. So a census reads and
triangulates every one. Memory of a worker is that of its process and of those under it.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from scenes.tiles.archive import Folder
from scenes.tiles.vector_tile import decode
from scripts.scale import watch
from tests.paths import ROOT

COLUMNS = ("polygons", "tiles", "file_bytes", "workers", "seconds", "core_seconds", "worker_mb",
           "command_mb", "load")  # fmt: skip


def main() -> None:
    """Read the command line, write the files, and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tiles", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--polygons", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    with given.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for polygons in given.polygons:
            archive = given.folder / f"{polygons}.pmtiles"
            written = repeated(given.tiles, archive, polygons)
            row = {**written, **taken(archive, given.workers)}
            writer.writerow(row)
            sys.stdout.write(f"{row}\n")
            sys.stdout.flush()


def repeated(folder: Path, out: Path, polygons: int) -> dict[str, Any]:
    """Write the tiles of a folder until there are so many polygons."""
    archive = Folder(folder)
    (zoom,) = archive.zooms
    tiles = [archive.read(name) or b"" for name in archive.names(zoom)]
    each = sum(len(layer.polygons) for tile in tiles for layer in decode(tile))
    count = len(tiles) * -(-polygons // each)
    side = int(count**0.5) + 1
    places = sorted(zxy_to_tileid(zoom, k % side, k // side) for k in range(count))
    with write(str(out)) as writer:
        for number, place in enumerate(places):
            tile = tiles[number % len(tiles)]
            writer.write_tile(place, gzip.compress(tile, 9, mtime=number))
        header = {"tile_type": TileType.MVT, "tile_compression": Compression.GZIP}
        writer.finalize(header, {"vector_layers": []})
    total = count // len(tiles) * each
    return {"polygons": total, "tiles": count, "file_bytes": out.stat().st_size}


def taken(archive: Path, workers: int) -> dict[str, Any]:
    """Count all of an archive by the command, and watch it."""
    out = archive.with_suffix("")
    load = psutil.getloadavg()[0]
    command = [sys.executable, "-m", "harness", "census", str(archive), "-o", str(out)]
    begun = time.monotonic()
    process = subprocess.Popen(
        [*command, "--dask", f"local:{workers}"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    peaks = {"worker": 0, "command": 0, "core_ms": 0}
    watch(process, lambda _: None, peaks)
    if process.returncode:
        raise SystemExit(f"the census ended with exit code {process.returncode}")
    return {
        "workers": workers,
        "seconds": f"{time.monotonic() - begun:.1f}",
        "core_seconds": f"{peaks['core_ms'] / 1e3:.1f}",
        "worker_mb": round(peaks["worker"] / 1e6),
        "command_mb": round(peaks["command"] / 1e6),
        "load": f"{load:.1f}",
    }


if __name__ == "__main__":
    main()
