"""The triangulators that are ours, one algorithm a file; those of libraries are in `libraries`."""
