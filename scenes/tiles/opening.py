"""Which archive a path is."""

from __future__ import annotations

from pathlib import Path

from scenes.tiles.archive import Archive, Folder
from scenes.tiles.mbtiles import MBTiles
from scenes.tiles.pmtiles import PMTiles

KINDS: dict[str, type[Archive]] = {".pmtiles": PMTiles, ".mbtiles": MBTiles}
"""Archives in a file, by its suffix."""


def opened(path: Path) -> Archive:
    """The archive that a path is; raises SceneError where it is none."""
    return KINDS.get("" if path.is_dir() else path.suffix.lower(), Folder)(path)
