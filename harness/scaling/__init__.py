"""Work over data sets and devices that are too many for one process, on Dask or in this process.

What is done is what is in a folder of results (`dataset`), whoever does it (`crew`): so any command
can be stopped, killed and given again.
"""
