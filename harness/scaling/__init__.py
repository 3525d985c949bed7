"""Data sets that are too large for one process, on Dask or in this process.

A folder of results records which parts are done (`dataset`), whoever ran them (`executors`), so
every command can be stopped, killed and run again.
"""
