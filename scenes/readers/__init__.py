"""Readers of files, a format a module; `reader` says which one serves which suffix."""
