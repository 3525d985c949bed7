"""Work over data sets and devices that are too many for one process, on Dask or in this process.

`task_queue` is the heart: it keeps a crew of workers busy with tasks, and counts what fails. What
is done is what is in a folder of results, so any command can be stopped, killed and given again.
"""
