"""The commands of `raster-harness`, one file per command; `index.py` lists them."""
