"""Data sets of many files, in this process or on Dask; every command can be killed and repeated."""
